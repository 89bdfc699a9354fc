# SPDX-License-Identifier: MIT
from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import fuzz


@pytest.fixture(autouse=True)
def one_second(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """An input may take a second."""
    monkeypatch.setattr(fuzz, "SECONDS_AN_INPUT", 1)
    before = signal.signal(signal.SIGALRM, fuzz._give_up)
    yield
    signal.signal(signal.SIGALRM, before)


def stall(_: bytes) -> None:
    """A reader that hangs and catches all that it may."""
    while True:
        try:
            sum(range(10_000))
        except Exception:
            continue


def test_an_input_that_goes_wrong_is_kept(tmp_path: Path) -> None:
    kept = tmp_path / "rle-fault"
    fuzz._read_within_limits(len, b"good", kept)  # type: ignore[arg-type]
    assert not kept.exists()
    with pytest.raises(ValueError, match="could not convert"):
        fuzz._read_within_limits(float, b"bad", kept)  # type: ignore[arg-type]
    assert kept.read_bytes() == b"bad"


def test_an_input_that_takes_too_long_is_kept(tmp_path: Path) -> None:
    kept = tmp_path / "rle-fault"
    with pytest.raises(fuzz._TooSlowError):
        fuzz._read_within_limits(stall, b"slow", kept)
    assert kept.read_bytes() == b"slow"


def test_an_interrupt_says_nothing_of_the_input(tmp_path: Path) -> None:
    def interrupt(_: bytes) -> None:
        raise KeyboardInterrupt

    kept = tmp_path / "rle-fault"
    with pytest.raises(KeyboardInterrupt):
        fuzz._read_within_limits(interrupt, b"good", kept)
    assert not kept.exists()


@pytest.mark.parametrize(
    ("printed", "status", "inputs", "good"),
    [
        ("inputs 412\nmemory 300\n", 0, 412, True),
        ("stat::number_of_executed_units: 9\nstat::peak_rss_mb: 300\n", 0, 9, True),
        ("inputs 412\nmemory 300\n", 1, 412, False),
        ("inputs 0\nmemory 300\n", 0, 0, False),
        ("nothing of the kind", 0, 0, False),
    ],
)
def test_what_a_process_says_is_counted(
    printed: str,
    status: int,
    inputs: int,
    good: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done = SimpleNamespace(stdout=printed, returncode=status)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    told: list[fuzz.Finding] = []
    found = fuzz.fuzz(["rle", "png"], 10, "atheris", tmp_path / "new", told.append)
    assert [f.target for f in found] == ["rle", "png"]
    assert told == found
    for finding in found:
        assert (finding.inputs, finding.good) == (inputs, good)
        assert finding.memory_mb in (0, 300)


def test_a_process_that_hangs_is_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hang(*_: object, timeout: float, **__: object) -> None:
        raise subprocess.TimeoutExpired("fuzz", timeout, output=b"inputs 7\n")

    monkeypatch.setattr(subprocess, "run", hang)
    (finding,) = fuzz.fuzz(["rle"], 10, "hypothesis", tmp_path)
    assert (finding.inputs, finding.good) == (7, False)
    assert "hung" in (tmp_path / "rle.log").read_text()
