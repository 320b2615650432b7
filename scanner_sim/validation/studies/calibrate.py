"""Calibration of the peak: its systematic error, measured as one would measure it on the bench.

A flat white target, square to the beam, is moved through the range in fractions of a pixel, and the measured position
is compared with the one that eq 1 gives for the target's range. The detector has no noise, the mirrors are still, the
light makes no speckle, and it is dark; nothing shakes, and the temperature is that of the calibration. The light is
that of the instrument as built, and eq 1 of the one that it believes to be: what its base, lens and array depart from
that is measured as well, as on a real bench. At each of a few positions along the line, hence widths of the spot, the
target passes through one pixel. To simulate many positions of it at once, targets stand above one another, each before
the beam at a φ of its own: the second mirror turns the whole triangulation, so that they are one target. Θ and φ are
positive throughout: Embree may lose hits of rays that it traces together as coherent when a component of their
directions changes its sign among them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scanner import Scanner
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.line.position_sensor import PositionSensor
from scanner_sim.foundation.errors import RunError
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.raster import RasterScan, raster_aim
from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.scene.objects import Scene
from scanner_sim.signals.line.bias_table import LARGEST_BIAS, BiasTable
from scanner_sim.signals.line.expected import ExpectedSpot

NODES, PLACES = 12, 48
"""Positions along the line, and positions of the target within a pixel."""
_SHIFTS = np.linspace(-1.0, 1.0, 97)
_BEYOND = 0.25
"""How far beyond the measured estimates the error is continued along a straight line [pixel]: noise can make a pixel
the brightest on which the spot is not centred."""
_REACH = 9.0
"""Least height of a target in 1/e² radii of the beam."""
_FARTHEST = 1000.0
"""Range beyond which no target is set up [m]."""
_THETA = 0.06
"""Deflection Θ at which it is measured, relative to the largest."""
_PHI = (0.1, 0.9)
"""First and last φ, relative to the largest."""
_FRACTION = 0.3
"""Share of the full well that the target's brightest pixel fills at most."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Passage:
    """The target's passage through one pixel: shape (m,).

    Attributes
    ----------
    width
        Expected standard deviation of the spot [pixel].
    range
        Range of the target in the middle of the pixel [m].
    phase
        True position, from the centre of the pixel that is the brightest [pixel].
    bias
        Estimate − truth [pixel].
    """

    width: float
    range: float
    phase: Floats
    bias: Floats


@guest()
def measure_bias(
    scenario: Scenario, *, device: DeviceChoice = "auto", progress: Callable[[int, int], None] | None = None
) -> tuple[BiasTable, tuple[Passage, ...]]:
    """Measure the systematic error of a scenario's estimator.

    Parameters
    ----------
    scenario
        Instrument and processing; scene, lighting and scan are left out, and so is a correction that it has.
    device
        Where to compute.
    progress
        Called with the positions done and the positions in all.

    Returns
    -------
    tuple
        The table, and the passages it was made from, by ascending width.

    Raises
    ------
    RunError
        If the target is not found often enough for a table, or is found farther away than a table reaches.
    """
    instrument = Instrument(_quiet(scenario, Scene(), _scan(scenario, 1)), device=device)
    nodes = tuple(_nodes(scenario, instrument.triangulation.spot))
    passages: dict[float, Passage] = {}
    for number, node in enumerate(nodes):
        passage = _passage(scenario, node, instrument.triangulation.spot, device)
        if passage is not None:
            passages[round(passage.width, 3)] = passage
        if progress is not None:
            progress(number + 1, len(nodes))
    if not passages:
        raise RunError(
            "the target was not found anywhere on the line.",
            remedy="Check laser.power, processing.validation and processing.threshold.",
        )
    found = tuple(passages[width] for width in sorted(passages))
    _within_reach(found)
    rows = np.stack([_row(passage) for passage in found])
    widths = np.array([passage.width for passage in found])
    return BiasTable(scenario.processing.peak, widths, _SHIFTS, rows), found


def _within_reach(passages: Sequence[Passage]) -> None:
    """Raise :class:`~scanner_sim.foundation.errors.RunError` if an error is beyond what a table holds."""
    errors = np.concatenate([passage.bias for passage in passages])
    largest = float(errors[np.abs(errors).argmax()])
    if abs(largest) > LARGEST_BIAS:
        raise RunError(
            f"positions err by up to {largest:.4g} px, and a table holds {LARGEST_BIAS:g} px: that is base, lens or "
            "array, and no estimator.",
            remedy="Calibrate these first, with scanner-sim selfcal, and name the file in processing.calibration.",
        )


