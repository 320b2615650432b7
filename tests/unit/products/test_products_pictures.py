"""Pictures: what is where, whatever the shape, and the same bytes every time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from PIL import Image

from scanner_sim.foundation.status import Status
from scanner_sim.products.image import RangeImage
from scanner_sim.products.pictures.image import about, draw_picture, slope
from scanner_sim.products.pictures.style import STATUS_COLOUR
from scanner_sim.products.pictures.voxel import draw_voxel, outcome
from scanner_sim.products.voxel import VoxelRecord

NAMES = ("range.png", "shaded.png", "signal.png")


def make_image(ranges: np.ndarray, step: float = 1e-3) -> RangeImage:
    """An image of the given ranges, (rows, columns); NaN is below the threshold."""
    rows, columns = ranges.shape
    return RangeImage(
        channels={
            "range_m": ranges.astype(np.float32),
            "Y": np.where(np.isnan(ranges), 0.0, 1e6 / ranges**2).astype(np.float32),
            "status": np.isnan(ranges).astype(np.float32),
        },
        theta=step * np.arange(columns),
        phi=step * np.arange(rows),
        objects=("node",),
        scenario_yaml="scanner:\n  preset: nrc_2000\n",
    )


def colours(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))


def rgb(colour: str) -> tuple[int, ...]:
    return tuple(int(colour[k : k + 2], 16) for k in (1, 3, 5))


@pytest.mark.parametrize("shape", [(1, 1), (1, 700), (700, 1), (5, 900), (40, 30), (2100, 30)])
@pytest.mark.parametrize("name", NAMES)
def test_any_shape_can_be_drawn(tmp_path: Path, name: str, shape: tuple[int, int]) -> None:
    ranges = 9.0 + 0.1 * np.add.outer(np.arange(shape[0]), np.arange(shape[1]))
    draw_picture(make_image(ranges), name, tmp_path / "picture.png")
    high, wide, _ = colours(tmp_path / "picture.png").shape
    assert 400 < wide < 3500
    assert 200 < high < 3500


@pytest.mark.parametrize("name", NAMES)
def test_an_image_without_any_return_is_a_picture_of_the_cause(tmp_path: Path, name: str) -> None:
    draw_picture(make_image(np.full((8, 8), np.nan)), name, tmp_path / "picture.png")
    picture = colours(tmp_path / "picture.png")
    assert (picture == rgb(STATUS_COLOUR[Status.BELOW_THRESHOLD])).all(-1).mean() > 0.4


@pytest.mark.slow
def test_every_cause_has_its_own_colour_and_no_blend_of_neighbours_appears(tmp_path: Path) -> None:
    """A picture smaller than the image leaves voxels out; it must not mix valid and invalid ones.

    Two ranges and one cause in a fine chequer give, apart from type and lines, two colours of the map and one of
    the cause.
    """
    row, column = np.indices((2500, 2500))
    ranges = np.choose((row + column) % 3, [9.0, 10.0, np.nan])
    draw_picture(make_image(ranges), "range.png", tmp_path / "picture.png")
    inner = colours(tmp_path / "picture.png")[600:1400, 600:1400].reshape(-1, 3)
    found = np.unique(inner, axis=0)
    assert len(found) == 3
    assert rgb(STATUS_COLOUR[Status.BELOW_THRESHOLD]) in {tuple(colour) for colour in found.tolist()}
    assert len(set(STATUS_COLOUR.values())) == len(Status) - 1


def test_the_first_row_is_at_the_top_and_the_first_column_at_the_left(tmp_path: Path) -> None:
    ranges = np.full((10, 10), 9.0)
    ranges[:3, :2] = np.nan
    draw_picture(make_image(ranges), "range.png", tmp_path / "picture.png")
    picture = colours(tmp_path / "picture.png")
    cause = (picture == rgb(STATUS_COLOUR[Status.BELOW_THRESHOLD])).all(-1)
    cause[picture.shape[0] // 2 :] = False  # the legend at the foot
    down, across = np.nonzero(cause)
    assert down.max() - down.min() > 1.2 * (across.max() - across.min())
    assert down.mean() < 0.35 * picture.shape[0]
    assert across.mean() < 0.35 * picture.shape[1]


def test_slope_is_the_tangent_of_a_tilted_plane() -> None:
    """Claim: the picture's derivative is dR/(R dθ), summed with dR/(R dφ) over √2.

    Set-up: R = 10 m · exp(0.3 θ + 0.1 φ), whose logarithmic derivatives are 0.3 and 0.1 everywhere. Expected:
    0.4/√2. Tolerance: float32 ranges (6e-8) over a step of 1 mrad leave 1e-4; one-sided ends add 0.3² · 1e-3/2.
    """
    step = 1e-3 * np.arange(20)
    image = make_image(10.0 * np.exp(0.1 * step[:, None] + 0.3 * step))
    np.testing.assert_allclose(slope(image), 0.4 / np.sqrt(2.0), atol=3e-4)


def test_slope_uses_the_neighbours_that_are_there() -> None:
    ranges = np.full((5, 5), np.nan)
    ranges[1, 1:4] = [10.0, 10.01, 10.02]
    ranges[4, 4] = 10.0
    found = slope(make_image(ranges))
    assert np.isfinite(found).sum() == 3
    np.testing.assert_allclose(found[1, 1:4], 1.0 / np.sqrt(2.0), rtol=3e-3)


def test_a_bump_is_bright_towards_the_upper_left(tmp_path: Path) -> None:
    """The eye expects light from above: reversed, bumps look like dents."""
    row, column = np.indices((60, 60)) - 29.5
    ranges = 10.0 - 0.2 * np.exp(-(row**2 + column**2) / 200.0)
    draw_picture(make_image(ranges, step=2e-3), "shaded.png", tmp_path / "picture.png")
    picture = colours(tmp_path / "picture.png")[..., 0].astype(float)
    grey = picture[120:900, 150:900]
    assert grey[:390, :375].mean() > grey[390:, 375:].mean() + 20.0


@pytest.mark.parametrize("name", NAMES)
def test_the_same_image_gives_the_same_bytes_whatever_the_users_style(tmp_path: Path, name: str) -> None:
    image = make_image(9.0 + np.random.default_rng(1).normal(size=(30, 40)))
    draw_picture(image, name, tmp_path / "one.png")
    with matplotlib.rc_context({"font.size": 20.0, "axes.facecolor": "black", "savefig.dpi": 30.0}):
        draw_picture(image, name, tmp_path / "two.png")
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    with Image.open(tmp_path / "one.png") as picture:
        assert set(picture.info) == {"dpi"}


def test_the_heading_names_instrument_scene_and_outcome() -> None:
    image = make_image(np.full((4, 5), 9.0))
    assert about(image) == "nrc_2000  ·  node  ·  4 × 5 voxels  ·  seed 0  ·  100.0 % valid"
    assert about(replace(image, scenario_yaml="", objects=tuple("abcd"))).startswith("a, b, c, …  ·  4 × 5")
    own = replace(image, scenario_yaml="scanner:\n  preset: /home/me/my_scanner.yaml\n")
    assert about(own).startswith("my_scanner  ·  node")


def make_record(status: Status = Status.VALID, truth: float = 20.2) -> VoxelRecord:
    pixel = np.arange(64.0)
    light = 5e4 * np.exp(-0.5 * ((pixel - truth) / 1.1) ** 2) if np.isfinite(truth) else np.zeros(64)
    number = 1.0 if status is Status.VALID else np.nan
    return VoxelRecord(
        row=3, column=4, theta=-0.1, phi=0.2, pixel_signal=light + 300.0, expected_signal=light,
        noise_sigma=np.full(64, 200.0), threshold=1000.0, saturation_level=6e4, status=status,
        peak_px=20.25 * number, sigma_peak_px=0.02 * number, range_m=9.998 * number, sigma_range_m=1e-3 * number,
        sigma_texture_m=5e-4 * number, truth_peak_px=truth,
        truth_range_m=10.0 if np.isfinite(truth) else np.nan, method="gaussian",
        window=(17, 23) if status is Status.VALID else None,
    )  # fmt: skip


@pytest.mark.parametrize(
    "record",
    [
        make_record(),
        make_record(Status.SATURATED),
        make_record(Status.BELOW_THRESHOLD, np.nan),
        make_record(Status.OUT_OF_ARRAY, 62.9),
        make_record(Status.OUT_OF_ARRAY, 80.0),
        replace(make_record(), sigma_peak_px=0.0),
    ],
    ids=["valid", "saturated", "nothing", "end", "beyond", "without noise"],
)
def test_every_outcome_of_a_voxel_can_be_drawn(tmp_path: Path, record: VoxelRecord) -> None:
    draw_voxel(record, tmp_path / "voxel.png")
    assert np.ptp(colours(tmp_path / "voxel.png")) > 200


def test_the_same_voxel_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        draw_voxel(make_record(Status.SATURATED), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_the_outcome_is_told_in_pixels_and_millimetres() -> None:
    pixel, metre = outcome(make_record())
    assert (
        pixel == "Position: 20.2500 pixel ± 0.02 pixel; true 20.2000 pixel; residual +0.05 pixel = +2.50 σ."
    )
    assert metre == "Range: 9.9980 m ± 1 mm; true 10.0000 m; residual -2 mm = -2.00 σ."
    assert outcome(make_record(Status.BELOW_THRESHOLD, np.nan))[1] == (
        "Range: none detected; the chief ray hits nothing."
    )


def test_lines_of_unequal_length_are_refused() -> None:
    with pytest.raises(ValueError, match="one shape"):
        replace(make_record(), noise_sigma=np.zeros(63))
    with pytest.raises(ValueError, match="leaves the line"):
        replace(make_record(), window=(60, 64))
