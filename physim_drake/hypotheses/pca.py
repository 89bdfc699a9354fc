# SPDX-License-Identifier: MIT
"""Initial poses from principal axes: the segment's put on the model's."""

from __future__ import annotations

from itertools import product

import numpy as np

from physim_drake.objects.model import ObjectModel
from physim_drake.observation.observation import Segment
from physim_drake.poses import Array, make_pose
from physim_drake.registration.registration_model import registration_model


def pca_poses(model: ObjectModel, segment: Segment) -> Array:
    """Poses that put the model's principal axes on the segment's, centroid on centroid.

    The signs of the axes are open, so four right-handed poses come back.

    Args:
        model: the object.
        segment: at least three points.

    Returns:
        X_SO, (4, 4, 4).
    """
    R_O, centre_O = _principal_frame(registration_model(model).points)
    R_S, centre_S = _principal_frame(segment.points)
    poses = []
    for a, b in product((1.0, -1.0), repeat=2):
        R = R_S @ np.diag([a, b, a * b]) @ R_O.T
        poses.append(make_pose(R, centre_S - R @ centre_O))
    return np.stack(poses)


def _principal_frame(points: Array) -> tuple[Array, Array]:
    """Right-handed principal axes (3, 3), as columns, and centroid (3,)."""
    centre = points.mean(axis=0)
    axes = np.linalg.eigh(np.cov((points - centre).T))[1]
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return axes, centre
