"""Is σ true where a spot falls on more than one surface? Clutter, stripes, gloss and sunlight, drawn at random."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from scanner_sim.instrument.simulate import simulate
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, mean_of
from scanner_sim.validation.compare.mixed_scenes import Kind, MixedCoverage, MixedScene
from scanner_sim.validation.compare.test_bench import ANEW

_SCENES = 12
"""Scenes of each kind."""
_LEAST_SCENES = 2
"""Scenes of a kind with ranges in them, below which nothing is said of the kind."""
_LEAST_RANGES = 100
"""Ranges of a scene below which it tells nothing of shares of a hundredth: the laser is faint beside the Sun."""
_NOTHING = (math.nan,) * 3
_SIDE = 64
_NEAR, _FAR, _END = 1.6, 6.4, 0.9
"""Nearest and farthest middle of a scene over the nearest range on the axis, and the latter over the farthest: 2.5 m to
10 m for the preset."""
_WIDEST = 3.0
"""Largest distance of neighbouring voxels, in radii of the beam."""
_STRIPES = (1.5, 11.0)
"""Narrowest and widest stripe, in radii of the beam."""
_KINDS: tuple[Kind, ...] = ("clutter", "stripes", "glossy", "sunlit")
_CASES = ("within 1.96 σ", "beyond 3 σ", "beyond 6 σ")
_LEAST, _MOST = 0.94, 0.99
"""Share within 1.96 σ: what unevenness moves a range by has an upper end, so that σ is cautious where it rules."""
_BEYOND = (5e-3, 2e-4)
"""Shares beyond 3 σ and beyond 6 σ at most."""


def _fitting(setting: ComparisonSetup) -> str:
    scenario = setting.scenario
    if "triangulation" not in scenario.rangefinders:
        return "the scenario ranges by time of flight alone"
    if scenario.processing.validation.mixed is None or not scenario.processing.validation.uneven:
        return "processing.validation.mixed or uneven is switched off"
    corrected = scenario.processing.bias_correction != "none" or setting.own_peak
    if scenario.processing.peak != "maximum_likelihood" and not corrected:
        return f"{scenario.processing.peak} has a systematic error of its own"
    field = max(0.5 * _SIDE * _WIDEST * scenario.scanner.laser.radius(R) / R for R in _ranges(setting))
    if field > scenario.scanner.mirrors.max_deflection:
        return f"the mirrors do not reach over {_SIDE} voxels, {_WIDEST:g} radii of the beam apart"
    return ""


def _ranges(setting: ComparisonSetup) -> tuple[float, float]:
    """Return the nearest and the farthest middle of a scene [m]."""
    scanner = setting.scenario.scanner
    near, end = _NEAR * scanner.nearest_range, _END * scanner.farthest_range
    return min(near, end), min(_FAR * scanner.nearest_range, end)


def _scene(setting: ComparisonSetup, kind: Kind, seed: int) -> MixedCoverage:
    """Return what the scenario's instrument makes of a scene that is drawn about the beam's own size."""
    drawn = MixedScene.drawn(kind, seed, side=_SIDE, ranges=_ranges(setting))
    beam = float(setting.scenario.scanner.laser.radius(drawn.distance))
    random = np.random.default_rng([seed, 7])
    pitch = beam * float(np.exp(random.uniform(math.log(1.0), math.log(_WIDEST))))
    drawn = drawn.at(pitch=pitch, widths=(_STRIPES[0] * beam, _STRIPES[1] * beam))
    own = drawn.scenario()
    made = setting.scenario.changed(
        seed=seed,
        scene=own.scene,
        scan=own.scan,
        lighting=own.lighting,
        ranging="triangulation",
        transport=ANEW,
        processing={"range_gate": None},
    )
    return MixedCoverage.of(simulate(made, device=setting.device))


def _measure(setting: ComparisonSetup) -> dict[str, Measured]:
    found: dict[str, Measured] = {}
    for number, kind in enumerate(_KINDS):
        count = max(2, setting.shots(_SCENES)) * setting.seeds
        first = setting.seed(29, number)[0]
        scenes = [_scene(setting, kind, (first + 31 * index) % 2**31) for index in range(count)]
        rows = np.array([one.shares() if one.pulls.size >= _LEAST_RANGES else _NOTHING for one in scenes])
        if np.isfinite(rows).all(axis=1).sum() < _LEAST_SCENES:
            continue
        found |= {f"{kind}: {case}": mean_of(rows[:, column]) for column, case in enumerate(_CASES)}
    return found


@cache
def _expected() -> tuple[Predicted, ...]:
    within = Predicted("|R̂ − R| < 1.96 σ", "", 0.5 * (_LEAST + _MOST), 0.5 * (_MOST - _LEAST))
    far = [Predicted("|R̂ − R| > n σ", "", 0.5 * most, 0.5 * most, 1.0, "all ranges") for most in _BEYOND]
    return within, *far


def _predict(setting: ComparisonSetup) -> dict[str, Predicted]:  # noqa: ARG001 (σ is true of every instrument)
    return {f"{kind}: {case}": one for kind in _KINDS for case, one in zip(_CASES, _expected(), strict=True)}


UNEVEN = Law(
    "uneven",
    "The stated σ is true where surfaces meet",
    "shares of |estimate − truth|/σ",
    "At least 94 % within 1.96 σ, at most 0.5 % beyond 3 σ and 0.02 % beyond 6 σ, over all voxels with a range, edges "
    "included, of cluttered, striped, glossy and sunlit scenes drawn at random, 1.6 to 6.4 times as far as the nearest "
    "range (2.5 m to 10 m for the preset), in rasters from one to three radii of the beam. The scenes are the samples.",
    "signals",
    _fitting,
    _measure,
    _predict,
    exercises="peak",
)
