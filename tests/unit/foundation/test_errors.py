"""Messages of faults, and functions of the user's own: what is listed, what is loaded, what is refused."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from scanner_sim.foundation.errors import MOST_FAULTS, Fault, InputError, ScenarioError
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
    for name in (":double", "own_laws_of_this_test", "own_laws_of_this_test:", "own_laws_of_this_test:a b"):
        with pytest.raises(InputError, match=r"is not MODULE:FUNCTION"):
            load(name)
    with pytest.raises(InputError, match="cannot be imported"):
        load("no_such_laws_of_this_test:double")
    for name in ("number", "triple"):
        with pytest.raises(InputError, match=f"has no function {name}"):
            load(f"own_laws_of_this_test:{name}")
