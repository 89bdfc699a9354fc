# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from typing import Any

import pytest

import physim_drake as physim
from tests.examples.test_examples import FOLDER


def test_the_notebook_runs_from_top_to_bottom(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = physim.EstimationConfig(physim.Method.SUPER4PCS_ICP)
    monkeypatch.setattr(physim.estimate_scene, "__defaults__", (quick, None))
    notebook = json.loads((FOLDER / "estimate.ipynb").read_text())
    namespace: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []  # nothing of a run is kept
            exec("".join(cell["source"]), namespace)
    assert len(namespace["estimate"].found) == 3
    for shown in ("observation", "estimate"):
        assert "<img " in namespace[shown]._repr_html_()
