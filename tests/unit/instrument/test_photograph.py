"""The video camera at work: which way up it is, how bright, how sharp, and when."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import claims
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import poisson

from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import InputError
from scanner_sim.render.device import activate
from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.scene.objects import Scene

pytestmark = pytest.mark.usefixtures("device")

SUN = {"sun": {"direction": (0.0, 0.0, -1.0), "spectrum": "astm_g173"}}
EARTHSHINE = {"sun": {"direction": (0.3, -0.4, 0.85)}, "earth": {"direction": (0.0, 0.6, -0.8)}}
PLAIN = {
    "interior": {"columns": 48, "rows": 36, "focal_length": 12e-3, "pixel_pitch": 50e-6},
    "lens": {"glare": {"veil": 0.0, "ghost": 0.0}, "aberration": 0.0, "f_number": 8.0},
    "exposure": {"type": "fixed", "time": 1e-3},
    "sampling": {"samples": 4, "edge_samples": 64, "bounces": 1},
}


def camera(**changes: Any) -> VideoCamera:
    blocks = {
        key: {**PLAIN.get(key, {}), **value}
        for key, value in changes.items()
        if isinstance(value, dict) and "type" not in value
    }
    return VideoCamera.model_validate({**PLAIN, **changes, **blocks})


def wall(x: float, y: float, size: float, **keys: Any) -> dict[str, Any]:
    material = {"reflectance": 0.1, "reflectance_visible": 0.9}
    return {
        "name": "wall",
        "shape": "rectangle",
        "size": (size, size),
        "position": (x, y, 10.0),
        "material": material,
        **keys,
    }


def taken(
    *objects: dict[str, Any],
    of: VideoCamera | None = None,
    times: Any = 0.0,
    light: Any = SUN,
    **options: Any,
) -> Any:
    from scanner_sim.instrument.photograph import photograph
    from scanner_sim.scene.files.loader import load_scene

    loaded = load_scene(Scene.model_validate({"objects": objects}), band="visible")
    lighting = Lighting.model_validate(light)
    return photograph(loaded, camera() if of is None else of, lighting, times, **options)


def even(found: Any, own: VideoCamera) -> NDArray[np.float64]:
    """Return the image without the fall of light towards the corners, which draws centroids inwards."""
    from scanner_sim.render.frame.lens_table import pixel_view_factors

    return np.asarray(found.truth.electrons[0] / pixel_view_factors(own.true_interior))


def centroid(image: NDArray[Any]) -> tuple[float, float]:
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    return float((image * columns).sum() / image.sum()), float((image * rows).sum() / image.sum())


def test_right_is_right_and_low_is_low() -> None:
    own = camera()
    u, v = centroid(even(taken(wall(0.7, 0.4, 0.4), of=own), own))
    assert (u, v) == pytest.approx(tuple(own.interior.project((0.7, 0.4, 10.0))), abs=0.02)


def test_an_even_plate_has_its_closed_form() -> None:
    """Claim: a Lambertian plate of ρ under the Sun gives ρ/π Φ η T π/(4N²) p² cos⁴θ cosβ electrons a second.

    Φ is summed here over ASTM G-173 with the energy of each photon, apart from the program's own integral. A path that
    goes on from the plate meets the Sun's disc, of Ω = π 4.65² 10⁻⁶, once in π/(Ω cosβ), and then counts twice: of
    27 648 paths so many as Poisson's law says, at the suite's level.
    Sixteen points drawn freely on the disc would scatter by α tanβ/(2 √16); in strata they do by less than 0.6 of that.
    """
    from scanner_sim.scene.light.sun import solar_irradiance

    tilt = 0.4
    light = {"sun": {"direction": (math.sin(tilt), 0.0, -math.cos(tilt)), "spectrum": "astm_g173"}}
    own = camera(sampling={"samples": 16})
    rate = taken(wall(0, 0, 20), of=own, light=light).truth.electrons[0] / 1e-3
    band = np.linspace(400e-9, 700e-9, 3001)
    middle = 0.5 * (band[1:] + band[:-1])
    sun = Lighting.model_validate(light).sun
    photons = float(
        np.sum(solar_irradiance(sun, middle) * np.diff(band) * middle / (6.62607015e-34 * 299792458.0))
    )
    v, u = np.mgrid[:36, :48]
    cos4 = (1.0 + ((u - 23.5) ** 2 + (v - 17.5) ** 2) * (50e-6 / 12e-3) ** 2) ** -2
    expected = 0.9 / np.pi * photons * math.cos(tilt) * 0.35 * 0.85 * np.pi / (4.0 * 64.0) * 50e-6**2 * cos4
    twice = np.maximum(np.rint(16.0 * (rate / expected - 1.0)), 0.0)
    single = rate / (expected * (1.0 + twice / 16.0))
    np.testing.assert_allclose(single, 1.0, rtol=1e-3)
    assert single.std() < 0.6 * 4.65e-3 * math.tan(tilt) / (2.0 * math.sqrt(16.0))
    assert twice.sum() <= poisson.isf(claims.LEVEL, 16 * rate.size * 4.65e-3**2 * math.cos(tilt))


def test_a_distorted_lens_keeps_the_light_and_puts_it_where_it_is_calibrated() -> None:
    """The whole image of a small plate holds the same light, and lies where the law of the lens says."""
    bent = {"k1": -0.25, "k2": 0.08, "p1": 2e-3, "p2": -1e-3, "principal_point": (24.3, 16.9)}
    finely = {"samples": 16, "edge_samples": 1024}
    own = camera(interior=bent, sampling=finely)
    plate = wall(0.7, 0.4, 0.3)
    image, ideal = (taken(plate, of=one).truth.electrons[0].sum() for one in (own, camera(sampling=finely)))
    assert image == pytest.approx(ideal, rel=5e-3)
    at = centroid(even(taken(plate, of=own), own))
    # The distortion bends the plate a little: a tenth of what it moves from one of its edges to the other.
    assert at == pytest.approx(tuple(own.interior.project((0.7, 0.4, 10.0))), abs=0.03)


def test_the_camera_as_built_is_not_what_is_believed() -> None:
    own = camera(as_built={"principal_point": (2.0, -1.0), "mount": {"position": (0.1, 0.0, 0.0)}})
    believed = own.interior.project((0.5, 0.4, 10.0))
    moved = 0.1 / 10.0 * own.interior.scale
    u, v = centroid(even(taken(wall(0.5, 0.4, 0.4), of=own), own))
    assert (u, v) == pytest.approx((believed[0] + 2.0 - moved, believed[1] - 1.0), abs=0.02)


@pytest.mark.parametrize("spread", [0.0, 0.3, 0.8])
def test_the_footprint_has_the_transfer_function_of_pixel_and_lens(spread: float) -> None:
    from scanner_sim.render.frame.footprint import footprint_quantiles

    nodes = footprint_quantiles(spread)
    for frequency in (0.1, 0.25, 0.5, 1.0):
        phase = 2.0 * np.pi * frequency * nodes
        # The mean over each piece between nodes, along which the place is linear.
        step = np.diff(phase)
        pieces = np.where(
            np.abs(step) > 1e-9, np.diff(np.sin(phase)) / np.where(step == 0, 1, step), np.cos(phase[1:])
        )
        expected = np.sinc(frequency) * math.exp(-2.0 * (np.pi * frequency * spread) ** 2)
        assert pieces.mean() == pytest.approx(expected, abs=1e-3)


def test_an_edge_is_as_blurred_as_pixel_and_lens_say() -> None:
    """The image of a straight edge is the integral of the footprint: a straight line convolved with a Gaussian.

    Of 32 × 32 samples of a pixel one column is halved by the edge: 2.8e-3 of it, 7e-4 of sixteen rows, of which 4.5 are
    exceeded by one column of fourteen at the suite's level; a thousandth is granted to the table of the footprint.
    """
    from scipy.special import ndtr

    own = camera(lens={"aberration": 30e-6}, sampling={"samples": 256, "edge_samples": 1024})
    scale = own.interior.scale
    edge = 10.0 * (20.37 - 23.5) / scale  # the left edge of the wall stands at u = 20.37
    image = even(taken(wall(edge + 5.0, 0.0, 10.0), of=own), own)
    spread = own.lens.point_spread / 50e-6
    x = np.linspace(-0.5, 0.5, 2001)
    expected = [ndtr((u + x - 20.37) / spread).mean() for u in range(14, 28)]
    found = image[10:26, 14:28].mean(axis=0) / image[10:26, 34:40].mean()
    np.testing.assert_allclose(found, np.array(expected), atol=4.5 * 7e-4 + 1e-3)


@pytest.mark.slow
def test_what_moves_is_blurred_over_the_exposure() -> None:
    """Claim: a plate that moves by d = 4.8 pixels in 10 ms is imaged d/2 on, its second moment larger by d²/12.

    Set-up: 20 m/s, twelve seeds; the lens blurs by a pixel, so that sums over pixels are integrals. Bounds: Student.
    """
    moving = {"motion": {"type": "twist", "velocity": (20.0, 0.0, 0.0)}}
    blur = {**PLAIN["lens"], "aberration": 50e-6}
    own = camera(
        exposure={"type": "fixed", "time": 10e-3}, lens=blur, sampling={"samples": 16, "edge_samples": 256}
    )
    column = np.arange(48)

    def moments(seed: int, **keys: Any) -> NDArray[np.float64]:
        profile = even(taken(wall(-0.1, 0.0, 0.3, **keys), of=own, seed=seed), own).sum(axis=0)
        mean = float(np.average(column, weights=profile))
        return np.array([mean, np.average((column - mean) ** 2, weights=profile), profile.sum()])

    pairs = np.array([(moments(seed), moments(seed, **moving)) for seed in range(12)])
    moved = 20.0 * 10e-3 / 10.0 * own.interior.scale
    along = claims.mean(pairs[:, 1, 0] - pairs[:, 0, 0], 0.5 * moved)
    wider = claims.mean(pairs[:, 1, 1] - pairs[:, 0, 1], moved**2 / 12.0)
    light = claims.mean(pairs[:, 1, 2] / pairs[:, 0, 2], 1.0)
    assert along, along
    assert wider, wider
    assert light, light
    assert along.finds < 0.05
    assert wider.finds < 0.3


def test_dots_have_their_centres() -> None:
    """Claim: 256 samples put the centres of black dots of 5 pixels on white to 0.005 pixel, one σ per axis.

    The footprint is symmetrical and the dot faces the camera: its centroid is its centre. Twenty dots beside
    one another at different places in their pixels; χ² of their errors over 0.005 pixel below its quantile of 1 − 1e-4.
    """
    from scipy import stats

    own = camera(
        interior={"columns": 120, "rows": 96, "pixel_pitch": 10e-6},
        lens={"aberration": 4e-6},
        sampling={"samples": 16, "edge_samples": 256},
    )
    size = 5.0 / own.interior.scale * 10.0
    spacing = 23.17 / own.interior.scale * 10.0
    pattern = {"diameter": size, "rows": 4, "columns": 5, "spacing": (spacing, spacing), "plate": spacing}
    board = {"name": "board", "array": pattern, "position": (0.003, 0.001, 10.0)}
    image = taken(board, of=own).truth.electrons[0].astype(float)
    errors = []
    for row in range(4):
        for column in range(5):
            where = (0.003 + (column - 2) * spacing, 0.001 + (row - 1.5) * spacing, 10.0)
            u, v = own.interior.project(where)
            low, left = round(v) - 8, round(u) - 8
            dark = image.max() - image[low : low + 17, left : left + 17]
            # Far from the dot the plate is even but for cos⁴θ, a plane here.
            y, x = np.mgrid[:17, :17]
            away = np.hypot(x + left - u, y + low - v) > 5.0
            plane = np.stack([np.ones_like(x), x, y], axis=-1).astype(float)
            fitted = np.linalg.lstsq(plane[away], dark[away], rcond=None)[0]
            dot = np.where(away, 0.0, dark - plane @ fitted)
            at = centroid(dot)
            errors += [at[0] + left - u, at[1] + low - v]
    z = np.square(np.array(errors) / 0.005).sum()
    assert z < stats.chi2.isf(1e-4, len(errors))


def test_sample_noise_is_stated() -> None:
    """Claim: over seeds, pixels scatter by what ``sample_sigma`` says, or less. Level: χ², a slack of 10 %."""
    from scipy import stats

    light = {**SUN, "earth": {"direction": (0.0, 1.0, 0.2), "albedo_visible": 0.9}}
    near = wall(0.3, 0.0, 0.9, name="near", position=(0.3, 0.2, 8.0), rotation={"axis": "x", "angle": 0.6})
    own = camera(sampling={"samples": 4, "edge_samples": 16, "bounces": 3})
    frames = [taken(wall(0, 0, 8), near, of=own, light=light, seed=seed) for seed in range(12)]
    electrons = np.array([one.truth.electrons[0] for one in frames], dtype=float)
    stated = np.mean([np.square(one.sample_sigma[0]) for one in frames], axis=0)
    found = electrons.var(axis=0, ddof=1)
    # Pixels are independent; the sum of unequal variances has the freedom of Satterthwaite.
    freedom = 11.0 * stated.sum() ** 2 / np.square(stated).sum()
    assert found.sum() < 1.1 * stated.sum() * stats.chi2.isf(1e-4, freedom) / freedom
    assert found.sum() > 0.3 * stated.sum()


def test_the_same_seed_gives_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    """On any number of threads, for any batch of paths, and for a frame among others or by itself."""
    import drjit as dr

    from scanner_sim.render.frame import light

    own, times = camera(), np.array([0.0, 0.05, 0.1])
    things = (
        wall(0.2, 0.0, 1.0, motion={"type": "twist", "velocity": (1.0, 0.0, 0.0)}),
        wall(0, 0, 3, name="far"),
    )
    before, found = dr.thread_count(), []
    try:
        for threads, batch in ((1, 2**20), (3, 2**20), (2, 10_000)):
            dr.set_thread_count(threads)
            monkeypatch.setattr(light, "_PATHS_AT_ONCE", batch)
            found.append(taken(*things, of=own, times=times, seed=4))
    finally:
        dr.set_thread_count(before)
    for other in found[1:]:
        assert other.counts.tobytes() == found[0].counts.tobytes()
        assert other.truth.electrons.tobytes() == found[0].truth.electrons.tobytes()
    alone = taken(*things, of=own, times=times[:1], seed=4)
    assert alone.counts[0].tobytes() == found[0].counts[0].tobytes()
    assert taken(*things, of=own, times=times[:1], seed=5).counts.tobytes() != alone.counts.tobytes()


def new_kernels() -> int:
    """Return how many kernels a frame of another pose, exposure, motion and seed needs after a first one."""
    import drjit as dr

    activate("cpu", 1)
    missed = 0
    for speed, time, seed, at in ((1.0, 1e-3, 0, 0.0), (2.0, 3e-3, 5, 0.2)):
        own = camera(exposure={"type": "fixed", "time": time}, mount={"position": (at, 0.0, 0.0)})
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            taken(wall(0, 0, 1, motion={"type": "twist", "velocity": (speed, 0, 0)}), of=own, seed=seed)
            kernels = [one for one in dr.kernel_history() if one["type"] == dr.KernelType.JIT]
        assert kernels
        missed = sum(not one["cache_hit"] for one in kernels)
    return missed


@pytest.mark.slow
def test_another_pose_exposure_or_seed_compiles_nothing_anew() -> None:
    """In a process of its own, where no other test has compiled what is asked for."""
    code = f"import runpy; print(runpy.run_path({__file__!r})['new_kernels']())"
    tests = str(Path(__file__).resolve().parents[2])
    made = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": tests},
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    assert made.stdout.strip() == "0"


def test_the_control_follows_the_light_by_its_lag() -> None:
    own = camera(
        exposure={"type": "automatic", "start": 1e-4, "shortest": 1e-7, "lag": 2, "rate": 0.5},
        frame_rate=30.0,
    )
    found = taken(wall(0, 0, 20), of=own, times=np.arange(24) / 30.0)
    assert found.exposure_s[0] == found.exposure_s[1] == 1e-4
    level = (found.counts.mean(axis=(1, 2)) - 2.0) / 253.0
    assert found.exposure_s[2] == pytest.approx(1e-4 * (0.35 / level[0]) ** 0.5)
    assert level[-1] == pytest.approx(0.35, rel=0.02)
    np.testing.assert_allclose(found.time_s, np.arange(24) / 30.0 + 0.5 * found.exposure_s)
    np.testing.assert_allclose(found.available_s - found.time_s, 0.5 * found.exposure_s + own.latency)
    settled = taken(wall(0, 0, 20), of=camera(exposure={"type": "automatic", "shortest": 1e-7}))
    assert settled.exposure_s[0] == pytest.approx(found.exposure_s[-1], rel=0.05)


def test_in_the_dark_there_is_noise_alone() -> None:
    found = taken(wall(0, 0, 8), light={})
    assert found.truth.electrons.max() == 0.0
    assert not found.saturated.any()
    assert 0 < found.counts.max() < 10


def test_the_earth_lights_what_the_sun_does_not() -> None:
    """The front of a plate whose back is in the Sun is black, but for the Earth, and is as bright as its albedo."""
    behind = {"direction": (0.0, -0.5, 0.8)}
    bright = []
    for albedo in (0.0, 0.3, 0.6):
        light = {"sun": behind, "earth": {"direction": (0.0, 1.0, -0.3), "albedo_visible": albedo}}
        bright.append(taken(wall(0, 0, 12), light=light).truth.electrons.mean(dtype=float))
    assert bright[0] == 0.0
    assert bright[1] > 0.0
    assert bright[2] == pytest.approx(2.0 * bright[1], rel=1e-5)


def test_the_sun_in_the_frame_saturates_and_beside_it_veils() -> None:
    seen = {"sun": {"direction": (0.05, 0.05, 1.0)}}
    beside = {"sun": {"direction": (0.14, 0.0, 1.0)}}
    hazy = camera(lens={"glare": {"veil": 0.01, "ghost": 0.0}})
    frame = taken(wall(-3, 0, 0.5), of=hazy, light=seen)
    u, v = hazy.interior.project((0.05, 0.05, 1.0))
    assert frame.saturated[0, round(v), round(u)]
    assert frame.saturated[0, :, round(u)].sum() > 5
    edge = taken(wall(-3, 0, 0.5), of=hazy, light=beside).truth.electrons[0]
    assert edge[18, 46] > edge[18, 30] > edge[18, 5] > 0.0
    hidden = wall(1.4, 0, 0.5)
    assert taken(hidden, of=hazy, light=beside).truth.electrons[0].sum() < 1e-3 * edge.sum()


def test_an_unknown_visible_reflectance_is_said() -> None:
    found = taken(wall(0, 0, 3, material={"reflectance": 0.4}), wall(0, 0, 1, name="own"))
    assert [
        note for note in found.notes if "reflectance_0.4" in note and "visible light is not known" in note
    ]
    assert len(found.notes) == 1


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, ["'paint'"]),
        ({"lighting": {}}, []),
        ({"output": {"pictures": False}}, []),
        ({"scene": {"objects": [wall(0, 0, 3)]}}, []),
    ],
)
def test_a_run_says_which_visible_reflectances_are_unknown(changes: Any, said: list[str]) -> None:
    """Claim: ``check`` and ``run`` say so where the camera takes a frame, and nowhere else."""
    from scanner_sim import Scenario
    from scanner_sim.instrument.scene_warnings import scene_warnings

    paint = wall(0, 0, 3, material={"reflectance": 0.4, "name": "paint"})
    raster = {"rows": 4, "columns": 4, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
    plain = {"schema": 1, "scene": {"objects": [paint]}, "lighting": SUN, "scan": raster}
    found = [one for one in scene_warnings(Scenario.model_validate({**plain, **changes})) if "visible" in one]
    assert len(found) == len(said)
    assert all(name in one for name, one in zip(said, found, strict=True))


def test_materials_of_mitsuba_files_are_the_librarys_in_visible_light(tmp_path: Path) -> None:
    """Claim: a file's surface with the id of a material of the library is seen as that, another as the file says."""
    text = """<scene version="3.0.0"><bsdf type="twosided" id="{name}"><bsdf type="diffuse">
    <spectrum name="reflectance" value="0.8"/></bsdf></bsdf>
    <shape type="rectangle"><transform name="to_world"><scale value="8"/></transform><ref id="{name}"/></shape>
    </scene>"""
    means = {}
    for name in ("dyed_black_anodise", "my_paint"):
        path = tmp_path / f"{name}.xml"
        path.write_text(text.format(name=name), encoding="utf-8")
        facing = {"axis": "y", "angle": np.pi}
        found = taken({"name": "sheet", "file": path, "position": (0.0, 0.0, 10.0), "rotation": facing})
        means[name] = found.truth.electrons[0].mean()
        assert any(name in note for note in found.notes) == (name == "my_paint")
    assert means["dyed_black_anodise"] / means["my_paint"] == pytest.approx(0.05 / 0.8, rel=0.02)


