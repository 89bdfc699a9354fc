# SPDX-License-Identifier: MIT
"""Fixtures for integration tests: `pytest_plugins = ["physim_drake.pytest_plugin"]`."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from physim_drake.estimation.estimator import EstimationConfig, PoseEstimator
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.testing import ObservedScene, observed_scene


@pytest.fixture(scope="session")
def object_library() -> ObjectLibrary:
    """The objects of the scenes: the bundled ones, unless you override it."""
    return ObjectLibrary.load(APC11)


@pytest.fixture(scope="session")
def make_scene(object_library: ObjectLibrary) -> Callable[..., ObservedScene]:
    """Makes a scene of `object_library`: `make_scene(level=2, seed=3)`.

    The arguments are those of `physim_drake.testing.observed_scene`.
    """

    def make(level: int = 1, seed: int = 0, **options: object) -> ObservedScene:
        return observed_scene(object_library, level, seed, **options)  # type: ignore[arg-type]

    return make


@pytest.fixture(scope="session")
def pose_estimator(object_library: ObjectLibrary) -> Iterator[PoseEstimator]:
    """An estimator for `object_library` that stays open for the whole session."""
    with PoseEstimator(object_library, EstimationConfig()) as estimator:
        yield estimator
