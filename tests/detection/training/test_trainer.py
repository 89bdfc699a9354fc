# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from physim_drake.detection.networks.factory import make_network
from physim_drake.detection.training.augmentation import AugmentationConfig, Augmenter
from physim_drake.detection.training.checkpoints import AveragedWeights, TrainingState
from physim_drake.detection.training.packed_images import LabelledImage, TrainingImages
from physim_drake.detection.training.trainer import Trainer, TrainingConfig
from physim_drake.detection.training.training_log import LOG_FILE, TrainingLog
from physim_drake.errors import InputError
from tests.detection.scenes import CLASSES, HEIGHT, LABELS, WIDTH, draw_image, tiny

CONFIG = TrainingConfig(
    steps=8, batch=2, warmup=2, log_every=2, save_every=3, test_every=4
)
CPU = torch.device("cpu")


def write_images(folder: Path, images: list[LabelledImage]) -> TrainingImages:
    """Packs images as they are."""
    np.save(folder / "color.npy", np.stack([i.color for i in images]))
    np.save(folder / "labels.npy", np.stack([i.labels for i in images]))
    if all(i.depth is not None for i in images):
        depth = np.stack([i.depth for i in images if i.depth is not None])
        np.save(folder / "depth.npy", np.round(depth / 1e-4).astype(np.uint16))
    notes = {"object_ids": [list(i.object_ids) for i in images]}
    (folder / "images.json").write_text(json.dumps(notes))
    return TrainingImages(folder)


class CutOff(Exception):  # noqa: N818
    """Stands for a kill."""


class Run:
    """A training run in a folder, which can be cut off and started again."""

    def __init__(self, folder: Path, config: TrainingConfig = CONFIG) -> None:
        folder.mkdir(exist_ok=True)
        torch.set_num_threads(1)
        images = write_images(folder, [draw_image(k) for k in range(4)])
        torch.manual_seed(config.seed)
        self.log = TrainingLog(folder, {"seed": config.seed, "steps": config.steps})
        self.tested: list[int] = []
        self.saved: list[dict[str, Tensor]] = []
        self.trainer = Trainer(
            make_network(tiny(), len(CLASSES)),
            Augmenter(
                images,
                LABELS,
                (HEIGHT, WIDTH),
                AugmentationConfig(backgrounds=5),
                config.seed,
            ),
            config,
            CPU,
            folder / "state.safetensors",
            self.log,
        )

    def __call__(self, report: Callable[[int], None] = lambda step: None) -> None:
        self.trainer.run(
            lambda weights: self.saved.append(
                {k: v.clone() for k, v in weights.items()}
            ),
            lambda network, step: self.tested.append(step),
            lambda step, losses: report(step),
        )


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> Run:
    run = Run(tmp_path_factory.mktemp("unbroken"))
    run()
    return run


def test_a_run_tests_and_saves(unbroken: Run):
    assert unbroken.tested == [4, 8]
    assert len(unbroken.saved) == 3  # after 3, 6 and 8 steps
    assert [e["step"] for e in unbroken.log.losses] == [2, 4, 6, 8]


@pytest.mark.parametrize("cut", [2, 4, 6])
def test_a_run_cut_off_ends_with_the_same_weights(
    unbroken: Run, tmp_path: Path, cut: int
):
    def stop(step: int) -> None:
        if step == cut:
            raise CutOff

    folder = tmp_path / "run"
    with pytest.raises(CutOff):
        Run(folder)(stop)
    second = Run(folder)
    assert second.trainer.step == cut // 3 * 3 - (3 if cut == 6 else 0)
    second()
    for name, value in unbroken.trainer.network.state_dict().items():
        torch.testing.assert_close(
            second.trainer.network.state_dict()[name], value, rtol=0, atol=0
        )
    for name, value in unbroken.saved[-1].items():
        torch.testing.assert_close(second.saved[-1][name], value, rtol=0, atol=0)
    assert told(second) == told(unbroken)
    assert [e["step"] for e in told(second)] == [2, 4, 6, 8]


def told(run: Run) -> list[dict[str, float]]:
    """The losses in its log, without times."""
    return [{k: v for k, v in e.items() if k != "seconds"} for e in run.log.losses]


