# SPDX-License-Identifier: MIT
from __future__ import annotations

import pytest

from physim_drake.parallel import cores


@pytest.mark.parametrize(("count", "workers"), [(1, 1), (3, 3), (64, 4)])
def test_there_is_a_worker_for_each_core_up_to_a_limit(
    count: int, workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cores, "core_count", lambda: count)
    assert cores.default_workers() == workers
