"""The judge of time of flight: closed forms and plain integrals, written apart from the simulator.

Sources: McIntyre, *IEEE Trans. Electron Devices* 13 (1966) 164–168, for the avalanche's noise; Kay, *Fundamentals of
statistical signal processing: estimation theory*, 1993, sec. 3.9, for the bound on a delay in coloured noise; the rest
follows from geometry.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import quad

from scanner_sim.foundation.constants import SPEED_OF_LIGHT

Floats = NDArray[np.float64]

_CHARGE = 1.602176634e-19
_TO_SIGMA = 1.0 / 2.3548200450309493
_PHASES = 16


def excess_noise(gain: float, k: float) -> float:
    """Return McIntyre's F = k M + (1 − k)(2 − 1/M)."""
    return k * gain + (1.0 - k) * (2.0 - 1.0 / gain)


def noise_bandwidth(bandwidth: float) -> float:
    """Return ∫|H|² df [Hz] of electronics whose |H|² is a Gaussian, one half at ``bandwidth``: by quadrature."""
    value, _ = quad(lambda f: 2.0 ** (-(f**2)), 0.0, np.inf)
    return float(value) * bandwidth


def receiver_snr(
    light: float,
    background: float,
    *,
    gain: float,
    responsivity: float,
    k: float,
    bulk: float,
    surface: float,
    amplifier: float,
    bandwidth: float,
) -> float:
    """Return M R₀ P_s/√(2q M² F [R₀ (P_s + P_b) + I_db] B + 2q I_ds B + i² B) for steady light.

    Parameters
    ----------
    light, background
        P_s and P_b [W].
    gain, responsivity, k
        M, R₀ [A/W] and the ionisation ratio.
    bulk, surface
        Dark currents I_db, I_ds [A].
    amplifier
        i [A/√Hz].
    bandwidth
        −3 dB bandwidth [Hz]; B is the noise bandwidth that belongs to it.
    """
    multiplied = responsivity * (light + background) + bulk
    density = 2.0 * _CHARGE * (gain**2 * excess_noise(gain, k) * multiplied + surface) + amplifier**2
    return gain * responsivity * light / math.sqrt(density * noise_bandwidth(bandwidth))


def leading_edge_walk(fwhm: float, ratio: float, reference: float = 2.0) -> float:
    """Return by how much nearer a Gaussian pulse of ``ratio`` times the level seems than one of ``reference`` [m].

    The level V is crossed √(2 ln(A/V)) standard deviations before the peak.
    """
    early = math.sqrt(2.0 * math.log(ratio)) - math.sqrt(2.0 * math.log(reference))
    return 0.5 * SPEED_OF_LIGHT * fwhm * _TO_SIGMA * early


def tilted_plane_sigma(pulse: float, response: float, beam: float, tilt: float) -> float:
    """Return the standard deviation [s] of the waveform from a plane that is tilted against the beam.

    The footprint's depth has the standard deviation s tan(tilt); the light passes it twice.

    Parameters
    ----------
    pulse, response
        Standard deviations of pulse and electronics [s].
    beam
        Standard deviation s of the irradiance across the beam, per axis [m].
    tilt
        Angle between the beam and the plane's normal [rad].
    """
    return math.hypot(pulse, response, 2.0 * beam * math.tan(tilt) / SPEED_OF_LIGHT)


def white_noise_bound(sigma: float, step: float, snr: float) -> float:
    """Return √(2 τ Δt/√π) σ_n/A [s] for a sampled Gaussian of standard deviation τ in white noise."""
    return math.sqrt(2.0 * sigma * step / math.sqrt(math.pi)) / snr


