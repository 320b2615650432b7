"""What pictures of visits, poses, shots and instruments draw: which number stands where, in which unit."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawn import figure_of, line
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from scanner_sim.foundation.status import Status
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.pictures import instrument, pattern, pose, time_series, track
from scanner_sim.ranging import axes as mirror_axes
from scanner_sim.tracking.record import TrackStatus
from scanner_sim.tracking.state import TrackMode


@pytest.fixture
def axes() -> Axes:
    return Figure().add_subplot()


def point_at(theta: float, phi: float) -> np.ndarray:
    """Return the point 5 m along a beam of mirrors whose axes are 1 m apart (eq 3)."""
    reach = 5.0 * math.cos(theta) - 1.0
    return np.array([5.0 * math.sin(theta), reach * math.sin(phi), reach * math.cos(phi) + 1.0])


def drawn_visit() -> Any:
    """Return a visit of nine voxels, of which five hit and two were not measured."""
    theta, phi = 0.1 + 1e-3 * np.arange(9.0), 0.2 - 2e-3 * np.arange(9.0)
    samples = SimpleNamespace(
        theta=theta[None], phi=phi[None], time=np.zeros((1, 9)), signal=1e3 * np.arange(1.0, 10.0)[None],
        range=5.0 + 1e-3 * np.array([[0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 14.0, 99.0, 77.0]]),
        valid=np.arange(9)[None] < 7,
    )  # fmt: skip
    return SimpleNamespace(
        number=12, time=3.25, target="t/1", mode=TrackMode.ACQUIRE, status=TrackStatus.MEASURED, samples=samples,
        centre=np.array([0.1, 0.2]), position=np.array([0.101, 0.198, 5.0]), truth=np.array([0.102, 0.199, 5.0]),
        covariance=np.diag([1e-12, 4e-12, 1e-6]), amplitude=2e-3,
        point=point_at(0.103, 0.198), truth_point=point_at(0.104, 0.199),
    )  # fmt: skip


def test_voxels_of_a_visit_are_drawn_by_signal_and_by_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the visit that is asked for; thousands of electrons, and millimetres about the median of the measured
    ranges; the true outline where it is given, else the circle of a facing target of 0.04 m at 5 m. Cross and circle
    are where the mirrors of the run, 1 m apart, point at the measured and at the true point."""
    one = drawn_visit()
    hit = np.array([[True, False, True, True, False, True, True, False, False]])
    response: Any = SimpleNamespace(hit=hit, used=np.array([[True] * 8 + [False]]))
    circle = SimpleNamespace(found=np.array([True]), radius=np.array([2e-3]))
    monkeypatch.setattr(pattern, "response_of", lambda _, record: response if record is one else None)
    monkeypatch.setattr(pattern, "circle_fit", lambda *_: circle)
    seen: list[Any] = []
    voxels = pattern._voxels
    monkeypatch.setattr(pattern, "_voxels", lambda *given: (seen.append(given[3:]), voxels(*given)))
    appearance = SimpleNamespace(diameter=0.04)
    made: Any = SimpleNamespace(
        records=[SimpleNamespace(number=11), one],
        targets=[SimpleNamespace(name="other", appearance=None), SimpleNamespace(name="t/1", appearance=appearance)],
        axes=mirror_axes.Axes(1.0),
    )  # fmt: skip
    outline = np.array([[0.1, 0.2], [0.103, 0.205]])
    for rim in (lambda _: outline, None):
        figure = figure_of(monkeypatch, pattern)
        pattern.draw_pattern(made, 12, "", rim)
        by_signal, by_range, centre = figure.axes[:3]
        assert by_signal.get_position().x1 < by_range.get_position().x0 < centre.get_position().x0
        for axes in (by_signal, by_range):
            cross = next(one.get_xydata() for one in axes.lines if one.get_marker() == "+")
            np.testing.assert_allclose(cross, [[3.0, -2.0]], atol=1e-9)
            truth = next(one.get_xydata() for one in axes.lines if one.get_label() == "truth")
            if rim is None:
                away = np.asarray(truth) - [4.0, -1.0]
                np.testing.assert_allclose(np.hypot(*away.T), 1e3 * 0.02 / 5.0)
            else:
                np.testing.assert_allclose(truth, [[0.0, 0.0], [3.0, 5.0]], atol=1e-9)
        assert [text.get_text() for text in figure.texts] == [
            "Pattern over t/1",
            f"visit 12 at 3.250 s in state acquire  ·  5 of 8 voxels hit  ·  {TrackStatus.MEASURED.sentence}",
        ]
    signal, ranges = seen[:2]
    np.testing.assert_allclose(signal[0], np.arange(1.0, 10.0))
    np.testing.assert_allclose(ranges[0][:7], [-6.0, -4.0, -2.0, 0.0, 2.0, 4.0, 8.0], atol=1e-9)
    assert "electrons" in signal[-1]
    assert ranges[-1] == "range about 5.0060 m [mm]"
    for given in (signal, ranges):
        np.testing.assert_array_equal(given[1], np.arange(9) < 7)


