"""Tables of what studies found: each number stands under its heading, in the unit that this says."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.cli import budgeting, differing, reproducing, self_calibrating
from scanner_sim.foundation.errors import Fault, InputError, ScenarioError
from scanner_sim.foundation.status import Status
from scanner_sim.products.pose_study import COMPONENTS
from scanner_sim.render import device
from scanner_sim.validation import reproduce
from scanner_sim.validation.reproduce import Verdict
from scanner_sim.validation.reproduce import run as paper_run
from scanner_sim.validation.reproduce.family import book as family_book

# The package gives the names of these modules to its verbs.
orbit: Any = importlib.import_module("scanner_sim.cli.orbit")
pose_study: Any = importlib.import_module("scanner_sim.cli.pose_study")


def test_a_budget_shows_five_ranges_of_each_source() -> None:
    """Claim: the first, the last and three evenly between; simulated (analytic) in mm, – for what is not known."""
    rows = [
        SimpleNamespace(mode=mode, source=source, range_m=1.0 + number, simulated_m=1e-3 * (number + shift),
                        analytic_m=math.nan if source == "shot" else 2e-3 * number)
        for mode, shift in (("u", 0.1), ("v", 0.3)) for source in ("all", "shot") for number in range(9)
    ]  # fmt: skip
    one = [row for row in rows if row.mode == "u"]
    head, first, second = budgeting.budget_rows(one)  # type: ignore[arg-type]
    assert head[1:] == ["1 m", "3 m", "5 m", "7 m", "9 m"]
    assert first == ["all", "0.1 (0)", "2.1 (4)", "4.1 (8)", "6.1 (12)", "8.1 (16)"]
    assert second == ["shot", "0.1 (–)", "2.1 (–)", "4.1 (–)", "6.1 (–)", "8.1 (–)"]
    names = [row[0] for row in budgeting.budget_rows(rows)]  # type: ignore[arg-type]
    assert names[1:] == ["u: all", "u: shot", "v: all", "v: shot"]
    assert len(budgeting.budget_rows(one[:2])[0]) == 3  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("found", "closed", "sweep", "at_rest", "words"),
    [
        (math.nan, 4.0, 1e-3, 5.0, None),
        (6.0, math.nan, 1e-3, math.nan, "6 m"),
        (6.0, 7.0, 0.0, 5.0, "6 m (closed forms 7 m)"),
        (
            6.0,
            7.0,
            1e-3,
            5.0,
            "6 m (closed forms 7 m); with the beam at rest 5 m, for a sweep averages speckle",
        ),
    ],
)
def test_where_both_ways_are_equally_precise_is_told(
    found: float,
    closed: float,
    sweep: float,
    at_rest: float,
    words: str | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(budgeting, "crossing", lambda _, of: {"simulated_m": found, "analytic_m": closed}[of])
    assert budgeting._meeting([], sweep, at_rest) == ({} if words is None else {"equally precise at": words})


def test_a_sweep_is_an_angle_with_its_unit() -> None:
    assert budgeting._angle("2 mrad") == pytest.approx(2e-3)
    assert budgeting._turn(2.5e-3) == "beam turns by 2.5 mrad"
    assert budgeting._turn(0.0) == "beam at rest"
    with pytest.raises(InputError, match="--sweep: "):
        budgeting._angle("2 mm")


def test_a_difference_is_told_range_by_range(told: Callable[[Any], list[Any]]) -> None:
    """Claim: counts, millimetres, pulls and shares beyond 2, 3 and 5 σ; beneath what normal errors have, 4.6, 0.27 and
    0.000057 %; changes of status by their number, twelve at most, and twelve keys."""
    lines = told(differing)
    numbers = {
        "both": 1234, "only_first": 5, "only_second": 6, "difference_m": {"median": 1e-3, "rms": 2e-3},
        "over_sigma": {"rms": 1.5},
        "share_beyond": {f"{of} sigma": {"found": share} for of, share in ((2, 0.25), (3, 0.125), (5, None))},
    }  # fmt: skip
    moves = {(Status.VALID, other): 10 * int(other) for other in Status if other is not Status.VALID}
    most = max(moves, key=moves.__getitem__)
    found: Any = SimpleNamespace(ranges=[SimpleNamespace(name="u", numbers=lambda: numbers)], statuses=moves)
    differing._print(found, ("a", "b"), [f"k{number}" for number in range(14)])
    (head, first, normal), blank, changes, keys = lines
    assert not blank
    assert head[1:4] == ["both", "only a", "only b"]
    assert head[4:] == ["median", "rms", "rms/σ", "beyond 2 σ", "beyond 3 σ", "beyond 5 σ"]
    assert first == ["u", "1,234", "5", "6", "1 mm", "2 mm", "1.5", "25 %", "12.5 %", "–"]
    assert normal == ["normal errors", *5 * [""], "1", "4.6 %", "0.27 %", "5.7e-05 %"]
    assert next(iter(changes)) == f"valid to {most[1].name.lower()}".replace("_", " ")
    assert next(iter(changes.values())) == f"{moves[most]:,}"
    assert len(changes) == min(12, len(moves))
    assert keys["scenarios differ in"] == ", ".join(f"k{n}" for n in range(12)) + ", … and 2 more"
    lines.clear()
    found.statuses = {}
    differing._print(found, ("a", "b"), [])
    assert lines[2:] == [{"status": "the same everywhere"}, {"scenarios differ in": "nothing"}]


def test_a_self_calibration_is_told_by_value_sigma_and_tolerance(told: Callable[[Any], list[Any]]) -> None:
    """Claim: each parameter with value, σ and tolerance in its unit, and σ over tolerance; five doubted sightings at
    most; how much less each misfit is."""
    lines = told(self_calibrating)
    field = SimpleNamespace(
        sought=("base", "theta_zero"), tolerance={"base": 1e-3, "theta_zero": 2e-4}, sightings=range(8),
        stations=range(3), targets=SimpleNamespace(names=range(5)),
    )  # fmt: skip
    result: Any = SimpleNamespace(
        field=field, values=np.array([2e-4, -1e-4]), sigma=np.array([5e-5, 1e-4]),
        adjusted=SimpleNamespace(unit_weight=1.0325, freedom=17), unobserved=[SimpleNamespace(words="p and q")],
        doubted=[(f"s{n}", f"t{n}", 0.1 * n) for n in range(7)], held_out=None,
        fitted=SimpleNamespace(designed=20.0, calibrated=5.0, improvement=0.75),
    )  # fmt: skip
    setup: Any = SimpleNamespace(plan=SimpleNamespace(sightings="x.csv"))
    self_calibrating._print(setup, result, Path("/f/c.yaml"), ("c.yaml", "c.json"))
    rows, table = lines
    assert rows[0] == ["parameter", "value", "σ", "tolerance", "σ/tolerance"]
    assert rows[1][0] == "base"
    assert rows[1][1:4] == ["0.2 mm", "50 um", "1 mm"]
    assert (rows[1][4], rows[2][4]) == ("0.05", "0.5")
    assert table["sightings"] == "8 of 5 targets from 3 stations, measured"
    assert table["unit weight"] == "1.032 with 17 degrees of freedom"
    assert table["not observed"] == "p and q (its tolerance stays)"
    assert table["doubted (weight)"].startswith("t0 from s0 (0.00), t1 from s1 (0.10)")
    assert table["doubted (weight)"].endswith("t4 from s4 (0.40) and 2 more")
    assert table["misfit of the fitted boards"] == "20 as designed, 5 calibrated, over noise (75 % less)"
    assert "of what was held out" not in table
    assert table["files"] == "/f/c.yaml, /f/c.json"
    assert table["use"] == "processing.calibration: /f/c.yaml"


def test_a_pose_study_is_told_by_component() -> None:
    """Claim: exponents of range of the base array of its own size, and gains by range, component after component, each
    simulated beside its closed form."""
    exponents = [
        SimpleNamespace(of=of, array=array, size_m=size, method="uv", ranging="tof", component=name, simulated=1.0 + n,
                        standard_error=0.1 * n, analytic=2.0 + n, printed=printed)
        for of, array, size, printed in (
            ("range", "b", 1.0, 3.0), ("size", "b", 1.0, 9.0), ("range", "c", 1.0, 9.0), ("range", "b", 2.0, 9.0))
        for n, name in enumerate(COMPONENTS)
    ]  # fmt: skip
    gains = [
        SimpleNamespace(method="joint", ranging="tof", range_m=away, component=name, simulated=away + n, analytic=n,
                        voxel=10.0 * n)
        for away in (20.0, 5.0) for n, name in enumerate(COMPONENTS)
    ]  # fmt: skip
    study: Any = SimpleNamespace(exponents=exponents, gains=gains, base="b", base_size=1.0)
    head, row = pose_study.exponent_rows(study)
    assert row[:2] == ["uv", "tof"]
    assert row[2:-1] == [f"{1.0 + n:.2f} ± {0.1 * n:.2f} ({2.0 + n:.2f})" for n in range(6)]
    assert row[-1] == "R^3"
    assert len(head) == len(row)
    for one in exponents:
        one.printed = math.nan
    assert pose_study.exponent_rows(study)[1][-1] == "–"
    _, near, far = pose_study.gain_rows(study)
    assert near[:3] == ["joint", "tof", "5 m"]
    assert far[:3] == ["joint", "tof", "20 m"]
    assert near[3:-1] == [f"{5.0 + n:.2f} ({n:.2f}; {10.0 * n:.2f})" for n in range(6)]


def test_shares_of_an_orbit_stand_beside_their_estimate() -> None:
    """Claim: a line for each condition, a column for each target, in per cent; an estimate beside its first one."""
    groups = [SimpleNamespace(conditions=(1, 2), estimate="35 %", name="shaded")]
    timeline: Any = SimpleNamespace(
        groups=groups, labels=[SimpleNamespace(name=name) for name in "abc"],
        tracks=[SimpleNamespace(name="u", own=(0.5, 0.25, 0.25)), SimpleNamespace(name="v", own=(0.1, 0.2, 0.7))],
        shares=lambda track: track.own,
    )  # fmt: skip
    assert orbit.share_rows(timeline) == [
        ["share of the orbit", "u", "v", "the paper"], ["a", "50.0 %", "10.0 %", ""],
        ["b", "25.0 %", "20.0 %", "35 % shaded"], ["c", "25.0 %", "70.0 %", ""],
    ]  # fmt: skip


@pytest.mark.parametrize("own", [True, False])
def test_a_self_calibration_leaves_its_files_beside_one_another(
    own: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: sightings of one's own are read, else simulated; targets stand by board and name where they were surveyed;
    calibration, report, tables and three pictures have the name that was asked for."""
    written: dict[str, Any] = {}
    setup: Any = SimpleNamespace(
        plan=SimpleNamespace(sightings="own" if own else None), digest="d", names="n",
        base=SimpleNamespace(scanner="s"), surveyed=lambda: SimpleNamespace(
            names=("p/1", "q/1", "p/2"), places=np.arange(9.0).reshape(3, 3), boards=("p", "q")
        ),
    )  # fmt: skip
    result: Any = SimpleNamespace(calibration="c")
    stubs: dict[str, Any] = {
        "read_setup": lambda plan: setup if plan == Path("x.yaml") else None,
        "simulated_sightings": lambda one, **_: ("simulated", ("lost one",)),
        "read_sightings": lambda *given: ("read", *given),
        "self_calibrate": lambda one, table: result if one is setup else None,
        "calibration_text": lambda *given: given,
        "about": lambda one: "about",
        "report": lambda *given: given,
        "json_text": lambda given: ("json", *given),
        "sightings_text": lambda *given: given,
        "points_text": lambda boards: boards,
        "write_files": lambda folder, writers, overwrite: written.update(
            writers, folder=folder, again=overwrite
        ),
        "write_text": lambda path, text: written.update({path: text}),
    }
    elsewhere = {"simulated_sightings": "simulated", "about": "report", "report": "report"}
    for name, stub in stubs.items():
        if name in elsewhere:
            monkeypatch.setattr(f"scanner_sim.calibration.{elsewhere[name]}.{name}", stub)
        else:
            monkeypatch.setattr(self_calibrating, name, stub)
    self_calibrating.self_calibrate_plan(
        Path("x.yaml"), tmp_path / "u.yaml", device="cpu", overwrite=True, quiet=True
    )
    assert (written.pop("folder"), written.pop("again")) == (tmp_path, True)
    names = [
        "u.yaml",
        "u.json",
        "u_sightings.csv",
        "u_targets.csv",
        "u_field.png",
        "u_residuals.png",
        "u_parameters.png",
    ]
    assert list(written) == names
    drawn = [written[name].func.__name__ for name in names[4:]]
    assert drawn == ["draw_field", "draw_residuals", "draw_parameters"]
    assert all(written[name].args == (result,) for name in names[4:])
    for name in names[:4]:
        written[name](name)
    table = ("read", "own", "d", "n") if own else "simulated"
    assert written["u.yaml"] == ("c", "s", "about")
    assert written["u.json"] == ("json", setup, result, () if own else ("lost one",))
    assert written["u_sightings.csv"] == (table, "d")
    assert written["u_targets.csv"] == {
        "p": {"1": [0.0, 1.0, 2.0], "2": [6.0, 7.0, 8.0]},
        "q": {"1": [3.0, 4.0, 5.0]},
    }
    for wrong, words in (
        (tmp_path / "u.csv", "no name of a calibration"),
        (tmp_path / "v" / "u.yaml", "there is no"),
    ):
        with pytest.raises(InputError, match=words):
            self_calibrating.self_calibrate_plan(
                Path("x.yaml"), wrong, device="cpu", overwrite=True, quiet=True
            )


