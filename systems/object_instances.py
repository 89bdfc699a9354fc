# SPDX-License-Identifier: MIT
"""Which models of a plant are objects of the library."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from physim_drake.errors import InputError
from physim_drake.objects.model import ObjectLibrary, ObjectModel


@dataclass(frozen=True)
class ObjectInstance:
    """A model of a plant that is an object of the library.

    Attributes:
        name: name of the model instance.
        object_id: id of the object it is.
        body_index: index of its body, whose frame is the object's frame O. Renderers
            give it to the body's pixels as their label.
    """

    name: str
    object_id: int
    body_index: int


def find_object_instances(
    plant: MultibodyPlant, library: ObjectLibrary, names: Mapping[str, str]
) -> tuple[ObjectInstance, ...]:
    """Finds the objects in a plant.

    Args:
        plant: the plant that they are in; finalized.
        library: the objects.
        names: object's name by model instance's, if they differ. An instance that
            is not named here is the object of the same name, or of the same name with
            ``_2``, ``_3``, ... added; others, such as a table, are not objects.

    Raises:
        InputError: if `names` names what is not there, or an object's instance has
            more than one body.
    """
    found = []
    by_name = {model.name: model for model in library.values()}
    instances = {plant.GetModelInstanceName(i): i for i in _instances(plant)}
    for name in names:
        if name not in instances:
            known = ", ".join(instances)
            raise InputError(
                "objects", f"the plant has no model {name!r}", f"it has {known}", name
            )
    for name, instance in instances.items():
        model = _object(name, library, by_name, names)
        if model is None:
            continue
        bodies = plant.GetBodyIndices(instance)
        if len(bodies) != 1:
            raise InputError(
                "objects",
                f"has {len(bodies)} bodies",
                "an object is a model of one body",
                name,
            )
        found.append(ObjectInstance(name, model.object_id, int(bodies[0])))
    return tuple(found)


def _instances(plant: MultibodyPlant) -> list[ModelInstanceIndex]:
    return [ModelInstanceIndex(i) for i in range(plant.num_model_instances())]


def _object(
    name: str,
    library: ObjectLibrary,
    by_name: Mapping[str, ObjectModel],
    names: Mapping[str, str],
) -> ObjectModel | None:
    if name in names:
        return library.by_name(names[name])
    stem = re.sub(r"_[0-9]+$", "", name)
    return by_name.get(name) or by_name.get(stem)
