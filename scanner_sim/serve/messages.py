"""The messages of the served door: what a client may ask, in one place; its JSON schema is made from here.

A message is a map of MessagePack. Each says the ``protocol``, and may carry an ``id`` that its answer repeats. Angles
are in rad, lengths in m, times in s from the beginning of the run; frames are those of the scanner, quaternions
(w, x, y, z).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from scanner_sim.foundation.errors import Fault, InputError
from scanner_sim.foundation.parts import Count, Number, Part, Switch

PROTOCOL: Literal[1] = 1
"""Version of the messages; a message of another one is refused."""
MOST_VISITS = 256
"""Visits of one ``step``: two seconds of work, after which the socket is looked at again."""
MOST_MOVES = 64
"""Objects of which one ``step`` tells."""
MOST_VOXELS = 65_536
"""Voxels of one ``raster``."""

Name = Annotated[str, Field(min_length=1, max_length=200)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]
_Row6 = Annotated[tuple[Number, ...], Field(min_length=3, max_length=6)]


class Message(Part):
    """What every message holds."""

    protocol: Literal[1]
    """Version of the messages."""
    id: Annotated[Count, Field(ge=0, le=2**53)] | None = None
    """Number that the answer repeats."""


class Open(Message):
    """Take hold of the run, and be told what it is; a free-running clock begins with the first one."""

    command: Literal["open"]
    client: Name = "client"
    """Name by which others are told who holds the run."""


class ObjectState(Part):
    """Where an object is and how it moves, until it is told again."""

    object: Name
    """One with a ``motion``."""
    position: Vector
    """Of its origin."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """``scanner_from_object``, or ``parent_from_object`` of what is fixed to another object."""
    velocity: Vector = (0.0, 0.0, 0.0)
    turn_rate: Vector = (0.0, 0.0, 0.0)
    time: Number | None = None
    """From when on; by default from what is not measured yet."""


class Step(Message):
    """Make visits and return their records; free-running, return up to ``visits`` of those made since the last."""

    command: Literal["step"]
    moves: Annotated[tuple[ObjectState, ...], Field(max_length=MOST_MOVES)] = ()
    """What is told of objects before: as of ``move``, but all of it or, where one is refused, nothing."""
    visits: Annotated[Count, Field(ge=1, le=MOST_VISITS)] = 1
    """How many at most: a run that is over makes no more."""
    truth: Switch = False
    """Whether records tell where the target truly was."""
    voxels: Switch = False
    """Whether records hold the voxels of their pattern."""


class Move(Message, ObjectState):
    """Tell where an object is and how it moves, until it is told again."""

    command: Literal["move"]


class Light(Message):
    """Tell where Sun and Earth stand, and the share of the Sun's light that arrives."""

    command: Literal["light"]
    sun: Vector | None = None
    earth: Vector | None = None
    visible: Number | None = None
    time: Number | None = None


class Point(Message):
    """Expect a target at a place, and search for it there."""

    command: Literal["point"]
    target: Name
    theta: Number
    phi: Number
    range: Number
    rates: Vector | None = None
    """Of the three, per second."""
    covariance: Annotated[tuple[_Row6, ...], Field(min_length=3, max_length=6)] | None = None
    """Of the three, or of the three and their rates."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a covariance that is not square."""
        if self.covariance is not None and {len(row) for row in self.covariance} != {len(self.covariance)}:
            yield Fault(
                "covariance", "its rows are not as long as it is high.", "Give 3 × 3 or 6 × 6 numbers."
            )


class Search(Message):
    """Search for a target where it is expected."""

    command: Literal["search"]
    target: Name


class Drop(Message):
    """Visit a target no more, until ``search`` or ``point``."""

    command: Literal["drop"]
    target: Name


class Amplitude(Message):
    """Run a target's patterns with an amplitude; without one the tracker chooses again."""

    command: Literal["amplitude"]
    target: Name
    amplitude: Number | None = None


