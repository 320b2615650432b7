"""Where a dark blob begins to be a dot, and where it ceases to be one: each limit from both sides."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from dot_frames import BLACK, BLUR, CALIBRATION, GAIN, READ
from numpy.typing import NDArray

from scanner_sim.signals.dots import fit
from scanner_sim.signals.dots.adjust import Fitted, Told, _covariance, _weights, _Window
from scanner_sim.signals.dots.edge_model import BLUR as BLUR_AT
from scanner_sim.signals.dots.edge_model import CONTRAST, COUNT, L_UU, L_VV, LIGHT
from scanner_sim.signals.dots.fit import _after, _before, _reach, _widening, _within
from scanner_sim.signals.dots.found import Blobs, _blob, _is_among, find_blobs
from scanner_sim.signals.dots.settings import DotStatus, FrameCalibration

Array = NDArray[np.float64]

ROWS, COLUMNS = 60, 90
WHITE = 180.0


def before(
    u: float,
    v: float,
    shape: tuple[float, ...] = (3.0, 0.0, 3.0),
    contrast: float = 0.9,
    told: Told | None = None,
) -> int:
    """Return what is said of a blob in a frame of 60 rows and 90 columns before it is fitted."""
    blob = Blobs(
        np.array([[u, v]]), np.array([shape]), np.array([WHITE]), np.array([contrast]), np.array([False])
    )
    return int(_before(np.zeros((ROWS, COLUMNS)), blob, CALIBRATION, told)[0])


def test_a_fit_looks_as_far_as_the_edge_and_its_blur() -> None:
    """Claim: (L_uu² + L_uv²)^½ is how far the ellipse reaches along u; 4 pixels and two blurs more are looked at."""
    turn = np.array([[math.cos(0.4), -math.sin(0.4)], [math.sin(0.4), math.cos(0.4)]])
    matrix = turn @ np.diag([7.0, 3.0]) @ turn.T
    around = matrix @ np.stack([np.cos(angle := np.linspace(0.0, 2.0 * np.pi, 100_001)), np.sin(angle)])
    found = _reach(np.array([[matrix[0, 0], matrix[0, 1], matrix[1, 1]]]), BLUR)
    assert found[0] == pytest.approx(np.abs(around[0]).max() + 4.0 + 2.0 * BLUR, rel=1e-8)


@pytest.mark.parametrize("side", range(4))
def test_what_a_fit_reads_must_lie_in_the_frame(side: int) -> None:
    """Claim: the window about the centre reaches no farther than the middles of the outermost pixels, on all sides."""
    reach = 3.0 + 4.0 + 2.0 * BLUR
    for off, status in ((0.01, DotStatus.VALID), (-0.01, DotStatus.CLIPPED)):
        place = [reach + off, reach + off, COLUMNS - 1 - reach - off, ROWS - 1 - reach - off][side]
        assert before(*((place, 30.0) if side % 2 == 0 else (45.0, place))) == status


def test_a_dot_has_a_depth_and_a_size() -> None:
    """Claim: eight times the noise of its white, read²/g² + 1/12 + n/g; half axes from 0.6 pixel to what 64 hold."""
    noise = math.sqrt((READ / GAIN) ** 2 + 1.0 / 12.0 + WHITE / GAIN)
    deep = 8.0 * noise / WHITE
    assert before(45.0, 30.0, contrast=1.01 * deep) == DotStatus.VALID
    assert before(45.0, 30.0, contrast=0.99 * deep) == DotStatus.SHADOWED
    # Half axes of 0.6 and 1.8 pixel, turned by 45°.
    for small, status in ((0.61, DotStatus.VALID), (0.59, DotStatus.TOO_SMALL)):
        assert before(45.0, 30.0, (0.5 * (small + 1.8), 0.5 * (1.8 - small), 0.5 * (small + 1.8))) == status
    wide = Blobs(
        np.full((2, 2), 100.0),
        np.array([[s, 0.0, s] for s in (58.7, 58.9)]),
        np.full(2, WHITE),
        np.full(2, 0.9),
        np.zeros(2, dtype=bool),
    )
    assert _before(np.zeros((200, 200)), wide, CALIBRATION, None).tolist() == [
        DotStatus.VALID,
        DotStatus.NOT_ELLIPTICAL,
    ]


def test_noise_beyond_the_sensors_is_that_of_the_pixel_in_the_middle() -> None:
    """Claim: a blob at column 45 and row 30 drowns in what is told of the pixel there, and of no other."""
    for row, column, status in (
        (30, 45, DotStatus.SHADOWED),
        (45, 30, DotStatus.VALID),
        (30, 46, DotStatus.VALID),
    ):
        sigma = np.zeros((ROWS, COLUMNS))
        sigma[row, column] = WHITE
        assert before(45.2, 29.8, told=Told.of(sigma)) == status


def fitted(**changes: float) -> Fitted:
    """Return the fit of a round dot of 5 pixels' half axis, with other values."""
    values = np.zeros((1, COUNT))
    for place, name, usual in (
        (LIGHT, "light", WHITE), (LIGHT + 1, "rise_u", 0.0), (LIGHT + 2, "rise_v", 0.0), (CONTRAST, "contrast", 0.9),
        (BLUR_AT, "blur", BLUR), (L_UU, "wide", 5.0), (L_VV, "high", 5.0),
    ):  # fmt: skip
        values[0, place] = changes.get(name, usual)
    one = np.ones(1)
    misfit = changes.get("misfit", 0.0) * one
    return Fitted(
        values, np.zeros((1, COUNT, COUNT)), changes.get("chi2", 90.0) * one, 100.0 * one, misfit, one > 0.0
    )


