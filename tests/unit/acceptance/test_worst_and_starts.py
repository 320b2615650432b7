"""What an acceptance test says in the end, and where its fits begin: worst repetitions, algebraic spheres, normals."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scanner_sim.acceptance import verdicts
from scanner_sim.acceptance.shapes import _algebraic, _kept, _principal
from scanner_sim.acceptance.verdicts import Accepted, Result, Verdict, worst_of


def result(quantity: str, artefact: str, repetition: int, error: float, verdict: Verdict) -> Result:
    one = 1e-3
    return Result(quantity, artefact, repetition, 0.5 + error, 0.5, one, one, one, one, 2e-3, one, verdict)


def test_the_worst_of_all_repetitions_decides() -> None:
    """Claim: a failure is worse than what is undecided, and that than a pass; of a test the repetition with the largest
    error of either sign stands for it, and the tests stay in their order."""
    passes, undecided, fails = Verdict.PASSES, Verdict.UNDECIDED, Verdict.FAILS
    assert worst_of([passes, fails, undecided]) is fails
    assert worst_of([passes, undecided, passes]) is undecided
    assert worst_of([passes]) is passes
    found = (
        result("size", "ball", 1, 1e-3, passes),
        result("form", "ball", 1, 4e-3, undecided),
        result("size", "ball", 2, -3e-3, undecided),
        result("form", "ball", 2, 2e-3, passes),
        result("size", "other", 1, 9e-3, passes),
    )
    setup: Any = SimpleNamespace()
    accepted = Accepted(setup, found, {})
    assert accepted.verdict is undecided
    assert accepted.worst("size", "ball") is found[2]
    assert [test.error for test in accepted.tests] == pytest.approx([-3e-3, 4e-3, 9e-3])
    assert [accepted.verdict_of(test) for test in accepted.tests] == [undecided, undecided, passes]


def test_a_search_for_a_sphere_begins_at_it() -> None:
    """Claim: of exact points of a cap the algebraic sphere is the sphere, far from the origin too."""
    rng = np.random.default_rng(3)
    way = rng.normal(size=(40, 3))
    way[:, 2] = -np.abs(way[:, 2]) - 0.3
    way /= np.linalg.norm(way, axis=1)[:, None]
    for centre, radius in (([0.3, -0.2, 6.0], 0.07), ([0.0, 0.0, 0.0], 2.0)):
        found = _algebraic(np.array(centre) + radius * way)
        np.testing.assert_allclose(found, [*centre, radius], atol=1e-9)


def test_the_farthest_points_are_left_out_on_either_side() -> None:
    deviations = np.array([0.1, -0.9, 0.2, 0.8, -0.3, 0.0, 0.05, -0.04, 0.5, -0.6])
    assert np.flatnonzero(~_kept(deviations, 0.3)).tolist() == [1, 3, 9]
    assert np.flatnonzero(~_kept(deviations, 0.29)).tolist() == [1, 3]
    assert _kept(deviations, 0.0).all()


@pytest.mark.parametrize("turn", [0.3, -0.4, 2.9])
def test_a_planes_normal_points_away_from_the_scanner(turn: float) -> None:
    """Claim: the last axis is square to a plane that is wider than high, and has a positive part along the sight."""
    rng = np.random.default_rng(5)
    flat = rng.uniform(-1.0, 1.0, (200, 3)) * [0.4, 0.2, 0.0]
    rotation = Rotation.from_rotvec([0.0, turn, 0.1])
    middle = np.array([0.5, -0.3, 5.0])
    mean, axes = _principal(rotation.apply(flat) + middle)
    normal = rotation.apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(mean, middle + rotation.apply(flat.mean(axis=0)), atol=1e-12)
    np.testing.assert_allclose(axes[2], normal * np.sign(normal @ middle), atol=1e-9)
    assert abs(axes[0] @ rotation.apply([1.0, 0.0, 0.0])) > 0.9
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)


def test_each_surface_has_draws_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: fits of one surface draw from a stream that no other surface has, nor what is made or seeded."""

    class OverError(Exception):
        """All surfaces were fitted."""

    def clouds(*_: Any, **__: Any) -> Any:
        for name in ("one", "two", "three"):
            yield SimpleNamespace(name=name, artefact=0), ("cloud",)
        raise OverError

    asked: list[Any] = []
    monkeypatch.setattr(verdicts, "measured_clouds", clouds)
    monkeypatch.setattr(verdicts, "fit_sphere", lambda *given: given)
    monkeypatch.setattr(verdicts, "host_generator", lambda *address: asked.append(address))
    plan = SimpleNamespace(artefacts={"ball": None}, seed=7, discarded=0.0)
    setup: Any = SimpleNamespace(plan=plan, surfaces=[])
    with pytest.raises(OverError):
        verdicts.accept(setup)
    assert [seed for seed, _, _ in asked] == [7] * 3
    numbers = [number for _, _, number in asked]
    assert len({0, 1, *numbers}) == 5
