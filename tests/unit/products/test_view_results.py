"""What the page of a scan and of a track holds, by hand from the results: places, errors, σ, colours, words."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_track import DG, SIGMA, make_track, placed
from numpy.typing import NDArray

from scanner_sim import load_scenario, simulate
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.closed_loop.poses import poses_of
from scanner_sim.instrument.viewing import surroundings_of
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.scene_view import Field, SceneView, ViewedObject
from scanner_sim.products.shots import ShotTable
from scanner_sim.products.view.packing import unpacked
from scanner_sim.products.view.scan import scan_data, shades
from scanner_sim.products.view.surroundings import Surroundings
from scanner_sim.products.view.track import _pose, track_data
from scanner_sim.ranging.axes import Axes
from scanner_sim.tracking.record import TrackStatus
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

AROUND = Surroundings(
    horizontal=(-0.1, 0.1),
    vertical=(-0.05, 0.05),
    array=None,
    gate=(0.5, math.inf),
    scale=0.1,
    baseline=0.2,
    axes=Axes(DG),
    sun=None,
    sun_visible=1.0,
)


def points(r: Array, theta: Array, phi: Array) -> Array:
    """Return (x, y, z) by eq 3."""
    reach = r * np.cos(theta) - DG
    return np.stack([r * np.sin(theta), reach * np.sin(phi), reach * np.cos(phi) + DG], axis=-1)


def test_a_page_of_a_scan_shows_its_points_and_the_true_ones_where_there_are_none() -> None:
    """Claim: of every second row and column, the places of valid voxels as measured and of others where the beam met
    the wall, to 0.04 mm, about axes that are built aside and with encoders that err; layers with their unit; the far
    end 3 % behind the farthest."""
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": (9.0, 9.0),
        "position": (0.0, 0.0, 6.0),
        "material": "z93_white",
    }
    scan = {"type": "raster", "rows": 5, "columns": 7, "horizontal": (-0.1, 0.1), "vertical": (-0.05, 0.05)}
    own = {
        "axis_separation": 2e-3,
        "axis_offset": 1e-3,
        "axis_skew": 2e-3,
        "theta_zero": 1e-3,
        "phi_scale": 5e-3,
    }
    told = {"scanner": {"as_built": own}, "output": {"truth": ["point"]}}
    scenario = load_scenario({"schema": 1, "scene": {"objects": [wall]}, "scan": scan} | told)
    image, around = simulate(scenario, device="cpu"), surroundings_of(scenario)
    channels = {name: image[name].copy() for name in image.channels}
    for name, values in channels.items():
        if not name.startswith("truth."):
            values[4, 4] = int(Status.BAD_SHAPE) if name == "status" else np.nan
    image = replace(image, channels=channels)
    data = scan_data(image, around, title="wall", step=2)
    assert (data["shape"], data["step"], data["raster"]) == ([3, 4], 2, True)
    theta = np.tile(np.linspace(-0.1, 0.1, 7)[::2], 3)
    phi = np.repeat(np.linspace(-0.05, 0.05, 5)[::2], 4)
    np.testing.assert_allclose(unpacked(data["theta"]).ravel(), theta, atol=1e-7)
    np.testing.assert_allclose(unpacked(data["phi"]).ravel(), phi, atol=1e-7)
    place = unpacked(data["position"]).reshape(3, 4, 3)
    measured = np.stack([image[f"P.{axis}"][::2, ::2] for axis in "XYZ"], axis=-1)
    true = np.stack([image[f"truth.P.{axis}"][::2, ::2] for axis in "XYZ"], axis=-1)
    other = np.zeros((3, 4), dtype=bool)
    other[2, 2] = True
    np.testing.assert_allclose(place[~other], measured[~other], atol=4e-5)
    np.testing.assert_allclose(place[other], true[other], atol=4e-5)
    assert data["layers"]["range_m"]["unit"] == "m"
    np.testing.assert_allclose(
        unpacked(data["layers"]["range_m"]).ravel(), image["range_m"][::2, ::2].ravel(), rtol=1e-6
    )
    farthest = 1.03 * float(image["range_m"][image.valid].max())
    assert data["surroundings"]["drawn_far"] == pytest.approx(farthest)
    assert "5 × 7 voxels, 34 with a range" in data["about"]
    by = {one["name"]: one for one in shades(image)}
    assert (by["error"]["layer"], by["error"]["minus"], by["error"]["factor"]) == (
        "range_m",
        "truth.range_m",
        1e3,
    )
    assert (by["error over σ"]["over"], by["error over σ"]["factor"]) == ("sigma_range_m", 1.0)
    assert by["range"]["factor"] == 1.0
    assert by["σ of the range"]["factor"] == 1e3
    assert "background" not in by
    assert "true incidence" not in by


def test_a_page_of_shots_has_the_angles_of_each() -> None:
    """Claim: of every second shot where it goes, and where one without a range would be, by eq 3."""
    theta, phi = np.array([0.3, -0.1, 0.2, 0.05, -0.2]), np.array([-0.1, 0.15, 0.02, -0.05, 0.12])
    status = np.array([0, 0, int(Status.BAD_SHAPE), 0, 0], dtype=np.float32)
    reach, true = np.where(status == 0, 5.0, np.nan), np.array([5.0, 6.0, 7.0, 8.0, 9.0])
    layers = {
        "range_m": reach,
        "status": status,
        "Y": 1e4 * true,
        "truth.range_m": true,
        "sigma_range_m": 1e-3 * reach,
    }
    layers |= {f"P.{axis}": column for axis, column in zip("XYZ", points(reach, theta, phi).T, strict=True)}
    channels = {name: values.astype(np.float32) for name, values in layers.items()}
    data = scan_data(ShotTable(channels, np.arange(5.0), theta, phi), AROUND, title="shots", step=2)
    assert (data["shape"], data["step"], data["raster"]) == ([3], 2, False)
    np.testing.assert_allclose(unpacked(data["theta"]).ravel(), theta[::2], atol=1e-7)
    np.testing.assert_allclose(unpacked(data["phi"]).ravel(), phi[::2], atol=1e-7)
    place = unpacked(data["position"]).reshape(3, 3)
    wanted = points(np.array([5.0, 7.0, 5.0]), theta[::2], phi[::2])
    np.testing.assert_allclose(place, wanted, atol=5e-5)
    assert "5 shots, 4 with a range" in data["about"]


@pytest.mark.parametrize("most", [2, 255, 256, 70_000])
def test_a_page_has_the_numbers_of_many_objects(most: int) -> None:
    """Claim: the number of each shot's object is shown as it is, however many objects there are."""
    one = np.ones(3, dtype=np.float32)
    numbers = np.array([0, most, 1], dtype=np.float32)
    channels = {"range_m": one, "status": 0 * one, "truth.object": numbers}
    channels |= {f"P.{axis}": one for axis in "XYZ"}
    names = tuple(f"object {number}" for number in range(most))
    table = ShotTable(channels, np.arange(3.0), np.zeros(3), np.zeros(3), objects=names)
    data = scan_data(table, AROUND, title="shots")
    assert unpacked(data["layers"]["truth.object"]).ravel().tolist() == [0, most, 1]