@pytest.mark.parametrize(
    ("inside", "outside", "status"),
    [
        ({"misfit": 0.0499}, {"misfit": 0.0501}, DotStatus.NOT_ELLIPTICAL),
        ({"wide": 17.9}, {"wide": 18.1}, DotStatus.NOT_ELLIPTICAL),
        ({"contrast": 1.299}, {"contrast": 1.301}, DotStatus.NOT_ELLIPTICAL),
        ({"high": 0.601}, {"high": 0.599}, DotStatus.TOO_SMALL),
        # At (−12, −12), the corner of the window.
        ({"rise_u": 5.99, "rise_v": 5.99}, {"rise_u": 6.01, "rise_v": 6.01}, DotStatus.SHADOWED),
        ({"rise_u": -8.0, "rise_v": 3.9}, {"rise_u": -8.0, "rise_v": 4.1}, DotStatus.SHADOWED),
    ],
)
def test_a_fit_is_trusted_up_to_a_limit(
    inside: dict[str, float], outside: dict[str, float], status: DotStatus
) -> None:
    """Claim: a misfit of a twentieth of the depth, half axes from 0.6 pixel to 1.5 half windows of 12, a contrast of
    1.3, and a corner with a fifth of the light."""
    about, used = np.arange(-12.0, 13.0), np.ones((1, 25, 25), dtype=bool)
    assert _after(fitted(**inside), about, used, CALIBRATION)[0] == DotStatus.VALID
    assert _after(fitted(**outside), about, used, CALIBRATION)[0] == status


def test_only_fitted_pixels_are_too_dark() -> None:
    """Claim: light that falls by 14 DN a pixel towards one side lacks nothing where pixels of the other are fitted."""
    about = np.arange(-12.0, 13.0)
    left = np.broadcast_to(about <= 0.0, (1, 25, 25))
    for used, rise, status in (
        (left, {"rise_u": -14.0}, DotStatus.VALID),
        (left, {"rise_u": 14.0}, DotStatus.SHADOWED),
        (left.transpose(0, 2, 1), {"rise_v": -14.0}, DotStatus.VALID),
        (left.transpose(0, 2, 1), {"rise_v": 14.0}, DotStatus.SHADOWED),
    ):
        assert _after(fitted(**rise), about, used, CALIBRATION)[0] == status


def test_sigma_is_widened_by_a_misfit_beyond_chance() -> None:
    """Claim: of 100 residuals χ² of 149.4 is exceeded once in a thousand times (tables of χ²: 149.449)."""
    assert _widening(fitted(chi2=149.3))[0] == 1.0
    assert _widening(fitted(chi2=149.6))[0] == pytest.approx(1.496)


def test_the_ellipse_that_is_fitted_is_wider_by_the_margin() -> None:
    """Claim: |(L + m 1)⁻¹ (x − c)| ≤ 1, by linear algebra, for an ellipse aslant and off the middle."""
    values = np.array([[0.3, -0.6, 5.0, 1.5, 3.0, *[0.0] * (COUNT - 5)]])
    about = np.arange(-9.0, 10.0)
    u, v = np.meshgrid(about - 0.3, about + 0.6)
    inverse = np.linalg.inv(np.array([[5.0, 1.5], [1.5, 3.0]]) + 2.5 * np.eye(2))
    wanted = np.linalg.norm(np.einsum("ij,jab->iab", inverse, np.stack([u, v])), axis=0) <= 1.0
    np.testing.assert_array_equal(_within(values, about, 2.5)[0], wanted)


