"""Which part of the background a pattern is given, and of what moment."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections import OrderedDict
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.instrument import background_rows
from scanner_sim.instrument.closed_loop import frozen_instrument as frozen_room
from scanner_sim.instrument.closed_loop import windows as windows_room
from scanner_sim.instrument.closed_loop.situation import Situation
from scanner_sim.instrument.closed_loop.windows import Windows, _span
from scanner_sim.instrument.time_slots import TimeSlots, angles_moved
from scanner_sim.instrument.triangulation import Triangulation
from scanner_sim.optics.line_image import sharp_everywhere
from scanner_sim.render.device import Device
from scanner_sim.render.settings import Transport
from scanner_sim.scan.protocol import Aim
from scanner_sim.scene.light.lighting import Sky

Array = NDArray[np.float64]

FOCAL, PITCH, HEIGHT, OFFSET, PIXELS = 0.1, 50e-6, 250e-6, 5e-3, 400


class Steady(TimeSlots):
    """The slots of what moves by so many bins a second as it says."""

    def _speed(self, *_: Any) -> float:
        return max(item.bins for item in self.items) * self._step  # type: ignore[attr-defined]


class Recorded(Windows):
    """Windows of a scene with one body that turns, which note what they were asked to render."""

    asked: tuple[Any, float]

    def _renderer(self, *_: int) -> Any:
        def render(reads: Any, light: Any, place: Any, poses: Any, seed: Any) -> list[Any]:
            self.asked = place, float(poses[0].position.x.numpy()[0])
            return []

        return render

    def _light(self, sky: Any) -> Any:
        return sky


class Clock:
    """An object whose place tells the time, and which moves by some bins a second."""

    def __init__(self, bins: float = 3.0) -> None:
        self.bins = bins

    def pose_at(self, time: float) -> Array:
        pose = np.eye(4)[None].copy()
        pose[0, 0, 3] = time
        return pose


ITEMS: Any = (Clock(),)
HERE = Situation(ITEMS, ITEMS, Sky())


@pytest.fixture
def windows(device: Device) -> Recorded:
    """Those of a line of 400 pixels of 50 µm behind 0.1 m, from 5 mm beside the axis on."""
    optics = SimpleNamespace(
        pitch=PITCH,
        height=HEIGHT,
        offset=OFFSET,
        receiver=SimpleNamespace(focal_length=FOCAL, line_image=sharp_everywhere(FOCAL)),
    )
    body = SimpleNamespace(mitsuba=None, item=ITEMS[0])
    loaded = SimpleNamespace(
        mitsuba=None,
        bodies=(body,),
        object_of=None,
        material_of=None,
        out_of_band_ratio=None,
        dark_in_band=None,
    )
    sensor = SimpleNamespace(pixels=PIXELS)
    scenario = SimpleNamespace(scanner=SimpleNamespace(position_sensor=sensor), seed=0, transport=Transport())
    line = object.__new__(Triangulation)
    line.optics, line.scenario = optics, scenario  # type: ignore[assignment]
    made = Recorded(SimpleNamespace(scenario=scenario, loaded=loaded), *line.sight)  # type: ignore[arg-type]
    slots = Steady(loaded, made.step, ITEMS)  # type: ignore[arg-type]
    made.__dict__ |= {"_heights": None, "_slots": slots}
    return made


def aim(time: float = 0.0) -> Aim:
    """Five shots about (0.11, -0.04), whose mirrors move by 2 mrad in a dwell."""
    phase = np.linspace(0.0, 2.0 * np.pi, 5)
    moved = np.full(5, 2e-3)
    return Aim(
        np.arange(5, dtype=np.uint32),
        0.11 + 0.01 * np.cos(phase),
        -0.04 + 0.02 * np.sin(phase),
        np.full(5, time),
        moved,
        moved,
    )


@pytest.mark.parametrize(("low", "high"), [(0.31, 0.52), (-0.2, 0.017), (0.0, 0.0), (-0.080, -0.078)])
def test_a_span_has_a_step_more_at_each_end_and_little_beyond(low: float, high: float) -> None:
    """Claim: from a multiple of 8 steps, a multiple of 64 many; at least one beyond each end, at most 8 + 1 before, and
    at most 64 + 2 after."""
    first, count = _span(low, high, 1e-3, 8, 64)
    assert (first % 8, count % 64) == (0, 0)
    assert 1.0 <= low / 1e-3 - first <= 9.0
    assert 1.0 <= first + count - 1 - high / 1e-3 <= 66.0


def test_a_window_holds_all_that_the_pixels_see(windows: Recorded) -> None:
    """Claim: Θ − atan(p/f) of the first pixel at the leftmost and the last at the rightmost shot, with half a dwell's
    travel, and the same for φ, lie within the first and last bins and rows; 67 bins and 18 rows too many at most."""
    windows.layers(windows.key(aim(), HERE))
    (first, top), _ = windows.asked
    _, bins, _, rows, *_ = windows.key(aim(), HERE)
    left = 0.10 - 1e-3 - math.atan((OFFSET + PIXELS * PITCH) / FOCAL)
    right = 0.12 + 1e-3 - math.atan(OFFSET / FOCAL)
    step, row = PITCH / FOCAL, 0.5 * HEIGHT / FOCAL
    start, end = float(first.numpy()[0]), float(first.numpy()[0]) + (bins - 1) * step
    assert left - 9.0 * step <= start <= left - 0.99 * step
    assert right + 0.99 * step <= end <= right + 67.0 * step
    start = float(top.numpy()[0])
    assert -0.06 - 1e-3 - 2.0 * row <= start <= -0.06 - 1e-3 - 0.99 * row
    assert -0.02 + 1e-3 + 0.99 * row <= start + (rows - 1) * row <= -0.02 + 1e-3 + 18.0 * row


@pytest.mark.parametrize(("time", "middle"), [(0.0, 0.125), (0.3, 0.375), (2.99, 2.875), (300.3, 300.375)])
def test_objects_stand_as_in_the_middle_of_the_slot(windows: Recorded, time: float, middle: float) -> None:
    """Claim: what moves by 3 bins a second has slots of 1/4 s, the longest power of two in which it moves by less than
    a bin, and is where it is in their middles."""
    windows.layers(windows.key(aim(time), HERE))
    assert windows.asked[1] == pytest.approx(middle)


@pytest.mark.parametrize(
    ("lasts", "pace", "middle"),
    [((0.2, 0.29), 3.0, 0.125), ((0.22, 0.31), 3.0, 0.375), ((0.2, 0.298), 0.3, 0.125)],
)
def test_the_slot_is_that_of_a_patterns_middle(
    windows: Recorded, lasts: tuple[float, float], pace: float, middle: float
) -> None:
    """Claim: of a pattern over the end of a slot it is the slot that holds more of it, from the first shot on, however
    its shots are spread over its time."""
    shots = dataclasses.replace(
        aim(), time=lasts[0] + (lasts[1] - lasts[0]) * np.linspace(0.0, 1.0, 5) ** pace
    )
    windows.layers(windows.key(shots, HERE))
    assert windows.asked[1] == pytest.approx(middle)


def test_the_next_pattern_of_a_slot_is_not_rendered_again(windows: Recorded) -> None:
    for time in (0.01, 0.2, 0.26, 0.1):
        windows.layers(windows.key(aim(time), HERE))
    assert windows.rendered == 2


def test_another_sky_or_another_place_is_rendered_anew_and_the_same_is_not(windows: Recorded) -> None:
    """Claim: a window belongs to its poses and its sky, and to nothing else of a situation."""
    windows.layers(windows.key(aim(), HERE))
    windows.layers(windows.key(aim(), Situation((), ITEMS, HERE.sky)))
    assert windows.rendered == 1
    windows.layers(windows.key(aim(), Situation(ITEMS, ITEMS, Sky())))
    assert windows.rendered == 2


def test_corners_move_by_the_angle_at_the_scanner() -> None:
    """Claim: a corner at (1, 0, 0) of a frame 5 m away that turns by 90° about z goes from (1, 0, 5) to (0, 2, 5) if
    the frame moves by 1 m along y meanwhile: √5 m at a distance of √29 m."""
    before, after = np.tile(np.eye(4), (2, 1, 1, 1))
    before[0, 2, 3] = 5.0
    after[0] = [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 5.0], [0.0, 0.0, 0.0, 1.0]]
    corners = np.zeros((3, 8))
    corners[0, 0] = 1.0
    moved = angles_moved(corners, before, after)
    assert moved.shape == (1, 8)
    assert moved[0, 0] == pytest.approx(math.sqrt(5.0 / 29.0))
    np.testing.assert_allclose(moved[0, 1:], 1.0 / math.sqrt(26.0))


def test_what_is_told_to_move_faster_has_shorter_slots(
    windows: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: slots are those of objects as they move now: 1/4 s at 3 bins a second, 1/16 s at 12, and 1/4 s again."""
    monkeypatch.setattr(windows_room, "TimeSlots", Steady)
    fast: Any = (Clock(12.0),)
    for items, middle in ((ITEMS, 0.375), (fast, 4.5 / 16.0), (ITEMS, 0.375)):
        windows._kept.clear()
        windows.layers(windows.key(aim(0.3), Situation(items, items, HERE.sky)))
        assert windows.asked[1] == pytest.approx(middle)


