"""Discs of which the values leave much open: the mean over all that may be there, and not the one that fits best.

A fit states the error that follows from how χ² bends at its least place. A voxel at the rim answers over the width of
the spot and of its way in a dwell, so that χ² is a parabola only as far as that. Where the values leave more open, as
under the Sun while a wide pattern crosses the rim four times, χ² hardly rises along a row of discs that is ten such
errors long. Of fits of targets 11 to 15 m away, partly in the Sun and partly in a shadow, four of a hundred had errors
above 4.5 σ, up to 14 σ; of the means one in a thousand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from scanner_sim.foundation.arithmetic import cholesky, exp, log, product
from scanner_sim.tracking.centroid import Centroid, centroid_of
from scanner_sim.tracking.disc_fit import by_voxel, disc_fit, share_on_disc
from scanner_sim.tracking.response import Response
from scanner_sim.tracking.samples import PatternSamples, rise_per_point

Array = NDArray[np.float64]

_DOUBTFUL = 0.3
"""σ of centre or radius, over the spot, from which the mean is taken."""
_DISCS = 256
"""Discs that are tried in a round: the mean then errs by a tenth of σ."""
_FEWEST_ROUNDS, _MOST_ROUNDS = 2, 8
"""Rounds of trials, each where the one before found likely discs; two do, but for one disc in a hundred."""
_SHARE = 0.1
"""Least effective number of a round's discs, over their number, that finds where likely ones are."""
_FLATTEST = 1.0 / 16.0
"""Least power to which likelihoods are raised while few discs of a round are likely."""
_STARTS = 6
"""Discs of the first trials from which further fits begin."""
_WIDEST, _WIDE = 3.0, 1.3
"""Spread of the first round's discs over the fit's σ, and of the next ones' over that of the round before."""
_ACROSS = 0.3
"""Largest σ of the first round, over the radius: a fit that knows less knows nothing of how its errors go together."""
_ROUND = 0.2
"""Least σ of the first round over the largest."""
_SMALLEST, _LARGEST = 0.1, 3.0
"""Radii that are tried, over that of the fit: a short arc may be that of any circle."""
_STEP = 0.8566748838545029
"""1/x with x⁵ = x + 1: multiples of its four powers cover a cube of four dimensions evenly."""


def averaged_disc(
    samples: PatternSamples,
    response: Response,
    fit: Centroid,
    patterns: int,
    *,
    spot: ArrayLike,
    duty_cycle: float,
    pointing: ArrayLike,
) -> Centroid:
    """Return fitted discs, and the mean over all discs in place of those of which the values leave much open.

    Parameters
    ----------
    samples, response, spot, duty_cycle, pointing
        As for :func:`~scanner_sim.tracking.disc_fit.disc_fit`.
    fit
        What that found, with gains.
    patterns
        How many of the rows are patterns. Those behind them, k times as many, are the same on planes that lean
        otherwise, whose centres are moved as those of their patterns are.

    Returns
    -------
    Centroid
        Centre, radius and covariance are moments of exp(−χ²/2m), χ² the least over both levels and m the misfit of the
        fit where that is above 1; centres and radii are all alike likely beforehand, and the target stays the darker or
        the brighter one. There may be several least χ²: discs are tried about the best of some fits that begin at the
        likeliest of a first round. What the pointing adds to a voxel's variance is that of the fit. The moments are
        sums over importance samples (Robert, Casella, *Monte Carlo Statistical Methods*, 2004, section 3.3) of
        Student's t with two degrees of freedom, whose tails are longer than the likelihood's. A round that finds few
        likely discs goes by a power of their weights, so that the next looks farther; what is found flattened to the
        end says too much. Gains are derivatives of the mean, ∂⟨c⟩/∂v = ⟨(c − ⟨c⟩) f⟩/(m σ²), f the value that a disc
        explains.
    """
    width, error = (by_voxel(part, len(fit.found)) for part in (spot, pointing))
    unsure = np.maximum(fit.sigma.max(axis=1), fit.sigma_radius) > _DOUBTFUL * width.min(axis=1)
    rows = np.flatnonzero((unsure & fit.found)[:patterns])
    if not len(rows):
        return fit
    centre, radius = fit.centre.copy(), fit.radius.copy()
    covariance, sigma_radius = fit.covariance.copy(), fit.sigma_radius.copy()
    misfit, gains = fit.misfit.copy(), np.array(fit.gains)
    seen = [
        _Seen.of(samples, response, row, fit, width[row], error[row], duty_cycle) for row in map(int, rows)
    ]
    index = np.repeat(rows, _STARTS)
    others = disc_fit(
        _rows(samples, index),
        response.of(index),
        _starts(seen, fit.of(rows)),
        spot=width[index],
        duty_cycle=duty_cycle,
        pointing=error[index],
    )
    for number, row in enumerate(map(int, rows)):
        best = _best(fit.of(slice(row, row + 1)), others.of(slice(_STARTS * number, _STARTS * (number + 1))))
        misfit[row] = best.misfit[0]
        moments = _moments(seen[number], _disc(best), _first_spread(best), max(float(misfit[row]), 1.0))
        if moments is None:
            continue
        mean, second, moved = moments
        centre[row::patterns] += mean[:2] - fit.centre[row]
        radius[row], covariance[row], gains[row] = mean[2], second[:2, :2], moved[:2]
        sigma_radius[row] = np.sqrt(second[2, 2])
    return centroid_of(centre, covariance, radius, sigma_radius, misfit, fit.found, gains)


