"""How exact the light transport is: beamlets against brute force, case by case.

Run as ``python benchmarks/accuracy.py [--rays N] [--travel MRAD]``. Each shot is compared with N random rays (default
2²²);
the reference's own noise is in the figures: about 0.0008 pixel and 5e-5 of the energy.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from scanner_sim.config.scanner import Scanner
from scanner_sim.render.device import activate
from scanner_sim.render.settings import Transport
from scanner_sim.scene.objects import Scene

PIXELS = 256
GREY = {"reflectance": 0.5}


def wall(distance: float, axis: Any = "y", degrees: float = 0.0, **changes: Any) -> dict[str, Any]:
    turn = {"axis": axis, "angle": float(np.deg2rad(degrees))}
    place = {"position": (0.0, 0.0, distance), "rotation": turn, "size": (40.0, 40.0), "material": GREY}
    return {"name": "wall", "shape": "rectangle", **place, **changes}


def half(side: float, distance: float, **changes: Any) -> dict[str, Any]:
    return wall(distance, position=(2.0 * side, 0.0, distance), size=(4.0, 8.0), **changes)


SMOOTH: dict[str, tuple[list[dict[str, Any]], float]] = {
    "plane at 2 m": ([wall(2.0)], 0.3),
    "plane at 10 m": ([wall(10.0)], 0.4),
    "tilted 60° about y, 3 m": ([wall(3.0, "y", 60.0)], 0.08),
    "tilted 60° about x, 3 m": ([wall(3.0, "x", 60.0)], 0.08),
    "tilted 60° askew, 2.2 m": ([wall(2.2, (1.0, 1.0, 0.0), 60.0)], 0.04),
    "sphere of 200 mm, 3 m": (
        [{"name": "ball", "shape": "sphere", "diameter": 0.2, "position": (0, 0, 3.0), "material": GREY}],
        0.025,
    ),
    "tube of 35 mm, 3 m": (
        [
            {
                "name": "tube",
                "shape": "cylinder",
                "diameter": 0.035,
                "length": 3.0,
                "position": (0, 0, 3.0),
                "material": GREY,
            }
        ],
        0.004,
    ),
    "aluminised Kapton, 3 m": ([wall(3.0, "y", -6.0, material="aluminised_kapton")], 0.08),
}
EDGES: dict[str, list[dict[str, Any]]] = {
    f"{kind} edge, {distance:g} m": scene
    for distance in (2.5, 5.0, 10.0)
    for kind, scene in (
        (
            "material",
            [
                half(1.0, distance, material={"reflectance": 0.9}),
                half(-1.0, distance, name="dark", material={"reflectance": 0.05}),
            ],
        ),
        ("depth", [half(1.0, distance), wall(1.1 * distance, name="behind")]),
    )
}


def lines(objects: list[dict[str, Any]], theta: Any, phi: Any, rays: int, travel: float) -> tuple[Any, Any]:
    """Return the lines [W], shape (shots, pixels), by beamlets and by brute force, swept by ``travel`` in Θ [rad]."""
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.render.background.reference import reference_line
    from scanner_sim.render.beam.line_projection import LineProjection
    from scanner_sim.render.beam.splitter import render_light
    from scanner_sim.render.shots import Shots
    from scanner_sim.render.transport import OpticalLayout
    from scanner_sim.scene.files.loader import load_scene

    scanner = Scanner()
    sensor, separation = scanner.position_sensor, scanner.mirrors.axis_separation
    bench = OpticalLayout(
        scanner.laser,
        scanner.receiver,
        separation,
        1.0,
        sensor.pitch,
        sensor.height,
        sensor.offset,
        sensor.diffusion,
    )
    loaded = load_scene(Scene(objects=tuple(objects)))
    theta, phi = theta.astype(np.float32), phi.astype(np.float32)
    swept = dr.full(mi.Float, travel, len(theta))
    shots = Shots(dr.arange(mi.UInt32, len(theta)), mi.Float(theta), mi.Float(phi), swept)
    beamlets = np.zeros((len(theta), PIXELS))
    for light in render_light(loaded, LineProjection(bench), Transport(), shots, 0)[1]:
        for place, index in enumerate(light.index.numpy()):
            beamlets[index] = light.line(place, PIXELS)
    random = [
        reference_line(
            loaded, bench, PIXELS, float(t), float(p), travel=(travel, 0.0), rays=rays, shot=number
        ).power
        for number, (t, p) in enumerate(zip(theta, phi, strict=True))
    ]
    return beamlets, np.array(random)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--rays", type=int, default=1 << 22, help="random rays of each shot")
    arguments.add_argument("--travel", type=float, default=1.0, help="sweep of Θ in the dwell [mrad]")
    chosen = arguments.parse_args()
    rays, travel = chosen.rays, 1e-3 * chosen.travel
    activate("cpu")
    random = np.random.default_rng(1)
    table = Table("smooth surface", "spot, rms [pixel]", "spot, mean [pixel]", "energy, largest")
    for name, (objects, span) in SMOOTH.items():
        ours, reference = lines(objects, *random.uniform(-span, span, (2, 12)), rays, travel)
        apart = [(line * np.arange(PIXELS)).sum(axis=1) / line.sum(axis=1) for line in (ours, reference)]
        difference = apart[0] - apart[1]
        energy = np.abs(ours.sum(axis=1) / reference.sum(axis=1) - 1.0).max()
        table.add_row(
            name, f"{np.sqrt(np.mean(difference**2)):.5f}", f"{difference.mean():+.5f}", f"{energy:.1e}"
        )
    Console().print(table)
    table = Table("edge", "light over contrast: mean", "rms", "largest", title="24 shots across each edge")
    for name, objects in EDGES.items():
        reach = 0.004 + 0.5 * travel
        theta, phi = np.linspace(-reach, reach, 24), random.uniform(-0.02, 0.02, 24)
        ours, reference = lines(objects, theta, phi, rays, travel)
        error = (ours.sum(axis=1) - reference.sum(axis=1)) / np.ptp(reference.sum(axis=1))
        table.add_row(name, f"{error.mean():+.5f}", f"{error.std():.5f}", f"{np.abs(error).max():.5f}")
    Console().print(table)


if __name__ == "__main__":
    main()