def test_frames_need_times_and_poses() -> None:
    for times in ([], [1.0, 0.5], [np.nan]):
        with pytest.raises(InputError, match="ascend"):
            taken(wall(0, 0, 1), times=times)
    with pytest.raises(InputError, match="as many poses"):
        taken(wall(0, 0, 1), times=[0.0, 1.0], mounts=np.eye(4)[None])


def test_poses_of_the_camera_may_differ_from_frame_to_frame() -> None:
    mounts = np.tile(np.eye(4), (2, 1, 1))
    mounts[1, :3, 3] = (0.1, 0.1, 1.0)
    own = camera()
    found = taken(wall(0.5, 0.4, 0.4), of=own, times=[0.0, 1.0], mounts=mounts)
    for image, mount in zip(found.truth.electrons, mounts, strict=True):
        expected = own.interior.project(np.array([0.5, 0.4, 10.0]) - mount[:3, 3])
        assert centroid(image) == pytest.approx(tuple(expected), abs=0.03)


def test_a_told_eclipse_dims_the_frames_after_it() -> None:
    """Claim: of a Sun of which 40 % arrive a Lambertian plate sends back 40 %; frames before see all of it.

    A path that by chance leaves the plate into the Sun's disc counts for another of its pixel: of four in each of 1728
    pixels in two frames 0.3 do, and six with a chance of 1e-6.
    """
    told = {**SUN, "changes": [{"time": 0.5, "visible": 0.4}]}
    found = taken(wall(0, 0, 20), light=told, times=[0.0, 1.0]).truth.electrons
    assert (np.abs(found[1] / found[0] / 0.4 - 1.0) > 1e-4).sum() < 6


