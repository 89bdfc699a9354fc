# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physim_drake.datasets.bop import BopDataset, Target, image_ids
from physim_drake.errors import InputError, PhysimError
from tests.datasets.tiny import (
    CAMERA,
    HEIGHT,
    WIDTH,
    depth_image,
    mangled,
    mask_image,
    write_image,
    write_json,
    write_tiny,
)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return write_tiny(tmp_path / "tiny")


def scene_file(root: Path, name: str) -> Path:
    return root / "test" / "000003" / name


def edit(path: Path, change: Callable[[Any], object]) -> None:
    """Lets `change` alter the value in a JSON file."""
    value = json.loads(path.read_text())
    change(value)
    path.write_text(json.dumps(value))


def test_observation_is_in_metres(root: Path) -> None:
    observation = BopDataset(root).observation(3, 7)
    np.testing.assert_allclose(observation.depth, depth_image() * 1e-4, rtol=1e-6)
    assert observation.intrinsics.fy == 11.0
    assert observation.color is not None
    assert observation.color[0, 0].tolist() == [0, 0, 200]
    # The world's origin lies 0.5 m before the camera, turned by 90 degrees.
    assert observation.X_WC is not None
    np.testing.assert_allclose(observation.X_WC[:3, 3], [0, 0, -0.5], atol=1e-12)
    np.testing.assert_allclose(observation.X_WC[:3, 0], [0, -1, 0], atol=1e-12)


def test_camera_pose_and_color_may_be_missing(root: Path) -> None:
    for name in ("rgb/000000.png", "rgb/000007.png"):
        scene_file(root, name).unlink()
    scene_file(root, "rgb").rmdir()
    edit(scene_file(root, "scene_camera.json"), lambda c: c["0"].pop("cam_R_w2c"))
    edit(scene_file(root, "scene_camera.json"), lambda c: c["0"].pop("cam_t_w2c"))
    observation = BopDataset(root).observation(3, 0)
    assert observation.X_WC is None
    assert observation.color is None


def test_gray_images_become_rgb(root: Path) -> None:
    gray = np.full((HEIGHT, WIDTH), 77, np.uint8)
    scene_file(root, "rgb").rename(scene_file(root, "old"))
    write_image(scene_file(root, "gray/000000.png"), gray)
    color = BopDataset(root).observation(3, 0).color
    assert color is not None
    assert (color == 77).all()


def test_targets_and_images(root: Path) -> None:
    dataset = BopDataset(root)
    targets = dataset.targets()
    assert targets[0] == Target(3, 0, 1, 1)
    assert dataset.images() == list(image_ids(targets)) == [(3, 0), (3, 7)]


def test_targets_come_from_the_ground_truth_without_a_file(root: Path) -> None:
    expected = BopDataset(root).targets()
    (root / "test_targets_bop19.json").unlink()
    assert BopDataset(root).targets() == expected


def test_ground_truth(root: Path) -> None:
    poses = BopDataset(root).ground_truth(3, 0)
    assert [p.object_id for p in poses] == [1, 2]
    assert [p.level for p in poses] == [1, 2]
    assert [p.visible_fraction for p in poses] == [1.0, 0.5]
    np.testing.assert_allclose(poses[0].X_CO[:3, 3], [0.01, 0.02, 0.51])


def test_masks_are_detections_with_their_bounds(root: Path) -> None:
    masks = BopDataset(root).masks(3, 0)
    assert [d.object_id for d in masks] == [1, 2]
    assert masks[0].box.tolist() == [1, 2, 4, 5]
    assert masks[0].mask is not None
    assert (masks[0].mask == (mask_image(1, 4) > 0)).all()


@pytest.mark.parametrize("given_by", ["detections", "targets"])
def test_masks_without_ground_truth(root: Path, given_by: str) -> None:
    scene_file(root, "scene_gt.json").unlink()
    expected = [1, 2]
    if given_by == "detections":
        entries = [
            {"scene_id": 3, "image_id": im_id, "category_id": object_id}
            for im_id, object_id in ((7, 1), (0, 2), (0, 1))
        ]
        write_json(root / "detections.json", entries)
        expected = [2, 1]
    assert [d.object_id for d in BopDataset(root).masks(3, 0)] == expected


