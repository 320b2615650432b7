"""What stands in the page of a result: arrays, inert JSON, windows of lines, the field of view."""

from __future__ import annotations

import json
import math
from typing import Any

import html5lib
import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.products.view.packing import packed, rounded, unpacked
from scanner_sim.products.view.page import inert_json
from scanner_sim.products.view.scan import shades
from scanner_sim.products.view.signals import WINDOW, line_windows, packed_windows, waveform_windows
from scanner_sim.products.view.surroundings import Surroundings
from scanner_sim.ranging.axes import Axes

NUMBERS = {
    "electrons_per_number": 10.0,
    "bias": 64.0,
    "dark_electron": 50.0,
    "off_scale": 2.0,
    "electrons_per_watt": 1e12,
    "stray_light": 0.0,
    "threshold_electron": 200.0,
}


@pytest.mark.parametrize("kind", ["u1", "u2", "i2", "i4", "f4"])
def test_the_page_holds_arrays_as_they_are(kind: str) -> None:
    values = np.arange(0 if kind[0] == "u" else -308, 896, 7).astype(kind).reshape(2, -1)
    again = unpacked(packed(values))
    assert again.dtype == np.dtype(f"<{kind}")
    assert np.array_equal(again, values)


def test_floats_keep_so_many_bits_as_are_asked_for() -> None:
    """Claim: of 11 bits the relative error is 2^−12 at most, and is reached nearly; NaN, infinities and 0 stay."""
    values = np.float32(10.0) ** np.linspace(-20.0, 20.0, 4001, dtype=np.float32)
    values = np.concatenate([values, -values])
    error = np.abs(unpacked(packed(values, 11)) / values.astype(np.float64) - 1.0)
    assert 0.9 * 2.0**-12 < error.max() <= 2.0**-12
    strange = np.array([np.nan, np.inf, -np.inf, 0.0], dtype=np.float32)
    assert np.array_equal(rounded(strange, 11), strange, equal_nan=True)


def test_doubles_become_single_and_longer_whole_numbers_are_refused() -> None:
    assert unpacked(packed(np.array([1.0, 1.0 / 3.0]))).tolist() == [1.0, float(np.float32(1.0 / 3.0))]
    with pytest.raises(ValueError, match="int64"):
        packed(np.arange(3))


def test_no_text_ends_the_data_of_a_page() -> None:
    """Claim: whatever a name holds, the parser sees one script of data, and JSON gives the name back."""
    names = ["</script><script>alert(1)</script>", "<!--<script>", "]]>", "&lt;", "\u2028", "a\\u003c", '"']
    text = inert_json({"names": names, "none": math.nan})
    assert not set(text) & set("<>&\u2028")
    tree = html5lib.parse(f'<script type="application/json">{text}</script>', namespaceHTMLElements=False)
    (script,) = tree.iter("script")
    found = json.loads(script.text)
    assert found["none"] is None
    # What steers a reader is written out, as everywhere.
    assert found["names"] == [name.replace("\u2028", "\\u2028") for name in names]


def lines(peak: list[float], pixels: int = 60, **more: NDArray[Any]) -> dict[str, NDArray[Any]]:
    count = len(peak)
    number = np.arange(count * pixels, dtype=np.uint16).reshape(count, pixels)
    return {
        "row": np.arange(count, dtype=np.int32),
        "column": np.arange(count, dtype=np.int32) * 2,
        "number": number,
        "peak_px": np.array(peak, dtype=np.float32),
        "laser_w": np.full((count, pixels), 3e-11, dtype=np.float32),
        "laser_field_w": np.full(count, 1.8e-9, dtype=np.float32),
        "truth.peak_px": np.array(peak) + 0.25,
        **more,
    }


def test_windows_lie_about_the_peak_and_end_with_the_line() -> None:
    part = lines([30.4, 2.0, 59.0, np.nan])
    found = line_windows([part], NUMBERS, 1)
    # Without a peak about the largest number, which is the last one here.
    assert found.first.tolist() == [18, 0, 60 - WINDOW["line"], 60 - WINDOW["line"]]
    for i, first in enumerate(found.first):
        assert np.array_equal(found.number[i], part["number"][i, first : first + WINDOW["line"]])
    assert found.numbers == {"dark": 69.0, "threshold": 20.0, "electrons": 10.0}
    assert found.expected == pytest.approx(69.0 + 3e-11 * 1e12 / 10.0)
    assert found.place[0] == pytest.approx(30.65)