def _rows(samples: PatternSamples, index: NDArray[np.intp]) -> PatternSamples:
    """Return some patterns, also more than once, with the angles at which they are looked at."""
    parts = (getattr(samples, field.name)[index] for field in fields(samples))
    return PatternSamples(*parts).at(samples.angles[index])


def _disc(one: Centroid) -> Array:
    """Return (Θ, φ, r) of the first disc, (3,)."""
    return np.append(one.centre[0], one.radius[0])


def _starts(seen: Sequence[_Seen], fit: Centroid) -> Centroid:
    """Return where further fits of each pattern begin: at the likeliest of discs that are tried about the first fit.

    A pattern that crosses the rim at four places has several least χ², and a fit finds that which is next to its start.
    """
    chosen = []
    for number, pattern in enumerate(seen):
        own = fit.of(slice(number, number + 1))
        tried, chi, _ = pattern.tried(_disc(own), _WIDEST**2 * _first_spread(own), own.radius[0])
        chosen.append(tried[np.argsort(chi, kind="stable")[:_STARTS]])
    discs = np.concatenate(chosen)
    none = np.zeros(len(discs))
    return Centroid(discs[:, :2], np.zeros((len(discs), 2, 2)), discs[:, 2], none, none, none == 0.0)


def _best(first: Centroid, others: Centroid) -> Centroid:
    """Return the fit of least misfit."""
    misfits = np.where(others.found, others.misfit, np.inf)
    least = int(np.argmin(misfits))
    return others.of(slice(least, least + 1)) if misfits[least] < first.misfit[0] else first


def _first_spread(fit: Centroid) -> Array:
    """Return the covariance (3, 3) of discs that are tried first: that of the fit, where it says anything."""
    spread = np.zeros((3, 3))
    spread[:2, :2], spread[2, 2] = fit.covariance[0], fit.sigma_radius[0] ** 2
    sigma = np.sqrt(np.diagonal(spread))
    wide = np.minimum(sigma, _ACROSS * fit.radius[0])
    spread *= np.outer(wide / sigma, wide / sigma)
    return spread + np.diag(np.maximum((_ROUND * wide.max()) ** 2 - wide**2, 0.0))


