"""The house has an order, and the imports keep it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

import scanner_sim

PACKAGE = Path(scanner_sim.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))

ROOMS = (
    "foundation",
    "scene",
    "optics",
    "scan",
    "render",
    "detector",
    "signals",
    "ranging",
    "tracking",
    "pose",
    "products",
    "analytic",
    "config",
    "instrument",
    "calibration",
    "acceptance",
    "validation",
    "campaign",
    "serve",
    "cli",
)
ORDER = {name: rank for rank, name in enumerate(ROOMS)}

# What the judge may share with the judged, and who may ask it.
SHARED_WITH_JUDGE = {"foundation.constants", "foundation.units", "foundation.errors"}
MAY_ASK_JUDGE = ("analytic", "validation.compare", "validation.reproduce")

# The device side of the flow. Elsewhere only the loader's four files, the streams and the numbers of kernels touch it.
DEVICE_ROOMS = {"mitsuba": {"render"}, "drjit": {"render", "detector", "signals"}}
DEVICE_FILES = {
    "mitsuba": {f"scene/files/{name}.py" for name in ("built_scene", "loader", "plugins", "shapes")},
    "drjit": {
        "scene/files/built_scene.py",
        "scene/files/loader.py",
        "foundation/device_loops.py",
        "foundation/device_numbers.py",
        "foundation/device_streams.py",
    },
}
NUMPY_ROOMS = {"ranging", "tracking", "pose"}
FORBIDDEN_AFTER_SIGNALS = {"mitsuba", "drjit", "torch", "jax"}

# Beside the verbs of the command line and the package's own file: an image and indices load pyplot when they are drawn,
# and formats of other programs are libraries that few have.
LOADS_LATE = {"products/image.py", "campaign/result.py", "products/formats/writers.py"}
# They take longer to load than the rest of a simulation together, and most simulations never call them.
LATE_LIBRARIES = {"colour", "scipy.signal", "xarray"}

LONGEST_MODULE = 450
STATEMENTS = ast.stmt | ast.excepthandler | ast.match_case


class Import(NamedTuple):
    """One imported module and where it is imported."""

    target: str
    line: int
    when_loaded: bool


def room_of(module: Path) -> str:
    """Name of the room or, for a file of the package itself, of the module."""
    first = module.relative_to(PACKAGE).parts[0]
    return first.removesuffix(".py")


def place(module: Path, line: int) -> str:
    return f"{module.relative_to(PACKAGE)}:{line}"


def name_of(module: Path) -> str:
    """Dotted name below the package; a room's own file has the name of the room."""
    parts = module.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


OWN = {f"scanner_sim.{name_of(module)}" for module in MODULES}


def is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")


def imports_of(source: str, package: tuple[str, ...]) -> Iterator[Import]:
    """Every import of a module; relative ones are resolved within ``package``."""

    def visit(node: ast.AST, when_loaded: bool) -> Iterator[Import]:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, node.lineno, when_loaded)
        elif isinstance(node, ast.ImportFrom):
            start = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            target = ".".join(part for part in (start, node.module) if part)
            # `from scanner_sim.scene import motion` names a module; `from scanner_sim.scene.motion import x` an object.
            inner = [f"{target}.{alias.name}" for alias in node.names]
            names = [name if name in OWN else target for name in inner]
            for name in names:
                yield Import(name, node.lineno, when_loaded)
        inside = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        # Only statements import: expressions, most of a file, need no look.
        for child in filter(lambda child: isinstance(child, STATEMENTS), ast.iter_child_nodes(node)):
            alternative = is_type_checking(node) and child in node.orelse  # type: ignore[attr-defined]
            typing_only = is_type_checking(node) and not alternative
            yield from visit(child, when_loaded and not inside and not typing_only)

    yield from visit(ast.parse(source), True)


@cache
def imports_in(module: Path) -> list[Import]:
    package = ("scanner_sim", *module.relative_to(PACKAGE).parent.parts)
    return list(imports_of(module.read_text(encoding="utf-8"), package))


def own_imports(module: Path) -> Iterator[tuple[str, int]]:
    """Imports from within the simulator: dotted name below the package, and line."""
    for target, line, _ in imports_in(module):
        first, _, name = target.partition(".")
        if first == "scanner_sim" and name:
            yield name, line


