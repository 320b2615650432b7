"""How the verbs of studies put their work together: what is asked of whom, which files come, and what is told."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.cli import approaching, budgeting, calibrating
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files import contents
from scanner_sim.signals.named import NamedEstimators
from scanner_sim.signals.processing import PEAKS

# The package gives the names of these modules to its verbs.
orbit: Any = importlib.import_module("scanner_sim.cli.orbit")
pose_study: Any = importlib.import_module("scanner_sim.cli.pose_study")

Told = Callable[[Any], list[Any]]
STUDIES = "scanner_sim.validation.studies"
COMPARE = "scanner_sim.validation.compare"
PICTURES = "scanner_sim.products.pictures"


class MadeCall(SimpleNamespace):
    """A call of a verb whose files are kept: of which kind, and what is in each."""

    def __init__(self, scenario: Any, quiet: bool = False, **more: Any) -> None:
        super().__init__(
            device="dev", quiet=quiet, overwrite=True, warned=[], said=[], kinds=[], files={}, **more
        )
        self._scenario = scenario

    def scenario(self) -> Any:
        return self._scenario

    def claimed(self, kind: Any) -> Any:
        self.kinds.append(kind)
        return nullcontext()

    def work(self, *_: str) -> Any:
        return nullcontext(("advance", self.said.append))

    def write(self, kind: Any, files: Mapping[str, Any]) -> tuple[Path, ...]:
        self.kinds.append(kind)
        self.files = dict(files)
        return tuple(Path("f") / name for name in files)

    def warn(self, sentences: Any) -> None:
        self.warned += sentences


def replaced(monkeypatch: pytest.MonkeyPatch, stubs: Mapping[str, Any]) -> None:
    """Put stubs where their names say."""
    for name, stub in stubs.items():
        monkeypatch.setattr(name, stub)


def named(*names: str) -> dict[str, Any]:
    """Return for each function a stub that gives back its name and what it was given."""

    def stub(name: str) -> Callable[..., Any]:
        return lambda *given, **options: (name.rpartition(".")[2], *given, *options.items())

    return {name: stub(name) for name in names}


@pytest.mark.parametrize(
    ("sweep", "turn", "ways", "dark"),
    [(None, 3e-3, ("triangulation", "tof"), True), ("2 mrad", 2e-3, ("triangulation",), False)],
)
def test_a_budget_is_that_of_the_sweep_that_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
    told: Told,
    sweep: str | None,
    turn: float,
    ways: tuple[str, ...],
    dark: bool,
) -> None:
    """Claim: rows and closed forms are of the beam that turns as asked, or as the scan's columns do; the image is of
    the scan itself, and where both ways meet at rest is of no sweep, between the first and the last range; a picture
    for each way; sources by their share of the image, those without any left out."""
    lines = told(budgeting)
    sky = SimpleNamespace(sky=lambda: SimpleNamespace(dark=dark))
    base: Any = SimpleNamespace(name="base", scanner=SimpleNamespace(rangefinders=("tof", "triangulation")))

    def swept(of: Any, chosen: float | None) -> Any:
        assert of in (base, swept_once.get("one"))
        travel = 3e-3 if chosen is None else chosen
        made = SimpleNamespace(
            travel=travel, raster=SimpleNamespace(travel=travel), rangefinders=ways, lighting=sky
        )
        swept_once.setdefault("one", made)
        return made

    swept_once: dict[str, Any] = {}
    rows = [SimpleNamespace(mode="triangulation", source="all", range_m=1.0)]
    if len(ways) == 2:
        rows.append(SimpleNamespace(mode="fused", source="all", range_m=1.0))
    asked: dict[str, Any] = {}

    def measured(of: Any, distances: Any, reflectance: float, **options: Any) -> Any:
        asked["measured"] = (of.travel, list(distances), reflectance, options)
        return "raw"

    def closed(raw: Any, of: Any, reflectance: float) -> Any:
        asked["closed"] = (raw, of.travel, reflectance)
        return rows

    def crossing(of: Any, reflectance: float, near: float, far: float) -> float:
        asked["crossing"] = (of.travel, reflectance, near, far)
        return 7.0

    shares = {"shot": 0.25, "read": 0.0, "speckle": 0.75}
    dominance = SimpleNamespace(shares=lambda: shares)

    def dominating(of: Any, **options: Any) -> Any:
        assert of is base
        return dominance

    replaced(monkeypatch, {
        f"{STUDIES}.budget.with_sweep": swept,
        f"{STUDIES}.budget.distances_of": lambda of, count: np.array([1.5, 3.0, 9.0]) if count == 3 else None,
        f"{STUDIES}.budget.measure_budget": measured,
        f"{STUDIES}.dominance.dominating": dominating,
        f"{COMPARE}.instrument.with_closed_forms": closed,
        f"{COMPARE}.instrument.closed_crossing": crossing,
        "scanner_sim.products.files.tables.records_csv": lambda given: ("csv", given),
        "scanner_sim.cli.budgeting.budget_json": lambda *given: given,
        "scanner_sim.cli.budgeting.resolved_yaml": lambda of: ("yaml", of),
        "scanner_sim.cli.budgeting.budget_rows": lambda given: ("rows", given),
        "scanner_sim.cli.budgeting._meeting": lambda *given: {"meeting": given},
        **named(*(f"{PICTURES}.budget.draw_{name}" for name in ("budget", "curves", "dominance"))),
    })  # fmt: skip
    call: Any = MadeCall(base)
    budgeting.budget_scenario(call, count=3, reflectance=0.3, sweep=sweep, image=sweep is None)
    assert asked["measured"] == (turn, [1.5, 3.0, 9.0], 0.3, {"device": "dev", "progress": "advance"})
    assert asked["closed"] == ("raw", turn, 0.3)
    both = "tof" in ways
    assert asked.get("crossing") == ((0.0, 0.3, 1.5, 9.0) if both else None)
    light = f"{'dark' if dark else 'lit as the scenario says'}, beam turns by {1e3 * turn:g} mrad"
    given = rows, 0.3, dominance if sweep is None else None, turn
    assert call.files["budget.json"][:4] == given
    at_rest = call.files["budget.json"][4]
    assert at_rest == 7.0 if both else math.isnan(at_rest)
    assert call.files["budget.csv"] == ("csv", rows)
    assert call.files["scenario.yaml"] == ("yaml", base)
    pictures = {name: write("p") for name, write in call.files.items() if name.endswith(".png")}
    lit = ("light", light)
    expected = {"budget.png": ("draw_budget", rows, 0.3, "p", ("mode", "triangulation"), lit)}
    if both:
        expected["budget_tof.png"] = ("draw_budget", rows, 0.3, "p", ("mode", "tof"), lit)
        expected["curves.png"] = ("draw_curves", rows, 0.3, "p", lit)
    if sweep is None:
        expected["dominance.png"] = ("draw_dominance", dominance, "p")
    assert pictures == expected
    assert call.kinds == [contents.BUDGET, contents.BUDGET]
    table, closing = lines
    assert table == ("rows", rows)
    words = f"beam turns by {1e3 * turn:g} mrad"
    assert closing["the beam in a dwell"] == words + (" (as the scan's columns)" if sweep is None else "")
    assert closing["meeting"][:2] == (rows, turn)
    assert closing.get("most of σ") == ("speckle 75 %, shot 25 %" if sweep is None else None)


@pytest.mark.parametrize("quiet", [True, False])
def test_an_orbit_is_told_by_its_shares_and_eclipse(
    monkeypatch: pytest.MonkeyPatch, told: Told, quiet: bool
) -> None:
    lines = told(orbit)
    timeline = SimpleNamespace(
        sun_visible=np.array([1.0, 0.0, 0.5, 0.9]), period=5430.0, times=np.zeros(4), scenario_yaml="yaml",
        warnings=["w"],
    )  # fmt: skip
    asked: list[Any] = []
    replaced(monkeypatch, {
        f"{STUDIES}.sweep.sweep_orbit": lambda *given, **options: (asked.append((given, options)), timeline)[1],
        **named(f"{PICTURES}.timeline.draw_timeline", "scanner_sim.products.timeline.orbit_csv",
                "scanner_sim.products.timeline.orbit_json"),
    })  # fmt: skip
    monkeypatch.setattr(orbit, "share_rows", lambda one: [["share", "u", "v", "the paper"]])
    monkeypatch.setattr(orbit, "print_rows", lambda rows, left: lines.append(rows) or asked.append(left))
    call: Any = MadeCall("scenario", quiet)
    orbit.orbit_scenario(call, steps=77)
    assert asked[0] == (("scenario", 77), {"device": "dev", "progress": "advance"})
    # Words to the left, numbers to the right.
    assert asked[1:] == ([] if quiet else [(0, 3)])
    assert call.kinds == [contents.ORBIT] * 2
    assert call.files["orbit.json"] == ("orbit_json", timeline)
    assert call.files["orbit.csv"] == ("orbit_csv", timeline)
    assert call.files["orbit.png"]("p") == ("draw_timeline", timeline, "p")
    assert call.files["scenario.yaml"] == "yaml"
    assert call.warned == ["w"]
    if quiet:
        assert not lines
        return
    assert lines[0] == [["share", "u", "v", "the paper"]]
    assert lines[1]["orbit"] == "90.5 min in 4 steps, 40.0 % in eclipse"
    assert lines[1]["files"] == "orbit.json, orbit.csv, orbit.png, scenario.yaml"


def test_a_study_of_poses_is_put_together(monkeypatch: pytest.MonkeyPatch, told: Told) -> None:
    """Claim: the plan is of the target that is asked for; closed forms take what its targets erred, and exponents and
    gains the rows with closed forms, about the base array and its size."""
    lines = told(pose_study)
    plan = SimpleNamespace(arrays=("a", "b"))
    where = f"{STUDIES}.pose_study"
    base = SimpleNamespace(name="square", size=1.25)
    replaced(monkeypatch, {
        f"{STUDIES}.target_grid.StudyTarget": SimpleNamespace(of=lambda *given: ("target", *given)),
        f"{where}.plan_study": lambda *given, quick: plan if given == ("s", ("target", "s", 0.05)) and quick else None,
        f"{where}.measure_study": lambda *given, **options: ("pools", "raw") if given[1] is plan and options == {
            "device": "dev", "progress": "advance"} else None,
        f"{where}.target_rows": lambda pools: ("of targets", pools),
        f"{where}.BASE": base, f"{where}.REFERENCE": 11.0,
        f"{COMPARE}.pose_forms.with_closed_forms": lambda *given: ("rows", *given),
        **named(f"{STUDIES}.pose_laws.exponents_of", f"{STUDIES}.pose_laws.gains_of",
                f"{PICTURES}.pose_study.draw_arrays", f"{PICTURES}.pose_study.draw_figure_15",
                "scanner_sim.products.files.tables.records_csv"),
    })  # fmt: skip
    monkeypatch.setattr(pose_study, "study_json", lambda study: ("json", study))
    monkeypatch.setattr(pose_study, "resolved_yaml", lambda scenario: ("yaml", scenario))
    monkeypatch.setattr(pose_study, "exponent_rows", lambda study: ("exponents", study))
    monkeypatch.setattr(pose_study, "gain_rows", lambda study: ("gains", study))
    call: Any = MadeCall("s")
    pose_study.study_scenario(call, diameter=0.05, quick=True)
    targets = ("of targets", "pools")
    rows = ("rows", "raw", ("a", "b"), targets, 11.0)
    exponents = ("exponents_of", rows, "square", 1.25, 11.0)
    gains = ("gains_of", rows, "square", 1.25)
    _, study = call.files["pose_study.json"]
    assert (study.base, study.base_size) == ("square", 1.25)
    assert (study.targets, study.rows, study.exponents, study.gains) == (targets, rows, exponents, gains)
    tables = {"pose_study": rows, "exponents": exponents, "gains": gains, "targets": targets}
    for name, table in tables.items():
        assert call.files[f"{name}.csv"] == ("records_csv", table)
    assert call.files["figure_15.png"]("p") == ("draw_figure_15", study, "p")
    assert call.files["arrays.png"]("p") == ("draw_arrays", study, "p")
    assert call.files["scenario.yaml"] == ("yaml", "s")
    assert lines[:2] == [("exponents", study), ("gains", study)]
    assert call.kinds == [contents.POSE_STUDY] * 2


def test_a_calibration_of_an_estimator_says_what_its_table_leaves(
    monkeypatch: pytest.MonkeyPatch, told: Told, tmp_path: Path
) -> None:
    """Claim: what is left is the error less that of the computed table of the same width, at the place that was found;
    the largest of either sign is told; the table and its picture stand side by side."""
    lines = told(calibrating)
    scenario = SimpleNamespace(processing=SimpleNamespace(peak="gaussian"))
    passages = [
        SimpleNamespace(
            width=1.0 + n, range=2.0 + n, phase=np.array([-0.25, 0.25]), bias=1e-3 * np.array([2.0 + n, -5.0])
        )
        for n in range(3)
    ]  # fmt: skip

    class Computed:
        def at(self, widths: Any, places: Any) -> Any:
            return 1e-3 * widths[:, None] * (1.0 + places)

    asked: list[Any] = []
    written: dict[str, Any] = {}
    monkeypatch.setattr(f"{STUDIES}.calibrate.measure_bias", lambda *given, **options: ("table", passages))
    monkeypatch.setattr(
        "scanner_sim.signals.line.bias.computed_bias", lambda *given: (asked.append(given), Computed())[1]
    )
    monkeypatch.setattr("scanner_sim.signals.line.bias_table.write_bias", lambda *given: given)
    monkeypatch.setattr(f"{PICTURES}.bias.draw_bias", lambda *given: given)
    monkeypatch.setattr(calibrating, "write_files", lambda folder, writers, overwrite: written.update(
        {name: write("p") for name, write in writers.items()}, folder=folder))  # fmt: skip
    call: Any = MadeCall(scenario, output=tmp_path / "u.csv")
    calibrating.calibrate_scenario(call)
    assert asked == [("gaussian", 1.0, 3.0)]
    assert written["folder"] == tmp_path
    assert written["u.csv"] == ("table", "p")
    estimator, curves, _ = written["u.png"]
    assert estimator == "gaussian"
    for curve, one in zip(curves, passages, strict=True):
        left = one.bias - 1e-3 * one.width * (1.0 + one.phase + one.bias)
        np.testing.assert_allclose(curve.left, left)
        np.testing.assert_array_equal(curve.phase, one.phase)
        np.testing.assert_array_equal(curve.bias, one.bias)
        assert curve.label == f"s = {one.width:.2f} px, {one.range:g} m"
    (table,) = lines
    largest = max(np.abs(curve.left).max() for curve in curves)
    assert table["largest error"] == f"0.0050 px; the computed table would leave {largest:.4f} px"
    assert table["measured at"] == "3 places, 1.00 to 3.00 px wide"
    assert table["use"] == "processing.bias_correction: u.csv"
    for output, words in (
        (tmp_path / "u.png", "no name of a table"),
        (tmp_path / "v" / "u.csv", "there is no folder"),
    ):
        with pytest.raises(InputError, match=words):
            calibrating.calibrate_scenario(MadeCall(scenario, output=output))  # type: ignore[arg-type]
    monkeypatch.setattr(type(PEAKS), "is_own", lambda _, name: name == "gaussian")
    with pytest.raises(InputError, match="gaussian is none of them"):
        calibrating.calibrate_scenario(call)


def planned() -> Any:
    """Return an approach of three epochs under two lights."""
    epochs = [SimpleNamespace(time=1.25 * n, distance=9.0 - n) for n in range(3)]
    points = [SimpleNamespace(epoch=epoch, array=f"a{light}") for light in range(2) for epoch in epochs]
    campaign: Any = ["run"] * 1234
    return SimpleNamespace(
        campaign=type("Runs", (list,), {"base": "base"})(campaign), points=points,
        approach=SimpleNamespace(orbits=range(2), base=Path("base.yaml")),
    )  # fmt: skip


@pytest.mark.parametrize("dry", [True, False])
@pytest.mark.parametrize("quiet", [True, False])
def test_an_approach_is_flown(monkeypatch: pytest.MonkeyPatch, told: Told, dry: bool, quiet: bool) -> None:
    """Claim: a dry run shows each epoch once, of whatever many lights, and does nothing; else all runs are done on as
    many workers as asked, in its folder, and the study has the file's name; faults are warned of after the table."""
    lines = told(approaching)
    monkeypatch.setattr(PEAKS, "_functions", {})
    one, folder, asked = planned(), Path("f"), []
    mine = NamedEstimators.of("own_estimators:centroid", None)
    study: Any = SimpleNamespace(faults=["it fell"])
    replaced(monkeypatch, {
        "scanner_sim.campaign.approach.reading.read_approach": lambda file: (
            one if file == Path("u/way.yaml") and PEAKS.function("centroid") else None),
        "scanner_sim.cli.approaching.scenario_warnings": lambda base: [f"of {base}"],
        "scanner_sim.cli.approaching.need_dask": lambda *given: asked.append(("dask", *given)),
        "scanner_sim.cli.approaching.do_runs": lambda campaign, settings, *given: asked.append(
            (campaign, settings.folder, settings.device, settings.estimators, *given)),
        "scanner_sim.campaign.approach.light.epoch_rows": lambda of, **options: ("epochs", of, options["device"]),
        "scanner_sim.campaign.approach.results.study_of": lambda *given: (asked.append(given), study)[1],
        "scanner_sim.campaign.store.reopened": lambda folder: ("store", folder),
        "scanner_sim.campaign.result.CampaignResult": lambda store: SimpleNamespace(table=lambda: ("table", store)),
        "scanner_sim.cli.approaching.write_study": lambda study, folder: (folder / "a.html", folder / "b.csv"),
        "scanner_sim.cli.approaching.condition_table": lambda study: "conditions",
    })  # fmt: skip
    approaching.fly_approach(
        Path("u/way.yaml"), folder, workers=3, peak="own_estimators:centroid", pulse=None, dry_run=dry, device="cpu",
        quiet=quiet,
    )  # fmt: skip
    warned = [] if quiet else ["of base"]
    if dry:
        rows = [
            ["time", "range", "array"],
            *([f"{1.25 * n:.1f} s", f"{9 - n}.000 m", "a0"] for n in range(3)),
        ]
        assert lines == [*warned, rows, {"runs": "1,234", "folder": "f"}]
        assert not asked
        return
    assert asked == [
        ("dask", 3, None), (one.campaign, folder, "cpu", mine, 3, None, quiet),
        ("way", one, ("table", ("store", folder)), ("epochs", one, "cpu")),
    ]  # fmt: skip
    told_at_end = ["conditions", "runs failed: it fell", {"folder": "f", "files": "a.html, b.csv"}]
    assert lines == warned + ([] if quiet else told_at_end)


