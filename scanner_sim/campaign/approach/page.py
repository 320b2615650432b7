"""An approach as one page for a browser: pictures, the table of conditions and that of epochs are in the file."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from scanner_sim.campaign.report import in_page
from scanner_sim.foundation.errors import printable
from scanner_sim.products.approach import ApproachStudy
from scanner_sim.products.pictures.approach import draw_approach

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
    pages = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=lambda value: value if hasattr(value, "__html__") else printable(str(value), lines=True),
    )
    return pages.get_template("approach_page.html").render(
        study=study,
        heading=table[0],
        rows=table[1:],
        epochs=study.epochs[:MOST_EPOCHS],
        pictures=[in_page(partial(draw_approach, study, orbit=orbit)) for orbit in range(pictures)],
    )
