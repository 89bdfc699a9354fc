# SPDX-License-Identifier: MIT
"""Scenes of small or large objects, estimated at a size for which the steps are made.

Every length of a scene and of its models is multiplied, and what is found is divided by
the same factor, which is a power of two, so that nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from physim_drake.estimation.preparation import PreparedScene
from physim_drake.hypotheses.generation import PoseHypotheses
from physim_drake.objects.model import ObjectLibrary, ObjectModel
from physim_drake.observation.segmented_scene import SegmentedScene
from physim_drake.observation.support_surface import SupportSurface
from physim_drake.poses import Array
from physim_drake.scene_estimate import ObjectEstimate, SceneEstimate, SearchTrace
from physim_drake.search.record import SearchRecord


def resized_poses(X: Array, scale: float) -> Array:
    """Poses (..., 4, 4) whose translations are multiplied by `scale`."""
    result = np.array(X, dtype=float)
    result[..., :3, 3] *= scale
    return result


def resized_library(models: Mapping[int, ObjectModel], scale: float) -> ObjectLibrary:
    """The objects, larger by `scale`, as dense as before."""
    return ObjectLibrary(
        [model.resized(scale) for model in models.values()], f"models x {scale:g}"
    )


def resized_scene(prepared: PreparedScene, scale: float) -> PreparedScene:
    """The image of a scene that is larger by `scale`, farther away by as much."""
    observation, segmented = prepared.observation, prepared.segmented
    X_WC = observation.X_WC
    observation = replace(
        observation,
        depth=_resized_depth(observation.depth, scale),
        X_WC=None if X_WC is None else resized_poses(X_WC, scale),
    )
    surface = SupportSurface(
        resized_poses(prepared.surface.X_CS, scale),
        resized_poses(prepared.surface.X_WS, scale),
        prepared.surface.known,
    )
    scene = SegmentedScene(
        [replace(s, points=s.points * scale) for s in segmented.segments],
        _resized_depth(segmented.depth, scale),
        _resized_depth(segmented.observed, scale),
        segmented.intrinsics,
        surface.X_CS,
        segmented.supported,
    )
    return replace(
        prepared, observation=observation, surface=surface, segmented=scene, factor=1.0
    )


def _resized_depth(
    depth: np.ndarray[tuple[int, ...], np.dtype[np.float32]], scale: float
) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return depth * np.float32(scale)


def resized_hypotheses(
    hypotheses: Iterable[PoseHypotheses], scale: float
) -> tuple[PoseHypotheses, ...]:
    """Hypotheses of objects that are larger by `scale`."""
    return tuple(replace(h, X_SO=resized_poses(h.X_SO, scale)) for h in hypotheses)


def resized_record(record: SearchRecord, scale: float) -> SearchRecord:
    """The search of a scene that is larger by `scale`."""
    result = record.result
    states = tuple(
        replace(s, poses=resized_poses(s.poses, scale)) for s in result.states
    )
    trace = tuple(replace(p, poses=resized_poses(p.poses, scale)) for p in result.trace)
    return replace(record, result=replace(result, states=states, trace=trace))


def resized_estimate(
    estimate: SceneEstimate, prepared: PreparedScene, scale: float
) -> SceneEstimate:
    """The estimate of a scene that is larger by `scale`.

    Args:
        estimate: of the scene as it was estimated.
        prepared: the scene that it becomes an estimate of.
        scale: size of that scene over the size of the one that was estimated.
    """
    return replace(
        estimate,
        objects=tuple(_resized_object(o, scale) for o in estimate.objects),
        surface=prepared.surface,
        trace=tuple(_resized_trace(t, scale) for t in estimate.trace),
    )


def _resized_object(item: ObjectEstimate, scale: float) -> ObjectEstimate:
    if item.X_CO is None or item.X_WO is None:
        return item
    X_CO, X_WO = (resized_poses(X, scale) for X in (item.X_CO, item.X_WO))
    return replace(item, X_CO=X_CO, X_WO=X_WO)


def _resized_trace(trace: SearchTrace, scale: float) -> SearchTrace:
    points = tuple((n, s, c, resized_poses(X, scale)) for n, s, c, X in trace.points)
    return replace(trace, points=points)