def test_empty_masks_are_left_out(root: Path) -> None:
    write_image(scene_file(root, "mask_visib/000000_000000.png"), mask_image(0, 0))
    assert [d.object_id for d in BopDataset(root).masks(3, 0)] == [2]


CAMERA_DEFECTS = {
    "no key": (lambda c: c["0"].pop("cam_K"), 'has no "cam_K"'),
    "no scale": (lambda c: c["0"].pop("depth_scale"), "depth_scale"),
    "few": (lambda c: c["0"].update(cam_K=[1, 2]), "must be a list of 9"),
    "text": (lambda c: c["0"].update(cam_K=["a"] * 9), "9 finite numbers"),
    "skew": (lambda c: c["0"]["cam_K"].__setitem__(1, 3), "skew"),
    "focal": (lambda c: c["0"]["cam_K"].__setitem__(0, -5), "do not fit"),
    "centre": (lambda c: c["0"]["cam_K"].__setitem__(2, 999), "do not fit"),
    "scale": (lambda c: c["0"].update(depth_scale=0), "depth_scale: is 0"),
    "rotation": (lambda c: c["0"].update(cam_R_w2c=[1] * 9), "is not a rotation"),
    "mirror": (
        lambda c: c["0"].update(cam_R_w2c=[1, 0, 0, 0, 1, 0, 0, 0, -1]),
        "is not a rotation",
    ),
    "half": (lambda c: c["0"].pop("cam_t_w2c"), 'has no "cam_t_w2c"'),
    "no image": (lambda c: c.pop("0"), "has no image 0"),
    "id": (lambda c: c.update({"../../etc": CAMERA}), "keys must be ids"),
    "list": (lambda c: c.update({"0": [1]}), "must be an object"),
}


@pytest.mark.parametrize("defect", CAMERA_DEFECTS)
def test_bad_cameras_name_file_and_field(root: Path, defect: str) -> None:
    change, message = CAMERA_DEFECTS[defect]
    edit(scene_file(root, "scene_camera.json"), change)
    with pytest.raises(InputError, match=message) as caught:
        BopDataset(root).observation(3, 0)
    assert "scene_camera.json" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [("{\n  oops", "line 2"), ('{"0": NaN}', "NaN"), ("\xff", "UTF-8"), ("", "line 1")],
)
def test_malformed_json(root: Path, text: str, message: str) -> None:
    scene_file(root, "scene_camera.json").write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match=message):
        BopDataset(root).images()


def test_color_of_another_size_is_named(root: Path) -> None:
    path = scene_file(root, "rgb/000000.png")
    write_image(path, np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(InputError, match=r"rgb/000000\.png: color: has shape"):
        BopDataset(root).observation(3, 0)


def test_mask_of_another_size_is_named(root: Path) -> None:
    write_image(scene_file(root, "mask_visib/000000_000001.png"), mask_image(0, 1).T)
    with pytest.raises(InputError, match=r"000000_000001\.png: is 8 x 12"):
        BopDataset(root).masks(3, 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[0].update(inst_count=0), "inst_count: is 0"),
        (lambda t: t[0].update(obj_id=True), "obj_id: is True"),
        (lambda t: t.append(t[0]), "again"),
        (lambda t: t[1].pop("obj_id"), r'\[1\]: has no "obj_id"'),
    ],
)
def test_bad_targets(root: Path, change: Callable[[Any], Any], message: str) -> None:
    edit(root / "test_targets_bop19.json", change)
    with pytest.raises(InputError, match=message):
        BopDataset(root).targets()


@pytest.mark.parametrize("missing", [{"scene_id": 9}, {"im_id": 5}])
def test_targets_in_images_that_are_missing_are_left_out_with_a_warning(
    root: Path, missing: dict[str, int], caplog: pytest.LogCaptureFixture
) -> None:
    edit(root / "test_targets_bop19.json", lambda t: t[0].update(missing))
    targets = BopDataset(root).targets()
    assert [(t.im_id, t.object_id) for t in targets] == [(0, 2), (7, 1), (7, 2)]
    assert "which is not in" in caplog.text