@dataclass(frozen=True)
class _Seen:
    """What one pattern saw: places and travels (2, points), and the rest (points,); ``sign`` of target over ground."""

    place: Array
    travel: Array
    spot: Array
    value: Array
    weight: Array
    sign: float

    @classmethod
    def of(
        cls,
        samples: PatternSamples,
        response: Response,
        row: int,
        fit: Centroid,
        spot: Array,
        error: Array,
        duty_cycle: float,
    ) -> _Seen:
        place = samples.angles[row]
        apart = response.target[row] - response.ground[row]
        seen = cls(
            place=place,
            travel=duty_cycle * rise_per_point(samples.angles[row : row + 1])[0],
            spot=spot[None],
            value=response.value[row],
            weight=np.ones(place.shape[1]),
            sign=float(np.sign(apart)),
        )
        slope = seen.shares(_disc(fit.of(slice(row, row + 1)))[None])[1][0]
        variance = response.sigma[row] ** 2 + (apart * slope * error) ** 2
        return replace(seen, weight=np.where(response.used[row], 1.0 / variance, 0.0))

    def shares(self, discs: Array) -> tuple[Array, Array]:
        """Return the share of each voxel's spot on discs (Θ, φ, r), (n, 3), and its slope, both (n, points)."""
        way = (self.travel**2).sum(axis=0)[None]
        away = self.place[None] - discs[:, :2, None]
        share, slope, _ = share_on_disc(away, self.travel[None], way, discs[:, 2:], self.spot)
        return share, slope

    def tried(self, about: Array, spread: Array, radius: float) -> tuple[Array, Array, Array]:
        """Return discs about one (3,) with a covariance, (n, 3), and :meth:`explained` of them.

        χ² is ∞ of radii that are not tried beside one that was found.
        """
        discs = about + product(_trials()[0], cholesky(spread).T)
        inside = (discs[:, 2] > _SMALLEST * radius) & (discs[:, 2] < _LARGEST * radius)
        discs[:, 2] = np.where(inside, discs[:, 2], radius)
        chi, light = self.explained(discs)
        return discs, np.where(inside, chi, np.inf), light

    def explained(self, discs: Array) -> tuple[Array, Array]:
        """Return χ² of discs (n, 3), least over the levels of both sides, and the values that they explain, (n, k).

        χ² is ∞ where target and ground would be exchanged.
        """
        share, weight = self.shares(discs)[0], self.weight
        total = weight.sum()
        off = share - (share * weight).sum(axis=1, keepdims=True) / total
        mean = (weight * self.value).sum() / total
        light = self.value - mean
        scatter, together = (off * off * weight).sum(axis=1), (off * (weight * light)).sum(axis=1)
        # A disc that no voxel is on, or all are, explains what one level does.
        told = scatter > 1e-9 * total
        apart = np.where(told, together / np.where(told, scatter, 1.0), 0.0)
        chi = (weight * light * light).sum() - apart * together
        return np.where(apart * self.sign > 0.0, chi, np.inf), mean + apart[:, None] * off


@cache
def _trials() -> tuple[Array, Array]:
    """Return numbers of Student's t with two degrees of freedom, (discs, 3), and their density's logarithms, (discs,).

    They come from points that fill a cube of four dimensions evenly, as multiples of the golden section fill a line; χ²
    of two degrees of freedom is −2 ln u.
    """
    number = np.arange(1, _DISCS + 1)[:, None]
    even = (0.5 + number * _STEP ** np.arange(1, 5)) % 1.0
    normal = ndtri(even[:, :3])
    student = normal / np.sqrt(-log(even[:, 3:]))
    return student, -2.5 * log(1.0 + 0.5 * (student**2).sum(axis=1))


def _moments(seen: _Seen, disc: Array, first: Array, misfit: float) -> tuple[Array, Array, Array] | None:
    """Return mean and covariance of the discs that may be there, and how each value moves the mean, (3, points).

    They are looked for about one ``disc``, at ``first`` with that covariance (3, 3); None where none explains anything.
    """
    density = _trials()[1]
    mean, second, wide = disc, first, _WIDEST
    for number in range(1, _MOST_ROUNDS + 1):
        # A mean of few discs may have no extent along an axis; the fit's tells what is small.
        spread = wide**2 * (second + 1e-6 * np.diag(np.diagonal(first)))
        tried, chi, light = seen.tried(mean, spread, disc[2])
        if not np.isfinite(chi).any():
            return None
        power, weight = 1.0, _weights(chi, density, misfit)
        while 1.0 / (weight**2).sum() < _SHARE * _DISCS and power > _FLATTEST:
            power *= 0.5
            weight = _weights(chi, density, misfit, power)
        mean = (weight[:, None] * tried).sum(axis=0)
        away = tried - mean
        weighted = (away * weight[:, None]).T
        second, wide = product(weighted, away), _WIDE
        if power == 1.0 and number >= _FEWEST_ROUNDS:
            break
    return mean, second, product(weighted, light) * (power / misfit * seen.weight)


def _weights(chi: Array, density: Array, misfit: float, power: float = 1.0) -> Array:
    """Return what discs weigh that were tried with such logarithms of their density, (discs,), together 1."""
    told = -0.5 * chi / misfit - density
    weight = exp(power * (told - told.max()))
    return np.asarray(weight / weight.sum())
