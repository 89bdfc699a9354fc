# SPDX-License-Identifier: MIT
from __future__ import annotations

import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest

from physim_drake.errors import InputError
from physim_drake.reporting.explanation_figures import graph_nodes, tree_blocks
from physim_drake.reporting.explanation_page import explanation_page, write_explanation
from tests.browser import needs_chromium, opened
from tests.reporting.explained import BOTTLE, BOX, CRAYONS, bare, example

VOID = {"meta", "img", "br"}

STAGES = (
    "camera",
    "surface",
    "segment",
    "hypotheses",
    "placed before",
    "search",
    "object by object",
    "truth",
)
"""What the sections are about, in order."""

_MISSING = "[...document.images].filter(i => !i.naturalWidth).map(i => i.alt)"


class Balance(HTMLParser):
    """Notices a tag that is closed but not open, or the reverse."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.sources += [v or "" for k, v in attrs if k in ("src", "href", "srcset")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: object) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def page() -> str:
    return explanation_page(example())


@pytest.fixture(scope="module")
def bare_page() -> str:
    return explanation_page(bare())


def test_pages_need_nothing_from_outside(page: str, bare_page: str) -> None:
    for text in (page, bare_page):
        assert "http:" not in text  # four letters alone may occur in picture data
        assert "https:" not in text
        parser = Balance()
        parser.feed(text)
        assert parser.open == []
        assert len(parser.sources) > 10
        assert all(s.startswith("data:image/") for s in parser.sources)
        assert "url(#" in text
        assert "@import" not in text


def test_ids_that_are_referred_to_are_there(page: str) -> None:
    known = set(re.findall(r'\bid="([^"]+)"', page))
    wanted = set(re.findall(r'url\(#([^)]+)\)|xlink:href="#([^"]+)"', page))
    assert {a or b for a, b in wanted} <= known


def test_every_stage_has_its_section(page: str) -> None:
    headings = re.findall(r"<h2>(\d)\.", page)
    assert headings == list("12345678")
    for name in example().names:
        assert page.count(name) >= 8


@needs_chromium
def test_it_opens_from_a_file_and_shows_every_stage(tmp_path: Path) -> None:
    path = write_explanation(example(), tmp_path)
    with opened(path.as_uri()) as page:
        assert page.evaluate(_MISSING) == []
        headings = page.locator("h2").all_inner_texts()
        for stage, heading in zip(STAGES, headings, strict=True):
            assert stage in heading.lower()
        for picture in ("Outlines of the poses kept of", "Residuals", "Best state"):
            assert page.locator(f"img[alt*='{picture}']").count() > 0
        blocks = page.locator("svg title").all_text_contents()
        assert any("tried" in text and "score" in text for text in blocks)


def test_right_poses_are_called_right(page: str) -> None:
    assert page.count("The pose is right.") == 2 * len(example().detections)


def test_what_is_not_known_is_left_out(bare_page: str) -> None:
    headings = re.findall(r"<h2>(\d)\.", bare_page)
    assert headings == list("1234567")
    assert "The pose is right" not in bare_page
    assert "nearest to the truth" not in bare_page


def test_an_object_that_is_not_found_is_told_of(bare_page: str) -> None:
    assert "2 of 3 objects found" in bare_page
    assert "Not found: its segment has 0 points, at least 30 are needed" in bare_page
    assert "None: the segment has 0 points." in bare_page


def test_diagrams_take_the_colour_of_the_page(page: str) -> None:
    assert "#010203" not in page
    assert "currentColor" in page
    count = len(example().detections)
    assert len(re.findall(r"<svg ", page)) == 2 * count + 1 + 2 * len(
        example().searches
    )


def test_the_page_is_named_after_its_image(tmp_path: Path) -> None:
    path = write_explanation(bare(), tmp_path)
    assert path == tmp_path / "000001_000000.html"
    assert path.read_text().endswith("</html>\n") or path.read_text().endswith(
        "</html>"
    )


def test_a_folder_that_is_missing_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_explanation(bare(), tmp_path / "missing")


def test_blocks_fill_the_rows_of_the_tree() -> None:
    e = example()
    (record,) = e.searches
    blocks = tree_blocks(record, e.names)
    first = [b for b in blocks if b.row == 0]
    assert sum(b.width for b in first) == pytest.approx(1.0)
    for left, right in pairwise(first):
        assert right.x == pytest.approx(left.x + left.width)
    assert [b.rank for b in first if b.best] == [
        record.result.states[0].hypotheses[0] + 1
    ]
    assert e.names[record.order[0]] in first[0].text


def test_objects_stand_to_the_right_of_those_placed_before() -> None:
    nodes = {n.index: n for n in graph_nodes([(BOTTLE, BOX), (BOX, CRAYONS)], 4)}
    columns = [nodes[k].column for k in (BOTTLE, BOX, CRAYONS, 3)]
    assert columns == [0, 1, 2, 0]
    assert (nodes[BOTTLE].row, nodes[3].row) == (0, 1)
