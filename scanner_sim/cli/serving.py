"""The verb ``serve``."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from scanner_sim.cli.call import Call
from scanner_sim.cli.report import scenario_of, warn
from scanner_sim.cli.tracking import write_tracking
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.memory import check_patterns
from scanner_sim.products.files.contents import TRACK
from scanner_sim.products.formats.writers import check_formats

if TYPE_CHECKING:
    from scanner_sim.serve.session import Session


def serve_scenario(
    call: Call,
    *,
    bind: str,
    realtime: float | None,
    state: Path,
    resume: Path | None,
    patience: float,
    threads: int,
) -> None:
    """Serve the track of a scenario until a client or a signal ends it; then its files are written.

    Raises
    ------
    ScannerSimError
        If the scenario, the folder, the address or the device cannot be used, or the disk fails.
    KeyboardInterrupt
        After everything is saved, if a signal ended it.
    """
    _check_installed()
    from scanner_sim.render.device import activate
    from scanner_sim.render.guest import guest
    from scanner_sim.serve.messages import PROTOCOL
    from scanner_sim.serve.server import Server, is_local
    from scanner_sim.serve.session import Session

    scenario = call.scenario()
    _ = scenario.following
    check_formats(scenario.output.formats)
    check_patterns((scenario,))
    files = _Files(call, scenario, state, resume)
    with guest(), call.claimed(TRACK), contextlib.closing(Server(bind, patience=patience)) as server:
        # Kernels of a pattern are so short that a second thread waits most of the time, and keeps its core busy: it is
        # for who has a core to spare.
        activate(call.device, threads=threads)
        if not is_local(server.address):
            warn(
                f"{server.address} is open to other computers: whoever reaches it steers this run; "
                "nothing is asked of them and nothing is encrypted"
            )
        with scenario_of(call.config):
            session = Session(scenario, device=call.device, resume=resume, save=files.save)
        told = {"address": server.address, "protocol": PROTOCOL, "realtime": realtime}
        typer.echo(json.dumps(told))
        try:
            with _ended_by_signals() as came:
                server.serve(session, realtime=realtime, stopped=lambda: bool(came))
        except BaseException:
            files.save_state(session)
            raise
        names = files.save(session) if came else files.write(session)
        if not call.quiet:
            typer.echo(f"written: {', '.join(names)}", err=True)
        if came:
            typer.echo(f"go on with: --resume {state}", err=True)
            signal.raise_signal(came[0])


class _Files:
    """What a served run writes: its folder, and its state."""

    def __init__(self, call: Call, scenario: Scenario, state: Path, resume: Path | None) -> None:
        self._call, self._scenario, self._state = call, scenario, state
        self._overwrite = call.overwrite
        if state.exists() and not call.overwrite and state != resume:
            raise InputError(f"{state} exists.", remedy="Name another with --state, or say --overwrite.")

    def save_state(self, session: Session) -> None:
        """Write the state."""
        self._state.parent.mkdir(parents=True, exist_ok=True)
        session.tracker.save(self._state)

    def save(self, session: Session) -> list[str]:
        """Write state and folder."""
        self.save_state(session)
        return [str(self._state), *self.write(session)]

    def write(self, session: Session) -> list[str]:
        """Write the folder, as ``run`` does; later ones replace it."""
        _, paths = write_tracking(session.track, self._scenario, self._call, overwrite=self._overwrite)
        self._overwrite = True
        return [str(path) for path in paths]


def _check_installed() -> None:
    missing = [name for name in ("zmq", "msgpack") if importlib.util.find_spec(name) is None]
    if missing:
        raise InputError(
            f"serving needs {' and '.join(missing)}, not installed.",
            remedy="pip install 'scanner-sim[serve]'",
        )


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[list[int]]:
    """Let Ctrl-C and termination end the serving after the visit that is being made; a second one at once.

    Yields a list of those that came.
    """
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield came
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def note(number: int, frame: object) -> None:  # noqa: ARG001 (the signal's signature)
        came.append(number)
        for each, handler in before.items():
            signal.signal(each, handler)

    for number in before:
        signal.signal(number, note)
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
