"""The verb ``run``."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from scanner_sim.cli.plan import check_memory, plan, sunlit
from scanner_sim.cli.report import scenario_of, warn
from scanner_sim.cli.tables import print_table
from scanner_sim.config import doubts, load_scenario
from scanner_sim.products.folder import check_target, write_run
from scanner_sim.products.image import RangeImage
from scanner_sim.render.device import DeviceChoice
from scanner_sim.status import Status


def run_scenario(
    config: Path,
    folder: Path,
    overrides: Sequence[str],
    *,
    device: DeviceChoice,
    dry_run: bool,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Simulate a scenario into a folder, with everything that can be refused refused before the work.

    Raises
    ------
    ScannerSimError
        If the scenario, the folder or the device cannot be used, or the disk fails.
    """
    scenario = load_scenario(config, overrides)
    suspicions = doubts(scenario)
    if not quiet:
        for sentence in suspicions:
            warn(sentence)
    check_target(folder, overwrite)
    if dry_run:
        print_table(plan(scenario, folder))
        return
    check_memory(scenario)
    # Loads the renderer: only after everything that can be refused without it.
    from scanner_sim.photo import take_photo
    from scanner_sim.simulate import simulate, simulate_waveforms

    camera = waveforms = None
    with _progress(quiet) as (advance, say):
        with scenario_of(config):
            image = simulate(scenario, device=device, progress=advance)
            if scenario.output.pictures and sunlit(scenario):
                say("taking the photograph")
                camera = take_photo(scenario, device=device)
            if (chosen := scenario.output.waveforms) != "none":
                say("recording waveforms")
                waveforms = simulate_waveforms(scenario, None if chosen == "all" else chosen, device=device)
        say("writing")
        paths = write_run(
            image, folder, scenario.output, camera=camera, waveforms=waveforms, overwrite=overwrite
        )
    if not quiet:
        for sentence in image.warnings:
            warn(sentence)
        print_table(closing(image, paths))


def closing(image: RangeImage, paths: Sequence[Path]) -> dict[str, str]:
    """Return the summary of a run as pairs of a word and a phrase."""
    valid = image.valid
    rows = {
        "voxels": f"{image.shape[0]} × {image.shape[1]}",
        "with a range": f"{np.count_nonzero(valid):,} ({100.0 * valid.mean():.4g} %)",
    }
    if valid.any():
        ranges, sigmas = image["range_m"][valid], image["sigma_range_m"][valid]
        rows["range"] = f"{np.median(ranges):.4g} m median, {ranges.min():.4g} m to {ranges.max():.4g} m"
        rows["σ of the range"] = f"{1e3 * float(np.median(sigmas)):.3g} mm median"
    for way, name in (("time of flight", "tof."), ("both together", "fused.")):
        if "fused.range_m" in image and (image[f"{name}status"] == 0).any():
            sigma = np.nanmedian(image[f"{name}sigma_range_m"])
            rows[f"σ of {way}"] = f"{1e3 * float(sigma):.3g} mm median"
    for code in Status:
        count = np.count_nonzero(image["status"] == code)
        if count and code is not Status.VALID:
            rows[code.name.lower().replace("_", " ")] = f"{count:,} ({code.sentence})"
    rows["folder"] = str(paths[0].parent)
    rows["files"] = ", ".join(path.name for path in paths)
    return rows


@contextlib.contextmanager
def _progress(quiet: bool) -> Iterator[tuple[Callable[[int, int], None], Callable[[str], None]]]:
    """Show a bar with rate and time left on a terminal, and nothing in a pipe.

    Gives two functions: one that takes the shots done and the shots in all, and one that says what is done now.
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield (lambda done, total: None), (lambda stage: None)
        return
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        Task,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        """Voxels per second."""

        def render(self, task: Task) -> Text:
            return Text("" if task.speed is None else f"{task.speed / 1e3:.0f} k voxels/s")

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        Rate(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=None)

        def advance(done: int, total: int) -> None:
            bar.update(task, description="simulating", completed=done, total=total)

        def say(stage: str) -> None:
            bar.update(task, description=stage)

        yield advance, say