def test_voxels_are_drawn_where_they_lie(axes: Axes) -> None:
    """Claim: milliradians about the commanded centre, φ downwards; misses, then hits, then what was not measured;
    colours from the first to the ninety-ninth per cent of what was measured."""
    one = drawn_visit()
    hit = np.array([[True, False, True, True, False, True, True, False, True]])
    response: Any = SimpleNamespace(hit=hit)
    value = np.array([3.0, 8.0, 5.0, 6.0, 7.0, 4.0, 9.0, 999.0, -999.0])
    shown = one.samples.valid[0]
    pattern._voxels(axes, one, response, value, shown, "viridis", "x")
    x, y = np.arange(9.0), -2.0 * np.arange(9.0)
    np.testing.assert_allclose(line(axes, 0), np.stack([x, y], axis=1), atol=1e-9)
    groups: list[Any] = list(axes.collections)
    for dots, members in zip(groups, ([1, 4], [0, 2, 3, 5, 6], [7, 8]), strict=True):
        np.testing.assert_allclose(dots.get_offsets(), np.stack([x, y], axis=1)[members], atol=1e-9)
    for dots, members in zip(groups[:2], ([1, 4], [0, 2, 3, 5, 6]), strict=True):
        np.testing.assert_allclose(dots.get_array(), value[members])
        np.testing.assert_allclose(dots.get_clim(), np.percentile(value[:7], (1.0, 99.0)))
    assert groups[0].get_sizes() < groups[1].get_sizes()
    low, high = axes.get_ylim()
    assert low > high
    assert axes.get_xlabel() == f"Θ about {math.degrees(0.1):.4f}° [mrad]"
    assert axes.get_ylabel() == f"φ about {math.degrees(0.2):.4f}° [mrad]"


def test_the_gate_of_a_visit_lies_about_what_was_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the target's depth before and behind the measured range, or the expected one where there is none."""
    asked: list[Any] = []
    monkeypatch.setattr(pattern, "target_response", lambda *given: asked.append(given))
    appearance = SimpleNamespace(kind="disc", depth=0.25)
    targets = [
        SimpleNamespace(name="u", appearance=None, expected=None),
        SimpleNamespace(name="t/1", appearance=appearance, expected=(0.1, 0.2, 8.0)),
    ]
    one = drawn_visit()
    pattern.response_of(SimpleNamespace(targets=targets), one)  # type: ignore[arg-type]
    one.position = np.full(3, np.nan)
    pattern.response_of(SimpleNamespace(targets=targets), one)  # type: ignore[arg-type]
    assert asked == [(one.samples, "disc", (4.75, 5.25)), (one.samples, "disc", (7.75, 8.25))]


def series(method: str, number: float, label: str = "u") -> Any:
    """Return poses at four times, of which the third is not valid."""
    status = np.array([PoseStatus.VALID, PoseStatus.VALID, PoseStatus.AMBIGUOUS, PoseStatus.VALID])
    grid = np.arange(24.0).reshape(4, 6)
    return SimpleNamespace(
        method=method, label=label, name=label, relative_to="", time=np.array([0.0, 1.0, 2.5, 4.0]), status=status,
        error=1e-3 * number * (grid - 11.0), sigma=1e-3 * number * (1.0 + grid),
    )  # fmt: skip