def test_targets_that_are_all_of_missing_images_are_an_error(root: Path) -> None:
    path = root / "test_targets_bop19.json"
    edit(path, lambda t: [x.update(scene_id=9) for x in t])
    with pytest.raises(InputError, match="image 0 of scene 9, which is not in"):
        BopDataset(root).targets()


def test_hidden_objects_and_those_without_a_model_are_no_targets_by_truth(
    root: Path,
) -> None:
    (root / "test_targets_bop19.json").unlink()
    info = scene_file(root, "scene_gt_info.json")
    edit(info, lambda i: i["7"][0].update(visib_fract=0.02))
    dataset = BopDataset(root)
    assert [(t.im_id, t.object_id) for t in dataset.targets()] == [
        (0, 1),
        (0, 2),
        (7, 2),
    ]
    (root / "models").mkdir()
    (root / "models" / "library.yaml").write_text(
        "objects:\n- {id: 1, name: nut, mesh: a.obj}\n"
    )
    (root / "models" / "a.obj").write_text("")
    assert [(t.im_id, t.object_id) for t in dataset.targets()] == [(0, 1)]


def test_targets_of_some_images_read_no_other_scene(root: Path) -> None:
    (root / "test_targets_bop19.json").unlink()
    broken = root / "test" / "000004" / "scene_camera.json"
    broken.parent.mkdir()
    broken.write_text("{")
    targets = BopDataset(root).targets(images=[(3, 7)])
    assert [(t.im_id, t.object_id) for t in targets] == [(7, 1), (7, 2)]


@pytest.mark.parametrize("split", ["../test", "/etc", "..", "", "a/b"])
def test_a_split_stays_in_the_dataset(root: Path, split: str) -> None:
    with pytest.raises(InputError, match="split"):
        BopDataset(root, split)


def test_missing_folders(root: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match='has no folder "val"'):
        BopDataset(root, "val")
    (tmp_path / "empty" / "test").mkdir(parents=True)
    with pytest.raises(InputError, match="holds no scene"):
        BopDataset(tmp_path / "empty").images()


FILES = [
    "test_targets_bop19.json",
    "levels.json",
    *(
        f"test/000003/{name}"
        for name in (
            "scene_camera.json",
            "scene_gt.json",
            "scene_gt_info.json",
            "depth/000000.png",
            "rgb/000000.png",
            "mask_visib/000000_000000.png",
        )
    ),
]


@pytest.mark.parametrize("name", FILES)
@settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_mangled_files_raise_only_input_errors(
    root: Path, name: str, data: st.DataObject
) -> None:
    path = root / name
    original = path.read_bytes()
    path.write_bytes(data.draw(mangled(original)))
    with suppress(PhysimError):
        dataset = BopDataset(root)
        for image in image_ids(dataset.targets()):
            dataset.observation(*image)
            dataset.masks(*image)
            dataset.ground_truth(*image)
    path.write_bytes(original)


def test_a_skew_of_rounding_is_none(root: Path) -> None:
    path = scene_file(root, "scene_camera.json")
    edit(path, lambda c: c["0"]["cam_K"].__setitem__(1, 1e-13))
    assert BopDataset(root).intrinsics(3, 0).K[0, 1] == 0


def test_rotations_off_by_rounding_are_made_orthonormal_and_told_once(
    root: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rotation = [0, -1.001, 0, 1, 0, 0, 0, 0, 1]
    path = scene_file(root, "scene_camera.json")
    edit(path, lambda c: [c[k].update(cam_R_w2c=rotation) for k in ("0", "7")])
    for im_id in (0, 7):
        X_WC = BopDataset(root).observation(3, im_id).X_WC
        assert X_WC is not None
        np.testing.assert_allclose(X_WC[:3, :3] @ X_WC[:3, :3].T, np.eye(3), atol=1e-9)
    assert caplog.text.count("not quite orthonormal") == 1
