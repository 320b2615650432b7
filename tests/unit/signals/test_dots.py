"""Dots in frames: their centres against the judge's images and bounds, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from claims import mean_square, share
from dot_frames import BLACK, BLUR, CALIBRATION, GAIN, READ, drawn, scene, tiled
from numpy.typing import NDArray
from scipy.optimize import least_squares

from scanner_sim.analytic.dots import centre_bound, dot_image
from scanner_sim.signals.dots.adjust import Told, _Window, adjusted
from scanner_sim.signals.dots.edge_model import BLUR as BLUR_AT
from scanner_sim.signals.dots.edge_model import COUNT, expected_numbers
from scanner_sim.signals.dots.fit import Dots, find_dots
from scanner_sim.signals.dots.found import find_blobs
from scanner_sim.signals.dots.settings import DotStatus, legend

Array = NDArray[np.float64]
SHAPE = np.array([[0.3, -0.2, 5.0, 0.7, 3.0, 200.0, 0.5, -0.3, 0.9, BLUR]])
ABOUT = np.arange(-12.0, 13.0)


def _errors(dots: Dots, centres: Array) -> tuple[Array, Array]:
    """Return errors and covariances of the dots nearest to centres, all of which must be valid."""
    nearest = np.linalg.norm(dots.centre[:, None] - centres, axis=2).argmin(axis=0)
    assert (dots.status[nearest] == DotStatus.VALID).all()
    return dots.centre[nearest] - centres, dots.covariance[nearest]


def test_the_edge_model_is_the_judges_image() -> None:
    """Claim: line integrals round the edge give the judge's sums over the area; tolerance 1e-5 of white, of either."""
    one = replace(scene(10.0, 0.9, 0.4, 0.3, -0.2), rise_u=0.5 * GAIN, rise_v=-0.3 * GAIN)
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    matrix = turn @ np.diag([one.a, one.b]) @ turn.T
    given = [one.u, one.v, matrix[0, 0], matrix[0, 1], matrix[1, 1], 180.0, 0.5, -0.3, one.contrast, BLUR]
    numbers, _ = expected_numbers(np.array([given]), ABOUT, ABOUT, 5.0)
    np.testing.assert_allclose(numbers[0], dot_image(one, 12) / GAIN, atol=180.0 * 1e-5)


@pytest.mark.parametrize("parameter", range(COUNT))
def test_its_derivatives_are_differences(parameter: int) -> None:
    step = np.zeros(COUNT)
    step[parameter] = 1e-5
    ends = [expected_numbers(SHAPE + way * step, ABOUT, ABOUT, 12.0)[0] for way in (1.0, -1.0)]
    _, derivatives = expected_numbers(SHAPE, ABOUT, ABOUT, 12.0)
    np.testing.assert_allclose(derivatives[:, parameter], (ends[0] - ends[1]) / 2e-5, atol=1e-5)


@pytest.mark.parametrize("blur", [0.06, 0.2499, 0.25, 1.3, 7.9])
def test_steps_of_the_edge_are_enough_at_any_blur(blur: float) -> None:
    """Claim: the numbers are those of sixteen times as many steps, to 1e-5 of white, which is 200 DN.

    The ellipse has points within rounding of pixels' middles, where a step to one side and a bend to the other
    differ by a whole step of the edge, 3 DN.
    """
    shape = SHAPE.copy()
    shape[0, -1] = blur
    for half_axis in (6.0, 6.3, 7.0, 9.1, 12.0):
        found, _ = expected_numbers(shape, ABOUT, ABOUT, half_axis)
        np.testing.assert_allclose(
            found, expected_numbers(shape, ABOUT, ABOUT, 16.0 * half_axis)[0], atol=2e-3
        )


