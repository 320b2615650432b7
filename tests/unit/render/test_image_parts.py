"""Parts of the image by hand: a spot cut by the pixels' height, the blur of the background."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba
import numpy as np
import pytest
from scipy.stats import norm

from scanner_sim.render.device import Device


@pytest.mark.parametrize("q", [0.0, 0.4, -0.7, 1.1])
def test_a_spot_cut_by_the_height_is_a_truncated_gaussian(device: Device, q: float) -> None:
    """Claim: share, mean and variance of p of a slanting Gaussian within |q| < h/2, by sums: 10⁻⁵ of the width.

    The spot is narrowed about its shifted middle, on either side of the pixels.
    """
    import drjit.auto.ad as auto

    from scanner_sim.render.beam.line_projection import cut_by_height

    var_p, var_q, covariance, height, p = 0.5, 0.3, 0.25, 1.2, 0.2
    found = cut_by_height(*(auto.Float(value) for value in (p, q, var_p, var_q, covariance, height)))
    grid = np.linspace(-0.5 * height, 0.5 * height, 20_001)
    weight = norm.pdf(grid, q, math.sqrt(var_q))
    weight[[0, -1]] *= 0.5
    middle = p + covariance / var_q * (grid - q)
    rest = var_p - covariance**2 / var_q
    share = weight.sum() * (grid[1] - grid[0])
    mean = np.average(middle, weights=weight)
    variance = rest + np.average((middle - mean) ** 2, weights=weight)
    got = [float(value[0]) for value in found]
    assert got == pytest.approx([share, mean, variance], abs=1e-5)


@pytest.mark.parametrize("spread", [0.9, 1.6])
def test_bins_are_blurred_to_the_point_spread_and_no_further(device: Device, spread: float) -> None:
    """Claim: a lit bin becomes a Gaussian of the point spread's variance less 1/6, for bins and the interpolation
    between them blur by 1/12 each; its light stays."""
    from scanner_sim.render.background import panorama as background

    mi: Any = mitsuba
    bins, rows, pitch = 101, 3, 50e-6
    line = np.zeros((rows, bins), dtype=np.float32)
    line[:, 50] = 1.0
    halves = [mi.Float(line.ravel()) for _ in range(4)]
    view: Any = SimpleNamespace(bins=bins, rows=rows, row_step=1.0)
    bench: Any = SimpleNamespace(point_spread=spread * pitch, pitch=pitch)
    panorama = background._assemble(view, bench, halves)
    seen = np.asarray(panorama.in_band.numpy(), dtype=np.float64).reshape(rows, bins)[1]
    place = np.arange(bins) - 50
    assert seen.sum() == pytest.approx(1.0, rel=1e-5)
    assert seen @ place == pytest.approx(0.0, abs=1e-5)
    # Cut at 3.5 of its width, a Gaussian keeps 0.9945 of its variance.
    assert seen @ place**2 == pytest.approx(spread**2 - 1.0 / 6.0, rel=0.02)


def test_a_bins_error_is_that_of_its_row_and_the_next_two(device: Device) -> None:
    """Claim: the squared error is averaged over three rows, the last twice at the rim.

    Set-up: both halves differ by 6 in the whole of the middle row of five, so that its mean errs by 3 there.
    """
    from scanner_sim.render.background import panorama as background

    mi: Any = mitsuba
    bins, rows, pitch = 61, 5, 50e-6
    line = np.ones((rows, bins), dtype=np.float32)
    other = line.copy()
    other[2] += 6.0
    halves = [mi.Float(values.ravel()) for values in (line, line, other, other)]
    view: Any = SimpleNamespace(bins=bins, rows=rows, row_step=1.0)
    bench: Any = SimpleNamespace(point_spread=0.8 * pitch, pitch=pitch)
    panorama = background._assemble(view, bench, halves)
    error = np.asarray(panorama.error.numpy(), dtype=np.float64).reshape(rows, bins)[:, 30]
    np.testing.assert_allclose(error, 3.0 / math.sqrt(3.0) * np.array([0.0, 1.0, 1.0, 1.0, 0.0]), atol=1e-5)


@pytest.mark.parametrize(("row", "wanted"), [(0.0, 10.0), (0.25, 12.5), (1.5, 30.0), (2.0, 40.0)])
def test_between_rows_the_background_is_interpolated(device: Device, row: float, wanted: float) -> None:
    from scanner_sim.render.background.panorama import Panorama

    mi: Any = mitsuba
    view: Any = SimpleNamespace(start=None, bins=3, rows=3, lattice=lambda: (0.0, 1.0, 2.0))
    layer = mi.Float(np.repeat([10.0, 20.0, 40.0], 3).astype(np.float32))
    panorama = Panorama(view, layer, layer, layer, layer)
    found = panorama.look(layer, mi.Float(row), mi.Float(1.0))
    assert float(found[0]) == pytest.approx(wanted, rel=1e-6)


def test_paths_of_a_lane_leave_their_extremes_their_sum_and_the_first_surface(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: three looks with two paths each add up: what comes from the first surface counts for each of its paths;
    the least and the most of direct light are those of a look and one of its paths together.

    Set-up: a lane's look k sees 3, 1, 2 (and 4, 6, 5) directly, path j of it another j/2, and by way of others 7 and
    10 k + j.
    """
    from scanner_sim.render.background import paths

    mi: Any = mitsuba
    zero = mi.Float([0.0, 0.0])

    def see(_: Any, origin: Any, direction: Any, light: Any, active: Any) -> tuple[Any, Any, Any]:
        assert dr.width(active) == 2
        seen = paths.Radiance(origin.x, zero, 7.0 + zero, 70.0 + zero)
        first = paths.FirstHit(mi.UInt32(origin.y), mi.Vector3f(origin.y), mi.Vector3f(origin.x))
        return seen, paths._Surface(None, light, None), first

    def follow(_: Any, total: Any, surface: Any, draws: Any, random: Any) -> Any:
        path = random(mi.UInt32(2))
        found = surface.bands + draws
        return paths.Radiance(
            total.direct + 0.5 * path, zero, total.indirect + found, total.indirect_out + 10.0 * found
        )

    def view(number: Any) -> Any:
        direct = mi.Float([3.0, 4.0]) + dr.select(number == 1, mi.Float([-2.0, 2.0]), 0.0)
        direct += dr.select(number == 2, mi.Float([-1.0, 1.0]), 0.0)
        origin = mi.Vector3f(direct, mi.Float(number) + 7.0, 0.0)

        def later(path: Any, draw: Any) -> Any:
            return dr.select(draw == 2, mi.Float(path), 99.0)

        return paths.Look(origin, None, 10.0 * mi.Float(number), lambda path: mi.Float(path), later)

    monkeypatch.setattr(paths._Tracer, "see", see)
    monkeypatch.setattr(paths._Tracer, "follow", follow)
    loaded: Any = SimpleNamespace(bodies=())
    light: Any = None
    active = mi.Bool([True, True])
    sums, first = paths.sum_paths(loaded, light, 1, view, active, 3, 2)
    indirect = 3 * 2 * 7.0 + (0 + 1 + 10 + 11 + 20 + 21)
    for part, wanted in (
        (sums.least, [1.0, 4.0]),
        (sums.most, [3.5, 6.5]),
        (sums.indirect, [indirect, indirect]),
        (sums.indirect_out, [10.0 * indirect, 10.0 * indirect]),
        (first.material, [7, 7]),
        (first.point.x, [3.0, 4.0]),
    ):
        np.testing.assert_allclose(part.numpy(), wanted)


