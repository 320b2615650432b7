"""What pictures draw of numbers: scales, ellipses, curves and outlines, on axes that are not written."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawn import figure_of
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from scanner_sim.acceptance import pictures as acceptance
from scanner_sim.acceptance.plan import Plate
from scanner_sim.acceptance.verdicts import Verdict
from scanner_sim.foundation.status import Status
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.pictures import (
    budget,
    difference,
    frame,
    image,
    pattern,
    pose,
    time_series,
    track,
    voxel,
    waveform,
)
from scanner_sim.products.voxel import VoxelRecord
from scanner_sim.signals.dots.settings import DotStatus


@pytest.fixture
def axes() -> Axes:
    return Figure().add_subplot()


@pytest.mark.parametrize("fitted", [True, False])
def test_a_waveform_has_its_range_above_its_time(monkeypatch: pytest.MonkeyPatch, fitted: bool) -> None:
    """Claim: light goes there and back: the upper scale is c/2 of the lower one, 14.99 cm for each nanosecond. A fitted
    pulse has a panel of its own below."""
    figure = figure_of(monkeypatch, waveform)
    made: Any = SimpleNamespace(
        number=np.arange(5.0)[None], step=2e-6, time=1e-9 * np.array([20.0, 30.0, 40.0, 50.0, 70.0]),
        delay=np.array([35e-9]), sigma=np.array([1e-11]), status=np.array([Status.VALID]),
        row=np.array([1]), column=np.array([2]),
    )  # fmt: skip
    fit = (1e-9 * np.array([30.0, 40.0]), 1e-6 * np.array([3.0, 4.0])) if fitted else None
    waveform.draw_waveform("", made, 0, fit)
    below, *close, above = figure.axes
    for one in close:
        assert below.get_position().y0 > one.get_position().y1
        np.testing.assert_allclose(one.lines[2].get_xydata(), [[30.0, 3.0], [40.0, 4.0]])
    assert len(close) == fitted
    assert below.get_xlim() == pytest.approx((20.0, 70.0))
    assert above.get_xlim() == pytest.approx((20.0 * 0.149896229, 70.0 * 0.149896229))
    np.testing.assert_allclose(below.lines[1].get_xydata()[:, 1], 2.0 * np.arange(5.0))


def test_ellipses_of_a_centre_are_those_of_its_covariance(axes: Axes) -> None:
    """Claim: about the error, in µrad; of each point q of one and two σ qᵀC⁻¹q is 1 and 4, with correlated axes."""
    covariance = 1e-12 * np.array([[9.0, 4.0], [4.0, 4.0]])
    record: Any = SimpleNamespace(
        position=np.array([0.1 + 3e-6, 0.2 - 7e-6, 9.0]), truth=np.array([0.1, 0.2, 9.0]),
        covariance=np.pad(covariance, ((0, 1), (0, 1))),
    )  # fmt: skip
    pattern._centre(axes, record)
    *_, one, two = (line.get_xydata() for line in axes.lines)
    for ring, size in ((one, 1.0), (two, 4.0)):
        away = 1e-6 * (ring - [3.0, -7.0])
        np.testing.assert_allclose(np.einsum("ni,ij,nj->n", away, np.linalg.inv(covariance), away), size)


@pytest.mark.parametrize("found", [True, False])
def test_a_fitted_circle_has_the_fits_radius(axes: Axes, found: bool) -> None:
    """Claim: about the measured position less the commanded centre, in mrad; without a fit the truth alone."""
    record: Any = SimpleNamespace(centre=np.array([0.1, 0.2]))
    outline = np.array([[0.1, 0.2], [0.103, 0.2]])
    circle: Any = SimpleNamespace(found=np.array([found]), radius=np.array([4e-3]))
    pattern._circles(axes, record, np.array([0.101, 0.198]), circle, outline)
    lines = {str(line.get_label()): line.get_xydata() for line in axes.lines}
    assert ("fit" in lines) is found
    np.testing.assert_allclose(lines["truth"], [[0.0, 0.0], [3.0, 0.0]], atol=1e-9)
    if found:
        np.testing.assert_allclose(np.hypot(*(lines["fit"] - [1.0, -2.0]).T), 4.0)


def test_the_curve_beside_differences_is_normal(axes: Axes, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of 4000 quantiles of the normal law, and of some that are none, every bin near the middle holds what the
    curve says: to one voxel for each edge of the bin, and the curve's bend over it."""
    monkeypatch.setattr(difference, "_words", lambda _: [])
    over = np.append(norm.ppf((np.arange(4000) + 0.5) / 4000.0), [math.nan] * 9)
    difference._draw_histogram(axes, SimpleNamespace(over_sigma=over))  # type: ignore[arg-type]
    at, height = axes.lines[-1].get_xydata().T
    counts, edges, _ = axes.patches[0].get_data()  # type: ignore[attr-defined]
    width = edges[1] - edges[0]
    assert width < 0.6
    middle = 0.5 * (edges[1:] + edges[:-1])
    bend = 4000.0 * width**3 / 24.0 * 0.4
    np.testing.assert_allclose(np.interp(middle, at, height), counts, atol=2.0 + bend)
    assert np.trapezoid(height, at) / width == pytest.approx(4000.0, rel=1e-3)