@pytest.mark.parametrize(("near", "shown"), [(4.0, 8.0), (0.3, 1.0)])
def test_a_page_without_ranges_shows_the_field_to_twice_the_nearest(near: float, shown: float) -> None:
    """Claim: twice the nearest range that is measured, a metre at least."""
    image = simulate(
        load_scenario({"schema": 1, "scan": {
            "type": "raster", "rows": 2, "columns": 3, "horizontal": (-0.1, 0.1), "vertical": (-0.05, 0.05)}}),
        device="cpu",
    )  # fmt: skip
    assert not image.valid.any()
    data = scan_data(image, replace(AROUND, gate=(near, math.inf)), title="nothing", step=1)
    assert data["surroundings"]["drawn_far"] == pytest.approx(shown)


def test_a_page_of_a_track_has_errors_and_sigma_of_its_ranges() -> None:
    """Claim: measured less true range, √ of its variance, and the voxels of patterns about the axes that the instrument
    believes, visit after visit."""
    made = replace(make_track(), axes=Axes(0.052, 1e-3, 2e-3))
    # What a visit decides is not always what it was made for.
    track = replace(made, records=(replace(made.records[0], after=TrackMode.LOST), *made.records[1:]))
    records, poses = track.records, poses_of(track)
    data = track_data(track, poses, AROUND, outlines=np.zeros((len(records), 2, 3)), title="track")
    # Poses of one object in another's frame have no place among those in the scanner's.
    alone = [(one.name, one.method) for one in poses if not one.relative_to]
    assert 0 < len(alone) < len(poses)
    assert [(one["object"], one["method"]) for one in data["poses"]] == alone
    visits = data["visits"]
    error = np.array([one.position[2] - one.truth[2] for one in records])
    np.testing.assert_allclose(unpacked(visits["error"]).ravel(), error, rtol=1e-6)
    found = np.array([one.status is TrackStatus.MEASURED for one in records])
    sigma = unpacked(visits["sigma"]).ravel()
    np.testing.assert_allclose(sigma[found], SIGMA[2], rtol=3e-4)
    assert np.isnan(sigma[~found]).all()
    np.testing.assert_allclose(unpacked(visits["time"]).ravel(), [one.time for one in records], rtol=1e-6)
    names = [target.name for target in track.targets]
    assert unpacked(visits["target"]).ravel().tolist() == [names.index(one.target) for one in records]
    modes = unpacked(visits["mode"]).ravel().tolist()
    assert [data["modes"][mode] for mode in modes] == [one.mode.value for one in records]
    later = [data["modes"][mode] for mode in unpacked(visits["after"]).ravel().tolist()]
    assert later == [one.after.value for one in records]
    codes = unpacked(visits["status"]).ravel().tolist()
    assert [data["statuses"][code]["name"] for code in codes] == [
        one.status.name.lower().replace("_", " ") for one in records
    ]
    np.testing.assert_allclose(
        unpacked(visits["truth_point"]).reshape(-1, 3),
        np.stack([one.truth_point for one in records]),
        atol=4e-5,
    )
    far = max(float(np.linalg.norm(one.truth_point)) for one in records)
    assert data["surroundings"]["drawn_far"] == pytest.approx(1.1 * far)
    assert f"{len(records)} visits to {len(names)} targets in {records[-1].time:.4g} s" in data["about"]
    first = unpacked(data["patterns"]["first"]).ravel()
    voxels = unpacked(data["patterns"]["point"]).reshape(-1, 3)
    signals = unpacked(data["patterns"]["signal"]).ravel()
    for number in (0, 5):
        samples: Any = records[number].samples
        good = (samples.status[0] == Status.VALID) & np.isfinite(samples.range[0])
        own = slice(first[number], first[number + 1])
        assert first[number + 1] - first[number] == good.sum()
        wanted = placed(made.axes, samples.range[0][good], samples.theta[0][good], samples.phi[0][good])
        np.testing.assert_allclose(voxels[own], wanted, atol=4e-5)
        np.testing.assert_allclose(signals[own], samples.signal[0][good], rtol=3e-4)


