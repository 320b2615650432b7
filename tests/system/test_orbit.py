"""The verb ``orbit``: shares of time in the conditions of Table 1, from geometry that is known."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from scanner_sim import load_scenario
from scanner_sim.analytic.orbit import earthshine, eclipse_fraction
from scanner_sim.cli import app
from scanner_sim.products.files.contents import ORBIT
from scanner_sim.products.timeline import Timeline
from scanner_sim.validation.studies.conditions import Condition
from scanner_sim.validation.studies.sweep import sweep_orbit

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
BOARD = """\
schema: 1
seed: 3
scene:
  objects:
    - {name: board, array: {diameter: 100 mm, plate: 300 mm}, position: [0 m, 0 m, 8 m]}
    - {name: lid, shape: rectangle, size: [40 m, 40 m], position: [0 m, -2 m, 8 m], rotation: {axis: x, angle: 90 deg},
       material: grey_reference}
lighting:
  orbit: {altitude: 400 km, inclination: 51.6 deg, beta: 0 deg, attitude: {forward: wake}}
scan: {type: raster, rows: 8, columns: 8, horizontal: [-12 deg, 12 deg], vertical: [-12 deg, 12 deg]}
"""
STEPS = 60

pytestmark = pytest.mark.usefixtures("device")


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "board.yaml"
    path.write_text(BOARD, encoding="utf-8")
    return path


def swept(path: Path, *changes: str, steps: int = STEPS) -> Timeline:
    return sweep_orbit(load_scenario(path, changes), steps, device="cpu")


def share(timeline: Timeline, condition: Condition) -> float:
    return float(timeline.shares(timeline.tracks[0])[condition])


def without_lid(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    start, end = text.index("    - {name: lid"), text.index("lighting:")
    path.write_text(text[:start] + text[end:], encoding="utf-8")


@pytest.mark.slow
def test_shares_of_a_free_board_follow_from_the_orbit(config: Path) -> None:
    """Claim: for a board that faces the scanner, which looks to wake in a noon orbit, all shares are geometry.

    Set-up: β = 0, so the Sun turns evenly about the horizontal axis of the board: it shines on the front for the
    half before noon, and in the other half stands behind the board. Expected: the closed form's eclipse share e
    in the dark, (1 − e)/2 normal, and the Sun in view while it sinks through the field of view, from 12° above the
    horizontal to 12° below it: 24°/360° of the time, less what the board hides. The rest is full shadow. Partial
    shadow needs a grazing Sun, at most one moment. Tolerance: a moment at each end, 2/60.
    """
    without_lid(config)
    timeline = swept(config)
    dark = eclipse_fraction(400e3, 0.0)
    assert share(timeline, Condition.NO_LIGHT) == pytest.approx(dark, abs=2 / STEPS)
    assert share(timeline, Condition.NORMAL) == pytest.approx(0.5 * (1.0 - dark), abs=2 / STEPS)
    assert share(timeline, Condition.BACK_ILLUMINATION) == pytest.approx(24 / 360, abs=2 / STEPS)
    assert share(timeline, Condition.PARTIAL_SHADOW) <= 1 / STEPS
    assert share(timeline, Condition.SATURATION) == 0.0
    assert np.sum(timeline.shares(timeline.tracks[0])) == pytest.approx(1.0)


def test_a_lid_puts_the_board_into_shadow(config: Path) -> None:
    """Claim: what stands between target and Sun counts. A roof 2 m above, 40 m deep, leaves the low Sun only.

    Set-up: the roof reaches from behind the scanner over the board. Expected: at elevations above atan(2 m / 28 m) = 4°
    the front is shaded: in shadow all the time the free board was lit, but for the climb from −20° to 4°:
    24°/360° of the orbit. Tolerance: two moments.
    """
    timeline = swept(config)
    assert share(timeline, Condition.NORMAL) == pytest.approx(24 / 360, abs=2 / STEPS)
    assert share(timeline, Condition.FULL_SHADOW) > 0.3


def test_light_of_the_earth_is_that_of_the_closed_form(config: Path) -> None:
    """Claim: a board that faces straight down gets the Earth's light that theory gives, and none at night.

    Set-up: the scanner looks up at the free board; the Sun stands 0°, 30° and 60° from the zenith. Expected: albedo 0.2
    times the closed form for a cap lit as the Sun's height at each of its points says, which is exact up to 70°.
    Tolerance: 5 %; 2400 rays scatter by 1 to 2 %.
    """
    without_lid(config)
    timeline = swept(
        config, "lighting.orbit.attitude.forward=zenith", "lighting.orbit.attitude.down=wake", steps=12
    )
    track = timeline.tracks[0]
    expected = [0.2 * earthshine(400e3, math.radians(angle)) for angle in (0.0, 30.0, 60.0)]
    assert track.earth[:3] == pytest.approx(expected, rel=0.05)
    assert not track.earth[timeline.sun_visible == 0.0].any()


def test_a_bright_open_detector_saturates(config: Path) -> None:
    """Claim: saturation is light against the full well: a well of 1e4 electrons is full whenever the board is lit."""
    without_lid(config)
    changes = ["scanner.position_sensor.full_well=10000 electron", "scanner.position_sensor.bias=0"]
    timeline = swept(config, *changes, steps=12)
    assert share(timeline, Condition.NORMAL) == 0.0
    assert share(timeline, Condition.SATURATION) > 0.2


@pytest.mark.slow
def test_it_writes_a_table_a_timeline_and_numbers(config: Path, tmp_path: Path) -> None:
    for name in "ab":
        result = invoke("orbit", config, "-o", name, "--steps", 12, "--device", "cpu")
        assert result.exit_code == 0, result.output
        assert {path.name for path in (tmp_path / name).iterdir()} == set(ORBIT.files)
    for name in ORBIT.files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    assert all(
        words in result.stdout for words in ("60 % normal", "35 % shadow", "back illumination", "board")
    )
    rows = list(csv.DictReader((tmp_path / "a" / "orbit.csv").read_text().splitlines()))
    assert len(rows) == 12  # one target: arrays come before other objects
    assert {row["target"] for row in rows} == {"board"}
    numbers = json.loads((tmp_path / "a" / "orbit.json").read_text())
    assert sum(numbers["targets"]["board"]["share"].values()) == pytest.approx(1.0)
    assert numbers["paper"]["normal"] == "60 %"
    with Image.open(tmp_path / "a" / "orbit.png") as picture:
        picture.verify()
    again = invoke("orbit", config, "-o", "a", "--steps", 12)
    assert again.exit_code == 2
    assert "--overwrite" in again.stderr
    assert invoke("orbit", "a/scenario.yaml", "-o", "a", "--steps", 12, "--overwrite", "-q").output == ""


def test_without_an_orbit_it_says_what_to_write() -> None:
    result = invoke("orbit", CONFIGS / "lighting_normal.yaml")
    assert result.exit_code == 2
    assert "no orbit" in result.stderr
    assert "lighting: {orbit:" in result.stderr


def test_without_a_target_it_says_so(config: Path) -> None:
    for change in ("scene.objects.board.position=[0 m, 0 m, -8 m]", "scene.objects=[]"):
        result = invoke("orbit", config, "--set", change, "--steps", 2)
        assert result.exit_code == 2
        assert "no target" in result.stderr


@pytest.mark.parametrize(
    ("board", "seen", "unseen"),
    [("array: {diameter: 100 mm, plate: 300 mm}", ["board"], ["lost1", "lost2"]),
     ("shape: rectangle, size: [300 mm, 300 mm], material: grey_reference", ["board", "lid"],
      ["lost1", "lost2", "other"])],
)  # fmt: skip
def test_a_target_behind_the_scanner_is_left_out_and_said(
    config: Path, board: str, seen: list[str], unseen: list[str]
) -> None:
    """Claim: targets are the arrays, and every object where there are none; of those that cannot be seen each one is
    named, whatever stands before or behind it in the file, and of what is no target none."""
    text, array = config.read_text(encoding="utf-8"), "array: {diameter: 100 mm, plate: 300 mm}"
    lost = "".join(f"    - {{name: lost{n}, {board}, position: [0 m, 0 m, -8 m]}}\n" for n in (1, 2))
    text = text.replace(array, board).replace("  objects:\n", f"  objects:\n{lost}")
    other = "    - {name: other, shape: sphere, diameter: 1 m, position: [0 m, 0 m, -6 m], material: grey_reference}\n"
    config.write_text(text.replace("lighting:\n", f"{other}lighting:\n"), encoding="utf-8")
    timeline = swept(config, "lighting.orbit.anomaly=180 deg", steps=1)
    assert [track.name for track in timeline.tracks] == seen
    assert list(timeline.warnings) == [
        f"'{name}' was left out: the scanner does not see it" for name in unseen
    ]


@pytest.mark.slow
def test_the_shipped_orbit_meets_every_kind_of_shadow() -> None:
    """The scenario is there to be looked at: lit, shaded in part and wholly, dark and against the Sun."""
    timeline = swept(CONFIGS / "lighting_orbit.yaml", steps=45)
    assert not timeline.warnings
    assert [track.name for track in timeline.tracks] == ["hatch", "under_truss", "free"]
    met = {Condition(int(code)) for track in timeline.tracks for code in track.condition}
    assert met >= set(Condition) - {Condition.SATURATION}
