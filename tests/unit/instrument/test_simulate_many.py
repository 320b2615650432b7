"""Many images: each written as it is made, with the layers that are wanted."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from scanner_sim import InputError, Scenario, load_scenario, read_range_image, simulate, simulate_many
from scanner_sim.config import resolved_yaml
from scanner_sim.instrument import simulate as module
from scanner_sim.instrument.together import alike
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


def test_images_that_are_made_together_tell_of_their_own_scenarios(
    small_scenario: str, tmp_path: Path
) -> None:
    """Claim: of scenarios that are simulated together, and differ in seed, power, files and where a wall stands and
    goes, each image has the seed, scenario, calibration, true poses, warnings and layers that it has alone."""
    path = tmp_path / "small.yaml"
    path.write_text(small_scenario, encoding="utf-8")
    at, motion = "scene.objects.wall.position=", "scene.objects.wall.motion="
    common = ["output.truth=[pose]"]
    changes = (
        [f"{motion}{{type: twist, velocity: [0 m/s, 0 m/s, 1 m/s]}}", "seed=5"],
        [f"{motion}{{type: twist}}", f"{at}[0 m, 0 m, 6 m]", "seed=6", "output.points=false"],
        [f"{motion}{{type: twist}}", f"{at}[1 m, 0 m, 7 m]", "scanner.laser.power=9 mW"],
    )
    alike_ones = [load_scenario(path, [*common, *change]) for change in changes]
    assert all(alike(alike_ones[0], one) for one in alike_ones)
    for scenario, image in zip(alike_ones, simulate_many(alike_ones, device="cpu"), strict=True):
        alone = simulate(scenario, device="cpu")
        assert image.seed == scenario.seed
        assert image.scenario_yaml == resolved_yaml(scenario) == alone.scenario_yaml
        for name in ("calibration_yaml", "warnings", "objects", "materials"):
            assert getattr(image, name) == getattr(alone, name), name
        assert list(image.channels) == list(alone.channels)
        for name in alone.channels:
            assert image[name].tobytes() == alone[name].tobytes(), name
        assert image.poses is not None
        place = image.poses.scanner_from_object["wall"][0, :3, 3]
        np.testing.assert_array_equal(place, scenario.scene.objects[0].position)


def test_with_a_seed_of_the_light_each_image_has_the_mirrors_errors_that_it_has_alone(
    small_scenario: str, tmp_path: Path
) -> None:
    """Claim: of two powers of one ``transport.light_seed``, whose mirrors jitter, each image is to the byte what its
    scenario makes alone; both powers see the same deflections."""
    path = tmp_path / "small.yaml"
    path.write_text(small_scenario, encoding="utf-8")
    common = ["transport.light_seed=5", "scanner.mirrors.jitter=100 urad"]
    both = [load_scenario(path, [*common, f"scanner.laser.power={power} mW"]) for power in (5, 9)]
    images = list(simulate_many(both, device="cpu"))
    for scenario, image in zip(both, images, strict=True):
        alone = simulate(scenario, device="cpu")
        for name in alone.channels:
            assert image[name].tobytes() == alone[name].tobytes(), name
    one, other = (image["truth.theta_rad"] for image in images)
    assert one.tobytes() == other.tobytes()


def test_what_stands_is_looked_for_before_the_work_and_only_where_it_goes(
    scenarios: list[Scenario], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: a result that stands in the folder of an image stops a batch before anything is measured, and one in the
    folder behind the last image does not: nothing is written there."""
    (tmp_path / "000001").mkdir()
    (tmp_path / "000001" / "range.exr").write_bytes(b"kept")
    (image,) = simulate_many(scenarios[:1], tmp_path, device="cpu")
    assert (
        read_range_image(tmp_path / "000000" / "range.exr")["range_m"].tobytes() == image["range_m"].tobytes()
    )
    assert (tmp_path / "000001" / "range.exr").read_bytes() == b"kept"

    def measured(*_: object, **__: object) -> None:
        pytest.fail("it was measured before it was refused")

    monkeypatch.setattr(module, "measure_scans", measured)
    with pytest.raises(InputError, match="000000"):
        next(simulate_many(scenarios[1:], tmp_path, device="cpu"))
