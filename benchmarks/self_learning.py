# SPDX-License-Identifier: MIT
"""What self-learning gains: python benchmarks/self_learning.py OUT [--weights FILE].

Under lights that the first training never saw, the robot looks at scenes and labels
what its detector missed. The detector trains on from its weights with these images and
as many of the old kind. It is evaluated before and after, on other scenes under the new
lights, whose labels are true, and on generated images of the old kind, to see what it
forgot. With --control it is also trained as long with old images alone.

Writes OUT/self_learning.json. A run that was cut off goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from physim_drake.datasets.bop import BopDataset
from physim_drake.detection.accuracy import evaluate_detector
from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.networks.devices import (
    DeviceName,
    choose_device,
    has_fast_bfloat16,
)
from physim_drake.detection.networks.weights import load_weights
from physim_drake.detection.training.detector_training import (
    WEIGHTS_FILE,
    DetectorTrainingJob,
    TrainDetectorConfig,
    train_detector,
)
from physim_drake.detection.training.scene_sets import (
    SceneSetConfig,
    generate_scene_set,
)
from physim_drake.detection.training.trainer import TrainingConfig
from physim_drake.models import APC11, DETECTOR
from physim_drake.objects.model import ObjectLibrary
from physim_drake.observation.detection_selection import ChoiceConfig
from physim_drake.picking.look_postures import LookingConditions
from physim_drake.picking.scenario import ObjectsConfig, PickScenario
from physim_drake.self_learning.exploration import (
    LEARNING_FILE,
    ExplorationConfig,
    Explorer,
    explore_scenes,
    write_judged_scenes,
)
from physim_drake.storage.typed_yaml import load_typed_yaml
from physim_drake.systems.detector import (
    DetectionAlgorithm,
    OracleDetector,
    TrainedDetector,
)

DIM = Path(__file__).parents[1] / "examples" / "lighting" / "dim.yaml"
_OTHER_SCENES = 1_000_003  # added to the seed, for the test set


def main() -> None:
    """Runs what is missing, and prints the table."""
    args = _arguments()
    logging.getLogger("drake").setLevel(logging.ERROR)
    args.out.mkdir(parents=True, exist_ok=True)
    seconds: dict[str, float] = {}
    tell = _Clock(seconds)
    _once(args.out / "test", lambda folder: _make_test(args, folder))
    tell("test set")
    _once(args.out / "learnt", lambda folder: _explore(args, folder))
    learnt = json.loads((args.out / "learnt" / LEARNING_FILE).read_text())
    tell("looking and labelling")
    if not learnt["images"]:
        sys.exit("the views agree on nothing: there is nothing to learn from")
    old = args.data
    if old is None:
        config = SceneSetConfig(args.old_scenes, seed=args.seed)
        library = ObjectLibrary.load(APC11)
        old = generate_scene_set(args.out, library, config, args.workers)
    tell("images of the old kind")
    trained = {"before": args.weights}
    both = (old, args.out / "learnt")
    trained["after"] = _train(args, "training", both, args.old_test_images)
    if args.control:
        trained["control"] = _train(args, "control", (old,), 2)
    tell("training")
    tests = {"new": args.out / "test", "old": args.out / "training" / "test"}
    result = {
        "settings": {k: str(v) for k, v in vars(args).items()},
        "learnt": learnt,
        "judged": {
            name: {kind: _judge(weights, test) for kind, test in tests.items()}
            for name, weights in trained.items()
        },
    }
    tell("judging")
    result["seconds"] = seconds
    path = args.out / "self_learning.json"
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    _print(result)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="folder of all that is made")
    parser.add_argument("--weights", type=Path, default=DETECTOR)
    parser.add_argument("--conditions", type=Path, default=DIM)
    parser.add_argument("--data", type=Path, help="old images, made if not given")
    parser.add_argument("--old-scenes", type=int, default=40, help="of 8 images each")
    parser.add_argument("--old-test-images", type=int, default=40)
    parser.add_argument("--test-scenes", type=int, default=15)
    parser.add_argument("--scenes", type=int, default=40, help="to learn from")
    parser.add_argument("--views", type=int, default=5, help="of a scene")
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--learning-rate", type=float, default=3e-4)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--control", action="store_true", help="old images alone, too")
    parser.add_argument(
        "--oracle", action="store_true", help="look with a detector that knows all"
    )
    return parser.parse_args()


def _once(folder: Path, make: Callable[[Path], None]) -> None:
    """Makes a folder, unless it is there, whole or not at all."""
    if folder.exists():
        return
    scratch = folder.with_name(f"{folder.name}.{os.getpid()}.tmp")
    make(scratch)
    scratch.rename(folder)


def _explorer(args: argparse.Namespace, seed: int) -> Explorer:
    scenario = PickScenario(objects=ObjectsConfig(str(APC11)))
    conditions = load_typed_yaml(args.conditions, LookingConditions)
    config = ExplorationConfig(args.views, args.workers, seed)
    return Explorer(scenario, conditions, config)


def _make_test(args: argparse.Namespace, folder: Path) -> None:
    with _explorer(args, args.seed + _OTHER_SCENES) as explorer:
        write_judged_scenes(explorer, folder, args.test_scenes)


def _explore(args: argparse.Namespace, folder: Path) -> None:
    with _explorer(args, args.seed) as explorer:
        detector: DetectionAlgorithm = (
            OracleDetector(explorer.cell.instances)
            if args.oracle
            else TrainedDetector(
                NetworkDetector.load(args.weights),
                dict.fromkeys(explorer.library, 1),
                ChoiceConfig(least_score=0.3),
            )
        )
        explore_scenes(
            explorer,
            detector,
            folder,
            args.scenes,
            lambda number, scene: print(
                f"scene {number + 1} of {args.scenes}: {len(scene.objects)} objects "
                f"certain, {scene.labels} labels, {scene.missed} of them missed",
                file=sys.stderr,
                flush=True,
            ),
        )


def _train(
    args: argparse.Namespace, name: str, data: tuple[Path, ...], test_images: int
) -> Path:
    """Trains on from the weights and returns the new ones."""
    device, out = choose_device(DeviceName.AUTO), args.out / name
    config = TrainDetectorConfig(
        SceneSetConfig(test_images=test_images, seed=args.seed),
        load_weights(args.weights).network.config,
        TrainingConfig(
            steps=args.steps,
            batch=args.batch,
            learning_rate=args.learning_rate,
            warmup=max(args.steps // 15, 1),
            save_every=50,
            test_every=args.steps,
            seed=args.seed,
            bfloat16=has_fast_bfloat16(device),
        ),
        data=data,
        start=args.weights,
    )
    library = ObjectLibrary.load(APC11)
    job = DetectorTrainingJob(
        out, library, config, args.workers, device, resume=True, progress=_report
    )
    train_detector(job)
    return out / WEIGHTS_FILE


def _report(stage: str, done: int, total: int, text: str) -> None:
    if stage in ("steps", "test") or done == total:
        print(f"{stage} {done}/{total} {text}", file=sys.stderr, flush=True)


def _judge(weights: Path, root: Path) -> dict[str, Any]:
    data = BopDataset(root)
    result, _ = evaluate_detector(NetworkDetector.load(weights), data, data.images())
    return {"images": len(data.images()), **result.as_dict()}


class _Clock:
    """Notes the seconds since it was called last."""

    def __init__(self, seconds: dict[str, float]) -> None:
        self._seconds, self._last = seconds, time.monotonic()

    def __call__(self, stage: str) -> None:
        now = time.monotonic()
        self._seconds[stage] = round(now - self._last, 1)
        self._last = now
        print(f"{stage}: {self._seconds[stage]:.0f} s", file=sys.stderr, flush=True)


def _print(result: dict[str, Any]) -> None:
    learnt = result["learnt"]
    print(
        f"{len(learnt['scenes'])} scenes, {learnt['images']} labelled images, "
        f"{learnt['labels']} labels, {learnt['missed']} of objects that were missed"
    )
    columns = ("box_50", "box", "mask_50", "mask", "recall_50")
    print(f"{'':20}" + "".join(f"{c:>11}" for c in columns))
    for kind in ("new", "old"):
        for name, judged in result["judged"].items():
            cells = "".join(f"{judged[kind][c]:11.3f}" for c in columns)
            print(f"{kind + ' images, ' + name:20}" + cells)
    print(", ".join(f"{k} {v:.0f} s" for k, v in result["seconds"].items()))


if __name__ == "__main__":
    main()
