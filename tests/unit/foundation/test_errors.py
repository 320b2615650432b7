"""Messages of faults, and functions of the user's own: what is listed, what is loaded, what is refused."""

from __future__ import annotations

import math
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from scanner_sim.foundation.errors import MOST_FAULTS, Fault, InputError, ScenarioError, at_least, at_most
from scanner_sim.foundation.own_function import OwnFunction


@pytest.mark.parametrize("count", [1, 2, MOST_FAULTS, MOST_FAULTS + 1, 3 * MOST_FAULTS])
def test_a_message_counts_all_faults_and_lists_fifty(count: int) -> None:
    """Claim: the first fifty stand in the message in their order, the rest as a number; the error holds them all."""
    faults = [Fault(f"key_{number}", "it is odd.", "Mend it.", number + 3) for number in range(count)]
    error = ScenarioError(faults, source="plan.yaml")
    first, *lines = str(error).split("\n")
    assert first == f"plan.yaml: {count} fault{'s' if count > 1 else ''}"
    listed = [f"  line {number + 3}, key_{number}: it is odd. Mend it." for number in range(min(count, 50))]
    assert lines == listed + ([f"  … and {count - 50} more"] if count > 50 else [])
    assert error.faults == tuple(faults)


def test_a_function_is_loaded_by_its_name_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: MODULE:FUNCTION of the folder is loaded; no module, no function, and what is none are told apart."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "own_laws_of_this_test.py").write_text("def double(x):\n    return 2 * x\n\n\nnumber = 3\n")

    def load(name: str) -> object:
        return OwnFunction(name, str(tmp_path)).load()

    double = load("own_laws_of_this_test:double")
    assert callable(double)
    assert double(3.5) == 7.0
    assert OwnFunction("own_laws_of_this_test:double", "").short == "double"
    sys.modules.pop("own_laws_of_this_test")
    own = "own_laws_of_this_test"
    for name in (":double", own, f"{own}:", f"{own}:a b", f".{own}:double", ".:double"):
        with pytest.raises(InputError, match=r"is not MODULE:FUNCTION"):
            load(name)
    for name in ("no_such_laws_of_this_test", "no_such_laws_of_this_test.within"):
        with pytest.raises(InputError, match=f"there is no module {name}"):
            load(f"{name}:double")
    for name in ("number", "triple"):
        with pytest.raises(InputError, match=f"has no function {name}") as told:
            load(f"own_laws_of_this_test:{name}")
        assert str(tmp_path / "own_laws_of_this_test.py") in told.value.remedy
    # Imported long before, from elsewhere.
    (tmp_path / "signal.py").write_text("def double(x):\n    return 2 * x\n")
    for module, place in (("signal", signal.__file__), ("sys", "part of Python")):
        with pytest.raises(InputError, match="has no function double") as told:
            load(f"{module}:double")
        assert told.value.remedy.endswith(f"is {place}.")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("def double(x)\n    return 2 * x\n", "SyntaxError: expected ':'"),
        ("double = twice\n", "NameError: name 'twice' is not defined"),
        ("import sys\nsys.exit(3)\n", "SystemExit: 3"),
        ("raise SystemExit\n", "SystemExit."),
        ("import no_such_library\n", "ModuleNotFoundError: No module named 'no_such_library'"),
        ("import faulty_module_of_this\n", "ModuleNotFoundError: No module named 'faulty_module_of_this'"),
    ],
)
def test_a_module_that_fails_is_no_fault_of_the_program(
    text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: whatever it raises, an end of the process and libraries that it lacks among it, is told with its name."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "faulty_module_of_this_test.py").write_text(text)
    with pytest.raises(InputError, match="faulty_module_of_this_test cannot be imported") as told:
        OwnFunction("faulty_module_of_this_test:double", str(tmp_path)).load()
    assert said in told.value.message
    assert told.value.remedy != "Start where it lies."


def test_a_module_is_not_at_fault_where_memory_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: memory that is exhausted during an import is passed on as that, and not as a fault of the module."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "large_module_of_this_test.py").write_text("raise MemoryError\n")
    with pytest.raises(MemoryError):
        OwnFunction("large_module_of_this_test:double", str(tmp_path)).load()


@pytest.mark.parametrize("last", [False, True])
def test_a_module_is_looked_for_in_the_own_folder_first(
    last: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: of two modules of one name the own one is loaded, though the other is installed; so it is where the own
    folder is already among those of Python, behind them."""
    own, installed = tmp_path / "own", tmp_path / "installed"
    for folder, factor in ((own, 2), (installed, 5)):
        folder.mkdir()
        (folder / "namesake_of_this_test.py").write_text(f"def times(x):\n    return {factor} * x\n")
    monkeypatch.setattr(sys, "path", [str(installed), *sys.path, *([str(own)] if last else [])])
    times = OwnFunction("namesake_of_this_test:times", str(own)).load()
    sys.modules.pop("namesake_of_this_test")
    assert times(3.5) == 7.0


def test_a_limit_in_few_digits_is_within_the_limit() -> None:
    """Claim: the nearest number of so many digits that is no larger, or no smaller; a limit that has no more digits,
    but for rounding, is itself."""
    rng = np.random.default_rng(4)
    for limit in (10.0 ** rng.uniform(-6.0, 6.0, 300)).tolist():
        for digits in (2, 3, 4):
            below, above = float(at_most(limit, digits)), float(at_least(limit, digits))
            step = 10.0 ** (math.floor(math.log10(limit)) + 1 - digits)
            assert below <= limit * (1.0 + 1e-9)
            assert above >= limit * (1.0 - 1e-9)
            assert above - below == pytest.approx(step, rel=1e-6)
            assert len(at_most(limit, digits).partition("e")[0].replace(".", "").lstrip("0")) <= max(
                digits, 7
            )
    assert [at_most(42.857142), at_least(42.857142), at_most(1 / 30, 4), at_most(1 / 60, 4)] == [
        "42.8", "42.9", "0.03333", "0.01666",
    ]  # fmt: skip
    assert (at_most(0.29 * 100), at_least(0.1 * 3 * 1000), at_most(300.0)) == ("29", "300", "300")
    assert at_least(1e3 * 5 * 0.004) == "20"
