"""A process that opens inputs one after the other, for the fuzzer beside it, which sees how it ends.

It reads a line of JSON for each input, and writes one on what became of it. The limits on processor time and memory are
the operating system's, so that a kernel that never ends or asks for everything is seen too.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import resource
import shutil
import sys
import traceback
import unicodedata
import warnings
from pathlib import Path
from typing import Any

from open_results import open_result

from scanner_sim.cli.campaign import run_campaign
from scanner_sim.config import load_scenario, resolved_yaml, scenario_from_text, scenario_warnings
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import InputError, RunError, ScannerSimError
from scanner_sim.instrument.closed_loop.tracker import Tracker
from scanner_sim.scan.raster import RasterScan

MEMORY = 3 << 30
"""Bytes by which an input may let the address space grow."""
LONGEST = 20_000
"""Characters of a message."""
VISITS = 2
"""Patterns of a tracking run."""


def shrunk(scenario: Scenario) -> Scenario:
    """Return a scenario with all that only costs time made small: the code that runs is the same."""
    transport = scenario.transport
    few = {
        **{
            name: min(getattr(transport, name), 24)
            for name in ("uneven_beamlets", "edge_beamlets", "pattern_beamlets")
        },
        "bounces": min(transport.bounces, 3),
        "bounce_paths": min(transport.bounce_paths, 4),
        "background_bounces": min(transport.background_bounces, 3),
        "background_samples": 2,
    }
    changes: dict[str, Any] = {
        "transport": transport.model_copy(update=few),
        "camera": _few_pixels(scenario.camera),
    }
    scan = scenario.scan
    if isinstance(scan, RasterScan):
        rows, columns = min(scan.rows, 4), min(scan.columns, 4)
        kept = {
            name: chosen
            if isinstance(chosen := getattr(scenario.output, name), str)
            else tuple((row, column) for row, column in chosen[:2] if row < rows and column < columns)
            or "none"
            for name in ("lines", "waveforms")
        }
        changes["scan"] = scan.model_copy(update={"rows": rows, "columns": columns})
        changes["output"] = scenario.output.model_copy(update=kept)
    elif scan.layout == "visits":
        least = max(32, 8 * max(scan.pattern.cycles))
        points = min(scan.pattern.points, least)
        changes["scan"] = scan.model_copy(
            update={"pattern": scan.pattern.model_copy(update={"points": points})}
        )
    return scenario.model_copy(update=changes)


def _few_pixels(camera: VideoCamera) -> VideoCamera:
    """Return a camera of about the same field with some 16 pixels a row, and little light to each."""
    interior, sampling = camera.interior, camera.sampling
    coarser = max(1.0, interior.columns / 16.0)
    fewer = {
        "columns": max(1, round(interior.columns / coarser)),
        "rows": max(1, round(interior.rows / coarser)),
        "pixel_pitch": coarser * interior.pixel_pitch,
    }
    little = {"samples": 4, "edge_samples": 4, "bounces": min(sampling.bounces, 2)}
    return camera.model_copy(
        update={
            "interior": interior.model_copy(update=fewer),
            "sampling": sampling.model_copy(update=little),
        }
    )


def open_scenario(path: Path, overrides: list[str], *, thorough: bool, pictures: bool) -> None:
    """Do with a scenario what the verbs do with it: check and plan, and, thoroughly, read back, run small and write."""
    from scanner_sim.cli.plan import plan
    from scanner_sim.instrument.memory import check_memory

    scenario = load_scenario(path, overrides)
    scenario_warnings(scenario)
    text = resolved_yaml(scenario)
    plan(scenario, path.parent / "out")
    with contextlib.suppress(InputError):
        check_memory(scenario)
    if thorough:
        if resolved_yaml(scenario_from_text(text, name="the resolved scenario")) != text:
            raise AssertionError("the resolved scenario reads back as another one")
        _simulate(shrunk(scenario), path.parent / "out", pictures=pictures)


def _simulate(scenario: Scenario, folder: Path, *, pictures: bool) -> None:
    from scanner_sim.cli.plan import sunlit
    from scanner_sim.instrument.closed_loop.poses import poses_of
    from scanner_sim.instrument.photograph import take_photo
    from scanner_sim.instrument.shots import simulate_shots
    from scanner_sim.instrument.simulate import simulate
    from scanner_sim.instrument.simulate_signals import signal_parts
    from scanner_sim.products.files.run_folder import write_run
    from scanner_sim.products.files.shots_folder import write_shots
    from scanner_sim.products.files.track_folder import write_track

    output = scenario.output.model_copy(update={"pictures": pictures})
    if isinstance(scenario.scan, RasterScan):
        image = simulate(scenario, device="cpu", threads=1)
        camera = None
        lines, waveforms = (signal_parts(scenario, name, device="cpu") for name in ("triangulation", "tof"))
        if pictures and sunlit(scenario):
            camera = take_photo(scenario, device="cpu")
        write_run(image, folder, output, camera=camera, lines=lines, waveforms=waveforms)
        return
    if scenario.scan.layout == "shots":
        write_shots(simulate_shots(scenario, device="cpu", threads=1), folder, output)
        return
    tracker = Tracker(scenario, device="cpu", threads=1)
    records = tuple(record for record, _ in zip(tracker, range(VISITS), strict=False))
    found = tracker.track(records)
    write_track(found, folder, output, poses=poses_of(found))


def open_state(path: Path) -> None:
    """Go on with a saved tracking run; what is saved after that must be accepted too."""
    tracker = Tracker.resume(path, device="cpu", threads=1)
    for _, _ in zip(tracker, range(VISITS), strict=False):
        pass
    tracker.save(path.with_name("again.json"))
    Tracker.resume(path.with_name("again.json"), device="cpu", threads=1)


def open_plan(path: Path) -> None:
    """Do with a plan what ``campaign --dry-run`` does."""
    run_campaign(
        path,
        path.with_name("out"),
        workers=0,
        scheduler=None,
        measure=None,
        peak=None,
        pulse=None,
        dry_run=True,
        device="cpu",
        quiet=True,
    )


def said_badly(message: str) -> str:
    """Return what is wrong with a message as a user sees it; empty where nothing is."""
    if len(message) > LONGEST:
        return f"a message of {len(message)} characters"
    for letter in message:
        if unicodedata.category(letter) in ("Cc", "Cf", "Cs", "Zl", "Zp") and letter != "\n":
            return f"a message with the character {letter!r}"
    return "" if message.strip() else "an empty message"


def outcome(job: dict[str, Any]) -> dict[str, str]:
    """Return what became of an input: ``result``, ``refused``, ``failed`` or ``finding``, with a sentence."""
    path = Path(job["path"])
    try:
        if job["kind"] == "state":
            open_state(path)
        elif job["kind"] == "plan":
            with contextlib.redirect_stdout(io.StringIO()):
                open_plan(path)
        elif job["kind"] == "result":
            open_result(path, pictures=job["pictures"])
        else:
            open_scenario(path, job["overrides"], thorough=job["thorough"], pictures=job["pictures"])
    except ScannerSimError as error:
        if fault := said_badly(str(error)):
            return {"outcome": "finding", "what": f"{fault}: {str(error)[:200]!r}"}
        kind = {InputError: "refused", RunError: "failed"}
        return {
            "outcome": next(word for base, word in kind.items() if isinstance(error, base)),
            "what": str(error),
        }
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(frame.filename).name}:{frame.lineno}"
        trace = traceback.format_exc()
        return {
            "outcome": "finding",
            "what": f"{type(error).__name__} at {where}: {error!s:.200}",
            "trace": trace,
        }
    return {"outcome": "result", "what": ""}


def _limit(seconds: float) -> None:
    """Let the process use so much more processor time, and memory up to the limit."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    until = math.ceil(used.ru_utime + used.ru_stime + seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (until, resource.RLIM_INFINITY))


def main() -> None:
    """Answer inputs until the standard input ends."""
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    from scanner_sim.render.device import activate

    activate("cpu", threads=1)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    for line in sys.stdin:
        job = json.loads(line)
        _limit(job["seconds"])
        answers.write(json.dumps(outcome(job)) + "\n")
        answers.flush()
        with contextlib.suppress(OSError):
            shutil.rmtree(Path(job["path"]).parent / "out", ignore_errors=True)


if __name__ == "__main__":
    main()
