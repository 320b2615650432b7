"""An approach as one page for a browser: pictures, the table of conditions and that of epochs are in the file."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from scanner_sim.products.approach import ApproachStudy
from scanner_sim.products.page_template import page_template, picture_address
from scanner_sim.products.pictures.approach import draw_approach, draw_conditions

MOST_EPOCHS = 200
"""Epochs that the page lists; the tables have all."""


def approach_page(study: ApproachStudy, table: list[list[str]], pictures: int) -> str:
    """Return the page of an approach.

    Parameters
    ----------
    study
        The approach.
    table
        Methods over the conditions of Table 1, its heading first.
    pictures
        Number of its lights that are drawn.
    """
    return page_template(Path(__file__).with_name("approach_page.html")).render(
        study=study,
        heading=table[0],
        rows=table[1:],
        by_light=picture_address(partial(draw_conditions, study)),
        epochs=study.epochs[:MOST_EPOCHS],
        pictures=[picture_address(partial(draw_approach, study, orbit=orbit)) for orbit in range(pictures)],
    )
