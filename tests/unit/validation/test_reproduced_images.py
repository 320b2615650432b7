"""Figures of the Sun and of images as they are reproduced, from light and images that are made by hand."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawn import line
from made_benches import AGREES, ALIKE, CHOSEN, DIFFERS, UNPRINTED, drawn, verdicts
from scipy import constants
from scipy.integrate import quad
from scipy.special import erf
from scipy.stats import norm

from scanner_sim.validation.reproduce import images, sunlight
from scanner_sim.validation.reproduce.item import Task, Verdict


def planck(wavelength: float) -> float:
    """Return a black body of 5770 K of the Sun's size at its mean distance [W/m²/m]."""
    h, c, k = constants.h, constants.c, constants.k
    emitted = 2.0 * math.pi * h * c**2 / wavelength**5 / math.expm1(h * c / (wavelength * k * 5770.0))
    return emitted * (695_000e3 / 149.68e9) ** 2


def effective(width: float) -> float:
    """Return the irradiance in a band about 1.5 µm, and a share of all of it for what a filter lets through beside."""
    total = constants.Stefan_Boltzmann * 5770.0**4 * (695_000e3 / 149.68e9) ** 2
    return (
        quad(planck, 1.5e-6 - 0.5 * width, 1.5e-6 + 0.5 * width, epsrel=1e-10)[0]
        + sunlight.sun.BLOCKING * total
    )


