"""Two results compared, from layers that were put in."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.products.difference import difference_json, difference_of, normal_beyond
from scanner_sim.products.image import RangeImage
from scanner_sim.products.shots import ShotTable

SHAPE = (3, 4)


def image(ranges: Any, sigma: float = 3e-3, seed: int = 1, **angles: Any) -> RangeImage:
    r = np.broadcast_to(np.asarray(ranges, dtype=np.float32), SHAPE).copy()
    status = np.where(np.isnan(r), np.float32(Status.MIXED), np.float32(Status.VALID))
    sigmas = np.where(np.isnan(r), np.float32(np.nan), np.float32(sigma))
    given = {"theta": np.linspace(-0.1, 0.1, SHAPE[1]), "phi": np.linspace(-0.1, 0.1, SHAPE[0])} | angles
    return RangeImage({"range_m": r, "sigma_range_m": sigmas, "status": status}, seed=seed, **given)


def test_differences_are_the_second_less_the_first_over_both_sigma() -> None:
    """Expected: 20 mm over the root of 3² + 4² mm² is 4 σ; 12 voxels less the one that only the first has."""
    first, second = image(5.0), np.full(SHAPE, 5.02)
    second[1, 2] = np.nan
    found = difference_of(first, image(second, 4e-3, seed=2))
    (one,) = found.ranges
    assert one.over_sigma[0, 0] == pytest.approx(4.0, rel=1e-4)
    assert np.argwhere(one.only_first).tolist() == [[1, 2]]
    assert not one.only_second.any()
    assert dict(found.statuses) == {(Status.VALID, Status.MIXED): 1}
    assert not found.same_seed
    told = json.loads(difference_json(found, {"changed_keys": ["seed"]}))
    numbers = told["ranges"]["range"]
    assert numbers["both"] == 11
    assert numbers["difference_m"]["median"] == pytest.approx(0.02, rel=1e-4)
    assert numbers["over_sigma"]["rms"] == pytest.approx(4.0, rel=1e-4)
    shares = {name: share["found"] for name, share in numbers["share_beyond"].items()}
    assert shares == {"2 sigma": 1.0, "3 sigma": 1.0, "5 sigma": 0.0}
    assert told["status_changes"] == [{"from": "VALID", "to": "MIXED", "count": 1}]
    assert told["seeds"] == [1, 2]
    assert told["changed_keys"] == ["seed"]


def test_differences_of_either_sign_count_alike() -> None:
    """Expected: 12 voxels, of which one has a range in the first and three in the second only; of the other eight two
    lie 4 σ nearer and one 4 σ farther, and five do not differ. What is nearer is negative."""
    first, second = np.full(SHAPE, 5.0), np.full(SHAPE, 5.0)
    first[0, :3], second[2, 3] = np.nan, np.nan
    second[1, :3] = 4.98, 4.98, 5.02
    (one,) = difference_of(image(first), image(second, 4e-3)).ranges
    numbers = one.numbers()
    assert (numbers["both"], numbers["only_first"], numbers["only_second"]) == (8, 1, 3)
    assert numbers["share_beyond"]["3 sigma"]["found"] == pytest.approx(3.0 / 8.0)
    assert numbers["difference_m"]["mean"] == pytest.approx(-0.02 / 8.0, rel=1e-4)
    assert numbers["over_sigma"]["rms"] == pytest.approx(4.0 * np.sqrt(3.0 / 8.0), rel=1e-4)
    assert numbers["over_sigma"]["mean"] == pytest.approx(-4.0 / 8.0, rel=1e-4)
    wanted = [[np.nan] * 3 + [0.0], [-4.0, -4.0, 4.0, 0.0], [0.0, 0.0, 0.0, np.nan]]
    np.testing.assert_allclose(one.over_sigma, wanted, rtol=1e-4)
    nearer = difference_of(image(5.0), image(4.98, 4e-3)).ranges[0].numbers()["over_sigma"]
    assert (nearer["mean"], nearer["median"]) == pytest.approx((-4.0, -4.0), rel=1e-4)


def test_a_result_differs_from_itself_by_nothing() -> None:
    found = difference_of(image(5.0), image(5.0))
    assert found.same_seed
    assert not found.statuses
    assert found.ranges[0].numbers()["over_sigma"]["rms"] == 0.0


def test_without_a_common_range_there_are_no_numbers() -> None:
    found = difference_of(image(np.nan), image(5.0))
    numbers = found.ranges[0].numbers()
    assert (numbers["both"], numbers["only_second"]) == (0, 12)
    assert numbers["difference_m"]["rms"] is None
    json.loads(difference_json(found, {}))


def test_the_normal_shares_are_those_of_the_tables() -> None:
    assert [normal_beyond(sigmas) for sigmas in (2.0, 3.0)] == pytest.approx(
        [2.0 * stats.norm.sf(2.0), 2.0 * stats.norm.sf(3.0)]
    )


@pytest.mark.parametrize(
    ("angles", "words"),
    [
        ({"theta": np.linspace(-0.1, 0.11, 4)}, "Θ differs by up to 0.573°"),
        ({"phi": np.linspace(0.0, 0.1, 3)}, "φ"),
    ],
)
def test_other_scans_are_refused(angles: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        difference_of(image(5.0), image(5.0, **angles))


def test_changes_of_status_come_by_their_number() -> None:
    """Claim: those of most voxels first; none that stayed what they were."""
    codes = np.zeros((2, *SHAPE), np.float32)
    codes[:, 0] = Status.MIXED
    codes[1, 1, :1], codes[1, 1, 1:], codes[1, 2, :2] = Status.SATURATED, Status.MIXED, Status.BELOW_THRESHOLD
    ranges = [np.where(own == Status.VALID, np.float32(5.0), np.float32(np.nan)) for own in codes]
    first, second = (
        replace(image(r), channels={"range_m": r, "sigma_range_m": 1e-3 * r, "status": own})
        for r, own in zip(ranges, codes, strict=True)
    )
    told = json.loads(difference_json(difference_of(first, second), {}))["status_changes"]
    assert [(one["from"], one["to"], one["count"]) for one in told] == [
        ("VALID", "MIXED", 3), ("VALID", "BELOW_THRESHOLD", 2), ("VALID", "SATURATED", 1),
    ]  # fmt: skip


def test_what_is_lost_one_way_is_won_the_other() -> None:
    """Claim: of two results in the other order each change of status is the reverse, as often."""
    codes = np.zeros((2, *SHAPE), np.float32)
    codes[0, 0, 1:], codes[1, 0], codes[1, 2, :2] = Status.OVERLAP, Status.BAD_SHAPE, Status.SATURATED
    ranges = [np.where(own == Status.VALID, np.float32(5.0), np.float32(np.nan)) for own in codes]
    first, second = (
        replace(image(r), channels={"range_m": r, "sigma_range_m": 1e-3 * r, "status": own})
        for r, own in zip(ranges, codes, strict=True)
    )
    lost = {
        (Status.OVERLAP, Status.BAD_SHAPE): 3,
        (Status.VALID, Status.BAD_SHAPE): 1,
        (Status.VALID, Status.SATURATED): 2,
    }
    assert difference_of(first, second).statuses == lost
    assert difference_of(second, first).statuses == {(b, a): count for (a, b), count in lost.items()}


def test_results_of_another_kind_or_size_are_told() -> None:
    flat = {name: layer.ravel() for name, layer in image(5.0).channels.items()}
    table = ShotTable(flat, np.arange(12.0), np.zeros(12), np.zeros(12))
    with pytest.raises(InputError, match="one result is a raster, and the other is a table of shots"):
        difference_of(image(5.0), table)
    short = {name: layer[:9] for name, layer in flat.items()}
    other = ShotTable(short, np.arange(9.0), np.zeros(9), np.zeros(9))
    with pytest.raises(InputError, match="different scans: 12 and 9"):
        difference_of(table, other)
    bare = replace(image(5.0), channels={"status": image(5.0)["status"]})
    with pytest.raises(InputError, match="no range_m with its σ in common"):
        difference_of(image(5.0), bare)
