"""Which laws a comparison leaves out, of which instrument, and why; and which targets it may be asked for."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np
import pytest
from made_settings import GREY, setting

from scanner_sim.config import load_scanner
from scanner_sim.foundation.errors import InputError
from scanner_sim.validation.compare import noise, run
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget, law_name
from scanner_sim.validation.compare.instrument_sheet import alone
from scanner_sim.validation.compare.law import Law, Measured, Predicted, exact
from scanner_sim.validation.compare.laws import LAWS

TOF = {"ranging": "tof"}
WEAK = "too weak at all ranges"
NARROW = [-1e-3, 1e-3]
LONG = ("sigma_shot", "sigma_read", "cramer_rao")
"""Laws that look at every range whether noise is small there, which takes long."""
PULSES = ("tof_range", "tof_bound", "tof_sigma", "tof_walk")
TIMED = (*PULSES, "tof_coverage")
SUN = {"direction": [0.0, 0.5, 1.0]}


@cache
def usual(timed: bool) -> dict[str, str]:
    """Return the reasons of the shipped instrument as it is."""
    return {law.name: law.applies(setting(**(TOF if timed else {}))) for law in LAWS}


def test_the_shipped_instrument_leaves_out_what_it_has_not() -> None:
    """Claim: nothing but departures that it has not, and time of flight where it does not range by it; by time of
    flight alone what needs ranges of the array."""
    left_out = {name for name, reason in usual(False).items() if reason}
    assert left_out == {"departures", *TIMED}
    assert {name for name, reason in usual(True).items() if reason} == {
        "departures",
        "coverage",
        "uneven",
        "pose",
    }
    both = {law.name: law.applies(setting(ranging="both")) for law in LAWS}
    assert {name for name, reason in both.items() if reason} == {"departures"}


@pytest.mark.parametrize(
    ("changes", "reasons"),
    [
        ({"scanner": {"laser": {"speckle": False}}}, {"no speckle": ("speckle_contrast", "speckle_limit")}),
        ({"scanner": {"filter": "none"}}, {"no filter": ("sunlight", "snr")}),
        ({"lighting": {"sun": SUN | {"spectrum": "astm_g173"}}}, {"measured spectrum": ("sunlight", "snr")}),
        ({"lighting": {"sun": SUN | {"spectrum": "planck"}}}, {}),
        ({"processing": {"validation": {"uneven": False}}}, {"switched off": ("uneven",)}),
        ({"processing": {"validation": {"mixed": None}}}, {"switched off": ("uneven",)}),
        ({"processing": {"peak": "centre_of_mass"}}, {"systematic error": ("coverage", "uneven")}),
        ({"processing": {"peak": "gaussian"}}, {"systematic error": ("uneven",)}),
        (
            {"processing": {"peak": "centre_of_mass", "bias_correction": "computed"}},
            {"correction of the estimator has no closed form": ("pose",)},
        ),
        ({"scanner": {"mirrors": {"temperature": {"rate": 1e-6}}}}, {"drift": ("coverage",)}),
        (
            {"scanner": {"mirrors": {"temperature": {"amplitude": "1 K", "period": "1 h"}}}},
            {"drift": ("coverage",)},
        ),
        ({"scanner": {"mirrors": {"synchronisation": "0 rad"}}}, {"no error between": ("sigma_synchronisation",)}),
        ({"scanner": {"mirrors": {"readout_step": "1 mrad"}}}, {"step is larger": ("covariance",)}),
        ({"scanner": {"position_sensor": {"noise": {"saturation": False}}}}, {"switched off": ("saturation",)}),
        (
            {
                "scanner": {"mirrors": {"max_deflection": "2 mrad"}},
                "scan": {"type": "raster", "rows": 4, "columns": 4, "horizontal": NARROW, "vertical": NARROW},
            },
            {"do not reach over 64 voxels": ("uneven",), "do not reach the corners": ("pose",)},
        ),
        (
            {"scanner": {"position_sensor": {"pixels": 50}}},
            {
                "sees no spot at this range": ("saturation", "pose"),
                "too few of the ranges": ("sigma_synchronisation",),
                "fewer than three": ("sigma_shot", "sigma_read"),
            },
        ),
        ({"scanner": {"laser": {"power": "1 nW"}}}, {WEAK: ("sigma_shot", "sigma_read", "cramer_rao")}),
        (TOF | {"scanner": {"lidar": {"pulse": {"shape": "t2_exponential"}}}}, {"no Gaussian": PULSES}),
        (TOF | {"scanner": {"lidar": {"photodiode": {"place": "offset"}}}}, {"along the laser": PULSES}),
        (
            TOF | {"scanner": {"lidar": {"photodiode": {"noise": {"amplifier": False, "quantisation": False}}}}},
            {"have no noise": PULSES},
        ),
        (TOF | {"processing": {"pulse": {"timing": "leading_edge"}}}, {"cautious": ("tof_coverage",)}),
        (TOF | {"processing": {"pulse": {"timing": "constant_fraction"}}}, {"cautious": ("tof_coverage",)}),
    ],
)  # fmt: skip
def test_what_an_instrument_lacks_leaves_out_its_laws_and_no_other(
    changes: dict[str, Any], reasons: dict[str, tuple[str, ...]]
) -> None:
    expected = {name: words for words, names in reasons.items() for name in names}
    told = setting(**changes)
    before = usual("ranging" in changes)
    for law in LAWS:
        if law.name in LONG and law.name not in expected:
            continue
        found = law.applies(told)
        if law.name in expected:
            assert expected[law.name] in found, law.name
        else:
            assert found == before[law.name], law.name


def test_laws_are_asked_for_by_words_and_told_by_titles() -> None:
    """Claim: a name is one word as an option takes it, another for each; titles and statements are sentences."""
    assert len({law.name for law in LAWS}) == len({law.title for law in LAWS}) == len(LAWS)
    for law in LAWS:
        assert law_name(law.name) == law.name
        assert law_name(law.name.replace("_", " ").upper()) == law.name
        assert law.title[0].isupper() or not law.title[0].isalpha()
        assert law.title != law.name
        assert law.statement.endswith(".")
        assert law.source
        assert not law.source.endswith(".")


@pytest.mark.parametrize(("ranges", "sloped"), [((3.0, 9.0, 20.0), True), ((3.0, 9.0), False)])
def test_a_slope_needs_three_ranges(ranges: tuple[float, ...], sloped: bool) -> None:
    told = dataclasses.replace(setting(), target=FlatTarget(GREY, ranges))
    assert bool(told.slopeless()) is not sloped
    reason = next(law for law in LAWS if law.name == "sigma_synchronisation").applies(told)
    assert ("a slope needs 3 ranges" in reason) is not sloped


@pytest.mark.parametrize(
    ("text", "grey", "ranges"),
    [
        ("50 % at 3 m, 10 m", 0.5, (3.0, 10.0)), ("0.125 at 20 m,4 m, 5 m", 0.125, (4.0, 5.0, 20.0)),
        ("7 m", 0.5, (7.0,)), ("100 % at 1 cm, 10 km", 1.0, (0.01, 1e4)),
        (", ".join(f"{R} m" for R in range(7, 107)), 0.5, tuple(map(float, range(7, 107)))),
        ("10 m, 10.01 m", 0.5, (10.0, 10.01)),
    ],
)  # fmt: skip
def test_a_target_is_read_by_its_grey_and_its_ranges(
    text: str, grey: float, ranges: tuple[float, ...]
) -> None:
    """Claim: half of the light where no reflectance is said; ranges ascend."""
    found = FlatTarget.parse(text)
    assert found.reflectance == pytest.approx(grey)
    assert found.ranges == pytest.approx(ranges)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0 % at 3 m", "reflectance of 0 is not"), ("101 % at 3 m", "reflectance of 1.01 is not"),
        ("9.9 mm", "0.01 m to 10000 m"), ("3 m, 10.001 km", "0.01 m to 10000 m"), ("9 mm, 11 km", "0.01 m to 10000 m"),
        (", ".join(f"{R} m" for R in range(7, 108)), "at most 100"), ("10 m, 9 m, 10 m", "same to four digits"),
        ("10 m, 10.001 m", "same to four digits"), ("3 s", "--target: "), ("", "--target: "),
    ],
)  # fmt: skip
def test_targets_that_cannot_be_are_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as fault:
        FlatTarget.parse(text)
    assert "50 % at 3 m, 10 m, 20 m" in fault.value.remedy


def test_targets_of_a_gate_that_begins_at_the_scanner_stand_before_it() -> None:
    """Claim: five ranges even in ratios, from 0.1 m and its margin on; of a gate that begins later from its begin."""
    pulsed = load_scanner("pulsed_scanner")
    for near, first in ((0.0, 0.115), (0.02, 0.023)):
        scanner = pulsed.changed(lidar={"digitiser": {"gate": (near, 200.0)}})
        ranges = ComparisonSetup(alone(scanner)).flat.ranges
        assert ranges[0] == pytest.approx(first, rel=5e-3)
        assert ranges[-1] == pytest.approx(200.0 / 1.15, rel=5e-3)
        assert len(ranges) == 5


def test_a_target_is_told_in_words() -> None:
    assert str(FlatTarget(0.125, (3.0, 10.5))) == "12.5 % at 3 m, 10.5 m"


@pytest.mark.parametrize(
    ("preset", "ends"),
    [
        ("nrc_2000", (1.15 * 1.5625, 25.0)),
        ("close_range_scanner", (1.15 * 0.310974, 1.00556 / 1.15)),
        ("pulsed_scanner", (1.15 * 1.5, 500.0 / 1.15)),
    ],
)
def test_targets_that_nobody_asked_for_go_over_what_is_seen(preset: str, ends: tuple[float, float]) -> None:
    """Claim: five, evenly in logarithms, from 1.15 of the nearest range to 1/1.15 of the farthest, of an array to 25 m;
    three digits, half of the light."""
    told = ComparisonSetup(setting(scanner={"preset": preset}).scenario)
    ranges = told.flat.ranges
    assert told.flat.reflectance == 0.5
    assert told.middle == ranges[2]
    np.testing.assert_allclose(ranges, ends[0] * (ends[1] / ends[0]) ** (np.arange(5) / 4.0), rtol=5e-3)
    assert [float(f"{R:.3g}") for R in ranges] == list(ranges)


def test_seeds_of_measurements_lie_apart_and_shots_are_a_quarter_when_quick() -> None:
    """Claim: consecutive seeds are pooled; no two of a hundred measurements have one in common, and the scenario's own
    moves all of them alike."""
    told = dataclasses.replace(ComparisonSetup(setting().scenario), seeds=3)
    places = [(a, b, c) for a in range(10) for b in range(5) for c in range(2)]
    found = [told.seed(*place) for place in places]
    for first, *others in found:
        assert [other - first for other in others] == [1, 2]
    assert len({seed for seeds in found for seed in seeds}) == 3 * len(places)
    moved = dataclasses.replace(
        told, scenario=told.scenario.model_copy(update={"seed": told.scenario.seed + 5})
    )
    assert [moved.seed(*place)[0] - told.seed(*place)[0] for place in places] == [5] * len(places)
    assert told.shots(4001) == 4001
    assert dataclasses.replace(told, quick=True).shots(4003) == 1000


def test_laws_are_judged_in_their_order_and_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: before each law it is said how many of all are done and which comes; one that does not apply is not
    measured, one that finds nothing says so, and each has the checks of its own cases."""
    measured: list[str] = []

    def law(name: str, reason: str, values: dict[str, float], **more: Any) -> Law:
        def measure(_: ComparisonSetup) -> dict[str, Measured]:
            measured.append(name)
            return {case: exact(value) for case, value in values.items()}

        def predict(_: ComparisonSetup) -> dict[str, Predicted]:
            return {case: Predicted("p", "m", 1.0, 0.1) for case in ("a", "b")}

        source = f"source of {name}"
        return Law(
            name, f"Title of {name}", source, f"It is {name}.", "target", lambda _: reason, measure, predict,
            exercises="light", **more,
        )  # fmt: skip

    laws = (
        law("good", "", {"b": 1.05, "a": 0.99}),
        law("left", "it rains", {"a": 1.0}),
        law("empty", "", {}, nothing="there is nothing"),
        law("bad", "", {"a": 1.5}),
        law("timed", "", {"a": 1.0}, rangefinder="tof"),
        law("needy", "", {"a": 1.0}, needs=("position",)),
    )
    monkeypatch.setattr(run, "LAWS", laws)
    told: list[tuple[int, int]] = []
    said: list[str] = []
    asked = setting(scanner={"preset": "laser_camera_system"})
    found = run.judge_laws(
        asked, level=0.02, progress=lambda done, whole: told.append((done, whole)), say=said.append
    )
    assert told == [(number, 6) for number in range(6)]
    assert said == [f"Title of {law.name}" for law in laws]
    assert measured == ["good", "empty", "bad", "needy"]
    assert [one.name for one in found.findings] == [law.name for law in laws]
    reasons = ["", "it rains", "there is nothing", "", "the instrument has no time-of-flight unit", ""]
    assert [one.reason for one in found.findings] == reasons
    assert [[check.case for check in one.checks] for one in found.findings] == [
        ["b", "a"],
        [],
        [],
        ["a"],
        [],
        ["a"],
    ]
    assert [one.verdict for one in found.findings if one.checks] == ["holds", "broken", "holds"]
    assert [check.simulated for check in found.findings[0].checks] == [1.05, 0.99]
    assert (found.level, found.seed) == (0.02, asked.scenario.seed)
    assert [one.name for one in found.broken] == ["bad"]
    part = run.judge_laws(asked, only=["Bad", "good"], level=0.02)
    assert [one.name for one in part.findings] == ["good", "bad"]
    for level in (0.0, 1.0):
        with pytest.raises(InputError, match="not between 0 and 1"):
            run.judge_laws(asked, level=level)
    with pytest.raises(InputError, match="no law called worse"):
        run.judge_laws(asked, only=["good", "worse"])


@pytest.mark.parametrize(
    ("ranges", "peak", "jumps"),
    [
        ((2.3, 9.0, 20.0), "centre_of_mass", True),
        ((2.0, 2.3, 20.0), "centre_of_mass", True),
        ((1.8, 2.0, 2.3), "centre_of_mass", True),
        ((2.5, 9.0, 20.0), "centre_of_mass", False),
        ((2.3, 9.0, 20.0), "gaussian", False),
    ],
)
def test_one_wide_spot_leaves_out_the_noise_of_the_centre_of_mass(
    monkeypatch: pytest.MonkeyPatch, ranges: tuple[float, ...], peak: str, jumps: bool
) -> None:
    """Claim: spots of more than 1.2 pixel, here nearer than 2.4 m, do not fit into its window; one of the ranges is
    enough. Other estimators have no such window, nor has the bound, which is that of a fit."""
    told = dataclasses.replace(setting(processing={"peak": peak}), target=FlatTarget(GREY, ranges))
    monkeypatch.setattr(noise, "_usable", lambda told, *_: told.flat.ranges)
    for law in LAWS:
        if law.name in LONG:
            reason = law.applies(told)
            assert ("window of the centre of mass jumps" in reason) is (jumps and law.name != "cramer_rao")