def test_figure_16_is_the_black_bodys(task: Task, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: σT⁴ (R/D)² and Planck's law, by SciPy's constants; the radius as printed, a tenth, makes a hundredth."""
    made = sunlight.figure_16(task)
    rows = made.rows
    total = constants.Stefan_Boltzmann * 5770.0**4 * (695_000e3 / 149.68e9) ** 2
    assert (rows[0].expected, rows[0].found) == (f"{total:.1f}", f"{total:.1f}")
    assert rows[1].found == f"{0.01 * total:.2f} (no simulation)"
    assert (rows[2].expected, rows[2].found) == (
        f"{1e-9 * planck(1.5e-6):.4f}",
        f"{1e-9 * planck(1.5e-6):.4f}",
    )
    assert verdicts(rows) == [AGREES, DIFFERS, UNPRINTED, UNPRINTED]
    # Drawn over µm, in W/m²/nm: the Sun through the atmosphere and outside of it, and the black body.
    (axes,) = drawn(monkeypatch, sunlight, made)
    micrometres, body = line(axes, 2).T
    np.testing.assert_allclose(body, [1e-9 * planck(1e-6 * one) for one in micrometres], rtol=1e-4)
    below, above = line(axes, 0), line(axes, 1)
    assert (below[:, 1] <= above[:, 1] + 1e-3).mean() > 0.99
    # Within the visible part the Sun outside differs from the body by lines alone, and what is below has lost some.
    part = (above[:, 0] > 0.5) & (above[:, 0] < 0.7)
    assert np.median(above[part, 1] / body[part]) == pytest.approx(1.0, abs=0.1)
    assert np.median(below[part, 1] / above[part, 1]) < 0.95


@pytest.mark.parametrize(
    ("total", "line", "above", "expected"),
    [
        (1.0019, 1.0009, 0.2049, [AGREES, DIFFERS, UNPRINTED, UNPRINTED]),
        (0.9979, 1.0009, 0.2049, [DIFFERS, DIFFERS, UNPRINTED, UNPRINTED]),
        (1.0019, 0.9989, 0.1951, [AGREES, DIFFERS, DIFFERS, UNPRINTED]),
        (1.0019, 1.0009, 0.1949, [AGREES, DIFFERS, UNPRINTED, DIFFERS]),
        (1.0019, 1.0009, 0.2051, [AGREES, DIFFERS, UNPRINTED, DIFFERS]),
    ],
)
def test_figure_16_is_judged_by_its_numbers(
    task: Task,
    monkeypatch: pytest.MonkeyPatch,
    total: float,
    line: float,
    above: float,
    expected: list[Verdict],
) -> None:
    """Claim: 1353 W/m² to 0.2 %, 0.2487 W/m²/nm to 0.1 %; a spectrum that is a fifth above the black body within 10 nm
    of 1.5 µm, and ten times as bright beside, is a fifth above by its mean over 20 nm, to 0.5 % of the body."""
    wavelength = 1e-9 * np.arange(1480.0, 1521.0)
    outside = planck(1.5e-6) * np.where(np.abs(wavelength - 1.5e-6) < 10.1e-9, 1.2, 10.0)
    monkeypatch.setattr(
        sunlight.sun, "solar_spectra", lambda: SimpleNamespace(wavelength=wavelength, outside=outside)
    )
    monkeypatch.setattr(sunlight, "total_irradiance", lambda sun: 1353.0 * total)
    monkeypatch.setattr(sunlight, "solar_irradiance", lambda sun, at: 0.2487e9 * line)

    def between(sun: Any, low: float, high: float) -> float:
        assert sun.spectrum == "astm_g173"
        # 20 nm about the laser's line, in nanometres.
        assert (low, high) == (1.49e-6, 1.51e-6)
        return 0.2487 * line * (1.0 + above) * 20.0

    monkeypatch.setattr(sunlight, "irradiance_between", between)
    rows = sunlight.figure_16(task).rows
    assert verdicts(rows) == expected
    assert rows[3].expected == "20.0 %"
    assert rows[3].found == f"{100.0 * above:.1f} %"


def test_light_of_the_sun_is_asked_for_a_wall_that_faces_it(
    task: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: laser first, then the background, of one shot straight ahead at a wall of reflectance 0.5."""
    budget = SimpleNamespace(laser=np.array([3.0]), background=np.array([5.0]))
    group = SimpleNamespace(light=SimpleNamespace(link_budget=lambda: budget))
    asked = []

    def bench(task: Task, objects: Any, scanner: Any, **rest: Any) -> Any:
        asked.append((objects, scanner, rest))

        def expose(aim: Any) -> Any:
            assert (aim.theta.tolist(), aim.phi.tolist()) == ([0.0], [0.0])
            return None, [group]

        return SimpleNamespace(expose=expose)

    monkeypatch.setattr(sunlight, "bench", bench)
    assert sunlight.light_at(task, 7.0, 30e-9) == (3.0, 5.0)
    ((wall,), scanner, rest) = asked[0]
    assert (wall["position"], wall["material"]) == ((0.0, 0.0, 7.0), {"reflectance": 0.5})
    # Wide enough for what any pixel sees.
    assert min(wall["size"]) >= 2.0 * 7.0
    assert scanner["filter"] == {"bandwidth": 30e-9}
    assert not any(scanner["mirrors"].values())
    assert rest["lighting"] == {"sun": {"direction": (0.0, 0.0, -1.0)}}
    assert rest["transport"] == {"background_bounces": 1}


def lights(distance: float, width: float) -> tuple[float, float]:
    """Return light of laser and Sun by eqs 18 and 19, on a pixel 250 µm high that is 0.2 m beside the axis.

    The spot is the beam's image and a point spread of 40 µm; both lights fall by cos⁴ of the angle to the axis.
    """
    area, passed, grey, f = math.pi / 4.0 * 25e-3**2, 0.5, 0.5, 0.1
    fall = (distance / math.hypot(distance, 0.2)) ** 4
    radius = 2e-3 * math.sqrt(1.0 + (distance * 1.5e-6 / (math.pi * 4e-6)) ** 2)
    spot = math.hypot(f * 0.5 * radius / distance, 40e-6)
    share = erf(0.5 * 250e-6 / (math.sqrt(2.0) * spot))
    laser = grey * passed * area * 15e-3 / (math.pi * distance**2) * share * fall
    return laser, grey / math.pi * 200e-6 * 250e-6 / f**2 * area * passed * effective(width) * fall


GOOD = [UNPRINTED, AGREES, UNPRINTED, UNPRINTED, UNPRINTED, DIFFERS, AGREES, CHOSEN]


@pytest.mark.parametrize(
    ("laser", "at", "sun", "width", "power", "wrong"),
    [
        (1.009, 5.0, 1.009, 10e-9, 0.0, {}),
        (0.989, 5.0, 1.0, 10e-9, 0.0, {1: DIFFERS}),
        (1.012, 2.0, 1.0, 10e-9, 0.0, {1: DIFFERS}),
        (1.0, 5.0, 1.012, 10e-9, 0.0, {2: DIFFERS}),
        (1.0, 5.0, 0.988, 50e-9, 0.0, {4: DIFFERS}),
        # The exponent over 10 and 20 m.
        (2.0**0.019, 20.0, 1.0, 10e-9, 0.0, {1: DIFFERS}),
        (2.0**0.021, 20.0, 1.0, 10e-9, 0.0, {1: DIFFERS, 6: DIFFERS}),
        (2.0**-0.021, 20.0, 1.0, 10e-9, 0.0, {1: DIFFERS, 6: DIFFERS}),
        # As the print has it: π times the sunlight.
        (1.0, 5.0, math.pi, 30e-9, 0.0, {3: DIFFERS, 5: AGREES, 7: DIFFERS}),
        (1.0, 5.0, 1.0, 30e-9, 0.023, {0: DIFFERS, 1: DIFFERS}),
    ],
)
def test_figure_17_is_judged_by_eqs_18_and_19(
    task: Task,
    monkeypatch: pytest.MonkeyPatch,
    laser: float,
    at: float,
    sun: float,
    width: float,
    power: float,
    wrong: dict[int, Verdict],
) -> None:
    """Claim: light by both equations, here by SciPy's constants and integrals, is theirs to 1 %; the exponent of their
    ratio may be 0.02 beside −2. With the width of 30 nm they are alike at 20 m, where the Sun is as told."""

    def found(task: Task, distance: float, band: float) -> tuple[float, float]:
        one, other = lights(distance, band)
        one *= (laser if distance == at else 1.0) * (1.0 + power)
        return one, other * (sun if band == width else 1.0)

    monkeypatch.setattr(sunlight, "light_at", found)
    made = sunlight.figure_17(task)
    rows = made.rows
    expected = [wrong.get(number, verdict) for number, verdict in enumerate(GOOD)]
    told = verdicts(rows)
    assert told == expected
    area = math.pi / 4.0 * 25e-3**2
    assert rows[0].expected == f"{1e9 * 0.25 * area * 15e-3 / (math.pi * 100.0):.2f}"
    if laser == 1.0 and not power:
        assert rows[0].found == f"{1e9 * lights(10.0, 30e-9)[0]:.2f}"
        equal = math.sqrt(15e-3 * 0.01 / (200e-6 * 250e-6 * effective(30e-9)))
        assert rows[7].expected == f"{equal:.1f} m"
    # Their ratio falls as R²: they are alike where it is one by what is found at the farthest.
    one, other = lights(20.0, 30e-9)
    one *= (laser if at == 20.0 else 1.0) * (1.0 + power)
    other *= sun if width == 30e-9 else 1.0
    assert rows[7].found == f"{20.0 * math.sqrt(one / other):.1f} m"
    if not wrong:
        assert rows[5].found == f"{1.0 / math.pi:.3f}"
        assert rows[2].found == "1.0090"
    # Drawn for each filter: the ratio by both equations, π times less as printed, and dots of what was found.
    (axes,) = drawn(monkeypatch, sunlight, made)
    for number, band in enumerate(sunlight._BANDWIDTHS):
        away, law = line(axes, 3 * number).T
        np.testing.assert_allclose(
            law, 15e-3 * 0.01 / (200e-6 * 250e-6 * effective(band) * away**2), rtol=1e-4
        )
        np.testing.assert_allclose(line(axes, 3 * number + 1)[:, 1], law / math.pi, rtol=1e-9)
        for distance, ratio in line(axes, 3 * number + 2):
            one, other = found(task, float(distance), band)
            assert ratio == pytest.approx(one / other)


class Picture(dict[str, Any]):
    """Layers of an image, and which of its voxels have a range."""

    def __init__(self, layers: dict[str, Any], valid: Any, materials: Any = ()) -> None:
        super().__init__(layers)
        self.valid, self.materials = np.asarray(valid, dtype=bool), list(materials)
        self.theta: Any = None


@pytest.mark.parametrize(
    ("scale", "verdict"), [(1.0, UNPRINTED), (1.052, UNPRINTED), (1.053, DIFFERS), (0.949, DIFFERS)]
)
def test_figure_2_is_judged_by_the_median_of_errors_over_sigma(
    task: Task, monkeypatch: pytest.MonkeyPatch, scale: float, verdict: Verdict
) -> None:
    """Claim: half of normal errors are within 0.6745 σ, here from SciPy's quantiles, which may be a twentieth off; nine
    tenths of what is hit must have a range, or there is no whole picture."""
    size = 1000
    normal = norm.ppf((np.arange(size) + 0.5) / size)
    sigma = np.linspace(1e-3, 2e-3, size)
    valid = np.arange(size + 200) < size
    layers = {
        "range_m": np.append(10.0 + scale * normal * sigma, np.full(200, 99.0)),
        "truth.range_m": np.full(size + 200, 10.0),
        "sigma_range_m": np.append(sigma, np.full(200, 1e-9)),
        "truth.object": np.append(np.ones(size), np.zeros(200)),
    }
    asked = []
    monkeypatch.setattr(images, "load_scenario", lambda path, changes: asked.append((path.stem, changes)))
    monkeypatch.setattr(images, "simulate", lambda scenario, device: Picture(layers, valid))
    whole, median = images.figure_2a(task).rows
    assert (whole.found, whole.verdict) == ("100.0 %", ALIKE)
    assert median.verdict is verdict
    ratio = scale * norm.ppf(0.75)
    error = 1e3 * float(np.median(np.abs(scale * normal * sigma)))
    assert median.expected == f"{norm.ppf(0.75):.3f}" == "0.674"
    assert median.found == f"{ratio:.3f}; median error {error:.2f} mm"
    layers["truth.object"][size : size + 111] = 1.0
    assert images.figure_2a(task).rows[0].verdict is ALIKE
    layers["truth.object"][size : size + 112] = 2.0
    assert images.figure_2a(task).rows[0].verdict is DIFFERS
    (only,) = images.figure_2b(task).rows
    assert only == median
    sized = [[f"scan.rows={n}", f"scan.columns={n}", "scan.motion=stepped"] for n in (192, 160)]
    assert asked[0] == ("node_512", sized[0])
    assert asked[-1] == ("tof_node", sized[1])
    drawn: list[str] = []
    monkeypatch.setattr(images, "draw_picture", lambda image, name, path: drawn.append(name))
    for figure in (images.figure_2a, images.figure_2b):
        draw = figure(task).draw
        assert draw is not None
        draw(Path("figure.png"))
    # The paper's are grey: slopes by triangulation, ranges by time of flight.
    assert drawn == ["shaded.png", "tof.png"]


@pytest.mark.parametrize(
    ("white", "black", "kept", "expected"),
    [
        (51, 1001, 951, [ALIKE] * 6),
        (50, 1001, 951, [DIFFERS, *[ALIKE] * 5]),
        (51, 1000, 951, [ALIKE, DIFFERS, *[ALIKE] * 4]),
        (51, 1001, 950, [ALIKE, ALIKE, ALIKE, DIFFERS, ALIKE, ALIKE]),
    ],
)
def test_figure_1_is_judged_by_shares(
    task: Task, monkeypatch: pytest.MonkeyPatch, white: int, black: int, kept: int, expected: list[Verdict]
) -> None:
    """Claim: of 10 000 pixels more than 0.5 % are white before the brighter of two lights, more than a tenth black, 3
    or less, under cast shadows; of 1000 ranges in the dark on the same object more than 95 % are kept."""
    hidden = 50
    asked: list[tuple[str, Any]] = []

    def scenario(path: Path, changes: Any) -> str:
        asked.append((path.stem, changes))
        return path.stem

    def photo(name: str, device: str) -> Any:
        values = np.full(10_000, 100)
        values[: {"lighting_back": white, "lighting_saturation": 7}.get(name, 0)] = 255
        values[: {"lighting_partial_shadow": black}.get(name, 0)] = 3
        values[-900:] = 4
        return values.reshape(100, 100)

    def image(name: str, device: str) -> Picture:
        count = kept if name == "lighting_saturation" else 1000
        # Beside the thousand: other objects are hit there, or there was no range in the dark.
        valid = np.arange(1000 + hidden) < (1000 + hidden if name == "lighting_dark" else count)
        own = np.zeros(1000 + hidden)
        own[1000:] = 0.0 if name == "lighting_dark" else 5.0
        return Picture({"truth.object": own}, valid)

    monkeypatch.setattr(images, "load_scenario", scenario)
    monkeypatch.setattr(images, "take_photo", photo)
    monkeypatch.setattr(images, "simulate", image)
    made = images.figure_1(task)
    rows = made.rows
    assert verdicts(rows) == expected
    panels = drawn(monkeypatch, images, made)
    for panel, (name, words) in zip(panels, images._PHOTOS.items(), strict=True):
        np.testing.assert_array_equal(panel.images[0].get_array(), photo(name, "cpu"))
        assert panel.images[0].get_clim() == (0, 255)
        assert panel.get_title() == words
    assert rows[0].found == f"{white / 100.0:.1f} % (the Sun in the field of view)"
    assert rows[1].found == f"{black / 100.0:.0f} %"
    assert [row.found for row in rows[2:]] == ["100.0 %", f"{kept / 10.0:.1f} %", "100.0 %", "100.0 %"]
    frames = [changes for _, changes in asked if changes[0].startswith("camera")]
    # The same field and as much light for each area as the shipped pixels of 10 µm, which hold 40 000.
    for frame in frames:
        told = dict(change.rsplit(".", 1)[1].split("=") for change in frame)
        pitch = float(told["pixel_pitch"].removesuffix(" um"))
        assert (int(told["columns"]) * pitch, int(told["rows"]) * pitch) == (6400.0, 4800.0)
        assert float(told["full_well"].removesuffix(" electron")) == pytest.approx(
            40_000.0 * (pitch / 10.0) ** 2
        )
    assert len(frames) == 4
    others = {tuple(changes) for _, changes in asked if not changes[0].startswith("camera")}
    assert others == {
        ("scan.rows=32", "scan.columns=32", "scan.motion=stepped", "transport.background_samples=2")
    }


@pytest.mark.parametrize(
    ("snr", "kept", "moved", "expected"),
    [
        ((1.11, 0.99), (91, 50, 51), 0, [UNPRINTED, ALIKE, ALIKE, ALIKE, UNPRINTED, UNPRINTED]),
        ((1.112, 1.01), (90, 50, 50), 1, [DIFFERS, DIFFERS, DIFFERS, ALIKE, DIFFERS, DIFFERS]),
        ((0.901, 0.5), (91, 91, 95), 0, [UNPRINTED, ALIKE, ALIKE, DIFFERS, UNPRINTED, UNPRINTED]),
        ((0.899, 0.5), (91, 50, 60), 0, [DIFFERS, ALIKE, ALIKE, ALIKE, UNPRINTED, UNPRINTED]),
    ],
)
def test_figure_18_is_judged_on_the_lit_white(
    task: Task, monkeypatch: pytest.MonkeyPatch, snr: Any, kept: Any, moved: int, expected: list[Verdict]
) -> None:
    """Claim: P f²/(R² S E) at 8 m, over cos 53.13° = 0.6 of the Sun, to 10 % of the median of white that is lit by more
    than half of the brightest; nine tenths of 100 voxels hit; six σ from the dark, one of a hundred is too many."""
    wanted = 15e-3 * 0.01 / (64.0 * 5e-8 * effective(30e-9)) / 0.6
    voxels = np.arange(120).reshape(10, 12).T
    asked = []

    def scenario(path: Path, changes: Any) -> Any:
        asked.append((path.stem, changes))
        if "lighting={}" in changes:
            return "dark"
        if "scanner.laser_off=0.5" in changes:
            return "off"
        return "no filter" if path.stem.endswith("no_filter") else "filter"

    def image(name: str, device: str) -> Picture:
        which = ("filter", "no filter", "off").index(name) if name != "dark" else 0
        ratio = (wanted * snr[0], snr[1], 3.0)[which]
        # 0 to 29 white and lit, 30 to 59 white in the shadow, 60 to 99 black, the rest of another object.
        own = np.where(voxels < 30, ratio, 77.0)
        shift = np.where(voxels < moved * (name == "no filter"), 6.01e-3, 5.99e-3)
        layers = {
            "truth.object": np.where(voxels < 100, 1, 2),
            "truth.material": np.where(voxels < 60, 3, 1),
            "background": np.where(
                voxels < 30, np.where(voxels == 3, 9.9, 5.0), np.where(voxels < 60, 4.9, 99.0)
            ),
            "snr": own,
            "range_m": 8.0 + (0.0 if name == "dark" else shift),
            "sigma_range_m": np.full((12, 10), 1e-3),
            "Y": 1e6 * (voxels + which) if name != "dark" else None,
        }
        valid = np.ones((12, 10)) if name == "dark" else voxels < kept[which]
        made = Picture(layers, valid, ["black", "grey", "target_white"])
        made.theta = np.linspace(-0.1, 0.1, 10)
        return made

    monkeypatch.setattr(images, "load_scenario", scenario)
    monkeypatch.setattr(images, "simulate", image)
    made = images.figure_18(task)
    rows = made.rows
    assert verdicts(rows) == expected
    # Drawn are laser and Sun together, and across the row that has an eighth of all lit ones above it, here the second
    # of twelve, both and sunlight alone in 10⁶ electrons.
    *shown, across = drawn(monkeypatch, images, made)
    for which, panel in enumerate(shown):
        layers = image(("filter", "no filter")[which], "cpu")
        total = layers["Y"] + layers["background"]
        np.testing.assert_allclose(panel.images[0].get_array(), total)
        np.testing.assert_allclose(line(panel, 0)[:, 1], 1.0)
        degrees = np.degrees(np.linspace(-0.1, 0.1, 10))
        np.testing.assert_allclose(line(across, 2 * which), np.stack([degrees, 1e-6 * total[1]], axis=1))
        alone = np.stack([degrees, 1e-6 * layers["background"][1]], axis=1)
        np.testing.assert_allclose(line(across, 2 * which + 1), alone)
    assert rows[0].expected == f"{wanted:.1f} (eqs 18, 19; the Sun at 53°)"
    assert [row.found for row in rows[:2]] == [f"{wanted * snr[0]:.1f}", f"{snr[1]:.2f}"]
    assert [row.found for row in rows[2:4]] == [f"{kept[0]:.1f} %", f"{kept[1]:.1f} %"]
    assert rows[4].found == f"0.00 %, {100.0 * moved / kept[1]:.2f} %"
    assert rows[5].found == f"{kept[2]:.1f} % kept"
    assert [name for name, _ in asked] == [
        "lighting_worst_case", "lighting_worst_case_no_filter", "lighting_worst_case_no_filter", "lighting_worst_case",
    ]  # fmt: skip
    assert all("scanner.laser_off=0" in changes for _, changes in asked)
