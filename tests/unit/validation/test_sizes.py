"""How many shots laws take, how many runs and voxels figures, and over which ladders of ranges, whole and quick ones.

They stand once more in ``sizes.toml``, for most other tests take fewer: with another number a comparison finds another
least deviation, and a figure of the documents is another one. Who changes one on purpose changes it there, too.
"""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path

import pytest

from scanner_sim import validation

STATED = tomllib.loads(Path(__file__).with_name("sizes.toml").read_text(encoding="utf-8"))
ROOT = Path(validation.__file__).parent
TAKEN = (("setting", "shots"), ("task", "choose"), ("np", "geomspace"), ("np", "linspace"))


def sizes(file: Path) -> list[str]:
    """Return numbers of shots, choices and ladders of a file, in the order of its lines."""
    found = []
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            owner, name = ast.unparse(node.func.value), node.func.attr
            if (owner, name) in TAKEN:
                words = ", ".join(map(ast.unparse, node.args))
                found.append((node.lineno, node.col_offset, f"{name} {words}"))
    return [words for *_, words in sorted(found)]


@pytest.mark.parametrize("name", sorted(STATED))
def test_sizes_are_those_that_are_stated(name: str) -> None:
    assert sizes(ROOT / name) == STATED[name]


def test_all_files_that_take_a_number_of_shots_state_it() -> None:
    found = {str(path.relative_to(ROOT)) for path in ROOT.rglob("*.py") if sizes(path)}
    assert found == set(STATED)
    assert sum(map(len, STATED.values())) > 100
