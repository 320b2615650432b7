"""Which experiment makes the number of which fact."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from scanner_sim.validation.reproduce.family import echoes, edges, spots, tiles
from scanner_sim.validation.reproduce.family.judging import Measured

Experiment = Callable[..., Measured]
"""Takes the task and the names of the fact's instruments."""

EXPERIMENTS: Mapping[str, Experiment] = MappingProxyType(
    {
        "few_millimetres": spots.at_ten,
        "equal_to_5_m": spots.meeting,
        "crack": tiles.crack,
        "lateral": edges.lateral,
        "dent": tiles.dent,
        "diffraction": edges.diffraction,
        "speckle_share": spots.speckle_share,
        "speckle_limit": spots.speckle_limit,
        "close_lateral": edges.close_lateral,
        "close_depth": spots.close_depth,
        "walk": echoes.walk,
        "edge_noise": echoes.edge_noise,
        "reflectance_bias": echoes.reflectance_bias,
        "incidence": echoes.incidence,
        "intensity": echoes.intensity,
        "tilt": spots.tilt,
    }
)
"""By the key of the fact."""
