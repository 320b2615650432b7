"""The verbs ``run`` and ``show`` for scenarios that follow targets."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scanner_sim.cli.call import Call, files_of
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import scenario_from_text
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop.every_pose import every_pose
from scanner_sim.instrument.closed_loop.poses import rims_of
from scanner_sim.instrument.memory import patterns
from scanner_sim.pose.beside import beside_camera
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.files.contents import POSES, RELATIVE_POSES
from scanner_sim.products.files.exchange import write_file, write_files
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.raster import RasterScan
from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus
from scanner_sim.tracking.state import TrackMode

if TYPE_CHECKING:
    from scanner_sim.products.image import RangeImage

_BACKDROP = 320
"""Voxels along the longer side of the image behind the targets."""


def run_tracking(scenario: Scenario, call: Call) -> Track:
    """Follow the targets of a scenario into a folder, and return what is in it.

    Raises
    ------
    ScannerSimError
        If the scene, the folder or the device cannot be used, or the disk fails.
    """
    from scanner_sim.instrument.closed_loop.track import track

    expected, visits = patterns(scenario), count(1)

    with call.work("tracking", "patterns") as (advance, say):

        def visited(_time: float, _duration: float) -> None:
            done = next(visits)
            advance(done, max(done, expected))

        made = track(scenario, device=call.device, progress=visited)
        poses, paths = write_tracking(
            made, scenario, call, overwrite=call.overwrite, say=say, progress=advance
        )
    call.warn(made.warnings)
    if not call.quiet:
        _print_closing(made, poses, paths)
    return made


def write_tracking(
    made: Track,
    scenario: Scenario,
    call: Call,
    *,
    overwrite: bool,
    say: Callable[[str], None] = lambda stage: None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[tuple[PoseSeries, ...], tuple[Path, ...]]:
    """Write the folder of a run, with its poses and pictures; return the poses and the files.

    Raises
    ------
    ScannerSimError
        If the scene, the folder or the device cannot be used, or the disk fails.
    """
    # Matplotlib takes long to load: after the work.
    from scanner_sim.products.files.frame_files import kept_frames
    from scanner_sim.products.files.track_folder import write_track

    say("taking the camera's frames" if "camera" in scenario.pose.methods else "estimating poses")
    with contextlib.ExitStack() as stack:
        frames = None
        if scenario.output.frames:
            frames = stack.enter_context(kept_frames(scenario.camera, call.output))
        keep = None if frames is None else frames.keep
        poses = every_pose(made, device=call.device, progress=progress, keep=keep)
        backdrop = None
        if scenario.output.pictures:
            say("drawing")
            backdrop = backdrop_of(made, scenario, call.device)
        paths = write_track(
            made,
            call.output,
            scenario.output,
            poses=poses,
            backdrop=backdrop,
            rim=rims_of(made),
            frames=frames,
            overwrite=overwrite,
        )
    return poses, paths


def show_track(result: Path, output: Path | None, *, device: DeviceChoice, overwrite: bool) -> None:
    """Draw the pictures of a tracking run anew.

    Raises
    ------
    InputError
        If there is no run, its scene can no longer be loaded, or the folder cannot be written to.
    """
    from scanner_sim.products.files.track_folder import pictures_of
    from scanner_sim.products.pose import read_poses
    from scanner_sim.products.track import read_track

    made = read_track(result)
    poses = [
        one
        for name in (POSES[1], RELATIVE_POSES[1])
        if (result / name).exists()
        for one in read_poses(result / name)
    ]
    scenario = scenario_from_text(made.scenario_yaml, name=str(result), stored=True)
    pictures = pictures_of(made, poses, backdrop_of(made, scenario, device), rims_of(made))
    paths = write_files(output or result, pictures, overwrite=overwrite or output is None)
    _print_closing(made, poses, paths)


def show_pattern(result: Path, number: int, output: Path | None, *, overwrite: bool) -> None:
    """Draw one pattern of a tracking run and print what was made of it.

    Raises
    ------
    InputError
        If there is no run or no such visit, its voxels were not kept, or the folder cannot be written to.
    """
    from scanner_sim.products.pictures.pattern import draw_pattern
    from scanner_sim.products.track import read_track

    made = read_track(result)
    record = next((record for record in made.records if record.number == number), None)
    if record is None:
        known = f"the last is {made.records[-1].number}" if made.records else "this run visited nothing"
        raise InputError(
            f"There is no pattern {number} in {result}.", remedy=f"Patterns count from 0; {known}."
        )
    if not record.samples.time.shape[1]:
        raise InputError(
            f"The voxels of pattern {number} were not kept: "
            + (
                record.status.sentence
                if record.status is TrackStatus.OUT_OF_VIEW
                else "output.patterns was off"
            )
            + ".",
            remedy="Run the folder's scenario.yaml with --set output.patterns=true, or name another pattern.",
        )
    path = write_file(
        (output or result) / f"pattern_{number}.png",
        lambda to: draw_pattern(made, number, to, rims_of(made)),
        overwrite=overwrite or output is None,
    )
    print_table(_numbers(record) | {"picture": str(path)})


def backdrop_of(track: Track, scenario: Scenario, device: DeviceChoice) -> RangeImage:
    """Return an image of the part of the field in which the targets were, at the run's last moment, in the dark."""
    from scanner_sim.instrument.simulate import simulate
    from scanner_sim.products.pictures.track import field_of

    limit = scenario.scanner.mirrors.max_deflection
    left, right, upper, lower = (min(max(end, -limit), limit) for end in field_of(track))
    step = max(right - left, lower - upper) / _BACKDROP
    scan = RasterScan(
        rows=max(round((lower - upper) / step), 2),
        columns=max(round((right - left) / step), 2),
        horizontal=(left, right),
        vertical=(upper, lower),
        motion="stepped",
    )
    last = max((record.time for record in track.records), default=0.0)
    changed = {"scan": scan, "lighting": Lighting(), "scene": scenario.scene.resting_at(last)}
    return simulate(scenario.model_copy(update=changed), device=device)


