# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from physim_drake.detection.training.augmentation import AugmentationConfig, Augmenter
from physim_drake.detection.training.packed_images import TrainingImages
from physim_drake.detection.training.photometry import PhotometryConfig, take_photo
from tests.detection.scenes import COLORS, HEIGHT, LABELS, WIDTH, draw_image
from tests.detection.training.test_trainer import write_images

QUIET = PhotometryConfig(0.0, 0.0, 0.0, 0.0, (1.0, 1.0), 0.0, 0.0, 2.2, 0.0, 0.0)
WILD = AugmentationConfig(paste=1.0, background=0.5, occluder=0.5, backgrounds=5)
STILL = AugmentationConfig(
    zoom=(1.0, 1.0),
    max_shift=0.0,
    max_turn=0.0,
    background=0.0,
    backgrounds=5,
    paste=0.0,
    occluder=0.0,
    photometry=replace(QUIET, compress=0.0),
)


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> TrainingImages:
    folder = tmp_path_factory.mktemp("images")
    return write_images(folder, [draw_image(k, depth=True) for k in range(6)])


def augmenter(images: TrainingImages, config: AugmentationConfig) -> Augmenter:
    return Augmenter(images, LABELS, (HEIGHT, WIDTH), config)


def test_nothing_changes_where_nothing_is_asked_for(images: TrainingImages):
    sample = augmenter(images, STILL).draw(np.random.default_rng(0))
    index = int(np.random.default_rng(0).integers(6))
    expected = images[index]
    color = sample.image[:3].numpy().transpose(1, 2, 0) * 255
    np.testing.assert_allclose(color, expected.color, atol=1.0)
    counts = [int(m.sum()) for m in sample.target["masks"]]
    assert counts == [int((expected.labels == k).sum()) for k in (1, 2)]


def test_calm_changes_are_smaller(images: TrainingImages):
    """Measured by how much of the colours of an object is still there."""
    still = augmenter(images, STILL)
    both = augmenter(images, AugmentationConfig(backgrounds=5))

    def difference(seed: int, calm: bool) -> float:
        plain = still.draw(np.random.default_rng(seed)).image[:3]
        changed = both.draw(np.random.default_rng(seed), calm=calm).image[:3]
        return float((changed - plain).abs().mean())

    wild = np.mean([difference(seed, False) for seed in range(40)])
    assert np.mean([difference(seed, True) for seed in range(40)]) < 0.7 * wild


def test_no_changes_are_calm_ones_too(images: TrainingImages):
    one, other = (
        augmenter(images, STILL).draw(np.random.default_rng(0), calm=calm)
        for calm in (True, False)
    )
    assert torch.equal(one.image, other.image)


@settings(max_examples=40)
@given(seed=st.integers(0, 300))
def test_boxes_and_masks_belong_together(images: TrainingImages, seed: int):
    sample = augmenter(images, WILD).draw(np.random.default_rng(seed))
    assert sample.image.shape == (4, HEIGHT, WIDTH)
    assert sample.image.dtype == torch.float32
    assert sample.image[:3].min() >= 0
    assert sample.image[:3].max() <= 1
    target = sample.target
    assert len(target["boxes"]) == len(target["labels"]) == len(target["masks"])
    for box, mask in zip(target["boxes"].int().tolist(), target["masks"], strict=True):
        left, top, right, bottom = box
        assert mask[top:bottom, left:right].sum() == mask.sum() >= 40
        assert mask[top].any()
        assert mask[bottom - 1].any()
        assert mask[:, left].any()
        assert mask[:, right - 1].any()


@settings(max_examples=40)
@given(seed=st.integers(0, 300))
def test_labels_follow_the_objects(images: TrainingImages, seed: int):
    """Under every motion and paste the red square is labelled as the red square."""
    config = replace(WILD, occluder=0.0, photometry=replace(QUIET, compress=0.0))
    sample = augmenter(images, config).draw(np.random.default_rng(seed))
    color = sample.image[:3].numpy().transpose(1, 2, 0) * 255
    names = {label: object_id for object_id, label in LABELS.items()}
    masks = sample.target["masks"].numpy()
    for label, mask in zip(sample.target["labels"].tolist(), masks, strict=True):
        if mask.sum() > 150:
            mean = np.median(color[mask], axis=0)
            errors = {i: np.abs(mean - np.array(COLORS[i])).sum() for i in COLORS}
            assert min(errors, key=lambda i: errors[i]) == names[label]


def test_the_same_seed_draws_the_same(images: TrainingImages):
    first, second = (
        augmenter(images, WILD).draw(np.random.default_rng(7)) for _ in range(2)
    )
    torch.testing.assert_close(first.image, second.image, rtol=0, atol=0)
    torch.testing.assert_close(first.target["boxes"], second.target["boxes"])


def test_images_are_never_mirrored(images: TrainingImages):
    """A turn keeps its sense: corners stay in order."""
    from physim_drake.detection.training.augmentation import _motion

    rng = np.random.default_rng(0)
    for _ in range(50):
        matrix = _motion(
            rng.uniform(0, 9, 2),
            rng.uniform(0, 9, 2),
            rng.uniform(0.3, 3.0),
            rng.uniform(-7.0, 7.0),
        )
        assert np.linalg.det(matrix[:, :2]) > 0


def test_pasted_objects_are_added(images: TrainingImages):
    config = replace(STILL, paste=1.0)
    counts = [
        len(augmenter(images, config).draw(np.random.default_rng(k)).target["labels"])
        for k in range(8)
    ]
    assert max(counts) > 2


@settings(max_examples=40)
@given(seed=st.integers(0, 300))
def test_photos_stay_in_range(seed: int):
    rng = np.random.default_rng(seed)
    photo = take_photo(draw_image(seed).color, PhotometryConfig(), rng)
    assert photo.shape == (HEIGHT, WIDTH, 3)
    assert photo.min() >= 0
    assert photo.max() <= 255


def test_a_perfect_camera_changes_nothing():
    color = draw_image(0).color
    photo = take_photo(color, replace(QUIET, compress=0.0), np.random.default_rng(0))
    np.testing.assert_allclose(photo, color, atol=0.01)
