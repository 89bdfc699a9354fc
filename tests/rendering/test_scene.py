# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Box

from physim_drake.camera import CameraIntrinsics
from physim_drake.errors import InputError
from physim_drake.models import APC11
from physim_drake.objects.containers import ContainerName, load_container
from physim_drake.objects.model import ObjectLibrary
from physim_drake.objects.sdformat import write_drake_model
from physim_drake.poses import inverse, make_pose
from physim_drake.rendering.appearance import Appearance
from physim_drake.rendering.depth import DepthRenderer
from physim_drake.rendering.scene import Prop, SceneRenderer
from tests.disks import room_for

K = CameraIntrinsics(320, 240, 300.0, 300.0, 158.0, 121.0)
DOWN = np.diag([1.0, -1.0, -1.0])
X_WC = make_pose(DOWN, [0.0, 0.0, 0.8])
BOX, CAN = 8, 3
# The can stands half behind the box as seen from above: it is lower and beside.
X_WO = np.stack([make_pose(p=[0.0, 0.0, 0.2]), make_pose(p=[0.09, 0.0, 0.06])])


@pytest.fixture(scope="module")
def library() -> ObjectLibrary:
    return ObjectLibrary.load(APC11, [BOX, CAN])


@pytest.fixture(scope="module")
def visuals(
    library: ObjectLibrary, tmp_path_factory: pytest.TempPathFactory
) -> list[Path]:
    folder = tmp_path_factory.mktemp("visuals")
    return [
        write_drake_model(library[i], folder / str(i)).with_suffix(".obj")
        for i in (BOX, CAN)
    ]


@pytest.fixture(scope="module")
def renderer(visuals: list[Path]) -> SceneRenderer:
    container = load_container(ContainerName.TABLE)
    return SceneRenderer(visuals, container, Appearance.plain())


def test_depth_is_that_of_the_reference_renderer(
    renderer: SceneRenderer, library: ObjectLibrary
):
    reference = DepthRenderer(library, K)
    X_CO = inverse(X_WC) @ X_WO
    images = renderer.render(X_WO, X_WC, K)
    for n, object_id in enumerate((BOX, CAN)):
        seen = images.labels == n
        alone = reference.render(object_id, X_CO[n])
        assert seen.sum() > 1000
        assert np.abs(images.depth - alone)[seen & (alone > 0)].max() < 1e-4
    table = images.labels == -1
    assert images.depth[table] == pytest.approx(0.8, abs=1e-4)


def test_silhouette_ignores_what_stands_before(renderer: SceneRenderer):
    visible = renderer.visible_labels(X_WO, X_WC, K) == 1
    whole = renderer.silhouette(1, X_WO, X_WC, K)
    assert (whole | visible).sum() == whole.sum()
    assert 0.3 * whole.sum() < visible.sum() < 0.9 * whole.sum()
    box = renderer.silhouette(0, X_WO, X_WC, K)
    assert (renderer.visible_labels(X_WO, X_WC, K) == 0).sum() == box.sum()


def test_textures_and_lights_change_the_color_only(visuals: list[Path]):
    container = load_container(ContainerName.TABLE)
    images = []
    for seed in (1, 2):
        appearance = Appearance.draw(np.random.default_rng(seed))
        renderer = SceneRenderer(visuals, container, appearance)
        images.append(renderer.render(X_WO, X_WC, K))
    a, b = images
    assert np.array_equal(a.depth, b.depth)
    assert np.array_equal(a.labels, b.labels)
    table = a.labels == -1
    difference = np.abs(a.color.astype(int) - b.color.astype(int))[table].mean()
    assert difference > 10


def test_objects_show_their_print(renderer: SceneRenderer):
    image = renderer.render(X_WO, X_WC, K)
    assert image.color[image.labels == 0].std(axis=0).max() > 25


@pytest.mark.parametrize("name", list(ContainerName))
def test_surface_is_the_plane_z_0(name: ContainerName, visuals: list[Path]):
    container = load_container(name)
    renderer = SceneRenderer(visuals, container, Appearance.plain())
    far = np.stack([make_pose(p=[0, 0, -50.0]), make_pose(p=[5, 0, -50.0])])
    X_WC = make_pose(DOWN, [0.0, 0.0, 0.3])
    depth = renderer.render_depth(far, X_WC, K)
    assert depth[100:140, 140:180] == pytest.approx(0.3, abs=1e-4)


def test_a_texture_that_does_not_fit_on_the_disk_is_named(visuals: list[Path]):
    """Half of one would end the process."""
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    props = [Prop(Box(0.1, 0.1, 0.1), np.eye(4), noise)]
    table, plain = load_container(ContainerName.TABLE), Appearance.plain()
    with room_for(1000), pytest.raises(InputError, match=r"\.png: cannot be written"):
        SceneRenderer(visuals, table, plain, props)
