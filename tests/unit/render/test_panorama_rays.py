"""The rays of a panorama's bins: where in a bin they lie, and the random numbers that they take."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import mitsuba
import numpy as np
import pytest
from claims import mean, mean_square
from numpy.typing import NDArray

from scanner_sim.foundation.streams import Stream
from scanner_sim.render.background import panorama
from scanner_sim.render.background.view import rows_between

Array = NDArray[np.float64]
mi: Any = mitsuba
ROWS, BINS, LOOKS, ONWARD, SEED = 6, 19, 4, 2, 7
RAYS = LOOKS * ONWARD
TOGETHER = 16
"""Neighbouring bins that share out directions."""

pytestmark = pytest.mark.usefixtures("device")


def traced(monkeypatch: pytest.MonkeyPatch, rows: Any, part: int) -> dict[str, Any]:
    """Follow the rays of one half of some rows without light: where the looks lie, (looks, bins), and what they and the
    paths that go on from them draw: (looks, bins, 4), and of the first three of each path (paths, 3, bins, 4)."""
    known, found = panorama.generator, {"along": [], "across": [], "light": [], "draws": [], "asked": []}

    def noted(seed: int, stream: Stream, shot: Any, sample: Any) -> Any:
        assert (seed, stream) == (SEED, Stream.BACKGROUND)
        pair = np.broadcast_arrays(shot.numpy().astype(np.int64), sample.numpy().astype(np.int64))
        found["asked"].append(np.stack(pair, axis=-1))
        return known(seed, stream, shot, sample)

    def through(layout: Any, view: Any, row: Any, column: Any, along: Any, across: Any) -> tuple[Any, Any]:
        found["row"], found["column"] = row.numpy(), column.numpy()
        found["along"].append(along.numpy())
        found["across"].append(across.numpy())
        return along, across

    def follow(loaded: Any, sky: Any, bounces: int, look: Any, inside: Any, *counts: Any) -> tuple[Any, Any]:
        assert counts == (LOOKS, ONWARD)
        for number in range(LOOKS):
            sight = look(mi.UInt32(number))
            found["light"].append(sight.light.numpy().T)
            for path in range(ONWARD):
                later = [sight.random(mi.UInt32(path), mi.UInt32(draw)) for draw in (2, 3)]
                draws = [draw.numpy().T for draw in (sight.scatter(mi.UInt32(path)), *later)]
                found["draws"].append(draws)
        return None, None

    monkeypatch.setattr(panorama, "generator", noted)
    monkeypatch.setattr(panorama, "rays_through", through)
    monkeypatch.setattr(panorama, "height_on_pixel", lambda layout, view, across: across)
    monkeypatch.setattr(panorama, "sum_paths", follow)
    monkeypatch.setattr(panorama, "for_rows", lambda loaded, row: loaded)
    view: Any = SimpleNamespace(bins=BINS, rows=ROWS)
    _, _, entry, inside = panorama._trace_rows(
        *(None,) * 3,  # type: ignore[arg-type]
        view, rows, part, (LOOKS, ONWARD), 2, SEED,
    )  # fmt: skip
    monkeypatch.undo()
    lit = inside.numpy()
    order = np.flatnonzero(lit)[np.argsort(entry.numpy()[lit])]
    place = found["row"].astype(int)[order] * BINS + found["column"].astype(int)[order]
    np.testing.assert_array_equal(place, rows[0] * BINS + np.arange(len(rows) * BINS))
    np.testing.assert_array_equal(place, entry.numpy()[order])
    each = {name: np.array(found[name])[:, order] for name in ("along", "across", "light")}
    each["draws"] = np.array(found["draws"])[:, :, order]
    each["asked"] = [pairs[order] if len(pairs) == len(lit) else pairs for pairs in found["asked"]]
    return each


@pytest.fixture(scope="module")
def halves(device: Any) -> list[dict[str, Any]]:
    with pytest.MonkeyPatch.context() as patch:
        return [traced(patch, np.arange(ROWS), part) for part in range(2)]


def test_each_look_lies_in_its_part_of_a_bin(halves: list[dict[str, Any]]) -> None:
    """Claim: the kth of n looks lies evenly in the kth nth of a bin's width, in which 12 (u − ½)² is 1 on average; over
    the height golden sections leave no gap between four looks but of g², g³ and g⁴ of it, from an even start."""
    along = np.array([half["along"] for half in halves])
    part = LOOKS * (along + 0.5) - np.arange(LOOKS)[:, None]
    assert part.min() >= -1e-6
    assert part.max() <= 1.0 + 1e-6
    assert mean(part, 0.5)
    assert mean(12.0 * (part - 0.5) ** 2, 1.0)
    across = np.array([half["across"] for half in halves])
    assert across.min() >= 0.0
    assert across.max() < 1.0
    assert mean(across[:, 0], 0.5)
    assert mean(12.0 * (across[:, 0] - 0.5) ** 2, 1.0)
    ordered = np.sort(across, axis=1)
    gaps = np.diff(ordered, axis=1, append=ordered[:, :1] + 1.0)
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    np.testing.assert_allclose(
        np.abs(gaps[..., None] - golden ** np.array([2, 3, 4])).min(axis=-1), 0.0, atol=1e-5
    )


def test_no_number_is_drawn_twice(halves: list[dict[str, Any]]) -> None:
    """Claim: no two rays of a panorama draw from one address, in either half; each row's pattern has its own."""
    every = np.concatenate([pairs for half in halves for pairs in half["asked"]])
    # Each look asks twice, and so does each of its paths before it leaves the first surface.
    assert len(every) == 2 * (ROWS * BINS * (1 + LOOKS * 2 + RAYS * (2 + 2)) + len(halves[0]["asked"][0]))
    starts = np.unique(np.concatenate([half["asked"][0] for half in halves]), axis=0)
    own = np.concatenate([pairs for half in halves for pairs in half["asked"][1:]])
    assert len(starts) == 2 * ROWS
    assert len(np.unique(own, axis=0)) == len(own)
    assert not set(map(tuple, starts)) & set(map(tuple, own))


