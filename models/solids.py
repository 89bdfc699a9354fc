# SPDX-License-Identifier: MIT
"""Smooth surfaces for visual meshes (turned, lofted, rounded), and their OBJ files.

Surfaces are stacks of rings. Shading is smooth except where a ring is given twice.
Parts of a model may overlap, because it is only for the eye.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_DEGENERATE = 1e-12  # m^2


@dataclass(frozen=True)
class Patch:
    """A surface of one material.

    Attributes:
        vertices: positions of the vertices, (V, 3), m.
        quads: vertex indices of the faces, (F, 4), anticlockwise from outside. The
            first two are equal if a face is a triangle.
        material: name of the material.
    """

    vertices: Array
    quads: Indices
    material: str

    def moved(self, R: ArrayLike | None = None, p: ArrayLike = (0, 0, 0)) -> Patch:
        """The surface turned by the rotation matrix R and shifted by p, m."""
        turned = self.vertices if R is None else self.vertices @ np.asarray(R).T
        return replace(self, vertices=turned + np.asarray(p, dtype=float))

    def normals(self) -> Array:
        """Unit normals at the vertices, (V, 3), averaged over faces by area."""
        crossed = _area_vectors(self.vertices, self.quads)
        sums = np.zeros_like(self.vertices)
        for corner in range(4):
            np.add.at(sums, self.quads[:, corner], crossed)
        length = np.linalg.norm(sums, axis=1, keepdims=True)
        return np.asarray(sums / np.maximum(length, 1e-30))


def rounded(corners: ArrayLike, radii: ArrayLike, steps: int = 2) -> Array:
    """A polyline with its corners rounded off.

    Args:
        corners: corners of the polyline, (N, 2).
        radii: radius at each corner, (N,), or one for all. 0 keeps a sharp edge. Ends
            are kept.
        steps: number of segments of an arc.
    """
    points = np.asarray(corners, dtype=float)
    r = np.broadcast_to(np.asarray(radii, dtype=float), len(points))
    line = [points[0]]
    for n in range(1, len(points) - 1):
        line += _arc(points[n - 1], points[n], points[n + 1], float(r[n]), steps)
    return np.array([*line, points[-1]])


def _arc(a: Array, b: Array, c: Array, radius: float, steps: int) -> list[Array]:
    if radius == 0.0:
        return [b, b]
    before, after = b - a, c - b
    if abs(before[0] * after[1] - before[1] * after[0]) < _DEGENERATE:
        return [b]  # no corner
    to_a, to_c = (a - b) / np.linalg.norm(a - b), (c - b) / np.linalg.norm(c - b)
    half = np.arccos(np.clip(to_a @ to_c, -1.0, 1.0)) / 2
    start = b + to_a * radius / np.tan(half)
    middle = b + (to_a + to_c) / np.linalg.norm(to_a + to_c) * radius / np.sin(half)
    across, tangent = (start - middle) / radius, -to_a
    angles = np.linspace(0.0, np.pi - 2 * half, steps + 1)
    return [
        middle + radius * (np.cos(t) * across + np.sin(t) * tangent) for t in angles
    ]


def turned(profile: ArrayLike, material: str, segments: int = 32) -> Patch:
    """A surface of revolution about z.

    Args:
        profile: radius and z, (N, 2), m, from the bottom up, with the solid on the
            left. An end at radius 0 closes the surface there.
        material: name of the material.
        segments: number of segments around.
    """
    line = np.asarray(profile, dtype=float)
    ends: list[Array | None] = [None, None]
    for n, index in enumerate((0, -1)):
        if line[index, 0] == 0.0:
            ends[n] = np.array([0.0, 0.0, line[index, 1]])
    rings = line[int(ends[0] is not None) : len(line) - int(ends[1] is not None)]
    angle = np.linspace(0.0, 2 * np.pi, segments, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(segments)], axis=-1)
    stack = rings[:, :1, None] * circle + rings[:, None, 1:] * np.array([0.0, 0.0, 1.0])
    return lofted(stack, material, (ends[0], ends[1]))


def oval(
    center: Sequence[float],
    half_sizes: tuple[float, float],
    power: float,
    segments: int = 32,
) -> Array:
    """A superellipse about `center` in a plane of constant z, (segments, 3).

    Args:
        center: centre, m.
        half_sizes: half sizes along x and y, m.
        power: exponent: 2 for an ellipse, more for squarer shapes.
        segments: number of segments around.
    """
    angle = np.linspace(0.0, 2 * np.pi, segments, endpoint=False)
    c, s = np.cos(angle), np.sin(angle)
    scale = (np.abs(c) ** power + np.abs(s) ** power) ** (-1 / power)
    flat = np.stack([half_sizes[0] * c * scale, half_sizes[1] * s * scale], axis=-1)
    return np.asarray(center) + np.pad(flat, ((0, 0), (0, 1)))


def lofted(
    rings: ArrayLike,
    material: str,
    ends: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
) -> Patch:
    """A surface through rings of points.

    Args:
        rings: points of each ring, (R, S, 3), m, anticlockwise seen from the last ring.
        material: name of the material.
        ends: points (3,) that close the surface below the first and above the last.
    """
    stack = np.asarray(rings, dtype=float)
    count, segments = stack.shape[:2]
    n = np.arange(count * segments).reshape(count, segments)
    a, b = n[:-1].ravel(), np.roll(n[:-1], -1, axis=1).ravel()
    d, c = n[1:].ravel(), np.roll(n[1:], -1, axis=1).ravel()
    quads = [np.stack([a, b, c, d], axis=-1)]
    vertices = [stack.reshape(-1, 3)]
    tip = count * segments
    for point, ring in ((ends[0], n[0, ::-1]), (ends[1], n[-1])):
        if point is not None:
            apex = np.full(segments, tip)
            fan = [apex, apex, ring, np.roll(ring, -1)]
            quads.append(np.stack(fan, axis=-1))
            vertices.append(np.reshape(np.asarray(point, dtype=float), (1, 3)))
            tip += 1
    corners, faces = np.concatenate(vertices), np.concatenate(quads)
    area = np.linalg.norm(_area_vectors(corners, faces), axis=1)
    return Patch(corners, faces[area > _DEGENERATE], material)


def _area_vectors(vertices: Array, quads: Indices) -> Array:
    """Normals of the faces, (F, 3), as long as twice their areas."""
    a, b, c, d = np.moveaxis(vertices[quads], 1, 0)
    return np.asarray(np.cross(c - a, d - b))


def obj_text(patches: Iterable[Patch], mtl_file: str) -> str:
    """An OBJ file of the surfaces, to 0.01 mm."""
    lines, first = [f"mtllib {mtl_file}"], 1
    by_material = sorted(patches, key=lambda patch: patch.material)
    material = None
    for patch in by_material:
        lines += _rows("v", patch.vertices, 5) + _rows("vn", patch.normals(), 2)
        if patch.material != material:
            material = patch.material
            lines.append(f"usemtl {material}")
        lines += [
            "f " + " ".join(f"{i}//{i}" for i in dict.fromkeys(face))
            for face in (patch.quads + first).tolist()
        ]
        first += len(patch.vertices)
    return "\n".join(lines) + "\n"


def mtl_text(colors: Mapping[str, tuple[float, float, float]]) -> str:
    """A file of materials: RGB of each, by name."""
    return "\n".join(
        f"newmtl {name}\nKd {r:g} {g:g} {b:g}\nKs 0.2 0.2 0.2\nNs 40\n"
        for name, (r, g, b) in colors.items()
    )


def _rows(keyword: str, values: Array, digits: int) -> list[str]:
    rounded_values = values.round(digits) + 0.0  # no negative zeros
    return [
        f"{keyword} " + " ".join(f"{x:.{digits}f}" for x in row)
        for row in rounded_values.tolist()
    ]
