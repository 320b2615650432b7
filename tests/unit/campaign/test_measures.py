"""Measures against numbers that were put in."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.campaign import measures
from scanner_sim.campaign.measures import MEASURES, Outcome, measured
from scanner_sim.foundation.status import Status
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.image import RangeImage
from scanner_sim.tracking.record import TrackStatus
from scanner_sim.tracking.state import TrackMode

ERRORS = np.array([[0.001, -0.001, 0.003, 0.0], [0.02, 0.001, 0.0, 0.0]], dtype=np.float32)
SIGMA = 0.001


def image() -> RangeImage:
    """Eight voxels: seven valid, one of these of nothing, and one 20 σ off."""
    status = np.zeros((2, 4), dtype=np.float32)
    status[1, 3] = Status.BELOW_THRESHOLD
    valid = status == 0
    truth = np.full((2, 4), 8.0, dtype=np.float32)
    truth[1, 2] = np.nan
    ranges = np.where(valid, np.float32(8.0) + ERRORS, np.float32(np.nan))
    layers = dict.fromkeys(("range_m", "P.X", "P.Y", "P.Z"), ranges)
    layers |= {"sigma_range_m": np.where(valid, SIGMA, np.nan).astype(np.float32), "status": status}
    layers["truth.range_m"] = truth
    return RangeImage(layers, 0.01 * np.arange(4), 0.01 * np.arange(2))


def test_an_image_gives_the_numbers_that_were_put_in() -> None:
    names = tuple(name for name, one in MEASURES.items() if one.of == "scan")
    found = measured(names, Outcome(scan=image()))
    known = np.array([0.001, -0.001, 0.003, 0.0, 0.02, 0.001])
    # Ranges of 8 m are stored in single precision: 1e-6 m at most.
    assert found["bias_range"] == pytest.approx(known.mean(), abs=1e-6)
    assert found["rms_range"] == pytest.approx(np.sqrt(np.mean(known**2)), abs=1e-6)
    assert found["pull_range"] == pytest.approx(np.sqrt(np.mean((known / SIGMA) ** 2)), abs=1e-3)
    assert found["sigma_range"] == pytest.approx(SIGMA, rel=1e-6)
    assert found["coverage"] == pytest.approx(4 / 6)
    assert found["valid_share"] == pytest.approx(7 / 8)
    assert found["false_returns"] == pytest.approx(2 / 8)


def test_measures_have_the_unit_and_the_ideal_of_what_they_are() -> None:
    """Claim: angles are in rad, lengths in m, shares and ratios bare; an error is ideally 0, a ratio of errors to σ and
    a share of what is good 1, one in twenty lies beyond 1.96 σ, and six numbers have a mean square of six."""
    ideal = {"pull": 1.0, "coverage": 0.95, "share": 1.0, "mahalanobis": 6.0}
    for name, measure in MEASURES.items():
        bare = any(word in name for word in (*ideal, "returns", "tracks", "status"))
        angle = any(word in name for word in ("theta", "phi", "attitude", "omega"))
        assert measure.unit == ("1" if bare else "rad" if angle else "m"), name
        assert measure.best == next((best for word, best in ideal.items() if word in name), 0.0), name
        assert measure.of in {field.name for field in fields(Outcome)}
        assert " " in measure.meaning


def test_what_has_nothing_to_measure_is_nan() -> None:
    found = measured(tuple(MEASURES), Outcome(scan=image()))
    assert {name for name, value in found.items() if math.isnan(value)} == {
        name for name, one in MEASURES.items() if one.of != "scan"
    }
    empty = image()
    dark = {name: np.full_like(layer, np.nan) for name, layer in empty.channels.items()}
    dark["status"] = np.full((2, 4), Status.BELOW_THRESHOLD, dtype=np.float32)
    found = measured(
        ("sigma_range", "bias_range", "coverage", "valid_share"), Outcome(scan=replace(empty, channels=dark))
    )
    assert found["valid_share"] == 0.0
    assert all(math.isnan(found[name]) for name in ("sigma_range", "bias_range", "coverage"))


def series(errors: np.ndarray, covariance: np.ndarray, status: np.ndarray) -> PoseSeries:
    count = len(errors)
    turn = np.zeros((count, 3, 3))
    for number, (x, y, z) in enumerate(errors[:, 3:]):
        turn[number] = np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    truth = np.broadcast_to(np.eye(3), (count, 3, 3)).copy()
    zeros = np.zeros(count)
    return PoseSeries(
        "node", "", "joint", zeros, errors[:, :3], turn, np.broadcast_to(covariance, (count, 6, 6)).copy(), zeros,
        zeros.astype(np.int64), zeros.astype(np.int64), status, np.zeros((count, 3)), truth,
        *np.zeros((2, count, 6, 6)),
    )  # fmt: skip


def test_poses_give_their_distances_and_mahalanobis_six_where_the_covariance_is_right() -> None:
    """Claim: for 4000 errors drawn with the stated covariance the mean squared Mahalanobis distance is 6.

    It is a mean of χ² of six degrees: its standard deviation is √(12 / 4000) = 0.055, and five of them are the bound, a
    level of 6e-7. Rotations of a microradian are exp([δω]×) to 1e-12.
    """
    rng = np.random.default_rng(11)
    sigma = np.array([1e-3, 2e-3, 3e-3, 1e-6, 2e-6, 3e-6])
    mixed = np.eye(6) + 0.3
    covariance = sigma[:, None] * mixed * sigma
    errors = rng.multivariate_normal(np.zeros(6), covariance, 4000)
    status = np.zeros(4000, dtype=np.int8)
    found = measured(tuple(MEASURES), Outcome(poses=(series(errors, covariance, status),)))
    assert found["pose_mahalanobis"] == pytest.approx(6.0, abs=5.0 * math.sqrt(12.0 / 4000.0))
    assert found["pose_position"] == pytest.approx(
        np.sqrt(np.mean(np.sum(errors[:, :3] ** 2, axis=1))), rel=1e-9
    )
    assert found["pose_attitude"] == pytest.approx(
        np.sqrt(np.mean(np.sum(errors[:, 3:] ** 2, axis=1))), rel=1e-5
    )
    assert found["valid_pose_share"] == 1.0
    status[:1000] = PoseStatus.MIRRORED
    fewer = measured(
        ("pose_mahalanobis", "valid_pose_share"), Outcome(poses=(series(errors, covariance, status),))
    )
    assert fewer["valid_pose_share"] == 0.75


def test_the_last_pose_of_a_method_is_measured_alone() -> None:
    """Claim: status, errors and σ are those of the last pose by the method that is named."""
    errors = np.array([[9e-3] * 6, [7e-3] * 6, [1e-3, -2e-3, 3e-3, 1e-6, 2e-6, -3e-6]])
    covariance = np.diag(np.array([1e-3, 2e-3, 3e-3, 4e-6, 5e-6, 6e-6]) ** 2)
    status = np.array([PoseStatus.VALID, PoseStatus.MIRRORED, PoseStatus.AMBIGUOUS], dtype=np.int8)
    found = measured(tuple(MEASURES), Outcome(poses=(series(errors, covariance, status),)))
    assert found["joint_status"] == PoseStatus.AMBIGUOUS
    assert [found[f"joint_t_{axis}"] for axis in "xyz"] == pytest.approx([1e-3, -2e-3, 3e-3])
    assert found["joint_omega_z"] == pytest.approx(-3e-6, rel=1e-5)
    assert found["joint_omega_y_sigma"] == pytest.approx(5e-6)
    assert MEASURES["joint_omega_y_sigma"].unit == "rad"
    assert math.isnan(found["uv_status"])
    none = Outcome(poses=(series(errors[:0], covariance, status[:0]),))
    assert math.isnan(measured(("joint_t_x",), none)["joint_t_x"])


def test_a_track_gives_the_errors_of_what_it_measured() -> None:
    """Claim: rms errors by axis and the range's over its σ, of measured visits alone; how many were, and how often a
    target was lost that was not."""
    errors = np.array([[1e-4, -2e-4, 3e-3], [-3e-4, 1e-4, -4e-3], [9.0, 9.0, 9.0], [9.0, 9.0, 9.0]])
    sigmas = [1e-3, 8e-3, 1.0, 1.0]
    status = [TrackStatus.MEASURED] * 2 + [TrackStatus.REFUSED] * 2
    modes = [(TrackMode.SEARCH, TrackMode.TRACK), (TrackMode.TRACK, TrackMode.LOST)]
    modes += [(TrackMode.LOST, TrackMode.LOST), (TrackMode.LOST, TrackMode.SEARCH)]
    truth = np.array([0.1, -0.2, 8.0])
    records = [
        SimpleNamespace(
            position=truth + error, truth=truth, covariance=np.diag([1.0, 1.0, sigma**2]), status=one,
            mode=before, after=after,
        )
        for error, sigma, one, (before, after) in zip(errors, sigmas, status, modes, strict=True)
    ]  # fmt: skip
    track: Any = SimpleNamespace(records=records)
    found = measured(tuple(name for name, one in MEASURES.items() if one.of == "track"), Outcome(track=track))
    for axis, name in enumerate(("theta", "phi", "range")):
        wanted = math.sqrt(np.mean(errors[:2, axis] ** 2))
        assert found[f"rms_target_{name}"] == pytest.approx(wanted, rel=1e-9)
    assert found["pull_target_range"] == pytest.approx(math.sqrt((3.0**2 + 0.5**2) / 2.0), rel=1e-9)
    assert (found["measured_share"], found["lost_tracks"]) == (0.5, 1.0)


def test_what_has_no_truth_or_no_sigma_has_no_part_in_a_measure() -> None:
    """Claim: a valid pose whose truth is unknown is left out of all measures of errors, and so is a range whose σ is
    nothing."""
    errors = np.array([[3e-3, 0.0, 4e-3, 1e-6, 0.0, 0.0], [7e-3] * 6])
    poses = series(errors, np.eye(6), np.zeros(2, dtype=np.int8))
    poses.truth_position[1] = np.nan
    found = measured(("pose_position", "pose_mahalanobis"), Outcome(poses=(poses,)))
    assert found["pose_position"] == pytest.approx(5e-3)
    assert found["pose_mahalanobis"] == pytest.approx(25e-6 + 1e-12, rel=1e-4)
    layers = {
        "range_m": np.array([5.1, 5.3, 6.0, 9.0]), "sigma_range_m": np.array([0.1, 0.0, 0.2, 0.1]),
        "truth.range_m": np.array([5.0, 5.0, np.nan, 5.0]),
    }  # fmt: skip

    class Scan(dict[str, Any]):
        valid = np.array([True, True, True, False])

    error, sigma = measures._errors(Scan(layers))  # type: ignore[arg-type]
    np.testing.assert_allclose((error, sigma), ([0.1], [0.1]))
