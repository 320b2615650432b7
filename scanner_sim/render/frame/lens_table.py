"""Where the pixels of a camera look, as a table for the device."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, Int32, Vector3f
from scanner_sim.optics.interior_orientation import InteriorOrientation

_MARGIN = 4
"""Pixels around the frame that the table covers as well: the feet of a pixel's point spread."""
_LENSES = 4
"""Lenses whose angles are kept: they take as long as the light of a small frame."""


@dataclass(frozen=True)
class LensTable:
    """Tangents of the angles of sight at the corners of pixels, on the device; between them they are interpolated.

    The law itself is :meth:`~scanner_sim.optics.interior_orientation.InteriorOrientation.tangents_of`, in double
    precision. Bilinear interpolation errs by an eighth of the second difference: 3e-5 pixel at the corner of a frame of
    640 pixels with k₁ = −0.2.

    Attributes
    ----------
    tangents
        (x/z, y/z) of the corners one after the other, row by row.
    columns, rows
        Corners in a row, and rows of corners, on the device: no kernel is compiled for a lens.
    """

    tangents: Float
    columns: Int32
    rows: Int32

    @classmethod
    def of(cls, interior: InteriorOrientation) -> LensTable:
        """Return the table of a lens. Where the margin lies beyond the distortion's fold, the frame's edge counts."""
        found = _corners(interior)
        rows, columns = found.shape[:2]
        return cls(mi.Float(for_device(found)), dr.opaque(mi.Int32, columns), dr.opaque(mi.Int32, rows))

    def directions(self, column: Int32, row: Int32, u: Float, v: Float) -> Vector3f:
        """Return unit vectors in the camera's frame, Dr.Jit.

        Parameters
        ----------
        column, row
            Pixels.
        u, v
            Places beside their centres [pixel], up to 4.5 beyond the frame; split so that single precision keeps them.
        """
        left, above = dr.floor(u + 0.5), dr.floor(v + 0.5)
        across, down = u + 0.5 - left, v + 0.5 - above
        at_column = dr.clip(column + mi.Int32(left) + _MARGIN, 0, self.columns - 2)
        at_row = dr.clip(row + mi.Int32(above) + _MARGIN, 0, self.rows - 2)
        corner = mi.UInt32(at_row * self.columns + at_column)
        below = corner + mi.UInt32(self.columns)

        def at(index: Int32) -> mi.Vector2f:
            return dr.gather(mi.Vector2f, self.tangents, index)

        upper = dr.lerp(at(corner), at(corner + 1), across)
        lower = dr.lerp(at(below), at(below + 1), across)
        tangent = dr.lerp(upper, lower, down)
        return dr.normalize(mi.Vector3f(tangent.x, tangent.y, 1.0))


@lru_cache(maxsize=_LENSES)
def _corners(interior: InteriorOrientation) -> NDArray[np.float64]:
    """Return the tangents at the corners of pixels, shape (rows, columns, 2)."""
    u = np.arange(-_MARGIN, interior.columns + _MARGIN + 1) - 0.5
    v = np.arange(-_MARGIN, interior.rows + _MARGIN + 1) - 0.5
    pixels = np.stack(np.meshgrid(u, v), axis=-1)
    found = interior.tangents_of(pixels)
    lost = np.isnan(found[..., 0])
    if lost.any():
        ends = np.array([[-0.5, -0.5], [interior.columns - 0.5, interior.rows - 0.5]])
        found[lost] = interior.tangents_of(np.clip(pixels[lost], *ends))
    return found


@lru_cache(maxsize=_LENSES)
def pixel_view_factors(interior: InteriorOrientation) -> NDArray[np.float64]:
    """Return cosθ dΩ of the pixels [sr], shape (rows, columns): light per radiance and area of the entrance pupil.

    With tangents t = (x/z, y/z) a pixel sees dΩ = cos³θ dt, and dt = 1/|∂(u, v)/∂t|: for a lens without distortion
    cosθ dΩ = cos⁴θ p²/f² (Horn, *Robot vision*, MIT Press 1986, section 10.3).
    """
    u, v = np.meshgrid(np.arange(interior.columns), np.arange(interior.rows))
    tangents = interior.tangents_of(np.stack([u, v], axis=-1))
    slopes = np.abs(np.linalg.det(interior.tangent_jacobian(tangents)))
    found = np.asarray((1.0 + np.sum(tangents**2, axis=-1)) ** -2 / slopes)
    found.flags.writeable = False
    return found
