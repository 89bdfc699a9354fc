# SPDX-License-Identifier: MIT
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

from physim_drake.errors import InputError
from physim_drake.systems.object_instances import find_object_instances
from tests.synthetic import ERASER, SOAP, library


def plant_of(**bodies: int) -> Any:
    """A plant whose model instances have so many bodies."""
    plant = MultibodyPlant(0.0)
    for name, count in bodies.items():
        instance = plant.AddModelInstance(name)
        for k in range(count):
            plant.AddRigidBody(f"body_{k}", instance, SpatialInertia.NaN())
    plant.Finalize()
    return plant


def found(plant: Any, names: dict[str, str]) -> dict[str, int]:
    return {i.name: i.object_id for i in find_object_instances(plant, library(), names)}


def test_models_go_by_their_name_with_or_without_a_number() -> None:
    plant = plant_of(table=1, dove_beauty_bar=1, dove_beauty_bar_2=1, dove_beauty=1)
    assert found(plant, {}) == {"dove_beauty_bar": SOAP, "dove_beauty_bar_2": SOAP}


def test_other_names_are_given() -> None:
    plant = plant_of(object_0=1, object_1=1, dove_beauty_bar=1)
    names = {
        "object_1": "expo_dry_erase_board_eraser",
        "dove_beauty_bar": "expo_dry_erase_board_eraser",
    }
    assert found(plant, names) == {"object_1": ERASER, "dove_beauty_bar": ERASER}


def test_the_body_is_the_models() -> None:
    plant = plant_of(table=2, dove_beauty_bar=1)
    (instance,) = find_object_instances(plant, library(), {})
    body = plant.GetBodyByName("body_0", plant.GetModelInstanceByName(instance.name))
    assert instance.body_index == int(body.index()) == 3


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({"soap": "dove_beauty_bar"}, "objects: soap: the plant has no model 'soap'"),
        ({"table": "anvil"}, "has no object 'anvil'"),
        ({"table": "dove_beauty_bar"}, "objects: table: has 2 bodies"),
    ],
)
def test_what_is_not_there_is_named(names: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        find_object_instances(plant_of(table=2), library(), names)


def test_a_plant_may_have_no_objects() -> None:
    assert found(plant_of(table=1), {}) == {}
    assert np.size(found(plant_of(), {})) == 1
