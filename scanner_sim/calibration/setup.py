"""From a plan to its field: the instrument's design, surveyed targets, scale bars, and readings for the adjustment."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.calibration.network import Field, ScaleBars, Sightings, Targets
from scanner_sim.calibration.plan import Board, SelfCalibration
from scanner_sim.calibration.tables import SightingTable, read_points
from scanner_sim.config.calibration import design_digest, design_of
from scanner_sim.config.document import Document
from scanner_sim.config.load import load_scenario
from scanner_sim.config.reading import in_order, read_part
from scanner_sim.config.scanner import RangefinderName
from scanner_sim.config.scenario import Scenario
from scanner_sim.config.wording import choice
from scanner_sim.foundation.errors import Fault, InputError, ScenarioError
from scanner_sim.foundation.parameters import INDEX, PARAMETERS
from scanner_sim.foundation.streams import Stream, host_generator
from scanner_sim.optics.deflection import Mirrors, wobble_correlation
from scanner_sim.ranging.believed import Design, RangedBy
from scanner_sim.ranging.calibration import ideal_readings
from scanner_sim.scene.targets import target_positions
from scanner_sim.tracking.errors import pixel_correlation

Array = NDArray[np.float64]

_SURVEYED, _BARRED, STATIONED = 0, 1, 2
"""Draws of the stream of surveys: places of the targets, lengths of the bars, and the first of the stations."""
_FAINT = 1e-3
"""Share of the strongest part of what is common below which a part is left out."""
_STEP = 1e-6
"""Step of numerical slopes, [rad] or relative to the range."""


@dataclass(frozen=True)
class Setup:
    """A plan with everything that it names.

    Attributes
    ----------
    plan, base
        The plan, and the scenario of the instrument.
    by
        How its ranges are measured.
    places
        Where the targets stand along their boards' axes [m], by board and target: true ones where sightings are to be
        simulated, else surveyed ones.
    """

    plan: SelfCalibration
    base: Scenario
    by: RangedBy
    places: Mapping[str, Mapping[str, Array]]

    @property
    def rangefinder(self) -> RangefinderName:
        """What measures the ranges."""
        return "triangulation" if self.by == "triangulation" else "tof"

    @property
    def design(self) -> Design:
        """The instrument as designed."""
        return design_of(self.base.scanner)

    @property
    def digest(self) -> str:
        """What tells its design from others."""
        return design_digest(self.base.scanner)

    @property
    def names(self) -> tuple[str, ...]:
        """All targets, as ``board/target``."""
        return tuple(f"{board}/{name}" for board, places in self.places.items() for name in places)

    @property
    def standing(self) -> Array:
        """Where they stand in the field by the boards' poses [m], shape (T, 3)."""
        poses = (board.field_from_here() for board in self.plan.boards)
        parts = [
            np.array(list(places.values())) @ pose[:3, :3].T + pose[:3, 3]
            for pose, places in zip(poses, self.places.values(), strict=True)
        ]
        return np.concatenate(parts)

    def surveyed(self) -> Targets:
        """Return the targets as the adjustment knows them; the survey of what is simulated errs by its σ."""
        places = np.concatenate([np.array(list(one.values())) for one in self.places.values()])
        if self.plan.sightings is None:
            noise = host_generator(self.plan.seed, Stream.SURVEY, _SURVEYED).standard_normal(places.shape)
            places = places + self.plan.survey * noise
        board = np.repeat(np.arange(len(self.places)), [len(one) for one in self.places.values()])
        return Targets(self.names, board, places, self.plan.survey, tuple(self.places))

    def bars(self) -> ScaleBars:
        """Return the scale bars; those without a length have that of the field, with an error."""
        bars, number = self.plan.scale_bars, {name: index for index, name in enumerate(self.names)}
        ends = np.array([[number[end] for end in bar.between] for bar in bars], np.intp).reshape(-1, 2)
        sigma = np.array([bar.sigma for bar in bars])
        apart = np.linalg.norm(self.standing[ends[:, 1]] - self.standing[ends[:, 0]], axis=1)
        apart = apart + sigma * host_generator(self.plan.seed, Stream.SURVEY, _BARRED).standard_normal(
            len(bars)
        )
        given = [
            own if bar.length is None else bar.length for bar, own in zip(bars, apart.tolist(), strict=True)
        ]
        return ScaleBars(ends[:, 0], ends[:, 1], np.array(given), sigma)


