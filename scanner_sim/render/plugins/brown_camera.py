"""The Mitsuba sensor ``brown_camera``: a camera with the interior orientation of a calibration.

Mitsuba's own ``perspective`` and ``thinlens`` know no distortion. Register this one with
:func:`register_brown_camera`, then write for instance::

    <sensor type="brown_camera">
        <float name="focal_length" value="0.012"/>
        <float name="pixel_pitch" value="1e-5"/>
        <float name="k1" value="-0.2"/>
        <film type="hdrfilm"><integer name="width" value="640"/><integer name="height" value="480"/></film>
    </sensor>

Properties: ``focal_length`` and ``pixel_pitch`` [m], ``principal_u`` and ``principal_v`` [pixel] from the centre of the
first pixel (by default the middle of the film), ``k1``, ``k2``, ``k3``, ``p1``, ``p2`` as OpenCV writes them, and
``to_world``. The camera looks along its +z, with +x to the right and +y down the film, as OpenCV's and the scanner's
frames do; Mitsuba's own cameras have +x to the left and +y up. The film is not to be cropped.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from pydantic import ValidationError

from scanner_sim.foundation.device_types import Float, Mask, Vector2f
from scanner_sim.foundation.errors import InputError
from scanner_sim.optics.interior_orientation import InteriorOrientation
from scanner_sim.render.frame.lens_table import LensTable
from scanner_sim.scene.files.plugins import once_per_variant, vectorised_only


@once_per_variant
def register_brown_camera() -> type:
    """Make ``brown_camera`` known to Mitsuba's present variant, and return its class.

    Call it again after every change of the variant: a plugin belongs to the variant in which it was made.

    Raises
    ------
    InputError
        In a scalar variant, which has no arrays of rays.
    """
    vectorised_only("brown_camera")
    made = _sensor_class()
    mi.register_sensor("brown_camera", made)
    return made


def _sensor_class() -> type:
    """Return the plugin for the present variant, whose types its base class fixes."""

    class BrownCamera(mi.Sensor):
        """A pinhole whose pixels look where a calibration says; see the module."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.m_needs_sample_2 = True
            self.m_needs_sample_3 = False
            film: Any = self.film()
            columns, rows = (int(size) for size in np.asarray(film.size()).ravel())
            self.interior = _interior(props, columns, rows)
            self._table = LensTable.of(self.interior)

        def sample_ray(
            self, time: Float, wavelength: Float, place: Vector2f, aperture: Vector2f, active: Mask = True
        ) -> tuple[Any, Any]:
            """Return the ray of a place on the film, (0, 0) its upper left and (1, 1) its lower right corner."""
            del aperture
            wavelengths, weight = self.sample_wavelengths(
                dr.zeros(mi.SurfaceInteraction3f), wavelength, active
            )
            u, v = place.x * self.interior.columns, place.y * self.interior.rows
            column, row = mi.Int32(dr.floor(u)), mi.Int32(dr.floor(v))
            seen = self._table.directions(column, row, u - mi.Float(column) - 0.5, v - mi.Float(row) - 0.5)
            to_world: Any = self.world_transform()
            ray: Any = mi.Ray3f(to_world @ mi.Point3f(0.0), dr.normalize(to_world @ seen), time, wavelengths)
            return ray, weight

        def sample_ray_differential(
            self, time: Float, wavelength: Float, place: Vector2f, aperture: Vector2f, active: Mask = True
        ) -> tuple[Any, Any]:
            """Return the ray of a place on the film, with its neighbours in the next pixels."""
            ray, weight = self.sample_ray(time, wavelength, place, aperture, active)
            found: Any = mi.RayDifferential3f(ray)
            for name, step in (
                ("x", (1.0 / self.interior.columns, 0.0)),
                ("y", (0.0, 1.0 / self.interior.rows)),
            ):
                beside, _ = self.sample_ray(time, wavelength, place + mi.Point2f(*step), aperture, active)
                setattr(found, f"o_{name}", beside.o)
                setattr(found, f"d_{name}", beside.d)
            found.has_differentials = True
            return found, weight

        def bbox(self) -> Any:
            """Return the box of the pinhole."""
            origin = self.world_transform().matrix
            at = [float(np.ravel(np.asarray(origin[row, 3]))[0]) for row in range(3)]
            return mi.ScalarBoundingBox3f(mi.ScalarPoint3f(at))

        def to_string(self) -> str:
            """Return the parameters in one line."""
            return f"BrownCamera[{self.interior!r}]"

    return BrownCamera


def _interior(props: Any, columns: int, rows: int) -> InteriorOrientation:
    """Return the interior orientation of a plugin's properties."""
    try:
        return InteriorOrientation(
            focal_length=float(props["focal_length"]),
            pixel_pitch=float(props["pixel_pitch"]),
            columns=columns,
            rows=rows,
            principal_point=(
                float(props.get("principal_u", 0.5 * (columns - 1))),
                float(props.get("principal_v", 0.5 * (rows - 1))),
            ),
            **{name: float(props.get(name, 0.0)) for name in ("k1", "k2", "k3", "p1", "p2")},
        )
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(
            f"brown_camera: {'.'.join(map(str, first['loc']))}: {first['msg']}.",
            remedy="Write lengths in metres, and the distortion of a calibration over the whole film.",
        ) from None
