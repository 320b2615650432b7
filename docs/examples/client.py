"""A controller outside of the simulator: NumPy, pyzmq and msgpack are all that it needs.

Start `scanner-sim serve configs/track_moving.yaml`, and then this with the address that it prints:

    python docs/examples/client.py tcp://127.0.0.1:5555

The node drifts; the controller brakes it by what the scanner sees, and prints the pose with its sigma.
"""

from __future__ import annotations

import sys
from typing import Any

import msgpack
import numpy as np
import zmq

PROTOCOL = 1


class RefusedError(Exception):
    """The server refused what was asked; it can be asked something else."""


class Scanner:
    """A served scanner: each command is a method, as scanner.step(visits=4)."""

    def __init__(self, address: str, name: str = "client", timeout: float = 60.0) -> None:
        self._context = zmq.Context()
        self._address, self._wait = address, int(1e3 * timeout)
        self._connect()
        self.about = self.ask("open", client=name)

    def _connect(self) -> None:
        self._socket = self._context.socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.connect(self._address)

    def ask(self, command: str, **content: Any) -> dict[str, Any]:
        """Send one message and return its answer."""
        message = {"protocol": PROTOCOL, "command": command} | content
        self._socket.send(msgpack.packb(message))
        if not self._socket.poll(self._wait):
            self._socket.close()  # a REQ socket cannot be asked again before it has its answer
            self._connect()
            raise TimeoutError(f"no answer from {self._address}")
        answer: dict[str, Any] = msgpack.unpackb(self._socket.recv())
        if not answer["ok"]:
            raise RefusedError("{message} {remedy}".format(**answer["error"]))
        return answer

    def __getattr__(self, command: str) -> Any:
        return lambda **content: self.ask(command, **content)

    def close(self, *, stop: bool = False) -> None:
        """Let go of the run; with stop the server writes its files and ends."""
        self.ask("close", stop=stop)
        self._socket.close()
        self._context.term()


def array(told: dict[str, Any]) -> np.ndarray:
    """Return an array of an answer: a layer of a raster, or what voxels hold."""
    return np.frombuffer(told["data"], told["dtype"]).reshape(told["shape"])


def main(address: str, visits: int = 200) -> None:
    """Brake an object for some visits, and look at it with a raster at the end."""
    scanner = Scanner(address)
    name = scanner.about["targets"][0]["object"]
    position, velocity, last = np.array([-0.1, 0.1, 9.0]), np.array([0.01, 0.0, 0.0]), 0.0
    for _ in range(visits):
        now = scanner.state()["time"]
        position, last = position + (now - last) * velocity, now
        known = scanner.pose(object=name)["pose"]
        if known["status"] == "following":
            change = -0.02 * np.array(known["velocity"])
            velocity = velocity + change
            scanner.push(object=name, velocity=change.tolist(), time=now)
        move = {"object": name, "position": position.tolist(), "velocity": velocity.tolist(), "time": now}
        if scanner.step(moves=[move])["finished"]:
            break
    known = scanner.pose(object=name)["pose"]
    sigma = np.sqrt(np.diag(known["covariance"]))
    print(f"{name} is {known['status']} at {known['time']:.3f} s")
    print("position", np.round(known["position"], 4), "±", np.round(sigma[:3], 4), "m")
    print("velocity", np.round(known["velocity"], 4), "±", np.round(sigma[6:9], 4), "m/s")
    seen = scanner.raster(rows=8, columns=8, horizontal=(-0.05, 0.05), vertical=(-0.05, 0.05))["raster"]
    print(f"raster: {np.isfinite(array(seen['layers']['range_m'])).sum()} of 64 voxels have a range")
    scanner.close(stop=True)


if __name__ == "__main__":
    main(*sys.argv[1:2], *map(int, sys.argv[2:3]))
