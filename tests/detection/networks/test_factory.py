# SPDX-License-Identifier: MIT
from __future__ import annotations

from typing import cast

import numpy as np
import pytest
import torch

from physim_drake.detection.average_precision import average_precision
from physim_drake.detection.detector import NetworkDetector
from physim_drake.detection.networks.backbones import FeaturePyramid
from physim_drake.detection.networks.config import (
    BackboneName,
    NetworkConfig,
    NetworkKind,
)
from physim_drake.detection.networks.factory import (
    Network,
    count_weights,
    make_network,
    segmenter,
)
from physim_drake.detection.networks.faster_rcnn import paste_masks
from physim_drake.errors import InputError
from tests.detection.scenes import (
    CLASSES,
    HEIGHT,
    WIDTH,
    draw_image,
    sample_of,
    tiny,
    truth_of,
)

KINDS = list(NetworkKind)
Losses = dict[str, torch.Tensor]


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


def learn(network: Network, images: int, steps: int, rate: float = 3e-3) -> list[float]:
    """Trains on a few images and returns the sums of the losses."""
    samples = [sample_of(draw_image(k)) for k in range(images)]
    optimizer = torch.optim.AdamW(network.parameters(), rate)
    sums = []
    network.train()
    for step in range(steps):
        for group in optimizer.param_groups:
            group["lr"] = rate * min(1.0, (step + 1) / 10, 3 * (steps - step) / steps)
        losses = cast(
            Losses,
            network([s.image for s in samples], [s.target for s in samples]),
        )
        total = torch.stack(list(losses.values())).sum()
        optimizer.zero_grad()
        total.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimizer.step()
        sums.append(total.item())
    return sums


@pytest.mark.parametrize(("kind", "steps"), [("faster-rcnn", 70), ("fcn", 40)])
def test_eight_images_are_learnt(kind: str, steps: int):
    torch.manual_seed(1)
    network = make_network(tiny(NetworkKind(kind)), len(CLASSES))
    losses = learn(network, 8, steps)
    assert losses[-1] < 0.4 * losses[0]
    detector = NetworkDetector(network, CLASSES)
    images = [draw_image(k) for k in range(8)]
    found = [detector.detect(image.color) for image in images]
    result = average_precision(found, [truth_of(image) for image in images])
    assert result.box_50 > 0.9
    assert result.mask_50 > 0.9


@pytest.mark.parametrize("kind", KINDS)
def test_losses_are_those_of_torchvision_by_name_and_shape(kind: NetworkKind):
    network = make_network(tiny(kind), len(CLASSES)).train()
    sample = sample_of(draw_image(0))
    losses = cast(Losses, network([sample.image], [sample.target]))
    assert all(loss.ndim == 0 and loss.isfinite() for loss in losses.values())
    if kind is NetworkKind.FASTER_RCNN:
        assert set(losses) - {"loss_pixels"} == {
            "loss_objectness",
            "loss_rpn_box",
            "loss_classifier",
            "loss_box",
            "loss_mask",
        }


def test_a_trained_detector_segments_too():
    """What tells the class of every pixel learns together with the rest."""
    torch.manual_seed(1)
    network = make_network(tiny(), len(CLASSES))
    learn(network, 8, 70)
    detector = NetworkDetector(segmenter(network), CLASSES)
    images = [draw_image(k) for k in range(8)]
    found = [detector.detect(image.color) for image in images]
    result = average_precision(found, [truth_of(image) for image in images])
    assert result.mask_50 > 0.8


@pytest.mark.parametrize("kind", KINDS)
def test_images_without_objects_can_be_learnt_from(kind: NetworkKind):
    network = make_network(tiny(kind), len(CLASSES)).train()
    target = {
        "boxes": torch.zeros(0, 4),
        "labels": torch.zeros(0, dtype=torch.int64),
        "masks": torch.zeros(0, HEIGHT, WIDTH),
    }
    image = torch.rand(3, HEIGHT, WIDTH)
    losses = cast(Losses, network([image], [target]))
    total = torch.stack(list(losses.values())).sum()
    total.backward()  # type: ignore[no-untyped-call]
    assert total.isfinite()


