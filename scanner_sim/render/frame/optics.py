"""What a camera's frames see, put onto the device."""

from __future__ import annotations

from dataclasses import dataclass

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float
from scanner_sim.optics.interior_orientation import InteriorOrientation
from scanner_sim.render.frame.footprint import footprint_quantiles
from scanner_sim.render.frame.lens_table import LensTable
from scanner_sim.render.frame.light import FrameView
from scanner_sim.render.rays import at_time, is_occluded
from scanner_sim.scene.files.loader import LoadedScene, device_poses

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FrameOptics:
    """A lens and its pixels: the table of their directions, quantiles of their footprint, rows and columns."""

    lens: LensTable
    footprint: Float
    shape: tuple[int, int]

    @classmethod
    def of(cls, interior: InteriorOrientation, point_spread: float) -> FrameOptics:
        """Return those of an interior orientation, and of the standard deviation of a point's image [m]."""
        nodes = footprint_quantiles(point_spread / interior.pixel_pitch)
        return cls(LensTable.of(interior), mi.Float(for_device(nodes)), (interior.rows, interior.columns))

    def view(
        self, loaded: LoadedScene, poses: Array, begins: Array, exposures: Array, moments: int
    ) -> FrameView:
        """Return what frames see.

        Parameters
        ----------
        loaded
            The scene.
        poses
            ``scanner_from_camera``, shape (frames, 4, 4).
        begins, exposures
            When the exposures begin and how long they are [s], shape (frames,).
        moments
            Instants of each exposure at which moving objects are placed, evenly spaced.
        """
        within = (np.arange(moments) + 0.5) / moments
        times = (begins[:, None] + exposures[:, None] * within).ravel()
        return FrameView(
            self.lens, self.footprint, self.shape, device_poses([poses])[0], loaded.poses_at(times), moments
        )


def is_hidden(loaded: LoadedScene, point: Array, direction: Array, time: float) -> bool:
    """Return whether anything of the scene stands between a point (3,) and what is far away in a direction (3,)."""
    ray = mi.Ray3f(mi.Point3f(*map(float, point)), mi.Vector3f(*map(float, direction)))
    return bool(is_occluded(at_time(loaded, time), ray).numpy()[0])
