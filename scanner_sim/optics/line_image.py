"""How the lens images what the beam lights onto the line of pixels: a thin lens, and an array that may be tilted.

In the plane of triangulation the lens's node is the origin. A point seen at the tangent t = tanα to the lens's axis, at
the depth L along it, has its image at the height v t and the depth v = f L/(L − f) behind the lens (lens equation;
Hecht, *Optics*, 5th ed., 2017, sec 5.2). The array is a straight line behind the lens, from the image of infinity at
the depth v₀ outwards, tilted by τ against the lens: its positions s stand at the heights s cosτ and depths
v₀ + s sinτ. The ray through the node meets it where s cosτ = t (v₀ + s sinτ), so that with g = tanτ and h = v₀/cosτ

    s = h t/(1 − g t)            t = s/(h + g s)            ds/dt = h/(1 − g t)²

An upright array (g = 0) focused at infinity (v₀ = f) has eq 1's p = f t. The beam runs parallel to the lens's axis at
the distance d (at Θ = 0), t = d/L; all of it is sharp where the array lies on its image, from (0, f) with the slope
g = f/d: Scheimpflug's condition (Rioux, *Appl. Opt.* 23, 1984, 3837; Blais, Rioux, Beraldin, SPIE 959, 1988, 225).
Then s = f d/(L − f) · √(1 + (f/d)²). While the beam is deflected its distance from the axis is
d cosΘ, and one array cannot be in focus at all Θ.

A ray through the point ξ of the pupil passes the array, to first order in ξ, at

    s(ξ) = s + ξ k/(cosτ (1 − g t)),       k = 1 − v_a/v = 1 − v_a (1/f − 1/L),       v_a = v₀/(1 − g t)

so that a pupil of diameter A, evenly lit, blurs a point by a disc whose standard deviation per axis is (A/4) |k| across
the line, and 1/(cosτ (1 − g t)) of that along it. The simulator takes a Gaussian of the same variance.

On a tilted array the blur is lopsided: to second order its centroid is off by
−(A/4)² k (1 − k) sinτ/(cosτ (1 − g t))²/v_a, up to 4 % of its σ. A calibrated instrument knows that, as it knows its
focus.

Not modelled: higher orders in ξ, and the blur's own shape; thickness, distortion and field curvature of the lens; the
pupil's foreshortening; that the blur of the Sun's and the Earth's light is another than that of the beam's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

from scanner_sim.foundation.device_numbers import beside
from scanner_sim.foundation.device_types import FloatLike


@dataclass(frozen=True)
class ArrayPlace:
    """How a lens images the surroundings of points on the array: numbers, NumPy or Dr.Jit arrays.

    Attributes
    ----------
    stretch
        v_a/v₀.
    across
        v_a/f: how much larger than in the focal plane the image is across the line.
    skewed
        1/(cosτ (1 − g t)): how much longer along the array than across it the image of a small thing is.
    defocus
        Standard deviation of the image of a point across the line by what the lens is out of focus, with a sign.
    shift
        By how much this image's centroid lies from its ray through the node, along the line.
    """

    stretch: FloatLike
    across: FloatLike
    skewed: FloatLike
    defocus: FloatLike
    shift: FloatLike

    @property
    def along(self) -> FloatLike:
        """How much larger than in the focal plane the image is along the line, ds/dt over f."""
        return self.across * self.skewed

    def spread(self, whole: FloatLike, aberration: FloatLike) -> FloatLike:
        """Return the variance of a point's image along the line.

        ``whole`` is that on an upright array in focus, ``aberration`` the part of it that the lens's rays make, in the
        unit of ``defocus``.
        """
        return whole + ((aberration + self.defocus * self.defocus) * self.skewed * self.skewed - aberration)


@dataclass(frozen=True)
class LineImage:
    """Lens and array, SI. The methods take numbers, NumPy or Dr.Jit arrays; no kernel knows the numbers.

    Attributes
    ----------
    focal_length
        f.
    depth
        Depth v₀ of the array behind the lens where the image of infinity falls.
    slope
        g = tanτ of the array's tilt τ; positive where near ranges have their image farther behind the lens.
    pupil
        Standard deviation per axis of points of the pupil, A/4; 0 for a lens that is taken to be in focus everywhere.
    """

    focal_length: float
    depth: float
    slope: float
    pupil: float

    @cached_property
    def secant(self) -> float:
        """1/cosτ."""
        return math.hypot(1.0, self.slope)

    @cached_property
    def scale(self) -> float:
        """H = v₀/cosτ [m], ds/dt at the image of infinity; the focal length of an upright array focused there."""
        return self.depth * self.secant

    @cached_property
    def skew(self) -> float:
        """g/h [1/m]: by how much v_a/v₀ grows along the array."""
        return self.slope / self.scale

    def position(self, tangent: FloatLike) -> FloatLike:
        """Return the position s [m] on the array of what is seen at tangents t."""
        scale, slope = beside(tangent, self.scale, self.slope)
        return scale * tangent / (1.0 - slope * tangent)

    def tangent(self, position: FloatLike) -> FloatLike:
        """Return the tangents t to the lens's axis at which positions s [m] look: :meth:`position` solved for t."""
        scale, slope = beside(position, self.scale, self.slope)
        return position / (scale + slope * position)

    def stretch(self, position: FloatLike) -> FloatLike:
        """Return v_a/v₀ = 1/(1 − g t) = 1 + s g/h at positions s [m]."""
        (skew,) = beside(position, self.skew)
        return 1.0 + skew * position

    def at(self, position: FloatLike, shift: FloatLike, unit: float) -> ArrayPlace:
        """Return how points of the beam are imaged at positions on the array.

        Parameters
        ----------
        position
            s [m].
        shift
            Lateral distance d cosΘ of the beam from the lens's axis [m]: its points are at L = shift/t.
        unit
            Of lengths on the line, such as a pixel's pitch [m].
        """
        pupil, ratio, secant = beside(
            position, self.pupil / unit, self.depth / self.focal_length, self.secant
        )
        stretch = self.stretch(position)
        across = ratio * stretch
        skewed = secant * stretch
        defocus = pupil * (1.0 - across + position / (secant * shift))
        return ArrayPlace(
            stretch, across, skewed, defocus, unit * self.lopsided(defocus, pupil, skewed, stretch)
        )

    def lopsided(
        self, defocus: FloatLike, pupil: FloatLike, skewed: FloatLike, stretch: FloatLike
    ) -> FloatLike:
        """Return how far the centroid of a blur lies from the ray through the node, along the line.

        The second order of s(ξ): −(A/4)² k (1 − k) sinτ/(cosτ (1 − g t))²/v_a, with k A/4 as ``defocus``.
        """
        (sine,) = beside(stretch, self.slope / self.scale)
        return -defocus * (pupil - defocus) * skewed * skewed * sine / stretch

    def blur_at(self, stretch: FloatLike, depth: FloatLike) -> FloatLike:
        """Return the standard deviation across the line [m] of the image of points at a depth L [m] by defocus.

        With a sign; ``stretch`` is v_a/v₀ where their rays meet the array.
        """
        pupil, ratio, behind = beside(depth, self.pupil, self.depth / self.focal_length, self.depth)
        return pupil * (1.0 - stretch * (ratio - behind / depth))