def watched(window: Any, *objects: dict[str, Any], light: Any, seed: int = 0, **options: Any) -> Any:
    from scanner_sim.instrument.photograph import frames_in_turn
    from scanner_sim.scene.files.loader import load_scene

    loaded = load_scene(Scene.model_validate({"objects": objects}), band="visible")
    own = camera(**options)
    lit = Lighting.model_validate(light)
    (frame,) = frames_in_turn(loaded, own, lit, [0.0], seed=seed, look=lambda: window)
    return frame


def test_a_window_has_the_light_of_the_whole_frame() -> None:
    """Claim: under the Sun alone a window of a frame is the same part of the whole one; beyond it is rough.

    The paths are the same. One in some hundreds happens upon the Sun's disc by the plate's own scattering: the pixel is
    then brighter in a whole frame, and all of them a little in a window. Beyond the window each pixel stands for
    sixteen, which differ by the fall of light to the corners, a tenth of 1 % from pixel to pixel here.
    """
    from scanner_sim.optics.pixel_window import PixelWindow

    own = {"bounces": 1, "samples": 16}
    inside = PixelWindow(10, 30, 5, 25)
    frame = watched(inside, wall(0, 0, 20), light=SUN, sampling=own)
    whole = taken(wall(0, 0, 20), of=camera(sampling=own))
    over = np.abs(frame.truth.electrons / whole.truth.electrons - 1.0)[0]
    assert np.mean(over[inside.where] < 1e-3) > 0.95
    assert np.mean(over < 1e-2) > 0.95
    known = np.zeros((36, 48), dtype=bool)
    known[inside.where] = True
    np.testing.assert_array_equal(np.isfinite(frame.sample_sigma[0]), known)
    assert np.isfinite(frame.noise_share).all()
    # Of the pixels that are followed: σ² by samples over that of light and sensor, means of both.
    for one in (frame, whole):
        noise = camera().sensor.variance(one.truth.electrons[0].astype(np.float64), float(one.exposure_s[0]))
        followed = np.isfinite(one.sample_sigma[0])
        wanted = np.mean(one.sample_sigma[0][followed].astype(np.float64) ** 2) / noise[followed].mean()
        assert one.noise_share[0] == pytest.approx(wanted, rel=1e-4)


