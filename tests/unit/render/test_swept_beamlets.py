"""Beamlets along each shot's own sweep: moments, evenness, and how they are turned."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from scanner_sim.render.beam.beamlets import edge_beamlets, edge_width
from scanner_sim.render.beam.swept_beamlets import averaged_positions, swept_positions
from scanner_sim.render.device import Device

Array = NDArray[np.float64]

LONGEST = 100.0


def lengths(rows: int) -> Array:
    share = np.linspace(0.0, LONGEST / (1.0 + LONGEST), rows)
    return np.asarray(share / (1.0 - share))


def passed(place: Array, length: float, spread: float) -> Array:
    """Distribution of a Gaussian convolved with a box, by a sum over the box."""
    steps = (np.arange(2000) + 0.5) / 2000 - 0.5
    return np.asarray(ndtr((place[:, None] - length * steps) / spread).mean(axis=1))


def unevenness(along: Array, across: Array, length: float, spread: float, angle: float) -> float:
    """Rms error of the light beyond straight edges whose normal stands at an angle to the travel."""
    place = np.sort(np.cos(angle) * along + np.sin(angle) * across)
    run = abs(length * np.cos(angle))
    edges = np.linspace(-1.0, 1.0, 161) * (2.2 + 0.5 * run)
    share = np.searchsorted(place, edges) / len(place)
    return float(np.sqrt(np.mean((share - passed(edges, run, spread)) ** 2)))


@pytest.mark.parametrize("count", [19, 48, 96])
def test_moments_are_those_of_the_beam(count: int) -> None:
    """First and second moments of places and times are exact for every length of travel."""
    spread = np.sqrt(1.0 - edge_width(count) ** 2)
    along, times, across = swept_positions(count, spread)
    parts = np.stack([along / spread, across / spread, times * np.sqrt(12.0)])
    assert np.abs(parts.mean(axis=2)).max() < 1e-9
    covariance = np.einsum("irk,jrk->rij", parts, parts) / count
    assert np.abs(covariance - np.eye(3)).max() < 1e-9


@pytest.mark.parametrize("count", [19, 96])
def test_moments_of_averaged_beamlets_are_those_of_the_beam(count: int) -> None:
    """So they are where each stands for all moments at which the beam is at its place, x + L t: x = −L t within it."""
    spread = float(np.sqrt(1.0 - edge_width(count) ** 2))
    along, times, across, left = averaged_positions(count, spread)
    length = lengths(len(along))[:, None]
    assert left.min() >= 0.0
    within = {(0, 0): length**2 * left, (0, 2): -length * left, (2, 2): left}
    parts = (along, across, times)
    for values in parts:
        assert np.abs(values.mean(axis=1)).max() < 1e-9
    for one in range(3):
        for other in range(one, 3):
            found = (parts[one] * parts[other] + within.get((one, other), 0.0)).mean(axis=1)
            wanted = 0.0 if one != other else 1.0 / 12.0 if one == 2 else spread**2
            assert np.abs(found - wanted).max() < 1e-9


@pytest.mark.parametrize("length", [0.3, 3.0, 30.0])
def test_averaged_beamlets_stand_for_the_moments_at_their_place(length: float) -> None:
    """Mean and variance of t given x + L t, against sums over the box. To make second moments exact moves the mean by
    less than a twentieth of what t is spread by, and changes the variance by less than a twentieth."""
    count = 96
    spread = float(np.sqrt(1.0 - edge_width(count) ** 2))
    along, times, _, left = averaged_positions(count, spread)
    row = int(np.abs(lengths(len(along)) - length).argmin())
    steps = (np.arange(4000) + 0.5) / 4000 - 0.5
    exact = float(lengths(len(along))[row])
    place = along[row] + exact * times[row]
    weight = np.exp(-0.5 * ((place[:, None] - exact * steps) / spread) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)
    mean = weight @ steps
    variance = weight @ steps**2 - mean**2
    assert np.all(np.abs(times[row] - mean) < 0.05 * np.sqrt(variance))
    assert np.allclose(left[row], variance, rtol=0.05)


@pytest.mark.parametrize("count", [48, 96])
def test_they_lie_evenly_across_the_travel(count: int) -> None:
    """Edges across the travel err by 1/(2k) at most, but for the exact variance; oblique ones less than a spiral's."""
    spread = float(np.sqrt(1.0 - edge_width(count) ** 2))
    along, times, across = swept_positions(count, spread)
    usual = edge_beamlets(count)
    for wanted in (2.5, 5.0, 8.0):
        row = int(np.abs(lengths(len(along)) - wanted).argmin())
        length = float(lengths(len(along))[row])
        place = np.sort(along[row] + length * times[row])
        middle = (np.arange(count) + 0.5) / count
        assert np.abs(passed(place, length, spread) - middle).max() < 0.5 / count
        ours, theirs = (
            np.mean(
                [
                    unevenness(x + length * t, y, length, spread, angle)
                    for angle in np.deg2rad(np.arange(-80.0, 81.0, 20.0))
                ]
            )
            for x, t, y in (
                (along[row], times[row], across[row]),
                (usual.nodes[:, 0], usual.times, usual.nodes[:, 1]),
            )
        )
        assert ours < 0.85 * theirs


