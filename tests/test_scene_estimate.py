# SPDX-License-Identifier: MIT
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.parsing import (
    LoadModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import MultibodyPlant

from physim_drake.errors import InputError
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.poses import Array, make_pose
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate
from tests.synthetic import SOAP, TISSUES, library, turned

X_A = make_pose(turned("xyz", 20, -50, 130), [0.1, -0.2, 0.3])
X_B = make_pose(turned("zyx", 170, 89, -20), [-0.4, 0.0, 0.05])


def found(object_id: int, X_WO: Array) -> ObjectEstimate:
    name = library()[object_id].name
    return ObjectEstimate(object_id, name, X_WO, X_WO, 0.9, "")


def not_found(object_id: int) -> ObjectEstimate:
    name = library()[object_id].name
    return ObjectEstimate(object_id, name, None, None, 0.0, "its segment is empty")


def estimate_of(objects: Sequence[ObjectEstimate]) -> SceneEstimate:
    surface = SupportSurface(np.eye(4), np.eye(4))
    return SceneEstimate(
        tuple(objects), surface, "physim-mcts", {"search": 1.25, "segments": 0.25}
    )


def parsed(path: Path) -> MultibodyPlant:
    plant = MultibodyPlant(0.001)
    ProcessModelDirectives(LoadModelDirectives(str(path)), Parser(plant))
    plant.Finalize()
    return plant


def body_pose(plant: MultibodyPlant, name: str) -> Array:
    body = plant.GetBodyByName("body", plant.GetModelInstanceByName(name))
    context = plant.CreateDefaultContext()
    return np.asarray(plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4())


def test_drake_puts_each_body_where_it_was_estimated(tmp_path: Path) -> None:
    result = estimate_of([found(SOAP, X_A), not_found(TISSUES), found(TISSUES, X_B)])
    plant = parsed(result.to_model_directives(library(), tmp_path / "made"))
    for object_id, X in ((SOAP, X_A), (TISSUES, X_B)):
        pose = body_pose(plant, library()[object_id].name)
        np.testing.assert_allclose(pose, X, atol=1e-9)
    # The world, the default instance and the two found objects.
    assert plant.num_model_instances() == 4
    assert plant.num_positions() == 0


def test_two_of_the_same_object_get_names_of_their_own(tmp_path: Path) -> None:
    result = estimate_of([found(SOAP, X_A), found(SOAP, X_B)])
    plant = parsed(result.to_model_directives(library(), tmp_path))
    name = library()[SOAP].name
    np.testing.assert_allclose(body_pose(plant, name), X_A, atol=1e-9)
    np.testing.assert_allclose(body_pose(plant, f"{name}_2"), X_B, atol=1e-9)


def test_nothing_found_is_an_empty_scene(tmp_path: Path) -> None:
    plant = parsed(
        estimate_of([not_found(SOAP)]).to_model_directives(library(), tmp_path)
    )
    assert plant.num_bodies() == 1


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        estimate_of([found(SOAP, X_A)]).to_model_directives(
            library(), tmp_path / "file" / "inside"
        )


def test_an_odd_name_is_parsed_too(tmp_path: Path) -> None:

    odd = replace(library()[SOAP], name="bar of soap, 2/3")
    objects = [ObjectEstimate(SOAP, odd.name, X_A, X_A, 0.9, "")]
    path = estimate_of(objects).to_model_directives(
        ObjectLibrary([odd], "odd"), tmp_path
    )
    plant = parsed(path)
    assert plant.num_bodies() == 2


def test_in_words() -> None:
    text = str(estimate_of([found(SOAP, X_A), not_found(TISSUES)]))
    assert text.splitlines()[0] == "physim-mcts, 1.5 s"
    assert "xyz [0.1, -0.2, 0.3] m" in text
    assert "confidence 0.90" in text
    assert f"{library()[TISSUES].name}: not found (its segment is empty)" in text
