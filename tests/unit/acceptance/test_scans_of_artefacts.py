"""What is scanned of each artefact: where its balls stand, how large they were made, and with which raster."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.acceptance import measured
from scanner_sim.acceptance.plan import Ball, LengthBar, Plate

GREY = {"reflectance": 0.5}
BAR = LengthBar.model_validate({
    "name": "bar", "position": (0.1, -0.3, 5.0), "length": 0.5, "diameter": 0.04, "direction": (1.0, 2.0, -2.0),
    "material": "z93_white",
})  # fmt: skip
BALL = Ball.model_validate({"name": "ball", "position": (0.2, 0.4, 3.0), "diameter": 0.06, "material": GREY})
TURN = {"axis": "y", "angle": math.radians(30.0)}
PLATE = Plate.model_validate(
    {"name": "plate", "position": (0.0, 0.1, 4.0), "size": (0.4, 0.2), "rotation": TURN}
)
TWICE = Plate.model_validate(
    {"name": "twice", "position": (0.0, 0.1, 4.0), "size": (0.4, 0.2), "rotation": [TURN, TURN]}
)


def setup(**more: Any) -> Any:
    artefacts = {one.name: one for one in (BAR, BALL, PLATE, TWICE)}
    told: dict[str, Any] = {
        "plan": SimpleNamespace(artefacts=artefacts, across=50), "base": "base", "rangefinder": "tof",
        "made": np.array([0.502, 0.0601, 0.0, 0.0]),
    }  # fmt: skip
    return SimpleNamespace(**told | more)


def test_artefacts_stand_as_they_were_made() -> None:
    """Claim: the two balls of a bar as far apart as it was made, with the diameter of the plan; a single ball with the
    diameter that it was made with; a plate where and how it was turned."""
    first, second = measured._objects(setup(), 0)
    np.testing.assert_allclose(
        np.subtract(second["position"], first["position"]), 0.502 * np.array([1.0, 2.0, -2.0]) / 3.0
    )
    np.testing.assert_allclose(0.5 * np.add(second["position"], first["position"]), BAR.position)
    for number, one in enumerate((first, second), start=1):
        assert (one["name"], one["shape"], one["diameter"], one["material"]) == (
            f"ball-{number}", "sphere", 0.04, "z93_white",
        )  # fmt: skip
    (ball,) = measured._objects(setup(), 1)
    assert (ball["position"], ball["diameter"]) == (BALL.position, 0.0601)
    assert ball["material"] == BALL.material.model_dump()  # type: ignore[union-attr]
    (plate,) = measured._objects(setup(), 2)
    assert (plate["shape"], plate["size"], plate["position"]) == ("rectangle", PLATE.size, PLATE.position)
    for number, turns in ((2, 1), (3, 2)):
        (turned,) = measured._objects(setup(), number)
        rotation: Any = turned["rotation"]
        assert len(rotation) == turns
        assert all(one["angle"] == pytest.approx(math.radians(30.0)) for one in rotation)


def test_an_artefact_is_scanned_over_its_window(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: rows over φ and columns over Θ, none of whose spots overlap, 50 at most; stepped, by the plan's
    rangefinder, without light of the Sun and poses by the camera, before the very instrument of the plan."""
    asked: list[Any] = []
    monkeypatch.setattr(measured, "same_instrument", lambda *given: asked.append(given))
    monkeypatch.setattr(measured, "_objects", lambda of, number: [f"objects of {number}"])
    surface: Any = SimpleNamespace(
        name="u", artefact=2, horizontal=(-0.01, 0.02), vertical=(0.1, 0.9), nearest=3.0, spot=4e-3
    )
    measured._scenario(setup(), surface)
    ((base, changes, source),) = asked
    assert (base, source) == ("base", "the scan of u")
    assert changes["scan"] == {
        "type": "raster", "rows": 50, "columns": int(0.03 * 3.0 / 4e-3) + 1, "horizontal": (-0.01, 0.02),
        "vertical": (0.1, 0.9), "motion": "stepped",
    }  # fmt: skip
    assert (changes["ranging"], changes["scene"], changes["lighting"], changes["pose"]) == (
        "tof",
        {"objects": ["objects of 2"]},
        {},
        {},
    )


def test_without_wobble_or_uncertainty_points_share_nothing() -> None:
    """Claim: no columns at all of what mirrors or a calibration would move the points by."""
    mirrors = SimpleNamespace(wobble=0.0)
    scenario: Any = SimpleNamespace(scanner=SimpleNamespace(mirrors=mirrors), raster=None)
    points = np.ones((7, 3))
    assert measured._of_mirrors(scenario, np.ones((1, 7), bool), points, points[:, 0]).shape == (7, 3, 0)
    assert measured._of_pixels(scenario, points[:0], points[:0, 0], points[:0, 0], points[:0, 0]).shape == (
        0,
        3,
        0,
    )
    still: Any = SimpleNamespace(scanner=SimpleNamespace(laser=SimpleNamespace(speckle=False)))
    assert measured._grain(still, 4.0).tolist() == [0.0]


@pytest.mark.parametrize("known", [None, False, True])
def test_errors_of_a_calibration_are_common_to_all(
    monkeypatch: pytest.MonkeyPatch, known: bool | None
) -> None:
    """Claim: by the way of ranging, at each point's range and angles; nothing where it is exact or there is none."""
    calibration = None if known is None else SimpleNamespace(is_uncertain=known)
    sight = ("r", np.array([0.1, 0.2]), np.array([0.3, 0.4]))
    geometry = SimpleNamespace(calibration=calibration, sight_of=lambda *axes: sight)
    monkeypatch.setattr(measured, "believed_geometry", lambda of: geometry)
    monkeypatch.setattr(measured, "ranged_by", lambda names, of: {"": (f"way of {names}",)})
    monkeypatch.setattr(measured, "errors_in_common", lambda *given: ("ranges", given))
    scenario: Any = SimpleNamespace(rangefinders=("tof",))
    found: Any = measured._of_calibration(scenario, np.ones((2, 3)), np.array([3.0, 4.0]))
    if not known:
        assert found.shape == (2, 3, 0)
        return
    assert found[0] is calibration
    assert found[1] == "way of ('tof',)"
    np.testing.assert_array_equal(found[2], [3.0, 4.0])
    assert (found[3] is sight[1], found[4] is sight[2]) == (True, True)