def test_they_turn_with_the_travel_and_the_beam(device: Device) -> None:
    """Where the beam lands, places stretch along the spot's travel, whatever its direction and the beam's twist.

    Place and travel together have even quantiles along the travel; second moments stay those of the beam.
    """
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.config.scanner import Scanner
    from scanner_sim.optics.filter import peak_transmission
    from scanner_sim.render.beam.swept_beamlets import SweptBeamlets, SweptTables
    from scanner_sim.render.shots import Shots
    from scanner_sim.render.transport import OpticalLayout

    scanner = Scanner()
    sensor = scanner.position_sensor
    bench = OpticalLayout(
        scanner.laser,
        scanner.receiver,
        scanner.mirrors.axis_separation,
        peak_transmission(scanner.filter),
        sensor.pitch,
        sensor.height,
        sensor.offset,
        sensor.diffusion,
    )
    count, distance = 64, 10.0
    right, down = np.array([8e-4, -3e-4, 0.0, 0.0]), np.array([0.0, 5e-4, -6e-4, 0.0])
    theta = np.zeros(4)
    shots = Shots(
        dr.arange(mi.UInt32, 4),
        mi.Float(theta.astype(np.float32)),
        mi.Float(theta.astype(np.float32)),
        mi.Float(right.astype(np.float32)),
        mi.Float(down.astype(np.float32)),
    )
    split = SweptBeamlets.of(SweptTables.of(count), bench, shots, dr.full(mi.Float, distance, 4))
    lane = dr.arange(mi.UInt32, 4 * count)
    drawn = split.draw(lane % count, lane // count)
    node, weight, time = drawn.node, drawn.weight, drawn.time
    a, b = (np.asarray(values.numpy(), dtype=np.float64).reshape(4, count) for values in node)
    t = np.asarray(time.numpy(), dtype=np.float64).reshape(4, count)
    assert np.isclose(float(weight[0]) * count, 1.0)
    laser = scanner.laser
    twist = np.arctan((distance - laser.waist_distance) / laser.rayleigh_length)
    sigma = 0.5 * laser.waist_radius / np.cos(twist)
    # The ruled lines turn places by the twist on their way; the laser stands the mirrors' distance behind φ's axis.
    x = a * np.cos(twist) - b * np.sin(twist)
    y = a * np.sin(twist) + b * np.cos(twist)
    travel = np.stack([distance * right, (distance - bench.axis_separation) * down], axis=1) / sigma
    spread = float(np.sqrt(1.0 - split.tables.width**2))
    for shot in range(3):
        length = float(np.hypot(*travel[shot]))
        along = (x[shot] * travel[shot, 0] + y[shot] * travel[shot, 1]) / length + length * t[shot]
        quantiles = passed(np.sort(along), length, spread)
        assert np.abs(quantiles - (np.arange(count) + 0.5) / count).max() < 0.6 / count
    moments = np.stack([x, y, t], axis=1)
    covariance = np.einsum("nik,njk->nij", moments, moments) / count
    expected = np.diag([spread**2, spread**2, 1.0 / 12.0])
    assert np.abs(covariance - expected).max() < 2e-3


@pytest.mark.parametrize("row", [0, 1, 40, 200, 254])
def test_a_sweep_has_the_beamlets_of_its_length(device: Device, row: int) -> None:
    """Claim: a way of so many standard deviations of the beam where it lands asks for the row of that length, along Θ
    by R, along φ about its own axis; beyond the longest the last, with moments that are known so much better."""
    import drjit as dr
    import mitsuba as mi
    from prototype import Laser, Receiver

    from scanner_sim.render.beam.swept_beamlets import SweptBeamlets, SweptTables
    from scanner_sim.render.shots import Shots
    from scanner_sim.render.transport import OpticalLayout

    laser, distance, theta, separation = Laser(waist_distance=2.0), 8.0, 0.3, 0.05
    layout = OpticalLayout(laser, Receiver(), separation, 0.8, 50e-6, 250e-6, 1e-3, 0.0)
    sigma = 0.5 * laser.radius(distance)
    way = float(lengths(256)[row]) * sigma
    arm = distance * np.cos(theta) - separation
    right, down = (
        np.array([way / distance, 0.0, 0.6 * way / distance, 3.0 * LONGEST * sigma / distance]),
        np.array([0.0, way / arm, -0.8 * way / arm, 0.0]),
    )
    angle = dr.full(mi.Float, theta, 4)
    shots = Shots(
        dr.arange(mi.UInt32, 4), angle, dr.zeros(mi.Float, 4),
        mi.Float(right.astype(np.float32)), mi.Float(down.astype(np.float32)),
    )  # fmt: skip
    found = SweptBeamlets.of(SweptTables.of(19), layout, shots, dr.full(mi.Float, distance, 4))
    np.testing.assert_allclose(found.length.numpy(), [row, row, row, 255.0], atol=2e-2)
    np.testing.assert_allclose(found.briefer.numpy(), [1.0, 1.0, 1.0, 1.0 / 9.0], rtol=1e-5)


@pytest.mark.parametrize("way", [(6e-4, 0.0), (0.0, -8e-4), (-3e-4, 4e-4)])
def test_rays_and_moves_go_to_their_places(device: Device, way: tuple[float, float]) -> None:
    """Claim: a ray to (u, y) starts where the twist carries it to x along the travel and y across, with u = x + L t;
    beamlets that move by (u, y) move by x and y along the beam's axes there and by t of the dwell, of which u is
    x + L t and x and L t have the shares of their variances, 1 and L²/12."""
    import drjit as dr
    import mitsuba as mi
    from prototype import Laser, Receiver

    from scanner_sim.render.beam.swept_beamlets import SweptBeamlets, SweptTables
    from scanner_sim.render.shots import Shots
    from scanner_sim.render.transport import OpticalLayout

    laser, distance, separation = Laser(waist_distance=2.0), 8.0, 0.05
    layout = OpticalLayout(laser, Receiver(), separation, 0.8, 50e-6, 250e-6, 1e-3, 0.0)
    shots = Shots(mi.UInt32(0), mi.Float(0.0), mi.Float(0.0), mi.Float(way[0]), mi.Float(way[1]))
    split = SweptBeamlets.of(SweptTables.averaged(19), layout, shots, mi.Float(distance))
    travel = np.array([distance * way[0], (distance - separation) * way[1]]) / (0.5 * laser.radius(distance))
    length = float(np.hypot(*travel))
    along, across = travel / length, np.array([-travel[1], travel[0]]) / length
    u, y, none = mi.Float(0.8), mi.Float(-0.3), mi.UInt32(0)
    first, second, time = (float(value.numpy()[0]) for value in split.moved(u, y, none))
    moved = np.array([first, second])
    assert moved @ along + length * time == pytest.approx(0.8, rel=1e-5)
    assert moved @ across == pytest.approx(-0.3, rel=1e-5)
    assert length * time / (moved @ along) == pytest.approx(length**2 / 12.0, rel=1e-5)
    # Rays that stand for a place start at the moment that such a move takes, within the dwell.
    far = float(split.start(mi.Float(40.0), y, none)[1].numpy()[0])
    assert (float(split.start(u, y, none)[1].numpy()[0]), far) == (pytest.approx(time, rel=1e-5), 0.5)
    node, time = split.start(u, y, none)
    twist = np.arctan((distance - laser.waist_distance) / laser.rayleigh_length)
    turn = np.array([[np.cos(twist), -np.sin(twist)], [np.sin(twist), np.cos(twist)]])
    landed = turn @ np.array([float(value.numpy()[0]) for value in node])
    assert abs(float(time.numpy()[0])) <= 0.5
    assert landed @ along + length * float(time.numpy()[0]) == pytest.approx(0.8, rel=1e-5)
    assert landed @ across == pytest.approx(-0.3, rel=1e-5)
    # And beamlets are where they say.
    beamlet = dr.arange(mi.UInt32, 19)
    drawn, places = split.draw(beamlet, none), split.place(beamlet, none)
    landed = turn @ np.stack([value.numpy() for value in drawn.node])
    np.testing.assert_allclose(places[0].numpy(), along @ landed + length * drawn.time.numpy(), atol=1e-5)
    np.testing.assert_allclose(places[1].numpy(), across @ landed, atol=1e-5)
    # They stay there while their nodes drift.
    assert drawn.drift is not None
    landed += 0.3 * turn @ np.stack([np.broadcast_to(rate.numpy(), 19) for rate in drawn.drift])
    np.testing.assert_allclose(
        places[0].numpy(), along @ landed + length * (drawn.time.numpy() + 0.3), atol=2e-5
    )
    np.testing.assert_allclose(places[1].numpy(), across @ landed, atol=2e-5)


def test_a_beam_that_goes_beyond_the_tables_passes_the_faster(device: Device) -> None:
    """Claim: three times as far as the longest way that is tabled, nodes drift three times as fast, and beamlets that
    have one moment each do not drift."""
    import mitsuba as mi
    from prototype import Laser, Receiver

    from scanner_sim.render.beam.swept_beamlets import SweptBeamlets, SweptTables
    from scanner_sim.render.shots import Shots
    from scanner_sim.render.transport import OpticalLayout

    laser, none = Laser(), mi.UInt32(0)
    layout = OpticalLayout(laser, Receiver(), 0.05, 0.8, 50e-6, 250e-6, 1e-3, 0.0)
    way = 3.0 * LONGEST * 0.5 * laser.radius(8.0) / 8.0
    shots = Shots(none, mi.Float(0.0), mi.Float(0.0), mi.Float(way))
    for tables, speed in ((SweptTables.averaged(19), 3.0 * LONGEST), (SweptTables.of(19), None)):
        drift = SweptBeamlets.of(tables, layout, shots, mi.Float(8.0)).draw(none, none).drift
        found = None if drift is None else float(np.hypot(*(float(rate.numpy()[0]) for rate in drift)))
        assert found == (None if speed is None else pytest.approx(speed, rel=1e-4))


@pytest.mark.parametrize("count", [24, 48, 96, 512])
def test_where_beamlets_are_seen_from_shares_nothing_with_them(device: Device, count: int) -> None:
    """Claim: points of the aperture have its mean and covariance, 0 and ¼, and at rest and on the longest ways no
    covariance with where beamlets pass; in between less than 0.02 of both scatters."""
    from scanner_sim.render.beam.swept_beamlets import SweptTables

    tables, spread = SweptTables.averaged(count), np.sqrt(1.0 - edge_width(count) ** 2)
    points = np.stack([tables.stop_across.numpy(), tables.stop_normal.numpy()], axis=1).astype(np.float64)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-6)
    np.testing.assert_allclose(points.T @ points / count, 0.25 * np.eye(2), atol=1e-5)
    assert np.hypot(*points.T).max() < 1.1
    along, times, across, _ = averaged_positions(count, spread)
    for places in (along + lengths(256)[:, None] * times, across):
        shared = np.abs(places @ points / count) / (0.5 * places.std(axis=1)[:, None])
        assert shared.max() < 0.02
        assert shared[[0, -1]].max() < 1e-5


