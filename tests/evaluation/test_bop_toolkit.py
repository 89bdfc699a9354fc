# SPDX-License-Identifier: MIT
"""The challenge's own toolkit reads our datasets and agrees with our errors.

It is in no package registry at present; where someone has installed it by hand, these
tests run.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physim_drake.camera import CameraIntrinsics
from physim_drake.datasets.bop import BopDataset
from physim_drake.evaluation.visible_surface import SceneDistances, vsd
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.pose_errors import add, mssd, symmetry_samples
from physim_drake.poses import Array
from physim_drake.rendering.depth import DepthRenderer
from tests.synthetic import perturbed

toolkit = pytest.importorskip(
    "bop_toolkit_lib.pose_error",
    reason="bop_toolkit is not installed, and no package registry has it",
)
inout = pytest.importorskip("bop_toolkit_lib.inout")

EXAMPLE = Path(__file__).parents[2] / "examples" / "data" / "tabletop"


@pytest.fixture(scope="module")
def dataset() -> BopDataset:
    return BopDataset(EXAMPLE, models=APC11)


@pytest.fixture(scope="module")
def library(dataset: BopDataset) -> ObjectLibrary:
    return ObjectLibrary.load(APC11, {t.object_id for t in dataset.targets()})


def R_t_mm(X: Array) -> tuple[Array, Array]:
    return X[:3, :3], 1000 * X[:3, 3:]


def test_loaders_read_the_same_poses_and_depth(dataset: BopDataset) -> None:
    scene = EXAMPLE / "test" / "000001"
    truth = inout.load_scene_gt(str(scene / "scene_gt.json"))[0]
    camera = inout.load_scene_camera(str(scene / "scene_camera.json"))[0]
    depth = inout.load_depth(str(scene / "depth" / "000000.png"))
    ours = dataset.ground_truth(1, 0)
    for entry, pose in zip(truth, ours, strict=True):
        assert entry["obj_id"] == pose.object_id
        np.testing.assert_allclose(
            entry["cam_t_m2c"].ravel(), 1000 * pose.X_CO[:3, 3], atol=1e-6
        )
    np.testing.assert_allclose(
        depth * camera["depth_scale"] / 1000, dataset.observation(1, 0).depth, atol=1e-6
    )


def test_add_and_mssd_agree(dataset: BopDataset, library: ObjectLibrary) -> None:
    for truth in dataset.ground_truth(1, 0):
        model = library[truth.object_id]
        X = perturbed(truth.X_CO, 0.01, 8.0, truth.object_id)
        vertices = np.asarray(model.mesh.vertices)
        arguments = (*R_t_mm(X), *R_t_mm(truth.X_CO), 1000 * vertices)
        assert 1000 * add(vertices, truth.X_CO, X) == pytest.approx(
            toolkit.add(*arguments), rel=1e-9
        )
        samples = symmetry_samples(model.symmetry, truth.X_CO, X)
        symmetries = [{"R": S[:3, :3], "t": 1000 * S[:3, 3:]} for S in samples]
        assert 1000 * mssd(vertices, truth.X_CO, X, samples) == pytest.approx(
            toolkit.mssd(*arguments, symmetries), rel=1e-9
        )


class _ToolkitRenderer:
    """Our renderer behind the toolkit's interface, mm."""

    def __init__(self, renderer: DepthRenderer) -> None:
        self._renderer = renderer

    def render_object(
        self, obj_id: int, R: Array, t: Array, *_: float
    ) -> dict[str, Array]:
        X = np.eye(4)
        X[:3, :3], X[:3, 3] = R, np.ravel(t) / 1000
        return {"depth": 1000.0 * self._renderer.render(obj_id, X)}


def test_vsd_agrees(dataset: BopDataset, library: ObjectLibrary) -> None:
    observation = dataset.observation(1, 0)
    K: CameraIntrinsics = observation.intrinsics
    renderer = DepthRenderer(library, K)
    scene = SceneDistances.from_depth(observation.depth, K)
    taus = np.linspace(0.05, 0.5, 10)
    for truth in dataset.ground_truth(1, 0):
        model = library[truth.object_id]
        X = perturbed(truth.X_CO, 0.008, 6.0, truth.object_id)
        ours = vsd(
            scene,
            renderer.render(truth.object_id, truth.X_CO),
            renderer.render(truth.object_id, X),
            model.diameter,
        )
        theirs = toolkit.vsd(
            *R_t_mm(X),
            *R_t_mm(truth.X_CO),
            1000.0 * observation.depth,
            K.K,
            15.0,
            taus,
            True,
            1000 * model.diameter,
            _ToolkitRenderer(renderer),
            truth.object_id,
        )
        np.testing.assert_allclose(ours, theirs, atol=1e-3)
