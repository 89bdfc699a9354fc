# SPDX-License-Identifier: MIT
"""One small generated dataset, which several modules look at."""

from __future__ import annotations

from pathlib import Path

import pytest

from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.scenes.dataset import generate_dataset
from physim_drake.scenes.recording import DatasetConfig

SCENES = 3
CONFIG = DatasetConfig(seed=5, min_objects=3, max_objects=3, views=2)


@pytest.fixture(scope="session")
def library() -> ObjectLibrary:
    return ObjectLibrary.load(APC11)


@pytest.fixture(scope="session")
def dataset(library: ObjectLibrary, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenes 1 to 3 of levels 1 to 3, two images each."""
    root = tmp_path_factory.mktemp("generated") / "dataset"
    generate_dataset(root, library, CONFIG, SCENES)
    return root