def _reach_the_bound(diameters: tuple[float, float], kinds: int, each: int, half: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    kept = drawn(kinds, diameters, rng)
    frame, centres = tiled(kept * each, half, rng)
    errors, covariance = _errors(find_dots(frame, CALIBRATION), centres)
    bounds = np.tile([centre_bound(one, half - 2) for one in kept], (each, 1, 1))
    roots = np.linalg.cholesky(np.linalg.inv(bounds))
    assert mean_square(np.einsum("dji,dj->di", roots, errors), slack=0.1)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert mean_square(errors / sigma, slack=0.02)
    assert share(int((np.abs(errors) < 1.96 * sigma).sum()), errors.size, 0.95, slack=0.01)
    stated = np.sqrt(np.trace(covariance, axis1=1, axis2=2) / np.trace(bounds, axis1=1, axis2=2))
    # One σ in a thousand is widened by chance.
    assert np.quantile(np.abs(stated - 1.0), 0.99) < 0.1


def test_centres_reach_the_bound_and_their_sigma_holds() -> None:
    """Claim: centres scatter by no more than 10 % beyond the bound of Cramér and Rao, and 94 to 96 % lie within 1.96 σ.

    Set-up: 12 dots of 5 to 14 pixels, tilts to 60°, on a sloping white of 7200 electrons, each 16 times. The mean
    square of errors, whitened by the judge's bound, is 1 but for sampling. Of a hundred σ one may be
    off the bound by a tenth.
    """
    _reach_the_bound((5.0, 14.0), 12, 16, 14, 11)


def test_a_misfit_beyond_chance_widens_the_covariance() -> None:
    """Claim: where χ² over its freedom is beyond chance the covariance does not depend on the noise that was told.

    Set-up: 4 dots of 12 pixels, 2 or 3 DN told where there are 6. What is known of the blur and the steps of numbers
    are left: 1 %.
    """
    rng = np.random.default_rng(31)
    frame, _ = tiled(drawn(4, (12.0, 12.5), rng), 14, None)
    noisy = frame + 6.0 * rng.standard_normal(frame.shape)
    # With so much gain light has no noise of its own.
    usual = replace(CALIBRATION, electrons_per_number=1e6)
    two, three = (find_dots(noisy, replace(usual, read_noise=told * 1e6)) for told in (2.0, 3.0))
    assert two.status.tolist() == three.status.tolist() == [DotStatus.VALID] * 4
    np.testing.assert_allclose(two.chi2 * 4.0, three.chi2 * 9.0, rtol=0.02)
    np.testing.assert_allclose(two.covariance, three.covariance, rtol=0.01, atol=0.01 * two.covariance.max())


@pytest.mark.parametrize("blur", [0.3, 1.2])
def test_pixels_are_fitted_four_and_two_blurs_beyond_the_edge(blur: float) -> None:
    """Claim: as many as middles of pixels lie within the ellipse that is so much wider, to 4 %: a blob's half axes err
    by a fifth of a pixel in twelve."""
    one = replace(scene(12.0, 0.8, 0.4, 0.2, -0.3), blur=blur)
    frame, _ = tiled([one] * 4, 18, None)
    found = find_dots(frame, replace(CALIBRATION, blur=blur))
    wider = 4.0 + 2.0 * blur
    np.testing.assert_allclose(found.pixels, np.pi * (one.a + wider) * (one.b + wider), rtol=0.04)


def test_noise_that_is_told_pixel_by_pixel_counts() -> None:
    """Claim: with noise of 1 to 13 DN beyond the sensor's, χ² is its freedom and σ hold; untold, χ² is not.

    Set-up: 10 dots of 8 to 14 pixels, each 5 times; the noise grows from column to column of each window.
    """
    rng = np.random.default_rng(23)
    frame, centres = tiled(drawn(10, (8.0, 14.0), rng) * 5, 14, rng)
    more = np.broadcast_to(1.0 + 12.0 * (np.arange(frame.shape[1]) % 29) / 28.0, frame.shape)
    noisy = frame + more * rng.standard_normal(frame.shape)
    told = find_dots(noisy, CALIBRATION, sigma=more)
    errors, covariance = _errors(told, centres)
    free = told.pixels - COUNT
    assert mean_square(np.sqrt(told.chi2 / free), freedom=float(free.sum()), slack=0.01)
    assert mean_square(errors / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)), slack=0.02)
    untold = find_dots(noisy, CALIBRATION)
    assert np.nanmedian(untold.chi2 / np.maximum(untold.pixels, 1)) > 2.0


def test_noise_that_errs_with_its_pixel_is_no_choice_among_errors() -> None:
    """Claim: σ hold where the noise of each pixel is told by the few samples that made it, as by paths of light.

    Set-up: 10 dots of 8 to 14 pixels, each 7 times. A pixel is the mean of 16 samples, white or black by chance, and
    its σ is theirs: 0 where all fall alike, as happens most where the mean is farthest off.
    """
    rng, samples = np.random.default_rng(24), 16
    frame, centres = tiled(drawn(10, (8.0, 14.0), rng) * 7, 14, None)
    white = frame.max() - BLACK
    share = np.clip((frame - BLACK) / white, 0.0, 1.0)
    hits = rng.binomial(samples, share) / samples
    # Without the slope of the light, the flat white and black have no samples' noise, as under the Sun.
    flat = np.minimum(share, 1.0 - share) < 0.1
    hits = np.where(flat, share, hits)
    told = np.where(flat, 0.0, white * np.sqrt(hits * (1.0 - hits) / (samples - 1)))
    electrons = white * hits * GAIN
    noisy = (rng.poisson(electrons) + rng.normal(0.0, READ, electrons.shape)) / GAIN + BLACK
    errors, covariance = _errors(find_dots(np.rint(noisy), CALIBRATION, sigma=told), centres)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert mean_square(errors / sigma, slack=0.1)


