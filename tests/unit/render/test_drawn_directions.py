"""Which random numbers a panorama's bins take: blocks of their own, and sequences that go on from bin to bin."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from scanner_sim.render.background import panorama, paths

pytestmark = pytest.mark.usefixtures("device")


def numbers(values: Any) -> np.ndarray:
    return np.asarray(values.numpy(), dtype=np.float64)


def test_a_bins_sequence_goes_on_where_that_of_its_neighbour_ends() -> None:
    """Claim: numbers of 16 bins, N of each, are one Kronecker sequence of 16 N: along every axis each is a fixed step
    beyond the one before, round a circle, from bin to bin as well; a shift moves all of them by its share of a gap."""
    count, row, half = 5, 3, 1
    members = 16
    lane = dr.arange(mi.UInt32, members * count)
    bins, number = lane // count, lane % count
    pattern, many = panorama._Pattern(9, mi.UInt32(row), mi.UInt32(half), bins), mi.UInt32(count)
    still = mi.Vector4f(0.0)
    for drawn in (pattern.light(number, many, still), pattern.scatter(number, many, still, still)):
        columns = [values for column in drawn if np.ptp(values := numbers(column))]
        assert len(columns) >= 3
        for values in columns:
            steps = np.diff(values) % 1.0
            np.testing.assert_allclose(steps, steps[0], atol=4e-7)
    shifts = 0.25, 0.5, 0.75, 1.0
    width = (1.0 / (members * count)) ** 0.5
    moved = pattern.light(number, many, mi.Vector4f(*shifts))
    for shift, one, other in zip(shifts, pattern.light(number, many, still), moved, strict=True):
        np.testing.assert_allclose((numbers(other) - numbers(one)) % 1.0, shift * width, atol=4e-7)


@pytest.mark.parametrize("part", [0, 1])
def test_every_sample_of_every_half_draws_from_a_block_of_its_own(
    part: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: of a bin's 64 numbers for each path the last five are those of the look (two), the start, the lobes and
    the shift, the others those of surfaces after the first; a look has its first path's. Halves follow one another,
    and bins have addresses of their own. Directions are numbered through all paths of a bin."""
    looks, onward, bins, seen, in_order = 5, 2, 37, [], []
    samples = looks * onward
    real = panorama.generator

    def counting(seed: Any, stream: Any, address: Any, draw: Any) -> Any:
        if dr.width(address) > 1:
            seen.append((numbers(address), float(numbers(mi.UInt32(draw))[0])))
        return real(seed, stream, address, draw)

    def sums(loaded: Any, sky: Any, bounces: int, look: Any, inside: Any, *counts: Any) -> tuple[Any, Any]:
        def drawn_by(function: Any, *given: int) -> tuple[Any, list[float]]:
            begin = len(seen)
            found = function(*map(mi.UInt32, given))
            return found, sorted(one for _, one in seen[begin:])

        assert counts == (looks, onward)
        for number in range(looks):
            sight, drawn = drawn_by(look, number)
            block = 64 * (part * samples + number * onward)
            assert drawn == [block + 59, block + 60]
            for path in range(onward):
                assert drawn_by(sight.scatter, path)[1] == [block + 64 * path + n for n in (62, 63)]
                for draw in (2, 3, 7):
                    assert drawn_by(sight.random, path, draw)[1] == [block + 64 * path + draw]
        return None, None

    class Numbered(panorama._Pattern):
        def scatter(self, number: Any, count: Any, *rest: Any) -> Any:
            in_order.append((float(number[0]), float(count[0])))
            return super().scatter(number, count, *rest)

    monkeypatch.setattr(panorama, "generator", counting)
    monkeypatch.setattr(panorama, "_Pattern", Numbered)
    monkeypatch.setattr(panorama, "sum_paths", sums)
    monkeypatch.setattr(panorama, "for_rows", lambda *_: None)
    monkeypatch.setattr(panorama, "rays_through", lambda *_: (None, None))
    monkeypatch.setattr(panorama, "height_on_pixel", lambda *_: None)
    view: Any = SimpleNamespace(bins=bins)
    *_, address, inside = panorama._trace_rows(
        None,
        None,
        None,
        view,
        np.array([4, 5]),
        part,
        (looks, onward),
        2,
        11,  # type: ignore[arg-type]
    )
    assert seen[0][1] == 64 * part * samples + 61
    assert in_order == [(number, samples) for number in range(samples)]
    lanes = numbers(inside).astype(bool)
    assert sorted(numbers(address)[lanes]) == list(range(4 * bins, 6 * bins))


