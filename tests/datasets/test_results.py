# SPDX-License-Identifier: MIT
from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physim_drake.datasets.results import (
    COLUMNS,
    ResultRow,
    format_row,
    read_results,
)
from physim_drake.errors import InputError, PhysimError
from physim_drake.poses import Array, exp_pose
from tests.datasets.tiny import mangled

HEADER = ",".join(COLUMNS)
IDENTITY = "1 0 0 0 1 0 0 0 1"
LINE = f"1,2,3,0.5,{IDENTITY},10 20 30,1.5"


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


@given(
    xi=st.lists(st.floats(-3, 3), min_size=6, max_size=6),
    score=st.floats(-1e6, 1e6),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_rows_survive_writing_and_reading(
    tmp_path: Path, xi: list[float], score: float
) -> None:
    X_CO: Array = exp_pose(np.array(xi))
    row = ResultRow(1, 2, 3, score, X_CO, time=0.25)
    path = write(tmp_path / "results.csv", HEADER, format_row(row))
    (found,) = read_results(path)
    np.testing.assert_allclose(found.X_CO, X_CO, atol=1e-9)
    assert (found.scene_id, found.im_id, found.object_id) == (1, 2, 3)
    assert found.score == pytest.approx(score, rel=1e-8)
    assert found.time == 0.25


def test_units_and_unknown_time(tmp_path: Path) -> None:
    path = write(tmp_path / "r.csv", HEADER, LINE, LINE.replace("1.5", "-1"), "")
    rows = read_results(path)
    assert rows[0].X_CO[:3, 3] == pytest.approx([0.01, 0.02, 0.03])
    assert [row.time for row in rows] == [1.5, None]


def test_columns_may_stand_in_any_order_and_time_may_lack(tmp_path: Path) -> None:
    path = write(
        tmp_path / "r.csv",
        "obj_id, im_id, scene_id, t, R, score",
        f"3, 2, 1.0, 1 2 3, {IDENTITY}, 1",
    )
    (row,) = read_results(path)
    assert (row.scene_id, row.object_id, row.time) == (1, 3, None)


def test_a_header_alone_holds_no_results(tmp_path: Path) -> None:
    assert read_results(write(tmp_path / "r.csv", HEADER)) == []


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (LINE.replace("1,2", "x,2"), "line 2, scene_id: is 'x'"),
        (LINE.replace("1,2", "1.5,2"), "scene_id: is '1.5'"),
        (LINE.replace("1,2", "1,-2"), "im_id: is '-2'"),
        (LINE.replace("0.5", ""), "score: is ''"),
        (LINE.replace("0.5", "nan"), "score: is 'nan'"),
        (LINE.replace("1 0 0 0", "1 0 0"), "R: is"),
        (LINE.replace("1 0 0 0", "-1 0 0 0", 1), "right-handed"),
        (LINE.replace("1 0 0 0", "2 0 0 0"), "right-handed"),
        (LINE.replace("10 20", "10 inf"), "t: is"),
        (LINE.replace("10 20", "1e300 20"), "millimetres"),
        (LINE.replace("1.5", "soon"), "time: is 'soon'"),
        (LINE + ",4", "has 8 columns"),
        ("1,2,3", "line 2: has 3 columns"),
        ('"1,2', "not CSV"),
    ],
)
def test_malformed_rows_name_line_and_column(
    tmp_path: Path, line: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read_results(write(tmp_path / "r.csv", HEADER, line))


def test_other_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_results(tmp_path / "none.csv")
    with pytest.raises(InputError, match="lacks scene_id"):
        read_results(write(tmp_path / "r.csv", ""))
    (tmp_path / "r.csv").write_bytes(b"\x89PNG\0\xff")
    with pytest.raises(InputError, match="is not UTF-8 text"):
        read_results(tmp_path / "r.csv")


@settings(
    max_examples=200,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_mangled_files_raise_only_input_errors(
    tmp_path: Path, data: st.DataObject
) -> None:
    path = tmp_path / "r.csv"
    path.write_bytes(data.draw(mangled(f"{HEADER}\n{LINE}\n{LINE}\n".encode())))
    with suppress(PhysimError):
        for row in read_results(path):
            assert np.isfinite(row.X_CO).all()
