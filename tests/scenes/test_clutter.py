# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physim_drake.objects.model import ObjectLibrary
from physim_drake.scenes.clutter import draw_distractors, draw_room
from physim_drake.scenes.generation import write_models
from physim_drake.scenes.recording import DatasetConfig, SceneRecord, record_scene
from physim_drake.scenes.views import ViewConfig

VIEW = ViewConfig(vivid=True, distractors=5, height=(0.4, 0.9), min_visible=0.1)


@given(seed=st.integers(0, 10_000), most=st.integers(0, 8))
def test_distractors_keep_clear_of_the_objects(seed: int, most: int):
    circles = np.array([[0.0, 0.0, 0.1], [0.2, -0.1, 0.05]])
    props = draw_distractors(circles, most, 1.0, np.random.default_rng(seed))
    assert len(props) <= most
    for prop in props:
        gap = np.linalg.norm(prop.X_WP[:2, 3] - circles[:, :2], axis=1) - circles[:, 2]
        assert (gap > 0.02).all()  # the radius of the smallest thing, and more
        assert 0.01 < prop.X_WP[2, 3] < 0.1


def test_low_containers_take_low_distractors():
    rng = np.random.default_rng(0)
    for _ in range(20):
        props = draw_distractors(np.zeros((0, 3)), 5, 0.06, rng)
        assert all(prop.X_WP[2, 3] < 0.03 for prop in props)


def test_the_room_is_below_and_around():
    for seed in range(10):
        floor, *furniture = draw_room(np.random.default_rng(seed))
        assert floor.X_WP[2, 3] < -0.5
        for prop in furniture:
            assert np.linalg.norm(prop.X_WP[:2, 3]) > 1.0


@pytest.fixture(scope="module")
def record(
    library: ObjectLibrary, tmp_path_factory: pytest.TempPathFactory
) -> SceneRecord:
    files = write_models(library, tmp_path_factory.mktemp("models"))
    config = DatasetConfig(seed=2, levels=(1,), max_objects=2, views=3, view=VIEW)
    return record_scene(library, config, 1, files)


def test_vivid_views_look_different(record: SceneRecord):
    colors = [view.observation.color for view in record.views]
    assert all(color is not None for color in colors)
    corners = np.array([c[:60, :60].mean(axis=(0, 1)) for c in colors if c is not None])
    assert np.ptp(corners, axis=0).max() > 20


def test_distractors_are_seen_but_have_no_label(
    library: ObjectLibrary, tmp_path_factory: pytest.TempPathFactory
):
    """Something high stands on the table where no object is."""
    files: dict[int, Path] = write_models(library, tmp_path_factory.mktemp("files"))
    view = replace(VIEW, noise=False, distractors=12)
    config = DatasetConfig(seed=4, levels=(1,), max_objects=2, views=1, view=view)
    record = record_scene(library, config, 1, files)
    raised = []
    for image in record.views:
        X_WC = image.observation.X_WC
        assert X_WC is not None
        p_C = image.observation.intrinsics.unproject(image.true_depth)
        z_W = p_C @ X_WC[2, :3] + X_WC[2, 3]
        other = ~image.visible.any(axis=0) & (image.true_depth > 0)
        raised.append(int(((z_W > 0.02) & (z_W < 0.3) & other).sum()))
    assert max(raised) > 300


def test_cameras_keep_to_their_heights(record: SceneRecord):
    for view in record.views:
        assert view.observation.X_WC is not None
        # It looks at the middle of the objects, a little above the surface.
        assert 0.36 < view.observation.X_WC[2, 3] < 1.1