def test_a_blob_has_the_moments_of_its_pixels() -> None:
    """Claim: centre, and the ellipse whose second moments are those of the pixels' squares; L L = 4 (moments). The
    frame's edge counts on each side; an area that does not fill its ellipse is none."""
    v, u = np.mgrid[:21, :25]
    aslant = np.hypot((u - 12.0 + 0.5 * (v - 10.0)) / 8.0, (v - 10.0) / 5.0) <= 1.0
    lacking, white = np.where(aslant, 90.0, 0.0), np.full(aslant.shape, 100.0)
    box = slice(30, 51), slice(40, 65)
    found = _blob(aslant, box, lacking, white, (200, 230))
    assert found is not None
    assert found[:2] == pytest.approx((52.0, 40.0), abs=1e-9)
    at = np.argwhere(aslant)[:, ::-1].astype(np.float64)
    # A pixel as 20 × 20 points.
    fine = (np.arange(20) + 0.5) / 20.0 - 0.5
    every = (at[:, None] + np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)).reshape(-1, 2)
    moments = np.cov(every.T, bias=True)
    shape = np.array([[found[2], found[3]], [found[3], found[4]]])
    np.testing.assert_allclose(shape @ shape, 4.0 * moments, rtol=1e-3)
    assert found[5:] == pytest.approx((100.0, 0.9, 0.0))
    for edge in (
        (slice(0, 21), box[1]), (box[0], slice(0, 25)), (slice(179, 200), box[1]), (box[0], slice(205, 230)),
    ):  # fmt: skip
        at_edge = _blob(aslant, edge, lacking, white, (200, 230))
        assert at_edge is not None
        assert at_edge[7] == 1.0
    cross = (np.abs(u - 12) < 2) | (np.abs(v - 10) < 2)
    assert _blob(cross, box, np.where(cross, 90.0, 0.0), white, (200, 200)) is None


def test_a_blob_at_the_frames_edge_is_clipped() -> None:
    """Claim: of two black discs the one that touches an edge is, whichever edge that is."""
    v, u = np.mgrid[:ROWS, :COLUMNS]
    for at in ((2.0, 25.0), (70.0, 57.5), (87.5, 31.0), (30.0, 1.5)):
        frame = np.full((ROWS, COLUMNS), WHITE + BLACK)
        for middle in (at, (48.0, 24.0)):
            frame[np.hypot(u - middle[0], v - middle[1]) < 4.6] = BLACK
        found = find_blobs(frame, CALIBRATION)
        assert found.clipped.tolist() == (np.hypot(*(found.centre - [48.0, 24.0]).T) > 2.0).tolist()
        assert found.clipped.sum() == 1


