"""The lists of planted faults fit the sources."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def plant() -> ModuleType:
    """The program that plants the faults."""
    spec = importlib.util.spec_from_file_location("plant", Path(__file__).with_name("plant.py"))
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["plant"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_fault_can_be_planted_and_names_tests_that_exist(plant: ModuleType, repo_root: Path) -> None:
    """Claim: each fault's text stands once in its file, nothing is listed twice, and its tests are there."""
    if not (repo_root / "scanner_sim").is_dir():
        pytest.skip("the faults are planted in the sources")
    faults = plant.faults()
    assert len(faults) == len({fault.name for fault in faults})
    for fault in faults:
        text = (repo_root / "scanner_sim" / fault.file).read_text(encoding="utf-8")
        assert text.count(fault.was) == 1, fault.name
        assert fault.was != fault.now, fault.name
        for name in fault.tests:
            assert (repo_root / "tests" / name).is_file(), name


def test_a_test_that_is_not_there_is_no_verdict(plant: ModuleType) -> None:
    """Claim: a fault lives if all of its tests passed or none is so marked; where a test is not there it is not known,
    and a package that cannot be imported was noticed."""
    tests = ("unit/test_a.py::test_gone",)
    assert plant.noticed(tests, 0, "1 passed") == plant.noticed(tests, 5, "1 deselected") == ""
    assert (
        plant.noticed(tests, 1, "F\nFAILED tests/unit/test_a.py::test_b[0.3 of it] - assert a - b\n1 failed")
        == "unit/test_a.py::test_b[0.3 of it]"
    )
    assert plant.noticed(tests, 2, "ERROR tests/unit/test_a.py - NameError") == "unit/test_a.py"
    assert plant.noticed(tests, -11, "") == "the process died"
    assert (
        plant.noticed(tests, 4, "ImportError while loading conftest '/x/tests/conftest.py'.") == "conftest.py"
    )
    with pytest.raises(plant.NoSuchTestError, match="test_gone"):
        plant.noticed(tests, 4, "ERROR: not found: /x/tests/unit/test_a.py::test_gone")
    with pytest.raises(RuntimeError, match="did not run"):
        plant.noticed(tests, 3, "INTERNALERROR")


def test_a_hint_that_is_gone_leaves_it_to_the_list(
    plant: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Claim: where the test that noticed a fault before is not there, those of the list are asked; if one of these is
    not there it is an error, and the file stands as it did."""
    file = tmp_path / "scanner_sim" / "law.py"
    file.parent.mkdir()
    file.write_text("x = 1\n", encoding="utf-8")
    fault = plant.Fault("room", "law.py", "1", "2", ("unit/test_a.py",))
    gone = {"unit/test_old.py::test_moved"}

    def asked(repository: Path, tests: tuple[str, ...], marked: str) -> str:
        assert file.read_text(encoding="utf-8") == "x = 2\n"
        if gone & set(tests):
            raise plant.NoSuchTestError(tests)
        return "unit/test_a.py::test_b" if marked == "slow" else ""

    monkeypatch.setattr(plant, "_asked", asked)
    assert plant.seen(fault, tmp_path, "unit/test_old.py::test_moved").killer == "unit/test_a.py::test_b"
    gone.add("unit/test_a.py")
    with pytest.raises(plant.NoSuchTestError):
        plant.seen(fault, tmp_path, "")
    assert file.read_text(encoding="utf-8") == "x = 1\n"
