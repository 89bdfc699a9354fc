# SPDX-License-Identifier: MIT
"""Spoilt files of every kind: nothing but what users are told leaves the readers."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from fuzz_mutations import inputs
from fuzz_targets import TARGETS, Target

EXAMPLES = {"mesh": 40, "weights": 40, "yaml": 40}


@pytest.fixture(params=sorted(TARGETS))
def named_target(request: pytest.FixtureRequest) -> Iterator[tuple[str, Target]]:
    with tempfile.TemporaryDirectory() as folder:
        yield request.param, TARGETS[request.param](Path(folder))


def test_spoilt_files_raise_nothing_but_physim_errors(
    named_target: tuple[str, Target],
) -> None:
    name, target = named_target
    for seed in target.seeds:
        target.read(seed)

    @settings(
        max_examples=EXAMPLES.get(name, 80),
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def read(data: st.DataObject) -> None:
        target.read(data.draw(inputs(target.seeds)))

    read()


def test_a_reader_that_fails_otherwise_is_noticed(tmp_path: Path, monkeypatch) -> None:
    from physim_drake.datasets import rle

    target = TARGETS["rle"](tmp_path)
    monkeypatch.setattr(rle, "_unpack", lambda counts: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        target.read(target.seeds[0])
