"""Where the objects of a scene truly stand when a scan begins and when it ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class TruePoses:
    """The poses of all objects at two instants, in the scanner's frame, in which the scanner itself rests.

    Attributes
    ----------
    time
        Begin of the first dwell and end of the last [s].
    scanner_from_object
        By the names of the objects, shape (2, 4, 4): the matrix of each instant takes a point of the object's frame to
        the scanner's. Where an object is at other times, ``scenario.scene.objects[…].pose_at(time)`` tells.
    """

    time: tuple[float, float]
    scanner_from_object: Mapping[str, NDArray[np.float64]]

    def plain(self) -> dict[str, Any]:
        """Return the same as numbers and lists."""
        return {
            "time_s": list(self.time),
            "scanner_from_object": {name: pose.tolist() for name, pose in self.scanner_from_object.items()},
        }

    @classmethod
    def of_plain(cls, data: Any) -> TruePoses:
        """Return what :meth:`plain` was made of.

        Raises
        ------
        ValueError, TypeError, LookupError, AttributeError
            If it is something else.
        """
        first, last = (float(time) for time in data["time_s"])
        poses = {
            str(name): np.array(pose, dtype=np.float64) for name, pose in data["scanner_from_object"].items()
        }
        if any(pose.shape != (2, 4, 4) or not np.isfinite(pose).all() for pose in poses.values()):
            raise ValueError("a pose is no pair of matrices")
        return cls((first, last), poses)
