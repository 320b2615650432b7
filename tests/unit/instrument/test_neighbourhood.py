"""What neighbours add to a voxel: variance along the beam, refusals in every layer, the limit of mixed light."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import Scenario, load_scenario
from scanner_sim.analytic.beam import beam_radius
from scanner_sim.config.scanner import speckle_optics
from scanner_sim.detector.packets import dwell_average
from scanner_sim.foundation.status import Status
from scanner_sim.instrument import neighbourhood
from scanner_sim.instrument.neighbourhood import _travel, _Voxels, judge_neighbours
from scanner_sim.instrument.simulate import measure_scans
from scanner_sim.optics.speckle import packets_of
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.ranging.mixed_voxels import is_mixed
from scanner_sim.ranging.shared_noise import Overlap, SharedNoise
from scanner_sim.ranging.uneven import Raster

Array = NDArray[np.float64]

ROWS, COLUMNS, R = 9, 11, 5.0


def scenario(width: float = 0.01, validation: Any = None) -> Scenario:
    return load_scenario(
        {
            "schema": 1,
            "scanner": {"laser": {"speckle": False}},
            "scan": {
                "type": "raster", "rows": ROWS, "columns": COLUMNS, "horizontal": (0.2, 0.2 + width),
                "vertical": (-0.31, -0.302), "motion": "stepped",
            },
            "processing": {"validation": validation or {"isolated": None, "mixed": None}},
        }
    )  # fmt: skip


def layers(signal: Array) -> dict[str, NDArray[Any]]:
    """Return the layers of a facing wall, light apart."""
    one = np.ones((ROWS, COLUMNS))
    made = {
        "status": 0.0 * one, "range_m": R * one, "sigma_range_m": 1e-4 * one, "Y": signal, "snr_detection": 1e4 * one,
        "peak_px": 80.0 * one, "sigma_peak_px": 0.01 * one,
    }  # fmt: skip
    for number, axis in enumerate("xyz"):
        made |= {f"P.{axis.upper()}": R * one, f"sigma_{axis}_m": (1.0 + number) * 1e-4 * one}
    for number, pair in enumerate(("xy", "xz", "yz")):
        made[f"cov_{pair}_m2"] = (1.0 + number) * 1e-9 * one
    return {name: values.astype(np.float32) for name, values in made.items()}


def judged(given: dict[str, NDArray[Any]], width: float = 0.01) -> dict[str, NDArray[Any]]:
    found = {name: values.copy() for name, values in given.items()}
    judge_neighbours(scenario(width), found, np.arange(ROWS), np.arange(COLUMNS))
    return found


def test_unevenness_widens_range_and_point_along_the_beam() -> None:
    """Claim: what uneven light adds to σ_R it adds to the point's covariance along ∂X/∂R, and to nothing else."""
    steep = np.exp(0.8 * np.arange(COLUMNS))[None] * np.full((ROWS, 1), 1e5)
    given = layers(steep)
    found = judged(given)
    added = found["sigma_texture_m"].astype(np.float64)
    assert (added[2:-2, 2:-2] > 1e-3).all()
    np.testing.assert_allclose(found["sigma_range_m"], np.hypot(1e-4, added), rtol=1e-5)
    theta, phi = scenario().raster.angles()
    beam = coordinates(1.0, theta[None, :], phi[:, None], 0.0)
    for number, axis in enumerate("xyz"):
        wanted = np.hypot((1.0 + number) * 1e-4, beam[number] * added)
        np.testing.assert_allclose(found[f"sigma_{axis}_m"], wanted, rtol=1e-5)
    for number, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        wanted = (1.0 + number) * 1e-9 + beam[i] * beam[j] * added**2
        np.testing.assert_allclose(found[f"cov_{'xyz'[i]}{'xyz'[j]}_m2"], wanted, rtol=1e-4, atol=1e-12)
    np.testing.assert_array_equal(found["range_m"], given["range_m"])


def test_the_shift_is_that_of_the_lights_gradient() -> None:
    """Claim: light that falls as exp(−g x) moves the spot's middle by s² g, and the range by R/d times it.

    Along a row that the beam rests in; on a pitch δ the difference is widened by √(1 + δ²/(δ² + 5 s²)).
    """
    width = 0.002
    known = scenario(width)
    spot = 0.5 * known.scanner.laser.radius(R)
    pitch = R * width / (COLUMNS - 1)
    slope = 30.0
    even = np.exp(slope * pitch * np.arange(COLUMNS))[None] * np.full((ROWS, 1), 1e5)
    added = judged(layers(even), width)["sigma_texture_m"].astype(np.float64)[4, 5]
    coarse = (pitch / spot) ** 2
    wanted = R / known.scanner.receiver.baseline * spot**2 * slope * math.sqrt(1.0 + coarse / (coarse + 5.0))
    assert added == pytest.approx(wanted, rel=1e-3)


