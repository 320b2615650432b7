"""What studies make of errors that were measured: standard deviations, intervals, exponents, parts, lines of sight."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import load_scenario
from scanner_sim.analytic.geometry import triangulated_range
from scanner_sim.foundation.status import Status
from scanner_sim.ranging.ranges import Geometry
from scanner_sim.render.device import Device
from scanner_sim.validation.studies import budget, budget_sources, calibrate, dominance, pose_laws, sweep

Array = NDArray[np.float64]


def scenario(**parts: Any) -> Any:
    scan = {
        "rows": 4,
        "columns": 5,
        "horizontal": (-0.2, 0.1),
        "vertical": (-0.05, 0.15),
        "motion": "stepped",
    }
    return load_scenario({"schema": 1, "scan": scan, **parts})


class Held:
    """Values as an array on the device holds them."""

    def __init__(self, values: Any) -> None:
        self.values = np.asarray(values)

    def numpy(self) -> Any:
        return self.values


def test_errors_far_from_a_place_grow_with_the_range_squared() -> None:
    """Claim: of triangulation R², its bias and what comes of deflections R; of time of flight not at all."""
    twice = np.array([2.0])
    for name in ("shot", "synchronisation", "speckle", "all"):
        assert budget._scale("triangulation", name, twice) == pytest.approx(4.0)
    for name in ("estimator", "jitter", "wobble", "readout", "drift"):
        assert budget._scale("triangulation", name, twice) == pytest.approx(2.0)
    assert budget._scale("tof", "shot", twice) == pytest.approx(1.0)


def test_a_standard_deviation_has_its_interval_of_chi_squared() -> None:
    """Claim: of 20 errors σ has 19 degrees of freedom; the 2.5 % and 97.5 % points of χ² are 8.907 and 32.852."""
    errors = np.random.default_rng(1).normal(0.5, 2.0, 20)
    sigma, low, high, freedom = budget._row("shot", errors[None])
    assert freedom == 19
    assert sigma == pytest.approx(math.sqrt(np.sum((errors - errors.mean()) ** 2) / 19.0))
    assert (low, high) == pytest.approx(
        (sigma * math.sqrt(19.0 / 32.852), sigma * math.sqrt(19.0 / 8.907)), rel=1e-4
    )
    both = budget._row("shot", np.stack([errors, errors + 7.0]))
    assert (both[0], both[3]) == (pytest.approx(sigma), 38)


def test_errors_that_are_the_same_for_all_shots_count_once_for_each_place() -> None:
    """Claim: of means 1 and −3 at two places the estimator's error is √5, with two degrees of freedom."""
    errors = np.array([[0.9, 1.1], [-3.2, -2.8]])
    found = budget._row("estimator", errors)
    assert (found[0], found[3]) == (pytest.approx(math.sqrt(5.0)), 2)
    assert budget._row("all", errors)[0] == pytest.approx(math.sqrt((0.81 + 1.21 + 10.24 + 7.84) / 4.0))


def test_light_adds_the_difference_of_two_variances() -> None:
    """Claim: errors ±5 with and ±3 without light leave 4 for every shot; the interval is that of a mean."""
    dark = np.array([[3.0, -3.0] * 200])
    sigma, low, high, freedom = budget._row_of_more(dark * 5.0 / 3.0, dark)
    assert (sigma, low, high) == pytest.approx((4.0, 4.0, 4.0))
    assert freedom == 399
    scattered = np.random.default_rng(2).normal(0.0, 5.0, 400)
    sigma, low, high, _ = budget._row_of_more(scattered[None], dark)
    more = (scattered - scattered.mean()) ** 2 - 9.0
    error = more.std() / 20.0
    assert (low**2, sigma**2, high**2) == pytest.approx(
        (more.mean() - 1.96 * error, more.mean(), more.mean() + 1.96 * error)
    )