def test_a_run_cut_off_between_its_log_and_its_first_state_begins_anew(
    unbroken: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cut_off(*arguments: object) -> None:
        raise CutOff

    folder = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr(TrainingState, "save", cut_off)
        with pytest.raises(CutOff):
            Run(folder)()
    second = Run(folder)
    second()
    assert told(second) == told(unbroken)


def test_a_finished_run_has_nothing_to_do(tmp_path: Path):
    config = replace(CONFIG, steps=3)
    Run(tmp_path / "run", config)()
    again = Run(tmp_path / "run", config)
    again()
    assert again.saved == []


def test_another_seed_gives_other_weights(unbroken: Run, tmp_path: Path):
    other = Run(tmp_path / "run", replace(CONFIG, seed=1))
    other()
    name = "box_head.score.weight"
    difference = other.saved[-1][name] - unbroken.saved[-1][name]
    assert difference.abs().max() > 1e-4


def test_the_state_of_another_run_is_refused(tmp_path: Path):
    Run(tmp_path / "run", replace(CONFIG, steps=3))()
    (tmp_path / "run" / "training.json").unlink()
    with pytest.raises(InputError, match=r"state.safetensors: steps: is 3, now 8"):
        Run(tmp_path / "run")


@pytest.mark.parametrize("content", [b"", b"\x80\x04N.", b"x" * 300])
def test_a_damaged_state_is_refused(tmp_path: Path, content: bytes):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "state.safetensors").write_bytes(content)
    with pytest.raises(InputError, match="remove it to train from the beginning"):
        Run(tmp_path / "run")


def test_a_log_that_is_none(tmp_path: Path):
    (tmp_path / "training.json").write_text(
        '{"settings": {}, "losses": 3, "tests": []}'
    )
    with pytest.raises(InputError, match="is not the log"):
        TrainingLog(tmp_path, {})


def test_the_log_of_another_run_is_refused(tmp_path: Path):
    TrainingLog(tmp_path, {"network": {"channels": 3}}).write()
    with pytest.raises(InputError, match="resume with the settings of the earlier"):
        TrainingLog(tmp_path, {"network": {"channels": 4}})


def test_a_log_without_times_is_refused(tmp_path: Path) -> None:
    log = {"settings": {}, "losses": [{"step": 0}], "tests": []}
    (tmp_path / LOG_FILE).write_text(json.dumps(log))
    with pytest.raises(InputError, match="is not the log of a training run"):
        TrainingLog(tmp_path, {})


def test_curves_are_drawn(unbroken: Run, tmp_path: Path):
    log = TrainingLog(tmp_path, {"a": 1})
    log.losses = unbroken.log.losses
    log.write()
    assert (tmp_path / "training.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "training.json").read_text())["settings"] == {"a": 1}


def test_the_learning_rate_rises_and_falls():
    config = TrainingConfig(steps=100, warmup=10, learning_rate=1.0)
    rates = [config.rate(step) for step in range(100)]
    assert rates[0] == pytest.approx(0.1)
    assert max(rates) == pytest.approx(1.0)
    assert rates.index(max(rates)) in (9, 10)
    assert rates[10:] == sorted(rates[10:], reverse=True)
    assert rates[-1] == pytest.approx(0.01, rel=0.1)


def test_averaged_weights_follow_the_network():
    network = nn.Linear(1, 1, bias=False)
    nn.init.zeros_(network.weight)
    average = AveragedWeights(network, decay=0.5)
    nn.init.ones_(network.weight)
    for step in (100, 101):
        average.update(network, step)
    assert average.values["weight"].item() == pytest.approx(0.75)


def test_a_network_of_another_make_can_be_trained(tmp_path: Path):
    """Anything that is called as torchvision's detectors are."""

    class Other(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.scale = nn.Parameter(torch.ones(1))

        def forward(
            self, images: list[Tensor], targets: list[dict[str, Tensor]]
        ) -> dict[str, Tensor]:
            boxes = torch.cat([t["boxes"] for t in targets])
            return {"loss": (self.scale * boxes.mean() / 100 - 0.3) ** 2}

    run = Run(tmp_path / "run")
    other = Other()
    trainer = Trainer(
        other,
        run.trainer._augmenter,
        CONFIG,
        CPU,
        tmp_path / "other.safetensors",
        TrainingLog(tmp_path, {}),
    )
    trainer.run(lambda weights: None, lambda network, step: None, lambda s, v: None)
    assert other.scale.item() != 1.0