def test_a_rows_numbers_do_not_depend_on_the_rows_beside_it(
    halves: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = traced(monkeypatch, np.arange(3, 5), 1)
    part = slice(3 * BINS, 5 * BINS)
    for name in ("along", "across", "light", "draws"):
        whole = halves[1][name][:, :, part] if name == "draws" else halves[1][name][:, part]
        np.testing.assert_array_equal(alone[name], whole)


def test_sixteen_bins_share_out_the_directions(halves: list[dict[str, Any]]) -> None:
    """Claim: the directions of the first surface are spread more evenly over 16 neighbours than at random, from a start
    of each row and half; those of later surfaces are random.

    Set-up: 64 looks and 128 paths of each row and half, eight cells of one number, and 2 × 4 and 4 × 2 of those that
    are directions in pairs. Counts of random ones, n to a cell, have the variance n · 7/8, and on average over the
    directions less than half of it once in 10⁴ times (χ² of 84 for one number alone). Those of the sequences have 0.16
    to 0.38 of it in eight drawings of the starts, but for the Sun's disc in 4 × 2 cells: 64 looks are 1.4 to 2.1 times
    as uneven as random ones there.
    """

    def flat(values: Array) -> Array:
        assert values.min() >= 0.0
        assert values.max() < 1.0
        count = len(values[0])
        rows = values.reshape(2, count, ROWS, BINS, 4)[..., :TOGETHER, :]
        return rows.transpose(4, 0, 2, 1, 3).reshape(4, 2 * ROWS, count * TOGETHER)

    def variance(cells: Array) -> Array:
        counts = np.array([np.bincount(row.astype(int), minlength=8) for row in cells])
        mean_count = cells.shape[1] / 8.0
        return ((counts - mean_count) ** 2).mean(axis=1) / (mean_count * 7.0 / 8.0)

    light = flat(np.array([half["light"] for half in halves]))
    scatter, *later = (flat(np.array([half["draws"][:, draw] for half in halves])) for draw in range(3))
    # Sun's disc: 0, 1; Earth: 2, 3; the direction of scattering: 1, 2; the fourth is free. The choice of a lobe, 0,
    # goes on by nearly 2/3: it takes more rays than these.
    pairs = ((light[0], light[1]), (light[2], light[3]), (scatter[1], scatter[2]))
    both = [
        variance(np.floor(n * one) * (8 // n) + np.floor(8 // n * other))
        for one, other in pairs
        for n in (2, 4)
    ]
    uneven = both.pop(1)
    assert np.mean(both) < 0.5
    assert np.mean(uneven) < 2.6
    assert np.mean([variance(np.floor(8.0 * one)) for pair in pairs for one in pair]) < 0.5
    for one in (*light, *scatter[:3]):
        assert len(np.unique(one[:, 0])) == 2 * ROWS
    for one in (scatter[3], *later[0], *later[1]):
        assert mean_square(np.sqrt(variance(np.floor(8.0 * one))), freedom=7.0 * 2 * ROWS)


@pytest.mark.parametrize("vertical", [(-0.0313, 0.0521), (0.0117, 0.0118), (-0.0449, -0.0207)])
def test_rows_between_reach_a_step_beyond_all_shots(vertical: tuple[float, float]) -> None:
    """Claim: half of a pixel's height apart, 1.25 mrad, on whole steps; one or two beyond the shots at the lower end,
    one to three at the upper, and their number does not depend on where on the grid the shots lie."""
    layout: Any = SimpleNamespace(height=250e-6, receiver=SimpleNamespace(focal_length=0.1))
    found = rows_between((-0.1, 0.2), vertical, layout, 1.5)
    step = 1.25e-3
    np.testing.assert_allclose(np.diff(found.phi), step, rtol=1e-9)
    np.testing.assert_allclose(found.phi / step, np.rint(found.phi / step), atol=1e-6)
    assert 1.0 <= (vertical[0] - found.phi[0]) / step <= 2.0
    assert 1.0 <= (found.phi[-1] - vertical[1]) / step <= 3.0
    moved = rows_between((-0.1, 0.2), (vertical[0] + 4e-4, vertical[1] + 4e-4), layout, None)
    assert len(moved.phi) == len(found.phi)
    assert (found.horizontal, found.time.tolist(), moved.time) == ((-0.1, 0.2), [1.5], None)
