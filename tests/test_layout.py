# SPDX-License-Identifier: MIT
"""Packages form a DAG: each imports only what stands before it here."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1] / "physim_drake"
ORDER = (
    *("errors", "extras", "closing", "compiled", "notebook", "poses", "camera"),
    *("pose_errors", "storage", "parallel", "models", "objects", "observation"),
    *("sensors", "registration", "hypotheses", "physics", "scene_estimate"),
    *("rendering", "search", "estimation", "datasets", "scenes", "evaluation"),
    *("detection", "batch", "suction", "picking", "systems", "episodes"),
    *("self_learning", "testing", "pytest_plugin", "reporting", "doctor", "cli"),
)


def imported(path: Path) -> set[str]:
    """The packages and flat modules of physim_drake that a module imports."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module == "physim_drake":
            names |= {f"physim_drake.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    parts = [name.split(".") for name in names]
    return {p[1] for p in parts if p[0] == "physim_drake" and len(p) > 1} & {*ORDER}


def upward_imports(root: Path) -> list[str]:
    """Imports of what stands later, as "module -> package"."""
    found = []
    for place in root.iterdir():
        # models/make_*.py are programs that write the models; nothing imports them.
        for path in [place] if place.is_file() else sorted(place.rglob("*.py")):
            own = place.stem
            if path.suffix != ".py" or own == "__init__" or path.match("make_*.py"):
                continue
            later = ORDER[ORDER.index(own) + 1 :]
            found += [f"{own}/{path.name} -> {n}" for n in imported(path) & {*later}]
    return found


def test_no_module_imports_upwards() -> None:
    assert upward_imports(ROOT) == []


def test_an_upward_import_is_seen(tmp_path: Path) -> None:
    (tmp_path / "objects").mkdir()
    (tmp_path / "objects" / "model.py").write_text(
        "from physim_drake.poses import inverse\n"
        "def late():\n    from physim_drake.search import tree\n"
    )
    assert upward_imports(tmp_path) == ["objects/model.py -> search"]


def test_the_architecture_page_names_every_package() -> None:
    page = (ROOT.parent / "docs" / "architecture.md").read_text(encoding="utf-8")
    start = page.index("## Layout")
    layout = page[start : page.index("\n## ", start)]
    packages = {p.name for p in ROOT.iterdir() if (p / "__init__.py").is_file()}
    missing = {name for name in packages if f"{name}/`" not in layout}
    assert missing == set()
    folders = (ROOT.parent, ROOT, ROOT / "detection")
    for name in re.findall(r"`([a-z_/]+(?:/|\.py))`", layout):
        assert any((folder / name).exists() for folder in folders), name
