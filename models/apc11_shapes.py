# SPDX-License-Identifier: MIT
"""The surfaces of the eleven objects, built from their dimensions.

Every visual surface here is closed, and every collision piece is convex. Points are
in the object's frame O, whose origin is the centre of the extents box and whose y axis
is the long or symmetry axis. Profiles are in millimetres, as in a drawing. Functions
return metres.

The azimuth of a surface swept about y is counted from +z towards +x, so that a label
reads from left to right from outside with +y up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_MM = 1e-3

# For each face of a box: the axes that point right and up on its picture as (index,
# sign), looked at from outside.
_BOX_VIEWS: Mapping[str, tuple[tuple[int, int], tuple[int, int]]] = {
    "+x": ((2, -1), (1, 1)),
    "-x": ((2, 1), (1, 1)),
    "+y": ((0, 1), (2, -1)),
    "-y": ((0, 1), (2, 1)),
    "+z": ((0, 1), (1, 1)),
    "-z": ((0, -1), (1, 1)),
}


@dataclass(frozen=True)
class Surface:
    """A closed triangle mesh whose faces are spread over the panels of a texture.

    Attributes:
        vertices: positions p_OV, (V, 3), m.
        faces: vertex indices, (F, 3), anticlockwise from outside.
        uv: place of each face corner on its panel, (F, 3, 2) in 0 .. 1, from the
            lower left corner.
        panel: index into the keys of `panels` for each face, (F,).
        panels: width and height of each panel by name, m.
    """

    vertices: Array
    faces: Indices
    uv: Array
    panel: Indices
    panels: Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class Band:
    """A part of a profile that is swept about y.

    Attributes:
        panel: name of the panel that the band is printed on.
        rings: y, radius along x and radius along z of each ring, (N, 3), mm.
        planar: whether the panel is a picture seen along y. Otherwise it is the
            unrolled side.
    """

    panel: str
    rings: Array
    planar: bool = False


def disc_rings(rings: ArrayLike) -> Array:
    """Turns rings of (y, radius), (N, 2), into round rings (N, 3), same unit."""
    y_r = np.asarray(rings, dtype=float)
    return y_r[:, [0, 1, 1]]


def arc(start: ArrayLike, end: ArrayLike, steps: int) -> Array:
    """A quarter ellipse between two rings, which leaves `start` along y.

    Args:
        start: first ring (y, radii ...).
        end: last ring, at which the profile is perpendicular to y.
        steps: number of segments.

    Returns:
        (steps + 1, 2 or 3) rings, both ends among them, in the unit of the input.
    """
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    angle = np.linspace(0.0, np.pi / 2, steps + 1)[:, None]
    rise, turn = np.sin(angle), 1 - np.cos(angle)
    blend = np.concatenate([rise, *[turn] * (len(a) - 1)], axis=1)
    return np.asarray(a + (b - a) * blend)


def chamfered_box(extents: Sequence[float], chamfer: float) -> Surface:
    """A cuboid with its edges cut at 45 degrees.

    Args:
        extents: full lengths along x, y, z, m.
        chamfer: width that the cut takes off each side, m.

    Returns:
        The surface, of 44 faces, with panels ``+x``, ``-x`` ... ``-z``.
    """
    half = np.asarray(extents) / 2
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).T.reshape(-1, 3)
    vertices = np.concatenate(
        [corners * (half - chamfer * (np.arange(3) != axis)) for axis in range(3)]
    )
    faces = convex_faces(vertices)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    axis = np.argmax(np.abs(normals).round(6), axis=1)
    positive = normals[np.arange(len(axis)), axis] > 0
    panel = 2 * axis + np.where(positive, 0, 1)

    size = np.asarray(extents, dtype=float)
    uv = np.zeros((len(faces), 3, 2))
    panels = {}
    for k, (name, view) in enumerate(_BOX_VIEWS.items()):
        panels[name] = (float(size[view[0][0]]), float(size[view[1][0]]))
        for column, (i, sign) in enumerate(view):
            along = sign * vertices[faces[panel == k], i] / size[i]
            uv[panel == k, :, column] = along + 0.5
    return Surface(vertices, faces, uv, panel, panels)


def swept(bands: Sequence[Band], segments: int) -> Surface:
    """Sweeps a profile about y into a closed surface.

    Args:
        bands: parts of the profile, each starting at the last ring of the one before.
            The profile is closed, or starts and ends on the axis.
        segments: number of steps around. A multiple of four reaches the full extents
            along x and z.

    Returns:
        The surface, with one panel for each different panel name.
    """
    azimuth = np.linspace(-np.pi, np.pi, segments + 1)
    points, uv, panel = [], [], []
    panels = _swept_panels(bands)
    names = list(panels)
    for band, start in zip(bands, _strip_starts(bands), strict=True):
        grid = _ring_points(band.rings * _MM, azimuth)
        if band.planar:
            width = panels[band.panel][0]
            facing = -1 if _faces_up(band, bands) else 1
            place = grid[..., [0, 2]] / width * [1, facing] + 0.5
        else:
            place = np.empty((*grid.shape[:2], 2))
            place[..., 0] = (azimuth / (2 * np.pi) + 0.5)[None]
            along = start + np.concatenate([[0.0], np.cumsum(_ring_steps(band))])
            place[..., 1] = (along / panels[band.panel][1])[:, None]
        points.append(_quad_corners(grid))
        uv.append(_quad_corners(place))
        panel.append(np.full(len(points[-1]), names.index(band.panel)))
    return _welded(
        np.concatenate(points), np.concatenate(uv), np.concatenate(panel), panels
    )


def displaced(surface: Surface, depth: Callable[[Array, Array], Array]) -> Surface:
    """Moves a swept surface towards its axis.

    Args:
        surface: surface to change.
        depth: function of the vertices' azimuths (V,), rad, and heights y (V,), m, that
            gives the inward displacement (V,), m.
    """
    x, y, z = surface.vertices.T
    radius = np.hypot(x, z)
    inward = np.where(radius > 0, depth(np.arctan2(x, z), y), 0.0)
    scale = 1 - inward / np.where(radius > 0, radius, 1.0)
    return replace(surface, vertices=np.stack([x * scale, y, z * scale], axis=1))


def convex_faces(vertices: Array) -> Indices:
    """Triangles (F, 3) of the convex hull of `vertices`, anticlockwise outside."""
    hull = ConvexHull(vertices)
    faces = hull.simplices.astype(np.int64)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward, ::-1]
    return faces


def convex_stack(rings: ArrayLike, sides: int) -> Array:
    """Corners of a convex piece swept about y, half in and half out of the round.

    A regular polygon stays within r (1 - cos(pi / sides)) / 2 of its circle if its
    corners lie as far outside as the middles of its sides lie inside.

    Args:
        rings: (y, radius) or (y, radius along x, radius along z), (N, 2 or 3), mm.
        sides: number of corners on a ring.

    Returns:
        (N * sides, 3), m.
    """
    table = np.asarray(rings, dtype=float)
    table = (disc_rings(table) if table.shape[1] == 2 else table) * _MM
    table[:, 1:] *= 2 / (1 + np.cos(np.pi / sides))
    azimuth = 2 * np.pi * np.arange(sides) / sides
    return _ring_points(table, azimuth).reshape(-1, 3)


def ring_wedges(inner: float, outer: float, width: float, count: int) -> list[Array]:
    """Cuts a ring about y into convex wedges.

    Args:
        inner: radius of the hole, mm.
        outer: outer radius, mm.
        width: length along y, mm.
        count: number of wedges.

    Returns:
        For each wedge its eight corners (8, 3), m, half in and half out of the
        round at both radii.
    """
    rings = [(y, r) for y in (-width / 2, width / 2) for r in (inner, outer)]
    corners = convex_stack(rings, count).reshape(4, count, 3)
    following = np.roll(corners, -1, axis=1)
    return [np.concatenate([corners[:, k], following[:, k]]) for k in range(count)]


def ball_corners(radius: float) -> Array:
    """Corners (162, 3) in m of a round polyhedron with 320 faces.

    An icosahedron, its edges halved twice, of such a size that the corners lie as
    far outside the ball as the lowest points of the faces lie inside.

    Args:
        radius: radius of the ball, mm.
    """
    points = np.asarray(trimesh.creation.icosphere(subdivisions=2).vertices)
    nearest = float(-ConvexHull(points).equations[:, 3].max())
    return np.asarray(points * (radius * _MM * 2 / (1 + nearest)))


def corner_normals(surface: Surface, crease: float = np.radians(50)) -> Array:
    """Normals of the face corners, smooth over edges that bend less than `crease`.

    Args:
        surface: surface with the faces.
        crease: angle between two faces beyond which the edge stays sharp, rad.

    Returns:
        Unit normals, (F, 3, 3): for each face and each of its corners.
    """
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    weighted = np.cross(b - a, c - a)
    unit = weighted / np.linalg.norm(weighted, axis=1, keepdims=True)
    meeting: list[list[int]] = [[] for _ in surface.vertices]
    for f, face in enumerate(surface.faces):
        for v in face:
            meeting[v].append(f)
    around = [np.array(m) for m in meeting]
    normals = np.empty((len(surface.faces), 3, 3))
    for f, face in enumerate(surface.faces):
        for corner, v in enumerate(face):
            near = around[v][unit[around[v]] @ unit[f] > np.cos(crease)]
            normals[f, corner] = weighted[near].sum(axis=0)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return normals


def _ring_points(rings: Array, azimuth: Array) -> Array:
    """Points (N, A, 3) of rings (N, 3) of (y, radius x, radius z) at azimuths (A,)."""
    y, rx, rz = (column[:, None] for column in rings.T)
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    return np.stack([rx * sine, y + 0 * sine, rz * cosine], axis=-1)


def _ring_steps(band: Band) -> Array:
    """Lengths (N - 1,) in m of the steps between a band's rings, along +x."""
    return np.asarray(np.linalg.norm(np.diff(band.rings[:, :2], axis=0), axis=1) * _MM)


