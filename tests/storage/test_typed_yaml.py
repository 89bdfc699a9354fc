# SPDX-License-Identifier: MIT
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.schema import Transform

from physim_drake.errors import InputError
from physim_drake.storage.typed_yaml import load_typed_yaml, parse_typed_yaml


class Color(StrEnum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Lamp:
    color: Color = Color.RED
    power: float = 1.0

    def __post_init__(self) -> None:
        if self.power < 0:
            raise InputError("lamp", f"is {self.power:g}", "give watts", "power")


@dataclass(frozen=True)
class Sun:
    hour: int = 12


@dataclass(frozen=True)
class Room:
    lamp: Lamp = field(default_factory=Lamp)
    light: Lamp | Sun = field(default_factory=Sun)
    lamps: tuple[Lamp, ...] = ()
    size: tuple[float, ...] = (1.0, 2.0)
    names: Mapping[str, str] = field(default_factory=dict)
    X_WR: Transform = field(default_factory=Transform)
    rent: float | None = None
    accent: Color | None = None
    folder: Path = Path(".")


ALL = """
lamp: {color: blue, power: 2}
light: !Lamp {power: 3}
lamps: [{color: blue}, {}]
size: [3, 4.5]
names: {a: b}
X_WR: {base_frame: world, translation: [0, 0, 1], rotation: !Rpy {deg: [90, 0, 0]}}
rent: 7
accent: blue
folder: x/y
"""


def test_nothing_given_is_the_defaults() -> None:
    room = parse_typed_yaml("", Room)
    assert (room.lamp, room.light, room.size) == (Lamp(), Sun(), (1.0, 2.0))
    changed = Room(rent=3.0)
    assert parse_typed_yaml("# nothing\n", Room, changed) is changed


def test_everything_can_be_given() -> None:
    room = parse_typed_yaml(ALL, Room)
    assert room.lamp == Lamp(Color.BLUE, 2.0)
    assert room.lamp.color is Color.BLUE
    assert room.light == Lamp(power=3.0)
    assert room.lamps == (Lamp(Color.BLUE), Lamp())
    assert room.size == (3.0, 4.5)
    assert room.names == {"a": "b"}
    X_WR = room.X_WR.GetDeterministicValue()
    np.testing.assert_allclose(X_WR.translation(), [0, 0, 1])
    np.testing.assert_allclose(X_WR.rotation().matrix()[1], [0, 0, -1], atol=1e-12)
    assert room.rent == 7.0
    assert room.accent is Color.BLUE
    assert room.folder == Path("x/y")


def test_defaults_given_are_kept_where_the_text_is_silent() -> None:
    room = parse_typed_yaml("lamp: {power: 5}", Room, Room(lamp=Lamp(Color.BLUE)))
    assert room.lamp == Lamp(Color.BLUE, 5.0)
    assert room.light == Sun()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("lamp: {colour: red}", "'colour'"),
        ("lamp: {power: bright}", "bright"),
        ("lamp: {color: green}", "'green' is not one of red, blue"),
        ("lamp: {power: -1}", "lamp: power: is -1; give watts"),
        ("lamp: 3", r"not of its field's type \(3\)"),
        ("light: !Moon {}", "Moon"),
        ("[1]", "should have been a dict"),
        ("lamp: [", "while parsing"),
        ("size: 3", "not of its field's type"),
    ],
)
def test_what_cannot_be_used_is_named_with_its_file(
    text: str, problem: str, tmp_path: Path
) -> None:
    path = tmp_path / "room.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=problem) as caught:
        load_typed_yaml(path, Room)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml: cannot be read"):
        load_typed_yaml(tmp_path / "none.yaml", Room)


def test_a_mapping_replaces_the_schemas_and_adds_to_the_callers() -> None:
    @dataclass(frozen=True)
    class Lights:
        watts: Mapping[str, float] = field(default_factory=lambda: {"desk": 5.0})

    assert parse_typed_yaml("watts: {door: 7}", Lights).watts == {"door": 7.0}
    assert parse_typed_yaml("watts: {}", Lights).watts == {}
    both = parse_typed_yaml("watts: {door: 7}", Lights, Lights()).watts
    assert both == {"desk": 5.0, "door": 7.0}