@pytest.mark.parametrize("count", [256, 900])
def test_rings_of_a_beam_hold_equal_shares_of_its_light(count: int) -> None:
    """Claim: beamlet i of n, counted outwards, stands where (i + ½)/n of a Gaussian's light is within. Tolerance: what
    makes the second moments exact moves the outermost by a hundredth of its radius; twice as much."""
    beamlets = edge_beamlets(count)
    radius = np.sort(np.hypot(*beamlets.nodes.T)) / np.sqrt(1.0 - edge_width(count) ** 2)
    wanted = np.sqrt(-2.0 * np.log(1.0 - (np.arange(count) + 0.5) / count))
    np.testing.assert_allclose(radius, wanted, rtol=0.0, atol=0.02 * wanted[-1])


def test_shots_of_a_batch_have_the_beamlets_that_each_has_alone(device: Device) -> None:
    """Claim: shots that go at other speeds, in other directions and to other distances are split side by side as each
    is by itself: nodes, moments, their variances and drifts, and the points of the aperture, to single precision."""
    import drjit as dr
    import mitsuba as mi
    from prototype import Laser, Receiver

    from scanner_sim.render.beam.swept_beamlets import SweptBeamlets, SweptTables
    from scanner_sim.render.shots import Shots
    from scanner_sim.render.transport import OpticalLayout, lanes

    layout = OpticalLayout(Laser(waist_distance=2.0), Receiver(), 0.05, 0.8, 50e-6, 250e-6, 1e-3, 0.0)
    theta = np.array([0.0, 0.1, -0.2])
    right, down = np.array([6e-4, 0.0, -3e-3]), np.array([0.0, -2e-3, 4e-4])
    reach, count, tables = np.array([3.0, 8.0, 20.0]), 19, SweptTables.averaged(19)

    def split(chosen: slice) -> dict[str, Array]:
        """Return columns of the lanes of some shots, shape (shots, beamlets)."""
        own = [mi.Float(part[chosen].astype(np.float32)) for part in (theta, 0.5 * theta, right, down, reach)]
        shots = Shots(dr.arange(mi.UInt32, dr.width(own[0])), *own[:4])
        found = lanes(SweptBeamlets.of(tables, layout, shots, own[4]), shots)
        assert found.drift is not None
        columns = {
            "node": found.node[0], "other node": found.node[1], "stop": found.stop[0], "other stop": found.stop[1],
            "time": found.time, "time_variance": found.time_variance, "drift": found.drift[0],
            "other drift": found.drift[1], "theta": found.own.theta, "travel": found.own.travel_phi,
        }  # fmt: skip
        return {name: np.array(values.numpy()).reshape(-1, count) for name, values in columns.items()}

    together, alone = split(slice(None)), [split(slice(row, row + 1)) for row in range(3)]
    for name, values in together.items():
        for row in range(3):
            np.testing.assert_allclose(values[row], alone[row][name][0], rtol=1e-5, atol=1e-6, err_msg=name)
    for name in ("node", "other node", "time"):
        assert np.abs(together[name][1:] - together[name][0]).max(axis=1).min() > 0.1, name


