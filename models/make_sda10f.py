# SPDX-License-Identifier: MIT
"""Makes the robot's URDF and meshes: ``python -m physim_drake.models.make_sda10f``.

Each run writes the same files.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physim_drake.models import SDA10F
from physim_drake.models.sda10f_looks import COLORS, link_looks
from physim_drake.models.sda10f_table import (
    Drive,
    JointRow,
    LinkRow,
    Primitive,
    Triple,
    joints,
    links,
)
from physim_drake.models.solids import mtl_text, obj_text

_MATERIALS = "motoman_sda10f.mtl"
_TURNED: dict[str, Triple] = {
    "x": (0.0, np.pi / 2, 0.0),
    "y": (-np.pi / 2, 0.0, 0.0),
    "z": (0.0, 0.0, 0.0),
}
_CONTACT = """\
      <drake:proximity_properties>
        <drake:rigid_hydroelastic/>
        <drake:mesh_resolution_hint value="0.03"/>
        <drake:mu_static value="0.4"/>
        <drake:mu_dynamic value="0.4"/>
      </drake:proximity_properties>
"""
_REACH = 2  # within the limits of its joints, a link cannot touch the next ones


def make_robot(folder: Path) -> None:
    """Writes the URDF and its meshes into `folder`, made if it does not exist."""
    meshes = folder / "meshes"
    meshes.mkdir(parents=True, exist_ok=True)
    for name, patches in link_looks().items():
        text = obj_text(patches, _MATERIALS)
        (meshes / f"{name}.obj").write_text(text, encoding="utf-8")
    (meshes / _MATERIALS).write_text(mtl_text(COLORS), encoding="utf-8")
    (folder / "motoman_sda10f.urdf").write_text(urdf_text(), encoding="utf-8")


def urdf_text() -> str:
    """The robot as URDF with Drake's extensions."""
    shapes = links()
    names = ["base_link", *(row.child for row in joints())]
    parts = [
        '<?xml version="1.0"?>\n<!-- SPDX-License-Identifier: MIT -->\n'
        "<!-- Written by make_sda10f.py; change sda10f_table.py instead. -->\n"
        '<robot xmlns:drake="http://drake.mit.edu" name="motoman_sda10f">\n'
    ]
    parts += [
        _link(name, shapes[name]) if name in shapes else f'  <link name="{name}"/>\n'
        for name in names
    ]
    parts += [_joint(row) for row in joints()]
    parts += [_transmission(row.name, row.drive) for row in joints() if row.drive]
    parts += _filter_groups()
    return "".join(parts) + "</robot>\n"


def _link(name: str, row: LinkRow) -> str:
    mesh = re.sub("arm_(left|right)_", "", name)
    visual = (
        "    <visual>\n"
        f'      <geometry><mesh filename="meshes/{mesh}.obj"/></geometry>\n'
        "    </visual>\n"
    )
    collisions = [
        f"    <collision>\n{_placed(shape)}{_CONTACT}    </collision>\n"
        for shape in row.shapes
    ]
    body = "".join([_inertial(row), visual, *collisions])
    return f'  <link name="{name}">\n{body}  </link>\n'


def _placed(shape: Primitive) -> str:
    if len(shape.size) == 3:
        geometry = f'<box size="{_numbers(shape.size)}"/>'
    else:
        radius, length = shape.size
        geometry = f'<cylinder radius="{radius:.6g}" length="{length:.6g}"/>'
    rpy = _TURNED[shape.axis]
    return (
        f'      <origin xyz="{_numbers(shape.xyz)}" rpy="{_numbers(rpy)}"/>\n'
        f"      <geometry>{geometry}</geometry>\n"
    )


