"""The error budget: each source of error alone and all together, for both ways of ranging and for their fusion.

On a facing flat target the range is measured many times at a few positions of the spot in its pixel, with one source
switched on while the estimator knows of them all: it weighs the samples as it does in a scan, so that the sources alone
add up to the whole in quadrature. What the estimator errs without any noise is taken off the errors, shot by shot,
and is a source of its own.

Where the scenario has light, all is measured under it but the noise of the laser's own light, ``shot`` and ``stray``:
``stray`` is by how much the light that the instrument as built scatters over the line raises the variance, ``sun`` by
how much that of Sun and Earth raises it beyond both. Ranges count from where the scanner is: of ``vibration``, and of
``power``, the scatter of the laser's, they have something only where a detector is not linear. ``drift`` is taken over
a whole course of the temperature. Jitter and wobble, which far away err less than single precision rounds, are enlarged
for their own row and their errors divided again; other sources that make less than 10⁻⁶ of the range are at that
rounding.

The beam turns during a dwell as in the scenario's scan, or as :func:`with_sweep` says: a sweep averages speckle.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from scanner_sim.config.built import with_serial_number
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.time_of_flight import EchoDelays
from scanner_sim.instrument.together import lanes_of
from scanner_sim.optics.deflection import Mirrors
from scanner_sim.products.budget import BudgetRow, Mode
from scanner_sim.ranging.fusion import fuse_points
from scanner_sim.ranging.ranges import Deflections, Ranges
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.render.shots import Shots
from scanner_sim.scan.protocol import Aim
from scanner_sim.scan.raster import RasterScan, raster_aim
from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.scene.objects import Scene
from scanner_sim.validation.studies.budget_sources import (
    ALL,
    LIFT,
    LIFTED,
    QUIET,
    STRAY,
    SUN,
    modes_of,
    quietened,
    sources_of,
)

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

FARTHEST = 30.0
"""Farthest distance of the target [m]."""
NEAREST = 0.1
"""Nearest distance of a target, where the gate begins at the scanner [m]."""
PIXEL_PHASES = 4
"""Positions of the spot in its pixel, or of the echo between two samples where there are no pixels."""
_SIDE = 22
"""Shots along each side of the target."""
HALF = 0.05
"""Deflection to each side at which the target is measured [rad]: far enough apart that no speckle is shared."""
_GOLDEN = 0.618
_AS_RANGE = (QUIET, "jitter", "wobble", "readout", "drift")
"""Sources of triangulation whose errors grow as R and not as R²: its bias, and what comes of deflections."""
_SPAN, _MOST = 8.0, 8
"""Ratio and number of distances that are measured in one launch."""
_FIXED = (QUIET, "response")
"""Sources that are the same for all shots at one position: one value for each position."""
_SQUARES = (ALL, "clock")
"""Sources of which the mean error counts, too."""


def distances_of(scenario: Scenario, count: int) -> Array:
    """Return evenly spaced distances in logarithms [m]: of an array from its nearest range to 30 m or its farthest.

    Of an instrument without an array over the gate of its time of flight.

    Raises
    ------
    InputError
        If the array sees nothing that is nearer than 30 m.
    """
    first, *_ = scenario.scanner.rangefinders
    seen = scenario.scanner.seen_by(first)
    nearest, farthest = 1.1 * seen[0], 0.9 * seen[1]
    if first == "tof":
        return np.geomspace(max(nearest, NEAREST), farthest, count)
    if nearest >= min(FARTHEST, farthest):
        raise InputError(
            f"the array sees ranges from {nearest:.4g} m only.",
            remedy="Raise position_sensor.pixels or pitch: the budget goes to 30 m.",
        )
    return np.geomspace(nearest, min(FARTHEST, farthest), count)


def course_time(scenario: Scenario) -> float:
    """Return the time [s] over which the budget's shots are spread.

    A period of the temperature's course, or the scan's duration; and long enough that no two shots wobble alike.
    """
    mirrors, raster = scenario.scanner.mirrors, scenario.raster
    course = mirrors.temperature
    whole = course.period if course.amplitude else raster.shots * scenario.scanner.dwell
    return max(whole, 2.0 * mirrors.wobble_time * _SIDE**2)


def kelvins_of(mirrors: Mirrors, time: float) -> float:
    """Return the root mean square of the temperature's difference [K] from the calibration over a time [s]."""
    steps = np.linspace(0.0, time, 1025)[:-1]
    return float(np.sqrt(np.mean(mirrors.temperature.difference(steps) ** 2)))


