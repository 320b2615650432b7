"""Scenes drawn at random whose spots fall on more than one surface: clutter, stripes, gloss, sunlight.

Nothing in them is chosen for an estimator: sizes, positions, turns, reflectances, range and raster come from the seed.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config import load_scenario
from scanner_sim.config.scenario import Scenario
from scanner_sim.products.image import RangeImage
from scanner_sim.validation.compare.test_bench import SceneKeys

Kind = Literal["clutter", "stripes", "glossy", "sunlit", "retro"]
KINDS: tuple[Kind, ...] = ("clutter", "stripes", "glossy", "sunlit", "retro")

_DULL = ("z93_white", "beta_cloth", "black_oxide", "dyed_black_anodise", "grey_reference")
_SHINY = ("weathered_aluminium", "oxidised_inconel", "solar_cell")
_STRIPES = (0.05, 0.8)
"""Reflectances of the stripes, in turn."""
RANGES = (2.5, 10.0)
"""Between which a scene's middle is drawn [m], unless others are asked for."""


@dataclass(frozen=True)
class MixedScene:
    """One such scene, and the raster that looks at it.

    Attributes
    ----------
    kind
        What stands in it.
    seed
        Of the scene and of the noise.
    distance
        Range of its middle [m].
    pitch
        Distance of neighbouring voxels at that range [m].
    side
        Voxels along either side of the raster.
    motion
        Of the raster.
    tilt
        Largest turn of the striped board about either axis [rad].
    widths
        Narrowest and widest stripe [m].
    speed
        Sideways velocity of what stands there [m/s].
    """

    kind: Kind
    seed: int
    distance: float = 4.0
    pitch: float = 4e-3
    side: int = 128
    motion: Literal["continuous", "stepped"] = "continuous"
    tilt: float = 0.0
    widths: tuple[float, float] = (4e-3, 30e-3)
    speed: float = 0.0

    @classmethod
    def drawn(cls, kind: Kind, seed: int, *, side: int = 128, ranges: tuple[float, float] = RANGES) -> Self:
        """Return a scene whose range, pitch, motion and tilt are drawn too."""
        random = np.random.default_rng([seed, 99])
        distance = float(np.exp(random.uniform(*np.log(ranges))))
        return cls(
            kind,
            seed,
            distance=distance,
            pitch=float(distance * np.exp(random.uniform(math.log(0.25e-3), math.log(2e-3)))),
            side=side,
            motion="continuous" if random.random() < 0.7 else "stepped",
            tilt=math.radians(50.0),
        )

    def at(self, **changes: Any) -> Self:
        """Return the scene with some attributes changed."""
        return replace(self, **changes)

    @property
    def half(self) -> float:
        """Half of the field [rad]."""
        return 0.5 * (self.side - 1) * self.pitch / self.distance

    def scenario(self, **changes: Any) -> Scenario:
        """Return the scenario of the preset's instrument before this scene; ``changes`` are its other keys."""
        random = np.random.default_rng(self.seed)
        objects = _stripes(random, self) if self.kind == "stripes" else _clutter(random, self)
        if self.speed:
            motion = {"type": "twist", "velocity": [self.speed, 0.0, 0.0]}
            objects = [item | {"motion": motion} for item in objects]
        lighting: dict[str, object] = {}
        if self.kind == "sunlit":
            sun = random.uniform([-0.8, -0.8, -1.0], [0.8, 0.2, -0.3])
            lighting = {"sun": {"direction": sun.tolist()}, "earth": {"direction": [0.0, 1.0, 0.0]}}
        return load_scenario(
            {
                "schema": 1,
                "seed": self.seed,
                "scene": {"objects": objects},
                "lighting": lighting,
                "scan": {
                    "type": "raster",
                    "rows": self.side,
                    "columns": self.side,
                    "horizontal": [-self.half, self.half],
                    "vertical": [-self.half, self.half],
                    "motion": self.motion,
                },
                **changes,
            }
        )


