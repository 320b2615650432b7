"""How the light is followed from the laser to the sensor."""

from __future__ import annotations

import math

from pydantic import Field

from scanner_sim.foundation.parts import Count, Part

_MOST_FINER = 64
"""Largest factor of the background's samples where rows are sparse."""

LONGEST_SLOT, _MOST_HALVINGS = 1.0, 6
"""Longest time slot for which a background of moving objects holds [s], and how often it may be halved."""
_MOST_MOVED_BINS = 1.0
"""Bins by which anything may move in a time slot."""
ROW_SPACING = 0.5
"""Distance of rows of the background between which one interpolates, over the height of a pixel."""


class Transport(Part):
    """Settings of the light transport; the defaults meet the accuracy stated in the documentation."""

    uneven_beamlets: Count = Field(default=48, ge=19, le=2048)
    """Beamlets of a shot on a crease, a strong curve or a gloss that changes within the spot."""
    edge_beamlets: Count = Field(default=96, ge=19, le=2048)
    """Beamlets of a shot that meets an edge of shape, material or shadow."""
    pattern_beamlets: Count = Field(default=480, ge=19, le=2048)
    """Beamlets of a shot of a tracking pattern that meets no smooth ground; a quarter of them where one edge parts the
    beam, as at the rim of a disc. Centres of discs of 100 mm at 4 m then err by 0.15 of their σ, beyond by less."""
    bounces: Count = Field(default=1, ge=1, le=16)
    """Surfaces that laser light may meet: 1 is the direct spot, more adds false spots."""
    bounce_paths: Count = Field(default=64, ge=3, le=4096)
    """Random paths of a shot, where there is more than one bounce; fewer than three cannot stand for a round beam."""
    background_bounces: Count = Field(default=4, ge=1, le=16)
    """Surfaces that light of Sun and Earth may meet."""
    background_samples: Count = Field(default=6, ge=2, le=65536, multiple_of=2)
    """Random paths of Sun and Earth per row and pixel, or a few more: up to three share a first surface. Where rows lie
    three pixels apart or more, each row has as many times more, up to 64."""
    background_seed: Count | None = Field(default=None, ge=0, lt=2**63)
    """Seed of the paths of Sun and Earth; none: the scenario's. With a number, runs of other seeds see the same light,
    with the same error, and one that follows another with the same scene, light and raster need not follow it again."""

    light_seed: Count | None = Field(default=None, ge=0, lt=2**63)
    """Seed of the light before it meets a detector: of the mirrors' errors and of all random paths; none: the
    scenario's. With a number, runs of other seeds draw other speckle and noise on the same light, which is how
    ``scanner-sim reprocess --seed`` writes its scenario. Runs that follow targets have none."""

    def seed_of_light(self, seed: int) -> int:
        """Return the seed of the mirrors' errors and of the laser's random paths in a scenario of a seed."""
        return seed if self.light_seed is None else self.light_seed

    def seed_of_background(self, seed: int) -> int:
        """Return the seed of the paths of Sun and Earth in a scenario of a seed."""
        return self.seed_of_light(seed) if self.background_seed is None else self.background_seed


def slot_halvings(speed: float, step: float) -> int:
    """Return how often the longest time slot is halved for the fastest speed [rad/s] before bins of a step [rad]."""
    moved = LONGEST_SLOT * speed / (_MOST_MOVED_BINS * step)
    return min(max(math.ceil(math.log2(max(moved, 1.0))), 0), _MOST_HALVINGS)


def times_finer(row_step: float, step: float) -> int:
    """Return how many times as many samples of the background each row gets where rows lie far apart.

    Parameters
    ----------
    row_step, step
        From row to row and from bin to bin [rad].
    """
    return max(1, round(min(row_step / (2.0 * step), _MOST_FINER)))
