# SPDX-License-Identifier: MIT
"""From thousands of poses to a few that keep their spread (the paper, section III-B).

Two levels: k-means++ on translations, then kernel k-means on rotations within each
cluster, with a kernel on the symmetry-aware angle. Poses weigh in by their score, and
every representative is a member of the set (its cluster's medoid).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

from physim_drake.poses import Array, SymmetryGroup

Indices = NDArray[np.int64]


@dataclass(frozen=True)
class ClusteringConfig:
    """How many clusters, and how wide.

    Attributes:
        representatives: poses to keep.
        translation_clusters: clusters of the first level.
        members: the best-scored members of each translation cluster that the second
            level looks at; its cost grows with their square.
        kernel_width: standard deviation of the rotation kernel, rad.
        iterations: iterations of either k-means.
    """

    representatives: int = 25
    translation_clusters: int = 5
    members: int = 400
    kernel_width: float = np.radians(15.0)
    iterations: int = 20


def cluster_poses(
    X_SO: Array,
    weights: Array,
    symmetry: SymmetryGroup,
    generator: np.random.Generator,
    config: ClusteringConfig = ClusteringConfig(),
) -> Indices:
    """Chooses representatives of a set of poses.

    Args:
        X_SO: (N, 4, 4).
        weights: positive, (N,); larger weighs more.
        symmetry: symmetry of the object; equivalent rotations are at distance zero.
        generator: seeds both k-means.
        config: numbers of clusters.

    Returns:
        Indices of the representatives, at most `config.representatives`, in falling
        order of their cluster's weight; fewer if the set has fewer distinct poses.
    """
    count = config.representatives
    if len(X_SO) <= count:
        return np.argsort(-weights, kind="stable")
    # Distinct by construction: k-means++ would divide by zero on copies.
    groups = _translation_clusters(X_SO[:, :3, 3], generator, config)
    groups = sorted(groups, key=lambda members: -float(weights[members].sum()))
    chosen: list[tuple[float, int]] = []
    for n, members in enumerate(groups):
        share = -(-(count - len(chosen)) // (len(groups) - n))
        members = members[np.argsort(-weights[members], kind="stable")]
        members = members[: config.members]
        chosen += _rotation_medoids(
            X_SO[members, :3, :3],
            X_SO[members, :3, 3],
            weights[members],
            members,
            symmetry,
            share,
            generator,
            config,
        )
    chosen.sort(key=lambda entry: (-entry[0], entry[1]))
    return np.array([index for _, index in chosen], dtype=np.int64)


def _translation_clusters(
    translations: Array, generator: np.random.Generator, config: ClusteringConfig
) -> list[Indices]:
    spread = np.ptp(translations, axis=0).max()
    k = min(config.translation_clusters, len(translations))
    if spread < 1e-6 or k == 1:
        return [np.arange(len(translations))]
    labels = kmeans2(
        translations / spread,
        k,
        iter=config.iterations,
        minit="++",
        missing="warn",
        rng=generator,
    )[1]
    return [np.flatnonzero(labels == c) for c in np.unique(labels)]


def _rotation_medoids(
    R: Array,
    p: Array,
    weights: Array,
    members: Indices,
    symmetry: SymmetryGroup,
    count: int,
    generator: np.random.Generator,
    config: ClusteringConfig,
) -> list[tuple[float, int]]:
    """(cluster weight, index) of the medoids of weighted kernel k-means."""
    angles = symmetry.rotation_distance(R, R, pairwise=True)
    # Translations enter weakly: they part poses whose rotations are equivalent, as
    # all of a ball's are.
    offsets = np.linalg.norm(p[:, None] - p[None], axis=-1)
    K = np.exp(-0.5 * (angles / config.kernel_width) ** 2 - 0.5 * (offsets / 0.03) ** 2)
    labels = _kernel_kmeans(K, weights, min(count, len(R)), generator, config)
    medoids = []
    for c in np.unique(labels):
        inside = np.flatnonzero(labels == c)
        similarity = K[np.ix_(inside, inside)] @ weights[inside]
        best = inside[int(similarity.argmax())]
        medoids.append((float(weights[inside].sum()), int(members[best])))
    return medoids


def _kernel_kmeans(
    K: Array,
    weights: Array,
    count: int,
    generator: np.random.Generator,
    config: ClusteringConfig,
) -> Indices:
    """Weighted kernel k-means (Dhillon et al. 2004), seeded as k-means++: (N,)."""
    n = len(K)
    seeds = [int(weights.argmax())]
    distance = 2 - 2 * K[seeds[0]]
    while len(seeds) < count and distance.max() > 1e-6:
        probability = np.maximum(distance, 0) * weights
        seeds.append(int(generator.choice(n, p=probability / probability.sum())))
        distance = np.minimum(distance, 2 - 2 * K[seeds[-1]])
    labels = K[:, seeds].argmax(axis=1)
    for _ in range(config.iterations):
        member = np.zeros((n, len(seeds)))
        member[np.arange(n), labels] = weights
        total = member.sum(axis=0)
        alive = total > 0
        share = member[:, alive] / total[alive]
        towards = K @ share
        within = np.einsum("nc,nc->c", share, towards)
        updated = np.flatnonzero(alive)[(within - 2 * towards).argmin(axis=1)]
        if (updated == labels).all():
            break
        labels = updated
    return np.asarray(labels)