def with_sweep(scenario: Scenario, sweep: float | None) -> Scenario:
    """Return a scenario whose beam turns by an angle [rad] during a dwell; as it is for None, at rest for 0.

    Only what the budget takes from a scan is meant: its columns are as far apart as the angle.

    Raises
    ------
    InputError
        If the angle is no less than the field over which the budget measures.
    """
    if sweep is None:
        return scenario
    if not 0.0 <= sweep < 2.0 * HALF:
        raise InputError(
            f"a sweep of {sweep:g} rad during a dwell is not between 0 and {2.0 * HALF:g} rad.",
            remedy="Write for example --sweep '2 mrad', or --sweep '0 rad' for mirrors at rest.",
        )
    raster = scenario.raster
    if sweep == 0.0:
        return scenario.changed(scan={"motion": "stepped"})
    columns = max(2, raster.columns)
    half = 0.5 * sweep * (columns - 1)
    return scenario.changed(scan={"motion": "continuous", "columns": columns, "horizontal": (-half, half)})


@guest()
def measure_budget(
    scenario: Scenario,
    distances: Array,
    reflectance: float,
    *,
    device: DeviceChoice = "auto",
    progress: Progress | None = None,
) -> tuple[BudgetRow, ...]:
    """Measure the standard deviation of the range on a facing target, for each source alone and for all together.

    Parameters
    ----------
    scenario
        Instrument, processing and lighting; the scene is left out. The scan gives the sweep of a dwell. With
        ``ranging`` ``tof`` or ``both`` time of flight and the fused range are measured as well.
    distances
        Distances of the target [m].
    reflectance
        Of the target, Lambertian.
    device
        Where to compute.
    progress
        Called with the runs done and the runs in all.

    Returns
    -------
    tuple of BudgetRow
        For each way of ranging, source and distance, with 95 % intervals of χ² (of ``sun`` and ``stray`` by the normal
        law); the analytic value is left open. NaN where fewer than half of the shots have a range.
    """
    assumed = Instrument(_alone(scenario, ALL, Scene()), device=device)
    rows: dict[tuple[Mode, str], list[BudgetRow]] = {
        (mode, name): [] for mode in modes_of(scenario) for name in sources_of(scenario, mode)
    }
    parts = list(_together(distances))
    done, total = 0, len(parts) * len(rows)
    for part in parts:
        places = np.array([list(_pixel_phases(assumed, distances[step])) for step in part])
        targets = _Targets(scenario, assumed, places, _seeds(scenario, part), reflectance, device)
        ratios = (distances[part, None] / places)[..., None]
        errors: dict[tuple[Mode, str], Array] = {}
        for mode, name in rows:
            errors[mode, name] = targets.errors(mode, name) * _scale(mode, name, ratios)
            done += 1
            if progress is not None:
                progress(done, total)
        for (mode, name), made in rows.items():
            less = {STRAY: "shot", SUN: STRAY if (mode, STRAY) in rows else "shot"}.get(name)
            for number, step in enumerate(part):
                own = errors[mode, name][number]
                row = _row(name, own) if less is None else _row_of_more(own, errors[mode, less][number])
                made.append(BudgetRow(mode, name, float(distances[step]), math.nan, *row))
    return tuple(row for own in rows.values() for row in own)


def _together(distances: Array) -> Iterator[list[int]]:
    """Yield the indices of distances whose plates are measured in one launch, in their order.

    They have one size: in a plate that is far larger than what is lit of it, single precision places less well.
    """
    part: list[int] = []
    for step in range(len(distances)):
        near = distances[[*part, step]]
        if part and (len(part) == _MOST or near.max() > _SPAN * near.min()):
            yield part
            part = []
        part.append(step)
    if part:
        yield part


def _seeds(scenario: Scenario, part: list[int]) -> list[int]:
    """Return the seeds of the positions about some of the distances, one distance after the other."""
    return [
        (scenario.seed + 101 * step + 17 * index + 1) % 2**63
        for step in part
        for index in range(PIXEL_PHASES)
    ]


def _scale(mode: Mode, name: str, ratio: Array) -> Array:
    """Return what an error at a position about a distance is at it: R² for triangulation, R of those in deflections."""
    return np.asarray(ratio ** (0 if mode != "triangulation" else 1 if name in _AS_RANGE else 2))


