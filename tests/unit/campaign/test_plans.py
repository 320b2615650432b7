"""Plans: what they say, what is wrong with them, and which runs they make."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from scipy.stats import kstest, loguniform, norm, truncnorm, uniform

from scanner_sim.campaign.plan import Values
from scanner_sim.campaign.reading import impossible_runs, read_campaign
from scanner_sim.campaign.runs import Campaign, dimension_of, drawn_value, number_of
from scanner_sim.foundation import units
from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.foundation.units import Dimension

GROUPS = """\
vary:
  - keys: {scanner.laser.power: [5 mW, 10 mW, 15 mW]}
  - keys:
      "scene.objects.wall.position[2]": {uniform: [5 m, 9 m]}
      processing.threshold: {normal: [6, 0.5], within: [5, 7]}
    sample: sobol
    count: 4
repeat: 2
measure: [sigma_range, valid_share]
"""
RATIO, WATTS = Dimension("1", ("25 %",)), Dimension("W", ("15 mW",))


@pytest.fixture
def write(tmp_path: Path, small_scenario: str):
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")

    def written(text: str, head: str = "schema: 1\nbase: small.yaml\nseed: 7\n") -> Path:
        (tmp_path / "plan.yaml").write_text(head + text, encoding="utf-8")
        return tmp_path / "plan.yaml"

    return written


def drawn(write, values: str, count: int, sample: str = "random") -> np.ndarray:
    text = f"vary:\n  - keys: {{scanner.laser.power: {values}}}\n    sample: {sample}\n    count: {count}\n"
    campaign = read_campaign(write(text))
    return np.array([campaign.scenario(run).scanner.laser.power for run in range(len(campaign))])


def test_groups_are_crossed_keys_are_paired_and_the_repetition_is_fastest(write) -> None:
    campaign = read_campaign(write(GROUPS))
    assert campaign.plan.shape == (3, 4, 2)
    assert len(campaign) == 24
    assert [campaign.place(run) for run in (0, 1, 2, 8)] == [(0, 0, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0)]
    same, other = campaign.values(0), campaign.values(1)
    assert same == other, "repetitions differ in their seed alone"
    powers = {run: campaign.scenario(run).scanner.laser.power for run in (0, 8, 23)}
    assert powers == {0: 0.005, 8: 0.01, 23: 0.015}
    assert len({campaign.seed(run) for run in range(24)}) == 24


def test_a_run_depends_on_the_plan_s_seed_and_its_number_alone(write) -> None:
    """Claim: each run is the same whoever asks, in whatever order, and however the others are asked for."""
    one, other = read_campaign(write(GROUPS)), read_campaign(write(GROUPS))
    forwards = [one.changes(run) for run in range(24)]
    assert [other.changes(run) for run in reversed(range(24))] == forwards[::-1]
    moved = read_campaign(write(GROUPS, "schema: 1\nbase: small.yaml\nseed: 8\n"))
    assert moved.changes(0) != forwards[0]


@pytest.mark.parametrize(
    ("form", "expected"),
    [
        ("{linear: [1 mW, 4 mW], count: 4}", [1e-3, 2e-3, 3e-3, 4e-3]),
        ("{logarithmic: [1 mW, 8 mW], count: 4}", [1e-3, 2e-3, 4e-3, 8e-3]),
        ("[1 mW, 0.5 mW]", [1e-3, 0.5e-3]),
        ("{list: [1 mW]}", [1e-3]),
    ],
)
def test_values_of_each_even_form(write, form: str, expected: list[float]) -> None:
    campaign = read_campaign(write(f"vary: [{{keys: {{scanner.laser.power: {form}}}}}]\n"))
    found = [campaign.scenario(run).scanner.laser.power for run in range(len(campaign))]
    assert found == pytest.approx(expected, rel=1e-12)
    assert found[0] == expected[0], "the ends are exact"
    assert found[-1] == expected[-1]


@pytest.mark.slow
@pytest.mark.parametrize("sample", ["random", "sobol", "latin_hypercube"])
def test_draws_have_their_distribution(write, sample: str) -> None:
    """Claim: 256 draws of each form have the distribution function that the form says.

    Kolmogorov and Smirnov's test at the level 1e-6, with the plan's own seed; its power against a scale wrong by 30 %
    is above 0.99 at 256 draws. Sobol's points and a Latin hypercube lie more evenly than random ones, so that the test
    is on the safe side for them.
    """
    expected = {
        "{uniform: [2 mW, 6 mW]}": uniform(2e-3, 4e-3).cdf,
        "{log_uniform: [1 mW, 100 mW]}": loguniform(1e-3, 0.1).cdf,
        "{normal: [15 mW, 1 mW], within: [14 mW, 18 mW]}": truncnorm(-1.0, 3.0, 15e-3, 1e-3).cdf,
        "{normal: [15 mW, 1 mW]}": truncnorm(-9.0, 9.0, 15e-3, 1e-3).cdf,
    }
    for form, cdf in expected.items():
        assert kstest(drawn(write, form, 256, sample), cdf).pvalue > 1e-6, form


def test_three_turns_are_all_attitudes_alike(write) -> None:
    """Claim: y and z turned evenly and x with an even sine turn any axis anywhere alike: coordinates even from −1 to 1.

    Kolmogorov and Smirnov's test at the level 1e-6 for each of nine, which Sobol's points pass the more easily; of the
    sines of the middle turn one lies in each of 256 equal steps, as Sobol's points have it.
    """
    turns = "[{axis: z, angle: 0 deg}, {axis: x, angle: 0 deg}, {axis: y, angle: 0 deg}]"
    text = (
        f"set: {{lighting: {{orbit: {{attitude: {{rotation: {turns}}}}}}}}}\n"
        "vary:\n  - keys:\n"
        "      lighting.orbit.attitude.rotation[0].angle: {uniform: [-180 deg, 180 deg]}\n"
        "      lighting.orbit.attitude.rotation[1].angle: {sine_uniform: [-90 deg, 90 deg]}\n"
        "      lighting.orbit.attitude.rotation[2].angle: {uniform: [-180 deg, 180 deg]}\n"
        "      lighting.orbit.anomaly: {uniform: [-180 deg, 180 deg]}\n    sample: sobol\n    count: 256\n"
    )
    campaign = read_campaign(write(text))
    orbits = [campaign.scenario(run).lighting.orbit for run in range(256)]
    turned = np.array([orbit.attitude.scanner_from_lvlh() for orbit in orbits if orbit is not None])
    sines = np.sin([orbit.attitude.rotation[1].angle for orbit in orbits if orbit is not None])
    assert sorted(np.floor(128.0 * (sines + 1.0))) == list(range(256))
    for coordinate in turned.reshape(256, 9).T:
        assert kstest(coordinate, uniform(-1.0, 2.0).cdf).pvalue > 1e-6


def test_sobol_s_points_and_hypercubes_fill_every_slice(write) -> None:
    """Claim: of 16 points one lies in each sixteenth of the range, which random ones do once in 900 000 times."""
    for sample in ("sobol", "latin_hypercube"):
        cells = np.floor(16.0 * (drawn(write, "{uniform: [2 mW, 4 mW]}", 16, sample) - 2e-3) / 2e-3)
        assert sorted(cells) == list(range(16)), sample


POWER = "scanner.laser.power"


def of(form: str, rest: str = ", count: 4") -> str:
    """Return a plan's group in which the laser's power has a form of values."""
    return f"vary: [{{keys: {{{POWER}: {form}}}{rest}}}]"


FAULTS = [
    ("sead: 7", "line 4, sead: there is no such key. Did you mean 'seed'?"),
    ("measure: [sigma_rang]", "line 4, measure[0]: 'sigma_rang' is no measure. Did you mean 'sigma_range'?"),
    ("measure: [lost_tracks]", "line 4, measure[0]: 'lost_tracks' is measured of another kind of result"),
    (
        "vary: [{keys: {scanner.laser.powr: [1 mW]}}]",
        "line 4, vary[0], scanner.laser.powr: there is no such key.",
    ),
    (
        "vary: [{keys: {scan.rows: {uniform: [1, 9]}}, count: 2}]",
        "line 4, vary[0], scan.rows: uniform reaches",
    ),
    (
        "vary: [{keys: {scan.rows: [1]}}, {keys: {scan.rows: [2]}}]",
        "line 4, vary[1].keys: scan.rows varies in",
    ),
    (
        "vary: [{keys: {scan.rows: [1], seed: [1, 2]}}]",
        "line 4, vary[0].keys: seed: it has 2 values, and the others",
    ),
    (of("[1 mW, 2 m]", ""), f"line 4, vary[0], {POWER}: 'm' cannot be"),
    (of("[1, 2]", ""), f"line 4, vary[0], {POWER}: 1 has no unit."),
    (
        of("{unifrm: [1 mW, 2 mW]}"),
        f"line 4, vary[0].keys.{POWER}.unifrm: there is no such key. Did you mean",
    ),
    (of("{uniform: [1 mW, 2 m]}"), f"line 4, vary[0], {POWER}: 'm' cannot"),
    (of("{uniform: [1, 2]}"), f"line 4, vary[0], {POWER}: 1 has no unit"),
    (of("{uniform: [2 mW, 1 mW]}"), f"line 4, vary[0], {POWER}: the first value must be below"),
    (of("{uniform: [1 mW, 9 MW]}"), f"line 4, vary[0], {POWER}: uniform reaches"),
    (of("{normal: [1 mW, 1 mW]}"), f"line 4, vary[0], {POWER}: normal reaches"),
    (
        of("{normal: [1 mW, 0 W], within: [1 mW, 2 mW]}"),
        f"line 4, vary[0], {POWER}: the second number of normal",
    ),
    (of("{log_uniform: [0 W, 1 mW]}"), f"line 4, vary[0], {POWER}: log_uniform needs values above 0."),
    (of("{uniform: [1 mW, 2 mW]}", ""), "line 4, vary[0].count: this key is missing"),
    *[
        (
            of("{uniform: [1 mW, 2 mW]}", f", sample: sobol, count: {count}"),
            f"line 4, vary[0].count: Sobol's points are even in powers of two only, and {count} is none. Write {near}.",
        )
        for count, near in ((5, 4), (100, 128), (80, 64))
    ],
    (of("{uniform: [1 mW, 2 mW]}", ", sample: saltelli, count: 12"), "line 4, vary[0].count: Sobol's points"),
    (of("[1 mW, 2 mW]", ", sample: saltelli, count: 16"), "line 4, vary[0].count: nothing is drawn"),
    (
        f"vary: [{{keys: {{{POWER}: {{uniform: [1 mW, 2 mW]}}, scan.rows: [4, 5]}}, sample: saltelli, count: 16}}]",
        "line 4, vary[0].keys: scan.rows: its values are not drawn",
    ),
    (
        f"vary: [{{keys: {{{POWER}: {{uniform: [1 mW, 2 mW]}}}}, sample: saltelli, count: 16}}, "
        "{keys: {seed: [1]}}]",
        "line 4, vary[1].keys: seed: Saltelli's design",
    ),
    (of("{sine_uniform: [1 mW, 2 mW]}"), f"line 4, vary[0], {POWER}: sine_uniform needs angles"),
    *[
        (
            f"set: {{lighting: {{orbit: {{attitude: {{rotation: {{axis: x, angle: 0 deg}}}}}}}}}}\n"
            f"vary: [{{keys: {{lighting.orbit.attitude.rotation.angle: {{sine_uniform: {ends}}}}}, count: 2}}]",
            "sine_uniform needs angles from -90 deg to 90 deg.",
        )
        for ends in ("[-91 deg, 20 deg]", "[-20 deg, 91 deg]")
    ],
    (of("[1 mW, 2 mW]"), "line 4, vary[0].count: nothing is drawn"),
    (of("{linear: [1 mW, 2 mW]}", ""), f"line 4, vary[0].keys.{POWER}.count: linear and"),
    *[
        (
            of(f"{{{form}: {values}, count: 8}}", rest),
            f"line 4, vary[0].keys.{POWER}.count: {form} has none. Remove it.",
        )
        for form, values, rest in (
            ("list", "[1 mW, 2 mW]", ""),
            ("uniform", "[1 mW, 2 mW]", ", count: 4"),
            ("normal", "[9 mW, 1 mW]", ", count: 4"),
        )
    ],
    (
        of("{uniform: [1 mW, 2 mW], within: [1 mW, 2 mW]}"),
        f"line 4, vary[0].keys.{POWER}.within: uniform has its ends",
    ),
    (
        of("{linear: [1 mW, 2 mW], list: [1 mW]}", ""),
        f"line 4, vary[0].keys.{POWER}: it has the forms list and",
    ),
    ("set: {scan.rowz: 3}", "line 4, set, scan.rowz: there is no such key. Did you mean 'rows'?"),
    ("keep: {runs: some}", "line 4, keep.runs: 'some' is not possible here. Possible: none, all."),
    ("keep: {runs: [1.5]}", "line 4, keep.runs[0]: 1.5 is not a whole number."),
    ("keep: {runs: [1]}", "line 4, keep.runs[0]: there is no run 1. They go from 0 to 0."),
    ("base: {}", "in line 2 and again in line 4"),
]


@pytest.mark.parametrize(("text", "words"), FAULTS)
def test_what_is_wrong_with_a_plan_is_said_before_its_first_run(write, text: str, words: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        read_campaign(write(text + "\n"))
    assert any(words in str(fault) for fault in caught.value.faults), caught.value


@pytest.mark.parametrize(
    ("middle", "legal"), [(6.01, True), (5.99, False)], ids=["just beyond six sigma", "just within"]
)
def test_a_normal_distribution_must_be_legal_to_six_sigma(write, middle: float, legal: bool) -> None:
    """Claim: a power is more than nothing, so that with a σ of 1 mW the middle must be more than 6 mW."""
    plan = write(of(f"{{normal: [{middle} mW, 1 mW]}}") + "\n")
    if legal:
        assert len(read_campaign(plan)) == 4
        return
    with pytest.raises(ScenarioError, match="normal reaches") as caught:
        read_campaign(plan)
    assert "within: [first, last]" in caught.value.faults[0].remedy


def test_a_plan_is_no_scenario_and_needs_one(write, tmp_path: Path) -> None:
    for text, words in (
        ("[]\n", "instead of the keys of a plan"),
        ("schema: 1\nbase: none.yaml\n", "there is no file"),
    ):
        (tmp_path / "plan.yaml").write_text(text, encoding="utf-8")
        with pytest.raises(ScenarioError, match=words):
            read_campaign(tmp_path / "plan.yaml")


def test_a_seed_may_be_varied_itself(write) -> None:
    campaign: Campaign = read_campaign(write("vary: [{keys: {seed: [3, 4]}}]\n"))
    assert [campaign.scenario(run).seed for run in range(2)] == [3, 4]


def test_runs_that_contradict_themselves_are_told_and_refuse_no_plan(write) -> None:
    """Claim: a corner of crossed groups that is impossible becomes a row; a plan that has nothing else is refused."""
    text = """\