def test_each_dot_is_fitted_once_in_the_least_window_that_holds_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: half windows from 8 to 64 pixels, each at most 1.4 times the one before, hold what reaches as far as they
    do and farther than the one before; what is not to be fitted is in none."""
    reach = np.concatenate([np.linspace(3.0, 63.99, 400), [8.0, 64.0, 20.0]])
    status = np.full(len(reach), DotStatus.VALID, dtype=np.int8)
    status[-1] = DotStatus.CLIPPED
    asked: list[tuple[int, Array]] = []
    monkeypatch.setattr(fit, "_reach", lambda *_: reach)
    monkeypatch.setattr(fit, "_before", lambda *_: status)
    monkeypatch.setattr(fit, "_fit", lambda dots, chosen, *rest: asked.append((rest[3], chosen)))
    empty = np.zeros((len(reach), 3))
    none = Blobs(empty[:, :2], empty, empty[:, 0], empty[:, 0], empty[:, 0] > 0.0)
    fit.fit_dots(np.zeros((ROWS, COLUMNS)), none, CALIBRATION)
    halves = np.array([half for half, _ in asked])
    assert (halves[0], halves[-1]) == (8, 64)
    assert (halves[1:] <= 1.4 * halves[:-1]).all()
    for least, (half, chosen) in zip((0, *halves), asked, strict=False):
        assert least < reach[chosen].min() <= reach[chosen].max() <= half
    np.testing.assert_array_equal(
        np.sort(np.concatenate([chosen for _, chosen in asked])), np.arange(len(reach) - 1)
    )


@pytest.mark.parametrize(
    ("away", "growth", "same"),
    [
        (1.9, 1.0, True),
        (2.1, 1.0, False),
        (0.0, 1.49, True),
        (0.0, 1.51, False),
        (0.0, 0.68, True),
        (0.0, 0.65, False),
    ],
)
def test_a_dark_area_is_found_once(away: float, growth: float, same: bool) -> None:
    """Claim: what two closings find is one area if its mean half axis, here of 2 × 8 pixels, is that of the other to a
    half, and its centre within half of it."""

    def blob(u: float, scale: float) -> tuple[float, ...]:
        return (u, 20.0, 5.0 * scale, 3.0 * scale, 5.0 * scale, 100.0, 0.9, 0.0)

    others = np.array([blob(20.0, 1.0), blob(80.0, 1.0)])
    assert _is_among(blob(20.0 + away, growth), others) is same


def test_a_frame_is_smoothed_by_seven_tenths_of_a_pixel() -> None:
    """Claim: a black square of 3 × 3 pixels lacks in its middle what a Gaussian of 0.7 pixel has there, of all the
    light."""
    frame = np.full((41, 41), WHITE + BLACK)
    frame[19:22, 19:22] = BLACK
    weight = np.exp(-0.5 * (np.arange(-3, 4) / 0.7) ** 2)
    within = weight[2:5].sum() / weight.sum()
    found = find_blobs(frame, CALIBRATION)
    assert found.contrast.tolist() == pytest.approx([within**2], rel=1e-9)
    np.testing.assert_allclose(found.centre, [[20.0, 20.0]], atol=1e-9)


def test_a_blur_is_known_to_a_share_of_itself() -> None:
    """Claim: to 0.3 of it, and no better than 0.06 pixel: 1/σ² of 0.5 pixel and of 0.1."""
    window: Any = SimpleNamespace(blur=np.array([0.5, 0.1]))
    known = _Window.blur_known.fget(window)  # type: ignore[attr-defined]
    np.testing.assert_allclose(known, [1.0 / 0.15**2, 1.0 / 0.06**2])


def test_of_weights_that_are_right_the_covariance_is_the_inverse() -> None:
    """Claim: N⁻¹(Σ w² V a aᵀ + what is known of the blur)N⁻¹ is N⁻¹ where w = 1/V; twice the variance of the pixels
    doubles what they bring in and leaves the blur's own, by NumPy's sums over the pixels."""
    rng = np.random.default_rng(3)
    rows, used = rng.normal(size=(1, COUNT, 5, 4)), np.ones((1, 5, 4), dtype=bool)
    used[0, 0, :2] = False
    expected, blur = rng.uniform(2e3, 4e3, (1, 5, 4)), np.array([0.5])
    none = np.zeros((1, 5, 4))
    window = _Window(none, used, np.arange(4.0), 3.0, blur, Told(none, none))
    weight = _weights(window, expected, CALIBRATION)
    np.testing.assert_allclose(weight[used], 1.0 / CALIBRATION.variance(expected)[used])
    assert not weight[~used].any()
    known = np.zeros((COUNT, COUNT))
    known[BLUR_AT, BLUR_AT] = 1.0 / 0.15**2
    pixels = sum(
        weight[0, row, column] * np.outer(rows[0, :, row, column], rows[0, :, row, column])
        for row in range(5)
        for column in range(4)
    )
    inverse = np.linalg.inv(pixels + known)
    found = _covariance(window, weight, inverse[None], expected, rows, CALIBRATION)
    np.testing.assert_allclose(found[0], inverse, rtol=1e-8, atol=1e-12)
    twice = _Window(none, used, np.arange(4.0), 3.0, blur, Told(CALIBRATION.variance(expected), none))
    found = _covariance(twice, weight, inverse[None], expected, rows, CALIBRATION)
    np.testing.assert_allclose(found[0], inverse @ (2.0 * pixels + known) @ inverse, rtol=1e-8, atol=1e-12)


def test_the_variance_of_pixels_is_the_sum_of_its_parts() -> None:
    """Claim: read noise and steps of 1/12, electrons over gain, and unlike responses by the square of the light; below
    black there is no light. Expected: by drawing nothing, in numbers: 6/4 DN, 800/4 DN² and 1 % of 800."""
    known = FrameCalibration(12.0, 4.0, 6.0, 1000.0, 0.5, uneven=0.01)
    dark = 1.5**2 + 1.0 / 12.0
    np.testing.assert_allclose(
        known.variance(np.array([800.0, 0.0, -50.0])), [dark + 200.0 + 64.0, dark, dark], rtol=1e-12
    )
    assert known.floor == pytest.approx(dark)


def test_what_is_told_of_a_pixel_weighs_with_its_neighbours() -> None:
    """Claim: a pixel of 3 DN has a variance of 9 of its own; where it weighs that is the mean over two pixels to each
    side, which the 25 pixels about it share."""
    sigma = np.zeros((11, 13))
    sigma[5, 6] = 3.0
    told = Told.of(sigma)
    wanted = np.zeros((11, 13))
    wanted[3:8, 4:9] = 9.0 / 25.0
    np.testing.assert_allclose(told.about, wanted, atol=1e-12)
    assert told.own.sum() == told.own[5, 6] == 9.0
    some = told.at((np.array([5, 3, 0]), np.array([6, 4, 0])))
    assert some.own.tolist() == [9.0, 0.0, 0.0]
    np.testing.assert_allclose(some.about, [0.36, 0.36, 0.0], atol=1e-12)
