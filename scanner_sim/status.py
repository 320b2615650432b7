"""Status codes: why a shot has no range, each with its sentence.

Validity is a code beside NaN, never an exception per shot. The codes are stable: files of earlier versions
keep their meaning, new codes are added at the end.
"""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Outcome of one shot."""

    sentence: str

    def __new__(cls, code: int, sentence: str) -> Status:
        member = int.__new__(cls, code)
        member._value_ = code
        member.sentence = sentence
        return member

    VALID = 0, "a range was measured"
    BELOW_THRESHOLD = 1, "no pixel of the line rises above the detection threshold"
    SATURATED = 2, "the peak reaches the full well or the end of the converter"
    AMBIGUOUS = 3, "two separate peaks of comparable height"
    OUT_OF_ARRAY = 4, "the peak lies too near the end of the array for the estimator's window"
    OUT_OF_GATE = 5, "the range lies outside the range gate"


def legend() -> dict[str, str]:
    """Return ``{code: "NAME: sentence"}`` for file headers."""
    return {str(int(member)): f"{member.name}: {member.sentence}" for member in Status}
