# SPDX-License-Identifier: MIT
"""Commands on a cluster of two machines, both of them here, one of which is lost."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from physim_drake.models import APC11

ray = pytest.importorskip("ray", reason="Ray, an extra, is not installed")

PROGRAM = [sys.executable, "-c", "from physim_drake.cli import main; main()"]
EXAMPLE = Path(__file__).parents[2] / "examples" / "data" / "tabletop"


@pytest.fixture
def cluster() -> Iterator[Any]:
    from ray.cluster_utils import Cluster

    machines = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    yield machines
    machines.shutdown()


def start(cluster: Any, *arguments: str | Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*PROGRAM, *map(str, arguments), "--engine", "ray"],
        env={**os.environ, "RAY_ADDRESS": cluster.address},
        stderr=subprocess.PIPE,
        text=True,
    )


def run(*arguments: str | Path) -> None:
    subprocess.run([*PROGRAM, *map(str, arguments)], check=True)


def files(root: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in root.rglob("*")
        if path.is_file()
    }


def test_scenes_are_the_same_though_a_machine_is_lost(
    cluster: Any, tmp_path: Path
) -> None:
    settings = ["--scenes", "4", "--objects", "2:2", "--levels", "1"]
    second = cluster.add_node(num_cpus=1)
    far = start(cluster, "generate", tmp_path / "far", *settings)
    while far.poll() is None and not list((tmp_path / "far/test").glob("0*")):
        time.sleep(0.1)
    cluster.remove_node(second, allow_graceful=False)
    assert far.wait() == 0, far.stderr and far.stderr.read()
    run("generate", tmp_path / "here", *settings)
    assert files(tmp_path / "far") == files(tmp_path / "here")


def test_poses_are_the_same(cluster: Any, tmp_path: Path) -> None:
    settings = ["--models", str(APC11), "--expansions", "12"]
    far = start(cluster, "estimate", EXAMPLE, "--out", tmp_path / "far.csv", *settings)
    assert far.wait() == 0, far.stderr and far.stderr.read()
    run(
        "estimate", EXAMPLE, "--out", tmp_path / "here.csv", *settings, "--workers", "1"
    )
    rows = [
        [line.rpartition(",")[0] for line in path.read_text().splitlines()]
        for path in (tmp_path / "far.csv", tmp_path / "here.csv")
    ]
    assert len(rows[0]) > 1
    assert rows[0] == rows[1]


def test_a_cluster_that_does_not_answer(tmp_path: Path) -> None:
    result = subprocess.run(
        [*PROGRAM, "generate", str(tmp_path / "out"), "--engine", "ray"],
        env={**os.environ, "RAY_ADDRESS": "127.0.0.1:1"},
        capture_output=True,
        text=True,
    )
    assert result.returncode == 2
    assert "no Ray cluster answers" in result.stderr.splitlines()[-1]
