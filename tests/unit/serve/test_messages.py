"""What a client may say: bytes, maps, keys, and the schema that tells them."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import scanner_sim.serve
from scanner_sim.foundation.errors import InputError
from scanner_sim.serve.messages import COMMANDS, Move, Point, Request, messages_schema, read_request
from scanner_sim.serve.wire import LARGEST, array, pack, unpack

PLAIN: dict[str, dict[str, Any]] = {
    "move": {"object": "node", "position": [0.0, 0.0, 5.0]},
    "point": {"target": "node/1", "theta": 0.1, "phi": 0.0, "range": 5.0},
    "search": {"target": "node/1"},
    "drop": {"target": "node/1"},
    "amplitude": {"target": "node/1"},
    "raster": {"rows": 4, "columns": 4, "horizontal": [-0.1, 0.1], "vertical": [-0.1, 0.1]},
    "wait": {"time": 3.0},
    "push": {"velocity": [0.0, 0.0, 0.1], "time": 1.0},
    "sight": {"target": "node/1"},
}


def message(command: str, **content: Any) -> dict[str, Any]:
    return {"protocol": 1, "command": command} | PLAIN.get(command, {}) | content


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_read_from_its_bytes(command: str) -> None:
    request = read_request(unpack(msgpack.packb(message(command, id=7))))
    assert (request.command, request.id) == (command, 7)
    assert len(COMMANDS) == len(Request.__args__)


def test_lists_become_the_vectors_of_a_message() -> None:
    move = read_request(unpack(msgpack.packb(message("move", velocity=[1, 2.5, 3]))))
    assert isinstance(move, Move)
    assert move.velocity == (1.0, 2.5, 3.0)
    point = read_request(message("point", covariance=np.eye(6).tolist()))
    assert isinstance(point, Point)
    assert np.array(point.covariance).shape == (6, 6)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ([1], "a message is a map"),
        (None, "a message is a map"),
        ({}, "the message none"),
        ({"protocol": 2, "command": "step"}, "speaks protocol 1, and the message 2"),
        ({"protocol": True, "command": "step"}, "the message True"),
        ({"protocol": 1}, "no command none"),
        ({"protocol": 1, "command": "__class__"}, "no command '__class__'"),
        ({"protocol": 1, "command": ["step"]}, "no command ['step']"),
        (message("step", visits=0), "step, visits"),
        (message("step", visits=1000), "step, visits"),
        (message("step", visits=True), "step, visits"),
        (message("step", visits="1"), "step, visits"),
        (message("step", file="/etc/passwd"), "step, file"),
        (message("step", moves=[PLAIN["move"], {"object": "node"}]), "step, moves.1.position"),
        (message("step", moves=[PLAIN["move"]] * 65), "step, moves"),
        (message("step", moves=PLAIN["move"]), "step, moves"),
        (message("step", id=-1), "step, id"),
        (message("move", position=[0.0, 1.0]), "move, position"),
        (message("move", position=[0.0, float("nan"), 1.0]), "move, position.1"),
        (message("move", position="abc"), "move, position"),
        (message("move", object=""), "move, object"),
        (message("point", covariance=[[1.0, 0.0, 0.0]] * 4), "rows are not as long"),
        (message("raster", rows=1000, columns=1000), "are too many"),
        (message("filter", acceleration=0.0), "filter, acceleration"),
    ],
)
def test_what_is_no_message_is_refused_with_its_key(content: Any, said: str) -> None:
    with pytest.raises(InputError) as caught:
        read_request(content)
    assert said in caught.value.message
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "no message"),
        (b"GET / HTTP/1.1\r\n\r\n", "no message"),
        (b"\xc1", "no message"),
        (msgpack.packb(message("step"))[:-2], "no message"),
        (msgpack.packb(message("step")) + b"\x01", "no message"),
        (b"\x91" * 5000 + b"\x01", "no message"),
        (b"\xdd\xff\xff\xff\xff", "no message"),
        (msgpack.packb({"a": msgpack.ExtType(5, b"\x00")}), "exceeds max_ext_len"),
        (b"\xc7\x00\x05", "type 5 of somebody's own"),
        (msgpack.packb({"a": msgpack.Timestamp(1)}), "ext"),
        (msgpack.packb({"a": b"b"}), "bin"),
        (msgpack.packb({1: 2}), "not allowed"),
        (msgpack.packb({b"": 2}), "no text"),
        (b"\x82\xa1a\x01\xa1a\x02", "a key twice"),
        (b"\xa2\xff\xfe", "no message"),
        (b"\xc0" * (LARGEST + 1), f"has {LARGEST + 1} bytes"),
    ],
)
def test_what_is_not_plain_messagepack_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(InputError, match=said):
        unpack(data)


@given(st.binary(max_size=200))
@example(msgpack.packb(message("move"))[:20])
def test_no_bytes_do_more_than_be_refused(data: bytes) -> None:
    with contextlib.suppress(InputError):
        read_request(unpack(data))


def test_arrays_keep_their_bits() -> None:
    values = np.array([[1.0, np.nan], [1e-300, -0.0]], dtype=">f8")
    told = msgpack.unpackb(pack({"a": array(values)}))["a"]
    again = np.frombuffer(told["data"], told["dtype"]).reshape(told["shape"])
    assert told["dtype"] == "<f8"
    assert again.tobytes() == values.astype("<f8").tobytes()


def test_the_shipped_schema_is_the_generated_one() -> None:
    file = Path(scanner_sim.serve.__file__).with_name("messages.schema.json")
    assert json.loads(file.read_text(encoding="utf-8")) == messages_schema(), (
        "run: scanner-sim schema --messages > scanner_sim/serve/messages.schema.json"
    )
