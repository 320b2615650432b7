"""How verbs follow targets: what ends serving, what is left behind, what is drawn anew, and what a plan says."""

from __future__ import annotations

import contextlib
import math
import signal
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.cli import plan, serving, tracking
from scanner_sim.foundation.errors import InputError
from scanner_sim.tracking.record import TrackStatus

Told = Callable[[Any], list[Any]]


def test_signals_end_serving_after_the_visit_and_a_second_one_at_once() -> None:
    """Claim: the first signal is noted, and takes the handlers back that there were; so does the end without a
    signal."""
    came: list[int] = []
    before = {
        one: signal.signal(one, lambda number, _: came.append(number))
        for one in (signal.SIGINT, signal.SIGTERM)
    }
    own = {one: signal.getsignal(one) for one in before}
    try:
        with serving._ended_by_signals() as ended:
            assert {one: signal.getsignal(one) for one in before} != own
            assert not ended
            signal.raise_signal(signal.SIGTERM)
            assert ended == [signal.SIGTERM]
            assert not came
            signal.raise_signal(signal.SIGINT)
            assert came == [signal.SIGINT]
        with serving._ended_by_signals() as ended:
            assert not ended
        assert {one: signal.getsignal(one) for one in before} == own
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


def test_a_served_run_leaves_its_state_and_its_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Claim: a state that is there is taken only to go on from it or where overwriting was said; the folder is made
    with what the call says, and replaced by every later one."""
    asked: list[Any] = []
    monkeypatch.setattr(
        serving, "write_tracking", lambda *given, overwrite: (asked.append((*given, overwrite)), [Path("a")])
    )
    session: Any = SimpleNamespace(
        track="track", tracker=SimpleNamespace(save=lambda path: path.write_text("state"))
    )
    call: Any = SimpleNamespace(overwrite=False)
    state = tmp_path / "new" / "state.bin"
    files = serving._Files(call, "scenario", state, None)  # type: ignore[arg-type]
    assert files.save(session) == [str(state), "a"]
    assert state.read_text() == "state"
    assert files.write(session) == ["a"]
    assert asked == [("track", "scenario", call, False), ("track", "scenario", call, True)]
    with pytest.raises(InputError, match="exists"):
        serving._Files(call, "scenario", state, tmp_path / "other")  # type: ignore[arg-type]
    serving._Files(call, "scenario", state, state)  # type: ignore[arg-type]
    call.overwrite = True
    serving._Files(call, "scenario", state, None)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("ends", "size", "expected"),
    [
        ((-0.1, 0.3, -0.2, 0.0), (160, 320), (-0.1, 0.3, -0.2, 0.0)),
        ((-0.9, 0.3, -0.2, 0.1), (107, 320), (-0.6, 0.3, -0.2, 0.1)),
        ((0.1, 0.1 + 1e-6, 0.0, 0.4), (320, 2), (0.1, 0.1 + 1e-6, 0.0, 0.4)),
    ],
)
def test_the_image_behind_targets_holds_the_field_in_which_they_were(
    monkeypatch: pytest.MonkeyPatch,
    ends: tuple[float, ...],
    size: tuple[int, int],
    expected: tuple[float, ...],
) -> None:
    """Claim: 320 voxels along the longer side, as many by proportion along the other, two at least; not beyond what the
    mirrors reach; in the dark, with the scene at rest as it was at the last visit."""
    asked: list[Any] = []
    scene = SimpleNamespace(resting_at=lambda time: ("rest", time))
    scenario: Any = SimpleNamespace(
        scanner=SimpleNamespace(mirrors=SimpleNamespace(max_deflection=0.6)), scene=scene,
        model_copy=lambda update: update,
    )  # fmt: skip
    monkeypatch.setattr(
        "scanner_sim.instrument.simulate.simulate", lambda of, device: asked.append((of, device))
    )
    monkeypatch.setattr("scanner_sim.products.pictures.track.field_of", lambda _: ends)
    track: Any = SimpleNamespace(records=[SimpleNamespace(time=time) for time in (0.5, 2.5, 1.5)])
    tracking.backdrop_of(track, scenario, "cpu")
    ((changed, device),) = asked
    scan = changed["scan"]
    assert device == "cpu"
    assert (scan.rows, scan.columns, scan.motion) == (*size, "stepped")
    assert (*scan.horizontal, *scan.vertical) == pytest.approx(expected)
    assert changed["scene"] == ("rest", 2.5)
    assert changed["lighting"].sky().dark


@pytest.mark.parametrize(
    ("status", "kept", "number", "words"),
    [
        (TrackStatus.MEASURED, True, 7, None),
        (TrackStatus.MEASURED, True, 8, "no pattern 8"),
        (TrackStatus.OUT_OF_VIEW, False, 7, TrackStatus.OUT_OF_VIEW.sentence),
        (TrackStatus.MEASURED, False, 7, "output.patterns was off"),
    ],
)
@pytest.mark.parametrize("output", [None, Path("o")])
def test_one_pattern_of_a_run_is_shown(
    monkeypatch: pytest.MonkeyPatch, told: Told, status: TrackStatus, kept: bool, number: int, words: str | None,
    output: Path | None,
) -> None:  # fmt: skip
    lines = told(tracking)
    asked: list[Any] = []
    samples = SimpleNamespace(time=np.zeros((1, 9 if kept else 0)))
    record = SimpleNamespace(number=7, status=status, samples=samples)
    track: Any = SimpleNamespace(records=[SimpleNamespace(number=6), record])
    monkeypatch.setattr("scanner_sim.products.track.read_track", lambda _: track)
    monkeypatch.setattr(
        "scanner_sim.products.pictures.pattern.draw_pattern", lambda *given: asked.append(given)
    )
    monkeypatch.setattr(tracking, "rims_of", lambda of: ("rims", of))
    monkeypatch.setattr(tracking, "_numbers", lambda one: {"visit": str(one.number)})
    monkeypatch.setattr(
        tracking, "write_file", lambda path, write, overwrite: (write("p"), asked.append(overwrite), path)[2]
    )
    with pytest.raises(InputError, match=words) if words else contextlib.nullcontext() as fault:
        tracking.show_pattern(Path("r"), number, output, overwrite=False)
    if words:
        assert number == 7 or "the last is 7" in fault.value.remedy
        return
    assert asked == [(track, 7, "p", ("rims", track)), output is None]
    assert lines == [{"visit": "7", "picture": str((output or Path("r")) / "pattern_7.png")}]


def test_a_run_without_visits_has_no_last_pattern(monkeypatch: pytest.MonkeyPatch) -> None:
    track = SimpleNamespace(records=[])
    monkeypatch.setattr("scanner_sim.products.track.read_track", lambda _: track)
    with pytest.raises(InputError, match="no pattern 0") as fault:
        tracking.show_pattern(Path("r"), 0, None, overwrite=False)
    assert fault.value.remedy == "Patterns count from 0; this run visited nothing."


def test_a_plan_of_visits_says_what_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: how many targets, the first eight by name, patterns and voxels of each, how long one takes, and how many
    frames a camera takes beside them, where there is one; then how long the scan takes."""
    monkeypatch.setattr(plan, "patterns", lambda _: 12_345)
    monkeypatch.setattr(plan, "period", lambda _: 0.0625)
    following = SimpleNamespace(pattern=SimpleNamespace(points=512, ratio="3:2"), duration=9.0)
    scenario: Any = SimpleNamespace(
        following=following, targets=[SimpleNamespace(name=f"t{n}") for n in range(10)],
        pose=SimpleNamespace(methods=("uv", "camera")), scan_setup="setup",
        camera=SimpleNamespace(frame_times=lambda duration: range(int(1000 * duration))),
        scan=SimpleNamespace(layout="visits", scan_time=lambda setup: 9.25 if setup == "setup" else None),
    )  # fmt: skip
    found = plan._pointing(scenario)
    assert found == {
        "targets": "10: t0, t1, t2, t3, t4, t5, t6, t7 and 2 more", "patterns": "12,345 of 512 voxels, 3:2",
        "one takes": "62.5 ms on the instrument", "camera": "9,000 frames", "scan takes": "9.25 s on the instrument",
    }  # fmt: skip
    scenario.pose.methods, scenario.targets = ("uv",), scenario.targets[:8]
    found = plan._track(scenario)
    assert found["targets"] == "8: t0, t1, t2, t3, t4, t5, t6, t7"
    assert "camera" not in found
    for layout, word in (("image", "voxels"), ("shots", "shots")):
        scenario.scan = SimpleNamespace(
            layout=layout, summary="so many", horizontal=(math.radians(-3.0), 0.0), vertical=(0.0, math.radians(4.5)),
            scan_time=lambda _: 2.0,
        )  # fmt: skip
        assert plan._pointing(scenario) == {
            word: "so many", "field of view": "Θ -3° to 0°, φ 0° to 4.5°", "scan takes": "2 s on the instrument",
        }  # fmt: skip


