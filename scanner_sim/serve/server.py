"""The socket of a served run: ZeroMQ, one client at a time, in lock-step with it or by a clock of its own."""

from __future__ import annotations

import ipaddress
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import zmq

from scanner_sim.foundation.errors import InputError, ScannerSimError
from scanner_sim.serve import messages as ask
from scanner_sim.serve.answers import Plain, done, refused, refused_by
from scanner_sim.serve.session import Session
from scanner_sim.serve.wire import LARGEST, pack, unpack

_LOOK = 100
"""Time [ms] after which the server looks whether it was told to stop."""
_WAITING = 64
"""Answers that wait for a client that does not read; it loses those that follow."""


class Server:
    """A socket that is bound; :meth:`serve` answers until it is told to stop.

    Parameters
    ----------
    address
        ``tcp://HOST:PORT``, with ``*`` for any free port, or ``ipc://PATH``.
    patience
        Silence [s] after which another client may take the run from the one that holds it.

    Raises
    ------
    InputError
        If the address cannot be bound.
    """

    def __init__(self, address: str, *, patience: float = 10.0) -> None:
        _check_address(address)
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        options = {zmq.MAXMSGSIZE: LARGEST, zmq.LINGER: 500, zmq.ROUTER_MANDATORY: 1, zmq.SNDTIMEO: 0}
        for option, value in (options | {zmq.SNDHWM: _WAITING, zmq.RCVHWM: _WAITING}).items():
            self._socket.setsockopt(option, value)
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            self.close()
            raise InputError(
                f"{address} cannot be bound: {error.strerror}.", remedy="Name another, or tcp://127.0.0.1:*"
            ) from None
        self.address: str = self._socket.getsockopt_string(zmq.LAST_ENDPOINT)
        self._patience = patience
        self._holder: tuple[bytes, str, float] | None = None
        self._stopped = False

    def close(self) -> None:
        """Let go of the address."""
        self._socket.close()
        self._context.term()

    def serve(
        self, session: Session, *, realtime: float | None = None, stopped: Callable[[], bool] = lambda: False
    ) -> None:
        """Answer until a client ends the run or ``stopped`` says so.

        Parameters
        ----------
        session
            The run.
        realtime
            Seconds of the run in one of the wall clock, from the first client on; None waits for each ``step``.
        stopped
            Looked at between visits and ten times a second.
        """
        session.realtime = realtime
        start: float | None = None
        while not (self._stopped or stopped()):
            working = session.look_ahead()
            if realtime is None or start is None:
                wait = _LOOK
            else:
                due = start + session.tracker.time / realtime - time.monotonic()
                wait = _LOOK if session.tracker.finished else int(min(max(1e3 * due, 0.0), _LOOK))
            if self._socket.poll(0 if working else wait):
                self._receive(session)
            if realtime is not None and start is None and self._holder is not None:
                start = time.monotonic() - session.tracker.time / realtime
            if realtime is not None and start is not None:
                self._go_on(session, start, realtime)

    def _go_on(self, session: Session, start: float, rate: float) -> None:
        """Make the visit that is due; it is an overrun if by the clock it is over later than it says."""
        if session.run_until(rate * (time.monotonic() - start)):
            session.overruns += rate * (time.monotonic() - start) > session.tracker.time

    def _receive(self, session: Session) -> None:
        """Answer a message; what cannot be read is answered as well."""
        sender, *frames = self._socket.recv_multipart()
        envelope = frames[:1] if len(frames) == 2 and frames[0] == b"" else []
        if len(frames) != 1 + len(envelope):
            self._send(sender, envelope, refused(None, "input", "a message is one frame.", "Send one."))
            return
        self._send(sender, envelope, self._answer(sender, frames[-1], session))

    def _answer(self, sender: bytes, data: bytes, session: Session) -> Plain:
        number: int | None = None
        try:
            content = unpack(data)
            number = _number(content)
            request = ask.read_request(content)
            if (holder := self._held_by_another(sender)) is not None:
                return refused(
                    number,
                    "busy",
                    f"'{holder}' holds the run.",
                    f"It lets go with close, or after {self._patience:g} s of silence.",
                )
            if not isinstance(request, ask.Open) and self._holder is None:
                raise InputError("the run is not open.", remedy="Send 'open' first.")
            told = done(number, session.answer(request))
        except ScannerSimError as error:
            if self._holder is not None and self._holder[0] == sender:
                self._holder = (*self._holder[:2], time.monotonic())
            return refused_by(number, error)
        self._hold(sender, request)
        return told

    def _held_by_another(self, sender: bytes) -> str | None:
        """Return the name of another client that holds the run and was heard of lately."""
        if self._holder is None or self._holder[0] == sender:
            return None
        _, name, heard = self._holder
        if time.monotonic() - heard <= self._patience:
            return name
        self._holder = None
        return None

    def _hold(self, sender: bytes, request: ask.Request) -> None:
        """Remember who holds the run; silence counts from the end of what was done."""
        if isinstance(request, ask.Close):
            self._holder, self._stopped = None, request.stop
            return
        name = request.client if isinstance(request, ask.Open) else ""
        if self._holder is not None:
            name = name or self._holder[1]
        self._holder = sender, name, time.monotonic()

    def _send(self, sender: bytes, envelope: list[bytes], content: Plain) -> None:
        """Send an answer; who has gone, or does not read, loses it."""
        try:
            self._socket.send_multipart([sender, *envelope, pack(content)])
        except zmq.ZMQError as error:
            if error.errno not in (zmq.EHOSTUNREACH, zmq.EAGAIN):
                raise


def _number(content: Any) -> int | None:
    """Return the number of a message that may be none, for its answer."""
    number = content.get("id") if isinstance(content, dict) else None
    return (
        number if isinstance(number, int) and not isinstance(number, bool) and 0 <= number <= 2**53 else None
    )


def is_local(address: str) -> bool:
    """Return whether only this computer reaches an address."""
    parts = urlsplit(address)
    if parts.scheme == "ipc" or parts.hostname == "localhost":
        return True
    try:
        return ipaddress.ip_address(parts.hostname or "").is_loopback
    except ValueError:
        return False


def _check_address(address: str) -> None:
    kind, _, rest = address.partition("://")
    if kind not in ("tcp", "ipc") or not rest or "\0" in address or (kind == "tcp" and ":" not in rest):
        raise InputError(
            f"'{address}' is no address to bind.", remedy="Write tcp://127.0.0.1:5555, or tcp://127.0.0.1:*"
        )
