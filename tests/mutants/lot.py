"""Draw faults that nobody chose, plant them, and see how many the tests notice.

    lot.py 511001 -n 50                    one fault in each of 50 functions of all rooms
    lot.py 511001 -n 50 ranging tracking   of some

A place of the syntax tree is drawn, and one of what may go wrong there: a term or a factor dropped, a sign, 5 % of a
number, one off in an index, the other axis, a square or a root left out, two arguments or two outcomes exchanged. Texts
and annotations have none. First those tests are asked that name the module or lie in its room, then all but the slow
ones. Who reads what lives leaves out what has no consequence: a cap that nothing reaches, how pictures are drawn.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from pathlib import Path

from plant import REPOSITORY, Fault, NoSuchTestError, asked_of, copied
from scipy.stats import binomtest

PACKAGE = REPOSITORY / "scanner_sim"
LAWS = ("unit/test_stated_limits.py", "unit/test_stated_numbers.py", "architecture/test_places.py")
"""Tests of all rooms at once."""
_LOST = ("mutants", "architecture/test_package.py", "architecture/test_wheel.py")
"""What fails in any copy, or for any change of a text."""
_PAIRS = (
    ("theta", "phi"), ("across", "down"), ("rows", "columns"), ("row", "column"), ("x", "y"), ("y", "z"),
    ("right", "down"), ("first", "last"), ("low", "high"), ("near", "far"), ("width", "height"), ("sun", "earth"),
)  # fmt: skip
_CALLS = {
    "sin": "cos", "cos": "sin", "fmin": "fmax", "fmax": "fmin", "minimum": "maximum", "maximum": "minimum",
    "floor": "ceil", "ceil": "floor", "min": "max", "max": "min", "argmin": "argmax", "argmax": "argmin",
}  # fmt: skip
_LEFT_OUT = ("sqrt", "square", "abs", "exp", "log", "radians", "degrees")
_PLACES = (ast.BinOp, ast.UnaryOp, ast.Constant, ast.Call, ast.Compare, ast.Attribute, ast.Name)
_TEXTS = (ast.Raise, ast.JoinedStr, ast.Assert)
_OTHER_WAY: dict[type[ast.cmpop], str] = {ast.Lt: ">", ast.Gt: "<", ast.LtE: "<", ast.GtE: ">"}


def changes(node: ast.AST, said: Callable[[ast.AST], str], text: str) -> Iterator[str]:
    """Yield what may stand in place of a node, which is ``said`` so in its file's ``text``."""
    if isinstance(node, ast.BinOp):
        yield from _of_two(node.op, *(f"({said(one)})" for one in (node.left, node.right)))
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield f"({said(node.operand)})"
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield from _of_number(node.value)
    elif isinstance(node, ast.Call):
        yield from _of_call(node, said)
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in _OTHER_WAY and len(node.ops) == 1:
        yield f"{said(node.left)} {_OTHER_WAY[type(node.ops[0])]} {said(node.comparators[0])}"
    elif isinstance(node, ast.Attribute | ast.Name) and isinstance(node.ctx, ast.Load):
        whole = said(node)
        for one, other in (*_PAIRS, *((b, a) for a, b in _PAIRS)):
            named = re.sub(rf"(?<![a-z]){one}$", other, whole)
            if named != whole and re.search(rf"\b{re.escape(named.rpartition('.')[2])}\b", text):
                yield named


def _of_two(operator: ast.operator, left: str, right: str) -> Iterator[str]:
    match operator:
        case ast.Add():
            yield from (f"({left} - {right})", left)
        case ast.Sub():
            yield from (f"({left} + {right})", left)
        case ast.Mult():
            yield from (left, right, f"({left} / {right})", f"(1.05 * {left} * {right})")
        case ast.Div():
            yield from (left, f"({left} * {right})", f"(0.95 * {left} / {right})")
        case ast.Pow() | ast.Mod():
            yield left
        case ast.FloorDiv():
            yield f"-(-{left} // {right})"


def _of_number(value: float) -> Iterator[str]:
    if isinstance(value, int):
        yield from (str(value + 1), *([str(value - 1)] if value else []))
    elif value:
        yield from (repr(float(f"{1.05 * value:.6g}")), f"(-{value!r})")
    else:
        yield "0.1"


def _of_call(node: ast.Call, said: Callable[[ast.AST], str]) -> Iterator[str]:
    called, given = said(node.func), [said(one) for one in node.args]
    name = called.rpartition(".")[2]
    if name in _CALLS:
        yield said(node).replace(called, called.removesuffix(name) + _CALLS[name], 1)
    if name in _LEFT_OUT and len(given) == 1:
        yield f"({given[0]})"
    if name == "hypot" and len(given) == 2:
        yield f"({given[0]} + {given[1]})"
    if name in ("arctan2", "cross") and len(given) == 2:
        yield f"{called}({given[1]}, {given[0]})"
    if name in ("where", "select") and len(given) == 3:
        yield f"{called}({given[0]}, {given[2]}, {given[1]})"


