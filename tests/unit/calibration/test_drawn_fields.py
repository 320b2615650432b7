"""The numbers that the pictures of a self-calibration show."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from calibration_fields import made_field
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scanner_sim.calibration import pictures
from scanner_sim.calibration.adjustment import adjust
from scanner_sim.calibration.starts import start_of

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def result() -> Any:
    """Three boards of which the last is held out, without noise: each station sees all of them."""
    whole, _ = made_field(np.random.default_rng(5), stations=3, boards=3, noise=0.0)
    board = whole.targets.board[whole.sightings.target]
    field, held = whole.seeing(np.flatnonzero(board != 2)), whole.seeing(np.flatnonzero(board == 2))
    count = len(field.sought)
    both = adjust(whole, start_of(whole), robust=False)
    return SimpleNamespace(
        field=field,
        held=held,
        adjusted=adjust(field, start_of(field), robust=False),
        whole=both,
        sigma=field.tolerances * np.linspace(0.1, 0.7, count),
        values=field.tolerances * np.linspace(-1.5, 2.0, count),
        correlations=np.eye(count) - 0.25,
        fitted=SimpleNamespace(designed=21.5, calibrated=1.02),
        held_out=SimpleNamespace(designed=14.2, calibrated=1.04),
    )


def drawn(monkeypatch: pytest.MonkeyPatch, law: Any, result: Any) -> Figure:
    """Return the figure that a law draws."""
    made = Figure(figsize=(8.0, 6.0))

    @contextmanager
    def kept(*_: Any, **__: Any) -> Iterator[Figure]:
        yield made

    monkeypatch.setattr(pictures, "drawing", kept)
    law(result, "it.png")
    return made


def test_a_field_is_drawn_from_above_and_from_the_side(monkeypatch: pytest.MonkeyPatch, result: Any) -> None:
    """Claim: targets of each board stand where the adjustment has them, x to the right and z up, and z to the right and
    y down; a board that was held out stands where it would if it had been adjusted, and says so."""
    above, side = drawn(monkeypatch, pictures.draw_field, result).axes
    # Adjusted with the others it is in the same frame, that of the first board.
    poses = result.whole.unknowns
    for axes, (across, upward) in ((above, (0, 2)), (side, (2, 1))):
        own = result.field
        for number, name in enumerate(own.targets.boards):
            pose = result.adjusted.unknowns.boards
            places = (
                own.targets.places[own.targets.board == number] @ pose.rotation[number].T
                + pose.position[number]
            )
            (line,) = [one for one in axes.lines if one.get_label() == name]
            np.testing.assert_allclose(line.get_xydata(), places[:, [across, upward]], atol=1e-9)
        (held,) = [one for one in axes.lines if str(one.get_label()).endswith("held out")]
        assert str(held.get_label()).startswith(result.held.targets.boards[0])
        places = result.held.targets.places @ poses.boards.rotation[2].T + poses.boards.position[2]
        np.testing.assert_allclose(held.get_xydata(), places[:, [across, upward]], atol=2e-5)
    assert side.yaxis_inverted()
    assert not above.yaxis_inverted()
    assert (above.get_xlabel(), above.get_ylabel()) == ("x [m]", "z [m]")
    assert (side.get_xlabel(), side.get_ylabel()) == ("z [m]", "y [m]")


def test_residuals_are_drawn_over_the_field_and_against_range(
    monkeypatch: pytest.MonkeyPatch, result: Any
) -> None:
    """Claim: row by row those of Θ, φ and the range's reading, as colours up to three σ at the readings in degrees, and
    over the range of the points board by board."""
    field = result.field
    rng = np.random.default_rng(1)
    residuals = rng.normal(size=(len(field.sightings.target), 3))
    made = SimpleNamespace(field=field, adjusted=replace(result.adjusted, residuals=residuals))
    axes = drawn(monkeypatch, pictures.draw_residuals, made).axes[:6]
    seen, board = field.sightings.readings, field.targets.board[field.sightings.target]
    places = np.degrees(np.stack([seen.theta, seen.phi], axis=1))
    for row, name in enumerate(("Θ", "φ", "range reading")):
        left, right = axes[2 * row], axes[2 * row + 1]
        (dots,) = left.collections
        np.testing.assert_allclose(dots.get_offsets(), places, atol=1e-9)
        np.testing.assert_array_equal(dots.get_array(), residuals[:, row])
        assert dots.get_clim() == (-3.0, 3.0)
        assert left.yaxis_inverted()
        assert right.get_ylabel() == f"{name}: residual / σ"
        for number, own in enumerate(field.targets.boards):
            (line,) = [one for one in right.lines if one.get_label() == own]
            chosen = board == number
            np.testing.assert_array_equal(line.get_ydata(), residuals[chosen, row])
            unknowns = result.adjusted.unknowns
            world = (
                field.targets.places[field.sightings.target[chosen]] @ unknowns.boards.rotation[number].T
                + unknowns.boards.position[number]
            )
            stations = unknowns.stations.position[field.sightings.station[chosen]]
            np.testing.assert_allclose(line.get_xdata(), np.linalg.norm(world - stations, axis=1), atol=1e-4)


def test_parameters_are_drawn_over_their_tolerances(monkeypatch: pytest.MonkeyPatch, result: Any) -> None:
    """Claim: σ as bars beside bars of 1, sizes of values as marks; the correlations as they are; and the misfits before
    and after, of what was fitted and of what was held out, with their numbers."""
    bars, matrix, misfits, *_ = drawn(monkeypatch, pictures.draw_parameters, result).axes
    count = len(result.field.sought)
    widths = [one.get_width() for one in bars.patches]
    np.testing.assert_allclose(widths, [*np.ones(count), *np.linspace(0.1, 0.7, count)])
    (marks,) = bars.lines
    np.testing.assert_allclose(marks.get_xdata(), np.abs(np.linspace(-1.5, 2.0, count)))
    np.testing.assert_array_equal(marks.get_ydata(), np.arange(count))
    assert [one.get_text() for one in bars.get_yticklabels()] == [
        name.replace("_", " ") for name in result.field.sought
    ]
    np.testing.assert_array_equal(matrix.images[0].get_array(), result.correlations)
    assert matrix.images[0].get_clim() == (-1.0, 1.0)
    middles = [one.get_x() + 0.5 * one.get_width() for one in misfits.patches]
    np.testing.assert_allclose(middles, [-0.2, 0.8, 0.2, 1.2])
    assert [one.get_height() for one in misfits.patches] == [21.5, 14.2, 1.02, 1.04]
    assert [(one.get_text(), *one.xy) for one in misfits.texts] == [
        ("21.5", -0.2, 21.5), ("14.2", 0.8, 14.2), ("1.02", 0.2, 1.02), ("1.04", 1.2, 1.04)
    ]  # fmt: skip
    assert [one.get_text() for one in misfits.get_xticklabels()] == ["fitted", "held out"]
    assert misfits.get_ylim() == (0.5, 43.0)