class Raster(Message):
    """Measure a raster between two visits: the clock goes on by it."""

    command: Literal["raster"]
    rows: Annotated[Count, Field(ge=1)]
    columns: Annotated[Count, Field(ge=1)]
    horizontal: tuple[Number, Number]
    """First and last Θ."""
    vertical: tuple[Number, Number]
    """First and last φ."""
    layers: Annotated[tuple[Name, ...], Field(min_length=1, max_length=32)] = ("range_m", "sigma_range_m")

    def cross_checks(self) -> Iterator[Fault]:
        """Yield more voxels than one message holds."""
        if self.rows * self.columns > MOST_VOXELS:
            yield Fault(
                "rows", f"{self.rows} × {self.columns} are too many.", f"At most {MOST_VOXELS} voxels."
            )


class Wait(Message):
    """Let the clock go on without a visit."""

    command: Literal["wait"]
    time: Number


class Filter(Message):
    """Begin the pose filter anew, with these numbers."""

    command: Literal["filter"]
    acceleration: Annotated[Number, Field(gt=0.0, le=1e6)] = 1e-6
    """Spectral density of accelerations that nobody told of [m²/s³]."""
    turn_acceleration: Annotated[Number, Field(gt=0.0, le=1e6)] = 1e-6
    """The same of turns [rad²/s³]."""
    patience: Annotated[Number, Field(gt=0.0, le=1e6)] = 0.2
    """Time without a visit that counts after which the filter is coasting."""


class Push(Message):
    """Tell the pose filter of a change of an object's velocity that somebody causes."""

    command: Literal["push"]
    object: Name | None = None
    velocity: Vector
    time: Number
    sigma: Annotated[Number, Field(ge=0.0)] = 0.0


class Pose(Message):
    """Return what the pose filter knows of an object, by default the first one, at a time, by default now."""

    command: Literal["pose"]
    object: Name | None = None
    time: Number | None = None


class Sight(Message):
    """Return where a target is to be seen, by the pose filter: what ``point`` takes."""

    command: Literal["sight"]
    target: Name
    time: Number | None = None


class State(Message):
    """Return what the run is at: targets, their modes, overruns."""

    command: Literal["state"]


class Save(Message):
    """Write the state and the files of the run so far, where the server was told to."""

    command: Literal["save"]


class Close(Message):
    """Let go of the run: another client may take hold of it; with ``stop`` files are written and the server ends."""

    command: Literal["close"]
    stop: Switch = False


Request = (
    Open
    | Step
    | Move
    | Light
    | Point
    | Search
    | Drop
    | Amplitude
    | Raster
    | Wait
    | Filter
    | Push
    | Pose
    | Sight
    | State
    | Save
    | Close
)
_READER: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="command")])
COMMANDS: tuple[str, ...] = tuple(
    one.model_fields["command"].annotation.__args__[0] for one in Request.__args__
)
"""What a client may ask."""


def read_request(content: Any) -> Request:
    """Return the request that a map holds.

    Raises
    ------
    InputError
        If it holds none: with the first key that is at fault.
    """
    if not isinstance(content, dict):
        raise InputError("a message is a map.", remedy=f"Send {{protocol: {PROTOCOL}, command: …}}.")
    if (version := content.get("protocol")) != PROTOCOL or isinstance(version, bool):
        raise InputError(
            f"this server speaks protocol {PROTOCOL}, and the message {_shown(version)}.",
            remedy=f"Send 'protocol': {PROTOCOL}, or use a server of the client's version.",
        )
    if content.get("command") not in COMMANDS:
        raise InputError(
            f"there is no command {_shown(content.get('command'))}.",
            remedy=f"Possible: {', '.join(COMMANDS)}.",
        )
    try:
        return _READER.validate_python(content)
    except ValidationError as error:
        details = error.errors(include_url=False, include_input=False)[0]
        keys = ".".join(str(step) for step in details["loc"][1:])
        if details["type"] == "impossible":
            fault = details["ctx"]["faults"][0]
            raise InputError(f"{fault.location}: {fault.problem}", remedy=fault.remedy) from None
        raise InputError(
            f"{content['command']}, {keys}: {details['msg'][0].lower()}{details['msg'][1:]}.",
            remedy="`scanner-sim schema --messages` says what each message holds.",
        ) from None


def _shown(value: Any) -> str:
    return "none" if value is None else repr(value)[:40]


def messages_schema() -> dict[str, Any]:
    """Return the JSON schema of requests."""
    schema = _READER.json_schema()
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"Requests to scanner-sim serve, protocol {PROTOCOL}",
        **schema,
    }
