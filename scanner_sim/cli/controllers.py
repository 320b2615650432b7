"""Verbs for programs that steer the scanner from outside."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scanner_sim.cli.options import beside, scenario_verb

if TYPE_CHECKING:
    from scanner_sim.cli.call import Call


@scenario_verb("served")
def serve(
    call: Call,
    bind: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Where clients find it; * is any free port. Loopback unless you say otherwise.",
        ),
    ] = "tcp://127.0.0.1:*",
    realtime: Annotated[
        float | None,
        typer.Option(
            metavar="RATE",
            min=1e-3,
            max=1e3,
            help="Run by the wall clock, so many seconds of the run in one, and count overruns.",
            show_default="in lock-step",
        ),
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="State that is saved.", show_default="the folder's name with .state"
        ),
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(metavar="FILE", help="State where to go on.", show_default=False)
    ] = None,
    patience: Annotated[
        float,
        typer.Option(
            metavar="S", min=0.1, max=1e5, help="Silence of a client after which another may take the run."
        ),
    ] = 10.0,
    threads: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=1,
            max=1024,
            help="Threads that compute. Two are quicker on a machine that does nothing else; on a busy one, slower.",
        ),
    ] = 1,
) -> None:
    """Let another program steer a track through a socket: move objects, change the light, step, get measurements.

    Example: `scanner-sim serve configs/track_moving.yaml --bind tcp://127.0.0.1:5555`

    Messages are MessagePack over ZeroMQ; `scanner-sim schema --messages` prints their form, the guide *Serve it*
    explains them. One line of JSON on the standard output says the address. The files of a track are written when a
    client ends or saves the run; Ctrl-C saves too, and `--resume` goes on.
    """
    from scanner_sim.cli.serving import serve_scenario

    serve_scenario(
        call,
        bind=bind,
        realtime=realtime,
        state=state or beside(call.output, ".state"),
        resume=resume,
        patience=patience,
        threads=threads,
    )
