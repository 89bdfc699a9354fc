# SPDX-License-Identifier: MIT
"""The names of the methods; light to import, for the command line."""

from __future__ import annotations

from enum import StrEnum


class Method(StrEnum):
    """The ways to estimate a scene.

    The first two search over the scene with physics and refine it; the others take
    each object alone. The last two do the same; but the segments of the last are those
    of a fully convolutional network, wherever a method chooses its detections.
    """

    PHYSIM_MCTS = "physim-mcts"
    PHYSIM_HEURISTIC = "physim-heuristic"
    SUPER4PCS_ICP = "super4pcs-icp"
    PCA_ICP = "pca-icp"
    FCN_PCA_ICP = "fcn-pca-icp"

    @property
    def searches(self) -> bool:
        """Whether it looks at all objects together."""
        return self in (Method.PHYSIM_MCTS, Method.PHYSIM_HEURISTIC)

    @property
    def makes_hypotheses(self) -> bool:
        """Whether it makes pose hypotheses; if not, it takes principal axes."""
        return self not in (Method.PCA_ICP, Method.FCN_PCA_ICP)
