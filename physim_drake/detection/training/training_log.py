# SPDX-License-Identifier: MIT
"""The log of a training run: settings, losses and tests, as JSON and a plot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from physim_drake.detection.average_precision import AveragePrecision
from physim_drake.errors import InputError
from physim_drake.storage.files import write_atomically
from physim_drake.storage.json_nodes import read_json

LOG_FILE, CURVES_FILE = "training.json", "training.png"


def check_settings(path: Path, earlier: Any, settings: dict[str, Any]) -> None:
    """Requires that a run can be resumed with these settings.

    Args:
        path: file with the settings of the earlier run.
        earlier: settings of the earlier run.
        settings: settings of this run.

    Raises:
        InputError: if the settings differ.
    """
    if not isinstance(earlier, dict):
        raise InputError(path, "does not hold the settings of a run", "remove it")
    for key in sorted(set(settings) | set(earlier)):
        if settings.get(key) != earlier.get(key):
            raise InputError(
                path,
                f"is {earlier.get(key)}, now {settings.get(key)}",
                "resume with the settings of the earlier run",
                key,
            )


class TrainingLog:
    """The record of a run in a folder.

    Args:
        folder: folder of the run. A log that is already there is continued.
        settings: plain values that the run depends on.

    Raises:
        InputError: if the folder's log belongs to a run with other settings.

    Attributes:
        settings: settings of the run, as read back from JSON.
        losses: an entry every few steps.
        tests: an entry per test.
        seconds: time of training so far.
    """

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self._folder = folder
        self.settings: dict[str, Any] = json.loads(json.dumps(settings))
        self.losses: list[dict[str, Any]] = []
        self.tests: list[dict[str, Any]] = []
        self.seconds = 0.0
        path = folder / LOG_FILE
        if path.exists():
            earlier = read_json(path)
            check_settings(path, earlier["settings"].value, self.settings)
            try:
                self.losses = [dict(e) for e in earlier["losses"].value]
                self.tests = [dict(e) for e in earlier["tests"].value]
                for entry in (*self.losses, *self.tests):
                    float(entry["step"])
                for entry in self.losses:
                    float(entry["seconds"])
            except (KeyError, TypeError, ValueError):
                raise InputError(
                    path, "is not the log of a training run", "remove it"
                ) from None

    def cut(self, step: int) -> None:
        """Forgets what came after a step, from which a run goes on."""
        self.losses = [e for e in self.losses if e["step"] <= step]
        self.tests = [e for e in self.tests if e["step"] <= step]
        self.seconds = self.losses[-1]["seconds"] if self.losses else 0.0

    def add_losses(self, step: int, rate: float, losses: dict[str, float]) -> None:
        """Notes the mean losses of the last few steps."""
        self.losses.append(
            {"step": step, "seconds": self.seconds, "learning_rate": rate, **losses}
        )

    def add_test(self, step: int, result: AveragePrecision, images: int) -> None:
        """Notes a test on so many images."""
        self.tests.append({"step": step, "images": images, **result.as_dict()})

    def write(self) -> None:
        """Writes the log and draws its curves.

        Raises:
            InputError: if a file cannot be written.
        """
        with write_atomically(self._folder / LOG_FILE) as file:
            json.dump(
                {
                    "settings": self.settings,
                    "losses": self.losses,
                    "tests": self.tests,
                },
                file,
                indent=1,
            )
            file.write("\n")
        self._draw(self._folder / CURVES_FILE)

    def _draw(self, path: Path) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(10, 4), layout="constrained")
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2)
        names = [k for k in (self.losses or [{}])[-1] if k.startswith("loss_")]
        for name in names:
            points = [(e["step"], e[name]) for e in self.losses if name in e]
            label = name.removeprefix("loss_").replace("_", " ")
            left.plot(*zip(*points, strict=True), label=label, linewidth=1)
        left.set(xlabel="step", ylabel="loss", yscale="log")
        for name, label in (
            ("box_50", "boxes, overlap 0.5"),
            ("box", "boxes, 0.5 to 0.95"),
            ("mask_50", "masks, overlap 0.5"),
            ("mask", "masks, 0.5 to 0.95"),
        ):
            points = [(e["step"], e[name]) for e in self.tests]
            if points:
                right.plot(*zip(*points, strict=True), "o-", label=label, linewidth=1)
        right.set(xlabel="step", ylabel="mean average precision", ylim=(0, 1))
        for axes, drawn in ((left, names), (right, self.tests)):
            axes.grid(alpha=0.3)
            if drawn:
                axes.legend(fontsize="small")
        with write_atomically(path, "wb") as file:
            figure.savefig(file, format="png", dpi=110)
