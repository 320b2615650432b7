"""The table of the page on the error budget, from the judge's closed forms.

Run as ``python docs/budgets.py``; rewrites it in docs/theory/budget.md. A test holds the page to what this makes.
"""

from __future__ import annotations

from pathlib import Path

from made_tables import marked, rewrite

from scanner_sim import load_scenario
from scanner_sim.validation.compare.instrument import closed_budget, closed_crossing
from scanner_sim.validation.studies.budget import distances_of, with_sweep

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "theory" / "budget.md"
_RANGES = (2.0, 5.0, 10.0, 20.0, 30.0)
_SOURCES = (
    "shot",
    "read",
    "quantisation",
    "response",
    "speckle",
    "synchronisation",
    "jitter",
    "wobble",
    "all",
)


def tables() -> str:
    """Return what stands on the page between its marks."""
    scenario = load_scenario(ROOT / "configs" / "plane.yaml", ["ranging=both"])
    rest = with_sweep(scenario, 0.0)
    turn = 1e3 * scenario.raster.travel
    lines = [
        f"| σ of the range [mm], turning by {turn:.2g} mrad | "
        + " | ".join(f"{R:g} m" for R in _RANGES)
        + " |"
    ]
    lines.append("|---" * (1 + len(_RANGES)) + "|")
    for words, one, names in (("", scenario, _SOURCES), (", at rest", rest, ("speckle", "all"))):
        found = [closed_budget(one, 0.5, R) for R in _RANGES]
        lines += [_line(f"{name}{words}", [part["triangulation"][name] for part in found]) for name in names]
        if not words:
            lines.append(_line("time of flight, all", [part["tof"]["all"] for part in found]))
    ends = distances_of(scenario, 2)
    near, far = float(ends[0]), float(ends[-1])
    moving, still = (closed_crossing(one, 0.5, near, far) for one in (scenario, rest))
    told = (
        f"Time of flight is the better one from {moving:.1f} m on, and from {still:.1f} m with the beam at rest: a "
        "sweep averages speckle."
    )
    return marked("docs/budgets.py", ("\n".join(lines), told))


def _line(name: str, values: list[float]) -> str:
    return f"| {name} | " + " | ".join(f"{1e3 * value:.2g}" for value in values) + " |"


def main() -> None:
    """Rewrite the table of the page."""
    rewrite(PAGE, tables())


if __name__ == "__main__":
    main()
