"""Plans of acceptance tests: what they make of artefacts, and every fault with its place and remedy."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pytest

from scanner_sim.acceptance import setup as acceptance_setup
from scanner_sim.acceptance.plan import LengthBar
from scanner_sim.acceptance.setup import Setup, _unlimited, read_setup
from scanner_sim.analytic import geometry as judge
from scanner_sim.foundation.errors import ScenarioError

PLAN = """\
schema: 1
base: base.yaml
limits: [{up_to: 3 m, length: 1 mm, size: 1 mm, flatness: 2 mm}, {up_to: 5 m, length: 2 mm}]
lengths:
  - {name: bar, position: [0 m, 0 m, 2 m], direction: x, length: 0.8 m, diameter: 120 mm, sigma: 0.1 mm}
spheres:
  - {name: ball, position: [0 m, 0 m, 2 m], diameter: 150 mm}
plates:
  - {name: plate, position: [0 m, 0 m, 2 m], size: [300 mm, 200 mm]}
"""
BASE = "schema: 1\nscan: {type: raster, rows: 4, columns: 4, horizontal: [-5 deg, 5 deg], vertical: [-5 deg, 5 deg]}\n"


def setup_of(folder: Path, *changes: tuple[str, str]) -> Setup:
    text = PLAN
    for was, now in changes:
        assert was in text
        text = text.replace(was, now)
    (folder / "base.yaml").write_text(BASE, encoding="utf-8")
    (folder / "plan.yaml").write_text(text, encoding="utf-8")
    return read_setup(folder / "plan.yaml")


def test_artefacts_differ_from_their_certificates_by_their_uncertainty(tmp_path: Path) -> None:
    made = [setup_of(tmp_path, ("limits:", f"seed: {seed}\nlimits:")).made for seed in range(60)]
    length, diameter, plate = np.transpose(made)
    assert length.std(ddof=1) == pytest.approx(1e-4, rel=0.4)
    assert abs(length.mean() - 0.8) < 5e-5
    assert (diameter == 0.15).all()
    assert (plate == 0.0).all()


def test_a_tenth_of_a_size_is_the_largest_uncertainty(tmp_path: Path) -> None:
    """Claim: the limits that the remedies name are taken: none but a draw of ten σ would be no body."""
    made = setup_of(
        tmp_path, ("sigma: 0.1 mm", "sigma: 68 mm"), ("diameter: 150 mm", "diameter: 150 mm, sigma: 15 mm")
    )
    assert made.made[0] > 0.12
    assert made.made[1] > 0.0


def test_limits_are_those_of_the_zone_of_the_farthest_point(tmp_path: Path) -> None:
    setup = setup_of(
        tmp_path,
        (
            "bar, position: [0 m, 0 m, 2 m], direction: x",
            "bar, position: [0 m, 0 m, 3 m], direction: [1.5, 0, 2]",
        ),
        ("length: 0.8 m", "length: 2.2 m"),
    )
    assert setup.zone_of(0) == setup.plan.limits[1]
    assert setup.zone_of(1) == setup.plan.limits[0]
    bar = setup.plan.lengths[0]
    assert isinstance(bar, LengthBar)
    assert bar.ends(2.2) == pytest.approx(np.array([[-0.66, 0.0, 2.12], [0.66, 0.0, 3.88]]))


@pytest.mark.parametrize(("diameter", "faults"), [(0.7999, []), (0.8, ["length"]), (0.9, ["length"])])
def test_spheres_of_a_bar_stand_apart(diameter: float, faults: list[str]) -> None:
    """Claim: farther than their diameter; spheres that touch, or reach into one another, are a fault of the length."""
    bar = LengthBar(name="bar", position=(0.0, 0.0, 2.0), direction="x", length=0.8, diameter=0.1)
    told = bar.model_copy(update={"diameter": diameter})
    assert [fault.location for fault in told.cross_checks()] == faults


@pytest.mark.parametrize(("farthest", "faulty"), [(7.0, False), (9.0, False), (9.1, True)])
def test_what_lies_beyond_the_last_zone_has_no_limit(farthest: float, faulty: bool) -> None:
    """Claim: of three zones up to 3, 5 and 9 m the last one bounds where an artefact may be, by its farthest point."""
    zones = [SimpleNamespace(up_to=up_to, length=1e-3) for up_to in (3.0, 5.0, 9.0)]
    surfaces = [SimpleNamespace(artefact=0, farthest=one) for one in (2.0, farthest)]
    surfaces.append(SimpleNamespace(artefact=1, farthest=99.0))
    setup: Any = SimpleNamespace(
        plan=SimpleNamespace(limits=zones), surfaces=surfaces, zone_of=lambda _: zones[2]
    )
    document: Any = SimpleNamespace(line=lambda _: 4)
    found = list(_unlimited(setup, 0, "lengths", 2, document))
    assert [one.location for one in found] == (["lengths[2].position"] if faulty else [])
    assert not faulty or "reaches 9.1 m, and limits are stated up to 9 m" in found[0].problem


FAULTS = {
    "twice": (("name: ball", "name: bar"), "'bar' is there already", "another name", "spheres[0].name"),
    "no unit": (("length: 1 mm", "length: 1"), "unit", "mm", "limits[0].length"),
    "aside": (
        ("ball, position: [0 m,", "ball, position: [1.9 m,"),
        "outside of the field of view",
        "z axis",
        "spheres[0]",
    ),
    "behind": (
        ("plate, position: [0 m, 0 m, 2 m]", "plate, position: [0 m, 0 m, -2 m]"),
        "behind",
        "z",
        "plates[0]",
    ),
    "near": (
        ("ball, position: [0 m, 0 m, 2 m]", "ball, position: [0 m, 0 m, 0.4 m]"),
        "measures from",
        "ranges",
        "spheres",
    ),
    "far": (
        ("plate, position: [0 m, 0 m, 2 m]", "plate, position: [0 m, 0 m, 9 m]"),
        "up to 5 m",
        "zone",
        "plates[0]",
    ),
    "small": (("diameter: 150 mm", "diameter: 12 mm"), "too small for the beam", "20", "spheres[0].diameter"),
    "narrow": (("200 mm]", "25 mm]"), "too small for the beam", "41", "plates[0].size"),
    "a bar of any length": (
        ("sigma: 0.1 mm", "sigma: 68.1 mm"),
        "68.1 mm is more than a tenth of the gap between the spheres, 680 mm",
        "at most 68 mm",
        "lengths[0].sigma",
    ),
    "a ball of any size": (
        ("diameter: 150 mm", "diameter: 150 mm, sigma: 0.16 m"),
        "160 mm is more than a tenth of the diameter, 150 mm",
        "at most 15 mm",
        "spheres[0].sigma",
    ),
    "touching": (("length: 0.8 m", "length: 0.1 m"), "touch", "longer", "lengths[0].length"),
    "nowhere": (("direction: x", "direction: [0, 0, 0]"), "no direction", "vector", "lengths[0].direction"),
    "unlimited": ((", flatness: 2 mm", ""), "no limit for flatness", "flatness: 1 mm", "limits[0]"),
    "disorder": (("up_to: 5 m", "up_to: 2 m"), "farther than the one before", "Sort", "limits[1].up_to"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_has_place_and_remedy(tmp_path: Path, name: str) -> None:
    change, problem, remedy, location = FAULTS[name]
    with pytest.raises(ScenarioError) as caught:
        setup_of(tmp_path, change)
    (fault,) = caught.value.faults
    assert problem in fault.problem
    assert remedy in fault.remedy + fault.problem
    assert fault.location.startswith(location)
    assert fault.line is not None


def touching(setup: Setup) -> bool:
    """Return whether one of 200 × 200 beams over the window of one end of the bar touches the ball of the other one."""
    bar, laser = setup.plan.lengths[0], setup.base.scanner.laser
    separation = setup.base.scanner.mirrors.axis_separation
    for surface, centre in zip(setup.surfaces[:2], bar.ends(0.5)[::-1], strict=True):
        theta, phi = np.meshgrid(
            *(np.linspace(*window, 200) for window in (surface.horizontal, surface.vertical))
        )
        start = judge.laser_origin(phi, separation)
        along = judge.scanner_axes(theta, phi)[0]
        ahead = np.sum((centre - start) * along, axis=-1)
        beside = np.linalg.norm(centre - start - ahead[..., None] * along, axis=-1)
        if (beside < 0.06 + laser.radius(float(np.linalg.norm(centre)))).any():
            return True
    return False


@pytest.mark.parametrize(
    "position", ["[0.95 m, 0 m, 2.3 m]", "[-0.4 m, 0.5 m, 2.3 m]", "[0 m, -0.6 m, 2.3 m]"]
)
def test_balls_of_a_bar_in_one_line_of_sight_are_refused(tmp_path: Path, position: str) -> None:
    """Claim: a bar is refused where a beam that scans one ball would meet the other one, and only there; and that the
    nearer one stands before the other is said.

    Set-up: bars of half a metre that point away from the scanner or to it, and 0 to 30° beside. Expected: by 40 000
    beams. Left out is what these miss: a window that the other ball touches by less than their distance.
    """
    said = []
    middle = np.array([float(one.split()[0]) for one in position.strip("[]").split(",")])
    aside = np.cross(middle, [0.3, 1.0, 0.2])
    aside /= np.linalg.norm(aside)
    for number, turn in enumerate(np.deg2rad([-30.0, -20.0, -12.0, -5.0, 0.0, 7.0, 15.0, 25.0])):
        away = 1.0 if number % 2 else -1.0
        near, far = ("first", "second") if number % 2 else ("second", "first")
        along = away * (np.cos(turn) * middle / np.linalg.norm(middle) + np.sin(turn) * aside)
        bar = f"bar, position: {position}, direction: {along.tolist()}, length: 0.5 m"
        change = ("bar, position: [0 m, 0 m, 2 m], direction: x, length: 0.8 m", bar)
        exact = ("sigma: 0.1 mm", "sigma: 0 mm")
        try:
            setup, refused = setup_of(tmp_path, change, exact), False
        except ScenarioError as error:
            (fault,) = error.faults
            assert fault.location == "lengths[0].direction"
            assert fault.line is not None
            assert f"bar/{near} at 2." in fault.problem
            assert f"stands before bar/{far} at 2." in fault.problem
            refused = True
            with mock.patch.object(acceptance_setup, "_in_line", return_value=()):
                setup = setup_of(tmp_path, change, exact)
        assert refused == touching(setup), turn
        said.append(refused)
    assert 2 <= sum(said) <= 6


def test_a_scenario_with_both_rangefinders_asks_which(tmp_path: Path) -> None:
    (tmp_path / "both.yaml").write_text(BASE + "ranging: both\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="judges one of them"):
        setup_of(tmp_path, ("base.yaml", "both.yaml"))


@pytest.mark.parametrize(
    ("base", "ranging", "judged"),
    [
        ("both", "tof", "tof"), ("both", "triangulation", "triangulation"), ("tof", "", "tof"),
        ("", "", "triangulation"),
    ],
)  # fmt: skip
def test_the_rangefinder_that_is_judged_is_the_plans(
    tmp_path: Path, base: str, ranging: str, judged: str
) -> None:
    """Claim: that which the plan names, else the one of the scenario; distances are held against its own ranges."""
    (tmp_path / "other.yaml").write_text(BASE + (f"ranging: {base}\n" if base else ""), encoding="utf-8")
    plan = "base: other.yaml\n" + (f"ranging: {ranging}\n" if ranging else "")
    assert setup_of(tmp_path, ("base: base.yaml\n", plan)).rangefinder == judged


@pytest.mark.parametrize(
    ("was", "now", "key"),
    [("[0 m, 0 m, 2 m]", "[0 m, 0 m, -2 m]", "position"), ("[300 mm, 200 mm]", "[300 mm, 25 mm]", "size")],
)
def test_what_cannot_be_measured_is_told_at_the_line_of_its_key(
    tmp_path: Path, was: str, now: str, key: str
) -> None:
    """Claim: of an artefact that takes several lines that of the key that is to be changed, not its first one."""
    plate = "  - name: plate\n    size: [300 mm, 200 mm]\n    position: [0 m, 0 m, 2 m]\n"
    start = (
        PLAN.partition("lengths:")[0]
        + "plates:\n  - {name: other, position: [0 m, 0 m, 2 m], size: [1 m, 1 m]}\n"
    )
    (tmp_path / "base.yaml").write_text(BASE, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(start + plate.replace(was, now), encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        read_setup(tmp_path / "plan.yaml")
    (fault,) = caught.value.faults
    lines = (start + plate).splitlines()
    assert fault.location == f"plates[1].{key}"
    assert fault.line == 1 + max(number for number, line in enumerate(lines) if line.strip().startswith(key))


def test_a_plan_without_artefacts_is_a_fault(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text(BASE, encoding="utf-8")
    plan = tmp_path / "plan.yaml"
    plan.write_text("schema: 1\nbase: base.yaml\nlimits: [{up_to: 3 m, length: 1 mm}]\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="no artefact"):
        read_setup(plan)


def test_windows_hold_the_artefacts_with_a_tenth_to_spare(tmp_path: Path) -> None:
    """Claim: Θ and φ of a ball's window are those of a ball 1.1 times as wide, of a plate those of its corners;
    nearest and farthest are its points' distances, and the spot is the beam's 1/e² diameter at the farthest.

    Expected: of a ball on the axis by the tangent cone from the first axis for Θ, and from the second for φ; the limb's
    points are 22.5° apart, of which the window misses 2 % of the radius at most.
    """
    setup = setup_of(tmp_path, ("sigma: 0.1 mm", "sigma: 0 mm"))
    bar, _, ball, plate = setup.surfaces
    laser, mirrors = setup.base.scanner.laser, setup.base.scanner.mirrors
    reach = 1.1 * 0.075
    assert ball.horizontal[1] == pytest.approx(np.arcsin(reach / 2.0), rel=0.02)
    assert ball.vertical[1] == pytest.approx(np.arcsin(reach / (2.0 - mirrors.axis_separation)), rel=0.02)
    assert ball.horizontal[0] == pytest.approx(-ball.horizontal[1])
    assert (ball.nearest, ball.farthest) == (pytest.approx(2.0 - reach), pytest.approx(2.0 + reach))
    assert ball.spot == pytest.approx(2.0 * laser.radius(2.0 + reach))
    assert (bar.artefact, ball.artefact, plate.artefact) == (0, 1, 2)
    assert (bar.extent, ball.extent, plate.extent) == (0.12, 0.15, 0.2)
    assert bar.horizontal[0] < np.arctan2(-0.4, 2.0) < bar.horizontal[1] < 0.0
    corner = np.array([0.15, 0.1, 2.0])
    assert plate.farthest == pytest.approx(np.linalg.norm(corner))
    assert plate.nearest == pytest.approx(2.0)
    assert plate.vertical[1] == pytest.approx(np.arctan2(0.1, 2.0 - mirrors.axis_separation))
    assert plate.horizontal[1] == pytest.approx(np.arctan2(0.15, 2.0), rel=1e-3)
