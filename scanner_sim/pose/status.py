"""Status codes of poses: why there is none, or why it should be doubted, each with its sentence."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class PoseStatus(IntEnum):
    """Outcome of one pose. The codes are stable: new ones are added at the end."""

    VALID = 0
    AMBIGUOUS = 1
    HIDDEN = 2
    TOO_FEW = 3
    COLLINEAR = 4
    NOT_CONVERGED = 5
    MIRRORED = 6
    NO_CONSENSUS = 7
    IMPLAUSIBLE = 8
    UNDETERMINED = 9

    @property
    def sentence(self) -> str:
        """What the code says, in words."""
        return _SENTENCES[self]

    @property
    def has_pose(self) -> bool:
        """Whether a pose stands beside the code, rather than NaN."""
        return self in _WITH_POSE


_WITH_POSE = (PoseStatus.VALID, PoseStatus.AMBIGUOUS, PoseStatus.IMPLAUSIBLE, PoseStatus.NOT_CONVERGED)
"""From the surest to the most doubtful: of two that hold of a pose the later one is its status."""
_SENTENCES = {
    PoseStatus.VALID: "a pose was found",
    PoseStatus.AMBIGUOUS: "a pose was found, but others that its covariance does not cover fit nearly as well, "
    "or nothing checks it",
    PoseStatus.HIDDEN: "no target was measured",
    PoseStatus.TOO_FEW: "fewer than three targets were measured",
    PoseStatus.COLLINEAR: "the measured targets lie on one line: the turn about it is open",
    PoseStatus.NOT_CONVERGED: "the adjustment did not settle; the pose is its last",
    PoseStatus.MIRRORED: "the targets fit their mirror image: check the signs of the surveyed points",
    PoseStatus.NO_CONSENSUS: "too few targets agree on one pose",
    PoseStatus.IMPLAUSIBLE: "the residuals are larger than their standard deviations allow: a wrong target or pose",
    PoseStatus.UNDETERMINED: "the measurements leave the pose open: no covariance can be stated",
}


def legend() -> dict[str, str]:
    """Return ``{code: "NAME: sentence"}`` for file headers."""
    return {str(int(member)): f"{member.name}: {member.sentence}" for member in PoseStatus}


def worse_of(first: NDArray[np.int8], second: NDArray[np.int8]) -> NDArray[np.int8]:
    """Return the status of what two poses make together, shapes (n,): of one without a pose, else the more doubtful.

    Where neither has a pose it is the first one's.
    """
    doubt = np.array([_WITH_POSE.index(code) if code.has_pose else len(_WITH_POSE) for code in PoseStatus])
    return np.where(doubt[first] >= doubt[second], first, second).astype(np.int8)
