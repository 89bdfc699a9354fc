# SPDX-License-Identifier: MIT
"""Rotational symmetries of a shape, found by turning it and comparing surfaces.

A motion counts as a symmetry if 95 % of the surface, so moved, lies within a
tolerance of the surface, and 98 % within four times that: what a depth image cannot
tell apart. Candidate axes are the principal axes of the surface. If principal
moments are nearly equal these are not determined, and directions in the plane, or on
the sphere, are tried.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from physim_drake.objects.surface_match import SurfaceMatch
from physim_drake.poses import (
    Array,
    ContinuousAxis,
    SymmetryGroup,
    nearest_rotation,
    rotation_angle,
)

_RELATIVE_TOLERANCE = 0.012  # of the diagonal
_LEAST_TOLERANCE = 1e-3  # m, about the noise of a depth camera
_ORDERS = range(2, 13)
# No small multiple of these angles (rad) is a full turn: only round shapes pass all.
_ROUND_ANGLES = 2 * np.pi * np.array([0.382, 0.764, 0.146, 0.528, 0.91, 0.292, 0.0557])
# The scan of a dented can deviates more, but about equally at all angles; a prism does
# not: its turns by full steps match.
_DENTED = 1.6
_SAME_MOTION = np.radians(8)  # groups of order <= 12 about an axis are 30 deg apart
_DEGENERATE = 0.7  # ratio of principal moments from which axes are searched
_MAX_PEAKS = 20  # axes searched for each turn; an icosahedron has 15 of two turns
_REFINABLE = 5.0  # times the tolerance: worse motions are not worth refining


def detect_symmetry(
    mesh: trimesh.Trimesh, tolerance: float | None = None
) -> SymmetryGroup:
    """Finds the rotations that map a shape onto itself.

    Args:
        mesh: surface, m.
        tolerance: largest deviation of 95 % of the moved surface, m; 1.2 % of the
            bounding box diagonal, and at least 1 mm, if it is None.

    Returns:
        the group; its discrete motions are closed under multiplication.
    """
    if tolerance is None:
        diagonal = float(np.linalg.norm(mesh.extents))
        tolerance = max(_LEAST_TOLERANCE, _RELATIVE_TOLERANCE * diagonal)
    match = SurfaceMatch(mesh)
    axes = np.concatenate([np.eye(3), _principal_axes(match)])
    round_axes = [
        found for a in axes if (found := _round_axis(match, a, tolerance)) is not None
    ]
    if round_axes and not _has_second_axis(round_axes):
        return _round_group(match, round_axes, tolerance)
    if round_axes:
        centre = round_axes[0][1].point
        return SymmetryGroup(
            axes=tuple(ContinuousAxis(axis, centre) for axis in np.eye(3))
        )
    searched = _searched_axes(match, tolerance)
    for axis in searched:
        found = _round_axis(match, axis, tolerance)
        if found is not None:
            return _round_group(match, [found], tolerance)
    return _discrete_group(match, np.concatenate([axes, searched]), tolerance)


def near_symmetries(
    mesh: trimesh.Trimesh, tolerance: float, group: SymmetryGroup | None = None
) -> Array:
    """Finds motions that map a shape nearly, but not exactly, onto itself.

    The candidates are the quarter and half turns about the principal axes and the axes
    of O, and their products. They are what an estimate confuses when it is wrong by a
    flip.

    Args:
        mesh: surface, m.
        tolerance: largest deviation of 95 % of the moved surface, m.
        group: the exact symmetries; detected if it is None.

    Returns:
        X_OS (K, 4, 4), the nearest first; none is in the group, and no two differ by
        an element of it.
    """
    group = detect_symmetry(mesh) if group is None else group
    match = SurfaceMatch(mesh)
    turns = Rotation.create_group("O").as_matrix()[1:]
    motions = []
    for frame in (np.eye(3), _principal_axes(match).T):
        for R in frame @ turns @ frame.T:
            about = [match.about(R, centre) for centre in match.centres]
            deviations = match.deviations(np.stack(about))
            best = int(deviations.argmin())
            if deviations[best] <= tolerance:
                motions.append((float(deviations[best]), about[best]))
    motions.sort(key=lambda item: item[0])
    kept = [np.eye(4)]
    for _, X in motions:
        distances = group.rotation_distance(np.stack(kept)[:, :3, :3], X[:3, :3])
        if distances.min() > np.radians(30):
            kept.append(X)
    return np.stack(kept)[1:]


def describe_symmetry(group: SymmetryGroup) -> str:
    """Puts a group in words: `ball`, `continuous about y + flip`, `8 discrete`."""
    if group.is_ball:
        return "ball"
    if group.axes:
        axis = group.axes[0].axis
        along = np.flatnonzero(np.abs(axis) > np.cos(np.radians(1)))
        name = "xyz"[along[0]] if len(along) else "({:.2f} {:.2f} {:.2f})".format(*axis)
        return f"continuous about {name}" + (
            " + flip" if len(group.discrete) > 1 else ""
        )
    return f"{len(group.discrete)} discrete" if len(group.discrete) > 1 else "none"


def _principal_axes(match: SurfaceMatch) -> Array:
    """Unit eigenvectors of the surface's second moments, as rows of (3, 3)."""
    R = np.linalg.eigh(match.covariance)[1].T
    return np.asarray(R * np.sign(np.linalg.det(R)))


