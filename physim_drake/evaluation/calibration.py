# SPDX-License-Identifier: MIT
"""Calibration: of the estimates with some confidence, how many are right.

An estimate is right here when it is within 5 degrees and 1 cm of the truth, after
symmetry. Targets without an estimate do not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0)
"""Edges of the bins of confidence, which are narrower for frequent values."""

SURE = 0.9
"""Least confidence of an estimate that may be acted on."""


@dataclass(frozen=True)
class ConfidenceBin:
    """Estimates of similar confidence.

    Attributes:
        low: least confidence in the bin.
        high: upper edge of the bin; only the last bin includes it.
        estimates: number of estimates in the bin.
        confidence: mean confidence; None if the bin is empty.
        correct: share of them that is right; None if the bin is empty.
    """

    low: float
    high: float
    estimates: int
    confidence: float | None
    correct: float | None


@dataclass(frozen=True)
class Calibration:
    """How well confidence predicts correctness.

    Attributes:
        bins: bins in ascending order.
        sure: number of estimates with a confidence of at least `SURE`.
        sure_correct: share of them that is right; None if the bin is empty.
        gap: mean distance of confidence and correctness over the bins, by estimates
            (the "expected calibration error").
    """

    bins: tuple[ConfidenceBin, ...]
    sure: int
    sure_correct: float | None
    gap: float

    @classmethod
    def of(
        cls, confidences: Sequence[float], correct: Sequence[bool]
    ) -> Calibration | None:
        """Sorts estimates into bins.

        Args:
            confidences: confidence of each estimate.
            correct: True for each estimate that is right.

        Returns:
            None if there are no estimates, or a confidence is outside 0..1, as scores
            of other programs may be.
        """
        claims, right = np.array(confidences, float), np.array(correct, bool)
        if len(claims) == 0 or not ((claims >= 0) & (claims <= 1)).all():
            return None
        index = np.clip(np.searchsorted(EDGES, claims, "right") - 1, 0, len(EDGES) - 2)
        bins = tuple(
            _bin(EDGES[k], EDGES[k + 1], claims[index == k], right[index == k])
            for k in range(len(EDGES) - 1)
        )
        sure = claims >= SURE
        gaps = [
            b.estimates * abs(b.confidence - b.correct)
            for b in bins
            if b.confidence is not None and b.correct is not None
        ]
        return cls(
            bins,
            int(sure.sum()),
            float(right[sure].mean()) if sure.any() else None,
            float(sum(gaps) / len(claims)),
        )

    def __str__(self) -> str:
        """Two lines: what the sure ones are worth, and the bins."""
        share = "-" if self.sure_correct is None else f"{self.sure_correct:.3f}"
        bins = ", ".join(
            f"{b.low:g}-{b.high:g}: {b.correct:.2f} ({b.estimates})"
            for b in self.bins
            if b.correct is not None
        )
        return (
            f"confidence: of {self.sure} estimates that claim {SURE:g} or more, "
            f"{share} are within 5 degrees and 1 cm\n"
            f"share that is right by confidence: {bins}"
        )


def _bin(
    low: float,
    high: float,
    claims: np.ndarray[tuple[int], np.dtype[np.float64]],
    right: np.ndarray[tuple[int], np.dtype[np.bool_]],
) -> ConfidenceBin:
    if len(claims) == 0:
        return ConfidenceBin(low, high, 0, None, None)
    mean, share = float(claims.mean()), float(right.mean())
    return ConfidenceBin(low, high, len(claims), mean, share)


def reliability_figure(calibration: Calibration) -> Figure:
    """The reliability diagram: share that is right over confidence, with counts.

    Bars on the diagonal are calibrated; above it, estimates are better than they
    claim.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.5, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], "--", color="0.5", linewidth=1, label="calibrated")
    filled = [b for b in calibration.bins if b.correct is not None]
    axes.bar(
        [b.low for b in filled],
        [b.correct or 0.0 for b in filled],
        [b.high - b.low for b in filled],
        align="edge",
        alpha=0.6,
        edgecolor="0.3",
        label="share that is right",
    )
    for k, b in enumerate(filled):
        # Narrow bins stand close together, so their counts take turns in height.
        height = 1.02 + 0.06 * (k % 3)
        axes.text((b.low + b.high) / 2, height, str(b.estimates), ha="center", size=7)
    axes.set(xlabel="confidence", ylabel="share that is right", xlim=(0, 1))
    axes.set(ylim=(0, 1.22), yticks=np.linspace(0, 1, 6))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="center left", fontsize="small")
    return figure