def test_the_slow_light_of_a_face_is_its_mean_with_its_error() -> None:
    """Claim: a plate that the Earth alone lights is as bright in a window as in frames, with a smaller stated error.

    Set-up: the Sun behind the plate, 16 paths a pixel. Compared is the mean over the window, whose error is that of the
    frame's mean, pixels apart, and of the window's, pixels together; 4 σ, a level of 6e-5.
    """
    from scanner_sim.optics.pixel_window import PixelWindow

    inside = PixelWindow(4, 32, 4, 44)
    own = {"bounces": 1, "samples": 16, "edge_samples": 64}
    frame = watched(inside, wall(0, 0, 40), light=EARTHSHINE, sampling=own)
    whole = taken(wall(0, 0, 40), of=camera(sampling=own), light=EARTHSHINE)
    mine, other = (one.truth.electrons[0][inside.where] for one in (frame, whole))
    sigma, plain = (one.sample_sigma[0][inside.where] for one in (frame, whole))
    assert mine.mean() > 1.0
    apart = math.hypot(float(sigma.mean()), float(plain.mean()) / math.sqrt(plain.size))
    assert abs(mine.mean() - other.mean()) < 4.0 * apart
    assert sigma.mean() < 0.2 * plain.mean()
    assert mine.std() < 0.3 * other.std()


