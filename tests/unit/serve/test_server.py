"""The socket of a served run without a run behind it: who holds it, who does not, and what cannot be read."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgpack
import pytest
import zmq

from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.serve import messages as ask
from scanner_sim.serve import session as session_module
from scanner_sim.serve.server import Server, _number, is_local
from scanner_sim.serve.wire import LARGEST

PATIENCE = 0.5
WAIT = 20_000


OPEN: list[zmq.Socket[bytes]] = []
"""Sockets of the clients of a test."""


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    while OPEN:
        OPEN.pop().close()


class Clock:
    """Stands for a tracker whose visits take 10 ms of the run."""

    time, finished = 0.0, False


class Echo:
    """Stands for a session: it answers what it was asked, and refuses what is told to fail."""

    def __init__(self, cost: float = 0.0) -> None:
        self.tracker, self.overruns, self.realtime, self.cost = Clock(), 0, None, cost
        self.asked: list[str] = []
        self.ahead, self.left = 0, 2

    def look_ahead(self) -> bool:
        if self.ahead >= self.left:
            return False
        time.sleep(1e-3)
        self.ahead += 1
        return True

    def answer(self, request: Any) -> dict[str, Any]:
        if request.command == "drop":
            raise InputError("there is no target.", remedy="Name one.")
        if request.command == "save":
            raise RunError("the disk is full.")
        self.asked.append(request.command)
        return {"asked": request.command}

    def run_until(self, clock: float) -> bool:
        if self.tracker.time > clock:
            return False
        time.sleep(self.cost)
        self.tracker.time += 0.01
        return True


class Client:
    """A client that says what it likes."""

    def __init__(self, address: str, kind: int = zmq.REQ) -> None:
        self.socket = zmq.Context.instance().socket(kind)
        OPEN.append(self.socket)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.connect(address)

    def raw(self, *frames: bytes) -> dict[str, Any]:
        self.socket.send_multipart(frames)
        assert self.socket.poll(WAIT), "the server hangs"
        answer: dict[str, Any] = msgpack.unpackb(self.socket.recv_multipart()[-1])
        return answer

    def ask(self, command: str, **content: Any) -> dict[str, Any]:
        return self.raw(msgpack.packb({"protocol": 1, "command": command} | content))


@pytest.fixture
def served() -> Iterator[tuple[str, Echo]]:
    with running(Echo()) as served:
        yield served


@contextmanager
def running(session: Any, realtime: float | None = None) -> Iterator[tuple[str, Any]]:
    server, stop = Server("tcp://127.0.0.1:*", patience=PATIENCE), threading.Event()
    work = threading.Thread(
        target=server.serve, args=(session,), kwargs={"realtime": realtime, "stopped": stop.is_set}
    )
    work.start()
    try:
        yield server.address, session
    finally:
        stop.set()
        work.join(20.0)
    assert not work.is_alive()
    server.close()


@pytest.mark.parametrize("kind", [zmq.REQ, zmq.DEALER])
def test_an_answer_says_what_was_asked_and_repeats_its_number(served: Any, kind: int) -> None:
    client = Client(served[0], kind)
    assert client.ask("open", id=3) == {"protocol": 1, "id": 3, "ok": True, "asked": "open"}
    assert client.ask("step")["id"] is None


def test_while_nobody_asks_the_server_looks_ahead(served: Any) -> None:
    """Claim: all parts of the next visit are done, and a message waits for no more than the one that is being done."""
    client, session = Client(served[0]), served[1]
    client.ask("open")
    deadline = time.monotonic() + 20.0
    while session.ahead < session.left and time.monotonic() < deadline:
        time.sleep(1e-3)
    assert session.ahead == session.left
    session.left = 10**9
    client.ask("step")
    before = session.ahead
    client.ask("step")
    assert session.ahead > before
    assert client.ask("close", stop=True)["ok"]


def test_between_parts_of_the_next_visit_the_server_does_not_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: it looks for messages between two parts, and waits for them, a tenth of a second, when none is left."""
    server, waits = Server("tcp://127.0.0.1:*"), list[int]()

    class Silent:
        def poll(self, milliseconds: int) -> int:
            waits.append(milliseconds)
            return 0

    with monkeypatch.context() as quiet:
        quiet.setattr(server, "_socket", Silent())
        server.serve(Echo(), stopped=lambda: len(waits) == 4)  # type: ignore[arg-type]
    server.close()
    assert waits == [0, 0, 100, 100]