@dataclass(frozen=True)
class Source:
    """A file of the package: its text, and where its lines begin [byte]."""

    path: Path
    text: bytes
    begins: list[int]

    @classmethod
    def of(cls, path: Path) -> Source:
        """Return that of a path."""
        text = path.read_bytes()
        return cls(path, text, [0, *accumulate(len(line) for line in text.splitlines(keepends=True))])

    def ends(self, node: ast.AST) -> tuple[int, int]:
        """Return where a node begins and ends [byte]."""
        places = (("lineno", "col_offset"), ("end_lineno", "end_col_offset"))
        first, last = (
            self.begins[getattr(node, line) - 1] + getattr(node, column) for line, column in places
        )
        return first, last

    def said(self, node: ast.AST) -> str:
        """Return what stands there."""
        first, last = self.ends(node)
        return self.text[first:last].decode()

    def nodes(self) -> Iterator[tuple[str, ast.AST]]:
        """Yield the function and the node of all places where something may go wrong."""

        def within(node: ast.AST, function: str) -> Iterator[tuple[str, ast.AST]]:
            for field, value in ast.iter_fields(node):
                if field in ("annotation", "returns", "decorator_list", "bases"):
                    continue
                for child in value if isinstance(value, list) else [value]:
                    if isinstance(child, ast.AST) and not isinstance(child, _TEXTS):
                        own = isinstance(child, ast.FunctionDef | ast.ClassDef)
                        inside = f"{function}.{child.name}" if own else function
                        if isinstance(child, _PLACES):
                            yield inside, child
                        yield from within(child, inside)

        return within(ast.parse(self.text), "")

    def changed(self, node: ast.AST, now: str) -> Fault | None:
        """Return a fault whose text stands once in the file; None for one that changes nothing, or is no Python."""
        first, last = self.ends(node)
        try:
            same = ast.dump(ast.parse(self.text[:first] + now.encode() + self.text[last:])) == ast.dump(
                ast.parse(self.text)
            )
        except SyntaxError:
            return None
        head, tail = self.text[:first].decode(), self.text[last:].decode()
        whole, was, about = self.text.decode(), self.said(node), 0
        while whole.count(head[len(head) - about :] + was + tail[:about]) != 1:
            about += 8
        left, right = head[len(head) - about :], tail[:about]
        file = self.path.relative_to(PACKAGE).as_posix()
        return None if same else Fault("lot", file, left + was + right, left + now + right, near(file))


def drawn(seed: int, count: int, rooms: list[str]) -> list[Fault]:
    """Return so many faults, no two of one function, of files whose path begins with one of the rooms."""
    draw = random.Random(seed)
    found = [
        (source, *place)
        for source in map(Source.of, sorted(PACKAGE.rglob("*.py")))
        if any(source.path.relative_to(PACKAGE).as_posix().startswith(room) for room in rooms)
        for place in source.nodes()
    ]
    draw.shuffle(found)
    faults: dict[tuple[Path, str], Fault] = {}
    for source, function, node in found:
        if len(faults) == count:
            break
        others = list(changes(node, source.said, source.text.decode()))
        if others and (source.path, function) not in faults:
            fault = source.changed(node, draw.choice(others))
            if fault is not None:
                faults[source.path, function] = fault
    return list(faults.values())


@cache
def _tests() -> dict[str, str]:
    tests = REPOSITORY / "tests"
    return {
        path.relative_to(tests).as_posix(): path.read_text(encoding="utf-8")
        for path in sorted(tests.rglob("test_*.py"))
    }


def near(file: str) -> tuple[str, ...]:
    """Return the tests that name a module of the package, or lie in its room."""
    module = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    parent, _, leaf = module.rpartition(".")
    named = re.compile(rf"\bscanner_sim\.(?:{re.escape(module)}\b|{re.escape(parent)} import .*\b{leaf}\b)")
    room = f"unit/{file.split('/')[0]}/"
    found = [
        name
        for name, text in _tests().items()
        if name.startswith(room) or (leaf in text and named.search(text))
    ]
    return (*(name for name in found if not name.startswith(_LOST)), *LAWS)


def noticed(fault: Fault, repository: Path) -> str:
    """Return which test notices a fault that is planted in a copy, empty if none does."""
    text = fault.plant(repository)
    try:
        try:
            killer = asked_of(repository, fault.tests, "not slow")
        except NoSuchTestError:
            killer = ""
        return killer or _all(repository)
    finally:
        fault.write(repository, text)


def _all(repository: Path) -> str:
    """Return the first of all plain tests that fails."""
    ignored = [word for name in _LOST for word in ("--ignore", f"tests/{name}")]
    ignored += ["--deselect", "tests/system/test_readme.py::test_links_lead_somewhere"]
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--tb=no", "-p", "no:cacheprovider", *ignored]
    made = subprocess.run(
        command,
        cwd=repository,
        env={**os.environ, "PYTHONPATH": str(repository)},
        capture_output=True,
        text=True,
        check=False,
    )
    found = re.search(r"^(?:FAILED|ERROR) tests/(.+?)(?: - |$)", made.stdout, re.MULTILINE)
    return found[1] if found else ("" if made.returncode == 0 else "the process died")


def main() -> int:
    """Run as the module says; the exit status is 1 if a fault lives."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("seed", type=int)
    asked.add_argument("rooms", nargs="*", default=[""], help="folders of the package; all without")
    asked.add_argument("-n", type=int, default=20, help="how many faults (20)")
    asked.add_argument("--show", action="store_true", help="draw them, and plant none")
    given = asked.parse_intermixed_args()
    faults = drawn(given.seed, given.n, given.rooms)
    if given.show:
        print(*(fault.name for fault in faults), sep="\n")
        return 0
    alive = []
    with tempfile.TemporaryDirectory() as folder:
        repository = copied(Path(folder) / "copy")
        for number, fault in enumerate(faults, 1):
            killer = noticed(fault, repository)
            print(f"{number}/{len(faults)}  {fault.name}\n      {killer or 'LIVES'}", flush=True)
            alive += [] if killer else [fault.name]
    share = binomtest(len(faults) - len(alive), len(faults)).proportion_ci(method="wilson")
    print(
        f"{len(faults) - len(alive)} of {len(faults)} are noticed: {share.low:.0%} to {share.high:.0%} at 95 %"
    )
    print(*alive, sep="\n  lives: ")
    return bool(alive)


if __name__ == "__main__":
    sys.exit(main())
