# SPDX-License-Identifier: MIT
from __future__ import annotations

import importlib.metadata
import sys
from pathlib import Path

import numpy as np
import pytest

import physim_drake.models
from physim_drake.doctor import probes as installation_probes
from physim_drake.doctor.checks import PROBES, Status
from physim_drake.doctor.probes import (
    PROBE_FUNCTIONS,
    compiled_loops,
    detector_weights,
    extras,
    models,
    packages,
    physics,
    rendering,
    torch_device,
    worker_processes,
)
from physim_drake.errors import InputError
from physim_drake.physics.settling import Settled, Settler
from physim_drake.poses import Array
from physim_drake.rendering.scene import SceneRenderer


def test_every_probe_has_its_function() -> None:
    assert [probe.name for probe in PROBES] == list(PROBE_FUNCTIONS)


@pytest.mark.parametrize(
    "probe",
    [packages, extras, rendering, physics, compiled_loops, models, torch_device],
)
def test_this_installation_passes(probe: installation_probes.ProbeFunction) -> None:
    assert probe().status is not Status.FAIL


def test_missing_and_wrong_packages_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    needed = ["numpy>=999", "nosuchpackage>=1", "drake>=1.0"]
    optional = ["nosuchextra>=2; extra == 'more'"]
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: needed + optional)
    check = packages()
    assert check.status is Status.FAIL
    assert "nosuchpackage is missing" in check.message
    assert f"numpy is {np.__version__}, but >=999 is needed" in check.message
    assert "nosuchextra" not in check.message + check.remedy
    assert "'nosuchpackage>=1'" in check.remedy


def test_an_untested_drake_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation_probes, "TESTED_DRAKE", ("0.1",))
    check = packages()
    assert check.status is Status.WARNING
    assert "drake==0.1" in check.remedy


def test_missing_extras_are_told_and_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ["numpy>=1", "nosuchray>=2; extra == 'ray'", "numpy>=1; extra == 'viz'"]
    asked += ["numpy>=999; extra == 'train'", "nosuchtool; extra == 'dev'"]
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: asked)
    check = extras()
    assert check.status is Status.OK
    assert check.message.startswith("viz; not ray for several machines")
    assert "(nosuchray is missing)" in check.message
    assert f"(numpy is {np.__version__}, but >=999 is needed)" in check.message
    assert check.message.endswith(": pip install 'physim-drake[ray,train]'")
    assert "nosuchtool" not in check.message
    assert packages().status is Status.OK


def test_a_wrong_depth_image_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    def blank(*_: object) -> Array:
        return np.zeros((48, 64), dtype=np.float32)

    monkeypatch.setattr(SceneRenderer, "_depth", blank)
    with pytest.raises(RuntimeError, match=r"rendered at 0\.000 m"):
        rendering()


def test_a_wrong_colour_image_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    def grey(*_: object) -> Array:
        return np.full((48, 64, 3), 128, dtype=np.uint8)

    monkeypatch.setattr(SceneRenderer, "_color", grey)
    with pytest.raises(RuntimeError, match="red box is rendered in RGB 128"):
        rendering()


def test_a_box_that_sinks_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    def sink(self: Settler, X_SO: Array, placed: object) -> Settled:
        return Settled(np.eye(4), at_rest=True, lost=False, time=1.0)

    monkeypatch.setattr(Settler, "settle", sink)
    with pytest.raises(RuntimeError, match=r"ends -50\.0 mm above"):
        physics()


def test_a_worker_that_ends_at_once_is_noticed(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(installation_probes, "_report_in", sys.exit)
    with pytest.raises(RuntimeError, match="ended at once, exit status 1"):
        worker_processes()


@pytest.fixture
def detector(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the weights of a small network would be."""
    path = tmp_path / "detector.safetensors"
    monkeypatch.setattr(physim_drake.models, "DETECTOR", path)
    return path


def write_network(path: Path) -> None:
    """Writes the weights of a small network for two objects."""
    from physim_drake.detection.networks.config import NetworkConfig, NetworkKind
    from physim_drake.detection.networks.factory import ObjectClass, make_network
    from physim_drake.detection.networks.weights import save_weights

    config = NetworkConfig(
        NetworkKind.FCN, widths=(8, 8, 8, 8), depths=(1, 1, 1, 1), pyramid_channels=8
    )
    classes = (ObjectClass(1, "box"), ObjectClass(2, "ball"))
    save_weights(path, make_network(config, 2).state_dict(), config, classes)


def test_absent_weights_are_a_warning(detector: Path) -> None:
    check = detector_weights()
    assert check.status is Status.WARNING
    assert "--detections" in check.remedy


def test_weights_are_read(detector: Path) -> None:
    write_network(detector)
    check = detector_weights()
    assert check.status is Status.OK
    assert check.message.startswith("for 2 objects, 0.")


def test_weights_that_were_cut_off_are_noticed(detector: Path) -> None:
    write_network(detector)
    detector.write_bytes(detector.read_bytes()[:-5])
    with pytest.raises(InputError, match="is damaged"):
        detector_weights()


def test_detectors_may_be_missing(
    detector: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_network(detector)
    monkeypatch.setitem(sys.modules, "torch", None)
    for probe in (torch_device, detector_weights):
        check = probe()
        assert check.status is Status.OK
        assert check.message == "not tried: torch is not installed (extra [train])"
