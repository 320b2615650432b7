"""The video camera: which way up it is, how bright, and what its sensor loses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from scanner_sim.render.camera_settings import Camera
from scanner_sim.scene.objects import Scene

FIELD = (-0.2, 0.2)
SUN_BEHIND = (0.0, 0.0, -1.0)
PLAIN = Camera(width=40, samples=8, bounces=1, exposure=1.0, stops=24.0, gamma=1.0, glare=0.0)

pytestmark = pytest.mark.usefixtures("device")


def wall(x: float, y: float, size: float, reflectance: float = 0.9, name: str = "wall") -> dict[str, Any]:
    return {
        "name": name,
        "shape": "rectangle",
        "size": (size, size),
        "position": (x, y, 10.0),
        "material": {"reflectance": reflectance},
    }


def taken(*objects: dict[str, Any], camera: Camera = PLAIN, **options: Any) -> Any:
    from scanner_sim.render.camera import photograph
    from scanner_sim.scene.files.loader import load_scene

    settings = {
        "horizontal": FIELD,
        "vertical": FIELD,
        "sun_direction": SUN_BEHIND,
        "sun_angular_radius": 4.65e-3,
        "earth_direction": None,
        **options,
    }
    return photograph(load_scene(Scene(objects=objects)), camera, **settings)


def developed(camera: Camera, *values: float) -> list[int]:
    from scanner_sim.render.camera import develop

    return develop(camera, np.array([values], dtype=np.float32))[0].tolist()


def test_right_is_right_and_low_is_low() -> None:
    picture = taken(wall(1.2, 0.6, 0.4))
    assert picture.linear.shape == picture.grey.shape == (40, 40)
    rows, columns = np.nonzero(picture.linear > 0.5)
    step = 2.0 * np.tan(0.2) / 40
    assert columns.mean() == pytest.approx(0.12 / step + 19.5, abs=0.2)
    assert rows.mean() == pytest.approx(0.06 / step + 19.5, abs=0.2)
    assert len(rows) == pytest.approx((0.04 / step) ** 2, rel=0.35)


def test_the_field_of_view_may_lie_aside() -> None:
    picture = taken(wall(2.0, 0.0, 0.2), horizontal=(0.1, 0.3), vertical=(-0.05, 0.05))
    assert picture.linear.shape == (round(40 * 2.0 * np.tan(0.05) / (np.tan(0.3) - np.tan(0.1))), 40)
    columns = np.nonzero(picture.linear > 0.4)[1]
    expected = (0.2 - np.tan(0.1)) / (np.tan(0.3) - np.tan(0.1)) * 40 - 0.5
    assert columns.mean() == pytest.approx(expected, abs=0.3)


def test_a_line_scan_has_a_picture_too() -> None:
    picture = taken(wall(0.0, 0.0, 8.0), vertical=(0.0, 0.0))
    assert picture.linear.shape == (2, 40)
    assert (picture.linear > 0.8).all()


def test_a_white_wall_that_faces_the_sun_is_one() -> None:
    assert taken(wall(0, 0, 8, 1.0)).linear.mean() == pytest.approx(1.0, abs=2e-3)
    aslant = taken(wall(0, 0, 8, 0.5), sun_direction=(np.sqrt(0.75), 0.0, -0.5))
    assert aslant.linear.mean() == pytest.approx(0.25, abs=1e-3)


def test_a_shadow_is_black_and_the_earth_lifts_it() -> None:
    near = {**wall(0.0, 0.0, 0.5, name="near"), "position": (0.0, -0.5, 8.0)}
    above = {"sun_direction": (0.0, -0.7, -0.7)}
    dark, lifted = (taken(wall(0, 0, 8), near, earth_direction=e, **above) for e in (None, (0.0, 1.0, 0.0)))
    step = 2.0 * np.tan(0.2) / 40
    row = round((-0.5 + 2.0) / 10.0 / step + 19.5)
    shadow = (slice(row - 1, row + 2), slice(19, 21))
    assert dark.linear[5, 5] == pytest.approx(0.9 * np.sqrt(0.5), rel=0.01)
    assert (dark.linear[shadow] == 0.0).all()
    assert (lifted.linear[shadow] > 0.01).all()
    assert (lifted.linear[shadow] < 0.2).all()


def test_no_sun_no_picture() -> None:
    picture = taken(wall(0, 0, 8), sun_direction=None, earth_direction=(0.0, 1.0, 0.0))
    assert picture.linear.max() == picture.grey.max() == 0


def test_the_sun_in_the_field_is_seen_past_the_wall() -> None:
    picture = taken(wall(0, 0, 0.5), sun_direction=(-0.1, -0.1, 1.0))
    rows, columns = np.nonzero(picture.linear > 100.0)
    assert 0 < len(rows) <= 9
    assert abs(rows.mean() - 9.6) < 1.5
    assert abs(columns.mean() - 9.6) < 1.5


def test_the_same_seed_gives_the_same_bytes_on_any_threads() -> None:
    import drjit as dr

    before = dr.thread_count()
    metal = {**wall(0, 0, 3), "material": "aluminised_kapton"}
    camera = Camera(width=64, samples=10)
    found = []
    try:
        for threads in (1, 2, 2):
            dr.set_thread_count(threads)
            found.append(taken(metal, wall(2, 0, 2, name="other"), camera=camera, seed=7).linear.tobytes())
    finally:
        dr.set_thread_count(before)
    assert len(set(found)) == 1
    assert taken(metal, wall(2, 0, 2, name="other"), camera=camera, seed=8).linear.tobytes() != found[0]


def test_batches_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    from scanner_sim.render import camera

    monkeypatch.setattr(camera, "_PATHS_AT_ONCE", 1000)
    picture = taken(wall(1.2, 0.6, 0.4))
    rows, columns = np.nonzero(picture.linear > 0.5)
    assert (rows.mean(), columns.mean()) == pytest.approx((25.4, 31.3), abs=0.4)


def test_white_saturates_and_dark_is_black() -> None:
    camera = PLAIN.model_copy(update={"exposure": 2.0, "stops": 4.0})
    assert developed(camera, 0.5, 3.0, 0.03) == [255, 255, 0]
    middle = (2.0 * 0.25 - 1.0 / 16.0) / (15.0 / 16.0)
    assert developed(camera, 0.25) == [round(255 * middle)]


def test_gamma_and_steps() -> None:
    assert developed(PLAIN.model_copy(update={"gamma": 2.0}), 0.25) == pytest.approx([127.5], abs=1)
    assert developed(PLAIN.model_copy(update={"bits": 1}), 0.4, 0.6) == [0, 255]
    assert developed(PLAIN.model_copy(update={"bits": 2}), 0.3) == [85]


def test_glare_moves_light_and_makes_none() -> None:
    from scanner_sim.render.camera import develop

    bright = np.zeros((61, 61), dtype=np.float32)
    bright[20, 40] = 300.0
    hazy = PLAIN.model_copy(update={"glare": 0.2})
    spread = develop(hazy, bright)
    assert develop(PLAIN, bright).astype(int).sum() == 255
    assert spread[20, 40] == 255
    assert 255 > spread[20, 43] > spread[20, 46] > spread[20, 52] > 0
    assert spread[20, 43] == spread[20, 37] == spread[17, 40]
    even = np.full((61, 61), 0.5, dtype=np.float32)
    assert abs(int(develop(hazy, even)[30, 30]) - 127.5) < 6.0


@pytest.mark.parametrize(
    "wrong", [{"exposure": 0.0}, {"stops": 0.0}, {"bits": 9}, {"glare": 1.0}, {"albedo": 1.2}, {"width": 1}]
)
def test_impossible_cameras_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Camera(**wrong)
