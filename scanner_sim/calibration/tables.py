"""Tables of a calibration: surveyed targets, and what was read of them from each station."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.wording import nearest
from scanner_sim.foundation.errors import Fault, InputError, ScenarioError
from scanner_sim.foundation.named_files import read_text_file

Array = NDArray[np.float64]

POINTS = ("target", "x_m", "y_m", "z_m")
ANGLES = ("theta_rad", "phi_rad", "range_m")
SIGMAS = tuple(f"sigma_{name}" for name in ANGLES)
CROSS = ("cov_theta_phi_rad2", "cov_theta_range_rad_m", "cov_phi_range_rad_m")
"""Covariances; a table without them has none."""
PIXELS = ("sigma_pixels_range_m", "image_pixel", "image_width_pixel")
WOBBLE = ("sigma_wobble_rad", "time_s")
"""What unlike pixels and the mirrors' wobble do; a table without them takes its sightings to be independent."""
_CORNERS = ((0, 1), (0, 2), (1, 2))
HEADING = "# scanner-sim sightings of instrument"
"""First line of a table of sightings, with the digest of the instrument's design; a table of your own needs none."""
_MOST = 1_000_000
"""Rows of a table."""
_SHOWN = 12
"""Names that a remedy lists."""
_FAR = (math.pi, math.pi, 1e5)
"""Largest angles [rad] and range [m]."""
_LEAST_OWN = 1e-12
"""Least share of the variance that a sighting has for itself, in any direction."""


@dataclass(frozen=True)
class SightingTable:
    """Sightings as the instrument believes them when it takes itself to be as designed, N of them.

    Attributes
    ----------
    station, target
        Names; a target's as ``board/target``.
    position
        (Θ, φ, R) by eq 3 as designed [rad, m], shape (N, 3).
    covariance
        Of each, shape (N, 3, 3).
    pixels
        σ of R by unlike pixels of the line sensor, which is in the covariance [m], shape (N,): sightings of one station
        have it in common as far as their images lie on the same pixels.
    image, image_width
        Position of the spot's image on the line and its standard deviation [pixel], shape (N,).
    wobble
        σ of Θ and of φ by the mirrors' wobble, which is in the covariance [rad], shape (N,): sightings of one station
        that are close in time and in the other angle have it in common.
    time
        When each was made [s], shape (N,).
    """

    station: tuple[str, ...]
    target: tuple[str, ...]
    position: Array
    covariance: Array
    pixels: Array
    image: Array
    image_width: Array
    wobble: Array
    time: Array


def read_points(path: Path, board: str) -> dict[str, tuple[float, float, float]]:
    """Return surveyed places along a board's axes [m], by the name of the target.

    Raises
    ------
    InputError
        If it cannot be read.
    ScenarioError
        With all faults of its rows.
    """
    places: dict[str, tuple[float, float, float]] = {}
    where: dict[tuple[float, ...], str] = {}
    faults: list[Fault] = []
    for line, row in _rows(path, POINTS, "Write a heading such as target,x_m,y_m,z_m.")[1]:
        if row.get("board", board) != board:
            continue
        name, before = row["target"], len(faults)
        place = tuple(_number(row, key, line, faults, 1e5) for key in POINTS[1:])
        known = len(faults) == before
        if name in places:
            faults.append(
                Fault("target", f"'{name}' is there twice.", "Give each target a name of its own.", line)
            )
        elif known and place in where:
            problem = f"'{name}' is where '{where[place]}' is."
            faults.append(Fault("target", problem, "Keep one of them, or correct its place.", line))
        places[name] = (place[0], place[1], place[2])
        if known:
            where[place] = name
    if not places and not faults:
        raise InputError(f"{path} has no targets of board {board}.", remedy="Check its column board.")
    if faults:
        raise ScenarioError(faults, source=str(path))
    return places


