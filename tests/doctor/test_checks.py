# SPDX-License-Identifier: MIT
from __future__ import annotations

import platform
from pathlib import Path

import pytest

from physim_drake.doctor import checks as installation
from physim_drake.doctor.checks import (
    PROBES,
    Check,
    Probe,
    Status,
    available_memory,
    check_installation,
    run_probe,
)

WEIGHTS = next(probe for probe in PROBES if probe.name == "detector weights")
RENDERING = next(probe for probe in PROBES if probe.name == "rendering")


def test_a_check_survives_the_way_from_one_process_to_another() -> None:
    check = Check("disk", Status.WARNING, "0.1 GiB", "free some")
    assert Check.from_dict(check.as_dict()) == check


def test_a_probe_reports_from_its_own_process() -> None:
    check = run_probe(WEIGHTS)
    assert check.name == "detector weights"
    assert check.status in (Status.OK, Status.WARNING)


def test_a_probe_that_raises_fails_with_its_last_words() -> None:
    check = run_probe(Probe("no such probe", "do this"))
    expected = Check(
        "no such probe", Status.FAIL, "KeyError: 'no such probe'", "do this"
    )
    assert check == expected


def test_a_probe_that_does_not_end_fails() -> None:
    check = run_probe(RENDERING, timeout=0.01)
    assert check.status is Status.FAIL
    assert check.message.startswith("no result within")
    assert "libegl1" in check.remedy


def test_missing_graphics_drivers_are_a_failing_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # OpenGL's dispatcher then finds no vendor, upon which VTK crashes its process.
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/dev/null")
    check = run_probe(RENDERING)
    assert check.status is Status.FAIL
    assert check.message
    assert "libegl1" in check.remedy


def test_memory_is_what_the_machine_has_left(tmp_path: Path) -> None:
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemTotal: 9 kB\nMemAvailable: 8388608 kB\n")
    assert available_memory(meminfo, tmp_path) == pytest.approx(8.0)
    (tmp_path / "memory.current").write_text("1073741824\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert available_memory(meminfo, tmp_path) == pytest.approx(8.0)


def test_memory_is_within_the_limit_of_a_container(tmp_path: Path) -> None:
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemAvailable: 8388608 kB\n")
    (tmp_path / "memory.current").write_text("1073741824\n")
    (tmp_path / "memory.max").write_text("4294967296\n")
    assert available_memory(meminfo, tmp_path) == pytest.approx(3.0)


def test_memory_may_be_unknown(tmp_path: Path) -> None:
    assert available_memory(tmp_path / "missing", tmp_path) is None


def test_little_of_anything_is_a_warning_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(installation, "PROBES", ())
    monkeypatch.setattr(installation, "core_count", lambda: 1)
    monkeypatch.setattr(installation, "available_memory", lambda: 0.3)
    monkeypatch.setattr(installation, "LEAST_DISK", 1e9)
    monkeypatch.setattr(platform, "system", lambda: "Darwin")
    checks = list(check_installation())
    assert [c.name for c in checks] == ["python", "cores", "memory", "disk"]
    assert all(c.status is Status.WARNING and c.remedy for c in checks)


def test_an_old_python_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "PROBES", ())
    monkeypatch.setattr(installation, "LEAST_PYTHON", (99, 0))
    first = next(iter(check_installation()))
    assert first.status is Status.FAIL
    assert "Python 99.0" in first.remedy