def test_what_is_expected_has_the_background_and_the_stray_light() -> None:
    """Claim: of a tenth of the laser's 1.8 nW and of the background's 60 pixels each pixel has a sixtieth, whether an
    exposure without the laser is subtracted or not: the number is that of the exposure with it."""
    around = np.full((1, 60), 1e-11, dtype=np.float32)
    off = np.full((1, 60), 70, dtype=np.uint16)
    for more in ({}, {"number_off": off}):
        found = line_windows([lines([30.0], background_w=around, **more)], NUMBERS | {"stray_light": 0.1}, 1)
        watts = 0.9 * (3e-11 + 1e-11) + 0.1 * (1.8e-9 / 60.0 + 1e-11)
        assert found.expected == pytest.approx(69.0 + watts * 1e12 / 10.0)


def test_lines_are_thinned_by_rows_and_columns_and_parts_are_joined() -> None:
    part = lines([30.0, 31.0, 32.0, 33.0, 34.0])
    found = line_windows([part, part], NUMBERS, 2)
    assert found.row.tolist() == [0, 2, 4] * 2
    assert found.column.tolist() == [0, 4, 8] * 2
    assert found.number[0, 12] == 30


def test_the_threshold_stands_above_what_is_subtracted() -> None:
    """Claim: c = g (n_on − b) − k g (n_off − b), so a charge of 0 is the number b + k (n_off − b)."""
    off = np.full((1, 60), 70, dtype=np.uint16)
    found = line_windows([lines([30.0], number_off=off)], NUMBERS, 1)
    assert found.beneath is not None
    assert found.beneath == pytest.approx(64.0 + 2.0 * 6.0)
    assert unpacked(packed_windows(found)["beneath"]) == pytest.approx(76.0, rel=1e-3)


def test_what_is_expected_keeps_a_65535th_of_its_span() -> None:
    part = lines([30.0])
    part["laser_w"] = np.linspace(0.0, 1e-8, 60, dtype=np.float32)[None, :]
    found = line_windows([part], NUMBERS, 1)
    said = packed_windows(found)
    again = said["expected_low"] + said["expected_scale"] * unpacked(said["expected"]).astype(np.float64)
    assert np.abs(again - found.expected).max() <= 0.5 * said["expected_scale"] * (1.0 + 1e-9)
    # From 0, or what is below it, to the largest.
    assert 65535.0 * said["expected_scale"] == pytest.approx(found.expected.max())
    assert said["expected_low"] == 0.0


def test_waveforms_are_kept_about_their_echo() -> None:
    count, samples = 1, 200
    part = {
        "row": np.zeros(count, dtype=np.int32),
        "column": np.zeros(count, dtype=np.int32),
        "number": np.arange(samples, dtype=np.int16)[None, :],
        "expected_a": np.full((count, samples), 4e-6, dtype=np.float32),
        "delay_s": np.array([95e-9]),
    }
    numbers = {"start_s": -5e-9, "rate_hz": 1e9, "step_a": 2e-8}
    found = waveform_windows([part], numbers, 1)
    assert found.first[0] == 100 - WINDOW["waveform"] // 2
    assert found.place[0] == pytest.approx(100.0)
    assert found.expected == pytest.approx(200.0)
    assert found.numbers == pytest.approx({"start_ns": -5.0, "step_ns": 1.0, "microampere": 0.02})


def around(**changes: Any) -> Surroundings:
    values: dict[str, Any] = {
        "horizontal": (-0.2, 0.3),
        "vertical": (-0.1, 0.1),
        "array": (0.0, 5e-3),
        "gate": (0.0, math.inf),
        "scale": 0.1,
        "baseline": 0.05,
        "axes": Axes(0.02),
    }
    return Surroundings(**values | changes)


def test_the_field_of_view_ends_where_the_array_or_the_gate_does() -> None:
    """Expected: R = f d cosΘ / p + d sinΘ (eq 1) with p = 5 mm: 1 m on the axis; no far end at p = 0."""
    assert around().near == pytest.approx(1.0)
    assert math.isinf(around().far)
    assert around(array=(1e-3, 5e-3)).far == pytest.approx(5.0)
    gated = around(array=(1e-3, 5e-3), gate=(1.5, 3.0))
    assert (gated.near, gated.far) == (1.5, 3.0)
    near, _ = around().ends(np.array([0.3]))
    assert near[0] == pytest.approx(math.cos(0.3) + 0.05 * math.sin(0.3))
    assert around(array=None, gate=(2.0, 9.0)).near == 2.0