@lru_cache(maxsize=64)
def line_image(
    focal_length: float, baseline: float, aperture: float, focus_distance: float, tilt: float | None
) -> LineImage:
    """Return the image of a lens on an array that passes through the image of a point of the beam.

    Parameters
    ----------
    focal_length, baseline, aperture
        f, d and A [m].
    focus_distance
        Depth L_f of the point of the beam that is sharp at Θ = 0 [m]; ∞ for infinity.
    tilt
        τ [rad]; None for Scheimpflug's condition, which holds for every point of the beam.

    Notes
    -----
    The point's image stands at v_f = f + f²/(L_f − f), at the height d f/(L_f − f); the array through it has
    v₀ = v_f − g d f/(L_f − f).
    """
    if tilt is None:
        return LineImage(focal_length, focal_length, focal_length / baseline, 0.25 * aperture)
    slope = math.tan(tilt)
    nearer = 0.0 if math.isinf(focus_distance) else focal_length / (focus_distance - focal_length)
    depth = focal_length + nearer * (focal_length - slope * baseline)
    return LineImage(focal_length, depth, slope, 0.25 * aperture)


@lru_cache(maxsize=64)
def sharp_everywhere(focal_length: float) -> LineImage:
    """Return the idealised image that is sharp at every range on an array with the scale of an upright one."""
    return LineImage(focal_length, focal_length, 0.0, 0.0)
