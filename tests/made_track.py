"""A track that a tracker might have made, without rendering one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from scanner_sim.config import load_scenario, resolved_yaml
from scanner_sim.ranging.axes import Axes
from scanner_sim.ranging.coordinates import angles_and_range, coordinates
from scanner_sim.scene.targets import target_positions
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.measurement import TargetAppearance
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus, TrackTarget
from scanner_sim.tracking.response import TargetKind
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import Refusal, TrackMode

DG, STEP, POINTS = 0.05, 0.01, 128
SIGMA = np.array([40e-6, 40e-6, 4e-3])
"""Of a made-up observation: Θ, φ [rad], R [m]."""


def array(name: str, x: float, rate: float) -> dict[str, object]:
    """Four targets that drift and turn."""
    return {
        "name": name,
        "array": {
            "diameter": "100 mm",
            "rows": 2,
            "columns": 2,
            "spacing": ["1 m", "1 m"],
            "plate": "200 mm",
        },
        "position": [f"{x} m", "0.2 m", "8 m"],
        "motion": {
            "type": "twist",
            "velocity": ["10 mm/s", "0 mm/s", "-5 mm/s"],
            "turn_rate": ["0 deg/s", f"{rate} deg/s", "0 deg/s"],
        },
    }


def make_track(seconds: float = 0.4, seed: int = 1, objects: int = 2) -> Track:
    """A run that a tracker might have made: known truth, made-up noise of known σ, one target acquired late."""
    random = np.random.default_rng(seed)
    scene = [array("node", -1.2, 1.0), array("z1", 1.2, -1.0)][:objects]
    names = [f"{item['name']}/{member}" for item in scene for member in range(1, 5)]
    scan = {"type": "track", "targets": names}
    scenario = load_scenario({"schema": 1, "scene": {"objects": scene}, "scan": scan})
    appearance = TargetAppearance(kind=TargetKind.BLACK, diameter=0.1, depth=0.3)
    centres = target_positions(2, 2, 1.0, 1.0)
    members = [(item, centre) for item in scenario.scene.objects for centre in centres]
    records = []
    for number in range(round(seconds / STEP)):
        which = number % len(names)
        item, centre = members[which]
        time = (number + 0.5) * STEP
        pose = item.pose_at(time)[0]
        point = pose[:3, :3] @ centre + pose[:3, 3]
        r, theta, phi = angles_and_range(*point, DG)
        truth = np.array([theta, phi, r])
        place = truth + SIGMA * random.standard_normal(3)
        late = which == 1 and number < 2 * len(names)
        found = not late
        blank = 0.0 if found else np.nan
        records.append(
            PatternRecord(
                number=number,
                target=names[which],
                time=time,
                mode=TrackMode.SEARCH if late else TrackMode.TRACK,
                after=TrackMode.SEARCH if late else TrackMode.TRACK,
                refusal=Refusal.NOT_SEEN if late else Refusal.NONE,
                status=TrackStatus.NOT_FOUND if late else TrackStatus.MEASURED,
                amplitude=30e-3 if late else 10e-3,
                centre=truth[:2] + 1e-4,
                position=place + blank,
                covariance=np.diag(SIGMA**2) + blank,
                errors=errors_of(blank),
                point=np.stack(coordinates(place[2], place[0], place[1], DG)) + blank,
                point_covariance=np.diag([1e-8, 2e-8, 1e-5]) + blank,
                truth=truth,
                truth_point=point,
                samples=pattern_of(truth, time, 30e-3 if late else 10e-3, random),
                available=time + 4e-3,
            )
        )
    targets = tuple(
        TrackTarget(
            name, name.split("/")[0], appearance, next(r.truth for r in records if r.target == name), centre
        )
        for name, (_, centre) in zip(names, members, strict=True)
    )
    return Track(
        records=tuple(records),
        targets=targets,
        seed=seed,
        scenario_yaml=resolved_yaml(scenario),
        made_by="scanner-sim 0",
        axes=Axes(DG),
        warnings=("A warning.",),
    )


def errors_of(blank: float) -> ErrorParts:
    """Every part, none as large as the next."""
    surface = np.diag([0.1, 0.2, 0.3]) * SIGMA**2
    surface[0, 1] = surface[1, 0] = 0.05 * SIGMA[0] * SIGMA[1]
    rest = replace(
        ErrorParts.all_white(np.zeros((3, 3))),
        surface=surface,
        turn=np.asarray(0.05),
        approach=np.asarray(0.2),
        pixels=np.asarray(0.4 * SIGMA[2] ** 2),
        image=np.asarray(44.0),
        image_width=np.asarray(0.9),
        wobble=np.asarray(0.01 * SIGMA[0] ** 2),
        wobble_time=np.asarray(0.05),
        wobble_angle=np.asarray(0.06),
        drift=np.array([0.1, 0.2]) * SIGMA[:2],
        common=np.array([[0.05, -0.02], [0.03, 0.04], [-0.06, 0.07]]) * SIGMA[:, None],
    )
    return replace(rest, white=np.diag(SIGMA**2) - rest.whole + blank)


def pattern_of(
    truth: np.ndarray, time: float, amplitude: float, random: np.random.Generator
) -> PatternSamples:
    """A 3:2 figure over a dark disc on a bright plate."""
    turn = 2.0 * np.pi * np.arange(1, POINTS + 1) / POINTS
    theta = truth[0] + 1e-4 + amplitude * np.sin(3.0 * turn)
    phi = truth[1] + 1e-4 + amplitude * np.sin(2.0 * turn)
    off = np.hypot(theta - truth[0], phi - truth[1]) > 0.05 / truth[2]
    signal = np.where(off, 8e5, 5e4) * (1.0 + 0.02 * random.standard_normal(POINTS))
    return PatternSamples(
        time=(time + 50e-6 * (np.arange(POINTS) - 63.5))[None],
        theta=theta[None],
        phi=phi[None],
        signal=signal[None],
        sigma_signal=np.sqrt(signal)[None],
        range=(truth[2] + 0.01 * random.standard_normal(POINTS))[None],
        sigma_range=np.full((1, POINTS), 0.01),
        status=np.zeros((1, POINTS), dtype=np.uint8),
    )


def placed(axes: Axes, r: np.ndarray, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return points (n, 3) [m] of shots (n,): what the first mirror sends to (R sinΘ, 0, R cosΘ) is turned by φ about
    the second axis, by SciPy's rotation."""
    middle = np.array([0.0, axes.offset, axes.separation])
    along = np.array([math.cos(axes.skew), math.sin(axes.skew), 0.0])
    flat = np.stack([r * np.sin(theta), 0.0 * r, r * np.cos(theta)], axis=1)
    return np.asarray(middle + Rotation.from_rotvec(-phi[:, None] * along).apply(flat - middle))
