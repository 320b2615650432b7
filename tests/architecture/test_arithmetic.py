"""What goes into tracks and poses is computed with arithmetic that does not depend on the processor."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import scanner_sim

PACKAGE = Path(scanner_sim.__file__).parent
ROOMS = ("ranging", "tracking", "pose", "closed_loop")
FUNCTIONS = {
    "arccos",
    "arcsin",
    "arctan",
    "arctan2",
    "dot",
    "exp",
    "expm1",
    "log",
    "log1p",
    "matmul",
    "power",
    "tan",
}
SAME_EVERYWHERE = {"norm"}
"""Of numpy.linalg: along an axis it is a sum and a root."""
CHECKS = {"det", "eigvalsh"}
"""Of numpy.linalg: these only decide whether an input is refused, far from the threshold."""


def chosen_by_processor(source: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            yield f"{node.lineno}: @"
        if isinstance(node, ast.keyword) and node.arg == "optimize":
            yield f"{node.value.lineno}: einsum(optimize=)"
        if isinstance(node, ast.Attribute):
            owner = ast.unparse(node.value)
            if owner == "np" and node.attr in FUNCTIONS:
                yield f"{node.lineno}: np.{node.attr}"
            if owner == "np.linalg" and node.attr not in SAME_EVERYWHERE | CHECKS:
                yield f"{node.lineno}: np.linalg.{node.attr}"


@pytest.mark.parametrize("room", ROOMS)
def test_no_code_is_chosen_by_the_processor(room: str) -> None:
    found = [
        f"{module.relative_to(PACKAGE)}:{use}"
        for module in (PACKAGE / room).rglob("*.py")
        for use in chosen_by_processor(module.read_text(encoding="utf-8"))
    ]
    assert not found, "scanner_sim/foundation/arithmetic.py has what does not depend on it"


def test_the_rule_finds_what_it_forbids() -> None:
    source = "np.exp(a @ b)\nnp.linalg.inv(a)\nnp.einsum('ij', a, optimize=True)\nnp.linalg.norm(a, axis=0)"
    assert len(list(chosen_by_processor(source))) == 4
