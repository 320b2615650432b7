"""Lists of angles in files: units of every column, and how much a file may hold."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.scan.listed import read_angles

ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
THETA, PHI, TIME = np.array([0.1, -0.2, 0.05]), np.array([-0.3, 0.15, 0.25]), np.array([0.02, 0.5, 0.9])


def written(path: Path, columns: dict[str, np.ndarray]) -> Path:
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(f"{value!r}" for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("theta", ANGLES)
@pytest.mark.parametrize("phi", ANGLES)
@pytest.mark.parametrize("time", TIMES)
def test_columns_are_read_in_the_unit_of_their_heading(
    theta: str, phi: str, time: str, tmp_path: Path
) -> None:
    """Claim: the same angles and times in any units, in any order of the columns, are the same numbers."""
    held = {
        f"time_{time}": TIME / TIMES[time],
        f"phi_{phi}": PHI / ANGLES[phi],
        f"theta_{theta}": THETA / ANGLES[theta],
    }
    found = read_angles(written(tmp_path / "angles.csv", held))
    np.testing.assert_allclose([found.theta, found.phi, found.time], [THETA, PHI, TIME], rtol=1e-14)


@pytest.mark.parametrize(
    ("limit", "most", "words"),
    [
        ("MOST_LISTED", 3, "has 3 lines of angles; 2 are read"),
        ("_LONGEST_LINE", 18, "line 3: it is longer than 17"),
    ],
)
def test_a_list_is_read_up_to_its_limits(
    limit: str, most: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: so many lines, so many letters in a line, are read, and one more is refused by its number."""
    path = tmp_path / "angles.csv"
    path.write_text("theta_rad,phi_rad\n0.1,0.2\n0.30000000,0.40000\n0.1,0.5\n")
    monkeypatch.setattr(f"scanner_sim.scan.listed.{limit}", most)
    assert len(read_angles(path).theta) == 3
    monkeypatch.setattr(f"scanner_sim.scan.listed.{limit}", most - 1)
    with pytest.raises(InputError, match=words):
        read_angles(path)


@pytest.mark.parametrize(
    ("heading", "most"), [("theta_deg", 90.0), ("phi_mrad", 500.0 * math.pi), ("time_ms", 1e9)]
)
def test_a_number_is_a_deflection_or_a_time(heading: str, most: float, tmp_path: Path) -> None:
    """Claim: angles reach 90°, times ten days and more, both ways; what is beyond is told by line and column."""
    other = {name: np.array([0.0, 0.1]) for name in ("theta_deg", "phi_mrad") if name != heading}
    for share, possible in ((0.999999, True), (1.000001, False)):
        for sign in (-1.0, 1.0):
            values = (
                np.array([0.0, sign * share * most]) if sign > 0.0 else np.array([sign * share * most, 0.0])
            )
            path = written(tmp_path / "angles.csv", {**other, heading: values})
            if possible:
                assert read_angles(path).theta.shape == (2,)
                continue
            with pytest.raises(
                InputError, match=f"line {3 if sign > 0.0 else 2}, column {heading}: .* is no"
            ):
                read_angles(path)


def test_times_ascend_by_lines(tmp_path: Path) -> None:
    """Claim: a time that is no later than the one before is told by its line."""
    held = {"theta_deg": THETA, "phi_deg": PHI, "time_s": np.array([0.1, 0.2, 0.2])}
    with pytest.raises(InputError, match="line 4, column time: the time does not ascend"):
        read_angles(written(tmp_path / "angles.csv", held))