@pytest.mark.parametrize(
    ("orbits", "pictures"), [(1, ["approach.png"]), (25, [f"approach_{n}.png" for n in range(1, 21)])]
)
def test_an_approach_leaves_tables_and_a_picture_for_each_light(
    monkeypatch: pytest.MonkeyPatch, orbits: int, pictures: list[str]
) -> None:
    """Claim: each table has its rows; at most twenty lights are drawn, each by its number; the page has the same."""
    study: Any = SimpleNamespace(
        orbits=orbits,
        made_by={"p": "1"},
        epochs="e",
        rows="r",
        conditions="c",
        tries="t",
        methods={},
        labels=(),
    )
    written: dict[str, Any] = {}
    replaced(monkeypatch, {
        "scanner_sim.products.page_template.drawn": lambda draw: draw("x"),
        "scanner_sim.products.files.exchange.write_files": lambda folder, writers, overwrite: written.update(
            {name: write("p") for name, write in writers.items()}, folder=folder, overwrite=overwrite),
        "scanner_sim.products.files.folder.write_bytes": lambda path, content: content,
        "scanner_sim.products.files.folder.write_text": lambda path, text: text,
        "scanner_sim.products.files.tables.write_parquet": lambda *given: given,
        "scanner_sim.products.files.tables.records_csv": lambda rows: ("csv", rows),
        "scanner_sim.cli.approaching.condition_table": lambda study: "table",
        **named("scanner_sim.campaign.approach.page.approach_page", "scanner_sim.products.approach.approach_json",
                f"{PICTURES}.approach.draw_approach", f"{PICTURES}.approach.draw_conditions"),
    })  # fmt: skip
    approaching.write_study(study, Path("f"))
    drawn = [("draw_approach", study, "x", ("orbit", number)) for number in range(len(pictures))]
    conditions = ("draw_conditions", study, "x")
    assert [name for name in written if name.startswith("approach") and name.endswith(".png")] == pictures
    assert [written[name] for name in pictures] == drawn
    assert written["conditions.png"] == conditions
    assert written["approach.html"] == ("approach_page", study, "table", conditions, drawn)
    assert written["approach.json"] == ("approach_json", study)
    tables = {"epochs": "e", "approach": "r", "conditions": "c"}
    assert {name: written[f"{name}.csv"] for name in tables} == {
        name: ("csv", rows) for name, rows in tables.items()
    }
    assert written["tries.parquet"] == ("p", "t", {"title": "approach", "versions": {"p": "1"}})
    assert (written["folder"], written["overwrite"]) == (Path("f"), True)


def test_conditions_are_told_method_by_method(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a line for each method in its words, a column for each condition, and below them how many epochs."""
    monkeypatch.setattr(approaching, "_cell", lambda row: f"{row.method}{row.condition}")
    conditions = [
        SimpleNamespace(method=name, condition=number, epochs=3 + number)
        for number in range(2) for name in ("uv", "xyz")
    ]  # fmt: skip
    study: Any = SimpleNamespace(
        methods={"uv": "angles", "xyz": "points"}, conditions=conditions,
        labels=[SimpleNamespace(name="sunny"), SimpleNamespace(name="dark")],
    )  # fmt: skip
    assert approaching.condition_table(study) == [
        ["method", "sunny", "dark"], ["angles", "uv0", "uv1"], ["points", "xyz0", "xyz1"], ["epochs", "3", "4"],
    ]  # fmt: skip