def read_setup(path: Path) -> Setup:
    """Read a plan and what it names.

    Raises
    ------
    InputError
        If a file cannot be read.
    ScenarioError
        With all faults that could be found, in the order of the plan.
    """
    plan, document = read_part(path, SelfCalibration, "a self-calibration")
    base = load_scenario(plan.base)
    places = {board.name: _places(board) for board in plan.boards}
    faults = [*_unlike_base(plan, base, document), *_unknown_ends(plan, places, document)]
    for number, board in enumerate(plan.boards):
        if len(places[board.name]) > 1000:
            where = ("boards", number)
            faults.append(
                Fault(
                    f"boards[{number}]", "it has more than 1000 targets.", "Split it.", document.line(where)
                )
            )
    if faults:
        raise ScenarioError(in_order(faults), source=str(path))
    ranging = plan.ranging or base.rangefinders[0]
    by: RangedBy = "triangulation" if ranging == "triangulation" else base.scanner.lidar.photodiode.place
    return Setup(plan, base, by, places)


def _places(board: Board) -> dict[str, Array]:
    if board.points is not None:
        return {name: np.array(place) for name, place in read_points(board.points, board.name).items()}
    if board.array is None:
        return {}
    centres = target_positions(board.array.rows, board.array.columns, *board.array.spacing)
    return {str(number): place for number, place in enumerate(centres, start=1)}


def _unlike_base(plan: SelfCalibration, base: Scenario, document: Document) -> Iterator[Fault]:
    """Yield what the plan asks of an instrument that has it not."""
    if plan.ranging is None and len(base.rangefinders) > 1:
        problem = "the scenario measures by both ways, and a calibration goes by one of them."
        yield Fault("ranging", problem, "Write ranging: triangulation or tof.", document.line(("base",)))
        return
    ranging = plan.ranging or base.rangefinders[0]
    if ranging not in base.scanner.rangefinders:
        part = "position sensor" if ranging == "triangulation" else "time-of-flight unit"
        problem = f"{base.scanner.preset} has no {part}, which {ranging} asks for."
        yield Fault("ranging", problem, "Leave it out, or change base.", document.line(("ranging",)))
        return
    if plan.sightings is None and "triangulation" not in base.scanner.rangefinders:
        problem = (
            f"{base.scanner.preset} follows no targets without a position sensor: nothing can be simulated."
        )
        remedy = "Give sightings of your own, or change base."
        yield Fault("sightings", problem, remedy, document.line(("base",)))
    for name in plan.parameters.given:
        if ranging not in PARAMETERS[INDEX[name]].sources:
            problem = f"{ranging} does not see it: it moves no point that is measured so."
            line = document.line(("parameters", name))
            yield Fault(f"parameters.{name}", problem, "Remove it, or change ranging.", line)


def _unknown_ends(
    plan: SelfCalibration, places: Mapping[str, Mapping[str, Array]], document: Document
) -> Iterator[Fault]:
    for number, bar in enumerate(plan.scale_bars):
        for end, target in enumerate(bar.between):
            board, _, name = target.partition("/")
            if name not in places[board]:
                where = ("scale_bars", number, "between", end)
                yield Fault(
                    f"scale_bars[{number}].between[{end}]",
                    f"board {board} has no target '{name}'.",
                    choice(name, tuple(places[board])[:12]),
                    document.line(where),
                )