INNER = [module for module in MODULES if module != PACKAGE / "__init__.py"]


def test_every_module_belongs_to_a_room() -> None:
    strangers = {room_of(module) for module in INNER} - ORDER.keys() - {"__main__"}
    assert not strangers, f"no place in the order of the house: {sorted(strangers)}"


def test_imports_point_down_the_order() -> None:
    wrong = [
        f"{place(module, line)}: {room_of(module)} imports {target}, which comes later"
        for module in INNER
        for target, line in own_imports(module)
        if ORDER[target.split(".")[0]] > ORDER.get(room_of(module), len(ORDER))
    ]
    assert not wrong, "\n".join(wrong)


def test_no_modules_import_one_another_in_a_circle() -> None:
    uses = {name_of(module): {target for target, _ in own_imports(module)} for module in INNER}
    while True:
        used = set().union(*uses.values())
        left = {
            name: needed & uses.keys()
            for name, needed in uses.items()
            if needed & uses.keys() and name in used
        }
        if left == uses:
            break
        uses = left
    assert not uses, f"in circles: {uses}"


def test_the_judge_stands_apart() -> None:
    wrong = []
    for module in INNER:
        name = name_of(module)
        for target, line in own_imports(module):
            asked = target.split(".")[0] == "analytic"
            if room_of(module) == "analytic" and not asked and target not in SHARED_WITH_JUDGE:
                wrong.append(f"{place(module, line)}: the judge imports {target}")
            if asked and not name.startswith(MAY_ASK_JUDGE):
                wrong.append(f"{place(module, line)}: {name} asks the judge")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("library", ["mitsuba", "drjit"])
def test_the_renderer_stays_in_its_rooms(library: str) -> None:
    wrong = [
        place(module, line)
        for module in INNER
        for target, line, _ in imports_in(module)
        if target.split(".")[0] == library
        and room_of(module) not in DEVICE_ROOMS[library]
        and module.relative_to(PACKAGE).as_posix() not in DEVICE_FILES[library]
    ]
    assert not wrong, f"{library} imported in {wrong}"


def test_the_estimators_are_numpy_only() -> None:
    wrong = [
        f"{place(module, line)}: {target}"
        for module in INNER
        if room_of(module) in NUMPY_ROOMS
        for target, line, _ in imports_in(module)
        if target.split(".")[0] in FORBIDDEN_AFTER_SIGNALS
    ]
    assert not wrong, "\n".join(wrong)


def test_imports_stand_at_the_top() -> None:
    """Only what is listed loads what it needs when it needs it."""
    wrong = [
        f"{place(module, line)}: {target}"
        for module in INNER
        if room_of(module) != "cli" and str(module.relative_to(PACKAGE)) not in LOADS_LATE
        for target, line, when_loaded in imports_in(module)
        if not when_loaded and not any(f"{target}.".startswith(f"{late}.") for late in LATE_LIBRARIES)
    ]
    assert not wrong, "\n".join(wrong)


def test_modules_fit_in_a_head() -> None:
    lengths = {str(m.relative_to(PACKAGE)): len(m.read_text(encoding="utf-8").splitlines()) for m in MODULES}
    assert not {name: length for name, length in lengths.items() if length > LONGEST_MODULE}


def test_only_the_command_line_prints() -> None:
    wrong = [
        place(module, node.lineno)
        for module in INNER
        if room_of(module) != "cli" and "print" in (text := module.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
    ]
    assert not wrong, f"print() in {wrong}"


def test_this_reader_sees_every_kind_of_import() -> None:
    """The rules above are worth what the reader of imports sees: relative, nested and typing-only ones."""
    source = """
import drjit as dr
from ..optics import beam
from scanner_sim import scene
if TYPE_CHECKING:
    import xarray
else:
    import pint
def later():
    import matplotlib.pyplot
"""
    found = {(item.target, item.when_loaded) for item in imports_of(source, ("scanner_sim", "render"))}
    assert found == {
        ("drjit", True),
        ("scanner_sim.optics", True),
        ("scanner_sim.scene", True),
        ("xarray", False),
        ("pint", True),
        ("matplotlib.pyplot", False),
    }