@pytest.mark.parametrize(
    ("samples", "finer", "counts"),
    [(12, 2, (4, 3)), (2, 1, (1, 1)), (6, 1, (1, 3)), (8, 1, (2, 2)), (10, 1, (2, 3))],
)
def test_both_halves_are_the_sharp_light_and_the_smooth_light_of_their_own_samples(
    samples: int, finer: int, counts: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: each half has half of the samples, more where rows lie far apart, no more than three from one look, and
    all looks have as many: 1, 3, 4, 5 and 12 are 1, 3, 2 × 2, 2 × 3 and 4 × 3. Its slow light is their mean, smooth by
    what its own first surfaces are, with rows as many bins apart as their angles say; its sharp light is added."""
    rows, bins = 5, 8
    view: Any = SimpleNamespace(time=None, rows=rows, bins=bins, step=2e-4, row_step=4.5e-4 * finer)
    asked, smoothed, assembled = [], [], []

    def traced(*given: Any) -> Any:
        some, part, counts = given[4], given[5], given[6]
        asked.append((some.tolist(), part, counts))
        at = np.concatenate([np.arange(bins) + row * bins for row in some]).astype(np.uint32)
        sums = [mi.Float(np.float32(100.0 * layer + 10.0 * part + at)) for layer in range(4)]
        found = SimpleNamespace(least=sums[0], most=sums[1], indirect=sums[2], indirect_out=sums[3])
        normal, point = [mi.Float(np.float32(part + at))] * 3, [mi.Float(np.float32(part - at))] * 3
        first = SimpleNamespace(normal=normal, material=mi.UInt32(at), point=point)
        return found, first, mi.UInt32(at), mi.Bool(np.ones(at.size, dtype=bool))

    def smoothing(layers: Any, features: Any, *shape: Any) -> Any:
        smoothed.append(([numbers(layer) for layer in layers], numbers(features.kind)[0], shape))
        return [layer * 2.0 for layer in layers]

    def sharp(*given: Any) -> Any:
        assert given[4:] == (7, 3)
        return [[mi.Float(0.25 + part), mi.Float(0.5 + part)] for part in range(2)]

    monkeypatch.setattr(panorama, "at_time", lambda *_: None)
    monkeypatch.setattr(panorama, "_trace_rows", traced)
    monkeypatch.setattr(panorama, "smooth", smoothing)
    monkeypatch.setattr(panorama, "evenly_sharp_light", sharp)
    monkeypatch.setattr(panorama, "_assemble", lambda _, __, halves: assembled.extend(map(numbers, halves)))
    monkeypatch.setattr(panorama, "_BINS_TOGETHER", 2 * bins)
    panorama.render_panorama(
        None,
        None,
        None,
        view,
        bounces=2,
        samples=samples,
        seed=3,
        sharp_samples=7,  # type: ignore[arg-type]
    )
    half = counts[0] * counts[1]
    assert asked == [(some, part, counts) for some in ([0, 1], [2, 3], [4]) for part in (0, 1)]
    entry = np.arange(rows * bins, dtype=np.float64)
    for part, (layers, first, shape) in enumerate(smoothed):
        for layer, values in enumerate(layers, start=2):
            np.testing.assert_allclose(values, (100.0 * layer + 10.0 * part + entry) / half, rtol=1e-6)
        assert first == part
        assert shape == (rows, bins, pytest.approx(2e-4 / (4.5e-4 * finer)))
    wanted = [
        (0.25, 0.5)[layer] + part + 2.0 * (200.0 + 100.0 * layer + 10.0 * part + entry) / half
        for part in (0, 1)
        for layer in (0, 1)
    ]
    for values, exact in zip(assembled, wanted, strict=True):
        np.testing.assert_allclose(values, exact, rtol=1e-6)


def test_every_other_path_asks_for_the_earth_with_even_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of 1000 paths whose numbers are even the half that asks has numbers that are even again, from 0 to 1, and
    counts twice; all ask for the Sun, with numbers of their own."""
    count = 1000
    even = (np.arange(count) + 0.5) / count
    columns = [np.roll(even, shift) for shift in (0, 100, 250, 600)]
    tracer = object.__new__(paths._Tracer)
    seen: list[Any] = []
    collected: list[Any] = []

    def sample_light(si: Any, active: Any, gain: Any, sample: Any, *_: Any) -> Any:
        seen.append((numbers(active).astype(bool), numbers(sample.x), numbers(sample.y)))
        return dr.select(active, gain, 0.0)

    vars(tracer).update(
        _light=None, _loaded=SimpleNamespace(material_of=mi.UInt32([0])), _limit=mi.UInt32(5),
        sample_light=sample_light, scatter=lambda *_, **__: (), shape_of=lambda *_: mi.UInt32(0),
        surface_of=lambda si, *_: SimpleNamespace(si=si, bands=mi.Vector2f(1.0)),
        collect=lambda *given: collected.append(given),
    )  # fmt: skip
    surface = dr.zeros(mi.SurfaceInteraction3f, count)
    surface.t = mi.Float(np.ones(count, np.float32))
    monkeypatch.setattr(paths, "meet", lambda *_, **__: surface)
    for name in ("sun_radiance", "earth_radiance", "pdf_sun", "pdf_earth"):
        monkeypatch.setattr(paths.sky, name, lambda *_: mi.Float(0.0))
    ray = dr.zeros(mi.Ray3f, count)
    every, one = mi.Bool(np.ones(count, dtype=bool)), mi.Float(np.ones(count, np.float32))
    draws = mi.Vector4f(*(mi.Float(np.float32(column)) for column in columns))
    tracer.turn(lambda _: draws, mi.UInt32(2), ray, every, 3.0 * one, one, ~every, mi.Vector2f(1.0), None)
    (sun, x, y), (earth, first, second) = seen
    assert sun.all()
    np.testing.assert_allclose((x, y), columns[:2], atol=1e-7)
    assert earth.sum() == count // 2
    np.testing.assert_allclose(np.sort(first[earth]), (np.arange(count // 2) + 0.5) / (count // 2), atol=1e-6)
    np.testing.assert_allclose(second, columns[3], atol=1e-7)
    assert numbers(collected[-1][3]).sum() == pytest.approx(3.0 * count)