@pytest.mark.parametrize("waist", [0.0, 9.0])
@pytest.mark.parametrize("way", [0.0, 2.0, 5.0])
def test_a_beam_whose_chief_ray_misses_sweeps_where_its_rim_lands(
    device: Device, waist: float, way: float
) -> None:
    """Claim: of a beam that passes the rim of a plate with nothing behind, its middle beside it, the plate returns the
    share of a Gaussian that is swept by so many standard deviations, those at the plate's distance, wherever the
    beam's waist is.

    Set-up: the rim stands a quarter to two standard deviations beside the middle of the beam, across the sweep.
    Tolerance: one beamlet of the 96; half of one is what quantiles err by, and moments that are made exact move them.
    """
    import drjit as dr
    import mitsuba as mi
    from prototype import Laser, Receiver

    from scanner_sim.render.beam.line_projection import LineProjection
    from scanner_sim.render.beam.splitter import render_light
    from scanner_sim.render.settings import Transport
    from scanner_sim.render.shots import Shots
    from scanner_sim.render.transport import OpticalLayout
    from scanner_sim.scene.files.loader import load_scene
    from scanner_sim.scene.objects import Scene

    laser, distance = Laser(waist_distance=waist), 3.0
    layout = OpticalLayout(laser, Receiver(), 0.05, 0.8, 50e-6, 250e-6, 1e-3, 0.0)
    sigma = 0.5 * laser.radius(distance)
    plate = {"name": "plate", "shape": "rectangle", "size": (2.0, 2.0), "position": (-1.0, 0.0, distance)}
    loaded = load_scene(Scene(objects=({**plate, "material": {"reflectance": 0.5}},)))
    # The first shot meets the plate as a whole.
    beside = np.array([-40.0, 0.25, 0.5, 1.0, 1.5, 2.0])
    theta = mi.Float((beside * sigma / distance).astype(np.float32))
    travel = dr.full(mi.Float, way * sigma / distance, len(beside))
    shots = Shots(dr.arange(mi.UInt32, len(beside)), theta, dr.zeros(mi.Float, len(beside)), travel)
    truth, groups = render_light(loaded, LineProjection(layout), Transport(edge_beamlets=96), shots, 0)
    np.testing.assert_array_equal(np.isfinite(truth.distance.numpy()), beside < 0.0)
    power = np.zeros(len(beside))
    for light in groups:
        amount = light.amount.numpy().astype(np.float64).reshape(-1, light.shots)
        power[light.index.numpy()] += amount.sum(axis=0)
    np.testing.assert_allclose(power / power[0], passed(-beside, way, 1.0), rtol=0.0, atol=1.0 / 96)
