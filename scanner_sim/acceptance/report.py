"""An acceptance test as plain data and as a page: results, and in what it differs from the standards."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from scanner_sim.acceptance.verdicts import COVERAGE, Accepted, Result, Verdict
from scanner_sim.config.calibration import design_digest
from scanner_sim.foundation.html_text import png_address
from scanner_sim.products.page_template import page_template

RULES = {
    "guarded": "A result passes that lies within its limit by the test's expanded uncertainty U or more, and fails "
    "that lies beyond it by more than U; in between nothing is proved (after ISO 14253-1).",
    "simple": "A result passes within its limit, and fails beyond it; the test's uncertainty is left out of account.",
}
NAMES = {"length": "length", "size": "diameter", "form": "form of sphere", "flatness": "flatness"}

CAPTIONS = {
    "errors.png": "Errors over their limits",
    "places.png": "Where the artefacts stand",
    "deviations.png": "Deviations from the fitted surfaces, first repetition",
}
"""Pictures of the page, by their files."""

DEPARTURES = (
    "Not done: the two-face tests of ASTM E3125. They need an instrument that turns by half a turn and tips over to "
    "see the same targets once more; two galvanometer mirrors have no second face. What they would find, errors of "
    "zeros and axes, must show in lengths here, and some of it, as the zero of φ, shows in no length.",
    "Not done: relative ranges along the line of sight against a reference instrument; bars in depth take their place.",
    "Number and places of the artefacts are those of the plan. The standards prescribe them for a volume; the plan "
    "should say why its own will do.",
    "A sphere's points are those within 60° of the line of sight, the cone of 120° that software after ASTM E3125 "
    "takes; a plate's lie within its edges by two diameters of the beam. Fits are by least squares of orthogonal "
    "distances, of all points alike, with free diameter.",
    "The largest deviations may be left out of a form up to the share that the plan allows. Its default, 0.3 %, is "
    "what VDI/VDE 2634 is usually quoted with.",
    "Points are a beam's diameter apart or more, so that no two show the same speckle.",
    "The uncertainty of the test is that of the certificates. Temperature, mounting and the artefacts' own form are "
    "not in it, and the instrument's own noise is not: it is what is tested.",
    "What is said here of ASTM E3125, VDI/VDE 2634 and ISO 14253-1 is from public descriptions; the standards "
    "themselves were not read, and this is no certificate after them.",
)
"""In what the test differs from the standards after which it is made."""


def remarks(found: Accepted) -> tuple[str, ...]:
    """Return sentences on what makes this test weaker than it looks."""
    coarse = sorted({one.artefact for one in found.results if one.uncertainty > 0.25 * one.limit})
    return (
        (
            f"the certificate of {', '.join(coarse)} has more than a quarter of the limit as expanded uncertainty: "
            "ASTM E3125 asks for four times less",
        )
        if coarse
        else ()
    )


def report(found: Accepted) -> dict[str, object]:
    """Return everything that an acceptance test found, in SI, as plain data."""
    setup = found.setup
    return {
        "software": f"scanner-sim {version('scanner-sim')}",
        "instrument": design_digest(setup.base.scanner),
        "ranging": setup.rangefinder,
        "seed": setup.plan.seed,
        "verdict": str(found.verdict),
        "rule": RULES[setup.plan.rule],
        "coverage_factor": COVERAGE,
        "discarded_share": setup.plan.discarded,
        "tests": [
            {
                "quantity": one.quantity,
                "artefact": one.artefact,
                "verdict": str(found.verdict_of(one)),
                "largest_error_m": one.error,
                "limit_m": one.limit,
            }
            for one in found.tests
        ],
        "results": [_plain(one) for one in found.results],
        "points": {
            name: {"valid": len(fit.points), "used": int(fit.used.sum())} for name, fit in found.fits.items()
        },
        "departures": list(DEPARTURES),
        "remarks": list(remarks(found)),
    }


def _plain(one: Result) -> dict[str, object]:
    numbers = {
        "measured_m": one.measured,
        "reference_m": one.reference,
        "error_m": one.error,
        "sigma_m": one.sigma,
        "sigma_noise_m": one.sigma_noise,
        "sigma_common_m": one.sigma_common,
        "expected_by_noise_m": one.expected,
        "limit_m": one.limit,
        "uncertainty_m": one.uncertainty,
    }
    return {
        "quantity": one.quantity,
        "artefact": one.artefact,
        "repetition": one.repetition,
        **{name: value if value == value else None for name, value in numbers.items()},
        "verdict": str(one.verdict),
    }


def page(found: Accepted, plan_text: str, pictures: Mapping[str, bytes]) -> str:
    """Return the report as one page for a browser, pictures included.

    Parameters
    ----------
    found
        What was tested.
    plan_text
        The plan as it was read.
    pictures
        PNG by file, as of :data:`CAPTIONS`.
    """
    return page_template(Path(__file__).with_name("page.html"), mm=millimetres).render(
        found=found,
        names=NAMES,
        title=title(found.verdict),
        rule=RULES[found.setup.plan.rule],
        version=version("scanner-sim"),
        coverage=COVERAGE,
        departures=DEPARTURES,
        remarks=remarks(found),
        pictures={caption: png_address(pictures[name]) for name, caption in CAPTIONS.items()},
        plan_text=plan_text,
    )


def title(verdict: Verdict) -> str:
    """Return the verdict on an instrument in words."""
    return {
        Verdict.PASSES: "The instrument passes",
        Verdict.UNDECIDED: "Neither passed nor failed: the test's uncertainty leaves it open",
        Verdict.FAILS: "The instrument fails",
    }[verdict]


def millimetres(value: float) -> str:
    """Return a length in millimetres with three decimals; a dash where there is none."""
    return f"{1e3 * value:.3f}" if value == value else "–"