def test_no_differences_are_no_bars(axes: Axes, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of results without a range in common the histogram is empty, and nothing is told besides (warnings are
    errors here)."""
    monkeypatch.setattr(difference, "_words", lambda _: [])
    difference._draw_histogram(axes, SimpleNamespace(over_sigma=np.full(9, np.nan)))  # type: ignore[arg-type]
    counts, _, _ = axes.patches[0].get_data()  # type: ignore[attr-defined]
    assert not counts.any()


@pytest.mark.parametrize("rule", ["guarded", "simple"])
def test_errors_stand_over_their_limits(monkeypatch: pytest.MonkeyPatch, rule: str) -> None:
    """Claim: errors of ±1 and 3 mm of a limit of 2 mm at ±½ and 1½; what an uncertainty of 0.4 mm leaves open, where
    it counts, goes from 0.8 to 1.2 of the limit to either side."""
    figure = figure_of(monkeypatch, acceptance)
    own = {"quantity": "length", "artefact": "bar", "limit": 2e-3}
    tests = [SimpleNamespace(**own, uncertainty=0.4e-3)]
    results = [SimpleNamespace(**own, error=error, verdict=Verdict.PASSES) for error in (1e-3, -1e-3, 3e-3)]
    plan = SimpleNamespace(plan=SimpleNamespace(rule=rule))
    acceptance.draw_errors(SimpleNamespace(tests=tests, results=results, setup=plan), "")  # type: ignore[arg-type]
    (axes,) = figure.axes
    dots = [float(line.get_xdata()[0]) for line in axes.lines if line.get_marker() == "o"]
    assert dots == pytest.approx([0.5, -0.5, 1.5])
    bands = [
        sorted(band.get_paths()[0].vertices[:, 0])[:: len(band.get_paths()[0].vertices) - 1]
        for band in axes.collections
    ]
    if rule == "guarded":
        np.testing.assert_allclose(bands, [[-1.2, -0.8], [0.8, 1.2]])
    assert axes.get_xlim()[1] > 1.5


def test_a_plate_is_drawn_where_it_lies(axes: Axes) -> None:
    """Claim: of 0.4 m × 0.2 m, turned about y by 30°, from above a line of 0.4 m through its place, seen from the side
    all of its height; the outline is closed, and goes round."""
    turned = {"axis": "y", "angle": math.radians(30.0)}
    given = {"name": "plate", "position": (0.1, -0.3, 5.0), "size": (0.4, 0.2), "rotation": turned}
    plate = Plate.model_validate(given)
    corner = np.array([[-0.2, -0.1], [0.2, -0.1], [0.2, 0.1], [-0.2, 0.1], [-0.2, -0.1]])
    for upward in (0, 1):
        acceptance._artefact(axes, plate, 0.0, upward, "black")
        z, up = axes.lines[-1].get_xydata().T
        np.testing.assert_allclose(z, 5.0 - corner[:, 0] * 0.5, atol=1e-12)
        wanted = (0.1 + corner[:, 0] * math.sqrt(0.75), -0.3 + corner[:, 1])[upward]
        np.testing.assert_allclose(up, wanted, atol=1e-12)


@pytest.mark.parametrize(
    ("off", "factor"), [(1.1e-3, 200.0), (1.3e-3, 100.0), (0.11, 2.0), (0.5, 1.0), (0.0, 1.0)]
)
def test_displacements_of_an_outline_are_enlarged_to_an_eighth_of_it(off: float, factor: float) -> None:
    """Claim: of 1, 2, 5, 10, 20 … the largest that keeps outlines of an object of 2 m within 0.24 m; told."""
    target = SimpleNamespace(appearance=SimpleNamespace(diameter=0.1))
    corners = [
        SimpleNamespace(centre=np.array([x, y, 0.0]), **vars(target))
        for x in (-0.95, 0.95)
        for y in (-0.95, 0.95)
    ]
    turned = Rotation.from_euler("xyz", (0.1, 0.2, 0.3)).as_matrix()[None]
    place = np.array([[0.2, 0.1, 6.0]])
    series: Any = SimpleNamespace(
        name="node", method="joint", time=np.array([1.5]), status=np.array([PoseStatus.VALID]),
        position=place + np.array([off, 0.0, 0.0]), truth_position=place, rotation=turned, truth_rotation=turned,
    )  # fmt: skip
    front, above = Figure().subplots(1, 2)
    pose._object(np.array([front, above]), [series], corners)  # type: ignore[arg-type]
    for panel in (front, above):
        true, shown = (lines.get_xydata() for lines in (panel.lines[0], panel.lines[len(panel.lines) // 2]))
        np.testing.assert_allclose(shown - true, np.broadcast_to([factor * off, 0.0], true.shape), atol=1e-9)
    assert front.get_title(loc="left").endswith(f"× {factor:g}")


def test_the_enlarged_part_of_a_line_shows_all_that_lies_in_it(axes: Axes) -> None:
    """Claim: the highest signal, light and threshold from the first to the last pixel are in sight, and what lies
    beside does not count."""
    for tallest in (3, 6):
        signal = np.full(12, 10.0)
        signal[[2, 7]], signal[tallest] = 900.0, 200.0
        record: Any = SimpleNamespace(pixel_signal=signal, expected_signal=np.full(12, 20.0), threshold=30.0)
        voxel._height(axes, record, 3, 6, 2.0)
        low, high = axes.get_ylim()
        assert low < 0.0
        assert 100.0 < high < 120.0


@pytest.mark.parametrize("highest", ["pixel_signal", "expected_signal", "threshold"])
def test_a_line_below_its_threshold_is_shown_with_it(axes: Axes, highest: str) -> None:
    """Claim: whichever of signal, light and threshold is the highest, and the lowest signal, are in sight."""
    record: Any = SimpleNamespace(
        pixel_signal=np.array([-50.0, 10.0, 20.0]), expected_signal=np.full(3, 20.0), threshold=20.0
    )
    setattr(record, highest, getattr(record, highest) + 200.0)
    voxel._height(axes, record, 0, 2, 2.0)
    low, high = axes.get_ylim()
    assert 2.0 * low < np.min(record.pixel_signal)
    assert 2.0 * high > 220.0


@pytest.mark.parametrize("drawn", ["image", "backdrop"])
def test_an_image_reaches_from_edge_to_edge_of_its_voxels(axes: Axes, drawn: str) -> None:
    """Claim: in degrees, half a voxel beyond the middles of the outer ones, each way by its own half; φ downwards."""
    theta, phi = -0.1 + 2e-3 * np.arange(30), 0.2 + 1e-3 * np.arange(40)
    if drawn == "image":
        made = SimpleNamespace(theta=theta, phi=phi)
        image._axes(SimpleNamespace(axes=axes, figure=axes.figure), made)  # type: ignore[arg-type]
        found = (*axes.get_xlim(), *axes.get_ylim())
    else:

        class Layers(SimpleNamespace):
            def __getitem__(self, name: str) -> Any:
                return np.ones((40, 30))

        track._backdrop(axes, Layers(theta=theta, phi=phi))  # type: ignore[arg-type]
        found = tuple(axes.images[0].get_extent())
    wanted = np.degrees([-0.101, -0.1 + 0.058 + 0.001, 0.2 + 0.039 + 0.0005, 0.1995])
    np.testing.assert_allclose(found, wanted)


@pytest.mark.parametrize(("rows", "columns"), [(40, 30), (8000, 6000), (90, 300)])
def test_dots_of_a_picture_keep_the_proportions_of_its_angles(rows: int, columns: int) -> None:
    """Claim: voxels are twice as wide as high, and so are their dots, to a dot for each voxel; they go evenly from the
    first voxel to the last."""
    made = SimpleNamespace(shape=(rows, columns), theta=2e-3 * np.arange(columns), phi=1e-3 * np.arange(rows))
    row, column = image._voxels_of_dots(made)  # type: ignore[arg-type]
    ratio = len(column) / len(row) / (2.0 * columns / rows)
    slack = sum(
        0.5 * count / len(dots) if len(dots) > count else 1.0 / len(dots)
        for dots, count in ((row, rows), (column, columns))
    )
    assert abs(ratio - 1.0) <= slack
    for dots, count in ((row, rows), (column, columns)):
        even = (np.arange(len(dots)) + 0.5) * count / len(dots) - 0.5
        assert np.abs(dots - even).max() <= 0.5


def test_the_frame_in_the_strip_is_what_is_enlarged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: whole pixels, from 12 before the first of detection, truth and window to 13 behind the last."""
    figure = figure_of(monkeypatch, voxel)
    light = 5e4 * np.exp(-0.5 * ((np.arange(64.0) - 20.2) / 1.1) ** 2)
    record = VoxelRecord(
        row=3, column=4, theta=-0.1, phi=0.2, pixel_signal=light + 300.0, expected_signal=light,
        noise_sigma=np.full(64, 200.0), threshold=1e3, saturation_level=6e4, status=Status.VALID, peak_px=20.25,
        sigma_peak_px=0.02, range_m=9.998, sigma_range_m=1e-3, sigma_texture_m=5e-4, truth_peak_px=20.2,
        truth_range_m=10.0, method="gaussian", window=(17, 23),
    )  # fmt: skip
    voxel.draw_voxel(record, "")
    strip, close, *_ = figure.axes
    assert close.get_xlim() == (17.0 - 12.0 - 0.5, 23.0 + 13.0 + 0.5)
    frame = next(patch for patch in strip.patches if patch.get_linestyle() == "--")
    across = frame.get_extents().transformed(strip.transData.inverted()).intervalx
    assert tuple(across) == pytest.approx(close.get_xlim())


def test_objects_stand_side_by_side_from_the_front_over_from_above(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a column for each object, its poses in the scanner's frame alone, in the order in which they come."""
    figure_of(monkeypatch, pose)
    seen: list[tuple[Any, list[str], int]] = []

    def keep(panels: Any, own: Any, targets: Any) -> None:
        seen.append((panels, [one.name for one in own], len(targets)))

    monkeypatch.setattr(pose, "_object", keep)
    series: Any = [
        SimpleNamespace(name=name, method=method, relative_to=other)
        for name, method, other in (
            ("b", "uv", ""),
            ("a", "uv", ""),
            ("b", "xyz", ""),
            ("b", "uv", "a"),
            ("c", "uv", ""),
        )
    ]
    targets = [SimpleNamespace(object=name) for name in "aabccc"]
    pose.draw_outlines(SimpleNamespace(targets=targets), series, "")  # type: ignore[arg-type]
    assert [(own, count) for _, own, count in seen] == [(["b", "b"], 1), (["a"], 2), (["c"], 3)]
    for column, (panels, *_) in enumerate(seen):
        front, above = (panel.get_subplotspec() for panel in panels)
        assert [front.rowspan.start, above.rowspan.start] == [0, 1]
        assert [front.colspan.start, above.colspan.start] == [column] * 2


def test_status_over_time_tells_the_share_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a row for each status that is present, with its share of all shots and a mark at each of its times."""
    figure = figure_of(monkeypatch, time_series)
    monkeypatch.setattr(time_series, "_headed", lambda *_: None)

    class Shots(SimpleNamespace):
        def __getitem__(self, name: str) -> Any:
            return np.array([Status.VALID, Status.SATURATED, Status.VALID, Status.VALID])

        def __len__(self) -> int:
            return 4

    time_series.draw_status_over_time(Shots(time=np.array([0.0, 1.0, 2.0, 3.0])), "")  # type: ignore[arg-type]
    (axes,) = figure.axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert set(names) == {"VALID 75 %", "SATURATED 25 %"}
    for name, wanted in (("VALID 75 %", [0.0, 2.0, 3.0]), ("SATURATED 25 %", [1.0])):
        row = axes.lines[names.index(name)]
        assert row.get_xdata().tolist() == wanted
        assert set(row.get_ydata().tolist()) == {names.index(name)}


def test_shares_over_time_are_of_all_shots_where_some_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: every second shot has no range and every second is drawn: half have none, of whom none is seen."""
    figure = figure_of(monkeypatch, time_series)
    monkeypatch.setattr(time_series, "_headed", lambda *_: None)
    monkeypatch.setattr(time_series, "_MOST_DOTS", 3)

    class Shots(SimpleNamespace):
        def __getitem__(self, name: str) -> Any:
            return np.array([Status.VALID, Status.SATURATED] * 3)

        def __len__(self) -> int:
            return 6

    time_series.draw_status_over_time(Shots(time=np.arange(6.0)), "")  # type: ignore[arg-type]
    (axes,) = figure.axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert set(names) == {"VALID 50 %", "SATURATED 50 %"}
    seen = {name: line.get_xdata().tolist() for name, line in zip(names, axes.lines, strict=True)}
    assert seen == {"VALID 50 %": [0.0, 2.0, 4.0], "SATURATED 50 %": []}


def test_a_frame_has_its_pixels_about_whole_numbers_and_rings_of_its_dots(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: from half a pixel before the first to half a pixel behind the last, v downwards; each ring q has
    qᵀS⁻²q = 1 for the root S of a dot's shape, about its centre."""
    figure = figure_of(monkeypatch, frame)
    shape = np.array([[4.0, 1.0, 2.0], [math.nan, math.nan, math.nan]])
    dots: Any = SimpleNamespace(
        name="array", targets=("array/1", "array/2"), status=np.array([DotStatus.VALID, DotStatus.VALID]),
        centre=np.array([[20.0, 10.0], [5.0, 5.0]]), shape=shape,
    )  # fmt: skip
    frame.draw_frame(np.zeros((30, 40), dtype=np.uint8), [dots], "frame", "")
    (axes,) = figure.axes
    assert (axes.get_xlim(), axes.get_ylim()) == ((-0.5, 39.5), (29.5, -0.5))
    (ring,) = (line.get_xydata() - [20.0, 10.0] for line in axes.lines)
    root = np.array([[4.0, 1.0], [1.0, 2.0]])
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", ring, np.linalg.inv(root @ root), ring), 1.0)
    assert [(one.get_text(), one.get_position()) for one in axes.texts] == [("1", (20.0, 10.0))]


def test_a_budget_is_drawn_in_millimetres_with_its_intervals(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a line of closed forms and points with bars from the lower end to the upper one; all of what the sources
    make together is in sight, up to three times the largest."""
    figure = figure_of(monkeypatch, budget)
    R = np.array([2.0, 5.0, 10.0])
    sizes = {"shot": 3e-5, "all": 5e-5}
    rows: Any = [
        SimpleNamespace(
            mode=mode, source=source, range_m=at, analytic_m=1.1 * size * at**2, simulated_m=size * at**2,
            low_m=0.8 * size * at**2, high_m=1.5 * size * at**2,
        )
        for mode in ("triangulation", "tof") for source, size in sizes.items() for at in R
    ]  # fmt: skip
    budget.draw_budget(rows, 0.5, "", mode="triangulation")
    (axes,) = figure.axes
    assert len(axes.containers) == 2
    for container, (name, size) in zip(axes.containers, sizes.items(), strict=True):
        dots, _, (bars,) = container.lines  # type: ignore[attr-defined]
        assert container.get_label() == name
        np.testing.assert_allclose(dots.get_ydata(), 1e3 * size * R**2)
        ends = np.array([segment[:, 1] for segment in bars.get_segments()])
        np.testing.assert_allclose(ends, 1e3 * size * R[:, None] ** 2 * [0.8, 1.5])
    low, high = axes.get_ylim()
    assert high == pytest.approx(3.0 * 5.0)
    assert low < 5e-2 * 4.0


def seen_voxel(**changes: Any) -> VoxelRecord:
    """Return a voxel of 64 pixels whose spot lies at 20.2, and is found at 20.25 ± 0.02."""
    light = 5e4 * np.exp(-0.5 * ((np.arange(64.0) - 20.2) / 1.1) ** 2)
    told: dict[str, Any] = {
        "row": 3, "column": 4, "theta": -0.1, "phi": 0.2, "pixel_signal": light + 300.0, "expected_signal": light,
        "noise_sigma": 200.0 + np.arange(64.0), "threshold": 1e3, "saturation_level": 6e4, "status": Status.VALID,
        "peak_px": 20.25, "sigma_peak_px": 0.02, "range_m": 9.998, "sigma_range_m": 1e-3, "sigma_texture_m": 5e-4,
        "truth_peak_px": 20.2, "truth_range_m": 10.0, "method": "gaussian", "window": (17, 23),
    }  # fmt: skip
    return VoxelRecord(**told | changes)


@pytest.mark.parametrize(
    ("signal", "light", "threshold", "power"),
    [
        ([1.0, 2999.0, np.nan], [0.0, 1.0, 1.0], 1.0, (1.0, "")),
        ([0.0, 3000.0, np.nan], [0.0, 1.0, 1.0], 1.0, (1e3, "10³")),
        ([0.0, 1.0, 1.0], [np.nan, 0.0, 2.9e6], 1.0, (1e3, "10³")),
        ([0.0, 1.0, 1.0], [np.nan, 0.0, 3e6], 1.0, (1e6, "10⁶")),
        ([0.0, 1.0, 1.0], [0.0, 0.0, 0.0], 3e3, (1e3, "10³")),
    ],
)  # fmt: skip
def test_signals_are_labelled_by_a_power_of_ten_of_the_largest(
    signal: list[float], light: list[float], threshold: float, power: tuple[float, str]
) -> None:
    lines: Any = {"pixel_signal": np.array(signal), "expected_signal": np.array(light)}
    told = seen_voxel(**lines, noise_sigma=np.ones(3), threshold=threshold, window=(0, 1))
    assert voxel._electrons(told) == power


def test_pixels_are_drawn_with_light_and_one_sigma_of_its_noise(axes: Axes) -> None:
    """Claim: the digitised signal, the light alone, and a band of one σ to each side of it, a pixel wide each, in the
    unit of the axis."""
    one = seen_voxel()
    voxel._bars(axes, one, 1e3)
    signal, band, light = (patch.get_data() for patch in axes.patches)  # type: ignore[attr-defined]
    for step in (signal, band, light):
        np.testing.assert_allclose(step.edges, np.arange(65.0) - 0.5)
    np.testing.assert_allclose(signal.values, 1e-3 * one.pixel_signal)
    np.testing.assert_allclose(light.values, 1e-3 * one.expected_signal)
    np.testing.assert_allclose(band.values, 1e-3 * (one.expected_signal + one.noise_sigma))
    np.testing.assert_allclose(band.baseline, 1e-3 * (one.expected_signal - one.noise_sigma))


@pytest.mark.parametrize(("well", "near"), [(9e4, True), (1.1e5, False)])
def test_limits_and_positions_are_marked(axes: Axes, well: float, near: bool) -> None:
    """Claim: window from edge to edge of its pixels, threshold, the full well where half of it is reached, the true
    position, and the detected one with its σ to each side."""
    voxel._marks(axes, seen_voxel(saturation_level=well), 1e3)
    lines = {str(one.get_label()): np.asarray(one.get_xydata()) for one in axes.lines}
    np.testing.assert_allclose(lines["threshold"][:, 1], 1.0)
    assert ("saturation" in lines) is near
    if near:
        np.testing.assert_allclose(lines["saturation"][:, 1], 1e-3 * well)
    np.testing.assert_allclose(lines["true position"][:, 0], 20.2)
    np.testing.assert_allclose(lines["detected position ± σ"][:, 0], 20.25)
    window, sigma = (patch.get_bbox().intervalx for patch in axes.patches)  # type: ignore[attr-defined]
    np.testing.assert_allclose(window, [16.5, 23.5])
    np.testing.assert_allclose(sigma, [20.23, 20.27])


@pytest.mark.parametrize(("truth", "reach"), [(20.2, 4.0 * 0.02), (20.0, 0.25)])
def test_the_corner_shows_detection_and_truth_apart(axes: Axes, truth: float, reach: float) -> None:
    """Claim: a bell of the detection's σ about it, and the truth where it lies from there; four σ or the truth in
    sight, and 15 % more; in the half where the spot is not; nothing without a σ."""
    axes.set_xlim(0.0, 63.0)
    voxel._detail(axes, seen_voxel(truth_peak_px=truth))
    (corner,) = axes.child_axes
    assert corner.get_xlim() == pytest.approx((-1.15 * reach, 1.15 * reach))
    np.testing.assert_allclose(corner.lines[1].get_xdata(), truth - 20.25, atol=1e-12)
    bell = corner.collections[0].get_paths()[0].vertices
    top = bell[bell[:, 1] > 1e-6]
    np.testing.assert_allclose(np.exp(-0.5 * (top[:, 0] / 0.02) ** 2), top[:, 1], atol=1e-9)
    voxel._detail(axes, seen_voxel(sigma_peak_px=math.nan))
    assert len(axes.child_axes) == 1