def test_an_error_that_was_enlarged_is_made_small_again() -> None:
    """Claim: jitter 32 times as large, beside a bias of 0.5, is told as itself; read noise less the bias."""
    targets = object.__new__(budget._Targets)
    targets.shape = (2, 3)
    told = {"jitter": 32.0 * 0.25 + 0.5, "read": 0.75, "estimator": 0.5}
    targets._measured = lambda mode, name: SimpleNamespace(error=np.full(24, told[name]))  # type: ignore[method-assign]
    for name, error in (("jitter", 0.25), ("read", 0.25), ("estimator", 0.5)):
        np.testing.assert_allclose(targets.errors("triangulation", name), np.full((2, 3, 4), error))


def test_a_budget_measures_at_even_places_of_a_pixel_out_to_30_m() -> None:
    """Claim: ±1/8 and ±3/8 of the nearest pixel; 30 m are the farthest."""
    spot = SimpleNamespace(pixel=lambda r, *_: 7.0 + 0.3, range=lambda pixel, *_: pixel)
    known = SimpleNamespace(triangulation=SimpleNamespace(spot=spot), scenario=scenario())
    found = list(budget._pixel_phases(known, 5.0))  # type: ignore[arg-type]
    assert found == pytest.approx([7.0 - 0.375, 7.0 - 0.125, 7.0 + 0.125, 7.0 + 0.375])
    assert budget.distances_of(scenario(), 5)[-1] == pytest.approx(30.0)


def test_a_budget_without_an_array_goes_over_the_gate_at_even_places_between_samples() -> None:
    """Claim: ±1/8 and ±3/8 of the 0.2998 m between two samples at 500 MHz; 1.1 times the near end to 0.9 of the far."""
    timed = scenario().replace({"scanner": {"preset": "pulsed_scanner"}, "ranging": "tof"})
    found = np.array(list(budget._pixel_phases(SimpleNamespace(scenario=timed), 50.0)))  # type: ignore[arg-type]
    step = 0.5 * 299_792_458.0 / 500e6
    np.testing.assert_allclose(found - 50.0, step * np.array([-0.375, -0.125, 0.125, 0.375]), atol=1e-12)
    assert budget.distances_of(timed, 5)[[0, -1]] == pytest.approx([1.65, 450.0])
    assert budget_sources.modes_of(timed) == ("tof",)


@pytest.mark.parametrize("stepped", [True, False])
def test_the_shots_of_a_budget_fill_its_course_of_time_evenly(stepped: bool) -> None:
    """Claim: n shots are T/n apart, in an order that does not go with the deflection; further lanes lie between."""
    sweep = {"columns": 5, "rows": 2, "horizontal": (-0.2, -0.1204), "vertical": (0.0, 0.1)}
    # 484 shots, and 486, which the golden ratio's multiple divides.
    known = scenario() if stepped else load_scenario({"schema": 1, "scan": sweep})
    n = 484 if stepped else 486
    aim, lanes = budget._aim(known), budget._moments(known, n, 3).reshape(3, -1)
    assert lanes.shape == (3, n) == (3, aim.theta.size)
    step = budget.course_time(known) / n
    for lane, times in enumerate(lanes):
        np.testing.assert_allclose(np.sort(times), (np.arange(n) + lane / 3.0) * step, rtol=1e-9)
        # The correlation of a random order would be 1/√484.
        assert abs(np.corrcoef(times, aim.theta)[0, 1]) < 4.0 / math.sqrt(n)


@pytest.mark.parametrize(
    ("distances", "parts"),
    [
        ([], []),
        ([3.0], [[0]]),
        ([1.0, 2.0, 7.9, 8.1, 60.0], [[0, 1, 2], [3, 4]]),
        ([9.0, 1.2, 1.0, 0.5], [[0, 1], [2, 3]]),
        ([4.0] * 19, [list(range(8)), list(range(8, 16)), [16, 17, 18]]),
    ],
)
def test_distances_that_are_measured_together_are_alike(
    distances: list[float], parts: list[list[int]]
) -> None:
    """Claim: eight at most, none more than eight times as far as another, and all in their order."""
    assert list(budget._together(np.array(distances))) == parts


