"""The verb ``budget``: sources alone and together, simulated beside closed forms, and what dominates an image."""

from __future__ import annotations

import csv
import importlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import claims
import numpy as np
import pytest
from PIL import Image
from scipy.stats import chi2
from typer.testing import CliRunner

from scanner_sim import load_scenario
from scanner_sim.analytic import geometry
from scanner_sim.analytic.beam import beam_radius
from scanner_sim.analytic.budget import InstrumentNumbers, range_budget
from scanner_sim.analytic.estimators import blais_rioux
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.analytic.time_of_flight import crossing_range
from scanner_sim.cli import app
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.products.budget import crossing
from scanner_sim.validation.compare.instrument import closed_crossing, instrument_of, with_closed_forms
from scanner_sim.validation.studies.budget import HALF, measure_budget, with_sweep
from scanner_sim.validation.studies.budget_sources import sources_of
from scanner_sim.validation.studies.dominance import dominating

WALL = """\
schema: 1
seed: 3
scene:
  objects:
    - {name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 8 m], material: {reflectance: 0.5}}
scan: {type: raster, rows: 24, columns: 24, horizontal: [-5 deg, 5 deg], vertical: [-5 deg, 5 deg]}
"""

pytestmark = pytest.mark.usefixtures("device")


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "wall.yaml"
    path.write_text(WALL, encoding="utf-8")
    return path


STUDY = importlib.import_module("scanner_sim.validation.studies.budget")


@pytest.fixture
def few_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spots at two places in a pixel: what is looked at is the folder."""
    monkeypatch.setattr(STUDY, "PIXEL_PHASES", 2)


@pytest.fixture
def simulate_only(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Leaves out sources that are not asked after; each is simulated by itself, so that the others stay as they are."""

    def chosen(*names: str, modes: tuple[str, ...] = ("triangulation", "tof", "fused")) -> None:
        monkeypatch.setattr(
            STUDY,
            "sources_of",
            lambda scenario, mode: tuple(
                name for name in sources_of(scenario, mode) if mode in modes and (not names or name in names)
            ),
        )

    return chosen


