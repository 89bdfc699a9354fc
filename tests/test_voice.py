# SPDX-License-Identifier: MIT
"""The documents speak plainly: a few turns of phrase that they do not use.

CONTRIBUTING.md has the rules. Only what is wrong nearly always is listed here.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "models").rglob("*.md")),
]

BETTER = {
    r"\b(is|are|does|do|was|were|has) none\b": "negate the verb: is not, does not",
    r"(?<![Tt]here )\b(is|are|was) no (?!longer|more|less|larger)\w+": "X is not a Y",
    r"\bwhere (it|they|one|none|nothing|there) (is|are|has|have|does|do)\b": "if",
    r"(^|[.:] )Where (?!to\b)": "begin a condition with If",
    r"\b(be|is|are) told\b": "say who tells whom, or what is printed",
    r", (too|as well)[.,;:]": "also, or no comma",
    r"\b(mend|mended|spoilt)\b": "correct, repair, damaged",
    r"^\*\*(When|Again|How long|In the way|Other ways)\.\*\*": "name the thing",
}
"""What is not written, and what is written instead."""

_CODE = re.compile(r"^```.*?^```$|`[^`\n]+`", re.DOTALL | re.MULTILINE)


def offences(text: str) -> list[str]:
    """Each turn of phrase in a text that is not in code, with the better one."""
    prose = _CODE.sub("`code`", text)
    return [
        f"{match[0].strip()!r}: {better}"
        for pattern, better in BETTER.items()
        for match in re.finditer(pattern, prose, re.MULTILINE)
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_page_is_in_plain_english(page: Path) -> None:
    assert offences(page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "text",
    [
        "A table is none.",
        "It is no mesh.",
        "The detections, where there are none,",
        "The mask is used where it is None.",
        "Where objects touch, give masks.",
        "A warning is told.",
        "That goes, too.",
    ],
)
def test_an_offence_is_seen(text: str) -> None:
    assert offences(text)


def test_code_and_places_are_no_offence() -> None:
    fine = "Stop where it started. `x is none` is a message.\n```\nis no x\n```\n"
    assert offences(fine) == []