def test_even_light_adds_nothing() -> None:
    found = judged(layers(np.full((ROWS, COLUMNS), 1e5)))
    assert found["sigma_texture_m"].max() < 1e-5
    np.testing.assert_allclose(found["sigma_range_m"], 1e-4, rtol=1e-3)


@pytest.mark.parametrize("beside", [False, True])
def test_a_bend_moves_echoes_along_the_beam_and_light_does_not(beside: bool) -> None:
    """Claim: ranges by time of flight that bend have 0.3 s Δ²/δ for unevenness, s at rest though the raster is swept;
    it widens σ and the point along the beam. How the light changes says nothing, nor do lines that are there beside.
    """
    bend, width = 0.006, 0.01
    steep = np.exp(0.8 * np.arange(COLUMNS))[None] * np.full((ROWS, 1), 1e5)
    known = scenario(width).replace({"scan.motion": "continuous"})
    lines = layers(steep)
    lines["range_m"] += np.float32(bend) * (np.arange(COLUMNS, dtype=np.float32) - 5.0) ** 2
    given = {
        f"tof.{name}": values for name, values in lines.items() if name not in ("peak_px", "sigma_peak_px")
    }
    given |= layers(np.full((ROWS, COLUMNS), 1e5)) if beside else {}
    judge_neighbours(known, given, np.arange(ROWS), np.arange(COLUMNS))
    ranges = given["tof.range_m"].astype(np.float64)
    laser = known.scanner.laser
    spot = 0.5 * beam_radius(ranges, laser.waist_radius, laser.waist_distance, laser.wavelength)
    pitch = ranges * width / (COLUMNS - 1)
    wanted = 0.3 * spot / pitch * math.sqrt((2.0 * bend) ** 2 - 6e-8)
    added = given["tof.sigma_texture_m"].astype(np.float64)
    np.testing.assert_allclose(added[:, 2:-2], wanted[:, 2:-2], rtol=1e-3)
    np.testing.assert_allclose(given["tof.sigma_range_m"], np.hypot(1e-4, added), rtol=1e-5)
    theta, phi = known.raster.angles()
    beam = coordinates(1.0, theta[None, :], phi[:, None], 0.0)
    for number, axis in enumerate("xyz"):
        widened = np.hypot((1.0 + number) * 1e-4, beam[number] * added)
        np.testing.assert_allclose(given[f"tof.sigma_{axis}_m"], widened, rtol=1e-5)
    first = given["sigma_texture_m"]
    np.testing.assert_array_equal(first, 0.0 * added if beside else given["tof.sigma_texture_m"])


def test_uneven_light_and_a_bend_add_as_squares() -> None:
    """Claim: what a gradient of light moves a range by, and what a bend of the surface does, are independent errors.

    Tolerance: ranges differ by 1 % along the bend, and with them the lever of the light. Either alone is 30 % less.
    """
    steep = np.exp(0.04 * np.arange(COLUMNS))[None] * np.full((ROWS, 1), 1e5)
    bend = 0.006 * (np.arange(COLUMNS) - 0.5 * COLUMNS) ** 2
    added = []
    for light, depth in ((steep, 0.0), (1e5 + 0.0 * steep, bend), (steep, bend)):
        given = layers(light)
        given["range_m"] += np.float32(depth)
        added.append(judged(given)["sigma_texture_m"].astype(np.float64)[3:-3, 3:-3])
    assert 0.5 < (added[0] / added[1]).min() < (added[0] / added[1]).max() < 2.0
    np.testing.assert_allclose(added[2], np.hypot(added[0], added[1]), rtol=0.03)