def _turn(axis: Array, angle: float) -> Array:
    return np.asarray(Rotation.from_rotvec(angle * axis).as_matrix())


def _round_axis(
    match: SurfaceMatch, axis: Array, tolerance: float
) -> tuple[float, ContinuousAxis] | None:
    """Tests a direction as continuous axis.

    Returns:
        the deviation (m) and the axis, put right by matching surfaces; or None.
    """
    turns = [match.about(_turn(axis, w), match.centroid) for w in _ROUND_ANGLES[:3]]
    if match.deviations(np.stack(turns)).max() > _REFINABLE * tolerance:
        return None
    refined = [match.refine(X) for X in turns]
    mean_axis = np.mean([_axis_of(X, axis) for X in refined], axis=0)
    mean_axis /= np.linalg.norm(mean_axis)
    choices = [
        (axis, match.centroid),
        (mean_axis, match.fixed_point(np.stack(refined))),
    ]
    angles = np.concatenate([_ROUND_ANGLES, 2 * np.pi / np.array(_ORDERS)])
    results = []
    for direction, point in choices:
        motions = [match.about(_turn(direction, w), point) for w in angles]
        deviations = match.deviations(np.stack(motions))
        worst = float(deviations[: len(_ROUND_ANGLES)].max())
        results.append((worst, float(deviations.min()), direction, point))
    # The given axis is kept if it is as good: it is often one of O exactly.
    best = 0 if results[0][0] < 1.1 * results[1][0] else 1
    worst, least, direction, point = results[best]
    dented = worst <= _DENTED * tolerance and least > worst / 2
    if worst > tolerance and not dented:
        return None
    return worst, ContinuousAxis(_upward(direction), point)


def _has_second_axis(found: list[tuple[float, ContinuousAxis]]) -> bool:
    first = found[0][1].axis
    return any(abs(first @ other.axis) < np.cos(0.3) for _, other in found)


def _round_group(
    match: SurfaceMatch,
    found: list[tuple[float, ContinuousAxis]],
    tolerance: float,
) -> SymmetryGroup:
    """The group about one continuous axis, with the half turn across it if there."""
    axis = min(found, key=lambda item: round(item[0], 4))[1]
    across = np.eye(3)[np.abs(axis.axis).argmin()]
    across = across - (across @ axis.axis) * axis.axis
    R = _turn(across / np.linalg.norm(across), np.pi)
    flips = []
    for centre in match.centres:
        point = axis.point + axis.axis * (axis.axis @ (centre - axis.point))
        flips.append(match.about(R, point))
    deviations = match.deviations(np.stack(flips))
    best = int(deviations.argmin())
    if deviations[best] > tolerance:
        return SymmetryGroup(axes=(axis,))
    return SymmetryGroup(np.stack([np.eye(4), flips[best]]), (axis,))


