"""The lists of planted faults fit the sources."""

from __future__ import annotations

import ast
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


def program(name: str) -> ModuleType:
    """Return a program that stands beside this file."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def plant() -> ModuleType:
    """The program that plants the faults."""
    return program("plant")


@pytest.fixture(scope="module")
def lot(plant: ModuleType) -> ModuleType:
    """The program that draws them."""
    return program("lot")


def test_a_lot_is_the_same_for_its_seed_and_can_be_planted(lot: ModuleType, repo_root: Path) -> None:
    """Claim: of 40 faults no two are of one function's text, each stands once in its file, changes the program, and is
    Python; another seed draws others, and a room's are of the room."""
    faults = lot.drawn(3, 40, ["ranging", "scan"])
    assert faults == lot.drawn(3, 40, ["ranging", "scan"])
    assert len(set(faults) - set(lot.drawn(4, 40, ["ranging", "scan"]))) > 20
    assert len(faults) == 40
    for fault in faults:
        assert fault.file.startswith(("ranging/", "scan/"))
        text = (repo_root / "scanner_sim" / fault.file).read_text(encoding="utf-8")
        assert text.count(fault.was) == 1, fault.name
        assert ast.dump(ast.parse(text.replace(fault.was, fault.now))) != ast.dump(ast.parse(text)), (
            fault.name
        )
        for name in fault.tests:
            assert (repo_root / "tests" / name).is_file(), name
    assert "unit/scan/test_lissajous.py" in lot.near("scan/lissajous.py")
    assert "paper/test_eq04.py" in lot.near("ranging/triangulation.py")


@pytest.mark.parametrize(
    ("written", "others"),
    [
        ("a + b", {"((a) - (b))", "(a)"}),
        ("a - b", {"((a) + (b))", "(a)"}),
        ("a / b", {"(a)", "((a) * (b))", "(0.95 * (a) / (b))"}),
        ("a**2", {"(a)"}),
        ("-a", {"(a)"}),
        ("7", {"8", "6"}),
        ("0", {"1"}),
        ("0.4", {"0.42", "(-0.4)"}),
        ("np.sin(a)", {"np.cos(a)"}),
        ("np.sqrt(a)", {"(a)"}),
        ("np.hypot(a, b)", {"(a + b)"}),
        ("np.where(c, a, b)", {"np.where(c, b, a)"}),
        ("a <= b", {"a < b"}),
        ("sigma_theta", {"sigma_phi"}),
        ("True", set()),
        ("'a + b'", set()),
    ],
)
def test_what_may_stand_in_a_places_stead(lot: ModuleType, written: str, others: set[str]) -> None:
    node = ast.parse(written, mode="eval").body
    said = lambda one: ast.get_source_segment(written, one)  # noqa: E731
    assert set(lot.changes(node, said, "sigma_phi")) == others


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

    monkeypatch.setattr(plant, "asked_of", asked)
    assert plant.seen(fault, tmp_path, "unit/test_old.py::test_moved").killer == "unit/test_a.py::test_b"
    gone.add("unit/test_a.py")
    with pytest.raises(plant.NoSuchTestError):
        plant.seen(fault, tmp_path, "")
    assert file.read_text(encoding="utf-8") == "x = 1\n"