def seen_as(points: Array, share: float = 0.0) -> str:
    one = ViewedObject("a", "box", (), 0, points, share, False)
    field = Field((-0.2, 0.1), (-0.05, 0.3), 1.0, 9.0)
    view = SceneView((one,), field, field[:2], np.zeros((1, 1), int), np.zeros((1, 1)), np.ones((1, 1)))
    return view.seen(one)


def test_words_say_whether_an_object_is_in_view() -> None:
    """Claim: its share; behind the scanner; within the field of Θ from −0.2 to 0.1 and φ from −0.05 to 0.3 but not
    seen; or beside it."""
    assert seen_as(np.ones((1, 3)), 0.123) == "in view, 12 %"
    assert seen_as(np.ones((1, 3)), 1e-4) == "in view, 0.01 %"
    assert seen_as(np.array([[0.1, 0.2, -3.0], [0.0, 0.0, 0.0]])) == "behind the scanner"
    for theta, phi, inside in (
        (-0.19, 0.29, True), (-0.21, 0.1, False), (0.09, -0.04, True), (0.11, 0.1, False), (0.0, 0.31, False),
        (0.0, -0.06, False),
    ):  # fmt: skip
        place = 5.0 * np.array(
            [[math.tan(theta), math.tan(phi), 1.0], [math.tan(theta), math.tan(phi), -1.0]]
        )
        words = "hidden, or finer than the picture" if inside else "outside of the field of view"
        assert seen_as(place) == words
    box = ViewedObject("a", "box", (), 0, np.array([[1.0, 2.0, 2.0], [-2.0, 0.0, 9.0]]), 0.0, False)
    assert box.size.tolist() == [3.0, 2.0, 7.0]
    assert box.distance == 3.0


def test_poses_of_a_page_are_told_by_place_and_attitude() -> None:
    """Claim: errors are lengths of the shift and of the turn, σ the roots of the traces of their covariances; a pose
    that is not valid is none."""
    rng = np.random.default_rng(5)
    covariance = rng.uniform(0.1, 0.9, (3, 6, 6))
    error = rng.normal(size=(3, 6))
    status = np.array([PoseStatus.VALID, PoseStatus.AMBIGUOUS, PoseStatus.VALID])
    series: Any = SimpleNamespace(
        name="o", method="uv", time=np.array([0.5, 1.0, 1.5]), status=status, covariance=covariance, error=error,
        position=np.arange(9.0).reshape(3, 3), rotation=np.arange(27.0).reshape(3, 3, 3),
        truth_position=np.arange(9.0).reshape(3, 3) + 1.0, truth_rotation=np.arange(27.0).reshape(3, 3, 3) + 1.0,
    )  # fmt: skip
    found = {
        name: unpacked(value) if isinstance(value, dict) else value for name, value in _pose(series).items()
    }
    assert (found["object"], found["method"]) == ("o", "uv")
    np.testing.assert_array_equal(np.ravel(found["good"]), [1, 0, 1])
    shift, turn = (np.linalg.norm(error[:, part], axis=1) for part in (slice(0, 3), slice(3, 6)))
    np.testing.assert_allclose(np.reshape(found["error"], (3, 2)), np.stack([shift, turn], axis=1), rtol=1e-6)
    diagonal = np.diagonal(covariance, axis1=1, axis2=2)
    sigma = np.sqrt(np.stack([diagonal[:, :3].sum(axis=1), diagonal[:, 3:].sum(axis=1)], axis=1))
    np.testing.assert_allclose(np.reshape(found["sigma"], (3, 2)), sigma, rtol=3e-4)
    for name in ("position", "truth_position", "rotation", "truth_rotation", "time"):
        np.testing.assert_allclose(np.ravel(found[name]), np.ravel(getattr(series, name)), rtol=1e-5)