vary:
  - keys: {scanner.rate: [1 kHz, 5 kHz]}
  - keys: {ranging: [tof], scanner.lidar.pulse.repetition_rate: [RATE]}
measure: [valid_share]
"""
    (sentence,) = impossible_runs(read_campaign(write(text.replace("RATE", "2 kHz"))))
    assert sentence.startswith("run 1 will be a row with its fault: scanner.lidar.pulse.repetition_rate: ")
    assert impossible_runs(read_campaign(write(text.replace("RATE", "20 kHz")))) == ()
    with pytest.raises(ScenarioError, match="every run of the plan"):
        impossible_runs(read_campaign(write(text.replace("RATE", "500 Hz"))))


def test_all_that_is_wrong_with_one_run_is_told_at_once(write) -> None:
    """Claim: two values that stand in one point of a group, neither of them possible, are two faults at their keys."""
    keys = "{scanner.position_sensor.pixels: [256, 4], scanner.laser.power: [15 mW, -1 W]}"
    with pytest.raises(ScenarioError) as error:
        read_campaign(write(f"vary: [{{keys: {keys}}}]\nmeasure: [valid_share]\n"))
    told = [str(fault) for fault in error.value.faults]
    assert len(told) == 2
    for key in (
        "scanner.position_sensor.pixels: 4 is not possible",
        "scanner.laser.power: -1 W is not possible",
    ):
        assert sum(key in one for one in told) == 1


@pytest.mark.parametrize("share", [1e-3, 0.2, 0.5, 0.97])
def test_a_draw_is_the_quantile_of_its_share(share: float) -> None:
    """Claim: SciPy's quantiles, of a normal distribution that is cut off on one side more than on the other too; of an
    angle with an even sine s the share (1 + s)/2."""
    cases = [
        (Values(uniform=(2.0, 6.0)), uniform(2.0, 4.0)),
        (Values(log_uniform=(1.0, 100.0)), loguniform(1.0, 100.0)),
        (Values(normal=(15.0, 2.0)), norm(15.0, 2.0)),
        (Values(normal=(15.0, 2.0), within=(14.0, 21.0)), truncnorm(-0.5, 3.0, 15.0, 2.0)),
    ]
    for values, law in cases:
        assert drawn_value(values, None, share) == pytest.approx(law.ppf(share), rel=1e-12)
    turn = drawn_value(
        Values(sine_uniform=("-90 deg", "90 deg")), Dimension("rad", ("15 deg",), ("deg", "rad")), share
    )
    assert 0.5 * (1.0 + math.sin(turn)) == pytest.approx(share, rel=1e-9)


@pytest.mark.parametrize(
    ("value", "dimension", "number"),
    [
        (3, None, 3.0), (2.5, None, 2.5), (0.25, RATIO, 0.25), ("25 %", RATIO, 0.25), ("20 mW", WATTS, 0.02),
        (True, None, "'True' is not a number"), ("3", None, "'3' is not a number"), ([1], RATIO, "is not a number"),
        (0.02, WATTS, "0.02 has no unit; write for example"),
    ],
)  # fmt: skip
def test_a_bound_is_a_number_with_its_unit(
    value: object, dimension: Dimension | None, number: float | str
) -> None:
    """Claim: in SI units; a share may be bare, and so may what has no dimension."""
    if isinstance(number, float):
        assert number_of(value, dimension) == pytest.approx(number)
        return
    with pytest.raises(ValueError, match=re.escape(number)):
        number_of(value, dimension)


@pytest.mark.parametrize("name", ["Length", "Angle", "Frequency", "Time", "Current", "AnglePerKelvin"])
def test_no_bound_of_a_quantity_is_bare(name: str) -> None:
    """Claim: nobody can tell the degrees or millimetres of a plan from radians and metres; an integer is as bare."""
    (dimension,) = (one for one in get_args(getattr(units, name)) if isinstance(one, Dimension))
    for bare in (0.3, 15, 0):
        words = f"{bare} has no unit; write for example {dimension.examples[0]}"
        with pytest.raises(ValueError, match=words):
            number_of(bare, dimension)


@pytest.mark.parametrize(
    ("key", "ends", "unit"),
    [
        ("scanner.receiver.focus_distance", "[1 m, 9 m]", "m"),
        ("scanner.receiver.array_tilt", "[-5 deg, 5 deg]", "rad"),
        ("scanner.as_built.theta_zero", "[-1 mrad, 1 mrad]", "rad"),
        ("scanner.laser.power", "[1 mW, 2 mW]", "W"),
    ],
)
def test_a_key_that_may_be_a_word_or_a_map_is_drawn_in_its_unit(
    write, key: str, ends: str, unit: str
) -> None:
    """Claim: what is a number with a unit beside something else varies as that number does, between its ends."""
    campaign = read_campaign(write(f"vary: [{{keys: {{{key}: {{uniform: {ends}}}}}, count: 8}}]\n"))
    dimension = dimension_of(campaign.base, key)
    assert dimension is not None
    assert dimension.unit == unit
    low, high = (dimension.parse(end) for end in ends[1:-1].split(", "))
    drawn_there = [dimension.parse(str(campaign.values(run)[key])) for run in range(len(campaign))]
    assert low < min(drawn_there) < max(drawn_there) < high


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ("\n        - 5 mW\n        - -3 mW\n", 8),
        (" {uniform: [-4 mW, -3 mW]}\n    count: 2\n", 6),
    ],
)
def test_an_impossible_value_is_told_with_its_line(write, values: str, line: int) -> None:
    """Claim: of a list the entry, of a distribution the key."""
    with pytest.raises(ScenarioError) as caught:
        read_campaign(write(f"vary:\n  - keys:\n      scanner.laser.power:{values}"))
    assert [fault.line for fault in caught.value.faults] == [line]
