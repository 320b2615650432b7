"""Many images: each written as it is made, with the layers that are wanted."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from scanner_sim import InputError, Scenario, load_scenario, read_range_image, simulate, simulate_many
from scanner_sim.products.files.contents import FILES

pytestmark = pytest.mark.usefixtures("device")


@pytest.fixture
def scenarios(small_scenario: str, tmp_path: Path) -> list[Scenario]:
    path = tmp_path / "small.yaml"
    path.write_text(small_scenario, encoding="utf-8")
    near = [load_scenario(path, [f"seed={seed}"]) for seed in (1, 2)]
    return [
        *near,
        load_scenario(path, ["scene.objects.wall.position=[0 m, 0 m, 5 m]", "output.points=false"]),
    ]


def test_each_image_is_written_before_it_is_yielded(scenarios: list[Scenario], tmp_path: Path) -> None:
    """Claim: folder and file of image i hold what is yielded, and what simulate makes of scenario i alone."""
    for number, image in enumerate(simulate_many(scenarios, tmp_path / "many", device="cpu")):
        folder = tmp_path / "many" / f"{number:06d}"
        read, alone = read_range_image(folder / "range.exr"), simulate(scenarios[number], device="cpu")
        for name in alone.channels:
            assert image[name].tobytes() == alone[name].tobytes() == read[name].tobytes()
        assert (folder / "points.ply").exists() == scenarios[number].output.points
        assert not (tmp_path / "many" / f"{number + 2:06d}").exists()


def test_only_the_wanted_layers_are_kept(scenarios: list[Scenario], tmp_path: Path) -> None:
    """Claim: they and the status, in memory and in files; the summary counts what is there."""
    wanted = ["truth.object", "range_m"]
    whole = next(simulate_many(scenarios, device="cpu"))
    image = next(simulate_many(scenarios, tmp_path, wanted, device="cpu"))
    assert list(image.channels) == ["range_m", "status", "truth.object"]
    for name in image.channels:
        assert image[name].tobytes() == whole[name].tobytes()
    assert list(read_range_image(tmp_path / "000000" / "range.exr").channels) == list(image.channels)
    files = {path.name for path in (tmp_path / "000000").iterdir()}
    assert files == {"range.exr", "scenario.yaml", "summary.json"} <= set(FILES)


def test_a_status_stays_with_its_measurements(small_scenario: str, tmp_path: Path) -> None:
    path = tmp_path / "small.yaml"
    path.write_text(small_scenario, encoding="utf-8")
    image = simulate(load_scenario(path, ["ranging=tof"]), device="cpu").keeping(["tof.range_m"])
    assert set(image.channels) == {"tof.range_m", "tof.status", "status"}


def test_unknown_layers_are_refused(scenarios: list[Scenario]) -> None:
    with pytest.raises(InputError, match=r"no layer 'tof\.range_m'"):
        next(simulate_many(scenarios, layers=["tof.range_m"], device="cpu"))
    with pytest.raises(InputError) as told:
        next(simulate_many(scenarios, layers=["truth.normal.X"], device="cpu"))
    assert told.value.remedy == "Write output.truth: [normal] into the scenario."


def test_results_are_not_overwritten_unless_asked_for(scenarios: list[Scenario], tmp_path: Path) -> None:
    """Claim: a folder that is there is refused before its scenario is simulated, and nothing is changed."""
    (first,) = simulate_many(scenarios[:1], tmp_path, device="cpu")
    before = (tmp_path / "000000" / "range.exr").read_bytes()
    with pytest.raises(InputError, match="000000"):
        next(simulate_many(scenarios[1:], tmp_path, device="cpu"))
    assert (tmp_path / "000000" / "range.exr").read_bytes() == before
    (other,) = simulate_many(scenarios[1:2], tmp_path, overwrite=True, device="cpu")
    assert not np.array_equal(first["range_m"], other["range_m"])
    assert (tmp_path / "000000" / "range.exr").read_bytes() != before


def test_scenarios_are_taken_as_they_are_needed(scenarios: list[Scenario]) -> None:
    """Claim: of endless scenarios that are not alike the first image needs two: the second tells that it is alone."""
    taken = 0

    def endless() -> Iterator[Scenario]:
        nonlocal taken
        for scenario in itertools.cycle((scenarios[0], scenarios[2])):
            taken += 1
            yield scenario

    next(simulate_many(endless(), device="cpu"))
    assert taken == 2
