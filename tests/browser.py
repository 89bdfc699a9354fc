# SPDX-License-Identifier: MIT
"""Opens pages in a real headless Chromium."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Page, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="needs Chromium: apt-get install chromium"
)

_TREE = """() => {
  const paths = [];
  const walk = (node, path) => {
    if (node.object.visible) {
      paths.push(path);
      for (const name in node.children) walk(node.children[name], path + "/" + name);
    }
  };
  walk(viewer.scene_tree, "");
  return paths;
}"""


@contextmanager
def opened(url: str) -> Iterator[Page]:
    """A page, drawn by software. An error of its scripts fails the test."""
    errors: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM,
            args=[
                "--no-sandbox",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
            ],
        )
        page = browser.new_page(viewport={"width": 960, "height": 640})
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(url)
        yield page
        browser.close()
    assert errors == []


def visible_paths(page: Page) -> set[str]:
    """What Meshcat's tree shows, for instance ``/drake/visualizer/table``."""
    return set(page.evaluate(_TREE))


def screenshot(page: Page, path: Path) -> int:
    """Keeps a picture of the page and returns how many colours it has."""
    from PIL import Image

    page.screenshot(path=str(path))
    with Image.open(path) as image:
        return len(image.convert("RGB").getcolors(maxcolors=1 << 24) or ())
