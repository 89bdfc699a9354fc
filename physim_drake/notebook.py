# SPDX-License-Identifier: MIT
"""HTML by which results show themselves in a notebook."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape

import cv2
import numpy as np
from numpy.typing import NDArray


def image_html(image: NDArray[np.uint8], description: str) -> str:
    """An image inside the page.

    Args:
        image: RGB image, (height, width, 3).
        description: text for those who cannot see it.
    """
    done, data = cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))
    assert done, "a colour image always encodes"
    text = base64.b64encode(data.tobytes()).decode()
    return (
        f'<img src="data:image/png;base64,{text}" alt="{escape(description)}" '
        'style="max-width: 100%">'
    )


def table_html(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of text."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>"
        for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
