# SPDX-License-Identifier: MIT
"""Explanations of the bundled example scene, made once with a small budget."""

from __future__ import annotations

import json
import shutil
import tempfile
from functools import cache
from pathlib import Path

from physim_drake.batch.detection_source import DetectionSource
from physim_drake.datasets.bop import BopDataset
from physim_drake.estimation.estimator import EstimationConfig
from physim_drake.models import APC11
from physim_drake.objects.model import ObjectLibrary
from physim_drake.reporting.explanation import Explanation, explain_image

EXAMPLE = Path(__file__).parents[2] / "examples" / "data" / "tabletop"
BOX, CRAYONS, BOTTLE = 0, 1, 2


def explain(root: Path) -> Explanation:
    """Explains the image of a dataset like the example."""
    dataset = BopDataset(root, models=APC11)
    library = ObjectLibrary.load(APC11, {t.object_id for t in dataset.targets()})
    source = DetectionSource.default(dataset)
    config = EstimationConfig().with_budget(24, 8)
    return explain_image(dataset, (1, 0), source.look_up, source.name, library, config)


@cache
def example() -> Explanation:
    """With colour and truth."""
    return explain(EXAMPLE)


@cache
def bare() -> Explanation:
    """Without colour and truth, and with the crayons' box where nothing is."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "bare"
        shutil.copytree(EXAMPLE, root)
        shutil.rmtree(root / "test" / "000001" / "rgb")
        for name in ("scene_gt.json", "scene_gt_info.json"):
            (root / "test" / "000001" / name).unlink()
        path = root / "detections.json"
        entries = json.loads(path.read_text())
        entries[CRAYONS]["bbox"] = [5, 400, 40, 40]
        path.write_text(json.dumps(entries))
        return explain(root)