@pytest.mark.parametrize("believed", [0.1, pytest.param(0.01, marks=pytest.mark.slow)])
def test_a_sharp_lens_has_centres(believed: float) -> None:
    """Claim: dots of a lens of a tenth of a pixel are right to 0.002 pixel without noise, and with it σ hold.

    Set-up: 5 dots of 5 to 8 pixels, tilts to 60°, without noise, then 10 times with it; the lens as it is, and believed
    to be sharper than any.
    """
    sharp, rng = replace(CALIBRATION, blur=believed), np.random.default_rng(25)
    frame, centres = tiled([replace(one, blur=0.1) for one in drawn(5, (5.0, 8.0), rng)], 9, None)
    errors, _ = _errors(find_dots(frame, sharp), centres)
    assert np.abs(errors).max() < 2e-3
    electrons = np.tile((frame - BLACK) * GAIN, (10, 1))
    noisy = (rng.poisson(electrons) + rng.normal(0.0, READ, electrons.shape)) / GAIN + BLACK
    every = np.concatenate([centres + np.array([0.0, number * len(frame)]) for number in range(10)])
    errors, covariance = _errors(find_dots(np.rint(noisy), sharp), every)
    assert mean_square(errors / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)), slack=0.02)


@pytest.mark.slow
def test_large_dots_reach_the_bound() -> None:
    """Claim: the same of 4 dots of 20 to 60 pixels, each 6 times."""
    _reach_the_bound((20.0, 60.0), 4, 6, 41, 12)


@pytest.mark.parametrize("diameter", [5.0, 9.0, 20.0, pytest.param(60.0, marks=pytest.mark.slow)])
def test_centres_have_no_bias(diameter: float) -> None:
    """Claim: without noise centres are right to 0.001 pixel, a twentieth of what is allowed, to tilts of 60°."""
    half = int(0.5 * diameter) + 12
    scenes = [
        scene(diameter, np.radians(tilt), angle, u, v)
        for tilt in (0.0, 60.0)
        for angle, u, v in ((0.1, 0.2, -0.3), (1.0, -0.45, 0.25))
    ]
    frame, centres = tiled(scenes, half, None)
    errors, _ = _errors(find_dots(frame, CALIBRATION), centres)
    assert np.abs(errors).max() < 1e-3


@pytest.mark.parametrize("blur", [0.3, 1.3, 4.0, 9.0])
def test_a_dot_is_fitted_whatever_the_blur_of_its_lens(blur: float) -> None:
    """Claim: a dot of a lens of a third of a pixel to nine, believed a tenth sharper than it is, has its own centre,
    half axes and blur: without noise to a thousandth of a pixel, and blurs to a thousandth of themselves.

    The belief is known to 0.3 of itself, the pixels tell a blur to a hundredth: it draws by 10⁻⁴ of the blur.
    A dot that is blurred over several pixels has a darker core, which is found as well and is no second dot.
    """
    one = replace(scene(12.0 + 3.0 * blur, 0.6, 0.4, 0.2, -0.3), blur=blur)
    frame, centres = tiled([one], int(22.0 + 3.5 * blur), None)
    dots = find_dots(frame, replace(CALIBRATION, blur=0.9 * blur))
    assert dots.status.tolist() == [DotStatus.VALID]
    np.testing.assert_allclose(dots.centre, centres, atol=1e-3)
    np.testing.assert_allclose(dots.half_axes, [[one.a, one.b]], atol=1e-3)
    np.testing.assert_allclose(dots.blur, blur, rtol=1e-3)


def test_a_dot_that_is_found_twice_leaves_others_alone() -> None:
    """Claim: of a blurred dot below two dark corners of the frame one fit stays, and the corners, which are clipped."""
    one = replace(scene(24.0, 0.6, 0.4, 0.2, -0.3), blur=4.0)
    frame, centres = tiled([one], 40, None)
    frame[:9, :9] = frame[:9, -9:] = BLACK
    dots = find_dots(frame, replace(CALIBRATION, blur=4.0))
    assert dots.status.tolist() == [DotStatus.CLIPPED, DotStatus.CLIPPED, DotStatus.VALID]
    np.testing.assert_allclose(dots.centre[2:], centres, atol=1e-3)


