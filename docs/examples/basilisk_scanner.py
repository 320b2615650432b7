"""A served scanner as a module of Basilisk, and an approach that is flown by it.

    scanner-sim serve configs/track_moving.yaml --set "scan.duration=60 s" --bind tcp://127.0.0.1:5555
    python docs/examples/basilisk_scanner.py tcp://127.0.0.1:5555

Needs Basilisk (the wheel bsk), NumPy, pyzmq and msgpack. Two spacecraft fly in one orbit; the scanner looks along the
chaser's third axis. Thrust follows from the scanner's messages alone: hold 9 m for three seconds, then approach.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from Basilisk.architecture import messaging, sysModel
from Basilisk.simulation import extForceTorque, spacecraft
from Basilisk.utilities import RigidBodyKinematics, SimulationBaseClass, macros, simIncludeGravBody
from client import Scanner
from frames import ahead, conjugate, relative, turned

SECOND = 1e-9
MASS = 500.0


class ScannerModule(sysModel.SysModel):
    """Reads the states of chaser and object, and publishes what the scanner says.

    In: ``chaserInMsg``, ``objectInMsg`` (SCStatesMsg), and if there is one ``eclipseInMsg`` (EclipseMsg: the share of
    the Sun's light). Out, with the scanner's axes in place of N: ``transOutMsg`` (NavTransMsg: position and velocity of
    the object), ``attOutMsg`` (NavAttMsg: attitude, rate of turn), ``poseOutMsg`` (OpNavMsg: the position with its
    covariance, and whether it holds), and for each target in ``targetOutMsgs`` an OpNavMsg of its measured place.
    """

    def __init__(self, address: str, name: str) -> None:
        super().__init__()
        self.ModelTag = "scanner"
        self.scanner, self.name = Scanner(address, self.ModelTag), name
        self.chaserInMsg, self.objectInMsg = messaging.SCStatesMsgReader(), messaging.SCStatesMsgReader()
        self.eclipseInMsg = messaging.EclipseMsgReader()
        self.transOutMsg, self.attOutMsg = messaging.NavTransMsg(), messaging.NavAttMsg()
        self.poseOutMsg = messaging.OpNavMsg()
        self.targetOutMsgs = {
            target["name"]: messaging.OpNavMsg() for target in self.scanner.about["targets"]
        }

    def Reset(self, CurrentSimNanos: int) -> None:  # noqa: ARG002 (Basilisk's signature)
        """Begin the filter anew."""
        self.scanner.filter(acceleration=1e-4)

    def UpdateState(self, CurrentSimNanos: int) -> None:
        """Tell where the object is now, make the visits up to now, and publish what is known."""
        now, clock = CurrentSimNanos * SECOND, self.scanner.state()["time"]
        while clock < now:
            answer = self.scanner.step()
            clock = answer["time"]
            for record in answer["records"]:
                self._publish_target(record, CurrentSimNanos)
            if answer["finished"]:
                raise RuntimeError("the scan is over: serve with a longer scan.duration")
        told = relative(_state(self.objectInMsg()), _state(self.chaserInMsg()))
        self.scanner.move(object=self.name, time=clock, **ahead(told, clock - now))
        if self.eclipseInMsg.isLinked():
            self.scanner.light(visible=self.eclipseInMsg().illuminationFactor, time=clock)
        self._publish_pose(self.scanner.pose(object=self.name, time=clock)["pose"], CurrentSimNanos)

    def _publish_target(self, record: dict[str, Any], nanos: int) -> None:
        said = messaging.OpNavMsgPayload()
        said.timeTag, said.valid = record["available"], int(record["status"] == 0)
        if said.valid:
            said.r_BN_C = record["point"]
            said.covar_C = np.ravel(record["point_covariance"]).tolist()
        self.targetOutMsgs[record["target"]].write(said, nanos, self.moduleID)

    def _publish_pose(self, pose: dict[str, Any], nanos: int) -> None:
        said = messaging.OpNavMsgPayload()
        said.timeTag, said.valid = pose["time"], int(pose["status"] == "following")
        if pose["status"] != "starting":
            said.r_BN_C = pose["position"]
            said.covar_C = np.array(pose["covariance"])[:3, :3].ravel().tolist()
            trans, attitude = messaging.NavTransMsgPayload(), messaging.NavAttMsgPayload()
            trans.timeTag = attitude.timeTag = pose["time"]
            trans.r_BN_N, trans.v_BN_N = pose["position"], pose["velocity"]
            attitude.sigma_BN = RigidBodyKinematics.EP2MRP(np.array(pose["quaternion"])).tolist()
            attitude.omega_BN_B = turned(conjugate(pose["quaternion"]), pose["turn_rate"]).tolist()
            self.transOutMsg.write(trans, nanos, self.moduleID)
            self.attOutMsg.write(attitude, nanos, self.moduleID)
        self.poseOutMsg.write(said, nanos, self.moduleID)


class Approach(sysModel.SysModel):
    """Thrust along inertial axes that holds the object at a place before the scanner, by the scanner's messages."""

    def __init__(self, scanner: ScannerModule, start: list[float], hold: float, speed: float) -> None:
        super().__init__()
        self.ModelTag = "approach"
        self.poseInMsg, self.transInMsg = (
            scanner.poseOutMsg.addSubscriber(),
            scanner.transOutMsg.addSubscriber(),
        )
        self.cmdForceOutMsg = messaging.CmdForceInertialMsg()
        self.start, self.hold, self.speed = np.array(start), hold, speed

    def UpdateState(self, CurrentSimNanos: int) -> None:
        """Command a force; none while nothing is known. The chaser's axes are those of the inertial frame here."""
        wanted = self.start - [0.0, 0.0, self.speed * max(CurrentSimNanos * SECOND - self.hold, 0.0)]
        force = np.zeros(3)
        if self.poseInMsg().valid:
            seen = self.transInMsg()
            force = MASS * (0.6 * (np.array(seen.r_BN_N) - wanted) + 1.2 * np.array(seen.v_BN_N))
        said = messaging.CmdForceInertialMsgPayload()
        said.forceRequestInertial = np.clip(force, -100.0, 100.0).tolist()
        self.cmdForceOutMsg.write(said, CurrentSimNanos, self.moduleID)


def _state(said: Any) -> tuple[Any, ...]:
    """Return a spacecraft's state as of :mod:`frames`: the Euler parameters of [BN] turn from B to N, actively."""
    quaternion = RigidBodyKinematics.MRP2EP(np.array(said.sigma_BN))
    return said.r_BN_N, quaternion, said.v_BN_N, turned(quaternion, said.omega_BN_B)


def _craft(name: str, position: list[float], velocity: list[float]) -> Any:
    craft = spacecraft.Spacecraft()
    craft.ModelTag = name
    craft.hub.mHub = MASS
    craft.hub.IHubPntBc_B = np.diag([100.0, 100.0, 100.0]).tolist()
    craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = position, velocity
    return craft


def fly(address: str, seconds: float = 8.0, name: str = "node") -> dict[str, list[float]]:
    """Fly, and return where the object was before the scanner at the end, truly and as it was seen, with σ [m].

    So its attitude (MRP): ``turn`` and ``seen_turn``.
    """
    simulation = SimulationBaseClass.SimBaseClass()
    simulation.CreateNewProcess("flight").addTask(simulation.CreateNewTask("task", macros.sec2nano(0.1)))
    orbit, place = np.array([7.0e6, 0.0, 0.0]), np.array([-0.1, 0.1, 9.0])
    speed = np.array([0.0, np.sqrt(3.986004415e14 / 7.0e6), 0.0])
    drift = np.array([0.02, 0.0, 0.0])
    chaser = _craft("chaser", orbit.tolist(), (speed + drift).tolist())
    port = _craft("port", (orbit + place).tolist(), speed.tolist())
    port.hub.sigma_BNInit, port.hub.omega_BN_BInit = [0.01, 0.02, 0.05], [0.0, 0.0, 0.02]
    gravity = simIncludeGravBody.gravBodyFactory()
    gravity.createEarth().isCentralBody = True
    for craft in (chaser, port):
        gravity.addBodiesTo(craft)
    scanner = ScannerModule(address, name)
    scanner.chaserInMsg.subscribeTo(chaser.scStateOutMsg)
    scanner.objectInMsg.subscribeTo(port.scStateOutMsg)
    control = Approach(scanner, place.tolist(), hold=3.0, speed=0.05)
    thrust = extForceTorque.ExtForceTorque()
    thrust.cmdForceInertialInMsg.subscribeTo(control.cmdForceOutMsg)
    chaser.addDynamicEffector(thrust)
    for number, model in enumerate((thrust, chaser, port, scanner, control)):
        simulation.AddModelToTask("task", model, 100 - number)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(seconds))
    simulation.ExecuteSimulation()
    seen, known, attitude = (
        one.read() for one in (scanner.transOutMsg, scanner.poseOutMsg, scanner.attOutMsg)
    )
    scanner.scanner.close(stop=True)
    truth = relative(_state(port.scStateOutMsg.read()), _state(chaser.scStateOutMsg.read()))
    sigma = np.sqrt(np.diag(np.reshape(known.covar_C, (3, 3))))
    turn = RigidBodyKinematics.EP2MRP(np.array(truth["quaternion"])).tolist()
    found = {"truth": truth["position"], "seen": list(seen.r_BN_N), "sigma": sigma.tolist()}
    return found | {"turn": turn, "seen_turn": list(attitude.sigma_BN)}


if __name__ == "__main__":
    for what, numbers in fly(*sys.argv[1:2], *map(float, sys.argv[2:3])).items():
        print(what, *(f"{number:.5f}" for number in numbers))