def test_the_field_of_view_of_a_tilted_array_ends_where_it_does() -> None:
    """Expected: R = h d cosΘ / p + d (sinΘ + g cosΘ) with d = 5 cm and a slope g of 2: both ends lie 0.1 m farther."""
    near, far = around(array=(1e-3, 5e-3), slope=2.0).ends(np.array([0.0, 0.3]))
    upright = around(array=(1e-3, 5e-3)).ends(np.array([0.0, 0.3]))
    for tilted, end in zip((near, far), upright, strict=True):
        assert tilted == pytest.approx(end + 0.1 * np.cos([0.0, 0.3]))


def test_outlines_lie_at_the_ends_of_the_scan() -> None:
    drawn = around(sun=np.array([0.0, 0.6, -0.8]), sun_visible=1.0).drawn(7.0)
    assert drawn["far"] is None
    assert drawn["drawn_far"] == 7.0
    assert drawn["sun"] == [0.0, 0.6, -0.8]
    json.dumps(drawn)
    points = np.concatenate([unpacked(one["points"]) for one in drawn["outlines"] if one["name"] == "far"])
    x, y, z = points.T.astype(np.float64)
    # Back from eq 3: φ about the second axis, and R from the first.
    reach = np.hypot(y, z - 0.02) + 0.02
    assert np.hypot(x, reach) == pytest.approx(7.0, rel=1e-5)
    theta, phi = np.arctan2(x, reach), np.arctan2(y, z - 0.02)
    assert (theta.min(), theta.max()) == pytest.approx((-0.2, 0.3), abs=1e-6)
    assert (phi.min(), phi.max()) == pytest.approx((-0.1, 0.1), abs=1e-6)


def test_outlines_go_along_all_four_edges_and_rays_to_the_corners() -> None:
    """Claim: of the near and of the far end, by eq 3: both edges along Θ with the range of each deflection, both along
    φ with that of the end they stand at; and a ray from the mirrors to each far corner."""
    given = around(array=(1e-3, 5e-3), gate=(0.7, 6.0))
    drawn = given.drawn(4.5)
    theta, phi = np.linspace(-0.2, 0.3, 25), np.linspace(-0.1, 0.1, 25)
    place = {name: [] for name in ("near", "far", "ray")}
    for one in drawn["outlines"]:
        place[one["name"]].append(unpacked(one["points"]).astype(np.float64))

    def points(r: Any, angle: Any, down: Any) -> NDArray[np.float64]:
        angle, down = np.broadcast_arrays(angle, down)
        reach = np.maximum(r, 0.02) * np.cos(angle) - 0.02
        return np.stack(
            [np.maximum(r, 0.02) * np.sin(angle), reach * np.sin(down), reach * np.cos(down) + 0.02], axis=-1
        )

    ends = {"near": given.ends(theta)[0], "far": np.minimum(given.ends(theta)[1], 4.5)}
    assert np.ptp(ends["near"]) > 0.03
    for name, r in ends.items():
        wanted = [points(r, theta, side) for side in (-0.1, 0.1)]
        wanted += [points(r[at], theta[at], phi) for at in (0, 24)]
        for found, edge in zip(place[name], wanted, strict=True):
            np.testing.assert_allclose(found, edge, atol=1e-5)
    corners = [(at, side) for at in (0, 24) for side in (-0.1, 0.1)]
    for found, (at, side) in zip(place["ray"], corners, strict=True):
        # What would lie behind the mirrors is at them.
        ray = points(np.array([0.0, ends["far"][at]]), theta[at], side)
        np.testing.assert_allclose(found, ray, atol=1e-5)


@pytest.mark.parametrize("layer", ["truth.incidence_rad", "sigma_texture_m", "background"])
def test_points_are_coloured_by_what_there_is(layer: str) -> None:
    """Claim: by a layer that is there, angles in degrees and lengths in mm, and not where it is missing."""

    class Layers(dict[str, Any]):
        channels = property(lambda self: self.keys())

    names = {
        "truth.incidence_rad": "true incidence",
        "sigma_texture_m": "σ by uneven spots",
        "background": "background",
    }
    factors = {"truth.incidence_rad": math.degrees(1.0), "sigma_texture_m": 1e3, "background": 1.0}
    bare = Layers({name: np.ones(3) for name in ("range_m", "Y", "sigma_range_m", "status")})
    assert {one["name"] for one in shades(bare)} == {"range", "signal", "σ of the range", "status"}  # type: ignore[arg-type]
    (added,) = (one for one in shades(Layers(bare | {layer: np.ones(3)})) if one["layer"] == layer)  # type: ignore[arg-type]
    assert (added["name"], added["factor"]) == (names[layer], factors[layer])