def coloured_noise_bound(pulse: float, response: float, step: float, snr: float, white: float) -> float:
    """Return the Cramér–Rao bound [s] on the delay of a Gaussian pulse of unknown amplitude.

    The root of the bound's mean square over all places of the pulse between two samples: where the pulse is hardly
    wider than a sample the information depends on the place (by 2 % in variance at a standard deviation of 0.87).

    Parameters
    ----------
    pulse, response
        Standard deviations of pulse and electronics [s]; the noise has passed the same electronics.
    step
        Time between samples [s].
    snr
        Amplitude over the standard deviation of the noise at a sample.
    white
        Share of the noise's variance that is white: the converter's.
    """
    n = 2 * round(8.0 * math.hypot(pulse, response) / step) + 1
    grid = (np.arange(n) - n // 2) * step
    lag = grid[:, None] - grid[None, :]
    R = (1.0 - white) * np.exp(-((lag / (2.0 * response)) ** 2)) + white * np.eye(n)
    variance = pulse**2 + response**2
    bounds = []
    for phase in (np.arange(_PHASES) + 0.5) / _PHASES:
        t = grid - phase * step
        p = snr * np.exp(-0.5 * t**2 / variance)
        J = np.stack([p * t / variance, p], axis=1)
        bounds.append(np.linalg.inv(J.T @ np.linalg.solve(R, J))[0, 0])
    return float(np.sqrt(np.mean(bounds)))


def sphere_range(distance: float, radius: float, beam: float) -> float:
    """Return the mean range [m] of a Gaussian beam's light from a Lambertian sphere, hit in the middle, coaxially.

    Each point returns in proportion to the cosine towards the lens over the squared distance; by quadrature over the
    beam's radius, with the beam parallel.

    Parameters
    ----------
    distance, radius
        Distance of the sphere's nearest point and its radius [m].
    beam
        Standard deviation of the irradiance across the beam [m].
    """

    def point(r: float) -> tuple[float, float]:
        depth = radius - math.sqrt(radius**2 - r**2)
        z = distance + depth
        back = math.hypot(z, r)
        cosine = ((radius - depth) * z - r * r) / (radius * back)
        return math.exp(-0.5 * (r / beam) ** 2) * r * cosine / back**2, 0.5 * (z + back)

    end = min(8.0 * beam, 0.999 * radius)
    weighted, _ = quad(lambda r: point(r)[0] * (point(r)[1] - distance), 0.0, end)
    weight, _ = quad(lambda r: point(r)[0], 0.0, end)
    return distance + float(weighted / weight)


def corner_echoes(
    first: ArrayLike, second: ArrayLike, reflectance: float, half_field: float, rays: int, seed: int
) -> tuple[Floats, Floats]:
    """Return light that meets two Lambertian planes, in this order: way [m] and share at a small lens per area [1/m²].

    The laser and the lens are at the origin; the laser shines along +z. Brute force: directions from the first plane by
    the cosine law, each point of the second plane connected to the origin.

    Parameters
    ----------
    first, second
        Planes (n, d) as four numbers: points x with n·x = d, unit normals n; unbounded.
    reflectance
        Of both.
    half_field
        Half angle [rad] of the round field about the laser that the lens sees.
    rays
        Number of random directions.
    seed
        Of NumPy's generator.

    Returns
    -------
    tuple
        Ways and shares, shape (rays,); shares are 0 where the second plane is not met or not seen.
    """
    n1, d1 = np.asarray(first, dtype=np.float64)[:3], float(np.asarray(first)[3])
    n2, d2 = np.asarray(second, dtype=np.float64)[:3], float(np.asarray(second)[3])
    spot = np.array([0.0, 0.0, d1 / n1[2]])
    random = np.random.default_rng(seed)
    u, v = random.random((2, rays))
    local = np.stack([np.sqrt(u) * np.cos(2 * np.pi * v), np.sqrt(u) * np.sin(2 * np.pi * v), np.sqrt(1 - u)])
    up = n1 if n1 @ spot < 0.0 else -n1
    side = np.cross(up, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    rays_out = (np.stack([side, np.cross(up, side), up]).T @ local).T
    with np.errstate(divide="ignore"):
        flight = (d2 - n2 @ spot) / (rays_out @ n2)
    met = np.isfinite(flight) & (flight > 1e-9)
    flight = np.where(met, flight, 1.0)
    point = spot + flight[:, None] * rays_out
    back = np.linalg.norm(point, axis=1)
    # Light leaves on the side that it came from; the lens must be there, before it, and not behind the first plane.
    cosine = -(point @ n2) / back * np.sign(-(rays_out @ n2))
    within = np.hypot(point[:, 0], point[:, 1]) <= math.tan(half_field) * point[:, 2]
    visible = met & (cosine > 0.0) & (point[:, 2] > 0.0) & within
    share = np.where(visible, reflectance**2 / math.pi * cosine * point[:, 2] / back**3, 0.0) / rays
    return spot[2] + flight + back, share


def crossing_range(tof_sigma: float, f: float, d: float, dp: float) -> float:
    """Return √(σ_TOF f d/Δp) [m], where triangulation's R² Δp/(f d) equals σ_TOF."""
    return math.sqrt(tof_sigma * f * d / dp)
