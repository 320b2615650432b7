"""Status codes: why a shot has no range, each with its sentence.

Validity is a code beside NaN, never an exception per shot. The codes are stable: files of earlier versions
keep their meaning, new codes are added at the end.
"""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Outcome of one shot."""

    VALID = 0
    BELOW_THRESHOLD = 1
    SATURATED = 2
    AMBIGUOUS = 3
    OUT_OF_ARRAY = 4
    OUT_OF_GATE = 5
    BAD_SHAPE = 6
    BAD_AMPLITUDE = 7
    ISOLATED = 8
    INCONSISTENT = 9
    MIXED = 10
    OVERLAP = 11

    @property
    def sentence(self) -> str:
        """What the code says, in words."""
        return _SENTENCES[self]


VALID, BELOW_THRESHOLD = int(Status.VALID), int(Status.BELOW_THRESHOLD)
"""As plain numbers, for arrays of codes that are compared in each visit: a member of an enum takes NumPy longer."""

_SENTENCES = {
    Status.VALID: "a range was measured",
    Status.BELOW_THRESHOLD: "nothing in the signal rises above the detection threshold",
    Status.SATURATED: "the signal reaches the full well, the amplifier's limit or the end of the converter",
    Status.AMBIGUOUS: "two separate peaks of comparable height",
    Status.OUT_OF_ARRAY: "the peak lies too near the end of the array for the estimator's window",
    Status.OUT_OF_GATE: "the range lies outside the range gate",
    Status.BAD_SHAPE: "the peak has not the width or the shape of the laser spot",
    Status.BAD_AMPLITUDE: "the peak is brighter than any surface at its range could be",
    Status.ISOLATED: "the range agrees with none of its neighbours",
    Status.INCONSISTENT: "triangulation and time of flight disagree beyond chance, and this is the less precise",
    Status.MIXED: "the spot lies on an edge: its light comes from more than one surface",
    Status.OVERLAP: "the pulse is wider than a surface makes it: echoes of more than one overlap",
}


def legend() -> dict[str, str]:
    """Return ``{code: "NAME: sentence"}`` for file headers."""
    return {str(int(member)): f"{member.name}: {member.sentence}" for member in Status}
