# SPDX-License-Identifier: MIT
from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pycocotools.coco import COCO
from pydrake.multibody.parsing import (
    LoadModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import MultibodyPlant

from physim_drake.datasets import bop_writer
from physim_drake.datasets.bop import BopDataset, mask_bounds
from physim_drake.datasets.detections import load_detections
from physim_drake.errors import InputError
from physim_drake.objects.model import ObjectLibrary
from physim_drake.poses import transform_points
from physim_drake.scenes.dataset import SceneMaker, generate_dataset
from tests.scenes.conftest import CONFIG, SCENES

PROGRAM = [sys.executable, "-c", "from physim_drake.cli import main; main()"]


def tree(root: Path) -> dict[str, bytes]:
    """Content of every file by its path."""
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


def test_reads_back(dataset: Path, library: ObjectLibrary):
    data = BopDataset(dataset)
    assert data.images() == [(s, i) for s in (1, 2, 3) for i in (0, 1)]
    models = ObjectLibrary.load(data.models)
    for object_id, model in models.items():
        assert model.extents == pytest.approx(library[object_id].extents, abs=1e-6)
        assert len(model.symmetry.discrete) == len(library[object_id].symmetry.discrete)
        assert len(model.symmetry.axes) == len(library[object_id].symmetry.axes)
    for scene_id, im_id in data.images():
        observation = data.observation(scene_id, im_id)
        assert observation.color is not None
        assert observation.color.std() > 5
        poses = data.ground_truth(scene_id, im_id)
        assert len(poses) == 3
        assert max(pose.level or 0 for pose in poses) == scene_id
        fractions = [pose.visible_fraction or 0.0 for pose in poses]
        assert min(fractions) >= CONFIG.view.min_visible
    assert len(data.targets()) == 3 * 2 * SCENES


def test_objects_are_where_the_ground_truth_says(dataset: Path):
    """Measured depth in a visible mask lies on the object's surface."""
    data = BopDataset(dataset)
    models = ObjectLibrary.load(data.models)
    for scene_id, im_id in data.images():
        observation = data.observation(scene_id, im_id)
        points_C = observation.intrinsics.unproject(observation.depth)
        masks = {m.object_id: m.mask for m in data.masks(scene_id, im_id)}
        for pose in data.ground_truth(scene_id, im_id):
            seen = masks[pose.object_id] & (observation.depth > 0)
            surface, _ = models[pose.object_id].surface_sample(4000)
            surface_C = transform_points(pose.X_CO, surface)
            near = np.linalg.norm(
                points_C[seen][::25, None] - surface_C[None], axis=2
            ).min(axis=1)
            assert np.median(near) < 0.004


def test_world_poses_agree_between_views(dataset: Path):
    data = BopDataset(dataset)
    for scene_id in (1, 2, 3):
        worlds = []
        for im_id in (0, 1):
            X_WC = data.observation(scene_id, im_id).X_WC
            assert X_WC is not None
            poses = data.ground_truth(scene_id, im_id)
            worlds.append(np.stack([X_WC @ pose.X_CO for pose in poses]))
        assert worlds[0] == pytest.approx(worlds[1], abs=1e-6)


def test_detections_are_jittered_true_boxes(dataset: Path):
    data = BopDataset(dataset)
    detections = load_detections(dataset / "detections.json", data)
    for image in data.images():
        boxes = {m.object_id: mask_bounds(m.mask) for m in data.masks(*image)}
        for detection in detections[image]:
            true = boxes[detection.object_id]
            size = np.tile(true[2:] - true[:2], 2)
            off = np.abs(detection.box - true) / size
            assert off.max() < 0.061
            assert off.max() > 0


def test_coco_annotations_give_the_visible_masks(dataset: Path):
    data = BopDataset(dataset)
    coco = COCO(str(dataset / "test" / "000002" / "scene_gt_coco.json"))
    masks = data.masks(2, 1)
    annotations = coco.loadAnns(coco.getAnnIds(imgIds=[1]))
    assert [a["category_id"] for a in annotations] == [m.object_id for m in masks]
    for annotation, detection in zip(annotations, masks, strict=True):
        assert np.array_equal(coco.annToMask(annotation), detection.mask)
        assert annotation["area"] == detection.mask.sum()
    names = {c["id"]: c["name"] for c in coco.loadCats(coco.getCatIds())}
    assert names[11] == "rawlings_baseball"


def test_directives_open_in_a_plant(dataset: Path):
    data = BopDataset(dataset)
    plant = MultibodyPlant(time_step=0.001)
    parser = Parser(plant)
    parser.package_map().AddPackageXml(str(dataset / "package.xml"))
    path = dataset / "test" / "000003" / "scene.dmd.yaml"
    ProcessModelDirectives(LoadModelDirectives(str(path)), plant, parser=parser)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    X_WC = data.observation(3, 0).X_WC
    for n, pose in enumerate(data.ground_truth(3, 0)):
        instance = plant.GetModelInstanceByName(f"object_{n}")
        body = plant.GetBodyByName("body", instance)
        X_WO = plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4()
        assert pytest.approx(X_WC @ pose.X_CO, abs=1e-6) == X_WO


def test_ground_truth_as_results_has_no_error(
    dataset: Path, shared: Path, tmp_path: Path
):
    rows = ["scene_id,im_id,obj_id,score,R,t,time"]
    for scene_id in (1, 2, 3):
        path = dataset / "test" / f"{scene_id:06d}" / "scene_gt.json"
        for im_id, entries in json.loads(path.read_text()).items():
            for entry in entries:
                R = " ".join(map(str, entry["cam_R_m2c"]))
                t = " ".join(map(str, entry["cam_t_m2c"]))
                rows.append(f"{scene_id},{im_id},{entry['obj_id']},1,{R},{t},1")
    results, report = tmp_path / "results.csv", tmp_path / "report.json"
    results.write_text("\n".join(rows) + "\n")
    program = [sys.executable, shared / "tools" / "evaluate.py", dataset, results]
    output = subprocess.run(
        [*program, "--json", report], check=True, capture_output=True, text=True
    ).stdout
    everything = next(line for line in output.splitlines() if line.startswith("All"))
    assert [float(x) for x in everything.split()[1:]] == [18, 1, 0, 0, 0, 0, 0, 1, 1]


@pytest.mark.timeout(200)
def test_killed_and_resumed_gives_the_same_files(
    dataset: Path, tmp_path: Path, library: ObjectLibrary
):
    """The unbroken run had one worker in this process; this one has two, killed."""
    root = tmp_path / "again"
    command = [*PROGRAM, "generate", str(root), "--scenes", str(SCENES), "--seed"]
    command += [str(CONFIG.seed), "--objects", "3:3", "--views", "2", "--workers", "2"]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    while not list((root / "test").glob("[0-9]*")):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert json.loads((root / "generation.json").read_text())["complete"] is False
    assert not (root / "test_targets_bop19.json").exists()
    before = {p.name: p.stat().st_mtime_ns for p in (root / "test").glob("[0-9]*")}
    assert len(before) < SCENES
    generate_dataset(root, library, CONFIG, SCENES, resume=True)
    assert tree(root) == tree(dataset)
    for name, stamp in before.items():
        assert (root / "test" / name).stat().st_mtime_ns == stamp


def test_resuming_a_whole_dataset_changes_nothing(
    dataset: Path, library: ObjectLibrary
):
    before = tree(dataset)
    generate_dataset(dataset, library, CONFIG, SCENES, resume=True)
    assert tree(dataset) == before


def test_resuming_with_other_settings_is_refused(dataset: Path, library: ObjectLibrary):
    with pytest.raises(InputError, match=r"settings\.seed: is 5, now 6"):
        generate_dataset(dataset, library, replace(CONFIG, seed=6), SCENES, resume=True)


def test_existing_files_are_kept(tmp_path: Path, library: ObjectLibrary):
    (tmp_path / "thesis.txt").write_text("all of it")
    for resume in (False, True):
        with pytest.raises(InputError, match="choose a"):
            generate_dataset(tmp_path, library, CONFIG, SCENES, resume=resume)
    assert tree(tmp_path) == {"thesis.txt": b"all of it"}


def test_full_disk_leaves_no_scene(
    tmp_path: Path, library: ObjectLibrary, monkeypatch: pytest.MonkeyPatch
):
    written = []
    write = bop_writer.write_image

    def write_some(path: Path, image: np.ndarray) -> None:
        if "mask" in str(path.parent):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        written.append(path)
        write(path, image)

    monkeypatch.setattr(bop_writer, "write_image", write_some)
    with pytest.raises(InputError, match="No space left"):
        generate_dataset(tmp_path / "out", library, CONFIG, 1)
    assert written
    assert list((tmp_path / "out" / "test").iterdir()) == []


def test_a_scene_that_is_there_is_not_made_again(
    tmp_path: Path, library: ObjectLibrary
):
    """As if a worker died right after it had put the scene in its place."""
    (tmp_path / "000001").mkdir()
    maker = SceneMaker(tmp_path, library, CONFIG, {})
    maker.make(1)
    with pytest.raises(KeyError):  # there are no model files to make others from
        maker.make(2)
    assert [path.name for path in tmp_path.iterdir()] == ["000001"]
