"""How honest the σ of one visit are: mean z² of Θ, φ and range by attitude, distance and light.

Run as ``python benchmarks/visits.py --attitudes 0,0 20,0 --distances 4 10 --light dark sunlit --boards 4``.

A board is a scene with its own seed: discs all over the field, each at its own direction and range (so that spots lie
anywhere on their pixels), each turned by pitch and yaw *about its own line of sight*. Visits to one disc share its
wobble and the place of its spot on the pixels, so that the discs are the independent samples: the standard error of
mean z² is that of the discs' means. Search visits, with larger patterns, are told apart from those that acquire and
track.

``--disc`` chooses the discs' material, ``retro_sheet`` for one; ``--spheres`` puts matt balls in their places.
``--set`` changes the instrument, to switch causes off in turn; ``quiet`` switches speckle, wobble, jitter, shot and
read noise and unlike pixels off.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim import Scenario, Tracker, load_scenario
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.tracking.record import PatternRecord, TrackStatus
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

SUN: dict[str, Any] = {"sun": {"direction": [-0.35, -0.45, -0.8]}}
SEPARATION = 0.05
FIELD = 0.35
"""Half of the field over which discs stand [rad], plates at 4 m side by side; nearer ones take turns."""
QUIET = (
    "scanner.laser.speckle=false",
    "scanner.mirrors.wobble=0 rad",
    "scanner.mirrors.jitter=0 rad",
    "scanner.position_sensor.noise.shot=false",
    "scanner.position_sensor.noise.read=false",
    "scanner.position_sensor.noise.prnu=false",
)


def board(
    pitch: float,
    yaw: float,
    distance: float,
    seed: int,
    *,
    side: int = 3,
    visits: int = 5,
    lit: bool = False,
    diameter: float = 0.1,
    disc: str | None = None,
    spheres: bool = False,
    overrides: tuple[str, ...] = (),
) -> Scenario:
    """Return a scenario with side² discs about a distance [m], turned by pitch and yaw [deg].

    They are black on white, or of a material, ``disc``, on black plates; or ``spheres`` before a wall.
    """
    draw = np.random.default_rng([seed, round(1e3 * distance)])
    most = FIELD
    step = 2.0 * most / side
    plate = min(max(0.4, 2.0 * diameter), 0.8 * step * distance)
    looks: dict[str, Any] = {"array": {"diameter": diameter, "plate": plate}}
    if disc is not None:
        looks |= {"disc": disc, "material": "black_paint"}
    if spheres:
        looks = {"shape": "sphere", "diameter": diameter, "material": {"reflectance": 0.8}}
    objects: list[dict[str, Any]] = []
    for row in range(side):
        for column in range(side):
            theta, phi = (
                -most + (place + 0.5) * step + draw.uniform(-0.1, 0.1) * step for place in (column, row)
            )
            reach = distance * (1.0 + draw.uniform(-0.03, 0.03))
            x, y, z = (float(part) for part in coordinates(reach, theta, phi, SEPARATION))
            turns = [("x", pitch), ("y", yaw + np.degrees(theta)), ("x", -np.degrees(phi))]
            rotation = [{"axis": axis, "angle": f"{angle} deg"} for axis, angle in turns]
            objects.append(
                {
                    "name": f"d{len(objects)}",
                    "position": [x, y, z],
                    "rotation": rotation,
                    **looks,
                }
            )
    scan = {
        "type": "track",
        "targets": [item["name"] for item in objects],
        "duration": side * side * visits * 10.03e-3,
    }
    if spheres:
        place, grey = [0.0, 0.0, 1.05 * distance + 1.0], {"reflectance": 0.5}
        objects.append(
            {"name": "wall", "shape": "rectangle", "size": [30.0, 30.0], "position": place, "material": grey}
        )
    whole = {"schema": 1, "seed": seed, "scene": {"objects": objects}, "scan": scan}
    return load_scenario(whole | ({"lighting": SUN} if lit else {}), overrides)


def squares(records: list[PatternRecord], modes: set[TrackMode]) -> tuple[Array, Array, Array]:
    """Return z of each measured visit in some modes (visits, 3), the number of its disc, and its σ (visits, 3)."""
    chosen = [r for r in records if r.mode in modes and r.status == TrackStatus.MEASURED]
    sigma = np.array([np.sqrt(np.diagonal(r.covariance)) for r in chosen]).reshape(-1, 3)
    error = np.array([r.position - r.truth for r in chosen]).reshape(-1, 3)
    return error / sigma, np.array([int(r.target[1:].split("/")[0]) for r in chosen]), sigma


def mean_square(z: Array, disc: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return mean z² and its standard error from the discs' means, each (3,)."""
    means = np.array([(z[disc == which] ** 2).mean(axis=0) for which in np.unique(disc)])
    return means.mean(axis=0), means.std(axis=0, ddof=1) / np.sqrt(len(means))