def _row(name: str, errors: Array) -> tuple[float, float, float, int]:
    """Return the standard deviation of errors at a few positions, its interval and degrees of freedom.

    Errors have the shape (positions, shots).
    """
    if not _enough(errors):
        return math.nan, math.nan, math.nan, 0
    count = int(np.isfinite(errors).sum())
    if name in _FIXED:
        squares, freedom = np.nanmean(errors, axis=1) ** 2, len(errors)
    elif name in _SQUARES:
        squares, freedom = np.nanmean(errors**2, axis=1), count
    else:
        squares, freedom = np.nanvar(errors, axis=1, ddof=1), count - len(errors)
    sigma = float(np.sqrt(squares.mean()))
    low, high = (sigma * math.sqrt(freedom / float(chi2.ppf(share, freedom))) for share in (0.975, 0.025))
    return sigma, low, high, freedom


def _row_of_more(lit: Array, less: Array) -> tuple[float, float, float, int]:
    """Return the same for the root of what light adds to the variance, from the same shots with and without it."""
    if not _enough(lit) or not _enough(less):
        return math.nan, math.nan, math.nan, 0
    square, other = ((own - np.nanmean(own, axis=1, keepdims=True)) ** 2 for own in (lit, less))
    added = (square - other)[np.isfinite(square - other)]
    mean, error = float(added.mean()), float(added.std() / math.sqrt(added.size))
    sigma, low, high = (math.sqrt(max(mean + side * error, 0.0)) for side in (0.0, -1.96, 1.96))
    return sigma, low, high, added.size - len(lit)


def _enough(errors: Array) -> bool:
    """Tell whether at least half of the shots have a range, and some at each position."""
    finite = np.isfinite(errors)
    return bool(finite.any(axis=1).all() and finite.mean() >= 0.5)


def _pixel_phases(assumed: Instrument, distance: float) -> Iterator[float]:
    """Yield distances about one, at which the spot lies at even positions in its pixel, or the echo likewise."""
    scanner = assumed.scenario.scanner
    if "triangulation" not in scanner.rangefinders:
        step = 0.5 * SPEED_OF_LIGHT / scanner.lidar.digitiser.rate
        yield from (distance + ((index + 0.5) / PIXEL_PHASES - 0.5) * step for index in range(PIXEL_PHASES))
        return
    pixel = round(float(assumed.triangulation.spot.pixel(distance, 0.0, 1.0)))
    for index in range(PIXEL_PHASES):
        yield float(assumed.triangulation.spot.range(pixel + (index + 0.5) / PIXEL_PHASES - 0.5, 0.0, 1.0))


@dataclass(frozen=True)
class _RangedShots:
    """Ranges of the shots on a target by one way of ranging, the true ones [m], shape (n,), and where they went."""

    ranges: Ranges
    truth: Array
    deflections: Deflections

    @property
    def error(self) -> Array:
        return np.asarray(self.ranges.range - self.truth)


class _Targets:
    """Plates at some distances, shape (distances, positions), each seen by lanes of its own; loaded once for all."""

    def __init__(
        self,
        scenario: Scenario,
        assumed: Instrument,
        places: Array,
        seeds: Sequence[int],
        reflectance: float,
        device: DeviceChoice,
    ) -> None:
        known, size = with_serial_number(scenario), _size(scenario, places.max())
        runs = [
            _alone(known.changed(seed=seed), ALL, _plate(place, size, reflectance))
            for seed, place in zip(seeds, places.ravel().tolist(), strict=True)
        ]
        self.assumed, self.device, self.shape = assumed, device, places.shape
        self.scenario = known.changed(seed=seeds[0], scene=runs[0].scene)
        self.lit = Instrument(runs[0], device=device)
        own = _aim(scenario)
        # Under the Sun, too: a facing Lambertian plate that fills the view is as bright at every distance.
        aim, self.seeds, self.poses = lanes_of(runs, self.lit.loaded, own)
        self.aim = dataclasses.replace(aim, time=_moments(scenario, len(own.shot), len(runs)))
        self._kept: dict[tuple[Mode, str], _RangedShots] = {}

    def errors(self, mode: Mode, name: str) -> Array:
        """Return errors of the range by one source alone [m], NaN without one: shape (distances, positions, shots)."""
        found = self._fused() if mode == "fused" else self._measured(mode, name).error
        # The bias counts as a source of its own; in the dark, of the laser's shot noise, it is much the same.
        if name not in (QUIET, ALL):
            found = found - self._measured(mode, QUIET).error
        return (found / LIFT if name in LIFTED else found).reshape(*self.shape, -1)

    def _measured(self, mode: Mode, name: str) -> _RangedShots:
        if (mode, name) in self._kept:
            return self._kept[mode, name]
        made = _alone(self.scenario, name, self.scenario.scene)
        instrument = self.lit if name == ALL else Instrument(made, device=self.device, reuse=self.lit)
        found = self._by_time(instrument) if mode == "tof" else self._by_line(instrument)
        if name in (QUIET, ALL):
            self._kept[mode, name] = found
        return found

    def _fused(self) -> Array:
        one, other = self._measured("triangulation", ALL), self._measured("tof", ALL)
        fused, _, _ = fuse_points(one.ranges, other.ranges, one.deflections, self.assumed.geometry)
        return np.asarray(fused.range - one.truth)

    def _by_line(self, instrument: Instrument) -> _RangedShots:
        """Return what an instrument triangulates that takes itself for the assumed one."""
        shots, deflections = self._fired(instrument)
        own = self.assumed.triangulation
        instrument.triangulation.reader = own
        truth, groups = instrument.triangulation.expose(shots)
        line = own.gathered(len(self.aim.shot), groups)
        ranges = own.ranges(line.position, line.sigma, line.status, deflections)
        return _RangedShots(ranges, truth.distance.numpy().astype(np.float64), deflections)

    def _by_time(self, instrument: Instrument) -> _RangedShots:
        """Return what it measures by time of flight."""
        shots, deflections = self._fired(instrument)
        own = self.assumed.time_of_flight
        truth, _, groups = instrument.time_of_flight.listen(shots, own.detector)
        delays = EchoDelays.empty(len(self.aim.shot))
        for group in groups:
            delays.fill(group.index, group.delays, own.unit.digitiser)
        ranges = own.ranges(delays, deflections)
        return _RangedShots(ranges, truth.distance.numpy().astype(np.float64), deflections)

    def _fired(self, instrument: Instrument) -> tuple[Shots, Deflections]:
        shots, pointing = instrument.fire(self.aim, self.seeds, self.poses)
        return shots, instrument.deflections(self.aim, pointing, seeds=self.seeds)