def test_an_exponent_is_that_of_weighted_logarithms() -> None:
    """Claim: NumPy's weighted line, its error with known errors, and widened where the points scatter by more."""
    x = np.array([1.0, 2.0, 4.0, 8.0, 16.0])
    relative = np.array([0.01, 0.03, 0.02, 0.05, 0.01])
    design = np.stack([np.log(x), np.ones(5)], axis=1) / relative[:, None]
    known = math.sqrt(np.linalg.inv(design.T @ design)[0, 0])
    slope, error = pose_laws.power_law(x, 3.0 * x**1.5, relative)
    assert (slope, error) == pytest.approx((1.5, known))
    rough = 3.0 * x**1.5 * np.array([1.1, 0.9, 1.05, 0.9, 1.1])
    slope, error = pose_laws.power_law(x, rough, relative)
    line, rest, *_ = np.linalg.lstsq(design, np.log(rough) / relative, rcond=None)
    assert slope == pytest.approx(line[0])
    assert rest[0] / 3.0 > 1.0
    assert error == pytest.approx(known * math.sqrt(rest[0] / 3.0))


def pose_row(method: str, ranging: str, simulated: float) -> Any:
    """Return a row whose interval of 95 % is 10 % to each side, in logarithms."""
    wide = math.exp(0.1 * 1.959964)
    return SimpleNamespace(
        array="square", size_m=1.0, range_m=10.0, method=method, ranging=ranging, mode=(method, ranging),
        component="x", simulated=simulated, low=simulated / wide, high=simulated * wide, analytic=2.0 * simulated,
        voxel=3.0 * simulated,
    )  # fmt: skip


def test_a_gain_is_the_error_of_points_over_the_other() -> None:
    """Claim: 6 over 2 and 6 over 3, with the relative errors of both, a tenth each, added in squares; closed forms are
    divided likewise."""
    rows = [pose_row("xyz", "tof", 6.0), pose_row("uv", "none", 2.0), pose_row("joint", "tof", 3.0)]
    for row, analytic, voxel in zip(rows, (15.0, 3.0, 6.0), (28.0, 4.0, 2.0), strict=True):
        row.analytic, row.voxel = analytic, voxel
    angles, both = pose_laws.gains_of(rows, "square", 1.0)
    assert pose_laws._relative(rows[0]) == pytest.approx(0.1)
    told = {name: (getattr(angles, name), getattr(both, name)) for name in ("method", "simulated")}
    assert told == {"method": ("uv", "joint"), "simulated": (pytest.approx(3.0), pytest.approx(2.0))}
    assert angles.standard_error == pytest.approx(3.0 * math.sqrt(0.02))
    assert [(one.analytic, one.voxel) for one in (angles, both)] == [(5.0, 7.0), (2.5, 14.0)]


