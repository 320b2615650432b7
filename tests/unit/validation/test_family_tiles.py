"""The ledger's experiments on edges and tiles, on instruments that answer by a law."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn import bars, line
from made_benches import Array, Benches, drawn, quick_task
from matplotlib.figure import Figure
from scipy.stats import norm

from scanner_sim.config import load_scanner
from scanner_sim.validation.reproduce.family import edges, tiles
from scanner_sim.validation.reproduce.item import Verdict

TASK = quick_task()
UNPRINTED, DIFFERS, AGREES = Verdict.UNPRINTED, Verdict.DIFFERS, Verdict.AGREES


class Edges:
    """Views of edges whose line spread is known: wider by turns, block of rows by block."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, wider: Mapping[int, float]) -> None:
        self.views: list[Any] = []
        self.objects: list[Any] = []

        def layers(view: Any, task: Any, objects: Any, instrument: str, step: int) -> Any:
            self.views.append(view)
            self.objects.append(objects)
            laser = load_scanner(instrument).laser
            way = (
                (view.distance - laser.waist_distance) * laser.wavelength / (math.pi * laser.waist_radius**2)
            )
            # The light of a Gaussian beam of radius w has σ = w/2.
            sigma = 0.5 * laser.waist_radius * math.sqrt(1.0 + way**2)
            x = (np.arange(view.columns) - view.columns // 2) * view.pitch
            block = (np.arange(view.rows) // 16 % 3 - 1) * 0.01
            own = sigma * wider.get(step, 1.0) * (1.0 + block[:, None])
            # An edge a little beside the middle, from 5 to 80 units.
            return {"Y": 5.0 + 75.0 * norm.cdf((x - 0.3 * sigma) / own)}

        monkeypatch.setattr(edges.View, "layers", layers)


@pytest.mark.parametrize(
    ("wider", "verdict"), [(1.04, UNPRINTED), (1.05, DIFFERS), (0.96, UNPRINTED), (0.95, DIFFERS)]
)
def test_edges_have_the_width_of_the_beam(
    monkeypatch: pytest.MonkeyPatch, wider: float, verdict: Verdict
) -> None:
    """Claim: full widths at half maximum, 2.3548 σ, of blocks of 16 rows whose line spreads are 0.99, 1 and 1.01 of the
    beam's: their mean, with the standard error of three. Four of these and 2 % are granted at each of the ranges. What
    is judged is the width where the beam is narrowest, be another one found to be narrower or not."""
    made = Edges(monkeypatch, {2: wider})
    found = edges.lateral(TASK, "nrc_2000")
    laser = load_scanner("nrc_2000").laser
    distances = np.linspace(1.6, 4.0, 4)
    way = (distances - laser.waist_distance) * laser.wavelength / (math.pi * laser.waist_radius**2)
    widths = 2.0 * math.sqrt(2.0 * math.log(2.0)) * 0.5 * laser.waist_radius * np.sqrt(1.0 + way**2)
    assert found.finding.value == pytest.approx(1e3 * widths.min(), rel=1e-5)
    assert found.finding.error == pytest.approx(1e3 * 0.01 * widths.min() / math.sqrt(3.0), rel=1e-4)
    assert found.rows[0].verdict is verdict
    assert found.rows[0].expected == f"{1e3 * widths.min():.3g} to {1e3 * widths.max():.3g} mm"
    # Drawn is the beam's own width, and what was found with three standard errors [mm].
    (axes,) = drawn(monkeypatch, edges, found)
    np.testing.assert_allclose(line(axes, 0), np.stack([distances, 1e3 * widths], axis=1), rtol=1e-5)
    (band,) = axes.patches
    low, high = band.get_extents().transformed(axes.transData.inverted()).intervaly
    assert (low, high) == pytest.approx((0.35, 0.5))
    ((_, marks, ends),) = bars(axes)
    own = 1e3 * widths * np.array([1.0, 1.0, wider, 1.0])
    np.testing.assert_allclose(marks, np.stack([distances, own], axis=1), rtol=1e-4)
    np.testing.assert_allclose(
        ends - marks[:, 1:], 3.0 * 0.01 / math.sqrt(3.0) * own[:, None] * [-1.0, 1.0], rtol=1e-3
    )
    assert [view.distance for view in made.views] == pytest.approx(distances)
    for view, width, objects in zip(made.views, widths, made.objects, strict=True):
        assert view.pitch == pytest.approx(width / 18.0)
        assert view.apart == pytest.approx(min(2.0 * width, 0.25 * view.distance / 48.0))
        dark, bright = objects
        assert (dark["material"], bright["material"]) == ({"reflectance": 0.05}, {"reflectance": 0.8})
        # Both meet in the middle and fill the view.
        half = 0.5 * dark["size"][0]
        assert (dark["position"][0], bright["position"][0]) == pytest.approx((-half, half))
        assert half > 0.5 * view.rows * view.apart + 5.0 * width


def test_only_diffraction_widens_a_beam(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the mean over three ranges of found over ideal widths, and its standard error; close by in µm, with the
    beam's focus among the ranges."""
    Edges(monkeypatch, {0: 1.02, 1: 1.05, 2: 1.11})
    found = edges.diffraction(TASK, "nrc_2000").finding
    assert found.value == pytest.approx(1.06, rel=1e-5)
    own = 0.01 / math.sqrt(3.0) * np.array([1.02, 1.05, 1.11])
    assert found.error == pytest.approx(math.sqrt(np.sum(own**2)) / 3.0, rel=1e-4)
    made = Edges(monkeypatch, {})
    focus = load_scanner("close_range_scanner").laser
    found = edges.close_lateral(TASK, "close_range_scanner").finding
    assert [view.distance for view in made.views] == pytest.approx(
        sorted([0.35, 0.65, 0.95, focus.waist_distance])
    )
    assert found.value == pytest.approx(1e6 * 1.17741 * focus.waist_radius, rel=1e-4)
    assert found.error == pytest.approx(1e6 * 1.17741 * focus.waist_radius * 0.01 / math.sqrt(3.0), rel=1e-3)


def test_a_view_is_a_raster_on_the_tile(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: columns lie ``pitch`` apart and rows ``apart``, about the middle voxel, at the tile's range."""
    view = tiles.View(4.0, 1e-3, 3e-3, 5, 7)
    benches = Benches(monkeypatch, tiles, lambda made, shots: {"Y": shots.theta + 100.0 * shots.phi})
    found = view.layers(TASK, [{"position": (0.0, 0.0, 4.0)}], "nrc_2000", 3)["Y"]
    assert found.shape == (5, 7)
    across, down = np.arange(-3, 4) * 1e-3 / 4.0, np.arange(-2, 3) * 3e-3 / 4.0
    np.testing.assert_allclose(found, across[None, :] + 100.0 * down[:, None], atol=1e-15)
    assert (benches.asked[0].step, benches.asked[0].scanner) == (3, {"preset": "nrc_2000"})


def test_a_crack_is_a_gap_of_its_width_with_a_floor_below() -> None:
    """Claim: two halves at 4 m whose sides are a width apart, 10 mm thick, and a floor 10 mm below their face."""
    left, right, floor = tiles._cracked(0.4e-3)
    for side, box in ((-1.0, left), (1.0, right)):
        (x, y, z), (width, height, depth) = box["position"], box["size"]
        assert y == 0.0
        assert side * x - 0.5 * width == pytest.approx(0.2e-3)
        assert (z - 0.5 * depth, z + 0.5 * depth) == pytest.approx((4.0, 4.01))
        assert (width, height) == pytest.approx((0.4, 0.4))
        assert box["material"] == {"reflectance": 0.5}
    assert floor["position"] == pytest.approx((0.0, 0.0, 4.01))
    assert floor["size"] == pytest.approx((0.2, 0.4))


def test_the_narrowest_crack_is_the_mean_of_the_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a crack that is seen as c width is at the criterion 5 where width = 5/c; three runs of different c, the
    better of signal and range counts."""
    widths = np.geomspace(0.08e-3, 0.8e-3, 4)
    steps = []

    def layers(view: Any, task: Any, objects: Any, instrument: str, step: int) -> Any:
        steps.append(step)
        assert (view.distance, view.pitch, view.apart, view.columns) == (4.0, 0.35e-3, 0.35e-3, 161)
        run, number = divmod(step, 4)
        left, right = (one["position"][0] for one in objects[:2])
        assert right - left - 0.4 == pytest.approx(widths[number])
        seen = widths[number] * (2e4, 2.5e4, 1e4)[run]
        return {"Y": seen, "range_m": 0.5 * seen} if run else {"Y": 0.5 * seen, "range_m": seen}

    monkeypatch.setattr(tiles.View, "layers", layers)
    monkeypatch.setattr(tiles, "_visibility", lambda image: image)
    made = tiles.crack(TASK, "nrc_2000")
    found = made.finding
    each = 5e3 / np.array([2e4, 2.5e4, 1e4])
    assert steps == list(range(12))
    assert (found.value, found.error) == pytest.approx((each.mean(), each.std(ddof=1) / math.sqrt(3.0)))
    # Drawn is how well each crack was seen, by width [mm], a dot for each run.
    monkeypatch.setattr(tiles, "sheet", lambda path, title, about, draw, *_, **__: draw([axes, other]))
    axes, other = Figure().subplots(1, 2)
    monkeypatch.setattr(other, "imshow", lambda image, **_: asked.append(image))
    monkeypatch.setattr(other.figure, "colorbar", lambda *_, **__: None)
    asked: list[Any] = []
    assert made.draw is not None
    made.draw(Path())
    seen = np.array([2e4, 2.5e4, 1e4])[:, None] * widths
    for run in range(3):
        np.testing.assert_allclose(line(axes, run), np.stack([1e3 * widths, seen[run]], axis=1))
    assert asked == [pytest.approx(1e4 * widths[-1])]


@pytest.mark.parametrize(("off", "verdict"), [(3.9, UNPRINTED), (4.1, DIFFERS)])
def test_a_dent_errs_by_its_root_mean_square(
    monkeypatch: pytest.MonkeyPatch, off: float, verdict: Verdict
) -> None:
    """Claim: of four runs about a depth of 5 mm that scatter by 0.1 mm: √(mean² + scatter²) with one over √8 of it; the
    mean may be four standard errors off, and 10 µm."""
    scatter = np.array([1.0, -1.0, 1.0, -1.0]) * 1e-4
    standard = scatter.std(ddof=1) / 2.0
    mean = off * standard + 1e-5 if off > 4.0 else off * standard
    depths = iter(5e-3 + mean + scatter)
    runs = []

    def layers(view: Any, task: Any, objects: Any, instrument: str, step: int) -> Any:
        runs.append(step)
        assert objects[0]["position"] == (0.0, 0.0, 4.0)
        assert (view.distance, view.pitch, view.rows, view.columns) == (4.0, 3e-3, 40, 40)
        x, y = np.meshgrid(np.arange(40.0), np.arange(40.0))
        return {"P.X": x, "P.Y": y, "P.Z": x + 7.0 * y}

    def depth(x: Array, y: Array, z: Array) -> float:
        np.testing.assert_array_equal(z, x + 7.0 * y)
        assert x.shape == (1600,)
        return float(next(depths))

    monkeypatch.setattr(tiles.View, "layers", layers)
    monkeypatch.setattr(tiles, "_fitted_depth", depth)
    found = tiles.dent(TASK, "nrc_2000")
    size = 1e3 * math.hypot(mean, 1e-4)
    assert (found.finding.value, found.finding.error) == pytest.approx((size, size / math.sqrt(8.0)))
    assert found.rows[0].found == f"{1e3 * mean:+.3f} ± {3e3 * standard:.3f} mm"
    assert found.rows[0].verdict is verdict
    assert runs == [0, 1, 2, 3]
    surface, shown = drawn(monkeypatch, tiles, found)[:2]
    dots, truth = shown.lines
    np.testing.assert_allclose(
        dots.get_xydata(), np.stack([[1, 2, 3, 4], 1e3 * (5e-3 + mean + scatter)], axis=1)
    )
    np.testing.assert_allclose(truth.get_ydata(), 5.0)
    # Of the tile less its distance, in mm.
    assert surface.images[0].get_array()[3, 5] == pytest.approx(1e3 * (5.0 + 7.0 * 3.0 - 4.0))


def test_a_dents_depth_is_found_wherever_it_lies() -> None:
    """Claim: 3.2 mm of a cap of a sphere with a rim of 41 mm, aside of the middle, in a plane askew about both axes,
    with what was not seen left out: exact points give the exact depth."""
    x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(-0.06, 0.06, 41)]))
    depth, rim, aside = 3.2e-3, 41e-3, (9e-3, -6e-3)
    radius = (rim**2 + depth**2) / (2.0 * depth)
    away = np.hypot(x - aside[0], y - aside[1])
    cap = depth - radius + np.sqrt(np.maximum(radius**2 - away**2, 0.0))
    z = 4.0 + 0.03 * x - 0.05 * y + np.where(away < rim, cap, 0.0)
    z[::17] = np.nan
    assert tiles._fitted_depth(x, y, z) == pytest.approx(depth, rel=1e-3)
