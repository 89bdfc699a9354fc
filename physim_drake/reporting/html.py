# SPDX-License-Identifier: MIT
"""Renders pages from templates, and embeds pictures in them."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import matplotlib
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import NDArray

# Colour that matplotlib draws with, which the page replaces by that of its text.
_INK = "#010203"
_INKED = (
    "axes.edgecolor",
    "axes.labelcolor",
    "axes.titlecolor",
    "grid.color",
    "legend.labelcolor",
    "text.color",
    "xtick.color",
    "ytick.color",
)
_SVG_STYLE: Any = {
    **dict.fromkeys(_INKED, _INK),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "font.size": 9.0,
    "legend.frameon": False,
    "savefig.facecolor": "none",
    "svg.fonttype": "none",
    "svg.hashsalt": "physim-drake",
}


def render_page(template: str, **values: Any) -> str:
    """Fills in one of this package's templates."""
    environment = Environment(
        loader=PackageLoader("physim_drake.reporting", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**values)


def png(figure: Figure) -> str:
    """A figure as a PNG file in base64."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return base64.b64encode(buffer.getvalue()).decode()


def jpeg(image: NDArray[np.uint8], scale: float = 1.0) -> str:
    """An image (height, width, 3), RGB, as a JPEG file in base64.

    Args:
        image: image to encode.
        scale: factor by which its size changes.
    """
    if scale != 1.0:
        way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        image = np.asarray(
            cv2.resize(image, None, fx=scale, fy=scale, interpolation=way),
            dtype=np.uint8,
        )
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(image[:, :, ::-1]))
    assert done, "a colour image always encodes"
    return base64.b64encode(data.tobytes()).decode()


@contextmanager
def page_style() -> Iterator[None]:
    """Figures made and encoded by `svg` within it look like part of the page."""
    with matplotlib.rc_context(_SVG_STYLE):
        yield


def svg(figure: Figure, description: str) -> Markup:
    """A figure as SVG to be put into a page, in whose colour it writes.

    Args:
        figure: a figure made within `page_style`; this call must be within it as well.
        description: text for readers who cannot see it.
    """
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :].replace(_INK, "currentColor")
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text)
    sizes = re.compile(r'(<svg [^>]*?)height="([\d.]+)pt"([^>]*?)width="([\d.]+)pt"')
    named = Markup(r'\1\3role="img" aria-label="{}" style="max-width:\4pt"')
    return Markup(sizes.sub(named.format(description), text, count=1))
