"""What a real lens does to an image: distortion, and blur that grows with the field."""

from __future__ import annotations

from dataclasses import dataclass

from scanner_sim.foundation.device_numbers import beside
from scanner_sim.foundation.device_types import FloatLike


def brown(
    x: FloatLike, y: FloatLike, radial: FloatLike, p1: FloatLike, p2: FloatLike
) -> tuple[FloatLike, FloatLike]:
    """Return tangents (x', y') as a lens with Brown's distortion images those of an ideal one.

    Parameters
    ----------
    x, y
        Tangents of the angles of sight.
    radial
        The factor 1 + k₁ρ² + k₂ρ⁴ + … with ρ² = x² + y².
    p1, p2
        Tangential distortion.

    Returns
    -------
    tuple
        x' = x radial + 2 p₁ x y + p₂ (ρ² + 2x²), y' = y radial + 2 p₂ x y + p₁ (ρ² + 2y²) (Brown, *Photogramm. Eng.*
        37, 1971, 855-866; signs as in OpenCV's ``projectPoints``).
    """
    xx, yy = x * x, y * y
    radius = xx + yy
    moved = x * radial + 2.0 * p1 * x * y + p2 * (radius + 2.0 * xx)
    aside = y * radial + 2.0 * p2 * x * y + p1 * (radius + 2.0 * yy)
    return moved, aside


@dataclass(frozen=True)
class LensErrors:
    """Errors of the image on the line.

    Attributes
    ----------
    radial_1, radial_2
        k₁ and k₂ of Brown's distortion.
    across, along
        Its tangential p₁ and p₂.
    blur
        Standard deviation of the light's spread at ``end`` [m], growing with p².
    end
        Position p of the array's near end [m].
    """

    radial_1: float
    radial_2: float
    across: float
    along: float
    blur: float
    end: float

    def image(self, p: FloatLike, q: FloatLike, f: FloatLike) -> tuple[FloatLike, FloatLike, FloatLike]:
        """Return where light lands that an ideal lens would bring to (p, q), and how much longer images are there.

        Parameters
        ----------
        p, q
            Along the line and across it [m].
        f
            Focal length [m].

        Returns
        -------
        tuple
            p' along the line and q' across it [m] in the focal plane, and ∂p'/∂p. With x = p/f, y = q/f, ρ² = x² + y²:
            (x', y') is :func:`brown` of them with the factor 1 + k₁ρ² + k₂ρ⁴.
        """
        k1, k2, p1, p2 = beside(p, self.radial_1, self.radial_2, self.across, self.along)
        x, y = p / f, q / f
        xx, yy = x * x, y * y
        radius = xx + yy
        radial = 1.0 + radius * (k1 + k2 * radius)
        moved, aside = brown(x, y, radial, p1, p2)
        slope = radial + xx * (2.0 * k1 + 4.0 * k2 * radius) + 2.0 * p1 * y + 6.0 * p2 * x
        return f * moved, f * aside, slope

    def variance(self, p: FloatLike) -> FloatLike:
        """Return the variance [m²] of the light's spread that the field adds at p [m]."""
        blur, end = beside(p, self.blur, self.end)
        share = p / end
        spread = blur * share * share
        return spread * spread
