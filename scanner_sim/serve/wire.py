"""Messages as bytes: MessagePack of plain values alone, bounded, and maps whose keys are words that come once."""

from __future__ import annotations

from typing import Any

import msgpack
import numpy as np
from numpy.typing import ArrayLike

from scanner_sim.foundation.errors import InputError

LARGEST = 65_536
"""Bytes of a request; a connection that sends more is cut by the socket."""


def unpack(data: bytes) -> Any:
    """Return what a message holds: maps, lists, text, numbers, true, false and nothing.

    Raises
    ------
    InputError
        If it is no MessagePack, is too large, holds bytes or types of somebody's own, or a key twice.
    """
    if len(data) > LARGEST:
        raise InputError(f"the message has {len(data)} bytes.", remedy=f"At most {LARGEST} are read.")
    try:
        return msgpack.unpackb(
            data,
            raw=False,
            strict_map_key=True,
            object_pairs_hook=_map,
            ext_hook=_refuse,
            max_bin_len=0,
            max_ext_len=0,
        )
    except (ValueError, TypeError, msgpack.UnpackException, RecursionError, OverflowError) as error:
        reason = str(error).split("\n")[0][:200] or type(error).__name__
        raise InputError(
            f"this is no message: {reason}.",
            remedy="Send one map as MessagePack, of text, numbers, lists and maps.",
        ) from None


def pack(content: dict[str, Any]) -> bytes:
    """Return a message as bytes; numbers of NumPy become plain ones."""
    packed: bytes = msgpack.packb(content, use_bin_type=True)
    return packed


def array(values: ArrayLike) -> dict[str, Any]:
    """Return an array as a map: ``dtype`` (little endian, as NumPy writes it), ``shape``, and its bytes row by row."""
    held = np.asarray(values)
    held = np.ascontiguousarray(held, dtype=held.dtype.newbyteorder("<"))
    return {"dtype": held.dtype.str, "shape": list(held.shape), "data": held.tobytes()}


def _map(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    made = dict(pairs)
    if len(made) != len(pairs):
        raise ValueError("a map holds a key twice")
    if not all(isinstance(key, str) for key in made):
        raise ValueError("a key is no text")
    return made


def _refuse(code: int, data: bytes) -> Any:  # noqa: ARG001 (msgpack's signature)
    raise ValueError(f"type {code} of somebody's own")
