"""Echoes: ranges, pulse widths, power and late light of scenes, against closed forms and brute force.

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

from typing import Any

import claims
import numpy as np
import pytest
from prototype import Digitiser, Laser, Photodiode, Pulse

from scanner_sim.analytic import spot
from scanner_sim.analytic import time_of_flight as judge
from scanner_sim.config.scanner import Scanner
from scanner_sim.detector.photodiode.photodiode import PhotodiodeNoise
from scanner_sim.detector.photodiode.waveform import record
from scanner_sim.ranging.time_of_flight import ranges_from_delays
from scanner_sim.render.settings import Transport
from scanner_sim.scene.objects import Scene
from scanner_sim.signals.waveform.detection import PulseDetector
from scanner_sim.signals.waveform.settings import PulseDetection

pytestmark = pytest.mark.usefixtures("device")

SCANNER = Scanner()
SILENT = PhotodiodeNoise(shot=False, amplifier=False, saturation=False, quantisation=False, clock=False)
DIODE, PULSE = Photodiode(noise=SILENT), Pulse()


def wall(distance: float, degrees: float = 0.0, **changes: Any) -> dict[str, Any]:
    turn = {"axis": "y", "angle": float(np.deg2rad(degrees))}
    # No larger than it must be: rays meet a triangle with rounding in proportion to its size.
    size = 6.0 * distance + 4.0
    place = {"position": (0.0, 0.0, distance), "rotation": turn, "size": (size, size)}
    return {"name": "wall", "shape": "rectangle", **place, "material": {"reflectance": 0.5}, **changes}


def bench(laser: Laser | None = None) -> Any:
    from scanner_sim.render.transport import OpticalLayout

    sensor = SCANNER.position_sensor
    return OpticalLayout(
        laser or SCANNER.laser,
        SCANNER.receiver,
        SCANNER.mirrors.axis_separation,
        1.0,
        sensor.pitch,
        sensor.height,
        sensor.offset,
        sensor.diffusion,
    )


def echoes(
    objects: list[dict[str, Any]],
    theta: Any,
    phi: Any,
    *,
    offset: bool = False,
    field: float = 0.02,
    laser: Laser | None = None,
    settings: Transport | None = None,
    seed: int = 0,
) -> tuple[np.ndarray, list[Any]]:
    """Return the true ranges and the groups of echoes."""
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.render.beam.path_projection import PathProjection
    from scanner_sim.render.beam.splitter import render_light
    from scanner_sim.render.shots import Shots
    from scanner_sim.scene.files.loader import load_scene

    loaded = load_scene(Scene(objects=tuple(objects)))
    theta, phi = (np.atleast_1d(np.asarray(angle, dtype=np.float32)) for angle in (theta, phi))
    shots = Shots(dr.arange(mi.UInt32, len(theta)), mi.Float(theta), mi.Float(phi))
    projection = PathProjection(bench(laser), offset, field)
    truth, groups = render_light(loaded, projection, settings or Transport(), shots, seed)
    return truth.distance.numpy().astype(np.float64), list(groups)


def measured(groups: list[Any], theta: np.ndarray, gate: tuple[float, float], baseline: float) -> np.ndarray:
    """Return the noise-free ranges by the matched filter [m]."""
    clock = Digitiser(gate=gate)
    detector = PulseDetector(PULSE, DIODE, clock, PulseDetection())
    found = np.full(len(theta), np.nan)
    for group in groups:
        delays = detector.detect(record(group, group.shot, PULSE, DIODE, clock, 0))
        index = group.index.numpy()
        sigma, status = delays.sigma.numpy() / clock.rate, delays.status.numpy()
        found[index] = ranges_from_delays(
            delays.seconds(clock), sigma, status, theta[index], 0.0, gate, baseline
        ).range
    return found


@pytest.mark.parametrize("distance", [1.5, 5.0, 18.0, 60.0, 150.0, 200.0])
@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_planes_are_measured_to_the_micrometre(distance: float, degrees: float) -> None:
    """Claim: noise-free ranges of planes lie within 20 µm of the truth to 20 m, and 2e-6 of it to 200 m.

    Set-up: 300 shots over ±0.3 rad at walls square and turned by 30°, through waveform and matched filter. Expected:
    the chief ray's range. Tolerance: that.
    """
    theta, phi = np.random.default_rng(1).uniform(-0.3, 0.3, (2, 300))
    truth, groups = echoes([wall(distance, degrees)], theta, phi)
    found = measured(groups, theta, (0.5, 2.0 * distance + 2.0), 0.0)
    assert np.isfinite(found).all()
    assert (np.abs(found - truth) < np.maximum(20e-6, 2e-6 * truth)).all()


def test_an_offset_receiver_measures_the_same() -> None:
    """Claim: with the lens at the triangulation base the exact path gives the same range; a narrow field loses it.

    Set-up: a wall at 5 m, base 0.2 m, field of 300 mrad, then of 5 mrad, which ends at 40 m. Expected: the truth; no
    light. Tolerance: 20 µm.
    """
    theta, phi = np.random.default_rng(2).uniform(-0.3, 0.3, (2, 200))
    truth, groups = echoes([wall(5.0)], theta, phi, offset=True, field=0.3)
    found = measured(groups, theta, (0.5, 12.0), SCANNER.receiver.baseline)
    assert np.abs(found - truth).max() < 20e-6
    _, dark = echoes([wall(5.0)], theta, phi, offset=True, field=5e-3)
    assert sum(float(group.amount.numpy().sum()) for group in dark) == 0.0
    _, lit = echoes([wall(50.0)], 0.0, 0.0, offset=True, field=5e-3)
    assert lit[0].amount.numpy().sum() > 0.0


@pytest.mark.parametrize(
    ("radius", "distance"), [(2.0, 8.0), (0.1, 5.0), (0.05, 10.0), (2.0, 60.0), (5.0, 150.0), (5.0, 200.0)]
)
def test_spheres_are_measured_over_their_footprint(radius: float, distance: float) -> None:
    """Claim: on a sphere the range is the footprint's mean, within 20 µm to 20 m and 2e-6 of it to 200 m.

    Set-up: spheres hit in the middle, down to one whose mean lies 49 µm behind its nearest point. Expected: the judge's
    integral over the beam. Tolerance: that; a chief ray alone would miss it on the smallest.
    """
    ball = {"name": "ball", "shape": "sphere", "diameter": 2.0 * radius, "material": {"reflectance": 0.5}}
    truth, groups = echoes([{**ball, "position": (0.0, 0.0, distance + radius)}], 0.0, 0.0)
    found = measured(groups, np.zeros(1), (0.5, 2.0 * distance), 0.0)
    expected = judge.sphere_range(distance, radius, 0.5 * SCANNER.laser.radius(distance))
    assert found[0] == pytest.approx(expected, abs=max(20e-6, 2e-6 * distance))
    assert truth[0] == pytest.approx(distance, abs=1e-5)


@pytest.mark.parametrize("degrees", [20.0, 60.0, 80.0])
def test_a_tilted_plane_stretches_the_pulse(degrees: float) -> None:
    """Claim: the waveform's standard deviation from a tilted plane is √(σ_p² + σ_h² + (2 s tanα/c)²), to 1 %.

    Set-up: a wide beam (waist 60 mm) at 20 m, tilted up to 80°, where the footprint stretches the pulse to twice its
    width. Expected: the judge's. Tolerance: 1 %; on the part that the plane adds, 3 %.
    """
    laser = Laser(waist_radius=60e-3)
    _, groups = echoes([wall(20.0, degrees)], 0.0, 0.0, laser=laser)
    clock = Digitiser(gate=(0.5, 40.0), rate=2e9)
    line = record(groups[0], groups[0].shot, PULSE, DIODE, clock, 0).records()[0].astype(np.float64)
    time = np.arange(line.size) / clock.rate
    mean = (time * line).sum() / line.sum()
    got = np.sqrt((((time - mean) ** 2) * line).sum() / line.sum())
    pulse, response = PULSE.sigma, DIODE.response_sigma
    expected = judge.tilted_plane_sigma(pulse, response, 30e-3, np.deg2rad(degrees))
    assert got == pytest.approx(expected, rel=0.01)
    added, wanted = got**2 - pulse**2 - response**2, expected**2 - pulse**2 - response**2
    assert added == pytest.approx(wanted, rel=0.06 if degrees > 70.0 else 0.03, abs=1e-23)


def test_the_power_is_that_of_the_link_budget() -> None:
    """Claim: a coaxial receiver collects ρ A T/(π R²) of the pulse from a wall that fills the beam (eq 19).

    Set-up: walls at 3, 10 and 40 m square to the beam. Expected: the judge's printed form for 1 W. Tolerance: 1e-4,
    the beam's and the aperture's own size at 3 m.
    """
    for distance in (3.0, 10.0, 40.0):
        _, groups = echoes([wall(distance)], 0.0, 0.0)
        area = SCANNER.receiver.aperture_area * SCANNER.receiver.transmission
        expected = spot.laser_power_printed(distance, 1.0, 0.5, area)
        assert groups[0].amount.numpy().sum() == pytest.approx(expected, rel=1e-4)


def test_an_edge_splits_the_pulse() -> None:
    """Claim: half on a near wall and half on one 1 m behind it, the pulse returns as two, each in its share.

    Set-up: an edge at the beam's middle, walls at 5 and 6 m; and the beam moved by one standard deviation. Expected:
    ways of 10 and 12 m; of the near wall's whole return the share Φ(x/s); of the far one's, the rays that pass the edge
    there and, to a random point of the aperture, back. Tolerance: 1.5 % of the whole (256 beamlets), 1 mm.
    """
    from scipy.stats import norm

    near = wall(5.0, position=(2.0, 0.0, 5.0), size=(4.0, 8.0))
    whole = {}
    for distance in (5.0, 6.0):
        _, alone = echoes([wall(distance)], 0.0, 0.0)
        whole[distance] = float(alone[0].amount.numpy().sum())
    beam, farther = (0.5 * SCANNER.laser.radius(z) for z in (5.0, 6.0))
    random = np.random.default_rng(5)
    ray, angle = random.standard_normal(1_000_000), random.uniform(0.0, 2.0 * np.pi, 1_000_000)
    stop = 0.5 * SCANNER.receiver.aperture * np.sqrt(random.random(1_000_000)) * np.cos(angle)
    for aside in (-1.0, 0.0, 1.0):
        theta = aside * beam / 5.0
        fine = Transport(edge_beamlets=256)
        _, groups = echoes([near, wall(6.0, name="far")], theta, 0.0, settings=fine)
        share, path = groups[0].amount.numpy(), groups[0].position.numpy() + groups[0].reference.numpy()[0]
        lit = share > 0.0
        first = lit & (path < 11.0)
        assert path[first] == pytest.approx(10.0, abs=1e-3)
        assert path[lit & ~first] == pytest.approx(12.0, abs=1e-3)
        expected = norm.cdf(aside)
        assert share[first].sum() / whole[5.0] == pytest.approx(expected, abs=0.015)
        there, spot_on_far = theta * 5.0 + ray * beam < 0.0, theta * 6.0 + ray * farther
        passed = there & ((5.0 * spot_on_far + stop) / 6.0 < 0.0)
        assert share[lit & ~first].sum() / whole[6.0] == pytest.approx(passed.mean(), abs=0.015)


def late_light(objects: list[dict[str, Any]], shots: int, paths: int, laser: Laser, field: float) -> Any:
    """Return shares and ways [m] of the light that met two surfaces, shape (shots, paths)."""
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.render.beam.beamlets import edge_beamlets
    from scanner_sim.render.beam.bounces import trace_bounces
    from scanner_sim.render.beam.path_projection import PathProjection
    from scanner_sim.render.shots import Shots
    from scanner_sim.scene.files.loader import load_scene

    loaded = load_scene(Scene(objects=tuple(objects)))
    fired = Shots(dr.arange(mi.UInt32, shots), *(dr.zeros(mi.Float, shots) for _ in range(2)))
    reference = dr.full(mi.Float, 8.0, shots)
    projection = PathProjection(bench(laser), False, field)
    late = trace_bounces(loaded, projection, edge_beamlets(paths), 2, fired, 0, reference)
    share, path = (
        values.numpy().reshape(shots, paths).astype(np.float64) for values in (late.power, late.position)
    )
    return share, path + 8.0


def test_late_light_of_a_corner_agrees_with_brute_force() -> None:
    """Claim: light that meets two walls of a corner arrives in its time and strength: z-test per bin.

    Set-up: a wall square to the beam at 4 m and a side wall at x = 0.6 m, field of ±1 rad, 400 shots of 2048 paths,
    against the judge's own tracer with 2 million rays. Expected: equal histograms of the way in bins of 0.1 m.
    Tolerance: level 10⁻⁴ for the mean of the shots' sums, which finds 3.5 %, and for the mean square of z over the bins
    that hold 3 % of the fullest, errors from the scatter of shots and of rays. Fainter bins hold few paths of either,
    which are not normal.
    """
    turned = {"axis": "y", "angle": -0.5 * np.pi}
    side = wall(0.0, name="side", position=(0.6, 0.0, 4.0), rotation=turned, size=(400.0, 400.0))
    back = wall(4.0, size=(400.0, 400.0))
    # A thin beam: the judge's is a ray.
    laser = Laser(waist_radius=0.2e-3, wavelength=0.3e-6)
    shots, half = 400, 1.0
    share, way = late_light([back, side], shots, 2048, laser, 2.0 * half)
    bins = np.arange(8.0, 12.01, 0.1)
    histogram = np.array(
        [np.histogram(ways, bins, weights=shares)[0] for ways, shares in zip(way, share, strict=True)]
    )
    area = SCANNER.receiver.aperture_area * SCANNER.receiver.transmission
    ways, weights = judge.corner_echoes((0, 0, 1, 4.0), (1, 0, 0, 0.6), 0.5, half, 2_000_000, 7)
    reference = np.histogram(ways, bins, weights=weights * area)[0]
    its_error = np.sqrt(np.histogram(ways, bins, weights=(weights * area) ** 2)[0])
    mean, error = histogram.mean(axis=0), histogram.std(axis=0, ddof=1) / np.sqrt(shots)
    lit = reference > 0.03 * reference.max()
    z = (mean - reference)[lit] / np.hypot(error, its_error)[lit]
    assert lit.sum() >= 10
    assert claims.mean_square(z)
    whole, rays = reference.sum(), float(np.sqrt(np.sum(its_error**2)))
    sums = claims.mean(histogram.sum(axis=1) / whole, 1.0, slack=4.0 * rays / whole)
    assert sums
    assert sums.finds < 0.035


def test_late_echoes_join_the_direct_one() -> None:
    """Claim: with two bounces the echoes of a shot hold the direct light unchanged and the late light besides.

    Set-up: the corner, 1024 paths in 64 echoes, twice. Expected: the first echo of one bounce; late ones behind it,
    whose sum is that of the paths; equal bytes. Tolerance: 1e-5 of the sum.
    """
    turned = {"axis": "y", "angle": -0.5 * np.pi}
    corner = [wall(4.0), wall(0.0, name="side", position=(0.6, 0.0, 4.0), rotation=turned)]
    settings = Transport(bounces=2, bounce_paths=1024)
    _, alone = echoes(corner, 0.0, 0.0, field=2.0)
    _, both = echoes(corner, 0.0, 0.0, field=2.0, settings=settings)
    _, again = echoes(corner, 0.0, 0.0, field=2.0, settings=settings)
    share, path = both[0].amount.numpy(), both[0].position.numpy()
    np.testing.assert_array_equal(share[:1], alone[0].amount.numpy())
    np.testing.assert_array_equal(share, again[0].amount.numpy())
    late = share[1:] > 0.0
    assert late.sum() > 10
    assert (path[1:][late] > path[0]).all()
    expected, _ = late_light(corner, 1, 1024, SCANNER.laser, 2.0)
    assert share[1:].sum() == pytest.approx(expected.sum(), rel=1e-5)