@pytest.mark.parametrize("light", [SUN, EARTHSHINE])
def test_edges_in_a_window_scatter_by_what_is_stated(light: Any) -> None:
    """Claim: over seeds, pixels at a plate's edges scatter by ``sample_sigma``, or less, by Sun and by Earth alone.

    Set-up: a plate aslant, twelve frames. What all its pixels share, the mean of the Earth's light on it, is taken off.
    Level: χ², a slack of 10 %. By the Earth's light nothing of the share of the plate in a pixel was once in σ.
    """
    from scipy import stats

    from scanner_sim.optics.pixel_window import PixelWindow

    plate, inside = wall(0.1, 0.05, 1.1, rotation={"axis": "z", "angle": 0.3}), PixelWindow(2, 34, 4, 46)
    own = {"bounces": 1, "samples": 16, "edge_samples": 64}
    frames = [watched(inside, plate, light=light, seed=seed, sampling=own) for seed in range(12)]
    electrons = np.array([one.truth.electrons[0][inside.where] for one in frames], dtype=np.float64)
    level = electrons.mean(axis=(1, 2), keepdims=True)
    electrons *= level.mean() / level
    mean, found = electrons.mean(axis=0), electrons.var(axis=0, ddof=1)
    edge = (mean > 0.05 * mean.max()) & (mean < 0.9 * mean.max())
    assert edge.sum() > 40
    stated = np.mean([np.square(one.sample_sigma[0][inside.where]) for one in frames], axis=0)[edge]
    freedom = 11.0 * stated.sum() ** 2 / np.square(stated).sum()
    assert found[edge].sum() < 1.1 * stated.sum() * stats.chi2.isf(1e-4, freedom) / freedom
    assert found[edge].sum() > 0.1 * stated.sum()