def read_sightings(path: Path, digest: str, targets: Sequence[str]) -> SightingTable:
    """Return sightings from a table.

    Parameters
    ----------
    path
        Columns ``station, target``, ``theta_rad, phi_rad, range_m`` and the ``sigma_`` of each; covariances
        ``cov_theta_phi_rad2, cov_theta_range_rad_m, cov_phi_range_rad_m`` may be there, and the part of σ of the range
        by unlike pixels, ``sigma_pixels_range_m``, with ``image_pixel`` and ``image_width_pixel``, and that of the
        angles by wobble, ``sigma_wobble_rad``, with ``time_s``.
    digest
        Of the instrument's design: a table that names another one is refused.
    targets
        Names that there are.

    Raises
    ------
    InputError
        If it cannot be read, or was measured with another instrument.
    ScenarioError
        With all faults of its rows.
    """
    columns = ("station", "target", *ANGLES, *SIGMAS)
    heading, rows = _rows(path, columns, f"Write a heading such as {','.join(columns)}.")
    if heading.startswith(HEADING) and heading.removeprefix(HEADING).strip() != digest:
        other = heading.removeprefix(HEADING).strip()
        raise InputError(
            f"{path} holds sightings of the instrument {other}, and the plan's is {digest}.",
            remedy="Take those of this instrument, or correct base; if the design is the same, remove the first line.",
        )
    faults: list[Fault] = []
    seen: dict[tuple[str, str], int] = {}
    position, covariance, pixels, wobble = [], [], [], []
    for line, row in rows:
        key, before = (row["station"], row["target"]), len(faults)
        if not row["station"]:
            faults.append(Fault("station", "it is empty.", "Name the station.", line))
        if row["target"] not in targets:
            faults.append(
                Fault("target", f"there is no target '{row['target']}'.", _near(row["target"], targets), line)
            )
        if key in seen:
            problem = f"station {key[0]} has seen '{key[1]}' in line {seen[key]} already."
            faults.append(Fault("target", problem, "Write the mean of both, with its σ.", line))
        seen.setdefault(key, line)
        position.append(
            [_number(row, name, line, faults, most) for name, most in zip(ANGLES, _FAR, strict=True)]
        )
        covariance.append(_covariance(row, line, faults))
        pixels.append(_pixels(row, line, faults))
        wobble.append(_wobble(row, line, faults))
        own = covariance[-1] - np.diag(np.square([*2 * [wobble[-1][0]], pixels[-1][0]]))
        if len(faults) == before and _least(own, covariance[-1]) <= _LEAST_OWN:
            problem = "without what unlike pixels and wobble do the covariance is not positive definite."
            remedy = (
                "Write covariances of the whole error, and parts of it that its correlations leave room for."
            )
            faults.append(Fault(CROSS[0], problem, remedy, line))
        if not position[-1][2] > 0.0:
            faults.append(Fault("range_m", f"{position[-1][2]:g} m is no range.", "", line))
    if not seen:
        raise InputError(
            f"{path} holds no sightings.", remedy="Write a row for each target from each station."
        )
    if faults:
        raise ScenarioError(faults, source=str(path))
    names = tuple(seen)
    return SightingTable(
        tuple(one for one, _ in names),
        tuple(one for _, one in names),
        np.array(position),
        np.array(covariance),
        *np.array(pixels).T,
        *np.array(wobble).T,
    )


def sightings_text(table: SightingTable, digest: str) -> str:
    """Return sightings as a table that :func:`read_sightings` reads."""
    stream = io.StringIO()
    stream.write(f"{HEADING} {digest}\n")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("station", "target", *ANGLES, *SIGMAS, *CROSS, *PIXELS, *WOBBLE))
    shared = (table.pixels, table.image, table.image_width, table.wobble, table.time)
    unlike = np.stack(shared, axis=1).tolist()
    for station, target, place, matrix, own in zip(
        table.station, table.target, table.position.tolist(), table.covariance, unlike, strict=True
    ):
        sigma = np.sqrt(np.diagonal(matrix)).tolist()
        cross = (float(matrix[corner]) for corner in _CORNERS)
        writer.writerow((station, target, *place, *sigma, *cross, *own))
    return stream.getvalue()


