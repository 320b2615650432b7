"""Which light counts as which condition of Table 1."""

from __future__ import annotations

import numpy as np
import pytest

from scanner_sim.validation.studies.conditions import ESTIMATES, Condition, classify

WELL = 1e6


def one(visible: float = 1.0, in_view: float = 0.0, brightest: float = 0.0, lit: float = 1.0) -> Condition:
    return Condition(int(classify(visible, in_view, brightest, WELL, lit)))


@pytest.mark.parametrize(
    ("lit", "condition"),
    [
        (1.0, Condition.NORMAL),
        (0.95, Condition.NORMAL),
        (0.95 - 1e-9, Condition.PARTIAL_SHADOW),
        (0.05, Condition.PARTIAL_SHADOW),
        (0.05 - 1e-9, Condition.FULL_SHADOW),
        (0.0, Condition.FULL_SHADOW),
    ],
)
def test_shadow_goes_by_the_share_in_sunlight(lit: float, condition: Condition) -> None:
    assert one(lit=lit) is condition


def test_saturation_begins_at_the_full_well() -> None:
    assert one(brightest=WELL) is Condition.SATURATION
    assert one(brightest=0.999 * WELL) is Condition.NORMAL


def test_the_gravest_condition_counts() -> None:
    """A glint does not matter against the Sun itself, and nothing matters in the dark."""
    assert one(brightest=WELL, lit=0.0) is Condition.SATURATION
    assert one(in_view=0.01, brightest=WELL, lit=0.0) is Condition.BACK_ILLUMINATION
    assert one(visible=0.0, in_view=1.0, brightest=WELL, lit=1.0) is Condition.NO_LIGHT


def test_a_sliver_of_the_sun_is_light() -> None:
    assert one(visible=0.01) is Condition.NORMAL
    assert one(visible=0.0099) is Condition.NO_LIGHT


def test_moments_are_classified_together() -> None:
    found = classify(
        np.array([1.0, 0.0, 1.0]), 0.0, np.array([0.0, 0.0, WELL]), WELL, np.array([0.5, 1.0, 1.0])
    )
    assert found.dtype == np.uint8
    assert found.tolist() == [Condition.PARTIAL_SHADOW, Condition.NO_LIGHT, Condition.SATURATION]


def test_the_papers_figures_cover_every_condition_once() -> None:
    covered = [condition for estimate in ESTIMATES for condition in estimate.conditions]
    assert sorted(covered) == list(Condition)
    assert [estimate.share for estimate in ESTIMATES] == ["60 %", "35 %", "< 5 %", "< 1 %"]


def test_every_condition_explains_itself() -> None:
    assert all(condition.words and condition.meaning for condition in Condition)
