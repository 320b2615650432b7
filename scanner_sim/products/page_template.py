"""Templates of pages for a browser, and pictures that such a page holds itself."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from scanner_sim.foundation.errors import printable
from scanner_sim.foundation.html_text import png_address


def page_template(file: Path, **filters: Callable[..., Any]) -> Template:
    """Return a template in which texts stand to the letter, lines stay lines, and an unknown name is a fault.

    Parameters
    ----------
    file
        The template.
    **filters
        Functions that it uses, by name.
    """
    pages = Environment(
        loader=FileSystemLoader(file.parent),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=lambda value: value if hasattr(value, "__html__") else printable(str(value), lines=True),
    )
    pages.filters.update(filters)
    return pages.get_template(file.name)


def picture_address(draw: Callable[[BinaryIO], None]) -> str:
    """Return what ``draw`` writes, a PNG, as the address of an image that holds it."""
    return png_address(drawn(draw))


def drawn(draw: Callable[[BinaryIO], None]) -> bytes:
    """Return what ``draw`` writes, for a page and a file: matplotlib takes half a second for a picture."""
    stream = io.BytesIO()
    draw(stream)
    return stream.getvalue()
