"""What an acceptance test finds: errors with their references and uncertainties, held against the maker's limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from scanner_sim.acceptance.measured import measured_clouds
from scanner_sim.acceptance.plan import Ball, LengthBar, Plate
from scanner_sim.acceptance.setup import DRAWN, Setup, on_plate
from scanner_sim.acceptance.shapes import Fit, fit_plane, fit_sphere
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.streams import Stream, host_generator
from scanner_sim.render.libraries import DeviceChoice

Array = NDArray[np.float64]
Sigmas = tuple[float, float, float, float]
"""σ of a value, its parts by noise and by the calibration, and what noise alone gives."""

COVERAGE = 2.0
"""k of the expanded uncertainty U = k u."""


class Verdict(StrEnum):
    """What a result says of its limit."""

    PASSES = "passes"
    UNDECIDED = "undecided"
    FAILS = "fails"


@dataclass(frozen=True)
class Result:
    """One measured quantity.

    Attributes
    ----------
    quantity
        ``length``, ``size``, ``form`` or ``flatness``.
    artefact, repetition
        Of what, and in which repetition, counted from 1.
    measured, reference
        The value that was measured, and the certified one [m].
    sigma, sigma_noise, sigma_common
        Standard deviation of the measured value as the instrument states it; its parts by noise alone and by the errors
        of its calibration [m]. That of a form is by noise alone, and both parts are NaN.
    expected
        The form that noise alone gives a perfect surface [m]; NaN for lengths and sizes.
    limit
        What the maker permits the error to be [m].
    uncertainty
        Expanded uncertainty of the test, which is that of the reference alone [m].
    verdict
        What it says of the limit.
    """

    quantity: str
    artefact: str
    repetition: int
    measured: float
    reference: float
    sigma: float
    sigma_noise: float
    sigma_common: float
    expected: float
    limit: float
    uncertainty: float
    verdict: Verdict

    @property
    def error(self) -> float:
        """The measured less the certified value [m]."""
        return self.measured - self.reference


@dataclass(frozen=True)
class Accepted:
    """All that an acceptance test found.

    Attributes
    ----------
    setup
        The test.
    results
        Every result, in the order of the plan.
    fits
        Sphere or plane of each surface, in the first repetition.
    """

    setup: Setup
    results: tuple[Result, ...]
    fits: Mapping[str, Fit]

    @property
    def verdict(self) -> Verdict:
        """The verdict on the instrument: the worst of all."""
        return worst_of([one.verdict for one in self.results])

    def worst(self, quantity: str, artefact: str) -> Result:
        """Return the repetition with the largest error."""
        found = [one for one in self.results if (one.quantity, one.artefact) == (quantity, artefact)]
        return max(found, key=lambda one: abs(one.error))

    def verdict_of(self, test: Result) -> Verdict:
        """Return the worst verdict of all repetitions of a test."""
        return worst_of(
            [
                one.verdict
                for one in self.results
                if (one.quantity, one.artefact) == (test.quantity, test.artefact)
            ]
        )

    @property
    def tests(self) -> tuple[Result, ...]:
        """The worst repetition of each test."""
        tests = dict.fromkeys((one.quantity, one.artefact) for one in self.results)
        return tuple(self.worst(*test) for test in tests)


def worst_of(verdicts: list[Verdict]) -> Verdict:
    """Return the worst of some verdicts."""
    return max(verdicts, key=list(Verdict).index)


def decide(error: float, limit: float, uncertainty: float, rule: str) -> Verdict:
    """Return what an error says of its limit.

    Parameters
    ----------
    error
        The measured error.
    limit
        The largest error that is permitted, of either sign.
    uncertainty
        Expanded uncertainty U of the test.
    rule
        ``guarded``: within the limit by U or more passes, beyond it by more than U fails, and between both nothing is
        proved; ``simple``: within the limit passes, and all else fails.
    """
    guard = 0.0 if rule == "simple" else uncertainty
    if abs(error) <= limit - guard:
        return Verdict.PASSES
    return Verdict.FAILS if abs(error) > limit + guard else Verdict.UNDECIDED


def accept(
    setup: Setup, *, device: DeviceChoice = "auto", progress: Callable[[int, int], None] | None = None
) -> Accepted:
    """Measure all artefacts and judge them.

    Parameters are those of :func:`~scanner_sim.acceptance.measured.measured_clouds`.

    Raises
    ------
    InputError
        If an artefact gives too few points.
    ScenarioError
        If a scene cannot be measured.
    """
    fits: dict[str, tuple[Fit, ...]] = {}
    artefacts = list(setup.plan.artefacts.values())
    for number, (surface, clouds) in enumerate(measured_clouds(setup, device=device, progress=progress)):
        generator = host_generator(setup.plan.seed, Stream.ACCEPTANCE, DRAWN + number)
        artefact, discarded = artefacts[surface.artefact], setup.plan.discarded
        if isinstance(artefact, Plate):
            clouds = tuple(cloud.chosen(on_plate(artefact, surface, cloud.points)) for cloud in clouds)
            found = [fit_plane(cloud, discarded, generator) for cloud in clouds]
        else:
            found = [fit_sphere(cloud, discarded, generator) for cloud in clouds]
        fits[surface.name] = tuple(one for one in found if one is not None)
        if len(fits[surface.name]) < len(clouds):
            fewest = min(len(cloud.points) for cloud in clouds)
            raise InputError(
                f"{surface.name} gives {fewest} valid points at least, too few for a fit.",
                remedy="Move it nearer, make it larger or of brighter material, or raise across.",
            )
    results = []
    for number in range(len(artefacts)):
        own = [fits[surface.name] for surface in setup.surfaces if surface.artefact == number]
        for repetition, same in enumerate(zip(*own, strict=True), start=1):
            results += _results(setup, number, repetition, same)
    return Accepted(setup, tuple(results), {name: found[0] for name, found in fits.items()})


def _results(setup: Setup, number: int, repetition: int, fits: tuple[Fit, ...]) -> list[Result]:
    """Return what one repetition says of one artefact."""
    one, zone = list(setup.plan.artefacts.values())[number], setup.zone_of(number)

    def judged(
        quantity: str,
        value: float,
        reference: float,
        sigmas: Sigmas,
        limit: float | None,
        u: float,
    ) -> list[Result]:
        if limit is None:
            return []
        spread = COVERAGE * u
        verdict = decide(value - reference, limit, spread, setup.plan.rule)
        return [Result(quantity, one.name, repetition, value, reference, *sigmas, limit, spread, verdict)]

    if isinstance(one, LengthBar):
        limit = None if zone.length is None else zone.length + zone.length_ratio * one.length
        return judged("length", *_length(fits[0], fits[1], one.length), limit, one.sigma)
    (fit,) = fits
    form = (fit.form, 0.0, (fit.sigma_form, np.nan, np.nan, fit.expected_form))
    if not isinstance(one, Ball):
        return judged("flatness", *form, zone.flatness, one.sigma)
    unit = np.array([0.0, 0.0, 0.0, 1.0])
    size = (float(fit.parameters[3]), one.diameter, _sigmas(unit, fit))
    return [
        *judged("size", *size, zone.size, one.sigma),
        *judged("form", *form, zone.form, one.sigma_form),
    ]


def _length(first: Fit, second: Fit, certified: float) -> tuple[float, float, Sigmas]:
    """Return the distance of two centres, the certified one, and σ."""
    apart = second.parameters[:3] - first.parameters[:3]
    length = float(np.linalg.norm(apart))
    along = np.append(apart / length, 0.0)
    common = along @ (second.common - first.common)
    noise, stated = (
        float(along @ (one + other) @ along)
        for one, other in ((first.noise, second.noise), (first.covariance, second.covariance))
    )
    shared = float(common @ common)
    return length, certified, (np.sqrt(stated + shared), np.sqrt(noise), np.sqrt(shared), np.nan)


def _sigmas(unit: Array, fit: Fit) -> Sigmas:
    common = unit @ fit.common
    shared, noise = float(common @ common), float(unit @ fit.noise @ unit)
    return np.sqrt(float(unit @ fit.covariance @ unit) + shared), np.sqrt(noise), np.sqrt(shared), np.nan