def _nodes(scenario: Scenario, spot: ExpectedSpot) -> Iterator[int]:
    """Yield the pixels through which the target passes."""
    pixels = scenario.scanner.position_sensor.pixels
    margin = min(12, pixels // 4)
    first = max(margin, math.ceil(float(spot.pixel(_FARTHEST, *_deflection(scenario)))))
    yield from sorted({round(pixel) for pixel in np.linspace(first, pixels - 1 - margin, NODES)})


def _passage(scenario: Scenario, node: int, spot: ExpectedSpot, device: DeviceChoice) -> Passage | None:
    """Move the target through a pixel; None where it is not measured at half of its positions or more."""
    phase = (np.arange(PLACES) + 0.5) / PLACES - 0.5
    truth = node + phase
    deflection = _deflection(scenario)
    ranges = np.asarray(spot.range(truth, *deflection))
    width = math.sqrt(sum(spot.variances(float(node), *deflection)))
    brightest = spot.white / ranges.min() ** 2 * min(1.0, 0.4 / width)
    reflectance = min(1.0, _FRACTION * scenario.scanner.position_sensor.full_well / brightest)
    assumed = _assumed_sensor(scenario.scanner)
    position, status, nearest = (np.full(PLACES, np.nan) for _ in range(3))
    for part in _parts(scenario, float(ranges.min())):
        scene, scan = _targets(scenario, ranges[part], reflectance)
        instrument = Instrument(_quiet(scenario, scene, scan), device=device)
        count = len(ranges[part])
        aim = raster_aim(scan, np.arange(count, dtype=np.uint32), scenario.scanner.dwell)
        _, groups = instrument.expose(aim)
        for group in groups:
            theta = np.full(len(group.index), _theta(scenario), dtype=np.float32)
            peaks = instrument.triangulation.find(group.signal, theta, sensor=assumed)
            here = np.arange(PLACES)[part][group.index]
            position[here], status[here] = peaks.position.numpy(), peaks.status.numpy()
            nearest[here] = group.signal.lines().argmax(axis=1)
    valid = status == Status.VALID
    if valid.sum() < PLACES // 2:
        return None
    order = np.argsort((truth - nearest)[valid])
    return Passage(
        width=width,
        range=float(spot.range(float(node), *deflection)),
        phase=(truth - nearest)[valid][order],
        bias=(position - truth)[valid][order],
    )


def _row(passage: Passage) -> Floats:
    """Return the error by the estimate: measured, continued along a straight line, and constant beyond."""
    estimate = passage.phase + passage.bias
    order = np.argsort(estimate)
    estimate, bias = estimate[order], passage.bias[order]
    few = max(3, len(bias) // 8)
    low, high = (np.polyfit(estimate[part], bias[part], 1) for part in (slice(0, few), slice(-few, None)))
    start, end = estimate[0] - _BEYOND, estimate[-1] + _BEYOND
    positions = np.concatenate([[start], estimate, [end]])
    values = np.concatenate([[bias[0] - low[0] * _BEYOND], bias, [bias[-1] + high[0] * _BEYOND]])
    along = np.interp(_SHIFTS, positions, values)
    return np.asarray(np.clip(along, -LARGEST_BIAS, LARGEST_BIAS), dtype=np.float64)


def _parts(scenario: Scenario, nearest: float) -> Iterator[slice]:
    """Yield the targets that find room above one another."""
    radius = scenario.scanner.laser.radius(nearest)
    height = (_PHI[1] - _PHI[0]) * _largest(scenario) * (nearest - scenario.scanner.mirrors.axis_separation)
    count = max(1, min(PLACES, int(height / (_REACH * radius))))
    for start in range(0, PLACES, count):
        yield slice(start, min(start + count, PLACES))


def _largest(scenario: Scenario) -> float:
    return min(scenario.scanner.mirrors.max_deflection, 0.5)


def _theta(scenario: Scenario) -> float:
    return _THETA * _largest(scenario)


def _deflection(scenario: Scenario) -> tuple[float, float]:
    """Return sine and cosine of the deflection Θ."""
    return math.sin(_theta(scenario)), math.cos(_theta(scenario))


def _targets(scenario: Scenario, ranges: Floats, reflectance: float) -> tuple[Scene, RasterScan]:
    """Return targets square to the beam, one for each row of a scan."""
    separation = scenario.scanner.mirrors.axis_separation
    radius = scenario.scanner.laser.radius(float(ranges.max()))
    scan = _scan(scenario, len(ranges))
    theta, (_, phi) = _theta(scenario), scan.angles()
    step = (_PHI[1] - _PHI[0]) * _largest(scenario) / len(ranges)
    targets = []
    for number, (angle, distance) in enumerate(zip(phi.tolist(), ranges.tolist(), strict=True)):
        arm = distance * math.cos(theta) - separation
        targets.append(
            {
                "name": f"target_{number}",
                "shape": "rectangle",
                "size": (20.0 * radius, 0.95 * step * arm),
                # Eq 3, and a plate that is turned as the two mirrors turn the beam.
                "position": (
                    distance * math.sin(theta),
                    arm * math.sin(angle),
                    separation + arm * math.cos(angle),
                ),
                "rotation": [{"axis": "y", "angle": theta}, {"axis": "x", "angle": -angle}],
                "material": {"reflectance": reflectance},
            }
        )
    return Scene.model_validate({"objects": targets}), scan


def _scan(scenario: Scenario, rows: int) -> RasterScan:
    first, last = (share * _largest(scenario) for share in _PHI)
    theta = _theta(scenario)
    return RasterScan(
        rows=rows, columns=1, horizontal=(theta, theta), vertical=(first, last if rows > 1 else first)
    )


def _quiet(scenario: Scenario, scene: Scene, scan: RasterScan) -> Scenario:
    """Return the scenario with another scene and scan, in the dark, without any noise or correction, and at rest."""
    scanner = scenario.scanner
    shaken = scanner.as_built is not None and scanner.as_built.vibration is not None
    return scenario.changed(
        scanner={
            "laser": {"speckle": False},
            "position_sensor": {"noise": scanner.position_sensor.noise.only()},
            "mirrors": scanner.mirrors.still().steady(),
            "laser_off": 0.0,
            **({"as_built": {"vibration": None}} if shaken else {}),
        },
        scene=scene,
        scan=scan,
        lighting=Lighting(),
        processing={"bias_correction": "none", "range_gate": None},
    )


def _assumed_sensor(scanner: Scanner) -> PositionSensor:
    """Return the sensor as its estimators know it: with its noise, which gives the pixels their weights."""
    return scanner.position_sensor.changed(noise={"saturation": False, "dark": False, "quantisation": False})