@pytest.mark.parametrize(("share", "two"), [(0.98, False), (1.01, True)])
def test_light_is_mixed_beyond_slope_noise_and_doubt(share: float, two: bool) -> None:
    """Claim: beyond tan(steepest) times the distance and √(4.5² (σ₁² + σ₂²) + 4 (u₁² + u₂²))."""
    shape, pitch, spot = (3, 4), 0.02, 0.004
    own, other, doubt, more = 0.003, 0.004, 0.001, 0.002
    sigma, uneven = np.full(shape, own), np.full(shape, doubt)
    sigma[:, 2:], uneven[:, 2:] = other, more
    ranges = np.full(shape, R)
    steepest = math.radians(60.0)
    limit = math.tan(steepest) * pitch + math.sqrt(4.5**2 * (own**2 + other**2) + 4.0 * (doubt**2 + more**2))
    ranges[:, 2:] += share * limit
    none, apart = np.zeros(shape), np.full(shape, pitch)
    about = Raster(apart, apart, np.full(shape, spot), none)
    noise = SharedNoise(sigma**2, none, none, Overlap(apart / (2.0 * spot), apart / (2.0 * spot)))
    codes = np.full(shape, int(Status.VALID), dtype=np.uint32)
    found = is_mixed(ranges, noise, uneven, codes, np.zeros(shape, dtype=np.bool_), about, steepest)
    wanted = np.zeros(shape, dtype=bool)
    wanted[:, 1:3] = two
    np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize(("share", "two"), [(0.97, False), (1.03, True)])
def test_uneven_light_counts_once_where_light_is_mixed(share: float, two: bool) -> None:
    """Claim: the limit of mixed light takes σ without its part by uneven light, √(σ² − u²), and that part apart."""
    known, steepest = scenario(), math.radians(60.0)
    noise, uneven = 0.003, 0.004
    given = layers(np.full((ROWS, COLUMNS), 1e5))
    given["sigma_range_m"][:] = math.hypot(noise, uneven)
    given["sigma_texture_m"] = np.full((ROWS, COLUMNS), uneven, dtype=np.float32)
    pitch = R * 0.01 / (COLUMNS - 1)
    limit = math.tan(steepest) * pitch + math.sqrt(2.0 * (4.5**2 * noise**2 + 4.0 * uneven**2))
    given["range_m"][:, 6:] += share * limit
    found = neighbourhood._mixed(_Voxels(known, given["range_m"].astype(np.float64)), given, steepest)
    wanted = np.zeros((ROWS, COLUMNS), dtype=bool)
    wanted[:, 5:7] = two
    np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize(("share", "lone"), [(0.98, False), (1.02, True)])
def test_a_lone_range_is_refused_beyond_the_slope_that_is_stated_for_it(share: float, lone: bool) -> None:
    """Claim: a range is isolated that differs from all of its neighbours by more than tan(steepest) times the distance
    and so many √2 σ, so that those across the corners decide; the slope from which light is mixed has no say."""
    steepest, sigmas, sigma = math.radians(55.0), 5.0, 1e-4
    judging = {"isolated": sigmas, "steepest": steepest, "mixed": math.radians(85.0)}
    known = scenario(validation=judging)
    given = layers(np.full((ROWS, COLUMNS), 1e5))
    corner = math.hypot(0.01 / (COLUMNS - 1), 0.008 / (ROWS - 1))
    given["range_m"][4, 6] += share * (math.tan(steepest) * R * corner + sigmas * math.sqrt(2.0) * sigma)
    found = neighbourhood._isolated(known, given, np.arange(ROWS), np.arange(COLUMNS))
    assert np.argwhere(found).tolist() == ([[4, 6]] if lone else [])


@pytest.mark.parametrize(("share", "two"), [(0.98, False), (1.02, True)])
def test_echoes_are_mixed_beyond_slope_and_noise(share: float, two: bool) -> None:
    """Claim: ranges of echoes differ beyond tan(steepest) times the distance and √(2 (4.5² σ² + 2² u²)), of what time
    of flight's own σ and its unevenness u are: those of the lines have no say."""
    known, steepest, noise, uneven = scenario(), math.radians(60.0), 0.003, 0.002
    given = layers(np.full((ROWS, COLUMNS), 1e5))
    given["sigma_range_m"][:], given["sigma_texture_m"] = 1.0, given["range_m"]
    own = {
        "sigma_range_m": math.hypot(noise, uneven),
        "sigma_texture_m": uneven,
        "status": 0.0,
        "snr_detection": 1e4,
    }
    for name, values in own.items():
        given[f"tof.{name}"] = np.full((ROWS, COLUMNS), values, dtype=np.float32)
    ranges = np.full((ROWS, COLUMNS), R)
    limit = math.tan(steepest) * R * 0.01 / (COLUMNS - 1)
    limit += math.sqrt(2.0 * (4.5**2 * noise**2 + 2.0**2 * uneven**2))
    ranges[:, 6:] += share * limit
    found = neighbourhood._mixed(_Voxels(known, ranges, "tof."), given, steepest)
    wanted = np.zeros((ROWS, COLUMNS), dtype=bool)
    wanted[:, 5:7] = two
    np.testing.assert_array_equal(found, wanted)