def _print_closing(track: Track, poses: Sequence[PoseSeries], paths: Sequence[Path]) -> None:
    """Print the summary of a run: targets, poses, files."""
    print_rows(_target_rows(track), left=(0, 1))
    if poses:
        print_rows(_pose_rows(poses), left=(0, 1))
    if any(one.method == "camera" for one in poses):
        print_rows(_beside_rows(poses), left=(0, 1))
    records = track.records
    rows = {"patterns": f"{len(records):,} of {len(track.targets)} targets"}
    if records:
        rows["time"] = f"{records[-1].time:.4g} s on the instrument"
    for code in TrackStatus:
        found = sum(record.status is code for record in records)
        if found:
            rows[code.name.lower().replace("_", " ")] = f"{found:,} ({code.sentence})"
    print_table(rows | files_of(paths))


def _target_rows(track: Track) -> list[list[str]]:
    """Return a line for each target: how often it was measured and, of the visits that followed it, σ and errors.

    A visit that searches has other patterns, and so another σ, than one that follows: the two are not put together.
    """
    from scanner_sim.products.track_summary import errors_of

    rows = [["target", "state", "measured", "followed"]]
    for name in ("σΘ µrad", "σφ µrad", "σR mm"):
        rows[0] += [name, "rms", "rms/σ"]
    for target in track.targets:
        records = track.of(target.name)
        followed = [record for record in records if record.mode is TrackMode.TRACK]
        error, sigma = errors_of(followed)
        row = [
            target.name,
            records[-1].after.value if records else "",
            f"{len(errors_of(records)[0])}/{len(records)}",
        ]
        row.append(str(len(error)))
        for axis, scale in enumerate((1e6, 1e6, 1e3)):
            if len(error):
                rms = [
                    float(np.sqrt(np.mean(one**2)))
                    for one in (error[:, axis], error[:, axis] / sigma[:, axis])
                ]
                row += [
                    f"{value:.3g}" for value in (scale * np.median(sigma[:, axis]), scale * rms[0], rms[1])
                ]
            else:
                row += [""] * 3
        rows.append(row)
    return rows


def _pose_rows(poses: Sequence[PoseSeries]) -> list[list[str]]:
    """Return a line for each series of poses: number of valid ones and the rms errors of its components."""
    rows = [["pose of", "method", "valid", "rms x mm", "y mm", "z mm", "ωx mrad", "ωy mrad", "ωz mrad"]]
    for one in poses:
        good = (one.status == PoseStatus.VALID) & np.isfinite(one.error).all(axis=1)
        valid = f"{np.count_nonzero(one.status == PoseStatus.VALID)}/{len(one.time)}"
        rms = 1e3 * np.sqrt(np.mean(one.error[good] ** 2, axis=0)) if good.any() else []
        rows.append([one.label, one.method, valid, *(f"{value:.3g}" for value in rms)])
        rows[-1] += [""] * (len(rows[0]) - len(rows[-1]))
    return rows


def _beside_rows(poses: Sequence[PoseSeries]) -> list[list[str]]:
    """Return a line for each series of the scanner beside the camera's: rms of their difference over its σ."""
    rows = [["scanner less camera", "method", "times", "rms/σ x", "y", "z", "ωx", "ωy", "ωz"]]
    for one in beside_camera(poses):
        rms = np.sqrt(np.mean((one.difference / one.sigma) ** 2, axis=0)) if len(one.time) else []
        rows.append([one.scanner.label, one.scanner.method, str(len(one.time)), *(f"{x:.3g}" for x in rms)])
        rows[-1] += [""] * (len(rows[0]) - len(rows[-1]))
    return rows


def _numbers(record: PatternRecord) -> dict[str, str]:
    """Return the numbers of a visit as pairs of a word and a phrase."""
    table = {
        "pattern": f"{record.number} over {record.target} at {record.time:.4f} s",
        "state": f"{record.mode.value}, then {record.after.value}",
        "status": f"{record.status.name}: {record.status.sentence}",
        "amplitude": f"{1e3 * record.amplitude:.3f} mrad",
        "voxels": f"{record.samples.time.shape[1]}, {int(record.samples.valid.sum())} with a range",
    }
    if np.isfinite(record.position).all():
        sigma = np.sqrt(np.diagonal(record.covariance))
        error = record.position - record.truth
        for axis, (name, unit, scale) in enumerate(
            (("Θ", "rad", 1e6), ("φ", "rad", 1e6), ("range", "m", 1e3))
        ):
            small = "mm" if unit == "m" else "µrad"
            table[name] = (
                f"{record.position[axis]:.6f} {unit} ± {scale * sigma[axis]:.3g} {small}, "
                f"true {record.truth[axis]:.6f} {unit}, error {scale * error[axis]:+.3g} {small}"
            )
    return table
