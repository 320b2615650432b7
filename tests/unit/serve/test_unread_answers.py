"""A client that asks on and does not read: what it loses, and that nobody else does."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import msgpack
import zmq

from scanner_sim.serve.messages import Request
from scanner_sim.serve.server import Server

COUNT, WAITING = 300, 64
TEXT = "x" * 200_000


def ask(client: zmq.Socket[bytes], command: str, number: int) -> None:
    client.send(msgpack.packb({"protocol": 1, "command": command, "id": number}))


def read(client: zmq.Socket[bytes]) -> dict[str, Any]:
    assert client.poll(20_000), "the server hangs"
    answer: dict[str, Any] = msgpack.unpackb(client.recv())
    return answer


def test_who_does_not_read_loses_answers_and_may_read_on() -> None:
    """Claim: 64 answers wait, the first ones in their order; those beyond are lost to this client alone, others have
    theirs meanwhile, and what is asked once there is room again is answered.

    Set-up: 300 answers of 200 kB: more than the 64, the one that the client holds, and the system's buffers together.
    """
    asked: list[int | None] = []

    def answer(request: Request) -> dict[str, str]:
        asked.append(request.id)
        return {"said": TEXT}

    session: Any = SimpleNamespace(look_ahead=lambda: False, answer=answer)
    with (
        closing(Server("tcp://127.0.0.1:*")) as server,
        zmq.Context() as context,
        context.socket(zmq.DEALER) as deaf,
        context.socket(zmq.DEALER) as other,
    ):
        deaf.setsockopt(zmq.RCVHWM, 1)
        for client in (deaf, other):
            client.setsockopt(zmq.LINGER, 0)
            client.connect(server.address)

        def serve(done: Callable[[], bool]) -> None:
            deadline = time.monotonic() + 20.0
            server.serve(session, stopped=lambda: done() or time.monotonic() > deadline)

        for number in range(COUNT):
            ask(deaf, "step" if number else "open", number)
        serve(lambda: len(asked) == COUNT)
        ask(other, "step", 0)
        serve(lambda: bool(other.poll(0)))
        assert read(other)["error"]["kind"] == "busy"
        found = [read(deaf)["id"] for _ in range(WAITING)]
        while found[-1] < COUNT:
            # There is room once what the system holds was read as well.
            ask(deaf, "step", number := number + 1)
            serve(lambda: asked[-1] == number)
            found.append(read(deaf)["id"])
    assert asked == list(range(number + 1))
    assert found[:-1] == list(range(len(found) - 1))
    assert len(found) <= COUNT