def test_encoders_are_known_as_at_the_time_of_their_shots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of a part of a raster the shots are row · columns + column, by which time and the encoders' drift go."""
    given = judged(layers(np.full((ROWS, COLUMNS), 1e5)))
    rows, columns = np.array([2, 4]), np.array([1, 3, 7])
    part = {name: values[np.ix_(rows, columns)] for name, values in given.items()}
    part |= {f"tof.{name}": values.copy() for name, values in part.items()}
    asked: list[NDArray[Any]] = []
    aim = neighbourhood.raster_aim

    def noted(scan: Any, shots: NDArray[Any], dwell: float) -> Any:
        asked.append(shots)
        return aim(scan, shots, dwell)

    monkeypatch.setattr(neighbourhood, "raster_aim", noted)
    neighbourhood._fuse_again(scenario(), part, rows, columns)
    assert asked[0].tolist() == [row * COLUMNS + column for row in (2, 4) for column in (1, 3, 7)]


@pytest.mark.parametrize(("refused", "kept"), [("", "tof."), ("tof.", "")])
def test_ranges_that_are_refused_beside_their_neighbours_have_no_unevenness(refused: str, kept: str) -> None:
    """Claim: of two ranges 0.1 m apart at σ of 0.1 and 1 mm the vaguer one is refused in every measured layer, of
    whichever rangefinder it is; the other one keeps all."""
    given = judged(layers(np.full((ROWS, COLUMNS), 1e5)))
    given |= {f"tof.{name}": values.copy() for name, values in given.items()}
    given["fused.status"] = given["status"].copy()
    given[f"{refused}range_m"][4, 5] += 0.1
    given[f"{refused}sigma_range_m"][4, 5] = 1e-3
    neighbourhood._fuse_again(scenario(), given, np.arange(ROWS), np.arange(COLUMNS))
    here = {name: values[4, 5] for name, values in given.items()}
    assert (here[f"{refused}status"], here[f"{kept}status"]) == (Status.INCONSISTENT, Status.VALID)
    measured = ("range_m", "sigma_range_m", "sigma_texture_m", "P.X", "sigma_z_m", "cov_xy_m2")
    assert all(np.isnan(here[f"{refused}{name}"]) for name in measured)
    assert all(np.isfinite(here[f"{kept}{name}"]) for name in measured)
    assert np.isfinite(given["tof.sigma_texture_m"]).sum() == ROWS * COLUMNS - (refused == "tof.")


def _voxels(known: Any, reach: NDArray[Any], packets: Any, left: tuple[float, float]) -> _Voxels:
    """Return voxels of known packets, of whose variances a dwell leaves some."""
    voxels = _Voxels(known, reach)
    vars(voxels).update(raster=Raster(reach, reach, reach, reach), packets=(packets, left))
    return voxels


