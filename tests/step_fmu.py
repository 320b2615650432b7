"""Step a unit of FMI 2.0 with FMPy: a program of its own, since the unit brings its Python modules into the process."""

from __future__ import annotations

import shutil
import sys

STEP, STEPS, SPEED = 0.05, 12, 0.05


def place(time: float) -> dict[str, float]:
    """Return the state of the object and of the chaser: both drift along x, and the chaser half as fast."""
    return {
        "object_x": 1.0 + SPEED * time,
        "object_y": 0.1,
        "object_z": 9.0,
        "object_vx": SPEED,
        "chaser_x": 1.1 + 0.5 * SPEED * time,
        "chaser_vx": 0.5 * SPEED,
    }


def main(unit: str, address: str) -> None:
    """Print the outputs after the last step."""
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave

    description, folder = read_model_description(unit), extract(unit)
    number = {variable.name: variable.valueReference for variable in description.modelVariables}
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="scanner",
    )
    slave.instantiate()
    slave.setString([number["address"], number["object"]], [address, "node"])
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    for step in range(STEPS):
        given = place(step * STEP)
        slave.setReal([number[name] for name in given], list(given.values()))
        slave.doStep(currentCommunicationPoint=step * STEP, communicationStepSize=STEP)
    names = [
        one.name for one in description.modelVariables if one.causality == "output" and one.type == "Real"
    ]
    values = dict(zip(names, slave.getReal([number[name] for name in names]), strict=True))
    (values["status"], values["visits"]) = slave.getInteger([number["status"], number["visits"]])
    slave.terminate()
    slave.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)
    for name, value in ({"time": STEP * STEPS} | values).items():
        sys.stdout.write(f"{name}={value}\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
