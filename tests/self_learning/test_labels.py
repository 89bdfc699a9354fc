# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physim_drake.datasets.bop import BopDataset
from physim_drake.errors import InputError
from physim_drake.estimation.estimator import EstimationConfig, Method, PoseEstimator
from physim_drake.self_learning.labels import (
    LabelledScene,
    SceneLearner,
    box_overlap,
    write_labelled_scene,
)
from tests.self_learning.views import AREA, CAMERAS, seen_from, view_of
from tests.synthetic import (
    ERASER,
    GLUE,
    SOAP,
    library,
    pair_apart,
    perturbed,
    pose_error,
    stack,
)

FIRST, SECOND = pair_apart()


@pytest.fixture(scope="module")
def learner():
    config = EstimationConfig(method=Method.SUPER4PCS_ICP)
    with PoseEstimator(library(), config) as estimator:
        yield SceneLearner(library(), estimator, AREA)


def check_truth(scene: LabelledScene, objects, cameras) -> None:
    """The labels are those of the true poses."""
    truth = dict(objects)
    for image, camera in zip(scene.images, cameras, strict=True):
        true_scene, _ = seen_from(objects, camera)
        masks = dict(zip([i for i, _ in objects], true_scene.masks, strict=True))
        np.testing.assert_array_equal(image.observation.X_WC, camera)
        for n, object_id in enumerate(image.object_ids):
            X_WO = camera @ image.X_CO[n]
            symmetry = library()[object_id].symmetry
            shift, turn = pose_error(X_WO, truth[object_id], symmetry)
            assert shift < 3
            assert turn < 3
            both = image.visible[n] & masks[object_id]
            assert both.sum() > 0.9 * (image.visible[n] | masks[object_id]).sum()


def test_a_view_is_labelled_by_what_others_saw(learner: SceneLearner):
    """In the last view nothing was detected, in the others one object each time."""
    near = [(i, perturbed(X, 0.001, 0.005, n)) for n, (i, X) in enumerate(stack())]
    views = [
        view_of(stack(), CAMERAS[0], near),
        view_of(stack(), CAMERAS[1], stack()),
        view_of(stack(), CAMERAS[2], []),
    ]
    scene = learner.labelled(views)
    assert {o.object_id for o in scene.objects} == {ERASER, SOAP}
    assert len(scene.images) == 3
    assert (scene.labels, scene.missed) == (6, 2)
    check_truth(scene, stack(), CAMERAS)


def test_a_wrong_object_is_seen_through(learner: SceneLearner):
    """Two views agree on it, but where it should be there is the table."""
    shown = [FIRST]
    ghost = (SOAP, SECOND[1])
    views = [view_of(shown, camera, [FIRST, ghost]) for camera in CAMERAS]
    scene = learner.labelled(views)
    assert [o.object_id for o in scene.objects] == [GLUE]
    assert all(image.object_ids == [GLUE] for image in scene.images)


def test_an_object_that_nobody_is_sure_of_is_painted_over(learner: SceneLearner):
    views = [view_of(pair_apart(), camera, [FIRST]) for camera in CAMERAS]
    scene = learner.labelled(views)
    for image, view, camera in zip(scene.images, views, CAMERAS, strict=True):
        assert image.object_ids == [GLUE]
        true_scene, _ = seen_from(pair_apart(), camera)
        assert image.observation.color is not None
        changed = (image.observation.color != view.observation.color).any(axis=-1)
        assert changed[true_scene.masks[1]].mean() > 0.9
        assert not changed[true_scene.masks[0]].any()
        assert image.observation.depth[true_scene.masks[1]].mean() < 0.02


def test_a_scene_of_which_nothing_is_certain_gives_no_image(learner: SceneLearner):
    views = [view_of(pair_apart(), CAMERAS[0], [FIRST]), view_of([], CAMERAS[1], [])]
    scene = learner.labelled(views)
    assert scene.images == ()
    assert scene.labels == scene.missed == 0


def test_poses_are_estimated_from_detections(learner: SceneLearner):
    views = []
    for camera in CAMERAS[:2]:
        scene, observation = seen_from(pair_apart(), camera)
        views.append(learner.estimated(observation, scene.detections))
    views.append(learner.estimated(seen_from(pair_apart(), CAMERAS[2])[1], []))
    learnt = learner.labelled(views)
    assert {o.object_id for o in learnt.objects} == {GLUE, SOAP}
    assert (learnt.labels, learnt.missed) == (6, 2)
    check_truth(learnt, pair_apart(), CAMERAS)


def test_a_view_without_a_pose_is_refused(learner: SceneLearner):
    _, observation = seen_from([FIRST], CAMERAS[0])
    with pytest.raises(InputError, match="no camera pose"):
        learner.estimated(replace(observation, X_WC=None), [])
    with pytest.raises(InputError, match="no colour"):
        learner.estimated(replace(observation, color=None), [])


def test_overlap_of_boxes():
    box = np.array([0.0, 0.0, 10.0, 10.0])
    assert box_overlap(box, box) == pytest.approx(1)
    assert box_overlap(box, box + np.array([5.0, 0, 5, 0])) == pytest.approx(1 / 3)
    assert box_overlap(box, box + 20.0) == 0


def test_labelled_scenes_are_read_back(learner: SceneLearner, tmp_path: Path):
    views = [view_of(stack(), camera, stack()) for camera in CAMERAS[:2]]
    scene = learner.labelled(views)
    (tmp_path / "test").mkdir()
    write_labelled_scene(tmp_path / "test", 4, scene.images, library())
    dataset = BopDataset(tmp_path)
    assert dataset.images() == [(4, 0), (4, 1)]
    for image_id, image in zip(dataset.images(), scene.images, strict=True):
        observation = dataset.observation(*image_id)
        np.testing.assert_array_equal(observation.color, image.observation.color)
        np.testing.assert_allclose(observation.X_WC, image.observation.X_WC, atol=1e-6)
        found = dataset.masks(*image_id)
        assert [d.object_id for d in found] == list(image.object_ids)
        for d, visible in zip(found, image.visible, strict=True):
            np.testing.assert_array_equal(d.mask, visible)


def test_a_scene_that_cannot_be_written_leaves_nothing(
    learner: SceneLearner, tmp_path: Path
):
    views = [view_of(stack(), camera, stack()) for camera in CAMERAS[:2]]
    scene = learner.labelled(views)
    target = tmp_path / "000004"
    target.mkdir()
    (target / "kept").touch()
    with pytest.raises(InputError, match="cannot be written"):
        write_labelled_scene(tmp_path, 4, scene.images, library())
    assert [p.name for p in tmp_path.iterdir()] == ["000004"]
    assert [p.name for p in target.iterdir()] == ["kept"]
