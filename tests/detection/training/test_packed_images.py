# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from physim_drake.datasets.bop import BopDataset
from physim_drake.detection.training import packed_images as training_images
from physim_drake.detection.training.packed_images import (
    MixedImages,
    TrainingImages,
    label_map,
    pack_images,
)
from physim_drake.errors import InputError
from physim_drake.observation.observation import Detection
from tests.datasets.tiny import CAMERA, HEIGHT, WIDTH, write_tiny
from tests.detection.scenes import square_mask


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return BopDataset(write_tiny(tmp_path / "tiny"))


def test_packed_images_are_those_of_the_dataset(dataset: BopDataset, tmp_path: Path):
    packed = pack_images(dataset, tmp_path / "packed", WIDTH, depth=True)
    assert len(packed) == 2
    assert packed.size == (HEIGHT, WIDTH)
    assert packed.object_ids == {1, 2}
    image = packed[1]
    observation = dataset.observation(3, 7)
    np.testing.assert_array_equal(image.color, observation.color)
    assert image.depth is not None
    np.testing.assert_allclose(image.depth, observation.depth, atol=1e-4)
    for k, truth in enumerate(dataset.masks(3, 7), start=1):
        np.testing.assert_array_equal(image.labels == k, truth.mask)
        assert image.object_ids[k - 1] == truth.object_id


def test_packed_images_are_reduced_but_never_enlarged(
    dataset: BopDataset, tmp_path: Path
):
    small = pack_images(dataset, tmp_path / "small", 6, depth=False)
    assert small.size == (4, 6)
    assert small[0].depth is None
    assert pack_images(dataset, tmp_path / "large", 99, False).size == (HEIGHT, WIDTH)


def test_sets_of_images_count_the_same(dataset: BopDataset, tmp_path: Path):
    """A large set beside a small one does not crowd it out."""
    large = pack_images(dataset, tmp_path / "large", WIDTH, depth=False)
    (dataset.root / "test/000003/scene_camera.json").write_text(
        json.dumps({"7": CAMERA})
    )
    one = BopDataset(dataset.root)
    small = pack_images(one, tmp_path / "small", 6, depth=False)
    mixed = MixedImages([large, small])
    assert (len(large), len(small), len(mixed)) == (2, 1, 4)
    assert mixed.size == large.size
    assert mixed.object_ids == {1, 2}
    shapes = [mixed[n].labels.shape for n in range(len(mixed))]
    assert shapes == [large.size, small.size] * 2
    for n in (0, 1):
        np.testing.assert_array_equal(mixed[2 * n].labels, large[n].labels)


def test_images_are_packed_once(dataset: BopDataset, tmp_path: Path):
    told: list[int] = []
    pack_images(dataset, tmp_path / "packed", 6, False, told.append)
    assert told == [1, 2]
    pack_images(dataset, tmp_path / "packed", 6, False, told.append)
    assert told == [1, 2]


def test_other_images_take_the_place_of_those_packed(
    dataset: BopDataset, tmp_path: Path
):
    folder = tmp_path / "packed"
    pack_images(dataset, folder, 6, depth=True)
    assert pack_images(dataset, folder, WIDTH, depth=True).size == (HEIGHT, WIDTH)
    assert pack_images(dataset, folder, WIDTH, depth=False)[0].depth is None
    other = BopDataset(write_tiny(tmp_path / "other"))
    (other.root / "test/000003/scene_camera.json").write_text(json.dumps({"7": CAMERA}))
    assert len(pack_images(other, folder, WIDTH, depth=False)) == 1


def test_what_is_packed_does_not_depend_on_where_it_stands(tmp_path: Path):
    notes = []
    for name in ("a", "b"):
        own = BopDataset(write_tiny(tmp_path / name / "data"))
        pack_images(own, tmp_path / name / "packed", 6, depth=False)
        notes.append((tmp_path / name / "packed" / "images.json").read_bytes())
    assert notes[0] == notes[1]


def test_an_object_that_is_not_known_leaves_nothing(
    dataset: BopDataset, tmp_path: Path
):
    with pytest.raises(InputError, match="shows object 2, which has no model"):
        pack_images(dataset, tmp_path / "packed", 6, False, known=[1])
    assert [p.name for p in tmp_path.iterdir()] == ["tiny"]
    assert len(pack_images(dataset, tmp_path / "packed", 6, False, known=[1, 2])) == 2


def test_an_image_that_cannot_be_read_leaves_nothing(
    dataset: BopDataset, tmp_path: Path
):
    (dataset.root / "test/000003/rgb/000007.png").write_bytes(b"no image")
    with pytest.raises(InputError, match=r"000007.png"):
        pack_images(dataset, tmp_path / "packed", 6, False)
    assert [p.name for p in tmp_path.iterdir()] == ["tiny"]


def test_packed_images_that_are_damaged_say_what_to_do(
    dataset: BopDataset, tmp_path: Path
):
    folder = tmp_path / "packed"
    pack_images(dataset, folder, 6, False)
    whole = (folder / "labels.npy").read_bytes()
    (folder / "labels.npy").write_bytes(whole[:-1])
    with pytest.raises(InputError, match=r"packed: cannot be used \(.*remove it"):
        TrainingImages(folder)
    (folder / "labels.npy").unlink()
    with pytest.raises(InputError, match=r"packed: cannot be used \(.*labels.npy"):
        TrainingImages(folder)


def test_images_of_two_sizes(dataset: BopDataset, tmp_path: Path):
    folder = dataset.root / "test/000003"
    for name in ("rgb/000007.png", "depth/000007.png"):
        image = cv2.imread(str(folder / name), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(folder / name), image[:6])
    for path in folder.glob("mask_visib/000007_*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path))[:6])
    with pytest.raises(InputError, match="another size than the first"):
        pack_images(dataset, tmp_path / "packed", 6, False)


def test_an_empty_dataset(tmp_path: Path):
    (tmp_path / "none" / "test").mkdir(parents=True)
    with pytest.raises(InputError, match="holds no scene"):
        pack_images(BopDataset(tmp_path / "none"), tmp_path / "packed", 6, False)


def test_a_full_disk(
    dataset: BopDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def fail(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(training_images, "_write", fail)
    with pytest.raises(InputError, match="No space left on device"):
        pack_images(dataset, tmp_path / "packed", 6, False)


def test_objects_in_front_come_last():
    first = Detection(4, np.zeros(4), 1.0, square_mask(0, 0, 10))
    second = Detection(4, np.zeros(4), 1.0, square_mask(5, 5, 10))
    labels = label_map([first, second], square_mask(0, 0, 1).shape)
    assert labels[2, 2] == 1
    assert labels[7, 7] == labels[12, 12] == 2
    assert labels[30, 30] == 0
