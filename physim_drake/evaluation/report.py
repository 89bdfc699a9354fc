# SPDX-License-Identifier: MIT
"""The report of an evaluation: errors of each true instance, and their means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from physim_drake.evaluation.calibration import Calibration

MISSED_ROTATION_DEG = 90.0
MISSED_TRANSLATION_CM = 20.0


@dataclass(frozen=True)
class InstanceErrors:
    """How well one true instance was found; by default it was not found.

    Attributes:
        scene_id: scene of the image.
        im_id: image in the scene.
        object_id: id of the object.
        gt_index: index of the instance in scene_gt.json.
        level: interaction level, or None if the dataset does not give it.
        found: True if an estimate was matched with it.
        confidence: the score of that estimate; None when missed.
        rotation_deg: mean of |roll|, |pitch|, |yaw|, smallest over the symmetries.
        geodesic_deg: rotation angle, smallest over the symmetries.
        translation_cm: distance of the origins.
        accepted: True if it is within 5 degrees and 1 cm.
        add_s_cm: mean distance to the nearest surface point; None when missed.
        add_s_accepted: True if that is below a tenth of the diameter.
        mssd_cm: maximum symmetry-aware surface distance; None when missed.
        mspd_px: maximum symmetry-aware projection distance; None when missed.
        vsd_recall: fraction of the challenge's tolerances and thresholds that VSD
            meets; None if VSD was not computed.
        mssd_recall: fraction of the thresholds that MSSD meets.
        mspd_recall: fraction of the thresholds that MSPD meets.
    """

    scene_id: int
    im_id: int
    object_id: int
    gt_index: int
    level: int | None = None
    found: bool = False
    confidence: float | None = None
    rotation_deg: float = MISSED_ROTATION_DEG
    geodesic_deg: float = MISSED_ROTATION_DEG
    translation_cm: float = MISSED_TRANSLATION_CM
    accepted: bool = False
    add_s_cm: float | None = None
    add_s_accepted: bool = False
    mssd_cm: float | None = None
    mspd_px: float | None = None
    vsd_recall: float | None = None
    mssd_recall: float = 0.0
    mspd_recall: float = 0.0


@dataclass(frozen=True)
class Summary:
    """Means over a set of targets; missed ones count 90 degrees and 20 cm.

    Attributes:
        targets: number of true instances.
        found: fraction with an estimate.
        rotation_mean_deg: mean of `InstanceErrors.rotation_deg`.
        geodesic_mean_deg: mean rotation angle.
        geodesic_median_deg: median rotation angle.
        translation_mean_cm: mean distance of the origins.
        translation_median_cm: median distance of the origins.
        recall_5deg_1cm: fraction within 5 degrees and 1 cm.
        add_s_recall: fraction with ADD-S below a tenth of the diameter.
        ar_vsd: average recall of VSD, None if it was not computed.
        ar_mssd: average recall of MSSD.
        ar_mspd: average recall of MSPD.
    """

    targets: int
    found: float
    rotation_mean_deg: float
    geodesic_mean_deg: float
    geodesic_median_deg: float
    translation_mean_cm: float
    translation_median_cm: float
    recall_5deg_1cm: float
    add_s_recall: float
    ar_vsd: float | None
    ar_mssd: float
    ar_mspd: float

    @classmethod
    def of(cls, errors: Sequence[InstanceErrors]) -> Summary:
        """Summarises at least one target."""
        geodesic = [e.geodesic_deg for e in errors]
        translation = [e.translation_cm for e in errors]
        vsd = [e.vsd_recall for e in errors if e.vsd_recall is not None]
        return cls(
            targets=len(errors),
            found=_mean([e.found for e in errors]),
            rotation_mean_deg=_mean([e.rotation_deg for e in errors]),
            geodesic_mean_deg=_mean(geodesic),
            geodesic_median_deg=float(np.median(geodesic)),
            translation_mean_cm=_mean(translation),
            translation_median_cm=float(np.median(translation)),
            recall_5deg_1cm=_mean([e.accepted for e in errors]),
            add_s_recall=_mean([e.add_s_accepted for e in errors]),
            ar_vsd=_mean(vsd) if vsd else None,
            ar_mssd=_mean([e.mssd_recall for e in errors]),
            ar_mspd=_mean([e.mspd_recall for e in errors]),
        )


@dataclass(frozen=True)
class EvaluationReport:
    """The outcome of one evaluation.

    Attributes:
        overall: means over all targets.
        levels: means by interaction level; empty if the dataset does not give levels.
        objects: means by object id.
        errors: one for each true instance.
        images: number of images with targets.
        timed_images: number of those with a time in the results.
        time_per_image: mean seconds over those, or None.
        unused_rows: rows of the results that belong to no target.
        calibration: how scores agree with the share that is right; None if there are
            no estimates, or scores are not confidences.
    """

    overall: Summary
    levels: dict[int, Summary]
    objects: dict[int, Summary]
    errors: tuple[InstanceErrors, ...]
    images: int
    timed_images: int
    time_per_image: float | None
    unused_rows: int
    calibration: Calibration | None = None

    @classmethod
    def of(
        cls,
        errors: Sequence[InstanceErrors],
        times: Sequence[float | None],
        unused_rows: int,
    ) -> EvaluationReport:
        """Computes all means.

        Args:
            errors: errors of at least one instance.
            times: seconds of each image with targets, None if not known.
            unused_rows: see `EvaluationReport`.
        """
        known = [time for time in times if time is not None]
        levels = sorted({e.level for e in errors if e.level is not None})
        return cls(
            Summary.of(errors),
            {n: Summary.of([e for e in errors if e.level == n]) for n in levels},
            {
                n: Summary.of([e for e in errors if e.object_id == n])
                for n in sorted({e.object_id for e in errors})
            },
            tuple(errors),
            len(times),
            len(known),
            _mean(known) if known else None,
            unused_rows,
            Calibration.of(
                [e.confidence for e in errors if e.confidence is not None],
                [e.accepted for e in errors if e.confidence is not None],
            ),
        )

    def as_dict(self) -> dict[str, Any]:
        """The report in plain values, for JSON."""
        return asdict(self)


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))
