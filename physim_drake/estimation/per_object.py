# SPDX-License-Identifier: MIT
"""Each object alone: its best hypothesis or principal axes, then ICP."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.hypotheses.pca import pca_poses
from physim_drake.objects.model import ObjectModel
from physim_drake.observation.observation import Segment
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.poses import Array
from physim_drake.registration.registration_model import registration_model
from physim_drake.registration.trimmed_icp import (
    TrimmedIcpConfig,
    lcp_scores,
    trimmed_icp,
)

_ICP = TrimmedIcpConfig(keep=0.9, soft=False, cutoff=0.02)
_LCP_DISTANCE = 0.005  # m


def register_hypotheses(
    scene: SegmentedScene,
    library: Mapping[int, ObjectModel],
    found: Mapping[int, PoseHypotheses],
) -> dict[int, Array]:
    """X_SO of each object, from its hypothesis of the highest LCP score.

    Args:
        scene: the segments.
        library: models of the objects.
        found: hypotheses of the objects, by their index in the scene.
    """
    return {
        k: _best_aligned(
            library[scene.object_ids[k]],
            scene.segments[k],
            h.X_SO[[int(h.lcp.argmax())]],
        )
        for k, h in found.items()
    }


def register_principal_axes(
    scene: SegmentedScene, library: Mapping[int, ObjectModel], indices: Iterable[int]
) -> dict[int, Array]:
    """X_SO of each object, from the principal axes of its segment.

    Args:
        scene: the segments.
        library: models of the objects.
        indices: indices of the objects in the scene.
    """
    placed = {}
    for k in indices:
        model, segment = library[scene.object_ids[k]], scene.segments[k]
        placed[k] = _best_aligned(model, segment, pca_poses(model, segment))
    return placed


def _best_aligned(model: ObjectModel, segment: Segment, X_SO: Array) -> Array:
    """The one of some poses (N, 4, 4) that fits best when it is aligned, (4, 4)."""
    field_O = registration_model(model).distance_field
    points, normals = segment.points, segment.normals
    aligned, _ = trimmed_icp(field_O, X_SO, points, normals, _ICP)
    scores = lcp_scores(field_O, aligned, points, normals, _LCP_DISTANCE)
    best: Array = aligned[int(scores.argmax())]
    return best