@pytest.mark.parametrize("kind", KINDS)
def test_what_detections_look_like(kind: NetworkKind):
    """Untrained, at two sizes, with scores low enough that something is found."""
    torch.manual_seed(0)
    network = make_network(tiny(kind), len(CLASSES)).eval()
    if kind is NetworkKind.FASTER_RCNN:
        network.least_score = 0.0
    shapes = [(120, 160), (60, 30)]
    with torch.inference_mode():
        results = network([torch.rand(3, *shape) for shape in shapes])
    for result, shape in zip(cast(list[Losses], results), shapes, strict=True):
        count = len(result["boxes"])
        assert result["boxes"].shape == (count, 4)
        assert result["masks"].shape == (count, 1, *shape)
        assert ((result["masks"] >= 0) & (result["masks"] <= 1)).all()
        assert ((result["labels"] >= 1) & (result["labels"] <= 2)).all()
        assert (result["scores"].diff() <= 0).all()
        limit = torch.tensor([shape[1], shape[0], shape[1], shape[0]])
        assert ((result["boxes"] >= 0) & (result["boxes"] <= limit + 1e-3)).all()


def test_training_needs_targets():
    network = make_network(tiny(), len(CLASSES)).train()
    with pytest.raises(ValueError, match="targets"):
        network([torch.rand(3, HEIGHT, WIDTH)])


def test_images_of_a_batch_do_not_mix():
    """Each is detected as it is alone, whatever stands beside it."""
    torch.manual_seed(0)
    network = make_network(tiny(), len(CLASSES)).eval()
    network.least_score = 0.0
    small, large = torch.rand(3, 64, WIDTH), torch.rand(3, 96, WIDTH)
    with torch.inference_mode():
        alone = cast(list[Losses], network([large]))[0]
        beside = cast(list[Losses], network([small, large]))[1]
    torch.testing.assert_close(alone["scores"], beside["scores"], atol=1e-4, rtol=1e-3)


def test_depth_is_taken_as_a_fourth_channel():
    torch.manual_seed(0)
    network = make_network(tiny(channels=4), len(CLASSES))
    sample = sample_of(draw_image(3, depth=True))
    assert sample.image.shape[0] == 4
    assert network.train()([sample.image], [sample.target])
    detector = NetworkDetector(network, CLASSES, channels=4)
    color = draw_image(3).color
    with pytest.raises(InputError, match="has no depth"):
        detector.detect(color)
    assert isinstance(
        detector.detect(color, np.ones((HEIGHT, WIDTH), np.float32)), tuple
    )


def test_images_of_other_channels_are_refused():
    network = make_network(tiny(), len(CLASSES)).eval()
    with pytest.raises(InputError, match="takes 3 channels"):
        network([torch.rand(4, HEIGHT, WIDTH)])


@pytest.mark.parametrize("backbone", list(BackboneName))
def test_pyramids_have_four_levels(backbone: BackboneName):
    config = NetworkConfig(
        backbone=backbone, widths=(16, 16, 16, 16), pyramid_channels=8
    )
    with torch.inference_mode():
        maps = FeaturePyramid(config)(torch.rand(1, 3, 64, 96))
    assert [tuple(m.shape) for m in maps] == [
        (1, 8, 64 // s, 96 // s) for s in (4, 8, 16, 32)
    ]


def test_the_shipped_size_of_network_fits_its_file():
    """25 MB in half precision."""
    assert 2 * count_weights(make_network(NetworkConfig(), 11)) < 25e6


def test_masks_are_pasted_into_their_boxes():
    masks = torch.tensor([[[0.0, 1.0], [0.0, 1.0]]])
    image = paste_masks(masks, torch.tensor([[2.0, 1.0, 6.0, 5.0]]), 8, 10)
    assert image.shape == (1, 1, 8, 10)
    assert image[0, 0, 1:5, 2:6].sum() == image.sum()
    assert (image[0, 0, 1:5, 5] == 1).all()
    assert (image[0, 0, 1:5, 2] == 0).all()


def test_boxes_at_the_edge_are_pasted_too():
    box = torch.tensor([[-4.0, -4.0, 0.4, 0.4], [9.8, 7.8, 30.0, 30.0]])
    assert paste_masks(torch.ones(2, 4, 4), box, 8, 10).shape == (2, 1, 8, 10)
