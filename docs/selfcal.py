"""Table and pictures of the guide to self-calibration: which field determines which parameter.

Run as ``python docs/selfcal.py``; rewrites the table in docs/guides/selfcal.md, and docs/pictures/selfcal_*.png.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from made_tables import rewrite_table

from scanner_sim.calibration.pictures import draw_field, draw_parameters, draw_residuals
from scanner_sim.calibration.plan import Station
from scanner_sim.calibration.selfcal import SelfCalibrated, self_calibrate
from scanner_sim.calibration.setup import Setup, read_setup
from scanner_sim.calibration.simulated import simulated_sightings

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "guides" / "selfcal.md"
PLAN = ROOT / "configs" / "calibration" / "two_boards.yaml"


def fields(setup: Setup) -> Iterator[tuple[str, Setup]]:
    """Yield fields from the poorest to the shipped one, each with its name."""
    upright, *others = setup.plan.stations
    back = Station(name="back", position=(0.0, 0.0, -0.9))
    yield "one board, one station", _with(setup, ("near",), (upright,))
    yield "the same, from two distances", _with(setup, ("near",), (upright, back))
    yield "two boards, one station", _with(setup, ("near", "far"), (upright,))
    yield "two boards, two distances", _with(setup, ("near", "far"), (upright, back))
    yield "two boards, four turned stations", _with(setup, ("near", "far"), (upright, *others))
    yield "the same, and a scale bar", _with(setup, ("near", "far"), (upright, *others), bars=True)


def _with(setup: Setup, boards: Sequence[str], stations: Sequence[Station], *, bars: bool = False) -> Setup:
    plan = setup.plan.changed(
        boards=tuple(board for board in setup.plan.boards if board.name in boards),
        stations=tuple(stations),
        scale_bars=setup.plan.scale_bars if bars else (),
    )
    return replace(setup, plan=plan, places={name: setup.places[name] for name in boards})


def main() -> None:
    """Calibrate in each field; write the table, and draw the shipped one."""
    setup = read_setup(PLAN)
    head = ["σ / tolerance", *(f"`{name}`" for name in setup.plan.parameters.given), "not observed"]
    rows = []
    for name, field in fields(setup):
        table, _ = simulated_sightings(field, device="cpu")
        rows.append([name, *_cells(self_calibrate(field, table))])
    rewrite_table(PAGE, "docs/selfcal.py", head, rows)
    result = self_calibrate(setup, simulated_sightings(setup, device="cpu")[0])
    for name, draw in (("field", draw_field), ("residuals", draw_residuals), ("parameters", draw_parameters)):
        draw(result, ROOT / "docs" / "pictures" / f"selfcal_{name}.png")


def _cells(result: SelfCalibrated) -> list[str]:
    shares = [
        f"{sigma / result.field.tolerance[name]:.2g}"
        for name, sigma in zip(result.field.sought, result.sigma, strict=True)
    ]
    return [*shares, "; ".join(one.words for one in result.unobserved)]


if __name__ == "__main__":
    main()
