# SPDX-License-Identifier: MIT
"""Hooks of MkDocs for the documentation site.

The README is the front page, and CHANGELOG.md and CONTRIBUTING.md are pages, so that
each exists once. Files of the repository that a page links to become pages. Formulas
become MathML, which browsers draw without scripts.
"""

from __future__ import annotations

import html
import posixpath
import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
_PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
}
_LANGUAGES = {".py": "python", ".yaml": "yaml", ".json": "json"}
_LINK = re.compile(r"(\]\()([^)#\s:]+)(#[^)\s]*)?(\))")
_CODE = re.compile(r"^(`{3,}).*?^\1`*$", re.DOTALL | re.MULTILINE)
_INLINE_CODE = re.compile(r"(?<!</span>)<code>[^<]+</code>")
_COMMANDS = re.compile(r'<div class="language-sh.*?</div>', re.DOTALL)
_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
_SHORT = len("<code></code>") + 20
_CELL = re.compile(r"<td[^>]*>[^<]*")
_UNIT = re.compile(r"(?<=\d) (?=(?:cm|mm|m|ms|s|N|MB|GB|%)(?:\W|$))")
_FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\[\[(](?P<tex>.*?)\\[\])]</(?P=tag)>',
    re.DOTALL,
)


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Adds the pages that come from outside of docs/."""
    texts = {f.src_uri: _docs_text(f) for f in files.documentation_pages()}
    for name, uri in _PAGES.items():
        texts[uri] = (ROOT / name).read_text(encoding="utf-8")
        files.append(File.generated(config, uri, content=texts[uri]))
    linked = {
        path
        for uri, text in texts.items()
        for match in _LINK.finditer(_CODE.sub("", text))
        if (path := _outside(_origin(uri), match[2])) is not None
    }
    for path in sorted(linked - set(_PAGES)):
        files.append(
            File.generated(config, _source_uri(path), content=_source_page(path))
        )


def on_page_markdown(
    markdown: str, page: Page, config: MkDocsConfig, files: Files
) -> str:
    """Lets links out of docs/ lead to the pages of those files."""
    uri = page.file.src_uri

    def mended(match: re.Match[str]) -> str:
        """The link, to the page of the file on the site."""
        start, link, anchor, end = match.groups()
        path = _path(_origin(uri), link)
        if path in _PAGES:
            target = _PAGES[path]
        elif path.startswith("docs/"):
            target = path.removeprefix("docs/")
        elif (ROOT / path).is_file():
            target = _source_uri(path)
        else:
            return match[0]
        here = posixpath.dirname(uri) or "."
        return f"{start}{posixpath.relpath(target, here)}{anchor or ''}{end}"

    return "".join(
        part if n % 2 else _LINK.sub(mended, part)
        for n, part in enumerate(_split_at_code(markdown))
    )


def on_page_content(
    content: str, page: Page, config: MkDocsConfig, files: Files
) -> str:
    """Turns formulas into MathML, and keeps together what is not to be broken up."""

    def drawn(match: re.Match[str]) -> str:
        display = "block" if match["tag"] == "div" else "inline"
        return convert(html.unescape(match["tex"]).strip(), display=display)

    # Drake's own documentation makes a drawing of the block below this line.
    content = content.replace("<p>.. pydrake_system::</p>", "")
    content = _CELL.sub(lambda cell: _UNIT.sub("&nbsp;", cell[0]), content)
    content = _COMMANDS.sub(_whole, _INLINE_CODE.sub(_whole, content))
    return _FORMULA.sub(drawn, content)


def _whole(code: re.Match[str]) -> str:
    """Keeps short code, and the options in longer code, in one line."""
    if len(code[0]) <= _SHORT:
        return code[0].replace("<code>", '<code class="whole">')
    return _OPTION.sub(r'<span class="whole">\g<0></span>', code[0])


def _docs_text(file: File) -> str:
    return (ROOT / "docs" / file.src_uri).read_text(encoding="utf-8")


def _origin(uri: str) -> str:
    """The path in the repository that a page comes from."""
    names = {page: name for name, page in _PAGES.items()}
    return names.get(uri, f"docs/{uri}")


def _path(origin: str, link: str) -> str:
    return posixpath.normpath(posixpath.join(posixpath.dirname(origin), link))


def _outside(origin: str, link: str) -> str | None:
    """The linked file's path in the repository, if it is outside of docs/."""
    path = _path(origin, link)
    return path if not path.startswith("docs/") and (ROOT / path).is_file() else None


def _source_uri(path: str) -> str:
    return f"source/{path}" + ("" if path.endswith(".md") else ".md")


def _source_page(path: str) -> str:
    text = (ROOT / path).read_text(encoding="utf-8")
    if path.endswith(".md"):
        return text
    language = _LANGUAGES.get(Path(path).suffix, "text")
    return f"# `{path}`\n\n````{language}\n{text.rstrip()}\n````\n"


def _split_at_code(text: str) -> list[str]:
    """The text and its code blocks in turn, beginning and ending with text."""
    parts, end = [], 0
    for match in _CODE.finditer(text):
        parts += [text[end : match.start()], match[0]]
        end = match.end()
    return [*parts, text[end:]]
