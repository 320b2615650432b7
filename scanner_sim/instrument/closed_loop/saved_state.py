"""All that a tracking run carries from visit to visit, and its file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ValidationError

from scanner_sim.config.document import spell
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop.situation import InUse
from scanner_sim.instrument.closed_loop.state_file import FORMAT, SavedRun, SavedState
from scanner_sim.optics.galvanometer import MirrorState
from scanner_sim.products.files.exchange import write_file
from scanner_sim.products.files.folder import write_text
from scanner_sim.scan.ways import MirrorPair, mirrors_at
from scanner_sim.tracking.prediction import Motion
from scanner_sim.tracking.record import TrackTarget
from scanner_sim.tracking.state import Refusal, TrackerSettings, TrackMode, TrackState, init

Array = NDArray[np.float64]

LARGEST_FILE = 64_000_000
"""Bytes of a file: a thousand targets take two million."""


@dataclass(frozen=True)
class TrackerState:
    """A tracking run between two visits.

    Attributes
    ----------
    visits
        Visits so far; the next one has this number, and its shots the numbers from visits · points on.
    clock
        When the next period begins [s].
    mirrors
        Where the mirrors are.
    turn
        Index of the target that is visited next, or of the first one after it that is followed.
    skipped
        Targets outside of the field of view in a row, just before.
    tracks
        What is remembered of each target.
    followed
        Whether each target is visited.
    amplitudes
        Amplitude of each target's patterns [rad] that a command has fixed; None where the tracker chooses.
    used
        What the background uses of moves and of changes of the light.
    said
        Warnings about how the run began.
    """

    visits: int
    clock: float
    mirrors: MirrorPair
    turn: int
    skipped: int
    tracks: tuple[TrackState, ...]
    followed: tuple[bool, ...]
    amplitudes: tuple[float | None, ...]
    used: InUse
    said: tuple[str, ...] = ()


def first_state(targets: tuple[TrackTarget, ...], settings: TrackerSettings) -> TrackerState:
    """Return the state of a run that begins: mirrors at rest straight ahead, every target to be searched for."""
    return TrackerState(
        visits=0,
        clock=0.0,
        mirrors=mirrors_at(0.0, 0.0),
        turn=0,
        skipped=0,
        tracks=tuple(init(target.expected, settings) for target in targets),
        followed=(True,) * len(targets),
        amplitudes=(None,) * len(targets),
        used=InUse(),
    )


def save_state(path: Path, state: TrackerState, scenario_yaml: str, made_by: str) -> None:
    """Write a run's state as JSON, which keeps every bit of every number; the file is whole or not there at all.

    Raises
    ------
    RunError
        If the file cannot be written.
    """
    content = {
        "format": FORMAT,
        "made_by": made_by,
        "scenario": scenario_yaml,
        "state": {
            "visits": state.visits,
            "clock": state.clock,
            "mirrors": {
                "angle": _to_list(state.mirrors.state.angle),
                "rate": _to_list(state.mirrors.state.rate),
                "command": _to_list(state.mirrors.state.command),
                "slope": _to_list(state.mirrors.slope),
                "time": state.mirrors.time,
            },
            "turn": state.turn,
            "skipped": state.skipped,
            "tracks": [_track(track) for track in state.tracks],
            "followed": list(state.followed),
            "amplitudes": list(state.amplitudes),
            "used_moves": {name: move.model_dump(mode="json") for name, move in state.used.moves},
            "used_light": None if state.used.light is None else state.used.light.model_dump(mode="json"),
            "said": list(state.said),
        },
    }
    text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
    if path.exists():
        load_state(path)  # raises where it is something else, which is not ours to replace
    write_file(path, lambda to: write_text(to, text), overwrite=True)


def load_state(path: Path) -> tuple[TrackerState, str]:
    """Return the state of a file of :func:`save_state`, and the resolved scenario that it belongs to.

    Raises
    ------
    InputError
        If there is no such file, or it holds something else: with the first number that is not possible.
    """
    remedy = "Name a file that a tracker saved."
    content = _content(path, remedy)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(
            f"{path} is no state of a tracker that this program reads.",
            remedy="Name a file that a tracker of this version saved.",
        )
    try:
        saved = SavedRun.model_validate(content)
    except ValidationError as error:
        raise InputError(
            f"{path} is a damaged state of a tracker: {_first_fault(error)}", remedy="Save it again."
        ) from None
    return _state(saved.state), saved.scenario


def _content(path: Path, remedy: str) -> object:
    """Return what a JSON file holds."""
    try:
        if not path.is_file():
            reason = "it is no file" if path.exists() else "there is none"
            raise InputError(f"{path} cannot be read: {reason}.", remedy=remedy)
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(f"{path} is too large for the state of a tracker.", remedy=remedy)
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or "it is not JSON"
        raise InputError(f"{path} cannot be read: {reason}.", remedy=remedy) from None


def _first_fault(error: ValidationError) -> str:
    """Say what is wrong first, and where, in the words of the file."""
    details = error.errors(include_url=False, include_input=False)[0]
    location = spell(details["loc"])
    if details["type"] == "impossible":
        fault = details["ctx"]["faults"][0]
        return f"{location}.{fault.location}: {fault.problem}"
    return f"{location}: {details['msg'][0].lower()}{details['msg'][1:]}."


def _state(saved: SavedState) -> TrackerState:
    mirrors = saved.mirrors
    return TrackerState(
        visits=saved.visits,
        clock=saved.clock,
        mirrors=MirrorPair(
            MirrorState(_array(mirrors.angle), _array(mirrors.rate), _array(mirrors.command)),
            _array(mirrors.slope),
            mirrors.time,
        ),
        turn=saved.turn,
        skipped=saved.skipped,
        tracks=tuple(
            TrackState(
                mode=TrackMode(track.mode),
                motion=Motion(_array(track.mean), _array(track.covariance), _array(track.time)),
                expected=_array(track.expected),
                refusal=Refusal(track.refusal),
                **{name: getattr(track, name) for name in _ALIKE},
            )
            for track in saved.tracks
        ),
        followed=saved.followed,
        amplitudes=saved.amplitudes,
        used=InUse(tuple(saved.used_moves.items()), saved.used_light),
        said=saved.said,
    )


def _array(values: ArrayLike) -> Array:
    return np.array(values, dtype=np.float64)


_ALIKE = ("patterns", "seen", "missed", "searched", "told")
"""Numbers that a file holds as the state does."""


def _track(track: TrackState) -> dict[str, object]:
    return {
        "mode": track.mode.value,
        "mean": _to_list(track.motion.mean),
        "covariance": _to_list(track.motion.covariance),
        "time": float(track.motion.time),
        "expected": _to_list(track.expected),
        "refusal": track.refusal.value,
        **{name: getattr(track, name) for name in _ALIKE},
    }


def _to_list(values: Array) -> object:
    return np.asarray(values, dtype=np.float64).tolist()