def field_of(setup: Setup, table: SightingTable) -> Field:
    """Return the field of a table of sightings: held-out boards and stations are in it.

    Raises
    ------
    InputError
        If a board was seen from nowhere, or a station of the plan has no sightings.
    """
    plan = setup.plan
    stations = tuple(dict.fromkeys((*(one.name for one in plan.stations), *table.station)))
    number = {name: index for index, name in enumerate(setup.names)}
    target = np.array([number[name] for name in table.target], np.intp)
    targets = setup.surveyed()
    blind = [f"station {name}" for name in stations if name not in table.station]
    blind += [
        f"board {name}"
        for name in np.array(targets.boards)[
            np.bincount(targets.board[target], minlength=len(targets.boards)) == 0
        ]
    ]
    if blind:
        raise InputError(
            f"There are no sightings of {', '.join(blind)}.",
            remedy="Turn stations and boards to one another, within the field of view, or remove them.",
        )
    theta, phi, r = table.position.T
    station = np.array([stations.index(name) for name in table.station], np.intp)
    readings = ideal_readings(setup.design, setup.by, r, theta, phi)
    slope = reading_slopes(setup.design, setup.by, table.position)
    own = table.covariance.copy()
    own[:, 2, 2] -= table.pixels**2
    own[:, (0, 1), (0, 1)] -= table.wobble[:, None] ** 2
    root = np.asarray(np.linalg.cholesky(slope @ own @ np.swapaxes(slope, 1, 2)), np.float64)
    common = common_of(table, station, slope, setup.base.scanner.mirrors)
    return Field(
        setup.design,
        plan.parameters.given,
        plan.encoder_period or math.tau,
        targets,
        Sightings(station, target, readings, root, common),
        stations,
        setup.bars(),
    )


def common_of(table: SightingTable, station: NDArray[np.intp], slope: Array, mirrors: Mirrors) -> Array:
    """Return what the readings of each station's sightings have in common, in independent parts (N, 3, k).

    Unlike pixels move the ranges of images that lie on them alike
    (:func:`~scanner_sim.tracking.errors.pixel_correlation`), and wobble the angles of what is close in time and in the
    other angle (:func:`~scanner_sim.optics.deflection.wobble_correlation`).

    Parameters
    ----------
    table, station
        Sightings, and the number of the station of each.
    slope
        ∂(ϑ, φ, measured)/∂(Θ, φ, R) of each, shape (N, 3, 3).
    mirrors
        Over which time and angle their wobble changes.
    """
    parts = []
    for number in range(int(station.max()) + 1):
        own = station == number
        width, image = table.image_width[own], table.image[own]

        def alike(values: Array, over: float, own: NDArray[np.bool_] = own) -> Array:
            return wobble_correlation((values[own][:, None] - values[own]) / over)

        together = alike(table.time, mirrors.wobble_time)
        theta, phi = (together * alike(table.position[:, 1 - axis], mirrors.wobble_angle) for axis in (0, 1))
        pixels = pixel_correlation((image[:, None] - image) / np.sqrt(width[:, None] * width))
        causes = ((0, table.wobble, theta), (1, table.wobble, phi), (2, table.pixels, pixels))
        moved = [
            slope[own][:, :, axis, None] * _root(sigma[own], share)[:, None] for axis, sigma, share in causes
        ]
        parts.append((own, np.concatenate(moved, axis=2)))
    result = np.zeros((len(station), 3, max(part.shape[2] for _, part in parts)))
    for own, part in parts:
        result[own, :, : part.shape[2]] = part
    return result


def _root(sigma: Array, correlation: Array) -> Array:
    """Return A with A Aᵀ the covariance of errors, of the parts that are not faint, shape (n, k)."""
    values, axes = np.linalg.eigh(sigma[:, None] * sigma * correlation)
    kept = values > _FAINT * values[-1]
    return np.asarray(axes[:, kept] * np.sqrt(values[kept]))


def reading_slopes(design: Design, by: RangedBy, position: Array) -> Array:
    """Return ∂(ϑ, φ, measured)/∂(Θ, φ, R) of an instrument as designed, shape (N, 3, 3), by central differences."""
    theta, phi, r = position.T

    def measured(off_theta: float, off_range: float) -> Array:
        return ideal_readings(design, by, r * (1.0 + off_range), theta + off_theta, phi).measured

    slopes = np.tile(np.eye(3), (len(r), 1, 1))
    slopes[:, 2, 0] = (measured(_STEP, 0.0) - measured(-_STEP, 0.0)) / (2.0 * _STEP)
    slopes[:, 2, 2] = (measured(0.0, _STEP) - measured(0.0, -_STEP)) / (2.0 * _STEP * r)
    return slopes
