# SPDX-License-Identifier: MIT
"""The documentation site builds without a warning, and a browser shows it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Literal

import pytest
from playwright.sync_api import (
    Browser,
    ConsoleMessage,
    Page,
    Request,
    Response,
    sync_playwright,
)

from tests.browser import CHROMIUM, needs_chromium

ROOT = Path(__file__).parents[1]

MAIN_PAGES = (
    "index",
    "getting-started",
    "first-image",
    "estimate-your-own-data",
    "cli",
    "troubleshooting",
    "glossary",
    "contributing",
    "build-a-diagram",
    "pick-cell",
    "your-own-cell",
    "train-a-detector",
    "integration-tests",
    "how-it-works",
    "architecture",
    "results/index",
    "api/estimating",
    "changelog",
)


_FITS = "document.documentElement.scrollWidth <= innerWidth"
_SCHEME = "document.body.getAttribute('data-md-color-scheme')"
_MISSING = "[...document.images].filter(i => !i.naturalWidth).map(i => i.src)"


def complaints(page: Page, address: str) -> list[str]:
    """What will be wrong with a page: errors, missing files, other servers."""
    wrong: list[str] = []

    def request(sent: Request) -> None:
        if not sent.url.startswith((address, "data:", "blob:")):
            wrong.append(f"outside: {sent.url}")

    def response(got: Response) -> None:
        if got.status >= 400:
            wrong.append(f"{got.status}: {got.url}")

    def failed(sent: Request) -> None:
        if sent.failure != "net::ERR_ABORTED":  # by going on to the next page
            wrong.append(f"{sent.failure}: {sent.url}")

    def console(message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            wrong.append(message.text)

    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("requestfailed", failed)
    page.on("request", request)
    page.on("response", response)
    page.on("console", console)
    return wrong


def build(out: Path, config: Path = ROOT / "mkdocs.yml") -> tuple[int, str]:
    """Builds the site: its exit status, 1 after a warning, and what it says."""
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", config, "-d", out],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    status, said = build(out)
    assert status == 0, said
    return out


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: object) -> None:
            """Says nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox"]
        )
        yield browser
        browser.close()


def test_a_link_that_leads_nowhere_is_an_error(tmp_path: Path) -> None:
    docs = tmp_path / "docs"
    docs.mkdir()
    (docs / "index.md").write_text("[gone](missing.md)")
    config = tmp_path / "mkdocs.yml"
    config.write_text("site_name: x\ntheme: {name: material, font: false}\n")
    status, said = build(tmp_path / "out", config)
    assert status == 1
    assert "missing.md" in said


def test_formulas_are_drawn_without_scripts(site: Path) -> None:
    text = (site / "how-it-works.html").read_text()
    assert text.count('<math xmlns="http://www.w3.org/1998/Math/MathML"') > 10
    assert "arithmatex" not in text


def test_options_are_not_broken_up(site: Path) -> None:
    text = (site / "cli.html").read_text()
    assert '<code class="whole">--resume</code>' in text
    assert "<code>RAY_ADDRESS=10.0.0.5:6379 physim-drake estimate datasets/lab" in text
    assert '<span class="whole">--engine</span> ray</code>' in text


def test_files_that_pages_link_to_are_pages(site: Path) -> None:
    text = (site / "build-a-diagram.html").read_text()
    assert 'href="source/examples/perception_diagram.py.html"' in text
    shown = (site / "source" / "examples" / "perception_diagram.py.html").read_text()
    assert "AddPerceptionDiagram" in shown


def test_docstrings_are_in_the_reference(site: Path) -> None:
    text = (site / "api" / "estimating.html").read_text()
    assert 'id="physim_drake.estimation.estimator.PoseEstimator.estimate"' in text
    assert "one for each object to find" in text
    systems = (site / "api" / "systems.html").read_text()
    assert "name: PerceptionDiagram" in systems
    assert "pydrake_system" not in systems


@needs_chromium
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_open_without_errors_and_need_no_other_server(
    address: str, browser: Browser, scheme: Literal["light", "dark"]
) -> None:
    page = browser.new_page(color_scheme=scheme)
    wrong = complaints(page, address)
    for name in MAIN_PAGES:
        page.goto(f"{address}{name}.html")
        for width in (1280, 390):
            page.set_viewport_size({"width": width, "height": 800})
            page.wait_for_function(_FITS)  # once what opens and closes has done so
        assert page.evaluate(_SCHEME) == {"light": "default", "dark": "slate"}[scheme]
        assert page.evaluate(_MISSING) == [], name
        assert page.locator("h1").inner_text(), name
    page.close()
    assert wrong == []


@needs_chromium
def test_the_search_finds_a_command(address: str, browser: Browser) -> None:
    page = browser.new_page()
    page.goto(address + "index.html")
    page.keyboard.press("s")
    page.keyboard.type("troubleshooting", delay=20)
    hit = page.locator(".md-search-result__link").first
    hit.wait_for(timeout=20_000)
    assert "Troubleshooting" in hit.inner_text()
    page.close()


@needs_chromium
def test_commands_are_copied_as_they_were_written(
    address: str, browser: Browser
) -> None:
    """Shown on a phone, where they go over several lines."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = readme.split("```sh\n")[1].split("```")[0].strip()
    assert "\n" in commands
    context = browser.new_context(
        permissions=["clipboard-read", "clipboard-write"],
        viewport={"width": 390, "height": 800},
    )
    page = context.new_page()
    page.goto(address + "index.html")
    block = page.locator(".language-sh").first
    code = block.locator("code")
    assert code.evaluate("code => code.scrollWidth <= code.clientWidth")
    block.hover()
    block.locator("button").first.click()
    page.wait_for_function("async () => await navigator.clipboard.readText()")
    assert page.evaluate("navigator.clipboard.readText()") == commands
    context.close()
