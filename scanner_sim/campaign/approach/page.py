"""An approach as one page for a browser: pictures, the table of conditions and that of epochs are in the file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from scanner_sim.foundation.html_text import png_address
from scanner_sim.products.approach import ApproachStudy
from scanner_sim.products.page_template import page_template

MOST_EPOCHS = 200
"""Epochs that the page lists; the tables have all."""


def approach_page(
    study: ApproachStudy, table: list[list[str]], by_light: bytes, pictures: Sequence[bytes]
) -> str:
    """Return the page of an approach.

    Parameters
    ----------
    study
        The approach.
    table
        Methods over the conditions of Table 1, its heading first.
    by_light
        The picture of its conditions, a PNG.
    pictures
        Those of its lights.
    """
    return page_template(Path(__file__).with_name("approach_page.html")).render(
        study=study,
        heading=table[0],
        rows=table[1:],
        by_light=png_address(by_light),
        epochs=study.epochs[:MOST_EPOCHS],
        pictures=[png_address(picture) for picture in pictures],
    )