@pytest.mark.parametrize("ground", [0.3, 2.5])
def test_what_is_behind_a_plate_does_not_matter(ground: float) -> None:
    """Claim: dots of a plate before darker and before much brighter ground are those of the plate alone, each once.

    The tolerance is a thousandth of their σ, for frames without noise: what a fit begins with is not the same, and with
    it which pixels count, which moves a noisy one by up to a tenth of σ. Beside them the plate itself may be a blob,
    and no rim of a dot.
    """
    scenes = [scene(diameter, 0.4, 0.7, 0.2, -0.3) for diameter in (6.0, 10.0, 16.0, 25.0)]
    plate, _ = tiled(scenes, 19, None)
    alone = find_dots(plate, CALIBRATION)
    assert (alone.status == DotStatus.VALID).all()
    frame = np.full((180, 200), BLACK + ground * (plate.max() - BLACK))
    frame[40 : 40 + plate.shape[0], 60 : 60 + plate.shape[1]] = plate
    dots = find_dots(frame, CALIBRATION)
    assert len(dots.centre) <= 5
    found = dots.status == DotStatus.VALID
    apart = dots.centre[found] - alone.centre - np.array([60.0, 40.0])
    sigma = np.sqrt(np.diagonal(alone.covariance, axis1=1, axis2=2))
    assert np.abs(apart / sigma).max() < 1e-3


def test_noise_alone_has_no_blobs() -> None:
    """Claim: a frame with hardly any light, whose noise is larger than a quarter of it, has no dark blob.

    Of 19 200 pixels none lies 6 standard deviations below its surroundings, but for one frame in 10⁵.
    """
    rng = np.random.default_rng(8)
    electrons = rng.poisson(40.0, (120, 160)) + rng.normal(0.0, READ, (120, 160))
    assert len(find_blobs(np.rint(electrons / GAIN + BLACK), CALIBRATION).centre) == 0


def test_every_failure_has_its_status() -> None:
    """Claim: dots without a centre say why; each of them is one dot in a frame of its own."""

    def status(frame: Array) -> int:
        dots = find_dots(frame, CALIBRATION)
        return int(dots.status[np.linalg.norm(dots.centre - 20.0, axis=1).argmin()])

    plain = scene(12.0, 0.3, 0.0, 0.0, 0.0)
    clean = dot_image(plain, 20) / GAIN + BLACK
    assert status(clean) == DotStatus.VALID
    assert status(np.minimum(7.0 * clean, CALIBRATION.saturation)) == DotStatus.SATURATED
    dim = replace(plain, light=6.5 * GAIN, rise_u=0.0, rise_v=0.0)
    assert status(dot_image(dim, 20) / GAIN + BLACK) == DotStatus.SHADOWED
    u, v = np.meshgrid(np.arange(41.0), np.arange(41.0))
    assert status(np.where(u + 0.3 * v < 21.0, BLACK + 0.1 * (clean - BLACK), clean)) in (
        DotStatus.SHADOWED,
        DotStatus.NOT_ELLIPTICAL,
        DotStatus.CLIPPED,
    )
    assert int(find_dots(clean[:, 12:], CALIBRATION).status[0]) == DotStatus.CLIPPED
    tiny = dot_image(scene(2.6, 1.2, 0.0, 0.0, 0.0), 20) / GAIN + BLACK
    assert (find_dots(tiny, CALIBRATION).status != DotStatus.VALID).all()
    bite = np.hypot(u - 26.0, v - 20.0) < 4.0
    assert status(np.where(bite, 180.0 + BLACK, clean)) == DotStatus.NOT_ELLIPTICAL
    assert set(legend()) == {str(int(code)) for code in DotStatus}


def test_an_even_frame_has_no_dots() -> None:
    rng = np.random.default_rng(3)
    frame = np.rint(180.0 + BLACK + rng.normal(0.0, 2.2, (200, 200)))
    assert not len(find_dots(frame, CALIBRATION).centre)


