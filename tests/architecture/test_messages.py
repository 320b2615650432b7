"""What is told of a fault of a file stands in its place: where, what, and what to do."""

from __future__ import annotations

import ast
from pathlib import Path

_WORDS = ("location", "problem", "remedy", "line")


def _ends_with_full_stop(text: ast.expr) -> bool | None:
    """Return whether a text that is written out ends so; None where its end is computed, or it is empty."""
    last = text.values[-1] if isinstance(text, ast.JoinedStr) else text
    if isinstance(last, ast.Constant) and isinstance(last.value, str) and last.value:
        return last.value.endswith(".")
    return None


def test_parts_of_a_fault_stand_in_their_order(repo_root: Path) -> None:
    """Claim: wherever a fault is made, the place is a path of keys without a full stop, problem and remedy are
    sentences with one, and what has the name of one part is not given as another."""
    found = 0
    for path in sorted((repo_root / "scanner_sim").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for call in ast.walk(ast.parse(text)) if "Fault(" in text else ():
            if not isinstance(call, ast.Call) or getattr(call.func, "id", "") != "Fault":
                continue
            found += 1
            for word, part in zip(_WORDS, call.args, strict=False):
                where = f"{path.name}:{call.lineno}: {word}"
                named = getattr(part, "attr", getattr(part, "id", word))
                assert named == word or named not in _WORDS, where
                assert _ends_with_full_stop(part) in (None, word != "location"), where
                assert word == "line" or not isinstance(getattr(part, "value", ""), int), where
                assert word != "line" or not isinstance(part, ast.JoinedStr), where
    assert found > 200