@pytest.mark.parametrize(
    ("by_scanner", "methods", "objects"),
    [(True, ("uv",), 2), (False, ("camera",), 3), (True, ("uv", "camera"), 3)],
)
def test_files_of_a_track_are_counted_by_what_has_a_pose(
    monkeypatch: pytest.MonkeyPatch, by_scanner: bool, methods: tuple[str, ...], objects: int
) -> None:
    """Claim: as many objects as the scanner sees by their targets or the camera by their arrays, whichever are more."""
    asked: list[Any] = []
    monkeypatch.setattr(plan, "planned_track_files", lambda *given: asked.append(given) or ())
    monkeypatch.setattr(plan, "carriers_of", lambda targets: ["a", "b"] if targets == "targets" else None)
    monkeypatch.setattr(plan, "_frames", lambda _: 17)
    scenario: Any = SimpleNamespace(
        scan=SimpleNamespace(layout="visits"), output="output", targets="targets", arrays_followed=["x", "y", "z"],
        pose=SimpleNamespace(by_scanner=by_scanner, methods=methods), rangefinders=("tof",),
        processing=SimpleNamespace(calibration=None),
        lighting=SimpleNamespace(sky=lambda: SimpleNamespace(sun_visible=0.5)),
    )  # fmt: skip
    plan._files(scenario)
    assert asked == [("output", objects, 17)]
    monkeypatch.setattr(plan, "planned_files", lambda *given, **options: (given, options))
    monkeypatch.setattr(plan, "planned_shot_files", lambda *given, **options: (given, options))
    scenario.scan.layout = "image"
    lit = {"lit": True, "calibrated": False}
    assert plan._files(scenario) == (("output",), lit | {"rangefinders": ("tof",)})
    scenario.scan.layout, scenario.processing.calibration = "shots", "c.yaml"
    assert plan._files(scenario) == (("output",), lit | {"calibrated": True})
