# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.networks.config import NetworkConfig, NetworkKind
from physim_drake.detection.networks.factory import make_network
from physim_drake.detection.networks.weights import (
    describe,
    load_weights,
    mix_weights,
    save_weights,
    start_from,
)
from physim_drake.errors import InputError
from tests.detection.scenes import CLASSES, draw_image, tiny


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file of weights."""
    torch.manual_seed(3)
    network = make_network(tiny(), len(CLASSES))
    path = tmp_path / "detector.safetensors"
    save_weights(path, network.state_dict(), tiny(), CLASSES)
    return path


@pytest.mark.parametrize("kind", list(NetworkKind))
def test_weights_can_be_read_back(tmp_path: Path, kind: NetworkKind):
    torch.manual_seed(3)
    network = make_network(tiny(kind), len(CLASSES))
    path = tmp_path / "weights"
    save_weights(path, network.state_dict(), tiny(kind), CLASSES)
    weights = load_weights(path)
    assert weights.classes == CLASSES
    assert weights.network.config == tiny(kind)
    assert not weights.network.training
    for name, value in network.state_dict().items():
        half = value.to(torch.float16).float()
        torch.testing.assert_close(weights.network.state_dict()[name], half)


def test_a_detector_read_back_detects_the_same(path: Path):
    first = NetworkDetector.load(path, threads=1)
    second = NetworkDetector.load(path, threads=1)
    color = draw_image(0).color
    boxes = [d.box.tolist() for d in first.detect(color, least_score=0.0)]
    assert boxes == [d.box.tolist() for d in second.detect(color, least_score=0.0)]


def test_the_number_of_threads_is_given_back(path: Path):
    torch.set_num_threads(2)
    NetworkDetector.load(path, threads=1).detect(draw_image(0).color)
    assert torch.get_num_threads() == 2


def test_a_missing_file(tmp_path: Path):
    with pytest.raises(InputError, match="cannot be read: No such file"):
        load_weights(tmp_path / "none")


@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.999])
def test_a_file_cut_short(path: Path, share: float):
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(InputError, match="is damaged or not a safetensors file"):
        load_weights(path)


@pytest.mark.parametrize("legacy", [False, True])
def test_a_pickle_is_not_loaded(tmp_path: Path, legacy: bool):
    class Trap:
        """Leaves a trace if it is unpickled."""

        def __reduce__(self) -> tuple[object, tuple[Path]]:
            return Path.touch, (tmp_path / "sprung",)

    path = tmp_path / "weights.pth"
    torch.save({"x": Trap()}, path, _use_new_zipfile_serialization=not legacy)
    with pytest.raises(InputError, match="is a pickle, and pickles are never loaded"):
        load_weights(path)
    assert not (tmp_path / "sprung").exists()


def test_weights_of_something_else(tmp_path: Path):
    path = tmp_path / "other.safetensors"
    save_file({"x": torch.zeros(2)}, path)
    with pytest.raises(InputError, match="holds no network of physim-drake"):
        load_weights(path)


def rewrite(path: Path, **changes: str) -> None:
    """The same tensors with other metadata."""
    state = make_network(tiny(), len(CLASSES)).state_dict()
    save_file(
        {k: v.contiguous() for k, v in state.items()},
        path,
        describe(tiny(), CLASSES) | changes,
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": "9"}, "is '9', this program reads '1'"),
        ({"network": "{"}, "metadata: cannot be used"),
        ({"network": "[1]"}, "metadata: cannot be used"),
        ({"network": json.dumps(tiny().as_dict() | {"channels": 5})}, "channels is 5"),
        ({"network": json.dumps(tiny().as_dict() | {"odd": 5})}, "unknown: odd"),
        ({"network": json.dumps(tiny().as_dict() | {"kind": "yolo"})}, "yolo"),
        (
            {"network": json.dumps(tiny().as_dict() | {"image_size": 10**9})},
            "out of range",
        ),
        ({"classes": "[]"}, "0 classes"),
        ({"classes": '[{"object_id": "1", "name": "a"}]'}, "is not a class"),
        ({"classes": '[{"object_id": 1, "name": "a"}]'}, "not \\("),
        (
            {"network": json.dumps(tiny().as_dict() | {"pyramid_channels": 32})},
            "not \\(",
        ),
    ],
)
def test_metadata_that_cannot_be(path: Path, changes: dict[str, str], message: str):
    rewrite(path, **changes)
    with pytest.raises(InputError, match=message) as error:
        load_weights(path)
    assert "\n" not in str(error.value)


def test_weights_that_are_no_numbers(path: Path):
    state = make_network(tiny(), len(CLASSES)).state_dict()
    state["box_head.shift.bias"][0] = torch.nan
    save_weights(path, state, tiny(), CLASSES)
    with pytest.raises(InputError, match=r"box_head.shift.bias: holds NaN"):
        load_weights(path)


def test_a_folder_that_does_not_exist(tmp_path: Path):
    with pytest.raises(InputError, match="cannot be written"):
        save_weights(tmp_path / "none" / "w", {}, tiny(), CLASSES)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({2: "", 7: ""}, "object 7 of lab is not among 2, 5"),
        ({2: "blue square"}, "object 2 of lab is blue square, here it is red square"),
    ],
)
def test_other_objects(path: Path, names: dict[int, str], message: str):
    detector = NetworkDetector.load(path)
    with pytest.raises(InputError, match="are weights for other objects") as error:
        detector.check_objects(names, "lab")
    assert message in str(error.value)


def test_the_same_objects(path: Path):
    NetworkDetector.load(path).check_objects({2: "red square", 5: ""}, "lab")


def test_configurations_are_read_back():
    config = NetworkConfig(kind=NetworkKind.FCN, widths=(1, 2, 3, 4))
    assert NetworkConfig.from_dict(json.loads(json.dumps(config.as_dict()))) == config


def test_what_fits_is_taken_from_weights_of_other_objects(path: Path):
    torch.manual_seed(4)
    network = make_network(tiny(), len(CLASSES) + 1)
    before = {k: v.clone() for k, v in network.state_dict().items()}
    start_from(network, path)
    other = load_weights(path).network.state_dict()
    for name, value in network.state_dict().items():
        fits = value.shape == other[name].shape
        assert torch.equal(value, (other if fits else before)[name])


def test_a_network_starts_from_one_of_another_kind(path: Path):
    network = make_network(tiny(NetworkKind.FCN), len(CLASSES))
    start_from(network, path)
    other = load_weights(path).network.state_dict()
    assert all(torch.equal(v, other[k]) for k, v in network.state_dict().items())


def test_a_mixture_lies_between_its_parts():
    one = {"w": torch.tensor([0.0, 1.0]), "steps": torch.tensor(7)}
    other = {"w": torch.tensor([4.0, 1.0], dtype=torch.float16), "steps": one["steps"]}
    mixed = mix_weights(one, other, 0.25)
    assert mixed["w"].tolist() == [1.0, 1.0]
    assert mixed["steps"] == 7


def test_another_backbone_is_no_start(path: Path):
    network = make_network(replace(tiny(), pyramid_channels=40), len(CLASSES))
    with pytest.raises(InputError, match="are weights of another backbone"):
        start_from(network, path)
