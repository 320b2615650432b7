"""The brightest pixel of a line, and the brightest that is no part of its peak, wherever they lie."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.signals.line.limits import Gate, Limits
from scanner_sim.signals.line.search import brightest_pixel, spot_pixel

Array = NDArray[np.float64]

PIXELS = 37

pytestmark = pytest.mark.usefixtures("device")


@pytest.mark.parametrize("apart", [3, 6, 7, 15])
def test_peaks_are_found_in_every_pixel(apart: int) -> None:
    """Claim: by plain comparison of all pixels; what lies more than six pixels away is another peak."""
    charges = np.random.default_rng(1).uniform(0.0, 10.0, (PIXELS, PIXELS)).astype(np.float32)
    place = np.arange(PIXELS)
    charges[place, (place + apart) % PIXELS] = 50.0
    charges[place, place] = 100.0
    table, shot = auto.Float(charges.ravel()), dr.arange(auto.UInt32, PIXELS)
    line: Any = SimpleNamespace(
        pixels=PIXELS,
        shots=PIXELS,
        floor_sigma=2.0,
        charge=lambda pixel: dr.gather(auto.Float, table, shot * PIXELS + pixel),
    )
    found = brightest_pixel(line)
    np.testing.assert_array_equal(found.pixel.numpy(), place)
    np.testing.assert_array_equal(found.height.numpy(), 100.0)
    np.testing.assert_array_equal(found.level.numpy(), 50.0)
    far = np.abs(place[:, None] - place) > 6
    wanted = np.where(far, charges, -np.inf).max(axis=1)
    np.testing.assert_array_equal(found.rival.numpy(), wanted)
    np.testing.assert_array_equal(found.rival_level.numpy(), 0.5 * wanted)


@dataclass
class Known:
    """What a plain search knows: limits a + b (pixel + origin)² of charge and flanks, and the least charge."""

    charge: tuple[float, float]
    dimmest: float
    flank: tuple[float, float]
    origin: float
    full: float
    gate: tuple[float, float, float] | None = None


def variance(side: float) -> float:
    return 9.0 + max(side, 0.0)


def plain_search(line: Array, away: int, known: Known) -> dict[str, float]:
    """Return what stands out most like a spot by the sentences of the module, pixel by pixel; ends are repeated."""
    last, peaks = len(line) - 1, []
    bright = broad = 0.0

    def at(pixel: int) -> float:
        return float(line[min(max(pixel, 0), last)])

    for here in range(last + 1):
        sides = [np.mean([at(here + sign * (away + k)) for k in range(3)]) for sign in (-1, 1)]
        side = float(max(sides))
        contrast = 0.25 * (at(here - 1) + 2.0 * at(here) + at(here + 1)) - side
        rises = at(here) > at(here - 1) or here == 0
        if not (rises and at(here) >= at(here + 1) and contrast > 0.0):
            continue
        square = (here + known.origin) ** 2
        most = known.charge[0] + known.charge[1] * square
        full = at(here) >= known.full and (most < known.full or contrast < 0.5 * known.full)
        if contrast > (0.0 if full else most):
            bright = max(bright, contrast)
            continue
        if contrast < known.dimmest * square:
            continue
        sigma = math.sqrt(variance(side))
        flank = 0.5 * (at(here - away + 1) + at(here + away - 1)) - side
        if flank > (known.flank[0] + known.flank[1] * square) * contrast + 3.0 * sigma:
            broad = max(broad, contrast)
            continue
        level = contrast / sigma
        inside = known.gate is not None and known.gate[0] <= here <= known.gate[1] and level > known.gate[2]
        rank = level + (1e5 if inside else 0.0)
        if peaks and here - peaks[-1][0] <= 6:
            if rank > peaks[-1][1]:
                peaks[-1] = (here, rank, contrast)
        else:
            peaks.append((here, rank, contrast))
    ranked = sorted(peaks, key=lambda one: (-one[1], one[0])) or [(0, 0.0, 0.0)]
    place, _, contrast = ranked[0]
    top = max((place, place - 1, place + 1), key=at)
    mean = 0.5 * at(place) + 0.25 * (at(place - 1) + at(place + 1))
    rival = ranked[1] if len(ranked) > 1 else (0, 0.0, 0.0)
    return {
        "pixel": top, "height": contrast, "rival": rival[2],
        "rival_level": rival[1] - (1e5 if ranked[0][1] >= 1e5 else 0.0), "brightest": line.max(),
        "level": (at(top) - mean + contrast) / math.sqrt(variance(mean - contrast)),
        "refused": bright > contrast, "broad": broad > contrast,
    }  # fmt: skip


@pytest.mark.parametrize(("away", "pixels", "gate"), [(4, 88, None), (6, 81, (30.0, 60.0, 5.0))])
def test_the_spot_is_found_by_a_plain_search(
    away: int, pixels: int, gate: tuple[float, float, float] | None
) -> None:
    """Claim: contrast, flanks, limits, ranks and rivals of 400 lines with spots, glints, struts and edges anywhere are
    those of plain sums, pixel by pixel."""
    rng, count, full = np.random.default_rng(6), 400, 1500.0
    place = np.arange(pixels)
    lines = rng.normal(0.0, 3.0, (count, pixels))
    for most, width in ((900.0, 1.2), (2500.0, 1.5), (500.0, 1.0), (1500.0, 5.0), (9000.0, 1.2)):
        middle = rng.uniform(-2.0, pixels + 2.0, (count, 1))
        height = most * rng.uniform(0.0, 1.0, (count, 1)) * (rng.random((count, 1)) < 0.7)
        height[:300] *= width > 3.0  # so that nothing outshines what is too broad, which a dozen are then
        lines += height * np.exp(-0.5 * ((place - middle) / width) ** 2)
    lines += rng.uniform(0.0, 2000.0, (count, 1)) * (place > rng.uniform(-40.0, pixels + 40.0, (count, 1)))
    lines = lines.astype(np.float32).astype(np.float64)
    known = Known((700.0, 0.12), 0.004, (0.2, 2e-5), 20.0, full, gate)
    table, shot = auto.Float(lines.ravel().astype(np.float32)), dr.arange(auto.UInt32, count)

    def charge(pixel: Any) -> Any:
        return dr.gather(auto.Float, table, shot * pixels + auto.UInt32(pixel))

    def pair(pixel: Any) -> Any:
        both = charge(pixel), charge(dr.minimum(auto.UInt32(pixel) + 1, pixels - 1))
        return *both, dr.maximum(*both)

    def noise(_: Any, side: Any) -> Any:
        return 9.0 + dr.maximum(side, 0.0)

    line: Any = SimpleNamespace(
        pixels=pixels, shots=count, charge=charge, pair=pair, variance=noise,
        window=SimpleNamespace(first=auto.UInt32(0), last=auto.UInt32(pixels - 1)),
        known=SimpleNamespace(full=auto.Float(full), dark=auto.Float(0.0)),
        beneath=lambda _, middle, side, __: (noise(0, side), middle >= full),
    )  # fmt: skip
    limits = Limits(
        (auto.Float(known.charge[0]), auto.Float(known.charge[1])), auto.Float(known.dimmest),
        (auto.Float(known.flank[0]), auto.Float(known.flank[1])), auto.Float(known.origin),
    )  # fmt: skip
    found = spot_pixel(line, away, limits, None if gate is None else Gate(*map(auto.Float, gate)))
    told = {
        name: np.asarray(getattr(found, name).numpy()).astype(np.float64)
        for name in ("pixel", "height", "level", "rival", "rival_level", "brightest", "refused", "broad")
    }
    wanted = [plain_search(one, away, known) for one in lines]
    for name, values in told.items():
        np.testing.assert_allclose(values, [one[name] for one in wanted], rtol=1e-3, atol=2e-2, err_msg=name)
    assert 0.1 < np.mean([one["refused"] for one in wanted]) < 0.9
    assert any(one["broad"] for one in wanted)