def test_parts_of_a_range_are_those_of_its_jacobian(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: variances of the peak count (∂R/∂p · pitch)², of the angles (∂R/∂Θ)², by differences of eq 1."""
    known = scenario()
    geometry = Geometry(0.1, 0.2, 0.05, 50e-6, 0.0, 1e-6)
    peaks = np.linspace(20.0, 200.0, 20)

    def parts_of(bench: Any, aim: Any) -> tuple[Array, Array]:
        return peaks[aim.shot], np.tile(0.01 * peaks[aim.shot], (6, 1))

    monkeypatch.setattr(
        dominance, "Instrument", lambda *_, **__: SimpleNamespace(geometry=geometry, scenario=known)
    )
    monkeypatch.setattr(dominance, "_peak_parts", parts_of)
    found = dominance.dominating(known)
    theta = np.tile(np.linspace(-0.2, 0.1, 5), 4)
    p = (peaks + 0.5) * 50e-6
    by_p = (
        triangulated_range(p + 1e-9, theta, 0.1, 0.2) - triangulated_range(p - 1e-9, theta, 0.1, 0.2)
    ) / 2e-9
    by_theta = (
        triangulated_range(p, theta + 1e-6, 0.1, 0.2) - triangulated_range(p, theta - 1e-6, 0.1, 0.2)
    ) / 2e-6
    variances = found.variances.reshape(8, 20)
    np.testing.assert_allclose(variances[0], 0.01 * peaks * (by_p * 50e-6) ** 2, rtol=1e-5)
    np.testing.assert_allclose(variances[-2], (by_p * 0.1 * (1.0 + (p / 0.1) ** 2) * 1e-6) ** 2, rtol=1e-5)
    # Jitter 8 µrad, wobble 3, noise 2 and a step of 1 µrad; at an even temperature nothing drifts.
    sigma = math.sqrt(64.0 + 9.0 + 4.0 + 1.0 / 12.0) * 1e-6
    np.testing.assert_allclose(variances[-1], (by_theta * sigma) ** 2, rtol=1e-5)


def test_a_part_is_the_variance_that_goes_with_its_source(device: Device) -> None:
    """Claim: of σ = 5 pixel, and 4 without a source, 9 are the source's; nothing where the changed model refuses."""
    known = scenario()
    index, valid, refused = np.arange(2), int(Status.VALID), int(Status.BELOW_THRESHOLD)
    peaks = SimpleNamespace(
        status=Held([valid, refused]), position=Held([30.0, 31.0]), sigma=Held([5.0, 5.0])
    )
    bench: Any = SimpleNamespace(
        scenario=known,
        expose=lambda aim: (None, [SimpleNamespace(index=index, peaks=peaks, signal=None)]),
        triangulation=SimpleNamespace(
            find=lambda *_, **more: SimpleNamespace(sigma=Held([4.0 if more["speckle"] else math.nan, 4.0]))
        ),
    )
    aim: Any = SimpleNamespace(theta=np.zeros(2))
    peak, parts = dominance._peak_parts(bench, aim)
    np.testing.assert_array_equal(peak, [30.0, np.nan])
    np.testing.assert_allclose(parts[:, 0], [9.0, 9.0, 9.0, 9.0, 0.0, 9.0])
    assert np.isnan(parts[:, 1]).all()


def test_each_part_is_that_of_its_own_source() -> None:
    """Claim: where variances add up, 1 pixel² by shot noise, 2 by reading, 4, 8, 16 and 32 by the others in turn, each
    source has its own and no other; light of another shape goes into none of them."""
    known = scenario()
    switches = ("shot", "read", "quantisation", "prnu")

    def find(_: Any, __: Any, *, sensor: Any, processing: Any, speckle: bool) -> Any:
        own = [getattr(sensor.noise, name) for name in switches]
        own += [speckle, processing.validation.misfit > 0.0]
        assert processing.validation.misfit in (0.0, known.processing.validation.misfit)
        assert not processing.validation.shape
        return SimpleNamespace(sigma=Held([math.sqrt(sum(2.0**k for k, one in enumerate(own) if one))]))

    assert all(getattr(known.scanner.position_sensor.noise, name) for name in switches)
    peaks = SimpleNamespace(
        status=Held([int(Status.VALID)]), position=Held([30.0]), sigma=Held([math.sqrt(63.0)])
    )
    bench: Any = SimpleNamespace(
        scenario=known,
        expose=lambda aim: (None, [SimpleNamespace(index=np.arange(1), peaks=peaks, signal=None)]),
        triangulation=SimpleNamespace(find=find),
    )
    _, parts = dominance._peak_parts(bench, SimpleNamespace(theta=np.zeros(1)))  # type: ignore[arg-type]
    told = dict(zip((part.name for part in dominance._PARTS), parts[:, 0], strict=True))
    names = ("shot", "read", "quantisation", "response", "speckle", "misfit")
    assert told == pytest.approx({name: 2.0**k for k, name in enumerate(names)})


def test_parts_of_a_range_are_those_of_its_place_on_the_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of one pixel² by each source ∂R/∂p = −f d cos Θ/p² of a pitch, in squares, at the voxel's own place, batch
    by batch, of which is told how many are done."""
    known = scenario()
    f, d, pitch = 0.1, 0.2, 50e-6
    made = SimpleNamespace(scenario=known, geometry=Geometry(f, d, 0.05, pitch, 0.0, 1e-6))
    monkeypatch.setattr(dominance, "Instrument", lambda *_, **__: made)
    monkeypatch.setattr(dominance, "_BATCH", 6)
    monkeypatch.setattr(
        dominance, "_peak_parts", lambda _, aim: (30.0 + aim.shot, np.ones((6, aim.shot.size)))
    )
    told: list[tuple[int, int]] = []
    found = dominance.dominating(known, progress=lambda *done: told.append(done))
    assert told == [(6, 20), (12, 20), (18, 20), (20, 20)]
    theta = np.linspace(-0.2, 0.1, 5)
    p = (30.5 + np.arange(20.0).reshape(4, 5)) * pitch
    for name in ("shot", "speckle"):
        own = found.variances[found.sources.index(name)]
        np.testing.assert_allclose(own, (f * d * np.cos(theta) / p**2 * pitch) ** 2, rtol=1e-6)


def stage(**more: Any) -> Any:
    """Return a stage of an orbit without a scene: pixels see from 0 to 0.1 rad to the left of the lens's axis."""
    made = object.__new__(sweep._Stage)
    made._scenario, made._reach, made._seed = scenario(), (0.0, 0.1), 1
    made._instrument = SimpleNamespace(
        geometry=Geometry(0.1, 0.2, 0.05, 50e-6, 0.0, 1e-6), optics=None, loaded=None
    )
    made.__dict__ |= more
    return made


def samples(*points: tuple[float, float, float]) -> Any:
    return SimpleNamespace(point=Held(np.array(points).T), count=len(points))


def test_a_point_is_seen_from_the_lens() -> None:
    """Claim: in the plane of triangulation the lens at (d, 0) looks along atan((x − d)/z)."""
    found = stage()._sight(samples((0.7, 0.0, 5.0), (-1.0, 0.0, 8.0)))
    np.testing.assert_allclose(found.angle, [math.atan(0.5 / 5.0), math.atan(-1.2 / 8.0)], rtol=1e-9)
    np.testing.assert_allclose(found.phi, 0.0, atol=1e-12)


def test_the_field_of_view_is_what_any_pixel_sees_in_the_scan() -> None:
    """Claim: from −0.2 − 0.1 to 0.1 − 0 across, and from −0.05 to 0.15 down."""
    grid = stage()._field_of_view()
    assert (grid.angle.min(), grid.angle.max()) == pytest.approx((-0.3, 0.1))
    assert (grid.phi.min(), grid.phi.max()) == pytest.approx((-0.05, 0.15))
    assert grid.angle.size == math.prod(sweep.GRID)


def test_the_pixel_that_makes_most_of_light_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: one watt is QE t λ/(hc) electrons, of the largest irradiance that a pixel counts, in each band by itself;
    rays through the lens end at its pixels' edges, at p/f from its axis."""
    sensor = {"quantum_efficiency": 0.5, "pitch": 50e-6, "pixels": 200, "offset": 2e-3}
    scanner = {
        "laser": {"wavelength": 1e-6}, "receiver": {"focal_length": 0.1, "array_tilt": "ideal"},
        "position_sensor": sensor, "rate": 1000.0, "laser_off": 0.2, "filter": "none",
    }  # fmt: skip
    through = SimpleNamespace(in_band=Held([0.1, 0.4, 0.3]), out_of_band=Held([0.02, 0.01, 0.0]))
    made = SimpleNamespace(triangulation=SimpleNamespace(throughput=through))
    monkeypatch.setattr(sweep, "Instrument", lambda *_, **__: made)
    monkeypatch.setattr(sweep._Stage, "_targets", lambda self: None)
    found = sweep._Stage(scenario(scanner=scanner), "cpu")
    watt = 0.5 * 0.8e-3 * 1e-6 / (6.62607015e-34 * 299792458.0)
    assert found._gain == pytest.approx((0.4 * watt, 0.02 * watt))
    assert found._reach == pytest.approx((math.atan(0.02), math.atan(0.12)))


def test_what_moments_show_stands_under_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: four moments are a quarter of the period apart; each is looked at once, in turn, and told of when it is
    done; light, background and what is behind go to their own columns, target by target."""
    asked, told = [], []

    def look(sky: Any) -> Any:
        asked.append(sky)
        step = len(asked)
        targets = [(0.1 * step, 0.01 * step, 10.0 * step, 0.02 * step), (0.9, 0.0, 7.0, 0.5)]
        return sweep._Moment(0.0, 100.0 * step, targets)

    made = SimpleNamespace(look=look, names=("one", "other"), warnings=("so",))
    monkeypatch.setattr(sweep, "_Stage", lambda *_: made)
    known = scenario(lighting={"orbit": {"altitude": "400 km", "beta": "70 deg"}})
    found = sweep.sweep_orbit(known, 4, progress=lambda *done: told.append(done))
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    np.testing.assert_allclose(found.times, found.period * np.array([0.0, 0.25, 0.5, 0.75]))
    np.testing.assert_array_equal(found.sun_visible, [sky.sun_visible for sky in asked])
    np.testing.assert_array_equal(found.sun_direction, [sky.sun_direction for sky in asked])
    steps = np.arange(1.0, 5.0)
    np.testing.assert_array_equal(found.brightest, 100.0 * steps)
    assert not found.sun_in_view.any()
    first, second = found.tracks
    assert (first.name, second.name, found.warnings) == ("one", "other", ("so",))
    for name, slope, other in (
        ("lit", 0.1, 0.9), ("earth", 0.01, 0.0), ("background", 10.0, 7.0), ("sun_behind", 0.02, 0.5)
    ):  # fmt: skip
        np.testing.assert_allclose(getattr(first, name), slope * steps)
        np.testing.assert_array_equal(getattr(second, name), other)


def test_the_sun_is_in_view_where_some_pixel_sees_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of five places, one hidden, one beside, one below and two within the field, two fifths are seen."""
    monkeypatch.setattr(sweep, "half_height", lambda optics: 0.01)
    sun = SimpleNamespace(
        angle=np.array([0.0, 0.2, 0.0, -0.29, 0.05]), phi=np.array([0.0, 0.0, 0.3, 0.155, -0.02])
    )
    free = np.array([True, True, True, True, False])
    assert stage()._sun_in_view(sun, free) == pytest.approx(0.4)


def test_the_sun_is_behind_a_point_whose_pixels_see_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: at Θ pixels see from Θ − 0.1 to Θ; a Sun at −0.05 to −0.04 is behind points at Θ = 0 and 0.04, not 0.1."""
    monkeypatch.setattr(sweep, "half_height", lambda optics: 0.01)
    sun = SimpleNamespace(angle=np.array([-0.05, -0.04, 0.3]), phi=np.array([0.0, 0.005, 0.0]))
    free = np.array([True, True, False])
    points = samples(*((5.0 * math.tan(theta), 0.0, 5.0) for theta in (0.0, 0.04, 0.1, -0.1)))
    assert stage()._sun_behind(points, sun, free) == pytest.approx(0.5)
    assert stage()._sun_behind(points, sun, np.zeros(3, dtype=bool)) == 0.0
    # A disc from φ = 0.02 to 0.06, and pixels of 0.01 to each side: of eight from 0.005 to 0.075 all but the ends.
    sun = SimpleNamespace(angle=np.full(3, -0.05), phi=np.array([0.02, 0.04, 0.06]))
    points = samples(*((0.0, 5.0 * math.tan(0.005 + 0.01 * n), 5.05) for n in range(8)))
    made = stage()
    made._instrument.geometry = SimpleNamespace(axis_separation=0.05)
    assert made._sun_behind(points, sun, np.ones(3, dtype=bool)) == pytest.approx(6.0 / 8.0)


def test_background_is_of_both_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: 2 electrons for each light in the band and 3 beyond it: 2 · 10 + 3 · 1 of a target, and of its glint."""
    import scanner_sim.validation.studies.sweep as module

    grid, sight = (SimpleNamespace(angle=np.zeros(n), phi=np.zeros(n)) for n in (4, 2))
    seen = np.full(6, 10.0), np.full(6, 1.0), np.full(6, 100.0), np.full(6, 1000.0)
    lights = SimpleNamespace(
        Sight=SimpleNamespace,
        trace_sunlight=lambda *_: seen,
        sun_at=lambda *_: (None, None),
        sunlit_share=lambda *_: 0.5,
        earth_irradiance=lambda *_: 0.25,
    )
    lights.Sight = lambda angle, phi: SimpleNamespace(angle=angle, phi=phi)
    monkeypatch.setattr(module, "light", lights)
    monkeypatch.setattr(module, "light_of", lambda sky: None)
    made = stage(_gain=(2.0, 3.0), _grid=grid, _sights=[sight], _samples=[None], names=("a",))
    made._sun_in_view = lambda *_: 0.125
    made._sun_behind = lambda *_: 0.75
    sky = SimpleNamespace(sun_visible=1.0, albedo=0.3, albedo_out_of_band=0.3)
    moment = made.look(sky)
    assert moment.targets == [(0.5, 0.25, pytest.approx(23.0), 0.75)]
    assert moment.brightest == pytest.approx(2.0 * 100.0 + 3.0 * 1000.0)
    assert moment.in_view == 0.125


def test_a_passage_goes_evenly_through_its_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: an estimate that is 0.1 too large has that bias at phases that are even and symmetric about the pixel's
    middle; variances of 3 and 1 make a width of 2. Phases ascend, whichever pixel was the brightest: from the one
    before, the first fifth of places lies a pixel farther on, and its bias goes with it."""
    places = calibrate.PLACES
    spot = SimpleNamespace(
        range=lambda pixel, *_: np.asarray(pixel, dtype=np.float64),
        variances=lambda *_: (3.0, 1.0),
        white=1.0,
    )
    monkeypatch.setattr(calibrate, "_parts", lambda *_: [slice(0, places)])
    monkeypatch.setattr(calibrate, "_quiet", lambda known, *_: known)
    monkeypatch.setattr(
        calibrate, "_targets", lambda known, ranges, _: (ranges, calibrate._scan(known, len(ranges)))
    )
    even = 60.0 + (np.arange(places) + 0.5) / places - 0.5
    lines = np.zeros((places, 100))
    lines[:, 60] = 1.0
    group = SimpleNamespace(index=np.arange(places), signal=SimpleNamespace(lines=lambda: lines))
    found = SimpleNamespace(position=Held(even + 0.1), status=Held(np.full(places, int(Status.VALID))))
    line = SimpleNamespace(find=lambda *_, **__: found)
    bench = SimpleNamespace(expose=lambda aim: (None, [group]), triangulation=line)
    monkeypatch.setattr(calibrate, "Instrument", lambda *_, **__: bench)
    passage = calibrate._passage(scenario(), 60, spot, "cpu")
    assert passage is not None
    assert passage.width == pytest.approx(2.0)
    np.testing.assert_allclose(passage.bias, 0.1, rtol=1e-9)
    np.testing.assert_allclose(passage.phase, even - 60.0, atol=1e-12)
    np.testing.assert_allclose(passage.phase, -passage.phase[::-1], atol=1e-12)
    some = places // 5
    lines[:some, 59] = 2.0
    found.position = Held(even + 0.1 + 1e-3 * np.arange(places))
    passage = calibrate._passage(scenario(), 60, spot, "cpu")
    assert passage is not None
    np.testing.assert_allclose(
        passage.phase, np.concatenate([even[some:] - 60.0, even[:some] - 59.0]), atol=1e-12
    )
    np.testing.assert_allclose(passage.bias, 0.1 + 1e-3 * np.roll(np.arange(places), -some), atol=1e-12)


def test_half_of_the_shots_make_a_row() -> None:
    """Claim: half of all ranges are enough, if there are some at each position."""
    place = np.arange(10)
    half, fewer = (np.where(place < count, 1.0, math.nan) for count in (5, 4))
    assert budget._enough(np.stack([half, half]))
    assert not budget._enough(np.stack([half, fewer]))
    assert not budget._enough(np.stack([np.ones(10), np.full(10, math.nan)]))
