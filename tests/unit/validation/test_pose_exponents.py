"""Exponents of a pose study: of what grows by known powers, each group of rows apart."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from scanner_sim.validation.studies.pose_laws import exponents_of, gains_of

OF = ("array", "size_m", "range_m", "method", "ranging", "component")
WIDE = math.exp(0.1 * 1.959964)


def row(array: str, size: float, distance: float, targets: int, method: str, ranging: str, axis: str) -> Any:
    """Return a row whose errors go by powers of range, size and number of targets that are all different, and differ
    from method to method; its interval of 95 % is 10 % to each side."""
    more = {"uv": 0.1, "xyz": 0.2, "joint": 0.3}[method] + (0.05 if axis == "t_z" else 0.0)
    near = 0.5 if ranging == "tof" else 0.0

    def power(step: float) -> float:
        grown = distance ** (2.0 + more - near + step) * size ** -(1.0 + more + step)
        return float(1e-4 * grown * targets ** -(0.5 + more + 2.0 * step))

    simulated = power(0.0)
    return SimpleNamespace(
        array=array, size_m=size, range_m=distance, targets=targets, method=method, ranging=ranging, component=axis,
        mode=(method, ranging), simulated=simulated, low=simulated / WIDE, high=simulated * WIDE,
        analytic=power(0.01), constant=power(0.02),
    )  # fmt: skip


def test_exponents_are_those_of_range_size_and_number() -> None:
    """Claim: of each layout, method and component over its ranges; of the base layout over its sizes, and of circles of
    its size over their numbers, both at the reference range; closed forms beside the simulated ones. The print is of
    angles and points by triangulation, and of the range alone. What has no error or no interval, or fewer than three
    steps, has no exponent. Of x at three steps of ln 2 with errors of a tenth σ is 0.1/(√2 ln 2).
    """
    modes = [("uv", "none"), ("xyz", "triangulation"), ("joint", "tof"), ("xyz", "tof")]
    layouts = [("square", size, 4) for size in (0.5, 1.0, 2.0, 4.0)]
    layouts += [("circle", 1.0, targets) for targets in (3, 6, 12)] + [("circle", 2.0, 24)]
    rows = [
        row(
            array if array == "square" else f"circle_{targets}",
            size,
            distance,
            targets,
            method,
            ranging,
            axis,
        )
        for array, size, targets in layouts
        for distance in (2.5, 5.0, 10.0)
        for method, ranging in modes
        for axis in ("t_x", "t_z")
    ]
    rows += [row("square", 8.0, distance, 4, "uv", "none", "t_x") for distance in (2.5, 10.0)]
    silent = row("square", 16.0, 10.0, 4, "uv", "none", "t_x")
    silent.simulated = 0.0
    unbounded = row("square", 32.0, 10.0, 4, "uv", "none", "t_x")
    unbounded.low, unbounded.simulated = 0.0, 5.0
    found = exponents_of([*rows, silent, unbounded], "square", 1.0, 10.0)
    kinds: dict[str, list[Any]] = {
        of: [one for one in found if one.of == of] for of in ("range", "size", "targets")
    }
    assert sum(map(len, kinds.values())) == len(found)
    assert {of: len(own) for of, own in kinds.items()} == {"range": 8 * 8, "size": 8, "targets": 8}
    for of, own in kinds.items():
        for one in own:
            more = {"uv": 0.1, "xyz": 0.2, "joint": 0.3}[one.method] + (
                0.05 if one.component == "t_z" else 0.0
            )
            near = 0.5 if one.ranging == "tof" else 0.0
            exponent, step = {
                "range": (2.0 + more - near, 1.0), "size": (-1.0 - more, -1.0), "targets": (-0.5 - more, -2.0),
            }[of]  # fmt: skip
            told = one.simulated, one.analytic, one.constant
            assert told == pytest.approx((exponent, exponent + 0.01 * step, exponent + 0.02 * step))
            assert math.isnan(one.size_m) is (of == "size")
            assert math.isnan(one.range_m) is (of == "range")
            assert one.array == "circle" if of == "targets" else one.array != "circle"
            if of == "range" or of == "targets":
                assert one.standard_error == pytest.approx(0.1 / (math.sqrt(2.0) * math.log(2.0)))
            printed = {("uv", "none"): 1.0, ("xyz", "triangulation"): 1.5}.get(
                (one.method, one.ranging), math.nan
            )
            wanted = printed if of == "range" else math.nan
            assert one.printed == pytest.approx(wanted, nan_ok=True)
    assert {one.range_m for one in kinds["size"] + kinds["targets"]} == {10.0}
    assert {one.size_m for one in kinds["targets"]} == {1.0}
    assert {one.size_m for one in kinds["range"]} == {0.5, 1.0, 2.0, 4.0}


def test_gains_are_those_of_the_base_array_alone() -> None:
    """Claim: of the array of that name and size, σ of points over that of angles alone and of both, at 5, 10 and 20 m;
    its error by those of both rows, 10 % each; another array of the same size, or the same of another, has no part."""

    def rows(array: str, size: float, factor: float) -> list[Any]:
        made = []
        for distance in (2.5, 5.0, 10.0):
            for method, ranging, sigma in (("uv", "none", 2.0), ("xyz", "tof", 7.0), ("joint", "tof", 1.6)):
                one = row(array, size, distance, 4, method, ranging, "t_z")
                own = factor * sigma if method == "xyz" else sigma
                one.simulated = own * distance
                one.low, one.high = one.simulated / WIDE, one.simulated * WIDE
                one.analytic, one.voxel = own, own**2
                made.append(one)
        return made

    others = [*rows("circle_4", 1.0, 3.0), *rows("square", 2.0, 5.0)]
    for given in ([*rows("square", 1.0, 1.0), *others], [*others, *rows("square", 1.0, 1.0)]):
        found = gains_of(given, "square", 1.0)
        assert [(one.range_m, one.method) for one in found] == [
            (5.0, "uv"),
            (5.0, "joint"),
            (10.0, "uv"),
            (10.0, "joint"),
        ]
        for one in found:
            gain = 7.0 / {"uv": 2.0, "joint": 1.6}[one.method]
            assert one.simulated == pytest.approx(gain)
            assert one.standard_error == pytest.approx(gain * math.hypot(0.1, 0.1))
            assert (one.analytic, one.voxel) == pytest.approx((gain, gain**2))
