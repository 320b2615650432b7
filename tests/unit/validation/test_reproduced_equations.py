"""Equations 1 to 5 as they are reproduced: what is found in ranges that are made by hand, and where verdicts turn."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from drawn import bars, line
from made_benches import AGREES, CHOSEN, DIFFERS, UNPRINTED, Benches, drawn, quick_task, signs, verdicts
from numpy.typing import NDArray

from scanner_sim.validation.reproduce import ranging
from scanner_sim.validation.reproduce.item import Verdict

Array = NDArray[np.float64]

TASK = quick_task()
F, D, G, PITCH = 0.1, 0.2, 0.05, 50e-6
"""Focal length, base, separation of the mirrors and pitch of the preset [m]."""


def place_of(R: Array, theta: Array) -> Array:
    """Return p of eq 1 [m], solved for it."""
    return F * D * np.cos(theta) / (R - D * np.sin(theta))


@pytest.mark.parametrize(
    ("pixels", "metres", "nearest", "expected"),
    [
        (0.0098, 4.9e-6, 1.5625, [AGREES, UNPRINTED, CHOSEN]),
        (0.0102, 4.9e-6, 1.5625, [DIFFERS, UNPRINTED, CHOSEN]),
        (0.0098, 5.1e-6, 1.5625, [AGREES, DIFFERS, CHOSEN]),
        (0.0098, 4.9e-6, 1.5626, [AGREES, UNPRINTED, DIFFERS]),
    ],
)
def test_equation_1_is_judged_by_spots_and_ranges(
    monkeypatch: pytest.MonkeyPatch, pixels: float, metres: float, nearest: float, expected: list[Verdict]
) -> None:
    """Claim: spots may be a hundredth of a pixel beside eq 1, the middle of pixel n lying at (n + 1/2) of them; ranges
    5e-6 R², half a millimetre at 10 m; what is not seen does not count. The nearest range is that of p = 12.8 mm."""

    def law(made: Any, shots: Any) -> dict[str, Array]:
        R = made.distance / np.cos(shots.theta)
        peak = (place_of(R, shots.theta) / PITCH - 0.5) + pixels * np.where(np.arange(R.size) % 3, 1.0, -1.0)
        peak[4] = math.nan
        return {"peak_px": peak, "truth.range_m": R, "range_m": R + metres * R**2}

    benches = Benches(monkeypatch, ranging, law, nearest)
    made = ranging.eq1(TASK)
    rows = made.rows
    assert verdicts(rows) == expected
    assert rows[0].found == f"{pixels:.4f} pixel"
    assert rows[1].found == f"{1e5 * metres:.2f} mm"
    assert (rows[2].expected, rows[2].found) == ("1.56 m", f"{nearest:.2f} m")
    plates = benches.asked[:-2]
    assert (plates[0].distance, plates[-1].distance) == pytest.approx((1.8, 40.0))
    assert all(not made.scanner["laser"]["speckle"] for made in plates)
    assert not any(any(made.scanner["position_sensor"]["noise"].values()) for made in plates)
    assert not any(any(made.scanner["mirrors"].values()) for made in plates)
    for shots in benches.shots:
        np.testing.assert_allclose(shots.theta, np.arange(-4, 5) * 0.1125, atol=1e-12)
        np.testing.assert_allclose(shots.phi, 0.2)
    # Drawn are eq 1 and the spots [mm] at both ends of the field and in its middle, what was not seen left out; and by
    # how many thousandths of a pixel each spot lies beside it.
    places, beside = drawn(monkeypatch, ranging, made)
    distances = np.array([one.distance for one in plates])
    for number, theta in enumerate((-0.45, 0.0, 0.45)):
        fine, curve = line(places, 2 * number).T
        np.testing.assert_allclose(curve, 1e3 * place_of(fine, np.full(fine.size, theta)))
        away, spot = line(places, 2 * number + 1).T
        np.testing.assert_allclose(away, distances / math.cos(theta))
        if theta == 0.0:
            assert np.isnan(spot).all()
        else:
            # Of each three in a row the first lies to one side, the others to the other.
            off = pixels * (1.0 if theta > 0.0 else -1.0)
            np.testing.assert_allclose(spot, 1e3 * (place_of(away, np.full(away.size, theta)) + off * PITCH))
    assert line(beside, 0).shape == (8 * len(plates), 2)
    np.testing.assert_allclose(np.abs(line(beside, 0)[:, 1]), 1e3 * pixels, rtol=1e-6)


@pytest.mark.parametrize(
    ("off", "wide", "far", "expected"),
    [
        (3.9, 3.9, 1.9, [AGREES, CHOSEN, UNPRINTED]),
        (-4.1, 3.9, 1.9, [DIFFERS, CHOSEN, UNPRINTED]),
        (3.9, -4.1, 1.9, [AGREES, CHOSEN, DIFFERS]),
        (3.9, 3.9, 2.1, [AGREES, DIFFERS, UNPRINTED]),
    ],
)
def test_equation_2_is_judged_by_standard_errors(
    monkeypatch: pytest.MonkeyPatch, off: float, wide: float, far: float, expected: list[Verdict]
) -> None:
    """Claim: of n² = 100 delays a mean errs by σ/n and σ by σ/√(2 n²); four of each are granted at the worst of five
    distances, and σ may double within 30 m. Farther away it may be anything that its closed form has."""
    n, base = 10, 2e-3
    distances = np.geomspace(2.0, 100.0, 5)
    closed = dict(zip(distances.tolist(), base * np.array([1.0, 1.0, far, 9.0, 9.0]), strict=True))
    found = closed | {distances[3]: 9.0 * base * (1.0 + wide / math.sqrt(2.0 * n**2))}

    def law(made: Any, shots: Any) -> dict[str, Array]:
        assert made.rest["ranging"] == "tof"
        assert made.scanner["lidar"] == {"digitiser": {"gate": (0.5, 130.0)}}
        sigma = found[made.distance]
        mean = off * sigma / n if made.step == 1 else 0.0
        truth = np.full(shots.shot.size, made.distance)
        return {"range_m": truth + mean + sigma * signs(shots), "truth.range_m": truth}

    benches = Benches(monkeypatch, ranging, law)
    monkeypatch.setattr(
        ranging, "closed_budget", lambda _, reflectance, R: {"tof": {"all": closed[R] * 2.0 * reflectance}}
    )
    made = ranging.eq2(TASK)
    rows = made.rows
    assert [made.distance for made in benches.asked] == pytest.approx(list(distances))
    assert all(shots.shot.size == n**2 for shots in benches.shots)
    assert verdicts(rows) == expected
    assert rows[0].found == f"{1e3 * off * base / n:+.2f} mm, {abs(off):.1f} standard errors"
    assert rows[1].expected == "2.0 to 18.0 mm"
    assert rows[2].found == f"{1.0 + wide / math.sqrt(200.0):.3f}, {abs(wide):.1f} standard errors"
    # Drawn are delays [ns] on eq 2, and what means err by [mm] with two standard errors.
    delays, means = drawn(monkeypatch, ranging, made)
    sigma = np.array([found[R] for R in distances.tolist()])
    mean = np.where(np.arange(5) == 1, off * sigma / n, 0.0)
    np.testing.assert_allclose(
        line(delays, 0), np.stack([distances, (distances + mean) / 0.149896229], axis=1)
    )
    fine, law_line = line(delays, 1).T
    np.testing.assert_allclose(law_line, fine / 0.149896229)
    ((_, marks, ends),) = bars(means)
    np.testing.assert_allclose(marks, np.stack([distances, 1e3 * mean], axis=1), atol=1e-9)
    np.testing.assert_allclose(ends - marks[:, 1:], 2e3 * sigma[:, None] / n * [-1.0, 1.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("across", "along", "separation", "expected"),
    [
        (1.9e-6, 0.0, 1.0, [AGREES, UNPRINTED, AGREES]),
        (2.1e-6, 0.0, 1.0, [DIFFERS, UNPRINTED, AGREES]),
        (0.0, 0.19e-3, 1.0, [DIFFERS, UNPRINTED, AGREES]),
        (0.0, 0.21e-3, 1.0, [DIFFERS, DIFFERS, AGREES]),
        (0.0, 0.0, 1.019, [DIFFERS, UNPRINTED, AGREES]),
        (0.0, 0.0, 1.021, [DIFFERS, UNPRINTED, DIFFERS]),
    ],
)
def test_equation_3_is_judged_by_points(
    monkeypatch: pytest.MonkeyPatch, across: float, along: float, separation: float, expected: list[Verdict]
) -> None:
    """Claim: the beam leaves the second mirror, D_g below the first one's image, so that x = R sinΘ, and y and z are
    the rest of R less D_g turned by φ, with D_g added to z. Points may be 2 µm beside it; a plane 0.2 mm uneven.
    Without D_g points of φ = 0.45 are 2 D_g sin(φ/2) = 22.3 mm off, of which 2 % are granted."""

    def law(made: Any, shots: Any) -> dict[str, Array]:
        own = G * separation
        # The range to a plane at z = 8 m.
        R = ((8.0 - G) / np.cos(shots.phi) + G) / np.cos(shots.theta)
        arm = R * np.cos(shots.theta) - own
        return {
            "range_m": R,
            "P.X": R * np.sin(shots.theta) + across * signs(shots),
            "P.Y": arm * np.sin(shots.phi),
            "P.Z": own + arm * np.cos(shots.phi) + along * signs(shots),
        }

    benches = Benches(monkeypatch, ranging, law)
    rows = ranging.eq3(TASK).rows
    assert verdicts(rows) == expected
    assert benches.asked[0].distance == 8.0
    if separation == 1.0:
        assert rows[0].found == f"{1e6 * max(across, along):.3f} µm"
        assert rows[1].found == f"{1e3 * along:.3f} mm"
        assert rows[2].expected == "22.3 mm at any range"
    if not along:
        assert rows[2].found == f"{22.3116 * separation:.1f} mm"


def slope_of_range(R: Array, theta: Array) -> Array:
    """Return ∂R/∂p of eq 1 by differences."""
    p, step = place_of(R, theta), 1e-8
    ranges = [F * D * np.cos(theta) / (p + side * step) + D * np.sin(theta) for side in (-1.0, 1.0)]
    return np.abs(ranges[1] - ranges[0]) / (2.0 * step)


TOLERANCE = 4.0 / math.sqrt(2.0 * 32**2)
"""Four standard errors of σ of 32² shots."""


@pytest.mark.parametrize(
    ("scale", "power", "rim", "expected"),
    [
        (1.0 + 0.98 * TOLERANCE, 0.0, 0.74, [AGREES, AGREES, AGREES]),
        (1.0 - 1.02 * TOLERANCE, 0.0, 0.74, [AGREES, DIFFERS, AGREES]),
        (1.0, 0.0, -0.76, [AGREES, AGREES, DIFFERS]),
        (1.0, 0.049, 0.0, [AGREES, AGREES, AGREES]),
        (1.0, -0.051, 0.0, [DIFFERS, AGREES, AGREES]),
        (1.0, 0.0, None, [AGREES, AGREES, DIFFERS]),
    ],
)
def test_equation_4_is_judged_on_the_axis_and_over_the_field(
    monkeypatch: pytest.MonkeyPatch, scale: float, power: float, rim: float | None, expected: list[Verdict]
) -> None:
    """Claim: an angle α between both directions moves p by f α (1 + p²/f²). R² Δp/(f d) of it passes to four standard
    errors on the axis and three quarters of that at one of seven angles; so does an exponent within 0.05 of 2. What eq
    1 itself makes of Δp, here by differences, does not at the rim, and is what is expected there."""
    angle = 10e-6
    # Far away p is small: the exponent of R² (1 + p²/f²) is 2 less what the nearest distances lose.
    middle = math.exp(np.mean(np.log(np.geomspace(3.0, 35.0, 6))))
    on_axis = np.geomspace(3.0, 35.0, 6)
    bent = float(np.polyfit(np.log(on_axis), np.log(1.0 + (D / on_axis) ** 2), 1)[0])

    def law(made: Any, shots: Any) -> dict[str, Array]:
        assert made.scanner["mirrors"]["synchronisation"] == angle
        theta = shots.theta if made.step >= 100 else np.zeros(shots.shot.size)
        R = made.distance / np.cos(theta)
        moved = F * angle * (1.0 + (place_of(R, theta) / F) ** 2)
        sigma = R**2 * moved / (F * D)
        if made.step < 100:
            sigma = sigma * scale * (made.distance / middle) ** (power - (bent if power else 0.0))
        elif rim is None:
            sigma = moved * slope_of_range(R, theta)
        elif made.step == 106:
            sigma = sigma * (1.0 + rim * TOLERANCE)
        return {"truth.range_m": R, "range_m": R + sigma * signs(shots)}

    benches = Benches(monkeypatch, ranging, law)
    rows = ranging.eq4(TASK).rows
    assert verdicts(rows) == expected
    assert [made.distance for made in benches.asked] == pytest.approx([*on_axis, *[8.0] * 7])
    if power:
        assert float(rows[0].found) == pytest.approx(2.0 + power, abs=6e-4)
    else:
        assert float(rows[1].found) == pytest.approx(scale, abs=6e-4)
    theta = np.array([-0.45, 0.45])
    along = 8.0 / np.cos(theta)
    exact = slope_of_range(along, theta) * F * D / along**2
    assert rows[2].expected == f"{exact[0]:.3f}, {exact[1]:.3f}"
    if rim is None:
        assert rows[2].found == rows[2].expected
    else:
        assert rows[2].found == f"1.000, {1.0 + rim * TOLERANCE:.3f}"


def by_differences(law: Callable[..., Array], at: tuple[float, ...], errors: tuple[float, ...]) -> Array:
    """Return σ of what a law makes of numbers that err apart, by its differences."""
    squares = 0.0
    for number, error in enumerate(errors):
        step = 1e-6 * max(abs(at[number]), 1e-3)
        ends = [law(*(one + side * step * (k == number) for k, one in enumerate(at))) for side in (1.0, -1.0)]
        squares = squares + ((ends[0] - ends[1]) / (2.0 * step) * error) ** 2
    return np.sqrt(squares)


def point_of(R: float, theta: float, phi: float, separation: float = 0.0) -> Array:
    """Return the point of eq 3: on a mirror's axis that lies so far behind the second's."""
    arm = R * math.cos(theta) - separation
    return np.array([R * math.sin(theta), arm * math.sin(phi), separation + arm * math.cos(phi)])


@pytest.mark.parametrize(
    ("way", "off", "expected"),
    [
        ("full", 0.0, [UNPRINTED, DIFFERS]),
        ("full", 0.99, [UNPRINTED, DIFFERS]),
        ("full", -1.01, [DIFFERS, DIFFERS]),
        ("printed", 0.0, [DIFFERS, AGREES]),
        ("printed", -0.99, [DIFFERS, AGREES]),
        ("printed", 1.01, [DIFFERS, DIFFERS]),
    ],
)
def test_equation_5_is_judged_by_its_worst_coordinate(
    monkeypatch: pytest.MonkeyPatch, way: str, off: float, expected: list[Verdict]
) -> None:
    """Claim: σ of x, y and z, by differences of the whole way from p, Θ and φ, and as printed from R, Θ and φ that err
    apart, without D_g; 4.5 standard errors of σ of 4000 shots for one coordinate of one direction are the bound. What
    has no point does not count. Dots are drawn on the line of the law that they follow."""
    angle, distance, phi = 50e-6, 8.0, 0.3
    directions = np.array([-0.45, -0.25, 0.0, 0.25, 0.45])
    tolerance = 4.5 / math.sqrt(8000.0)
    full, printed = np.empty((5, 3)), np.empty((5, 3))
    for row, theta in enumerate(directions.tolist()):
        R = distance / math.cos(theta)
        p = F * D * math.cos(theta) / (R - D * math.sin(theta))
        apart = F * (1.0 + (p / F) ** 2) * 1e-6

        def whole(p: float, theta: float, phi: float) -> Array:
            return point_of(F * D * math.cos(theta) / p + D * math.sin(theta), theta, phi, G)

        full[row] = by_differences(whole, (p, theta, phi), (apart, angle, angle))
        printed[row] = by_differences(point_of, (R, theta, phi), (R**2 * apart / (F * D), angle, angle))
    sigma = (full if way == "full" else printed).copy()
    sigma[3, 1] *= 1.0 + off * tolerance
    assert (abs(full / printed - 1.0) > 2.0 * tolerance).any()

    def law(made: Any, shots: Any) -> dict[str, Array]:
        assert made.scanner["mirrors"]["jitter"] == angle
        assert made.scanner["mirrors"]["synchronisation"] == 1e-6
        theta = float(shots.theta[0])
        assert (shots.phi == phi).all()
        R, true = made.distance / math.cos(theta), np.ones(shots.shot.size)
        points = point_of(R, theta, phi, G) + sigma[made.step] * signs(shots)[:, None]
        points[:2] = math.nan
        return {
            "truth.range_m": R * true, "truth.theta_rad": theta * true, "truth.phi_rad": phi * true,
            **dict(zip(("P.X", "P.Y", "P.Z"), points.T, strict=True)),
        }  # fmt: skip

    benches = Benches(monkeypatch, ranging, law)
    made = ranging.eq5(TASK)
    assert verdicts(made.rows) == expected
    assert [shots.shot.size for shots in benches.shots] == [4000] * 5
    np.testing.assert_array_equal([shots.theta[0] for shots in benches.shots], directions)
    worst, short = sigma / full, sigma / printed
    assert made.rows[0].found == f"{worst.min():.3f} to {worst.max():.3f}"
    assert made.rows[1].found == f"{short.min():.2f} to {short.max():.2f}"
    assert made.rows[1].expected == f"{(full / printed).min():.2f} to {(full / printed).max():.2f}"
    (first,) = drawn(monkeypatch, ranging, made)
    if off == 0.0:
        for number in range(3):
            law_line, printed_line, dots = (
                line.get_ydata() for line in first.lines[3 * number : 3 * number + 3]
            )
            np.testing.assert_allclose(dots, law_line if way == "full" else printed_line, rtol=1e-4)


def test_dots_lie_on_the_lines_of_equations_3_and_4(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of exact points the shift without D_g is 2 D_g sin(|φ|/2) at every dot; of eq 4's own σ each dot lies on
    its line, over range and over the field."""

    def points(made: Any, shots: Any) -> dict[str, Array]:
        R = np.full(shots.shot.size, 9.0)
        found = [point_of(*one, G) for one in zip(R, shots.theta, shots.phi, strict=True)]
        return {"range_m": R, **dict(zip(("P.X", "P.Y", "P.Z"), np.transpose(found), strict=True))}

    Benches(monkeypatch, ranging, points)
    _, shifts = drawn(monkeypatch, ranging, ranging.eq3(TASK))
    dots, line = (one.get_xydata() for one in shifts.lines)
    assert len(dots) == 21
    np.testing.assert_allclose(dots, line, atol=1e-9)
    np.testing.assert_allclose(line[:, 1], 2e3 * G * np.sin(np.abs(line[:, 0]) / 2.0), atol=1e-9)

    def ranges(made: Any, shots: Any) -> dict[str, Array]:
        theta = shots.theta if made.step >= 100 else np.zeros(shots.shot.size)
        R = made.distance / np.cos(theta)
        moved = F * 10e-6 * (1.0 + (place_of(R, theta) / F) ** 2)
        slope = slope_of_range(R, theta) if made.step >= 100 else R**2 / (F * D)
        return {"truth.range_m": R, "range_m": R + moved * slope * signs(shots)}

    Benches(monkeypatch, ranging, ranges)
    for panel in drawn(monkeypatch, ranging, ranging.eq4(TASK)):
        curve, dots = panel.lines[0].get_xydata(), panel.lines[-1].get_xydata()
        np.testing.assert_allclose(np.interp(dots[:, 0], *curve.T), dots[:, 1], rtol=1e-4)