def _strip_starts(bands: Sequence[Band]) -> list[float]:
    """Arc length in m at which each band starts on its panel."""
    used: dict[str, float] = {}
    starts = []
    for band in bands:
        starts.append(used.get(band.panel, 0.0))
        used[band.panel] = starts[-1] + float(_ring_steps(band).sum())
    return starts


def _swept_panels(bands: Sequence[Band]) -> dict[str, tuple[float, float]]:
    """Width and height of each panel, m."""
    panels: dict[str, tuple[float, float]] = {}
    for band in bands:
        rx, rz = band.rings[:, 1].max() * _MM, band.rings[:, 2].max() * _MM
        if band.planar:
            size = (2 * max(rx, rz),) * 2
        else:
            before = panels.get(band.panel, (0.0, 0.0))
            around = 2 * np.pi * float(np.sqrt((rx**2 + rz**2) / 2))
            length = before[1] + float(_ring_steps(band).sum())
            size = (max(before[0], around), length)
        panels[band.panel] = (float(size[0]), float(size[1]))
    return panels


def _faces_up(band: Band, bands: Sequence[Band]) -> bool:
    heights = np.concatenate([b.rings[:, 0] for b in bands])
    return bool(band.rings[:, 0].mean() > (heights.min() + heights.max()) / 2)


def _quad_corners(grid: Array) -> Array:
    """Corners (M, 3, D) of the triangles that fill a grid of points (N, A, D)."""
    a, b = grid[:-1, :-1], grid[:-1, 1:]
    c, d = grid[1:, 1:], grid[1:, :-1]
    halves = [np.stack(t, axis=2) for t in ((a, b, c), (a, c, d))]
    return np.stack(halves, axis=2).reshape(-1, 3, grid.shape[-1])


def _welded(
    points: Array, uv: Array, panel: Indices, panels: Mapping[str, tuple[float, float]]
) -> Surface:
    """Joins triangle corners (M, 3, 3) at the same place, and drops empty triangles."""
    vertices, faces = np.unique(
        points.reshape(-1, 3).round(9) + 0.0, axis=0, return_inverse=True
    )
    faces = faces.reshape(-1, 3)
    keep = np.all(faces != np.roll(faces, 1, axis=1), axis=1)
    return Surface(vertices, faces[keep], uv[keep], panel[keep], panels)