def points_text(boards: Mapping[str, Mapping[str, Sequence[float]]]) -> str:
    """Return the surveyed targets of all boards as a table that :func:`read_points` reads."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("board", *POINTS))
    for board, places in boards.items():
        writer.writerows((board, name, *map(float, place)) for name, place in places.items())
    return stream.getvalue()


def _rows(
    path: Path, columns: Sequence[str], remedy: str
) -> tuple[str, Iterator[tuple[int, dict[str, str]]]]:
    """Return the comment above a table, and its rows by column, each with its line."""
    lines = read_text_file(path).splitlines()
    if len(lines) > _MOST:
        raise InputError(f"{path} has {len(lines)} lines; {_MOST} are read.", remedy="Split it.")
    above = 1 if lines and lines[0].startswith("#") else 0
    heading = [name.strip() for name in lines[above].split(",")] if len(lines) > above else []
    missing = [name for name in columns if name not in heading]
    if missing:
        near = "; ".join(f"{name}: {_near(name, heading)}" for name in missing if heading)
        raise InputError(f"{path} has no column {', '.join(missing)}.", remedy=f"{remedy} {near}")
    if len(set(heading)) < len(heading):
        raise InputError(f"{path} has a column twice.", remedy=remedy)
    found = []
    for number, line in enumerate(lines[above + 1 :], start=above + 2):
        cells = [cell.strip() for cell in line.split(",")]
        if not line.strip():
            continue
        if len(cells) != len(heading):
            fault = Fault(
                "",
                f"it has {len(cells)} cells, and the heading {len(heading)}.",
                "Separate them by commas.",
                number,
            )
            raise ScenarioError([fault], source=str(path))
        found.append((number, dict(zip(heading, cells, strict=True))))
    return (lines[0] if above else ""), iter(found)


def _number(row: Mapping[str, str], name: str, line: int, faults: list[Fault], most: float) -> float:
    try:
        value = float(row[name])
    except ValueError:
        faults.append(
            Fault(name, f"'{row[name]}' is no number.", "Write it in SI units, with a decimal point.", line)
        )
        return 1.0
    if not abs(value) <= most:
        faults.append(Fault(name, f"{value:g} is not within ±{most:g}.", "Check its unit.", line))
        return 1.0
    return value


def _covariance(row: Mapping[str, str], line: int, faults: list[Fault]) -> Array:
    sigma = np.array(
        [_number(row, name, line, faults, most) for name, most in zip(SIGMAS, _FAR, strict=True)]
    )
    if not (sigma > 0.0).all():
        faults.append(Fault(SIGMAS[int(np.argmin(sigma))], "a standard deviation is above 0.", "", line))
        return np.eye(3)
    matrix = np.diag(sigma**2)
    for name, (i, j) in zip(CROSS, _CORNERS, strict=True):
        if row.get(name):
            matrix[i, j] = matrix[j, i] = _number(row, name, line, faults, 1e10)
    if _least(matrix, matrix) <= 1e-9:
        remedy = "Write covariances, not correlations, of the same row."
        faults.append(Fault(CROSS[0], "the covariance is not positive definite.", remedy, line))
        return np.diag(sigma**2)
    return matrix


def _least(part: Array, whole: Array) -> float:
    """Return the least eigenvalue of a part of a covariance in units of the whole one's σ."""
    sigma = np.sqrt(np.diagonal(whole))
    return float(np.linalg.eigvalsh(part / sigma / sigma[:, None])[0])


def _pixels(row: Mapping[str, str], line: int, faults: list[Fault]) -> tuple[float, float, float]:
    if not row.get(PIXELS[0]):
        return 0.0, 0.0, 1.0
    for name in PIXELS[1:]:
        if not row.get(name):
            faults.append(
                Fault(name, f"it is missing, and {PIXELS[0]} is given.", "Write both, or none.", line)
            )
            return 0.0, 0.0, 1.0
    sigma, image, width = (_number(row, name, line, faults, 1e5) for name in PIXELS)
    if not 0.0 <= sigma < _number(row, SIGMAS[2], line, [], _FAR[2]):
        remedy = f"It is a part of {SIGMAS[2]}."
        faults.append(Fault(PIXELS[0], f"{sigma:g} m are not from 0 to below {SIGMAS[2]}.", remedy, line))
    if not width > 0.0:
        faults.append(Fault(PIXELS[2], "a width is above 0.", "", line))
        return 0.0, 0.0, 1.0
    return sigma, image, width


def _wobble(row: Mapping[str, str], line: int, faults: list[Fault]) -> tuple[float, float]:
    if not row.get(WOBBLE[0]):
        return 0.0, 0.0
    if not row.get(WOBBLE[1]):
        fault = Fault(WOBBLE[1], f"it is missing, and {WOBBLE[0]} is given.", "Write both, or neither.", line)
        faults.append(fault)
        return 0.0, 0.0
    sigma, time = _number(row, WOBBLE[0], line, faults, _FAR[0]), _number(row, WOBBLE[1], line, faults, 1e9)
    least = min(_number(row, name, line, [], _FAR[0]) for name in SIGMAS[:2])
    if not 0.0 <= sigma < least:
        remedy = f"It is a part of {SIGMAS[0]} and {SIGMAS[1]}."
        faults.append(Fault(WOBBLE[0], f"{sigma:g} rad are not from 0 to below {least:g} rad.", remedy, line))
        return 0.0, 0.0
    return sigma, time


def _near(name: str, names: Sequence[str]) -> str:
    """Say which of some names was probably meant, or which there are."""
    near = nearest(name, list(names))
    if near:
        return f"Did you mean '{near}'?"
    return f"There are {', '.join(names[:_SHOWN])}{', …' if len(names) > _SHOWN else ''}."