@pytest.mark.parametrize(("own", "source"), [(True, "table.csv"), (False, "x.yaml")])
def test_a_fault_of_sightings_is_told_of_the_file_that_has_it(
    own: bool, source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: the table of one's own, whose line the fault names; what cannot be simulated is a fault of the plan."""

    def faulty(*_: Any, **__: Any) -> None:
        raise ScenarioError([Fault("range_m", "it is none.", "", 6)], source="table.csv")

    setup: Any = SimpleNamespace(plan=SimpleNamespace(sightings="own" if own else None), digest="", names=())
    monkeypatch.setattr(self_calibrating, "read_setup", lambda _: setup)
    monkeypatch.setattr(self_calibrating, "read_sightings", faulty)
    monkeypatch.setattr("scanner_sim.calibration.simulated.simulated_sightings", faulty)
    with pytest.raises(ScenarioError, match=f"^{source}: 1 fault"):
        self_calibrating.self_calibrate_plan(
            Path("x.yaml"), tmp_path / "u.yaml", device="cpu", overwrite=True, quiet=True
        )


@pytest.mark.parametrize("family", [True, False])
def test_items_are_made_on_the_device_that_is_asked_for(
    family: bool, tmp_path: Path, told: Callable[[Any], list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: the device is taken before anything is made; paper or ledger, with task, items and folder as asked; a line
    for each item counts its verdicts, under those that there are."""
    asked: list[Any] = []
    agrees, differs = Verdict.AGREES, Verdict.DIFFERS
    result = SimpleNamespace(count=lambda verdict: {agrees: 3, differs: 1}.get(verdict, 0))
    other = SimpleNamespace(count=lambda verdict: 2 if verdict is agrees else 0)
    items = [SimpleNamespace(key=key, title=f"of {key}") for key in "uv"]

    def made(folder: Path, task: Any, **options: Any) -> dict[str, Any]:
        options.pop("progress")(1, 2, "u")
        asked.append((folder, task, options))
        return {"u": result, "v": other}

    book = {name: SimpleNamespace(items=items, page=f"{name}.html") for name in ("family", "paper")}
    monkeypatch.setattr(device, "activate", asked.append)
    monkeypatch.setattr(reproduce, "reproduce", made)
    monkeypatch.setattr(family_book, "family", lambda: book["family"])
    monkeypatch.setattr(paper_run, "paper", lambda: book["paper"])
    lines = told(reproducing)
    options: Any = {"family": family, "quick": True, "seed": 7, "overwrite": True}
    reproducing.reproduce_book(tmp_path, ("u", "v"), **options, device="cpu", quiet=False)
    which = "family" if family else "paper"
    assert asked[0] == "cpu"
    folder, task, given = asked[1]
    assert folder == tmp_path
    assert (task.quick, task.device, task.seed) == (True, "cpu", 7)
    assert (task.repository / "configs").is_dir()
    assert given == {"only": ("u", "v"), "anew": True, "book": book[which]}
    rows, table = lines
    assert rows == [
        ["item", "", *(str(one) for one in Verdict if one in (agrees, differs))], ["u", "of u", "3", "1"],
        ["v", "of v", "2", "–"],
    ]  # fmt: skip
    assert table == {"folder": str(tmp_path), "page": f"{which}.html"}