def _inertial(row: LinkRow) -> str:
    center, inertia = mass_distribution(row)
    keys = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2)}
    keys |= {"iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    entries = " ".join(f'{k}="{inertia[ij]:.6g}"' for k, ij in keys.items())
    return (
        "    <inertial>\n"
        f'      <origin xyz="{_numbers(center)}"/>\n'
        f'      <mass value="{row.mass:.6g}"/>\n'
        f"      <inertia {entries}/>\n"
        "    </inertial>\n"
    )


def mass_distribution(row: LinkRow) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centre of mass (3,), m, and inertia about it (3, 3), kg m^2, in the link's frame.

    The mass is spread evenly over the volumes of the shapes. Overlaps count twice.
    """
    volumes = np.array([_volume(shape) for shape in row.shapes])
    masses = row.mass * volumes / volumes.sum()
    centers = np.array([shape.xyz for shape in row.shapes])
    center = masses @ centers / row.mass
    inertia = np.zeros((3, 3))
    for mass, shape, r in zip(masses, row.shapes, centers - center, strict=True):
        inertia += mass * (_unit_inertia(shape) + (r @ r) * np.eye(3) - np.outer(r, r))
    return center, inertia


def _volume(shape: Primitive) -> float:
    if len(shape.size) == 3:
        return float(np.prod(shape.size))
    radius, length = shape.size
    return float(np.pi * radius**2 * length)


def _unit_inertia(shape: Primitive) -> NDArray[np.float64]:
    if len(shape.size) == 3:
        squares = np.square(shape.size)
        return np.diag(squares.sum() - squares) / 12
    radius, length = shape.size
    moments = np.full(3, (3 * radius**2 + length**2) / 12)
    moments["xyz".index(shape.axis)] = radius**2 / 2
    return np.diag(moments)


def _joint(row: JointRow) -> str:
    lines = [
        f'  <joint name="{row.name}" type="{"revolute" if row.drive else "fixed"}">',
        f'    <origin xyz="{_numbers(row.xyz)}" rpy="{_numbers(row.rpy)}"/>',
        f'    <parent link="{row.parent}"/>',
        f'    <child link="{row.child}"/>',
    ]
    if row.drive:
        limits = {
            "lower": -row.limit,
            "upper": row.limit,
            "effort": row.drive.effort,
            "velocity": row.drive.speed,
            "drake:acceleration": row.drive.acceleration,
        }
        values = " ".join(f'{k}="{v:.15g}"' for k, v in limits.items())
        lines += [f'    <axis xyz="{_numbers(row.axis)}"/>', f"    <limit {values}/>"]
    return "\n".join(lines) + "\n  </joint>\n"


def _transmission(joint: str, drive: Drive) -> str:
    return (
        f'  <transmission name="{joint}_transmission">\n'
        "    <type>transmission_interface/SimpleTransmission</type>\n"
        f'    <joint name="{joint}"/>\n'
        f'    <actuator name="{joint}">\n'
        f'      <drake:gear_ratio value="{drive.gear_ratio:g}"/>\n'
        f'      <drake:rotor_inertia value="{drive.rotor_inertia:g}"/>\n'
        "    </actuator>\n"
        "  </transmission>\n"
    )


def _filter_groups() -> list[str]:
    """Groups of links near each other in the chain, whose contacts are ignored."""
    parents = {row.child: row.parent for row in joints()}
    shaped = list(links())
    groups = []
    for name in shaped:
        members, ancestor = [name], name
        while len(members) <= _REACH and ancestor in parents:
            ancestor = parents[ancestor]
            if ancestor in shaped:
                members.append(ancestor)
        if len(members) > 1:
            groups.append(_filter_group(f"{name}_and_parents", members))
    return groups


def _filter_group(name: str, members: Sequence[str]) -> str:
    lines = [f'    <drake:member link="{member}"/>\n' for member in members]
    return (
        f'  <drake:collision_filter_group name="{name}">\n'
        + "".join(lines)
        + f'    <drake:ignored_collision_filter_group name="{name}"/>\n'
        "  </drake:collision_filter_group>\n"
    )


def _numbers(values: Sequence[float] | NDArray[np.float64]) -> str:
    return " ".join(f"{x + 0.0:.15g}" for x in values)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the program."""
    parser = argparse.ArgumentParser(description="Make the robot's model.")
    parser.add_argument("--out", type=Path, default=SDA10F, help="folder to write to")
    make_robot(parser.parse_args(arguments).out)


if __name__ == "__main__":
    main()