def test_rows_cover_the_way_of_each_shot(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: from half of a dwell's travel before the first to half of it behind the last, in Θ and φ; grids of several
    aims are as wide as the widest, and begin each at its own first."""
    asked: list[Any] = []
    monkeypatch.setattr(background_rows, "rows_between", lambda *given: asked.append(given))
    ones = np.ones(3)
    aims: list[Any] = [
        SimpleNamespace(
            theta=np.array([0.1, 0.2, 0.15]), phi=0.3 * ones, travel_theta=-0.04 * ones, travel_phi=0.01 * ones
        ),
        SimpleNamespace(
            theta=np.array([-0.1, -0.08, -0.1]), phi=np.array([0.0, 0.5, 0.1]), travel_theta=0.02 * ones,
            travel_phi=0.0 * ones,
        ),
    ]  # fmt: skip
    layout: Any = object()
    background_rows.rows_about(aims, [None, 2.0], layout)
    for given, (left, top, time) in zip(asked, ((0.08, 0.295, None), (-0.11, 0.0, 2.0)), strict=True):
        assert given[0] == pytest.approx((left, left + 0.14))
        assert given[1] == pytest.approx((top, top + 0.5))
        assert given[2:] == (layout, time)


def test_slots_of_a_window_are_as_short_as_a_bin_asks(
    windows: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: the fastest object moves by one bin at most while the background stands, p/f and not a row, and of the
    objects of a situation those are asked that it has."""
    asked = []

    def slots(_: Any, step: float, items: Any = None) -> Any:
        asked.append((step, items))
        return SimpleNamespace(items=items, at=lambda _: (0, 0))

    monkeypatch.setattr(windows_room, "TimeSlots", slots)
    Windows(windows._instrument, windows._optics, (0.0, 0.1))
    others: Any = (Clock(7.0),)
    windows.key(aim(), Situation(others, others, Sky()))
    assert asked == [(PITCH / FOCAL, None), (PITCH / FOCAL, others)]


def test_each_run_has_windows_of_its_own_rangefinders(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: under the Sun every run has, for each rangefinder, windows before its own scene, whose kernels are those
    of the first run; in the dark there are none. Slots of all are as short as the finest of the bins asks."""
    made: list[Any] = []

    def window(own: Any, *sight: Any, like: Any = None) -> Any:
        made.append(SimpleNamespace(own=own, sight=sight, like=like, step=0.3 / (1.0 + len(made))))
        return made[-1]

    def run(seed: int, dark: bool = False) -> Any:
        sky = SimpleNamespace(dark=dark, seed=seed)
        scenario = SimpleNamespace(seed=seed, lighting=SimpleNamespace(sky=lambda: sky))
        finders = [SimpleNamespace(sight=(f"optics {which}", (0.0, 0.1))) for which in range(2)]
        loaded = SimpleNamespace(bodies=[SimpleNamespace(item=f"item {seed}")])
        return SimpleNamespace(scenario=scenario, loaded=loaded, rangefinders=finders)

    monkeypatch.setattr(frozen_room, "Windows", window)
    monkeypatch.setattr(frozen_room, "Situations", lambda *about: about)
    runs = [run(seed) for seed in (4, 7, 9)]
    bench = frozen_room.FrozenInstrument(*runs)
    assert bench.instrument is runs[0]
    assert bench._seeds.tolist() == [4, 7, 9]
    assert bench.windows == bench._windows[0] == made[:2]
    for number, own in enumerate(runs):
        for which, one in enumerate(bench._windows[number]):
            assert one.own is own
            assert one.sight == (f"optics {which}", (0.0, 0.1))
            assert one.like is (None if number == 0 else made[which])
        still = bench._still[number]
        assert (still.items, still.background) == ((f"item {own.scenario.seed}",),) * 2
        assert still.sky is own.scenario.lighting.sky()
    first, *others = bench.situations()
    step = made[1].step
    assert first == (runs[0].scenario, runs[0].loaded, step)
    assert others == [(own.scenario, own.loaded, step, first) for own in runs[1:]]
    unlit = frozen_room.FrozenInstrument(run(4, dark=True), run(5, dark=True))
    assert unlit.windows == []
    assert unlit._windows == [[], []]
    assert unlit.situations()[0][2] == math.inf


def test_windows_of_each_size_have_kernels_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: they are recorded once a size, and render as many rows and bins as were asked for."""
    monkeypatch.setattr(windows_room, "Frozen", lambda made, *, enabled: lambda *given: made(*given))
    monkeypatch.setattr(windows_room, "one_kernel", lambda loaded: True)
    made: Any = object.__new__(Windows)
    made.__dict__ |= {
        "_renderers": {},
        "first": SimpleNamespace(_layers=lambda *given: given),
        "_instrument": SimpleNamespace(loaded=None),
    }
    sizes = [(3, 40), (5, 40), (3, 60)]
    kernels = [made._renderer(*size) for size in sizes]
    for size, kernel in zip(sizes, kernels, strict=True):
        assert kernel("reads", "light", "corner", "poses", "seed") == (
            "light",
            "corner",
            "poses",
            "seed",
            *size,
        )
        assert made._renderer(*size) is kernel


def test_runs_side_by_side_see_what_each_sees_alone(
    windows: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: of three runs whose patterns point elsewhere, whose objects stand elsewhere and whose skies are unlike,
    each has the window of its own aim, of its own objects and sky, among its own windows, as when it is alone."""
    monkeypatch.setattr(windows_room, "TimeSlots", Steady)
    monkeypatch.setattr(
        windows_room, "join_windows", lambda places, layers: [*zip(places, layers, strict=True)]
    )
    others = [copy.copy(windows) for _ in range(2)]
    runs = [windows, *others]
    for number, own in enumerate(runs):
        own._kept, own._joined = OrderedDict(), OrderedDict()
        monkeypatch.setattr(own, "_render", lambda *key, number=number: [number, *key])
    aims = [dataclasses.replace(aim(), theta=aim().theta + 0.1 * number) for number in range(3)]
    situations = []
    for number in range(3):
        items: Any = (Clock(3.0 * (1.0 + number)),)
        situations.append(Situation(items, items, Sky()))
    alone = [windows_room.seen_by([runs[i]], [aims[i]], [situations[i]]) for i in range(3)]
    assert windows_room.seen_by(runs, aims, situations) == [seen for (seen,) in alone]
    for number, ((_, (which, *_, poses, sky)),) in enumerate(alone):
        assert which == number
        assert sky is situations[number].sky
        # 3, 6 and 9 bins a second have slots of 1/4, 1/8 and 1/16 s, in the middle of which objects stand.
        assert np.frombuffer(poses, dtype=np.float32).max() == 1.0
        assert 0.5 ** (3 + number) in np.frombuffer(poses, dtype=np.float32)
