"""What the served door costs: patterns a second through the socket with a move at every visit, and where the time goes.

Run as ``python benchmarks/serving.py [--visits 400] [--rounds 3]``.

A server in a process of its own follows the four targets of ``configs/track_moving.yaml``. Its processor time is read
from the system before and after, as the client's own is; threads of the renderer that wait count in it. In turns: a
step, a message that does nothing, a move and a step, a step that carries its move, of a server with one thread and of
one with two; and then the same visits with :class:`~scanner_sim.Tracker` in one process, without a socket. With another
checkout first on ``PYTHONPATH`` it measures that.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import zmq
from rich.console import Console
from rich.table import Table

from scanner_sim import Tracker, load_scenario
from scanner_sim.render.device import activate

CONFIG = Path(__file__).resolve().parents[1] / "configs" / "track_moving.yaml"
TICK = os.sysconf("SC_CLK_TCK")


def processor_time(process: int) -> float:
    """Return the processor time of a process and its threads so far [s]."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def asker(address: str) -> Any:
    """Return what sends a message and returns its answer."""
    socket = zmq.Context.instance().socket(zmq.REQ)
    socket.connect(address)

    def ask(command: str, **keys: Any) -> dict[str, Any]:
        socket.send(msgpack.packb({"protocol": 1, "command": command} | keys))
        answer: dict[str, Any] = msgpack.unpackb(socket.recv())
        assert answer["ok"], answer
        return answer

    return ask


def place(at: float) -> list[float]:
    """Return where the node is: it drifts, and shakes by a tenth of a millimetre."""
    return [-0.1 + 0.01 * at + 1e-4 * np.sin(50.0 * at), 0.1, 9.0]


def through_the_socket(visits: int, rounds: int, threads: int) -> dict[str, list[tuple[float, float, float]]]:
    """Return for each kind of work wall time, the server's processor time and the client's, of one round trip [s]."""
    found: dict[str, list[tuple[float, float, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        words = ["serve", str(CONFIG), "-q", "-o", f"{folder}/out", "--set", "scan.duration=600 s"]
        command = [sys.executable, "-m", "scanner_sim", *words, "--set", "output.pictures=false"]
        # Older checkouts know one thread only.
        command += [] if threads == 1 else ["--threads", str(threads)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            ask = asker(json.loads(server.stdout.readline())["address"])
            now = ask("open")["time"]
            for _ in range(3 * 8):
                now = ask("step")["time"]

            def state() -> dict[str, Any]:
                return {"object": "node", "position": place(now), "velocity": [0.01, 0.0, 0.0], "time": now}

            def moved() -> None:
                nonlocal now
                ask("move", **state())
                now = ask("step")["time"]

            def moved_at_once() -> None:
                nonlocal now
                now = ask("step", moves=[state()])["time"]

            for _ in range(rounds):
                works = {
                    "step alone": lambda: ask("step"),
                    "a message": lambda: ask("state"),
                    "move and step": moved,
                    "step with its move": moved_at_once,
                }
                for name, work in works.items():
                    now = ask("state")["time"]
                    begun = time.perf_counter(), processor_time(server.pid), time.process_time()
                    for _ in range(visits):
                        work()
                    ended = time.perf_counter(), processor_time(server.pid), time.process_time()
                    spent = [(b - a) / visits for a, b in zip(begun, ended, strict=True)]
                    found.setdefault(name, []).append((spent[0], spent[1], spent[2]))
            server.kill()
    return found


def in_one_process(visits: int, rounds: int, threads: int) -> list[tuple[float, float]]:
    """Return wall and processor time of a visit with a move before it, without a socket, in so many threads [s]."""
    activate("cpu", threads)
    tracker = Tracker(load_scenario(CONFIG, ["scan.duration=600 s"]))
    found, pose = [], np.eye(4)
    for _ in range(3 * 8):
        next(tracker)
    for _ in range(rounds):
        begun = time.perf_counter(), time.process_time()
        for _ in range(visits):
            now = tracker.time
            pose[:3, 3] = place(now)
            tracker.move("node", pose, velocity=(0.01, 0.0, 0.0), time=now)
            next(tracker)
        found.append(((time.perf_counter() - begun[0]) / visits, (time.process_time() - begun[1]) / visits))
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--visits", type=int, default=400)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    table = Table("what", "wall ms", "server CPU ms", "client CPU ms", "a second by wall")
    for threads in (1, 2):
        for name, rounds in through_the_socket(given.visits, given.rounds, threads).items():
            spent, best = 1e3 * np.median(rounds, axis=0), min(one[0] for one in rounds)
            what = f"{name}, threads: {threads}"
            table.add_row(what, *(f"{one:.3f}" for one in spent.tolist()), f"{1 / best:.0f}")
    for threads in (1, 2):
        rounds = in_one_process(given.visits, given.rounds, threads)
        wall, own = np.median(rounds, axis=0)
        name, best = f"move and step, no socket, threads: {threads}", min(one[0] for one in rounds)
        table.add_row(name, f"{1e3 * wall:.3f}", f"{1e3 * own:.3f}", "", f"{1 / best:.0f}")
    Console().print(table)


if __name__ == "__main__":
    main()
