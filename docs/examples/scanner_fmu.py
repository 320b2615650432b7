"""A served scanner as a co-simulation unit of FMI 2.0: a thin client, built with pythonfmu.

    pythonfmu build -f docs/examples/scanner_fmu.py docs/examples/client.py docs/examples/frames.py

The unit holds these three files and pythonfmu's library; where it is loaded a Python with NumPy, pyzmq and msgpack must
be found. Inputs are the states of the object and of the chaser in one frame, and the Sun's direction; outputs are the
pose of the object in the scanner's frame, its covariance and status. A step tells the state at its beginning, makes
the visits that begin within it, and gives the pose at its end.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from client import Scanner
from frames import ahead, conjugate, relative, turned
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String

STATUS = {"starting": 0, "following": 1, "coasting": 2}
BODY = ("x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz")


class ScannerUnit(Fmi2Slave):
    """A scanner that sits on a chaser, and what it says of one object.

    Inputs: ``object_x`` to ``object_wz``, ``chaser_x`` to ``chaser_wz``, and ``sun_x``, ``sun_y``, ``sun_z``,
    ``sun_visible``, which are told only where the Sun has a direction.

    Outputs: ``pose_x`` to ``pose_wz``; ``covariance_1_1`` to ``covariance_6_6``, the upper triangle of that of
    (δt [m], δω [rad]); ``status``, 0 starting, 1 following, 2 coasting; ``surprise``; ``range`` and ``sigma_range`` [m]
    of the last visit; ``visits``.
    """

    description = "Auto-synchronised laser scanner that a scanner-sim server simulates"

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.address, self.object = "tcp://127.0.0.1:5555", "node"
        for name in ("address", "object"):
            self.register_variable(
                String(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed)
            )
        self.values = dict.fromkeys((f"{who}_{part}" for who in ("object", "chaser") for part in BODY), 0.0)
        self.values |= {"object_qw": 1.0, "chaser_qw": 1.0, "object_z": 10.0, "sun_visible": 1.0}
        self.values |= dict.fromkeys(("sun_x", "sun_y", "sun_z"), 0.0)
        inputs = list(self.values)
        self.corners = [(i, j) for i in range(6) for j in range(i, 6)]
        outputs = [f"pose_{part}" for part in BODY]
        outputs += [f"covariance_{i + 1}_{j + 1}" for i, j in self.corners]
        outputs += ["surprise", "range", "sigma_range"]
        self.values |= dict.fromkeys(outputs, 0.0)
        for name in (*inputs, *outputs):
            self._number(name, Fmi2Causality.input if name in inputs else Fmi2Causality.output)
        self.status, self.visits, self.scanner = 0, 0, None
        for name in ("status", "visits"):
            self.register_variable(
                Integer(name, causality=Fmi2Causality.output, variability=Fmi2Variability.discrete)
            )

    def _number(self, name: str, causality: Fmi2Causality) -> None:
        self.register_variable(
            Real(
                name,
                causality=causality,
                getter=lambda: self.values[name],
                setter=lambda value: self.values.update({name: value}),
            )
        )

    def _state(self, who: str) -> tuple[list[float], ...]:
        numbers = [self.values[f"{who}_{part}"] for part in BODY]
        return numbers[:3], numbers[3:7], numbers[7:10], numbers[10:]

    def exit_initialization_mode(self) -> None:
        """Take hold of the run."""
        self.scanner = Scanner(self.address, self.instance_name)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Tell, visit, and ask for the pose."""
        scanner, chaser = self.scanner, self._state("chaser")
        clock, end = scanner.state()["time"], current_time + step_size
        told = relative(self._state("object"), chaser)
        scanner.move(object=self.object, time=clock, **ahead(told, clock - current_time))
        sun = [self.values[f"sun_{axis}"] for axis in "xyz"]
        if any(sun):
            towards = turned(conjugate(chaser[1]), sun).tolist()
            scanner.light(sun=towards, visible=self.values["sun_visible"], time=clock)
        last = 0.0
        while clock < end:
            answer = scanner.step()
            if not answer["records"]:
                return False
            (record,), clock = answer["records"], answer["time"]
            last, self.visits = record["time"], self.visits + 1
            if record["status"] == 0:
                self.values |= {"range": record["range"], "sigma_range": record["sigma_range"]}
        self._take(scanner.pose(object=self.object, time=max(end, last))["pose"])
        return True

    def _take(self, pose: dict[str, Any]) -> None:
        self.status = STATUS[pose["status"]]
        if self.status == 0:
            return
        numbers = [*pose["position"], *pose["quaternion"], *pose["velocity"], *pose["turn_rate"]]
        self.values |= {f"pose_{part}": value for part, value in zip(BODY, numbers, strict=True)}
        spread = np.array(pose["covariance"])
        self.values |= {f"covariance_{i + 1}_{j + 1}": float(spread[i, j]) for i, j in self.corners}
        self.values["surprise"] = float(np.nan_to_num(pose["surprise"]))

    def terminate(self) -> None:
        """Let go of the run."""
        if self.scanner is not None:
            self.scanner.close()
