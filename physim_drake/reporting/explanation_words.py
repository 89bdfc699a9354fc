# SPDX-License-Identifier: MIT
"""What became of an object, in plain words."""

from __future__ import annotations

import numpy as np

from physim_drake.pose_errors import PoseError
from physim_drake.poses import Array
from physim_drake.registration.registration_model import lookalike_turns
from physim_drake.reporting.explanation import Explanation
from physim_drake.search.states import Confirmation

RIGHT_DEG, RIGHT_MM = 5.0, 10.0
"""A pose within both is called right."""

NEAR_DEG, NEAR_MM = 20.0, 25.0
"""A hypothesis within both is one that registration can be expected to correct."""

_DOUBTED = 0.9
_RIVALS = (
    "Other poses of it that were tried explain the image about as well, so that "
    "they share the confidence."
)


def verdict(explanation: Explanation, k: int, confirmation: Confirmation) -> str:
    """What the image says about the estimate of object `k`."""
    item = explanation.estimate.objects[k]
    if not item.found:
        return (
            f"Not found: {item.reason}. Likely its box is off the object, something "
            "hides it, or the camera measures nothing there, as on black, shiny or "
            "transparent things."
        )
    if item.confidence >= explanation.config.confident_from:
        return "The depth image confirms it."
    if confirmation.confidence >= explanation.config.confident_from:
        return f"The depth image agrees with it. {_RIVALS}"
    doubts = []
    if confirmation.agrees < _DOUBTED:
        doubts.append(
            f"Where the model is drawn, {1 - confirmation.agrees:.0%} of the measured "
            "depth is not where the model is: the pose is off, or the object has "
            "another size or shape than its model."
        )
    if confirmation.explained < _DOUBTED:
        doubts.append(
            f"Of the depth in its segment, {1 - confirmation.explained:.0%} is "
            "explained by no object: its box holds other things as well, or the pose "
            "is off."
        )
    if item.confidence < _DOUBTED * confirmation.confidence:
        doubts.append(_RIVALS)
    start = "does not confirm" if doubts else "nearly confirms"
    return " ".join([f"The depth image {start} it.", *doubts])


def diagnosis(explanation: Explanation, k: int) -> str:
    """At which stage object `k` went wrong, judged by the truth; empty without one."""
    final = explanation.error(k, explanation.estimate.objects[k].X_CO)
    if explanation.truth[k] is None or explanation.estimate.objects[k].X_CO is None:
        return ""
    if is_within(final, RIGHT_DEG, RIGHT_MM):
        return "The pose is right."
    if _looks_alike(explanation, k):
        return (
            "It is turned to where the object looks nearly the same to a depth camera, "
            "and colour is not used: if the turn does not matter, give the object this "
            "symmetry."
        )
    nearest = explanation.nearest_representative(k)
    kept = explanation.error(k, _representative(explanation, k, nearest))
    if kept is None or not is_within(kept, NEAR_DEG, NEAR_MM):
        return (
            "None of the kept hypotheses is near the true pose, so that the search "
            "had nothing right to choose: look at the segment and the hypotheses."
        )
    searched = explanation.error(k, explanation.searched_pose(k))
    if not is_within(searched, NEAR_DEG, NEAR_MM):
        rank = 0 if nearest is None else nearest + 1
        return (
            f"Hypothesis {rank} was near the true pose, but the search found that a "
            "state with another one explains more of the image, or had no time to try "
            "this one well: look at the search, or give it more expansions."
        )
    if not is_within(searched, RIGHT_DEG, RIGHT_MM):
        return (
            "The search came near the true pose, but neither it nor the refinement "
            "came near enough: the depth hardly tells the poses apart, or is off."
        )
    return "The search was right; later rounds or the refinement moved the object away."


def _looks_alike(explanation: Explanation, k: int) -> bool:
    """Whether the estimate is right but for a turn that hardly changes the shape."""
    model = explanation.library[explanation.detections[k].object_id]
    X_CO = explanation.estimate.objects[k].X_CO
    if X_CO is None:
        return False
    return any(
        is_within(explanation.error(k, X), RIGHT_DEG, RIGHT_MM)
        for X in X_CO @ lookalike_turns(model)
    )


def is_within(error: PoseError | None, angle_deg: float, distance_mm: float) -> bool:
    """Whether an error is known and below both limits."""
    return (
        error is not None
        and error.geodesic_deg <= angle_deg
        and error.translation_mm <= distance_mm
    )


def stage_errors(explanation: Explanation, k: int) -> list[PoseError | None]:
    """How far object `k` was from the truth at each stage.

    Returns:
        of the best-scored hypothesis, of the nearest one kept, of the best state of
        the first search, and of the estimate; None if there is none.
    """
    nearest = explanation.nearest_representative(k)
    first = 0 if len(explanation.hypotheses[k].X_SO) else None
    return [
        explanation.error(k, _representative(explanation, k, first)),
        explanation.error(k, _representative(explanation, k, nearest)),
        explanation.error(k, explanation.searched_pose(k)),
        explanation.error(k, explanation.estimate.objects[k].X_CO),
    ]


def _representative(explanation: Explanation, k: int, n: int | None) -> Array | None:
    if n is None:
        return None
    return np.asarray(explanation.scene.X_CS @ explanation.hypotheses[k].poses[n])