def told(name: str, z: Array, disc: NDArray[np.int64], sigma: Array, of: int) -> str:
    """Return a row: mean z² ± its standard error, mean z, largest |z| and median σ."""
    if len(np.unique(disc)) < 2:
        return f"{name:6s} {len(z)} of {of}"
    square, error = mean_square(z, disc)
    cells = "  ".join(f"{a:5.2f}±{b:4.2f}" for a, b in zip(square, error, strict=True))
    mean = " ".join(f"{value:5.2f}" for value in z.mean(axis=0))
    most = " ".join(f"{value:4.1f}" for value in np.abs(z).max(axis=0))
    a, b, c = np.median(sigma, axis=0) * (1e6, 1e6, 1e3)
    d, e, f = np.sqrt(((z * sigma) ** 2).mean(axis=0)) * (1e6, 1e6, 1e3)
    return (
        f"{name:6s} {len(z):4d}/{of:<4d} z² {cells} | z {mean} | max {most} | rms {d:5.1f} {e:5.1f} µrad {f:6.3f} mm"
        f" | σ {a:5.1f} {b:5.1f} {c:6.3f}"
    )


def main() -> None:
    """Print a row for each case."""
    asked = argparse.ArgumentParser()
    asked.add_argument("--attitudes", nargs="+", default=["0,0", "20,0", "40,0", "0,20", "0,40", "30,30"])
    asked.add_argument("--distances", nargs="+", type=float, default=[4.0, 10.0, 20.0])
    asked.add_argument("--light", nargs="+", default=["dark"], choices=["dark", "sunlit"])
    asked.add_argument("--boards", type=int, default=4)
    asked.add_argument("--visits", type=int, default=5)
    asked.add_argument("--side", type=int, default=3)
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--diameter", type=float, default=0.1)
    asked.add_argument("--disc", help="its material, on black plates, in place of black on white")
    asked.add_argument("--spheres", action="store_true", help="balls before a wall in place of discs")
    asked.add_argument("--set", nargs="*", default=[])
    given = asked.parse_args()
    overrides = tuple(item for asked in given.set for item in (QUIET if asked == "quiet" else (asked,)))
    for light in given.light:
        for distance in given.distances:
            for attitude in given.attitudes:
                pitch, yaw = map(float, attitude.split(","))
                begun = time.process_time()
                case(given, pitch, yaw, distance, light == "sunlit", overrides)
                print(f"       {time.process_time() - begun:.0f} s", flush=True)


def case(
    given: argparse.Namespace,
    pitch: float,
    yaw: float,
    distance: float,
    lit: bool,
    overrides: tuple[str, ...],
) -> None:
    """Run the boards of a case, and print its rows."""
    rows: dict[str, list[Any]] = {"search": [], "track": []}
    modes = {"search": {TrackMode.SEARCH, TrackMode.LOST}, "track": {TrackMode.ACQUIRE, TrackMode.TRACK}}
    of, refusals = dict.fromkeys(rows, 0), dict[str, int]()
    for index in range(given.boards):
        made = board(
            pitch, yaw, distance, given.seed + index, side=given.side, visits=given.visits, lit=lit,
            diameter=given.diameter, disc=given.disc, spheres=given.spheres, overrides=overrides,
        )  # fmt: skip
        records = list(Tracker(made, device="cpu", threads=1))
        for name, which in modes.items():
            z, disc, sigma = squares(records, which)
            rows[name].append((z, disc + 1000 * index, sigma))
            of[name] += sum(r.mode in which for r in records)
        for record in records:
            if record.status != TrackStatus.MEASURED:
                refusals[record.refusal.value] = refusals.get(record.refusal.value, 0) + 1
    print(f"{distance:g} m, pitch {pitch:g}°, yaw {yaw:g}°, {'sunlit' if lit else 'dark'}  {refusals or ''}")
    for name, found in rows.items():
        z, disc, sigma = (np.concatenate(parts) for parts in zip(*found, strict=True))
        print(told(name, z, disc, sigma, of[name]))


if __name__ == "__main__":
    main()