def test_what_cannot_be_done_is_said_and_the_run_goes_on(served: Any) -> None:
    client = Client(served[0], zmq.DEALER)
    assert client.ask("step")["error"]["message"] == "the run is not open."
    client.ask("open")
    refused = client.ask("drop", target="x", id=9)
    assert (refused["ok"], refused["id"], refused["error"]["kind"]) == (False, 9, "input")
    assert refused["error"]["remedy"] == "Name one."
    assert client.ask("save")["error"]["kind"] == "run"
    for garbage in (b"", b"\xc1", b"x" * 1000, msgpack.packb([1])):
        assert client.raw(garbage)["error"]["kind"] == "input"
    assert client.raw(b"one", b"two")["error"]["message"] == "a message is one frame."
    assert client.raw(b"", b"", b"")["error"]["message"] == "a message is one frame."
    assert client.ask("step")["ok"]


def test_a_second_client_is_refused_until_the_first_lets_go(served: Any) -> None:
    """Claim: nothing that a second client asks reaches the run, and it is told who holds it; after ``close`` it may."""
    first, second = Client(served[0]), Client(served[0])
    first.ask("open", client="guidance")
    first.ask("step")
    for command in ("open", "step", "close"):
        refused = second.ask(command)
        assert refused["error"]["kind"] == "busy"
        assert "'guidance' holds the run" in refused["error"]["message"]
    assert served[1].asked == ["open", "step"]
    first.ask("close")
    assert second.ask("open")["ok"]
    assert first.ask("step")["error"]["kind"] == "busy"


def test_a_client_that_died_loses_the_run_after_its_patience(served: Any) -> None:
    first, second = Client(served[0]), Client(served[0])
    first.ask("open")
    first.socket.send(msgpack.packb({"protocol": 1, "command": "step"}))
    first.socket.close()  # before its answer
    assert second.ask("open")["error"]["kind"] == "busy"
    time.sleep(1.5 * PATIENCE)
    assert second.ask("step")["error"]["message"] == "the run is not open."
    assert second.ask("open")["ok"]


def test_a_slow_client_keeps_the_run_while_nobody_else_asks(served: Any) -> None:
    client = Client(served[0])
    client.ask("open")
    time.sleep(1.5 * PATIENCE)
    assert client.ask("step")["ok"]


def test_a_client_that_errs_is_not_silent(served: Any) -> None:
    first, second = Client(served[0]), Client(served[0])
    first.ask("open")
    until = time.monotonic() + 1.5 * PATIENCE
    while time.monotonic() < until:
        assert not first.ask("drop", target="x")["ok"]
        time.sleep(0.1 * PATIENCE)
    assert second.ask("open")["error"]["kind"] == "busy"


def test_who_does_not_read_or_sends_too_much_does_not_stop_the_others(served: Any) -> None:
    """Claim: a client that never reads its answers, and one whose message is too large, are no one's matter."""
    deaf, large, client = Client(served[0], zmq.DEALER), Client(served[0], zmq.DEALER), Client(served[0])
    for _ in range(3000):
        deaf.socket.send(msgpack.packb({"protocol": 1, "command": "step"}), zmq.DONTWAIT)
        if not deaf.socket.poll(0, zmq.POLLOUT):
            break
    large.socket.send(b"x" * (LARGEST + 1))
    assert client.ask("open")["ok"]
    assert not large.socket.poll(200)


def test_a_client_that_ends_the_run_ends_the_server() -> None:
    session, server = Echo(), Server("tcp://127.0.0.1:*")
    work = threading.Thread(target=server.serve, args=(session,))
    work.start()
    client = Client(server.address)
    client.ask("open")
    assert client.ask("close", stop=True)["ok"]
    work.join(20.0)
    assert not work.is_alive()
    server.close()