@pytest.mark.slow
def test_budget_writes_its_folder(config: Path, few_places: None) -> None:
    result = invoke("budget", config, "-o", "out", "--distances", 2, "--image", "--device", "cpu")
    assert result.exit_code == 0, result.output
    assert "speckle" in result.output
    for name in ("budget.png", "dominance.png"):
        with Image.open(Path("out", name)) as picture:
            assert picture.width > 600
    told = json.loads(Path("out/budget.json").read_text(encoding="utf-8"))
    with open("out/budget.csv", encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    names = {*sources_of(load_scenario(config)), "speckle_all_diffusion", "speckle_all_aberration"}
    assert len(rows) == len(told["rows"]) == 2 * len(names)
    assert {row["source"] for row in rows} == names
    assert told["sweep_rad"] == pytest.approx(np.radians(10.0) / 23)
    assert "beam turns by 7.59 mrad (as the scan's columns)" in result.output
    assert {row["mode"] for row in rows} == {"triangulation"}
    assert sum(told["share_of_voxels_dominated"].values()) == pytest.approx(1.0)
    again = invoke("budget", config, "-o", "out", "--distances", 2)
    assert again.exit_code == 2
    assert "already holds a result" in again.output


@pytest.mark.slow
def test_both_ways_have_their_files(config: Path, few_places: None) -> None:
    result = invoke(
        "budget", config, "-o", "out", "--distances", 2, "--set", "ranging=both", "--device", "cpu"
    )
    assert result.exit_code == 0, result.output
    assert "tof: amplifier" in result.output
    assert "equally precise at" in result.output
    for name in ("budget.png", "budget_tof.png", "curves.png"):
        with Image.open(Path("out", name)) as picture:
            assert picture.width > 600
    told = json.loads(Path("out/budget.json").read_text(encoding="utf-8"))
    assert {row["mode"] for row in told["rows"]} == {"triangulation", "tof", "fused"}
    assert told["crossing"]["simulated_m"] == pytest.approx(told["crossing"]["analytic_m"], rel=0.1)


@pytest.mark.slow
def test_the_sweep_can_be_chosen(config: Path, few_places: None) -> None:
    """Claim: the sweep averages speckle, moves the crossing, and the output says both."""
    scenario = load_scenario(config, ["ranging=both"])
    near, far = 2.0, 30.0
    rest, fast = (closed_crossing(with_sweep(scenario, sweep), 0.5, near, far) for sweep in (0.0, 5e-3))
    assert rest < 0.9 * fast
    assert with_sweep(scenario, None) is scenario
    assert [with_sweep(scenario, sweep).raster.travel for sweep in (0.0, 5e-3)] == pytest.approx([0.0, 5e-3])
    for wrong, word in (("5", "no unit"), ("5 rad", "is not between"), ("-1 mrad", "is not between")):
        refused = invoke("budget", config, "-o", "out", f"--sweep={wrong}")
        assert refused.exit_code == 2
        assert word in refused.output
    options = ("--set", "ranging=both", "--device", "cpu", "--sweep", "2 mrad")
    result = invoke("budget", config, "-o", "out", "--distances", 2, *options)
    assert result.exit_code == 0, result.output
    assert "beam turns by 2 mrad" in result.output
    assert "with the beam at rest" in result.output
    told = json.loads(Path("out/budget.json").read_text(encoding="utf-8"))
    assert told["sweep_rad"] == pytest.approx(2e-3)
    assert told["crossing"]["at_rest_m"] < 0.9 * told["crossing"]["analytic_m"]


def test_a_sweep_over_a_flat_target_leaves_its_range(
    config: Path, simulate_only: Callable[..., None]
) -> None:
    """Claim: of the R (1 − d²/R²) δ²/12 that the mean place of a beam on a facing plane errs by (eq 1, second order,
    without the change of light), 0.33 mm at 10 m with 20 mrad, a hundredth is left at most."""
    scenario = with_sweep(load_scenario(config), 20e-3)
    d = scenario.scanner.receiver.baseline
    simulate_only("estimator")
    for row in measure_budget(scenario, np.array([4.0, 10.0]), 0.5, device="cpu"):
        curve = (row.range_m - d**2 / row.range_m) * 20e-3**2 / 12.0
        assert row.simulated_m < 0.01 * curve, row


def test_distances_do_not_know_one_another(config: Path, simulate_only: Callable[..., None]) -> None:
    """Claim: what is told of 3 m is the same whether 12 m are measured in the same launch or 30 m in another one, in
    the dark and in sunlight.

    Tolerance: plates of other sizes round elsewhere in single precision; sunlight on them is rendered, to 3 % of what
    it adds.
    """
    sun = "lighting.sun={direction: [0.3, 0.0, -0.95]}"
    scenario = load_scenario(config, ["ranging=both", sun])
    simulate_only("shot", "read", "speckle", "clock", "sun")
    near, alone = (
        [
            row
            for row in measure_budget(scenario, np.array([3.0, far]), 0.5, device="cpu")
            if row.range_m == 3.0
        ]
        for far in (12.0, 30.0)
    )
    assert len(near) == 7
    for one, other in zip(near, alone, strict=True):
        assert (one.mode, one.source) == (other.mode, other.source)
        close = 0.03 if one.source == "sun" else 1e-3
        assert one.simulated_m == pytest.approx(other.simulated_m, rel=close), one.source


@pytest.mark.slow
def test_jitter_and_wobble_are_lifted_from_the_rounding(
    config: Path, simulate_only: Callable[..., None]
) -> None:
    """Claim: at 30 m, where single precision rounds by 13 µm, jitter (7.1 µm) and wobble (2.7 µm) are the closed form.

    Set-up: the grid of shots includes the ends of the field, so that the root mean square of its deflections is 6 %
    above that of the field. Both roundings of a difference are divided by 32 as it is. Tolerance: 4 standard errors of
    a standard deviation of 4 · 490 shots.
    """
    scenario = load_scenario(config)
    instrument = instrument_of(scenario, 0.5, HALF)
    expected = range_budget(instrument, 30.0)
    # Fourteen columns from end to end, 7.59 mrad apart.
    theta = math.radians(10.0) / 23.0 * (np.arange(14) - 6.5)
    ends = math.sqrt(np.mean((instrument.baseline - 30.0 * theta) ** 2))
    ends /= math.hypot(instrument.baseline, 30.0 * HALF / math.sqrt(3.0))
    simulate_only("jitter", "wobble")
    found = {
        row.source: row.simulated_m for row in measure_budget(scenario, np.array([30.0]), 0.5, device="cpu")
    }
    for name in ("jitter", "wobble"):
        wanted = math.hypot(expected[name] * ends, math.sqrt(2.0) * 13e-6 / 32.0)
        assert found[name] == pytest.approx(wanted, rel=4.0 / math.sqrt(2.0 * 4.0 * 490.0)), name


def test_an_array_that_sees_too_little_is_refused(config: Path) -> None:
    result = invoke("budget", config, "-o", "out", "--set", "scanner.position_sensor.pixels=8")
    assert result.exit_code == 2
    assert "the array sees ranges from" in result.output
    assert not Path("out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("peak", "laser_off", "distances"),
    [
        ("maximum_likelihood", 0.0, (7.0, 20.0)),
        ("maximum_likelihood", 0.4, (20.0,)),
        ("gaussian", 0.0, (7.0,)),
        ("blais_rioux_4", 0.0, (7.0,)),
    ],
)
def test_simulated_is_analytic(
    config: Path, peak: str, laser_off: float, distances: tuple[float, ...]
) -> None:
    """Claim: the closed forms are what is simulated, source by source.

    Set-up: the preset at 7 or 20 m, reflectance 0.5, 1936 shots for each source. Expected: equal. Tolerance, at a
    level of 10⁻⁴ for each: χ² of the 1932 degrees of freedom of shot, read and quantisation noise, the angle between
    projection and reception, and speckle; 5 % for the four places at which the simulation stands for all in the pixel.
    The pixels' response has one pattern for each place: χ² of four degrees of freedom, and so has its part of all
    together, beside the 1932 of the rest. The bias of ``blais_rioux_4`` is the judge's over these plates: 5 %. Where
    the laser is off for a part of the dwell, the dark line is subtracted although nothing shines; its quantisation
    alone, without noise that moves it from step to step, is the same number in each pixel: it is left out there.
    """
    scenario = load_scenario(config, [f"processing.peak={peak}", f"scanner.laser_off={laser_off}"])
    bench = instrument_of(scenario, 0.5, HALF)
    rows = measure_budget(scenario, np.array(distances), 0.5, device="cpu")
    separation = scenario.scanner.mirrors.axis_separation
    for row in rows:
        budget = range_budget(bench, row.range_m)
        expected = budget[row.source]
        if laser_off and row.source == "quantisation":
            continue
        if row.source in ("shot", "read", "quantisation", "synchronisation", "speckle"):
            many = (row.freedom, np.inf)
            assert claims.scatter_ratio(row.simulated_m, expected, many, slack=0.05), row.source
            assert row.low_m < row.simulated_m < row.high_m < 1.1 * row.simulated_m
        elif row.source == "response":
            assert claims.scatter_ratio(row.simulated_m, expected, (row.freedom, np.inf), slack=0.05)
        elif row.source == "all":
            rest = expected**2 - budget["response"] ** 2
            ends = ([0.5 * claims.LEVEL, 1.0 - 0.5 * claims.LEVEL], 1932), ([0.25e-4, 1.0 - 0.25e-4], 4)
            (low, high), (least, most) = (chi2.ppf(*end) / end[1] for end in ends)
            part = budget["response"] ** 2
            assert 0.95**2 * (low * rest + least * part) < row.simulated_m**2
            assert row.simulated_m**2 < 1.05**2 * (high * rest + most * part)
        elif row.source == "estimator" and peak == "blais_rioux_4":
            assert row.simulated_m == pytest.approx(
                bias_at_four_places(bench, row.range_m, separation), rel=0.05
            )


def bias_at_four_places(bench: InstrumentNumbers, distance: float, separation: float) -> float:
    """Return the root mean square bias of ``blais_rioux_4`` [m] at the places of the budget, and at no others.

    Each place is that of the shot straight ahead; over the plate, which is flat, the spot moves by a part of a pixel.
    """
    beam = bench.waist_radius, bench.waist_distance, bench.wavelength, bench.m_squared
    image = 0.5 * float(beam_radius(distance, *beam)) * bench.array.focal_length / distance
    along = float(np.sqrt(image**2 + bench.aberration**2 + bench.diffusion**2)) / bench.pitch
    angles = np.linspace(-HALF, HALF, 22)
    theta, phi = (angle.ravel() for angle in np.meshgrid(angles, angles))
    optics = bench.array.focal_length, bench.array.baseline
    flat = geometry.range_to_plane(theta, phi, separation, (0.0, 0.0, distance), (0.0, 0.0, -1.0))
    moved = (
        geometry.image_position(flat, theta, *optics) - geometry.image_position(distance, 0.0, *optics)
    ) / bench.pitch
    per_pixel = geometry.range_error(flat, theta, *optics, bench.pitch)
    means = []
    for place in (np.arange(4) + 0.5) / 4 - 0.5:
        errors = [
            (blais_rioux(pixel_shares(20.0 + at, along, 41).tolist(), 2) - 20.0 - at) * size
            for at, size in zip(place + moved, per_pixel, strict=True)
        ]
        means.append(np.mean(errors))
    return float(np.sqrt(np.mean(np.square(means))))


@pytest.mark.slow
def test_sources_alone_make_the_whole(config: Path) -> None:
    """Claim: the squares of all sources add up to that of all together.

    Set-up: as above, ``gaussian`` at 12 m. Expected: equal. Tolerance: 8 %: 4 standard errors of 1.6 %, and the
    response, whose pattern is another one in each run.
    """
    scenario = load_scenario(config, ["processing.peak=gaussian"])
    rows = measure_budget(scenario, np.array([12.0]), 0.5, device="cpu")
    found = {row.source: row.simulated_m for row in rows}
    whole = found.pop("all")
    assert np.sqrt(sum(value**2 for value in found.values())) == pytest.approx(whole, rel=0.08)


@pytest.mark.slow
def test_what_strays_and_what_shakes(config: Path, simulate_only: Callable[..., None]) -> None:
    """Claim: stray light adds the noise of its own charge and takes its share from the spot; vibration and the scatter
    of power make nothing of a range.

    Set-up: 40 % of the light scattered, the platform shaking by 1 mrad and 0.3 mm, power and pulses scattered by 10 %,
    at 4 m by triangulation and at 12 m by time of flight, where the amplifier clips nothing. Expected: shot noise and
    what strays as the closed forms; of the others nothing. Tolerance: 5 % for the four places, and χ²; 5·10⁻⁷ of the
    range, the rounding of single precision.
    """
    turns, shifts = (
        "[[5 Hz, 1e-7 rad^2/Hz], [100 Hz, 1e-9 rad^2/Hz]]",
        "[[5 Hz, 1e-8 m^2/Hz], [100 Hz, 1e-10 m^2/Hz]]",
    )
    shaken = f"{{turn: {turns}, shift: {shifts}}}"
    built = f"{{stray_light: 40 %, power_noise: 10 %, pulse_noise: 10 %, vibration: {shaken}}}"
    scenario = load_scenario(config, ["ranging=both", f"scanner.as_built={built}"])
    simulate_only("shot", "stray", "vibration", "power")
    near, far = (measure_budget(scenario, np.array([R]), 0.5, device="cpu") for R in (4.0, 12.0))
    found = {row.source: row for row in near if row.mode == "triangulation"}
    closed = range_budget(instrument_of(scenario, 0.5, HALF), 4.0)
    assert set(found) == {"shot", "stray", "vibration", "power"}
    for name in ("shot", "stray"):
        many = (found["shot"].freedom, np.inf)
        assert claims.scatter_ratio(found[name].simulated_m, closed[name], many, slack=0.05), name
    for name in ("vibration", "power"):
        assert found[name].simulated_m < 5e-7 * 4.0
        assert closed[name] == 0.0
    timed = {row.source: row for row in far if row.mode == "tof"}
    assert set(timed) == {"shot", "vibration", "power"}
    for name in ("vibration", "power"):
        assert timed[name].simulated_m < 5e-7 * 12.0


@pytest.mark.slow
def test_what_dominates_an_image(config: Path) -> None:
    """Claim: speckle makes most of σ at 8 m; without it, and in weak light, read noise; parts sum to σ².

    Set-up: the wall by ``gaussian``, under a beam at rest, and of 0.3 mW without speckle. Expected: these; the parts of
    ``gaussian``, which is linear, add up to the stated variance. Tolerance: 3 %, single precision in differences of σ².
    """
    from scanner_sim import simulate

    scenario = load_scenario(config, ["processing.peak=gaussian", "scan.motion=stepped"])
    found = dominating(scenario, device="cpu")
    assert found.shares()["speckle"] > 0.99
    image = simulate(scenario, device="cpu")
    valid = (image["status"] == 0) & (found.largest >= 0)
    assert valid.mean() > 0.95
    whole = image["sigma_range_m"][valid].astype(np.float64) ** 2
    assert np.median(found.variances.sum(axis=0)[valid] / whole) == pytest.approx(1.0, abs=0.03)
    weak = load_scenario(
        config, ["processing.peak=gaussian", "scanner.laser.power=0.3 mW", "scanner.laser.speckle=false"]
    )
    assert dominating(weak, device="cpu").shares()["read"] > 0.7


def only(**sources: str) -> list[str]:
    """Return settings that leave of all errors those that are named."""
    noise = "{shot: false, read: false, dark: false, prnu: false, saturation: true, quantisation: false}"
    quiet = {"jitter": "0 rad", "wobble": "0 rad", "synchronisation": "0 rad", "readout_noise": "0 rad"}
    mirrors = ", ".join(
        f"{key}: {value}" for key, value in {**quiet, "readout_step": "0 rad", **sources}.items()
    )
    diode = "{shot: false, amplifier: false, quantisation: false}"
    return [
        f"scanner.position_sensor.noise={noise}",
        f"scanner.mirrors={{{mirrors}}}",
        f"scanner.lidar.photodiode.noise={diode}",
        "scanner.laser.speckle=false",
    ]


@pytest.mark.slow
def test_the_curves_cross_where_the_closed_form_says(
    config: Path, simulate_only: Callable[..., None]
) -> None:
    """Claim: simulated, both ways are equally precise at R = √(σ_TOF f d/Δp), and time of flight is flat (Figure 12).

    Set-up: a constant Δp = f σ_e from an angle of 10 µrad between projection and reception, and the clock's jitter of
    67 ps; a facing target at five distances from 2 to 30 m. Expected: 14.2 m; σ of time of flight the same
    everywhere; fused σ no more than 1.02 of the better. Tolerance: 4 % of the distance, 5 standard errors of 1.6 % in
    each σ, which count half and in two points; 7 % of the flat curve, 4.4 of them; 4 % beside the 2 %: errors that
    are shared.
    """
    scenario = load_scenario(config, ["ranging=both", *only(synchronisation="10 urad")])
    distances = np.array([2.0, 6.0, 10.0, 20.0, 30.0])
    simulate_only("all")
    rows = measure_budget(scenario, distances, 0.5, device="cpu")
    timed = 0.5 * SPEED_OF_LIGHT * 67e-12
    assert crossing(rows, "simulated_m") == pytest.approx(
        crossing_range(timed, 0.1, 0.2, 0.1 * 10e-6), rel=0.04
    )
    sigma = {(row.mode, row.range_m): row.simulated_m for row in rows if row.source == "all"}
    for distance in distances.tolist():
        assert sigma["tof", distance] == pytest.approx(timed, rel=0.07)
        better = min(sigma["triangulation", distance], sigma["tof", distance])
        assert sigma["fused", distance] < 1.02 * 1.04 * better


@pytest.mark.slow
def test_time_of_flight_is_analytic(config: Path, simulate_only: Callable[..., None]) -> None:
    """Claim: the closed forms of time of flight are what is simulated, source by source.

    Set-up: the preset at 12 and 25 m, where the amplifier clips nothing, and at 4 m, where it does. Expected: equal.
    Tolerance: 10 %: 4 standard errors of 1.6 %, and the second order; the fused range likewise. Rounding, which is no
    white noise on its own, 20 %. Clipped pulses within a factor of 1.6: their edges are read off a table, and what they
    err is a hundredth of the clock's part.
    """
    scenario = load_scenario(config, ["ranging=both"])
    judged = 0
    simulate_only(modes=("tof", "fused"))
    rows = measure_budget(scenario, np.array([4.0, 12.0, 25.0]), 0.5, device="cpu")
    for row in with_closed_forms(rows, scenario, 0.5):
        if row.mode == "triangulation" or row.source == "estimator":
            continue
        judged += 1
        slack = 0.2 if row.source == "quantisation" else 0.1
        slack = 0.6 if row.range_m < 5.0 and row.source in ("shot", "amplifier", "quantisation") else slack
        assert row.simulated_m == pytest.approx(row.analytic_m, rel=slack), (row.mode, row.source)
    assert judged == 3 * (5 + 1)


@pytest.mark.slow
@pytest.mark.parametrize("laser_off", [0.0, 0.5])
def test_sun_and_drift_are_analytic(
    config: Path, laser_off: float, simulate_only: Callable[..., None]
) -> None:
    """Claim: the closed forms of the Sun's light and of drift are what is simulated.

    Set-up: the preset by both ways in sunlight at 12 m, with and without subtraction of the background; a course of
    10 K. Expected: equal. Tolerance: 12 %: 4 standard errors of 1.6 %, of 2 % for the difference of two variances,
    and the second order.
    """
    settings = ["ranging=both", "lighting={sun: {direction: [-0.5, -0.3, -0.8]}}"]
    settings += ["scanner.mirrors.temperature={amplitude: 10 K}", f"scanner.laser_off={laser_off}"]
    scenario = load_scenario(config, settings)
    simulate_only("sun", "shot", "drift")
    rows = with_closed_forms(measure_budget(scenario, np.array([12.0]), 0.5, device="cpu"), scenario, 0.5)
    found = {(row.mode, row.source): row for row in rows}
    for key in (("triangulation", "sun"), ("tof", "sun"), ("triangulation", "drift")):
        assert found[key].simulated_m == pytest.approx(found[key].analytic_m, rel=0.12), key
