# SPDX-License-Identifier: MIT
"""Algorithm 1 of the paper: from one object's segment to its pose hypotheses."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from physim_drake.hypotheses.clustering import ClusteringConfig, cluster_poses
from physim_drake.hypotheses.pairs import pair_index
from physim_drake.hypotheses.super4pcs import Super4PcsConfig, super4pcs
from physim_drake.hypotheses.visibility import visibility
from physim_drake.objects.model import ObjectModel
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.poses import Array
from physim_drake.registration.registration_model import (
    RegistrationModel,
    registration_model,
)
from physim_drake.registration.trimmed_icp import (
    TrimmedIcpConfig,
    lcp_scores,
    trimmed_icp,
)

_TRUST_IN_SIGHT = 2
"""Power of visibility. Of 1 to 4, the representatives hold a success most often at 2
and 3 (`benchmarks.peers --only registration` counts that, on any dataset)."""
_SHARPNESS = 4
"""Power of a pose's weight in clustering."""


@dataclass(frozen=True)
class HypothesisConfig:
    """How hypotheses are made.

    Attributes:
        super4pcs: sizes and tolerances of the congruent sets.
        clustering: numbers of representatives.
        segment_points: points of the segment that are matched and scored.
        lcp_delta: distance from the model within which a point counts, m.
        coarse_delta: the same while the poses are not yet polished.
        polished: this many of the most promising poses get a short trimmed ICP, and
            are scored again.
        polish: its settings.
    """

    super4pcs: Super4PcsConfig = field(default_factory=Super4PcsConfig)
    clustering: ClusteringConfig = field(default_factory=ClusteringConfig)
    segment_points: int = 140
    lcp_delta: float = 0.003
    coarse_delta: float = 0.006
    polished: int = 1000
    polish: TrimmedIcpConfig = field(
        default_factory=lambda: TrimmedIcpConfig(iterations=8, tolerance=3e-4)
    )


@dataclass(frozen=True)
class PoseHypotheses:
    """Scored poses of one object, and the few that represent them.

    Attributes:
        object_id: id of the object.
        X_SO: all poses, (N, 4, 4), in the support frame.
        lcp: LCP scores of the poses, (N,), 0..1.
        representatives: indices of the poses to search over, best LCP first, (K,).
    """

    object_id: int
    X_SO: Array
    lcp: Array
    representatives: np.ndarray[tuple[int], np.dtype[np.int64]]

    @property
    def poses(self) -> Array:
        """The representatives' X_SO, (K, 4, 4)."""
        return self.X_SO[self.representatives]

    @property
    def scores(self) -> Array:
        """The representatives' LCP scores, (K,)."""
        return self.lcp[self.representatives]


def generate_hypotheses(
    model: ObjectModel,
    scene: SegmentedScene,
    points: Array,
    normals: Array,
    generator: np.random.Generator,
    config: HypothesisConfig = HypothesisConfig(),
) -> PoseHypotheses:
    """Super4PCS poses of a segment, scored and clustered.

    For choosing among them, each pose weighs its LCP score (how much of the segment
    it explains) times the square of its visibility (how much of what it shows was
    observed): a box that holds more of another object than of its own is explained
    better by wrong poses, but these show what was not observed.

    Args:
        model: the object.
        scene: the image it is in.
        points: p_S of its segment, (N, 3), m.
        normals: unit normals at the points, (N, 3).
        generator: source of all random choices.
        config: sizes and tolerances.

    Returns:
        The whole scored set; empty if the segment is too small to match.
    """
    prepared = registration_model(model)
    if len(points) > config.segment_points:
        keep = generator.choice(len(points), config.segment_points, replace=False)
        points, normals = points[keep], normals[keep]
    X_SO = super4pcs(pair_index(model), points, normals, generator, config.super4pcs)
    if len(X_SO) == 0:
        return PoseHypotheses(
            model.object_id, X_SO, np.zeros(0), np.zeros(0, dtype=np.int64)
        )
    distances = prepared.distance_field
    deltas = config.coarse_delta, config.lcp_delta
    scores = lcp_scores(distances, X_SO, points[::2], normals[::2], deltas)
    coarse, lcp = scores[:, 0], scores[:, 1].copy()
    best = _most_promising(prepared, X_SO, coarse, scene, config.polished)
    X_SO[best], _ = trimmed_icp(distances, X_SO[best], points, normals, config.polish)
    lcp[best] = lcp_scores(distances, X_SO[best], points, normals, config.lcp_delta)
    weights = lcp[best] * visibility(prepared, X_SO[best], scene) ** _TRUST_IN_SIGHT
    weights = weights**_SHARPNESS + 1e-9
    chosen = best[
        cluster_poses(X_SO[best], weights, model.symmetry, generator, config.clustering)
    ]
    chosen = chosen[np.argsort(-lcp[chosen], kind="stable")]
    return PoseHypotheses(model.object_id, X_SO, lcp, chosen)


def _most_promising(
    prepared: RegistrationModel,
    X_SO: Array,
    lcp: Array,
    scene: SegmentedScene,
    count: int,
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Indices of the poses whose LCP score times squared visibility is largest.

    Visibility is at most 1, so poses need not be looked at once their score alone is
    less than what enough others have.
    """
    order = np.argsort(-lcp, kind="stable")
    weights = np.zeros(0)
    for start in range(0, len(order), count):
        following = order[start : start + count]
        seen = visibility(prepared, X_SO[following], scene)
        promise = lcp[following] * seen**_TRUST_IN_SIGHT
        weights = np.concatenate([weights, promise])
        rest = order[start + count : start + count + 1]
        if len(rest) == 0 or (lcp[rest] <= np.partition(weights, -count)[-count]).all():
            break
    return order[np.argsort(-weights, kind="stable")[:count]]