@pytest.mark.parametrize(("cost", "late"), [(0.0, False), (0.03, True)])
def test_a_free_run_keeps_the_clock_and_counts_overruns(cost: float, late: bool) -> None:
    """Claim: it begins with the first client, goes on by itself, and each visit that costs thrice its time is late.

    A visit that costs nothing may be late on a machine that is busy: at most of some.
    """
    session = Echo(cost)
    with running(session, realtime=1.0) as (address, _):
        time.sleep(0.4)
        assert session.tracker.time == 0.0
        client, begun = Client(address), time.monotonic()
        client.ask("open")
        while session.tracker.time < 0.2:
            time.sleep(0.01)
            assert time.monotonic() - begun < 20.0
        if not late:
            assert session.tracker.time <= time.monotonic() - begun + 0.02
        visits = round(session.tracker.time / 0.01)
        assert session.overruns >= visits - 2 if late else session.overruns < visits


@pytest.mark.parametrize(
    "address", ["", "5555", "inproc://x", "tcp://", "tcp://host", "tcp://999.0.0.1:1", "tcp://127.0.0.1:x"]
)
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(InputError) as caught:
        Server(address)
    assert "tcp://127.0.0.1:" in caught.value.remedy


def test_an_address_that_is_taken_is_refused(served: Any) -> None:
    with pytest.raises(InputError, match="cannot be bound"):
        Server(served[0])


def test_only_loopback_is_local() -> None:
    assert all(
        map(
            is_local,
            ("tcp://127.0.0.1:5", "tcp://127.9.0.1:*", "tcp://[::1]:5", "tcp://localhost:5", "ipc:///tmp/x"),
        )
    )
    assert not any(
        map(is_local, ("tcp://0.0.0.0:5", "tcp://*:5", "tcp://10.0.0.1:5", "tcp://[::]:5", "tcp://eth0:5"))
    )


@pytest.mark.parametrize(
    ("done", "rate", "finished", "waits"),
    [(0.1, 2.0, False, 50), (0.1, 0.5, False, 100), (0.01, 1.0, False, 10), (0.1, 2.0, True, 100)],
)
def test_a_free_run_waits_until_its_next_visit_is_due(
    monkeypatch: pytest.MonkeyPatch, done: float, rate: float, finished: bool, waits: int
) -> None:
    """Claim: a visit that is due at a time of the run is waited for as long as the clock takes for it, and a tenth of a
    second at most; before the first client, after the end, and without a clock just that tenth."""
    server = object.__new__(Server)
    waited: list[int] = []
    server._stopped, server._holder = False, None
    server._socket = SimpleNamespace(poll=lambda wait: waited.append(wait) or False)  # type: ignore[assignment]
    session: Any = SimpleNamespace(
        look_ahead=lambda: False, tracker=SimpleNamespace(time=0.0, finished=finished), realtime=None
    )
    monkeypatch.setattr(
        Server, "_go_on", lambda self, session, start, rate: setattr(session.tracker, "time", done)
    )
    monkeypatch.setattr("scanner_sim.serve.server.time.monotonic", lambda: 1000.0)
    turns = iter(range(4))

    def stopped() -> bool:
        turn = next(turns, None)
        server._holder = ("client", b"") if turn else None  # type: ignore[assignment]
        return turn is None

    server.serve(session, realtime=rate, stopped=stopped)
    # The first one comes while nobody is there, the next when the clock begins.
    assert waited == pytest.approx([100, 100, waits, waits], abs=1)
    assert session.realtime == rate


@pytest.mark.parametrize("patience", [10.0, 3.0])
def test_the_run_is_held_for_as_long_as_the_patience_says(
    monkeypatch: pytest.MonkeyPatch, patience: float
) -> None:
    """Claim: silence of just the patience keeps the run, a thousandth more loses it; who holds it is never another."""
    clock = [0.0]
    monkeypatch.setattr("scanner_sim.serve.server.time.monotonic", lambda: clock[0])
    server = object.__new__(Server)
    server._patience, server._holder = patience, None
    assert server._held_by_another(b"you") is None
    server._holder = b"me", "mine", 70.0
    for silence, holder in ((0.999 * patience, "mine"), (1.001 * patience, None)):
        clock[0] = 70.0 + silence
        assert server._held_by_another(b"me") is None
        assert server._held_by_another(b"you") == holder
        assert (server._holder is None) is (holder is None)