def test_a_tilted_array_has_another_range_a_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a pixel is worth ∂R/∂p of the judge's pinhole with the array's scale h and slope g: (R − g d)² pitch/(h d)
    on the axis, by differences of R = h d/p + g d."""
    packets = SimpleNamespace(ratio=1.0, sigma=1.0, energy=1.0, on_surface=0.0)
    monkeypatch.setattr(neighbourhood, "_contrast", lambda _: 1.0)
    line = SimpleNamespace(scale=0.11, slope=0.6)
    receiver, sensor = SimpleNamespace(line_image=line, baseline=0.2), SimpleNamespace(pitch=50e-6)
    known: Any = SimpleNamespace(scanner=SimpleNamespace(receiver=receiver, position_sensor=sensor))
    place, half = 0.11 * 0.2 / (R - 0.6 * 0.2), 25e-6
    pixel = 0.11 * 0.2 / (place - half) - 0.11 * 0.2 / (place + half)
    one = np.ones((1, 1))
    found = neighbourhood._range_noise(_voxels(known, R * one, packets, (1.0, 1.0)), one)
    assert float(found.energy[0, 0]) == pytest.approx(pixel**2, rel=1e-3)


@pytest.mark.parametrize("sigma", [1.0, 1e-6])
def test_speckle_is_shared_as_energy_and_as_place_within_what_is_stated(
    monkeypatch: pytest.MonkeyPatch, sigma: float
) -> None:
    """Claim: of speckle's variance a quarter, which lies on the surface, is shared as the centroid is, the rest as the
    energy; sweeps leave 0.5 and 0.8 of them; all together is σ², of which speckle makes no more than there is."""
    packets = SimpleNamespace(ratio=0.5, sigma=2.0, energy=0.1, on_surface=0.25)
    monkeypatch.setattr(neighbourhood, "_contrast", lambda _: 0.7)
    known, reach = scenario(), np.full((1, 1), R)
    voxels = _voxels(known, reach, packets, (0.8, 0.5))
    found = neighbourhood._range_noise(voxels, np.full((1, 1), sigma))
    parts = [float(part[0, 0]) for part in (found.own, found.energy, found.position)]
    assert sum(parts) == pytest.approx(sigma**2)
    assert parts[1] / parts[2] == pytest.approx(0.75 * 0.8 / (0.25 * 0.5))
    receiver, pitch = known.scanner.receiver, known.scanner.position_sensor.pitch
    pixel = R**2 * pitch / (receiver.focal_length * receiver.baseline)
    speckle = (0.7 * pixel) ** 2 * 0.1 * (0.75 * 0.8 + 0.25 * 0.5)
    assert parts[1] + parts[2] == pytest.approx(min(speckle, sigma**2))


@pytest.mark.parametrize("ranging", ["triangulation", "tof", "both"])
def test_bands_judge_as_the_whole_image_does(monkeypatch: pytest.MonkeyPatch, ranging: str) -> None:
    """Claim: an image that is judged band after band has the bytes of one that is judged at once, at every row, with
    what is isolated, mixed, uneven and fused in it; a band is no lower than six times the rows that reach into it.

    A ball before an oblique wall, so that edges, voids and texture lie across the bands' ends.
    """
    ball = {
        "shape": "sphere",
        "diameter": 0.05,
        "position": [0.0, 0.0, 2.9],
        "material": {"reflectance": 0.6},
    }
    wall = {
        "shape": "rectangle",
        "size": (0.09, 1.0),
        "position": (0.0, 0.0, 3.0),
        "material": {"reflectance": 0.3},
    }
    scan = {"rows": 200, "columns": 24, "horizontal": (-0.05, 0.05), "vertical": (-0.4, 0.4)}
    objects = [{"name": "ball", **ball}, {"name": "wall", "rotation": {"axis": "y", "angle": 0.5}, **wall}]
    known = load_scenario({"schema": 1, "ranging": ranging, "scene": {"objects": objects}, "scan": scan})
    (measured,), _ = measure_scans([known], device="cpu", progress=None, batch=65536, threads=1)
    rows, columns, far = np.arange(200), np.arange(24), neighbourhood.reach(known)
    assert 0 < 6 * far < 100
    made = []
    for together in (200 * 24, 1):
        monkeypatch.setattr(neighbourhood, "_TOGETHER", together)
        made.append({name: values.reshape(200, 24).copy() for name, values in measured.items()})
        judge_neighbours(known, made[-1], rows, columns)
    assert len(neighbourhood.bands(200, 24, far)) == math.ceil(200 / (6 * far)) > 1
    assert neighbourhood.most_together(known) == min(8 * far, 200) * 24
    whole, banded = made
    assert list(whole) == list(banded)
    for name, values in whole.items():
        assert values.tobytes() == banded[name].tobytes(), name
    codes = set(np.unique(whole["status"]).tolist())
    assert {int(Status.VALID), int(Status.MIXED)} <= codes


def test_voxels_lie_apart_by_their_angles_in_radii_of_the_beam_there() -> None:
    """Claim: neighbours are a range times an angle apart, in 1/e² radii of the judge's beam there; images of spots
    have half of these radii as σ, in pixels, and a dwell averages over the way within it."""
    known = scenario().replace({"scan.motion": "continuous"})
    laser, sensor, focal = (
        known.scanner.laser,
        known.scanner.position_sensor,
        known.scanner.receiver.focal_length,
    )
    reach = np.array([[1.7, 4.1, 9.3]])
    voxels = _Voxels(known, reach)
    theta, phi = known.raster.angles()
    w = beam_radius(reach, laser.waist_radius, laser.waist_distance, laser.wavelength)
    np.testing.assert_allclose(voxels.overlap.across, reach * (theta[1] - theta[0]) / w, rtol=1e-9)
    np.testing.assert_allclose(voxels.overlap.down, reach * (phi[1] - phi[0]) / w, rtol=1e-9)
    image = (0.5 * w * focal / (reach * sensor.pitch)) ** 2
    wanted = packets_of(speckle_optics(known.scanner), image, image, known.scanner.seen_at(reach))
    found, left = voxels.packets
    for name in ("energy", "sigma", "on_surface"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), rtol=1e-9)
    way = reach * _travel(known)
    for part, exact in zip(left, dwell_average(way, 0.0 * way, w), strict=True):
        np.testing.assert_allclose(part, exact, rtol=1e-9)