def test_poses_are_drawn_component_by_component(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: mm and mrad; marks of valid poses, lines of ±2σ that break where there is none, ticks at the top there,
    for each method its own; a column for each object; the axis holds 2.6 σ and the largest error."""
    figure = figure_of(monkeypatch, pose)
    made = [series("uv", 1.0), series("joint", 0.5), series("uv", 3.0, "v")]
    pose.draw_poses(made, "")
    grid = np.array(figure.axes).reshape(6, 2)
    assert [one.get_title(loc="left") for one in grid[0]] == ["u", "v"]
    units = [axes.get_ylabel() for axes in grid[:, 0]]
    assert [("mm" in unit, "mrad" in unit) for unit in units] == [(True, False)] * 3 + [(False, True)] * 3
    for column, own in enumerate((made[:2], made[2:])):
        for component in range(6):
            axes = grid[component, column]
            reach = 0.0
            for place, one in enumerate(own):
                error, sigma = 1e3 * one.error[:, component], 1e3 * one.sigma[:, component]
                good = np.array([0, 1, 3])
                np.testing.assert_allclose(
                    line(axes, 4 * place), np.stack([one.time[good], error[good]], axis=1)
                )
                stated = np.where([True, True, False, True], sigma, np.nan)
                for shift, sign in ((1, -2.0), (2, 2.0)):
                    np.testing.assert_allclose(line(axes, 4 * place + shift)[:, 1], sign * stated)
                np.testing.assert_allclose(line(axes, 4 * place + 3), [[2.5, 0.97 - 0.05 * place]])
                largest = np.percentile(np.abs(error[good]), 99.0)
                reach = max(reach, 2.6 * np.median(sigma[good]), 1.1 * largest)
            assert axes.get_ylim() == pytest.approx((-reach, reach))
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["uv", "joint"]


def test_an_outline_is_the_targets_rims_and_the_rectangle_around_them() -> None:
    """Claim: each rim a circle of its own target's diameter about its centre, across the object's z-axis; the rectangle
    touches them all, half-way between the nearest and the farthest. Seen from the front x and y, from above x and z.

    Set-up: two targets of an object without turn at (0.2, 0.1, 6), where it is found.
    """
    targets: Any = [
        SimpleNamespace(appearance=SimpleNamespace(diameter=diameter), centre=np.array(centre))
        for diameter, centre in ((0.1, (-0.6, 0.3, 0.2)), (0.24, (0.5, -0.4, -0.4)))
    ]
    place = np.array([[0.2, 0.1, 6.0]])
    series: Any = SimpleNamespace(
        name="node", method="joint", time=np.array([1.5]), status=np.array([PoseStatus.VALID]),
        position=place, truth_position=place, rotation=np.eye(3)[None], truth_rotation=np.eye(3)[None],
    )  # fmt: skip
    panels = Figure().subplots(2)
    pose._object(panels, [series], targets)
    ends = np.array([[-0.65, -0.52, -0.1], [0.62, 0.35, -0.1]]) + place
    for panel, second in zip(panels, (1, 2), strict=True):
        rectangle, *rims = (line(panel, number) for number in range(3))
        np.testing.assert_allclose(rectangle.min(axis=0), ends[0, [0, second]], atol=1e-3)
        np.testing.assert_allclose(rectangle.max(axis=0), ends[1, [0, second]], atol=1e-3)
        for target, rim in zip(targets, rims, strict=True):
            away = rim - (target.centre + place[0])[[0, second]]
            radius = 0.5 * target.appearance.diameter
            if second == 1:
                np.testing.assert_allclose(np.hypot(*away.T), radius)
            else:
                np.testing.assert_allclose(away[:, 1], 0.0, atol=1e-12)
            np.testing.assert_allclose([away[:, 0].min(), away[:, 0].max()], [-radius, radius], rtol=0.01)


def visits(errors: list[float]) -> list[Any]:
    """Return visits at every half second with given errors of Θ [µrad], those of φ twice, of range [mm] a third."""
    modes = [TrackMode.SEARCH, TrackMode.ACQUIRE, TrackMode.TRACK, TrackMode.TRACK, TrackMode.LOST]
    truth = np.array([0.1, 0.2, 9.0])
    return [
        SimpleNamespace(
            time=0.5 * number, mode=mode, truth=truth, covariance=np.diag([4e-12, 9e-12, 16e-6]),
            position=truth + error * np.array([1e-6, 2e-6, 1e-3 / 3.0]),
            status=TrackStatus.MEASURED if number % 2 == 0 else TrackStatus.OUT_OF_VIEW,
        )
        for number, (mode, error) in enumerate(zip(modes, errors, strict=True))
    ]  # fmt: skip


@pytest.mark.parametrize(("axis", "unit", "sigma"), [(0, 1.0, 2.0), (1, 2.0, 3.0), (2, 1.0 / 3.0, 4.0)])
def test_errors_of_a_target_are_drawn_over_time(axes: Axes, axis: int, unit: float, sigma: float) -> None:
    """Claim: errors of measured visits in µrad and mm, a band of ±2σ, ticks where it was not measured, and states from
    their first visit to the next state's."""
    track._errors(axes, visits([1.0, 99.0, -7.0, 98.0, 30.0]), axis)
    np.testing.assert_allclose(
        line(axes, 0), np.stack([[0.0, 1.0, 2.0], unit * np.array([1.0, -7.0, 30.0])], axis=1)
    )
    band: Any = axes.collections[0]
    corners = band.get_paths()[0].vertices
    assert (corners[:, 1].min(), corners[:, 1].max()) == pytest.approx((-2.0 * sigma, 2.0 * sigma))
    assert (corners[:, 0].min(), corners[:, 0].max()) == (0.0, 2.0)
    np.testing.assert_allclose(line(axes, 2)[:, 0], [0.5, 1.5])
    reach = 1.2 * max(3.0 * sigma, np.percentile(unit * np.array([1.0, 7.0, 30.0]), 99.5))
    assert axes.get_ylim() == pytest.approx((-1.25 * reach, 1.1 * reach))
    states: list[Any] = list(axes.collections[1:])
    ends = [
        (bar.get_paths()[0].vertices[:, 0].min(), bar.get_paths()[0].vertices[:, 0].max()) for bar in states
    ]
    assert ends == [(0.0, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 2.0)]
    order = [TrackMode.SEARCH, TrackMode.ACQUIRE, TrackMode.TRACK, TrackMode.LOST]
    assert [to_hex(bar.get_facecolor()[0]) for bar in states] == [track.STATE_COLOUR[mode] for mode in order]


def test_targets_are_drawn_row_by_row(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the first eight, each in a row of Θ, φ and range; how many are not drawn is told."""
    figure = figure_of(monkeypatch, track)
    asked: list[tuple[str, int]] = []
    monkeypatch.setattr(track, "_errors", lambda _, records, axis: asked.append((records, axis)))
    targets = [SimpleNamespace(name=f"t{number}") for number in range(11)]
    track.draw_track(SimpleNamespace(targets=targets, of=lambda name: name), "")  # type: ignore[arg-type]
    assert asked == [(f"t{number}", axis) for number in range(8) for axis in range(3)]
    grid = np.array(figure.axes).reshape(8, 3)
    assert [row[0].get_title(loc="left") for row in grid] == [f"t{number}" for number in range(8)]
    assert [one.texts[0].get_text() for one in grid[0]] == [
        "Θ error [µrad]",
        "φ error [µrad]",
        "range error [mm]",
    ]
    assert figure.texts[1].get_text().endswith("not drawn: 3 more")


def test_the_field_shows_paths_patterns_and_centres(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: in degrees, all that is known of true places, the last search dashed, the last pattern, and its measured
    centre; the part of the field that holds them, φ downwards."""
    figure = figure_of(monkeypatch, track)

    def visit(number: int, mode: TrackMode, known: bool) -> Any:
        centre = np.array([0.01 * number, 0.02])
        empty = np.zeros((1, 0))
        return SimpleNamespace(
            target="t", mode=mode, centre=centre, amplitude=1e-3 * (1.0 + number), position=centre + 1e-4,
            truth=centre + 2e-4 if known else np.full(3, np.nan), status=TrackStatus.MEASURED,
            samples=SimpleNamespace(time=empty, theta=empty, phi=empty),
        )  # fmt: skip

    records = [
        visit(0, TrackMode.SEARCH, False), visit(1, TrackMode.SEARCH, True), visit(2, TrackMode.TRACK, True),
        visit(3, TrackMode.TRACK, True),
    ]  # fmt: skip
    made: Any = SimpleNamespace(
        targets=[SimpleNamespace(name="t"), SimpleNamespace(name="never")], records=records,
        of=lambda name: records if name == "t" else [],
    )  # fmt: skip
    track.draw_field(made, "")
    (axes,) = figure.axes
    truth, _, search, last, middle = (np.radians(line(axes, number)) for number in range(5))
    np.testing.assert_allclose(truth, [[0.01 * n + 2e-4, 0.0202] for n in (1, 2, 3)])
    for ring, number in ((search, 1), (last, 3)):
        np.testing.assert_allclose(np.hypot(*(ring - [0.01 * number, 0.02]).T), 1e-3 * (1.0 + number))
    np.testing.assert_allclose(middle, [[0.0301, 0.0201]])
    left, right, upper, lower = np.degrees(track.field_of(made))
    assert (*axes.get_xlim(), *axes.get_ylim()) == pytest.approx((left, right, lower, upper))
    name = axes.texts[0]
    assert name.get_text() == "t"
    assert name.xy == pytest.approx(np.degrees([0.034, 0.02]), abs=1e-3)  # type: ignore[attr-defined]


class Shots(SimpleNamespace):
    """A made-up table of shots."""

    def __getitem__(self, name: str) -> Any:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.time)


@pytest.mark.parametrize(("away", "unit", "scale"), [(0.5, "mm", 1e3), (7.0, "m", 1.0)])
def test_ranges_in_one_direction_are_drawn_over_time(
    monkeypatch: pytest.MonkeyPatch, away: float, unit: str, scale: float
) -> None:
    """Claim: measured and true ranges, in mm below a metre; below them their difference beside ±σ [mm], on an axis of
    five σ of the worst 5 %; the heading says which direction, how many shots, and how many are valid."""
    figure = figure_of(monkeypatch, time_series)
    time = np.arange(5.0) * 0.25
    truth = away + 1e-3 * np.arange(5.0)
    ranges, sigma = truth + 1e-3 * np.array([1.0, -2.0, 3.0, -4.0, 5.0]), 1e-3 * np.arange(1.0, 6.0)
    shots: Any = Shots(
        time=time, theta=np.full(5, math.radians(3.0)), phi=np.full(5, math.radians(-2.0)), objects={1: "wall"},
        seed=17, valid=np.array([True, True, False, True, True]),
        columns={"range_m": ranges, "sigma_range_m": sigma, "truth.range_m": truth},
    )  # fmt: skip
    monkeypatch.setattr(time_series, "numbered", lambda given: given)
    time_series.draw_range_over_time(shots, "")
    whole, error = figure.axes
    np.testing.assert_allclose(line(whole, 0), np.stack([time, scale * truth], axis=1))
    np.testing.assert_allclose(line(whole, 1), np.stack([time, scale * ranges], axis=1))
    assert [str(one.get_label()) for one in whole.lines] == ["truth", "measured"]
    assert whole.get_ylabel() == f"range [{unit}]"
    np.testing.assert_allclose(line(error, 0), np.stack([time, [1.0, -2.0, 3.0, -4.0, 5.0]], axis=1))
    band: Any = error.collections[0]
    assert abs(band.get_paths()[0].vertices[:, 1]).max() == pytest.approx(5.0)
    assert error.get_ylim() == pytest.approx((-24.0, 24.0))
    words = whole.texts[0].get_text()
    assert words == "wall  ·  Θ 3°, φ -2°  ·  5 shots in 1 s  ·  seed 17  ·  80.0 % valid"


@pytest.mark.parametrize(("count", "step"), [(20_000, 1), (20_001, 2), (60_001, 4)])
def test_at_most_twenty_thousand_shots_are_drawn(count: int, step: int) -> None:
    made: Any = Shots(time=np.zeros(count))
    np.testing.assert_array_equal(time_series._drawn(made), np.arange(count)[::step])


@pytest.mark.parametrize(("ends", "expected"), [((0.0, 0.0), True), ((0.1, 0.0), False), ((0.0, 0.1), False)])
def test_shots_point_alike_where_both_angles_are_the_same(ends: tuple[float, float], expected: bool) -> None:
    made: Any = SimpleNamespace(theta=np.array([0.3, 0.3 + ends[0]]), phi=np.array([0.2, 0.2 + ends[1]]))
    assert time_series.in_one_direction(made) is expected


def sheet(lined: bool) -> Any:
    """Return the sheet of an instrument with a base of 0.2 m, a lens of 40 mm and f = 100 mm."""
    ranges = np.array([1.0, 3.0, 20.0])
    ends = ((-0.01, -0.102), (0.02, -0.096))
    lined_sheet = SimpleNamespace(ends=ends, image_px=2.0 * ranges, pixel_m=4e-3 * ranges)
    return SimpleNamespace(
        line=lined_sheet if lined else None, baseline=0.2, focal_length=0.1, aperture=0.04, range_m=ranges,
        spot_m=1e-3 * ranges, lateral_m=2e-3 * ranges, sigma_m={"tof": 3e-3 * ranges, "fused": 1e-3 * ranges},
        reflectance=0.5,
    )  # fmt: skip


@pytest.mark.parametrize("lined", [True, False])
def test_an_instruments_curves_are_in_millimetres(lined: bool) -> None:
    """Claim: beam and σ across in mm, the image in pixels on an axis of its own; σ of each way, and where there is an
    array one pixel of it."""
    one, ranges = sheet(lined), np.array([1.0, 3.0, 20.0])
    across, sigma = Figure().subplots(1, 2)
    instrument._draw_lateral(across, one)
    np.testing.assert_allclose(line(across, 0), np.stack([ranges, ranges], axis=1))
    np.testing.assert_allclose(line(across, 1), np.stack([ranges, 2.0 * ranges], axis=1))
    others = [axes for axes in across.figure.axes if axes not in (across, sigma)]
    assert len(others) == lined
    for axes in others:
        np.testing.assert_allclose(line(axes, 0), np.stack([ranges, 2.0 * ranges], axis=1))
    instrument._draw_sigma(sigma, one)
    found = {str(curve.get_label()): np.asarray(curve.get_xydata()) for curve in sigma.lines}
    expected = {instrument.CURVES["tof"][1]: 3.0, instrument.CURVES["fused"][1]: 1.0}
    if lined:
        expected["one pixel of the array"] = 4.0
    assert set(found) == set(expected)
    for name, factor in expected.items():
        np.testing.assert_allclose(found[name], np.stack([ranges, factor * ranges], axis=1))
    one.lateral_m = np.zeros(3)
    alone = Figure().add_subplot()
    instrument._draw_lateral(alone, one)
    assert len(alone.lines) == 1


def test_the_head_is_drawn_to_scale(axes: Axes, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: lens and array a base beside the laser; rays go straight from the ends of the array through the middle of
    the lens up to nine tenths of the larger of base and focal length."""
    monkeypatch.setattr(instrument, "_draw_beam", lambda *_: None)
    one = sheet(True)
    instrument._draw_head(axes, one, one.line)
    first, second, axis, lens, array, laser = (line(axes, number) for number in range(6))
    for ray, (x, z) in ((first, (-10.0, -102.0)), (second, (20.0, -96.0))):
        np.testing.assert_allclose(ray[1], [200.0 + x, z])
        assert ray[0, 1] == pytest.approx(180.0)
        (a, b), (c, d) = ray - [200.0, 0.0]
        assert a * d == pytest.approx(b * c)
        assert a * c < 0.0
    np.testing.assert_allclose(axis, [[200.0, -102.0], [200.0, 180.0]])
    np.testing.assert_allclose(lens, [[180.0, 0.0], [220.0, 0.0]])
    np.testing.assert_allclose(array, [[190.0, -102.0], [220.0, -96.0]])
    np.testing.assert_allclose(laser, [[0.0, 0.0]])


def test_a_status_is_named_where_only_shots_have_it_that_are_not_drawn() -> None:
    count = 20_002
    status = np.full(count, int(Status.VALID))
    status[1] = int(Status.SATURATED)
    shots: Any = Shots(time=np.arange(float(count)), columns={"status": status})
    with pytest.MonkeyPatch.context() as patch:
        figure = figure_of(patch, time_series)
        patch.setattr(time_series, "_headed", lambda *_: None)
        time_series.draw_status_over_time(shots, "")
    (axes,) = figure.axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert {name.split()[0] for name in names} == {"VALID", "SATURATED"}