def test_silence_counts_from_the_last_that_was_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: who asks every six seconds keeps the run for longer than the patience of ten, under the name of its first
    message; ten seconds after its last one another gets it."""
    clock = [100.0]
    monkeypatch.setattr("scanner_sim.serve.server.time.monotonic", lambda: clock[0])
    server = object.__new__(Server)
    server._patience, server._holder = 10.0, None
    server._hold(b"me", ask.Open(protocol=1, command="open", client="mine"))
    for _ in range(4):
        clock[0] += 6.0
        assert server._held_by_another(b"you") == "mine"
        server._hold(b"me", ask.Step(protocol=1, command="step"))
    clock[0] += 9.9
    assert server._held_by_another(b"you") == "mine"
    clock[0] += 0.2
    assert server._held_by_another(b"you") is None


@pytest.mark.parametrize(("took", "late"), [(0.019, False), (0.021, True)])
def test_a_visit_is_late_if_the_clock_is_past_its_end(
    monkeypatch: pytest.MonkeyPatch, took: float, late: bool
) -> None:
    """Claim: at half of the clock's rate a visit of 10 ms that is due has 20 ms; one that is not due is not made."""
    clock, session = [100.28], Echo()
    monkeypatch.setattr("scanner_sim.serve.server.time.monotonic", lambda: clock[0])
    monkeypatch.setattr(time, "sleep", lambda cost: clock.__setitem__(0, clock[0] + cost))
    session.cost, session.tracker.time = took, 0.14 - 1e-6
    server = object.__new__(Server)
    server._go_on(session, 100.0, 0.5)  # type: ignore[arg-type]
    assert (session.tracker.time, session.overruns) == (pytest.approx(0.15, abs=1e-5), late)
    session.tracker.time = 0.2
    server._go_on(session, 100.0, 0.5)  # type: ignore[arg-type]
    assert (session.tracker.time, session.overruns) == (0.2, late)


def test_who_errs_beside_the_holder_takes_no_time_from_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: what cannot be read keeps the run for who holds it, and for nobody else."""
    clock = [75.0]
    monkeypatch.setattr("scanner_sim.serve.server.time.monotonic", lambda: clock[0])
    server = object.__new__(Server)
    server._patience, server._stopped = 10.0, False
    for sender, heard in ((b"you", 70.0), (b"me", 75.0)):
        server._holder = b"me", "mine", 70.0
        assert not server._answer(sender, b"\xc1", Echo())["ok"]  # type: ignore[arg-type]
        assert server._holder == (b"me", "mine", heard)
    server._holder = None
    assert not server._answer(b"you", b"\xc1", Echo())["ok"]  # type: ignore[arg-type]
    assert server._holder is None


def test_a_session_begins_anew_or_where_it_was_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: without a state the tracker is that of the scenario; with one it goes on from there, on the device that is
    asked for, after it was seen that both follow the same targets."""
    asked: list[tuple[Any, ...]] = []

    class Made:
        def __init__(self, scenario: Any, *, device: str) -> None:
            asked.append(("new", scenario, device))

        @staticmethod
        def resume(path: Any, *, device: str) -> str:
            asked.append(("resumed", path, device))
            return "tracker"

    monkeypatch.setattr(session_module, "Tracker", Made)
    monkeypatch.setattr(session_module, "load_state", lambda path: asked.append(("loaded", path)))
    monkeypatch.setattr(session_module, "_check_same_targets", lambda *given: asked.append(("same", *given)))
    scenario: Any = "scenario"
    session_module.Session(scenario, device="cpu")
    assert asked == [("new", "scenario", "cpu")]
    asked.clear()
    found = session_module.Session(scenario, device="cpu", resume=Path("state"))
    assert asked == [
        ("loaded", Path("state")), ("resumed", Path("state"), "cpu"), ("same", "tracker", "scenario", Path("state"))
    ]  # fmt: skip
    assert (found.records, found.overruns, found.realtime) == ([], 0, None)


def test_a_message_s_number_is_a_whole_one_that_every_language_holds() -> None:
    for given, number in (
        (0, 0),
        (2**53, 2**53),
        (2**53 + 1, None),
        (-1, None),
        (True, None),
        (1.0, None),
        ("1", None),
    ):
        assert _number({"id": given}) == number
    assert _number([3]) is _number({}) is None