@pytest.mark.parametrize("pitch", [50e-6, 80e-6])
def test_a_bins_error_is_that_of_the_mean_over_a_window(device: Device, pitch: float) -> None:
    """Claim: half the difference of both halves, meant over 200 µm about a bin, whose outermost bins count by the part
    that lies within; root mean square over eight bins to either side and the next rows. By plain sums."""
    from scanner_sim.render.background import panorama as background

    mi: Any = mitsuba
    rng, bins, rows = np.random.default_rng(3), 90, 3
    # Without a point spread nothing is blurred.
    one, two, three, four = rng.uniform(1.0, 3.0, (4, rows, bins)).astype(np.float32)
    halves = [mi.Float(values.ravel()) for values in (one, two, three, four)]
    view: Any = SimpleNamespace(bins=bins, rows=rows, row_step=1.0)
    found = background._assemble(view, SimpleNamespace(point_spread=0.0, pitch=pitch), halves)
    edges = np.arange(-40, 41)
    inside = np.clip(
        np.minimum(edges + 0.5, 100e-6 / pitch) - np.maximum(edges - 0.5, -100e-6 / pitch), 0.0, 1.0
    )
    window = inside / inside.sum()
    for mean, error, first, other in (
        (found.in_band, found.error, one, three),
        (found.out_of_band, found.error_out, two, four),
    ):
        told = mean.numpy().reshape(rows, bins)
        np.testing.assert_allclose(told, 0.5 * (first + other), rtol=1e-6)
        apart = 0.5 * (first - other).astype(np.float64)
        square = np.stack([np.convolve(row, window, "same") ** 2 for row in apart])
        near = np.stack([np.convolve(row, np.full(17, 1.0 / 17.0), "same") for row in square])
        wanted = np.sqrt(near.mean(axis=0))
        at = np.arange(30, 60)
        np.testing.assert_allclose(error.numpy().reshape(rows, bins)[1, at], wanted[at], rtol=1e-4)
