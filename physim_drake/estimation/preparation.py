# SPDX-License-Identifier: MIT
"""One image made ready for the estimate: its support surface and its segments."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from physim_drake.errors import InputError
from physim_drake.estimation.scale_check import error_with_scale_warning, scale_warning
from physim_drake.objects.model import ObjectModel
from physim_drake.observation.object_sizes import ObjectSizes
from physim_drake.observation.observation import Detection, RgbdObservation
from physim_drake.observation.segmented_scene import SegmentedScene, prepare_scene
from physim_drake.observation.support_surface import (
    NoSurfaceError,
    SupportSurface,
    find_support_surface,
    no_surface,
    surface_at_height,
)


@dataclass(frozen=True)
class EstimationRequest:
    """What an estimate is made of.

    Attributes:
        observation: the image.
        detections: one for each object to find.
        surface_height: z of the support surface in the world, m; found in the image if
            None; -inf if nothing carries the objects.
    """

    observation: RgbdObservation
    detections: Sequence[Detection]
    surface_height: float | None = None


@dataclass(frozen=True)
class PreparedScene:
    """One image made ready.

    Attributes:
        observation: the image.
        detections: one for each object to find.
        surface: plane that the objects rest on.
        segmented: the image cut into segments, one for each detection; hypotheses are
            in the frame S of its surface.
        seconds: time taken to make it, s.
        factor: by what the lengths of its estimate are multiplied, see `ObjectSizes`.
    """

    observation: RgbdObservation
    detections: tuple[Detection, ...]
    surface: SupportSurface
    segmented: SegmentedScene
    seconds: float = 0.0
    factor: float = 1.0


def prepare(
    request: EstimationRequest, library: Mapping[int, ObjectModel], seed: int
) -> PreparedScene:
    """Finds the support surface and cuts the image into segments.

    Args:
        request: the image and what to find in it.
        library: models of the objects.
        seed: seed of the search for the surface.

    Raises:
        InputError: if the surface cannot be found.
    """
    start = time.monotonic()
    observation, detections = request.observation, tuple(request.detections)
    sizes = ObjectSizes.of([d for d in detections if d.seen], library)
    if request.surface_height is None:
        surface = _found_surface(observation, detections, library, sizes, seed)
    elif request.surface_height == -math.inf:
        surface = no_surface(observation)
    else:
        surface = surface_at_height(observation, request.surface_height)
    segmented = prepare_scene(observation, surface, detections, sizes)
    taken = time.monotonic() - start
    return PreparedScene(
        observation, detections, surface, segmented, taken, sizes.factor
    )


def _found_surface(
    observation: RgbdObservation,
    detections: Sequence[Detection],
    library: Mapping[int, ObjectModel],
    sizes: ObjectSizes,
    seed: int,
) -> SupportSurface:
    """The surface in the image; an error says if the image seems to have a wrong unit.

    Raises:
        InputError: if nothing is measured where the objects are.
    """
    seen = [d for d in detections if d.seen]
    generator = np.random.default_rng(seed)
    try:
        return find_support_surface(observation, seen, generator, sizes)
    except NoSurfaceError as error:
        return no_surface(observation, error.problem)
    except InputError as error:
        warning = scale_warning(observation, seen, library)
        raise error_with_scale_warning(error, warning) from None
