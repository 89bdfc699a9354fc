# SPDX-License-Identifier: MIT
"""The comparison is fair and right, and a missing package is skipped."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.peers import registration, settling, stages
from benchmarks.peers.cases import Case
from benchmarks.peers.drawn_segments import drawn_cases
from benchmarks.peers.installed import HOW, PACKAGES, installed, missing
from benchmarks.peers.refinement import Refiner, ours, peers
from physim_drake.poses import is_rotation
from physim_drake.registration.registration_model import registration_model
from tests import synthetic


@pytest.fixture(scope="module")
def drawn() -> list[Case]:
    return drawn_cases(synthetic.library(), 3, seed=1)


@pytest.fixture(scope="module")
def apart() -> list[Case]:
    """A glue bottle and a bar of soap that stand alone on the table."""
    image = synthetic.synthesize(synthetic.pair_apart())
    scene = image.scene()
    models = [synthetic.library()[i] for i in scene.object_ids]
    return [
        Case("1/0", k, model, scene, image.X_SO[k]) for k, model in enumerate(models)
    ]


def needs(package: str) -> None:
    if not installed(package):
        pytest.skip(f"{PACKAGES[package]} is not installed; {HOW}")


def test_what_is_missing_is_named() -> None:
    assert set(missing()) <= set(PACKAGES.values())
    assert len(missing()) == sum(not installed(package) for package in PACKAGES)


def test_drawn_segments_hold_a_fifth_of_another_object(drawn: list[Case]) -> None:
    for case in drawn:
        points = case.segment.points
        field = registration_model(case.model).distance_field
        near = np.abs(field.query_posed(case.X_SO, points)[0]) < 0.006
        assert 1000 < len(points) <= 1500
        assert 0.75 < near.mean() < 0.9


def test_errors_fold_symmetry_and_starts_are_as_far_off_as_said(
    apart: list[Case],
) -> None:
    case = apart[0]
    turned = np.stack([case.X_SO, case.X_SO @ case.model.symmetry.discrete[-1]])
    assert case.errors(turned)[0] == pytest.approx([0, 0], abs=1e-4)
    start = case.perturbed(8.0, 0.01, seed=3)
    rotation, _ = case.errors(start[None])
    middle = np.append(case.model.mesh.bounds.mean(axis=0), 1.0)
    moved = np.linalg.norm((start - case.X_SO) @ middle)
    assert rotation == pytest.approx([8.0], abs=1e-3)
    assert moved == pytest.approx(0.01)
    assert not np.allclose(start, case.perturbed(8.0, 0.01, seed=4))


def test_our_refinement_mends_the_starts(apart: list[Case]) -> None:
    check_refiner(ours(), apart)


@pytest.mark.parametrize("package", ["small_gicp", "open3d"])
def test_refinement_of_others(package: str, apart: list[Case]) -> None:
    needs(package)
    name = {"small_gicp": "small_gicp", "open3d": "Open3D"}[package]
    chosen = [refiner for refiner in peers() if refiner.name.startswith(name)]
    assert len(chosen) == 2
    for refiner in chosen:
        check_refiner(refiner, apart)


def check_refiner(refiner: Refiner, cases: list[Case]) -> None:
    """It moves a pose a little off to where its points are."""
    for case in cases:
        start = case.perturbed(3.0, 0.004, seed=0)
        prepared = refiner.prepare(case.model)
        end = refiner.refine(prepared, case, start)
        assert is_rotation(end[:3, :3])
        rms = [
            float(
                np.median(
                    np.abs(
                        registration_model(case.model).distance_field.query_posed(
                            X, case.segment.points
                        )[0]
                    )
                )
            )
            for X in (start, end)
        ]
        assert rms[1] < min(0.0015, 0.8 * rms[0])


def test_our_registration_finds_an_object_alone(apart: list[Case]) -> None:
    method = registration.Ours()
    (record, *_) = stages.register([method], apart[:1], (6.0, 1.5), 1, lambda _: None)
    assert record["refined"]
    assert record["any"]
    assert record["poses"] == 26
    assert 0 < record["seconds"] < 60


@pytest.mark.parametrize(
    ("package", "make"),
    [
        ("open3d", registration.Open3dRansac),
        ("open3d", registration.Open3dFgr),
        ("ppf_match_3d", registration.OpencvPpf),
    ],
)
def test_registration_of_others_gives_poses(
    package: str, make: Callable[[Refiner], Any], apart: list[Case]
) -> None:
    needs(package)
    method = make(ours())
    case = apart[0]
    poses = method.propose(method.prepare(case.model), case, 0)
    assert 1 <= len(poses) <= 25
    assert all(is_rotation(X[:3, :3]) for X in poses)
    assert (np.linalg.norm(poses[:, :3, 3] - case.X_SO[:3, 3], axis=1) < 0.3).all()


@pytest.mark.parametrize(
    ("package", "make"),
    [
        ("", settling.Ours),
        ("", settling.OursFreed),
        ("mujoco", settling.MujocoEngine),
        ("pybullet", settling.PybulletEngine),
    ],
)
def test_an_object_put_down_stays_where_it_stands(
    package: str, make: Callable[[], Any], apart: list[Case]
) -> None:
    """Its frame, its centre of mass and its pieces are those of the model."""
    if package:
        needs(package)
    engine = make()
    for case in apart:
        others = [(c.model, c.X_SO) for c in apart if c is not case]
        scene = engine.build(case, others)
        lifted = case.X_SO.copy()
        lifted[2, 3] += 0.003
        for X_SO in (lifted, case.X_SO):
            rotation, distance = case.errors(engine.settle(scene, X_SO)[None])
            assert rotation[0] < 2.0
            assert 10 * distance[0] < 3.0


def test_rows_tell_shares_ratios_and_wins() -> None:
    def record(method: str, image: str, good: bool, seconds: float) -> dict[str, Any]:
        return {
            "method": method, "image": image, "object": "soap", "poses": 1,
            "seconds": seconds, "refining_seconds": 0.001, "best": False,
            "refined": good, "any": good, "rotation_deg": 1.0, "translation_cm": 0.1,
        }  # fmt: skip

    records = [
        record("ours", "1", True, 0.2),
        record("ours", "2", True, 0.2),
        record("other", "1", False, 0.1),
        record("other", "2", True, 0.1),
    ]
    first, second = stages.registration_rows(records)
    assert first["+ICP %"] == 100
    assert second["+ICP, ratio"] == 0.5
    assert second["s, ratio"] == pytest.approx(0.5)
    soap, everything = stages.object_rows(records)
    assert soap["other"] == "50 %  1:0"
    assert everything["other"] == soap["other"]