def _searched_axes(match: SurfaceMatch, tolerance: float) -> Array:
    """Axes (A, 3) for shapes whose principal axes are not determined."""
    moments, vectors = np.linalg.eigh(match.covariance)
    if moments[0] > _DEGENERATE * moments[2]:
        count = 600
        z = (np.arange(count) + 0.5) / count
        angle = np.pi * (1 + np.sqrt(5)) * np.arange(count)
        radius = np.sqrt(1 - z**2)
        directions = np.stack(
            [radius * np.cos(angle), radius * np.sin(angle), z], axis=1
        )
        turns, apart = [np.pi, 2 * np.pi / 3, np.pi / 2], np.radians(12)
    else:
        rows = [
            np.outer(np.cos(angles), vectors[:, i])
            + np.outer(np.sin(angles), vectors[:, j])
            for angles in [np.radians(np.arange(0, 180, 2))]
            for i, j in pairwise(range(3))
            if moments[i] > _DEGENERATE * moments[j]
        ]
        directions = np.concatenate(rows) if rows else np.zeros((0, 3))
        turns, apart = [np.pi], np.radians(8)
    kept: list[Array] = []
    for turn in turns if len(directions) else []:
        motions = np.stack(
            [match.about(_turn(a, turn), match.centroid) for a in directions]
        )
        order = np.argsort(match.coarse_deviations(motions))
        peaks = _apart(directions[order[: len(order) // 4]], apart)[:_MAX_PEAKS]
        refined = [
            match.refine(match.about(_turn(a, turn), match.centroid)) for a in peaks
        ]
        fits = match.deviations(np.stack(refined)) <= tolerance
        kept += [
            _axis_of(X, a)
            for X, a, fit in zip(refined, peaks, fits, strict=True)
            if fit
        ]
    return _apart(np.array(kept).reshape(-1, 3), np.radians(3))


def _apart(axes: Array, angle: float) -> Array:
    """Those of `axes` (A, 3) that are more than `angle` (rad) from all before them."""
    kept = np.zeros((0, 3))
    for axis in axes:
        if (np.abs(kept @ axis) < np.cos(angle)).all():
            kept = np.concatenate([kept, axis[None]])
    return kept


def _axis_of(X: Array, axis: Array) -> Array:
    """The unit axis of a motion (4, 4) that should turn about `axis` (3,)."""
    vector = Rotation.from_matrix(X[:3, :3]).as_rotvec()
    length = float(np.linalg.norm(vector))
    if length < 0.1:
        return axis
    return np.asarray(vector / length * (1.0 if vector @ axis > 0 else -1.0))


def _discrete_group(
    match: SurfaceMatch, axes: Array, tolerance: float
) -> SymmetryGroup:
    """The largest group that grows from turns about `axes` (A, 3), best ones first."""
    rotations = np.stack(
        [_turn(a, 2 * np.pi / order) for a in axes for order in _ORDERS]
    )
    motions = np.stack([match.about(R, match.centroid) for R in rotations])
    near = match.deviations(motions) < _REFINABLE * tolerance
    if not near.any():
        return SymmetryGroup()
    rotations, motions = rotations[near], motions[near]
    refined = np.stack([match.refine(X) for X in motions])
    moved = rotation_angle(np.swapaxes(rotations, 1, 2) @ refined[:, :3, :3])
    good = (match.deviations(refined) <= tolerance) & (moved < 0.2)
    centre = match.fixed_point(refined[good]) if good.any() else match.centroid
    rotations = np.concatenate([rotations, refined[good][:, :3, :3]])
    motions = np.stack([match.about(R, centre) for R in rotations])
    deviations = match.deviations(motions)
    group = np.eye(3)[None]
    # Rounded, so that of equals the first is taken: an axis of O before others.
    for i in np.argsort(np.round(deviations, 4), kind="stable"):
        if deviations[i] > tolerance:
            break
        if rotation_angle(group.swapaxes(1, 2) @ rotations[i]).min() < _SAME_MOTION:
            continue
        grown = _close_group(np.concatenate([group, rotations[i : i + 1]]))
        if grown is None:
            continue
        members = np.stack([match.about(R, centre) for R in grown])
        if match.deviations(members).max() <= tolerance:
            group = grown
    return SymmetryGroup(np.stack([match.about(R, centre) for R in group]))


def _close_group(generators: Array) -> Array | None:
    """Multiplies rotations (K, 3, 3) until nothing new appears.

    The result is then put right to be a group to rounding error: each element becomes
    the mean of its representations as g_ij g_j^-1 (Grove, Karcher and Ruh, 1974).

    Returns:
        the group, identity first, or None if it would have more than 60 elements.
    """
    group = generators
    while True:
        products = (group[:, None] @ group[None]).reshape(-1, 3, 3)
        fresh: list[Array] = []
        for R in products:
            known = np.concatenate([group, np.array(fresh).reshape(-1, 3, 3)])
            if rotation_angle(known.swapaxes(1, 2) @ R).min() > _SAME_MOTION:
                fresh.append(R)
                if len(known) >= 60:
                    return None
        if not fresh:
            break
        group = np.concatenate([group, fresh])
    products = group[:, None] @ group[None]
    angles = rotation_angle(group.swapaxes(1, 2)[None, None] @ products[:, :, None])
    table = angles.argmin(axis=2)
    if any(len(set(row)) < len(row) for row in table.tolist()):
        return None
    for _ in range(8):
        group = nearest_rotation(
            np.mean(group[table] @ group.swapaxes(1, 2)[None], axis=1)
        )
    return np.concatenate([np.eye(3)[None], group[1:]])


def _upward(axis: Array) -> Array:
    """The axis or its opposite, so that its largest component is positive."""
    return np.asarray(axis * np.sign(axis[np.abs(axis).argmax()]))
