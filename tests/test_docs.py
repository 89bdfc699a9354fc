# SPDX-License-Identifier: MIT
"""What the documents say works."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import typer

from physim_drake.cli import app
from physim_drake.estimation import EstimationConfig, Method, estimate_scene

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    """The code blocks of a page in one language."""
    pattern = rf"^```{language}\n(.*?)^```"
    return re.findall(pattern, page.read_text(), re.DOTALL | re.MULTILINE)


def test_python_of_the_documents_runs(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    quick = EstimationConfig(Method.PCA_ICP)
    monkeypatch.setattr(estimate_scene, "__defaults__", (quick, None))
    namespace: dict[str, Any] = {}
    for page in (ROOT / "README.md", ROOT / "docs" / "getting-started.md"):
        code = blocks(page, "python")
        assert code, f"{page.name} shows no Python"
        for text in code:
            exec(compile(text, page.name, "exec"), namespace)
    assert "up_glucose_bottle: xyz" in capsys.readouterr().out
    assert (tmp_path / "out" / "scene" / "scene.dmd.yaml").is_file()
    assert (tmp_path / "out" / "overlay.png").is_file()


def test_the_integration_test_of_the_documents_passes() -> None:
    (text,) = blocks(ROOT / "docs" / "integration-tests.md", "python")
    exec(compile(text, "integration-tests.md", "exec"), {})


def test_every_python_block_is_in_a_tested_page() -> None:
    tested = {
        "README.md",
        "build-a-diagram.md",  # in tests/systems
        "getting-started.md",
        "integration-tests.md",
    }
    assert {page.name for page in PAGES if blocks(page, "python")} == tested


def test_json_of_the_documents_is_json() -> None:
    texts = [text for page in PAGES for text in blocks(page, "json")]
    assert len(texts) == 3
    for text in texts:
        assert json.loads(text)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text())
    for link in links:
        if not link.startswith("https://"):
            assert (page.parent / link).exists(), link


@pytest.mark.parametrize("name", ["estimate", "generate", "train", "detect"])
def test_the_options_of_a_command_are_all_described(name: str) -> None:
    command = typer.main.get_command(app).commands[name]  # type: ignore[attr-defined]
    options = {
        o for p in command.params for o in p.opts if o.startswith("--") and o != "--out"
    }
    page = (ROOT / "docs" / "cli.md").read_text()
    section = page.partition(f"\n## {name}\n")[2].partition("\n## ")[0]
    described = set(re.findall(r"^\| `(--[a-z-]+)", section, re.MULTILINE))
    switches = {o.replace("--no-", "--") for o in described}
    assert switches - {"--help"} == options - {"--help"}