def test_axes_of_a_dot_are_the_eigenvectors_of_its_shape() -> None:
    """Claim: half axes are the eigenvalues, the longer first, and the angle is that of the longer one's eigenvector."""
    rng = np.random.default_rng(4)
    long, short, turn = rng.uniform(3.0, 6.0, 9), rng.uniform(1.0, 2.9, 9), rng.uniform(-1.5, 1.5, 9)
    c, s = np.cos(turn), np.sin(turn)
    shape = np.stack(
        [c * c * long + s * s * short, c * s * (long - short), s * s * long + c * c * short], axis=1
    )
    none = np.zeros(9)
    dots = Dots(none, none, shape, none, none, none, none, none, none)  # type: ignore[arg-type]
    np.testing.assert_allclose(dots.half_axes, np.stack([long, short], axis=1), rtol=1e-12)
    np.testing.assert_allclose(dots.angle, turn, atol=1e-12)


def test_dots_that_are_fitted_on_keep_what_belongs_to_them() -> None:
    """Claim: of the windows of some dots each has its own numbers, pixels, blur and further variance."""
    many = np.arange(4.0)
    pixels = many[:, None, None] + np.zeros((4, 3, 3))
    window = _Window(pixels, pixels > 1.5, ABOUT, 12.0, 10.0 + many, Told(20.0 + pixels, 30.0 + pixels))
    some = window.of(np.array([3, 1]))
    found = some.numbers, some.used, some.blur, some.more.own, some.more.about
    assert [part.reshape(2, -1)[:, 0].tolist() for part in found] == [
        [3.0, 1.0],
        [True, False],
        [13.0, 11.0],
        [23.0, 21.0],
        [33.0, 31.0],
    ]


def test_ten_parameters_are_told_by_the_pixels_and_one_belief() -> None:
    """Claim: of exact numbers the fit finds what made them and leaves nothing; as many residuals are free as pixels
    count, less nine: the tenth parameter, the blur, has an observation of its own."""
    numbers, _ = expected_numbers(SHAPE, ABOUT, ABOUT, 12.0)
    used = np.ones((2, len(ABOUT), len(ABOUT)), dtype=bool)
    used[0, :2], used[1, 3, 4:9] = False, False
    start = np.repeat(SHAPE, 2, axis=0)
    start[:, :6] += [0.1, -0.1, 0.2, 0.1, -0.2, 4.0]
    none = np.zeros(used.shape)
    found = adjusted(np.repeat(numbers, 2, axis=0), used, start, ABOUT, CALIBRATION, Told(none, none))
    assert found.settled.all()
    np.testing.assert_allclose(found.parameters, np.repeat(SHAPE, 2, axis=0), rtol=1e-3, atol=1e-3)
    assert found.freedom.tolist() == [625.0 - 50.0 - 9.0, 625.0 - 5.0 - 9.0]
    assert found.chi2.max() < 1e-3


def test_a_fit_is_the_least_of_pixels_and_of_what_is_known_of_the_blur() -> None:
    """Claim: where noise hides the blur a fit has the parameters at which the squares of all residuals, the blur's
    among them, are least, by SciPy, to a hundredth of σ; their covariance is the inverse of what pixels and the known
    blur tell, Σ a aᵀ/V + 1/(0.3 b)², within 1 %, where what is known beforehand makes up a tenth of it.

    Set-up: a dot under 30 DN of noise of which the fit is told, its blur believed to be half as large again. The fit
    stops where a step promises 10⁻⁵ of χ², 0.003 σ.
    """
    believed, noise = 1.5 * BLUR, 30.0
    rng = np.random.default_rng(17)
    numbers = expected_numbers(SHAPE, ABOUT, ABOUT, 12.0)[0] + noise * rng.standard_normal((1, 25, 25))
    start, used = SHAPE.copy(), np.ones(numbers.shape, dtype=bool)
    start[:, BLUR_AT] = believed
    told = np.full(numbers.shape, noise**2)
    found = adjusted(numbers, used, start, ABOUT, CALIBRATION, Told(told, told))
    assert found.settled.all()
    sigma = np.sqrt(CALIBRATION.variance(expected_numbers(found.parameters, ABOUT, ABOUT, 12.0)[0]) + told)

    def residuals(values: Array) -> Array:
        apart = (expected_numbers(values[None], ABOUT, ABOUT, 12.0)[0] - numbers) / sigma
        return np.append(apart, (values[BLUR_AT] - believed) / (0.3 * believed))

    least = least_squares(residuals, SHAPE[0], x_scale="jac", xtol=1e-10, ftol=1e-12, gtol=1e-12)
    covariance = np.linalg.inv(least.jac.T @ least.jac)
    scale = np.sqrt(np.diag(covariance))
    assert (np.abs(found.parameters[0] - least.x) / scale).max() < 0.01
    np.testing.assert_allclose(
        found.covariance[0] / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=0.01
    )
