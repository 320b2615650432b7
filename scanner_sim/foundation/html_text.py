"""What a notebook shows of a result: small pieces of HTML that need nothing else, with every text escaped."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape

from scanner_sim.foundation.errors import printable

_CELL = "text-align:left;vertical-align:top;padding:1px 10px 1px 0"


def html_text(text: object) -> str:
    """Return a text as HTML shows it: no markup of its own, nothing that steers the reader."""
    return escape(printable(str(text)))


def html_box(title: str, *parts: str) -> str:
    """Return pieces of HTML under a heading, which is a text."""
    return f'<div style="max-width:60em"><b>{html_text(title)}</b>{"".join(parts)}</div>'


def html_rows(rows: Sequence[Sequence[object]], heading: Sequence[str] = ()) -> str:
    """Return a table of texts, with a heading or without."""
    cells = [(heading, "th")] if heading else []
    cells += [([str(cell) for cell in row], "td") for row in rows]
    lines = (
        "<tr>" + "".join(f'<{kind} style="{_CELL}">{html_text(cell)}</{kind}>' for cell in row) + "</tr>"
        for row, kind in cells
    )
    return f"<table>{''.join(lines)}</table>"


def html_folded(title: str, part: str) -> str:
    """Return a piece of HTML that a click on its title opens."""
    return f"<details><summary>{html_text(title)}</summary>{part}</details>"


def html_picture(png: bytes, title: str, width: int) -> str:
    """Return a picture of so many dots across [px] in the page itself, its dots as squares."""
    style = f"width:{width}px;image-rendering:pixelated;display:block;margin:4px 0"
    return f'<img alt="{html_text(title)}" style="{style}" src="{png_address(png)}">'


def png_address(png: bytes) -> str:
    """Return a picture as the address of an image that holds it."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")
