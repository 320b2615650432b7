"""The interior orientation of a camera: from points before its lens to pixels, and back.

A central projection with Brown's distortion (*Photogramm. Eng.* 37, 1971, 855-866), as OpenCV and most calibrations of
cameras write it: u to the right, v down, z forward, the centre of the first pixel at (0, 0). Not modelled: affinity and
shear of the pixels, orders of distortion beyond k₃, and its change with distance and temperature.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Discriminator, Field, Tag

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Number, Part
from scanner_sim.foundation.units import Length
from scanner_sim.optics.lens_errors import brown

Array = NDArray[np.float64]

PARAMETERS = ("focal_length", "principal_u", "principal_v", "k1", "k2", "k3", "p1", "p2")
"""What a calibration tells of a camera, in the order of :meth:`InteriorOrientation.parameter_jacobian`."""
_SETTLED = 1e-13
"""Step of a tangent below which the inverse of the distortion is found."""
_MOST_STEPS = 60
_ON_AN_EDGE = 17
"""Points of each edge of the frame at which the distortion must have an inverse."""

PrincipalPoint = Annotated[
    Annotated[Literal["centre"], Tag("(word)")] | Annotated[tuple[Number, Number], Tag("(pixel)")],
    Discriminator(lambda value: "(word)" if isinstance(value, str) else "(pixel)"),
]
"""The middle of the frame, or a pixel (u, v)."""


class InteriorOrientation(Part):
    """How a camera images directions onto its pixels."""

    focal_length: Length = Field(ge=1e-4, le=10.0)
    """Distance of the lens from the pixels, at which the camera is focused (the calibrated focal length)."""
    pixel_pitch: Length = Field(ge=1e-7, le=1e-3)
    """Distance of neighbouring pixels, along rows and columns."""
    columns: Count = Field(ge=8, le=16384)
    """Pixels of a row."""
    rows: Count = Field(ge=8, le=16384)
    """Pixels of a column."""
    principal_point: PrincipalPoint = Field(default="centre", examples=[[322.5, 241.0], "centre"])
    """Pixel (u, v) onto which the lens's axis falls: column and row from the centre of the first pixel."""
    k1: Number = Field(default=0.0, ge=-10.0, le=10.0)
    """Radial distortion k₁, of the square of the tangent of the field angle."""
    k2: Number = Field(default=0.0, ge=-100.0, le=100.0)
    """Radial distortion k₂, of its fourth power."""
    k3: Number = Field(default=0.0, ge=-1000.0, le=1000.0)
    """Radial distortion k₃, of its sixth power."""
    p1: Number = Field(default=0.0, ge=-1.0, le=1.0)
    """Tangential distortion p₁, which acts on v most."""
    p2: Number = Field(default=0.0, ge=-1.0, le=1.0)
    """Tangential distortion p₂, which acts on u most."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a distortion that folds within the frame, so that a pixel has no direction of its own."""
        edge = np.linspace(-0.5, 0.5, _ON_AN_EDGE)
        u, v = edge * self.columns, edge * self.rows
        around = np.concatenate(
            [np.stack(np.broadcast_arrays(u, end), axis=-1) for end in (v[0], v[-1])]
            + [np.stack(np.broadcast_arrays(end, v), axis=-1) for end in (u[0], u[-1])]
        )
        if not np.isfinite(self.directions(around + 0.5 * np.array([self.columns - 1, self.rows - 1]))).all():
            yield Fault(
                "k1",
                "the distortion folds within the frame: some pixel sees two directions or none.",
                "Reduce k1, k2 and k3 to those of a calibration over the whole frame.",
            )

    @property
    def centre(self) -> tuple[float, float]:
        """Principal point (u, v) [pixel]."""
        if self.principal_point == "centre":
            return 0.5 * (self.columns - 1), 0.5 * (self.rows - 1)
        return self.principal_point

    @property
    def scale(self) -> float:
        """Focal length in pixels."""
        return self.focal_length / self.pixel_pitch

    @property
    def fold(self) -> float:
        """Square of the tangent of the field angle at which the radial distortion turns back; infinite for none.

        The least positive root of ∂(ρ radial)/∂ρ = 1 + 3 k₁ρ² + 5 k₂ρ⁴ + 7 k₃ρ⁶.
        """
        roots = np.roots([7.0 * self.k3, 5.0 * self.k2, 3.0 * self.k1, 1.0])
        real = roots.real[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0.0)]
        return float(real.min()) if real.size else np.inf

    def project(self, points: ArrayLike) -> Array:
        """Return the pixels onto which points are imaged.

        Parameters
        ----------
        points
            (x, y, z) in the camera's frame [m], shape (..., 3).

        Returns
        -------
        ndarray
            (u, v) [pixel], shape (..., 2), also beyond the frame. NaN for points that are not before the lens, or so
            far aside that the distortion has folded.
        """
        tangents, _ = self._tangents(points)
        return self.pixels_of(tangents)

    def pixels_of(self, tangents: Array) -> Array:
        """Return the pixels (..., 2) of tangents (x/z, y/z) of the angles of sight, shape (..., 2)."""
        x, y = tangents[..., 0], tangents[..., 1]
        return np.stack(brown(x, y, self._radial(x * x + y * y), self.p1, self.p2), axis=-1) * self.scale + (
            self.centre
        )

    def directions(self, pixels: ArrayLike) -> Array:
        """Return the unit vectors from which pixels receive their light.

        Parameters
        ----------
        pixels
            (u, v), shape (..., 2).

        Returns
        -------
        ndarray
            (x, y, z) in the camera's frame, shape (..., 3), from :meth:`tangents_of`.
        """
        tangents = self.tangents_of(pixels)
        rays = np.concatenate([tangents, np.ones((*tangents.shape[:-1], 1))], axis=-1)
        unit: Array = rays / np.sqrt(np.sum(rays * rays, axis=-1, keepdims=True))
        return unit

    def tangents_of(self, pixels: ArrayLike) -> Array:
        """Return the tangents (x/z, y/z) of the angles of sight of pixels (..., 2), shape (..., 2).

        By Newton's method, to 1e-12. NaN where the distortion brings no light, beyond its fold.
        """
        wanted = (np.asarray(pixels, dtype=np.float64) - self.centre) / self.scale
        found, settled = wanted.copy(), np.zeros(wanted.shape[:-1], dtype=bool)
        most = np.sqrt(min(self.fold, 1e6))
        for _ in range(_MOST_STEPS):
            x, y = found[..., 0], found[..., 1]
            away = np.stack(brown(x, y, self._radial(x * x + y * y), self.p1, self.p2), axis=-1) - wanted
            (a, b), (c, d) = self._slopes(x, y)
            determinant = a * d - b * c
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.stack(
                    [d * away[..., 0] - b * away[..., 1], a * away[..., 1] - c * away[..., 0]], axis=-1
                )
                step /= determinant[..., None]
            settled = (np.abs(step).max(axis=-1) < _SETTLED) & (determinant > 0.0)
            if settled.all():
                break
            found = np.where(settled[..., None], found, found - np.nan_to_num(step))
            # Beyond the fold the slopes have the other sign, and steps lead away.
            with np.errstate(over="ignore"):  # of a step where the slopes vanish
                radius = np.sqrt(np.sum(found * found, axis=-1, keepdims=True))
            found = np.where(radius > most, found * (most / np.maximum(radius, most)), found)
        return np.where(settled[..., None], found, np.nan)

    def jacobian(self, points: ArrayLike) -> Array:
        """Return ∂(u, v)/∂(x, y, z) of points (..., 3) [pixel/m], shape (..., 2, 3)."""
        tangents, depth = self._tangents(points)
        by_tangents = self.tangent_jacobian(tangents)
        across = -np.einsum("...ij,...j->...i", by_tangents, tangents)
        return np.concatenate([by_tangents, across[..., None]], axis=-1) / depth[..., None, None]

    def tangent_jacobian(self, tangents: Array) -> Array:
        """Return ∂(u, v)/∂(x/z, y/z) at tangents (..., 2) [pixel], shape (..., 2, 2)."""
        (a, b), (c, d) = self._slopes(tangents[..., 0], tangents[..., 1])
        return self.scale * np.stack([np.stack([a, b], axis=-1), np.stack([c, d], axis=-1)], axis=-2)

    def parameter_jacobian(self, points: ArrayLike) -> Array:
        """Return ∂(u, v)/∂ of the :data:`PARAMETERS` at points (..., 3), shape (..., 2, 8).

        [pixel] per [m] of the focal length, per pixel of the principal point, and per unit of the distortion.
        """
        tangents, _ = self._tangents(points)
        x, y = tangents[..., 0], tangents[..., 1]
        square, product, radius = tangents * tangents, x * y, x * x + y * y
        moved = np.stack(brown(x, y, self._radial(radius), self.p1, self.p2), axis=-1)
        columns = [moved / self.pixel_pitch, *(np.broadcast_to(axis, moved.shape) for axis in np.eye(2))]
        columns += [self.scale * tangents * radius[..., None] ** power for power in (1, 2, 3)]
        columns += [
            self.scale * np.stack([2.0 * product, radius + 2.0 * square[..., 1]], axis=-1),
            self.scale * np.stack([radius + 2.0 * square[..., 0], 2.0 * product], axis=-1),
        ]
        return np.stack(columns, axis=-1)

    def _tangents(self, points: ArrayLike) -> tuple[Array, Array]:
        """Return (x/z, y/z), NaN where there is no image, and z [m]."""
        given = np.asarray(points, dtype=np.float64)
        depth = np.where(given[..., 2] > 0.0, given[..., 2], np.nan)
        tangents = given[..., :2] / depth[..., None]
        inside = np.sum(tangents * tangents, axis=-1, keepdims=True) < self.fold
        return np.where(inside, tangents, np.nan), depth

    def _radial(self, radius: Array) -> Array:
        return 1.0 + radius * (self.k1 + radius * (self.k2 + radius * self.k3))

    def _slopes(self, x: Array, y: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Return ((∂x'/∂x, ∂x'/∂y), (∂y'/∂x, ∂y'/∂y)) of the distortion."""
        radius = x * x + y * y
        radial = self._radial(radius)
        rise = 2.0 * (self.k1 + radius * (2.0 * self.k2 + radius * 3.0 * self.k3))
        cross = x * y * rise + 2.0 * (self.p1 * x + self.p2 * y)
        return (
            (radial + x * x * rise + 2.0 * self.p1 * y + 6.0 * self.p2 * x, cross),
            (cross, radial + y * y * rise + 2.0 * self.p2 * x + 6.0 * self.p1 * y),
        )