def _raster(scenario: Scenario) -> RasterScan:
    """Return a raster over the target whose columns are as far apart as the scenario's."""
    travel = scenario.raster.travel
    columns = _SIDE if travel == 0.0 else max(2, math.floor(2.0 * HALF / travel) + 1)
    half = HALF if travel == 0.0 else 0.5 * travel * (columns - 1)
    return RasterScan(
        rows=math.ceil(_SIDE**2 / min(_SIDE, columns)),
        columns=columns,
        horizontal=(-half, half),
        vertical=(-HALF, HALF),
        motion="stepped" if travel == 0.0 else "continuous",
    )


def _aim(scenario: Scenario) -> Aim:
    """Return voxels of the raster over the target, far apart in place."""
    scan = _raster(scenario)
    columns = np.unique(np.linspace(0, scan.columns - 1, min(_SIDE, scan.columns)).round().astype(np.uint32))
    rows = np.arange(scan.rows, dtype=np.uint32)
    shots = (rows[:, None] * np.uint32(scan.columns) + columns[None, :]).ravel()
    return raster_aim(scan, shots, scenario.scanner.dwell)


def _moments(scenario: Scenario, count: int, lanes: int) -> Array:
    """Return times of so many shots in each of some lanes [s], far apart within each and in none of them the same.

    In a mixed order: a drift must not go with the deflection.
    """
    stride = round(_GOLDEN * count)
    while math.gcd(stride, count) > 1:
        stride += 1
    turn = (np.arange(count) * stride) % count
    later = np.arange(lanes)[:, None] / lanes
    return np.asarray((turn + later).ravel() / count * course_time(scenario))


def _size(scenario: Scenario, farthest: float) -> float:
    """Return the side of plates that hold all that is lit at a distance [m]."""
    scan = _raster(scenario)
    half = max(HALF, scan.horizontal[1]) + scan.travel
    return float(2.2 * half * farthest + 8.8 * scenario.scanner.laser.radius(farthest))


def _plate(distance: float, size: float, reflectance: float) -> Scene:
    """Return a facing plate, which each lane may have elsewhere."""
    plate = {
        "name": "target",
        "shape": "rectangle",
        "size": (size, size),
        "position": (0.0, 0.0, distance),
        "material": {"reflectance": reflectance},
        "motion": {"type": "twist", "velocity": (0.0, 0.0, 0.0), "turn_rate": (0.0, 0.0, 0.0)},
    }
    return Scene.model_validate({"objects": [plate]})


def _alone(scenario: Scenario, name: str, scene: Scene) -> Scenario:
    """Return the scenario before a scene, with one source of error, or with ``all``."""
    scanner = scenario.scanner
    lighting = Lighting() if name in ("shot", STRAY) else scenario.lighting
    if name != ALL:
        scanner = quietened(scanner, name)
    return scenario.changed(
        scanner=scanner,
        scene=scene,
        scan=_raster(scenario),
        lighting=lighting,
        processing={"range_gate": None},
    )