def _clutter(random: np.random.Generator, scene: MixedScene) -> list[SceneKeys]:
    """Return boxes and spheres of the field's scale before a wall of the same material, and gaps in it."""
    R, wide = scene.distance, 2.0 * scene.half * scene.distance
    objects = [
        {
            "name": "wall",
            "shape": "rectangle",
            "size": [1.1 * wide, 0.8 * wide],
            "position": [0.0, 0.15 * wide, R + 0.6 * wide],
            "rotation": _turns(random, math.radians(40.0)),
            "material": _material(random, scene.kind),
        }
    ]
    for number in range(12):
        x, y, z = random.uniform(-0.5, 0.5, 3) * wide
        item = {
            "name": f"item_{number}",
            "position": [x, y, R + z],
            "material": _material(random, scene.kind),
        }
        if random.random() < 0.5:
            size = (random.uniform(0.1, 0.4, 3) * wide).tolist()
            item |= {"shape": "box", "size": size, "rotation": _turns(random, math.pi)}
        else:
            item |= {"shape": "sphere", "diameter": float(random.uniform(0.1, 0.4) * wide)}
        objects.append(item)
    return objects


def _stripes(random: np.random.Generator, scene: MixedScene) -> list[SceneKeys]:
    """Return a board of upright stripes of two reflectances in turn, wider than the field."""
    wide = 2.4 * scene.half * scene.distance
    tilt, turn = random.uniform(-scene.tilt, scene.tilt, 2) if scene.tilt else (0.0, 0.0)
    reach = 0.5 * wide / math.cos(turn)
    edges = [-reach]
    while edges[-1] < reach:
        edges.append(edges[-1] + float(random.uniform(*scene.widths)))
    objects = []
    for number, (left, right) in enumerate(itertools.pairwise(edges)):
        middle = 0.5 * (left + right)
        objects.append(
            {
                "name": f"stripe_{number}",
                "shape": "rectangle",
                "size": [right - left, 1.2 * wide / math.cos(tilt)],
                "position": [
                    middle * math.cos(turn),
                    0.0,
                    scene.distance - middle * math.sin(turn),
                ],
                "rotation": [{"axis": "x", "angle": tilt}, {"axis": "y", "angle": turn}],
                "material": {"reflectance": _STRIPES[number % 2]},
            }
        )
    return objects


def _turns(random: np.random.Generator, most: float) -> list[SceneKeys]:
    return [{"axis": axis, "angle": float(random.uniform(-most, most))} for axis in "xyz"]


def _material(random: np.random.Generator, kind: Kind) -> Any:
    match kind:
        case "glossy":
            return str(random.choice(_SHINY)) if random.random() < 0.5 else str(random.choice(_DULL))
        case "retro":
            return "retro_sheet" if random.random() < 0.3 else str(random.choice(_DULL))
        case "sunlit":
            return str(random.choice(_DULL))
        case _:
            return {"reflectance": 0.5}


@dataclass(frozen=True)
class MixedCoverage:
    """What an image of such a scene shows: (range − truth)/σ of its ranges, and the share of hits that have one."""

    pulls: NDArray[np.float64]
    kept: float

    @classmethod
    def of(cls, image: RangeImage) -> MixedCoverage:
        """Return what an image shows; ranges without a truth along the chief ray are left out."""
        measured, sigma, truth = (
            image[name].astype(np.float64) for name in ("range_m", "sigma_range_m", "truth.range_m")
        )
        pulls, hits = (measured - truth) / sigma, image["truth.object"] > 0
        return cls(pulls[np.isfinite(pulls)], float((image.valid & hits).sum() / max(hits.sum(), 1)))

    def shares(self) -> tuple[float, float, float]:
        """Return the shares within 1.96 σ, beyond 3 σ and beyond 6 σ; NaN where there is no range."""
        size = np.abs(self.pulls)
        if not size.size:
            return math.nan, math.nan, math.nan
        return tuple(float(np.mean(part)) for part in (size < 1.959964, size > 3.0, size > 6.0))  # type: ignore[return-value]
