"""The light of epochs: the conditions of Table 1 where geometry tells them."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import pytest

from scanner_sim.campaign.approach import light
from scanner_sim.campaign.approach.light import UNSEEN, epoch_rows
from scanner_sim.campaign.approach.reading import read_approach
from scanner_sim.foundation.errors import InputError
from scanner_sim.validation.studies import sweep
from scanner_sim.validation.studies.conditions import Condition

TEXT = """\
schema: 1
base: {base}
object: vehicle
trajectory:
  type: waypoints
  interpolation: linear
  points:
    - {{time: 0 s, position: [0 m, 0 m, 12 m]}}
    - {{time: 1 s, position: [0 m, 0 m, 12 m], rotation: {{axis: y, angle: 180 deg}}}}
epochs: {{count: 2}}
arrays: [{{array: far}}]
orbits:
  - {{beta: 30 deg, anomaly: 85 deg}}
  - {{beta: 0 deg, anomaly: -70 deg}}
  - {{beta: 15 deg, anomaly: 40 deg}}
  - {{beta: 0 deg, anomaly: 180 deg}}
  - {{beta: 0 deg, anomaly: 85 deg}}
"""


@pytest.mark.slow
@pytest.mark.usefixtures("device")
def test_conditions_are_those_of_the_geometry(repo_root: Path, tmp_path: Path) -> None:
    """Claim: each light makes the condition that follows from where the Sun stands.

    Expected: low behind the scanner it lights the array in full; low before it the array faces away; high, the visor
    above throws its shadow on a part; on the Earth's far side there is none; in the orbit's plane behind the scanner
    the polished panel mirrors it. Turned by 180 degrees the array is behind its vehicle.
    """
    path = tmp_path / "approach.yaml"
    base = repo_root / "configs" / "approach" / "vehicle.yaml"
    path.write_text(TEXT.format(base=base), encoding="utf-8")
    rows = epoch_rows(read_approach(path), device="cpu", progress=lambda done, most: None)
    seen = [row for row in rows if row.epoch == 0]
    expected = [
        Condition.NORMAL,
        Condition.FULL_SHADOW,
        Condition.PARTIAL_SHADOW,
        Condition.NO_LIGHT,
        Condition.SATURATION,
    ]
    assert [row.condition for row in seen] == expected
    assert [row.orbit for row in seen] == [0, 1, 2, 3, 4]
    assert seen[0].sunlit_share == 1.0
    assert seen[1].sunlit_share == 0.0
    assert 0.1 < seen[2].sunlit_share < 0.9
    assert seen[3].sun_visible_share == 0.0
    assert seen[0].background_electron > 10.0 * seen[1].background_electron
    assert all(row.condition == UNSEEN for row in rows if row.epoch == 1)
    assert {row.condition_name for row in rows if row.epoch == 1} == {"not seen"}


def test_the_light_of_a_point_is_that_of_its_array(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of two arrays in one light each has its own condition, share and background; one not seen has none."""
    tracks = [
        SimpleNamespace(name="near", condition=[2], lit=[0.1], background=[7.0]),
        SimpleNamespace(name="far", condition=[0], lit=[0.9], background=[5.0]),
    ]
    timeline = SimpleNamespace(tracks=tracks, sun_visible=[0.5])
    monkeypatch.setattr(light, "sweep_orbit", lambda scenario, count, device: timeline)
    monkeypatch.setattr(light, "_around", lambda scenario: None)
    scenario: Any = SimpleNamespace(model_copy=lambda update: None)
    for name, wanted in (("near", (2, 0.1, 0.5, 7.0)), ("far", (0, 0.9, 0.5, 5.0))):
        point: Any = SimpleNamespace(array=name)
        assert light._light_on(scenario, point, "cpu") == wanted
    gone: Any = SimpleNamespace(array="gone")
    condition, *shares = light._light_on(scenario, gone, "cpu")
    assert condition == UNSEEN
    assert all(math.isnan(share) for share in shares)


def test_only_what_is_hidden_is_not_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: an array of which no point is visible is not seen; elements that are too old for the epoch are a fault."""
    monkeypatch.setattr(light, "_around", lambda scenario: None)
    monkeypatch.setattr(sweep, "Instrument", lambda scenario, device: mock.MagicMock())
    monkeypatch.setattr(sweep, "electrons_per_watt", lambda *given: 1.0)
    monkeypatch.setattr(sweep, "visible_samples", lambda *given: SimpleNamespace(count=0))
    monkeypatch.setattr(sweep, "orbit_times", lambda lighting, steps: [0.0])
    scenario = mock.MagicMock()
    scenario.scene.objects = ()
    scenario.model_copy.return_value = scenario
    scenario.scanner.receiver.line_image.tangent.return_value = 0.1
    point: Any = SimpleNamespace(array="far")
    assert light._light_on(scenario, point, "cpu")[0] == UNSEEN
    scenario.lighting.sky.side_effect = ValueError("they are of 2008")
    with pytest.raises(InputError, match="cannot be followed: they are of 2008"):
        light._light_on(scenario, point, "cpu")
