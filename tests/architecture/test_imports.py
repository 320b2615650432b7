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

FOUNDATIONS = ("arithmetic", "errors", "units", "constants", "frames", "status", "streams", "parts")
ROOMS = (
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
)
WHOLE = (
    "scanner",
    "scenario",
    "config",
    "conditions",
    "lidar",
    "workbench",
    "neighbourhood",
    "memory",
    "voxel_records",
    "simulate",
    "photo",
    "closed_loop",
    "studies",
    "compare",
    "reproduce",
    "cli",
)
ORDER = {name: rank for rank, name in enumerate((*ROOMS, "analytic", *WHOLE), start=1)}
ORDER |= dict.fromkeys(FOUNDATIONS, 0)

# What the judge may share with the judged, and who may ask it.
SHARED_WITH_JUDGE = {"analytic", "constants", "units", "errors"}
MAY_ASK_JUDGE = {"analytic", "compare", "reproduce", "cli"}

# The device side of the flow. Elsewhere only the loader's three files and the streams touch it.
DEVICE_ROOMS = {"mitsuba": {"render"}, "drjit": {"render", "detector", "signals"}}
DEVICE_FILES = {
    "mitsuba": {"scene/loader.py", "scene/plugins.py", "scene/shapes.py"},
    "drjit": {"scene/loader.py", "streams.py"},
}
NUMPY_ROOMS = {"ranging", "tracking", "pose"}
FORBIDDEN_AFTER_SIGNALS = {"mitsuba", "drjit", "torch", "jax"}

HEAVY = {"pint", "colour", "matplotlib", "mitsuba", "drjit", "trimesh", "xarray"}
QUICK_TO_IMPORT = {"__init__.py", "cli.py", "scenario.py", "config.py", "units.py"}

LONGEST_MODULE = 450


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
            # `from scanner_sim import frames` names a room; `from scanner_sim.frames import x` an object.
            names = (
                [f"{target}.{alias.name}" for alias in node.names] if target == "scanner_sim" else [target]
            )
            for name in names:
                yield Import(name, node.lineno, when_loaded)
        inside = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for child in ast.iter_child_nodes(node):
            alternative = is_type_checking(node) and child in node.orelse  # type: ignore[attr-defined]
            typing_only = is_type_checking(node) and not alternative
            yield from visit(child, when_loaded and not inside and not typing_only)

    yield from visit(ast.parse(source), True)


@cache
def imports_in(module: Path) -> list[Import]:
    package = ("scanner_sim", *module.relative_to(PACKAGE).parent.parts)
    return list(imports_of(module.read_text(encoding="utf-8"), package))


def own_imports(module: Path) -> Iterator[tuple[str, int]]:
    """Imports from within the simulator: room and line."""
    for target, line, _ in imports_in(module):
        parts = target.split(".")
        if parts[0] == "scanner_sim" and len(parts) > 1:
            yield parts[1], line


INNER = [module for module in MODULES if module != PACKAGE / "__init__.py"]


def test_every_module_belongs_to_a_room() -> None:
    strangers = {room_of(module) for module in INNER} - ORDER.keys() - {"__main__"}
    assert not strangers, f"no place in the order of the house: {sorted(strangers)}"


def test_imports_point_down_the_order() -> None:
    wrong = [
        f"{place(module, line)}: {room_of(module)} imports {target}, which comes later"
        for module in INNER
        for target, line in own_imports(module)
        if ORDER.get(target, -1) > ORDER.get(room_of(module), len(ORDER))
    ]
    assert not wrong, "\n".join(wrong)


def test_foundations_do_not_import_one_another_in_a_circle() -> None:
    uses = {
        room_of(module): {target for target, _ in own_imports(module)} & set(FOUNDATIONS)
        for module in INNER
        if room_of(module) in FOUNDATIONS
    }
    while leaves := {name for name, needed in uses.items() if not needed & uses.keys()}:
        uses = {name: needed for name, needed in uses.items() if name not in leaves}
    assert not uses, f"foundations in a circle: {sorted(uses)}"


def test_the_judge_stands_apart() -> None:
    wrong = []
    for module in INNER:
        room = room_of(module)
        for target, line in own_imports(module):
            if room == "analytic" and target not in SHARED_WITH_JUDGE:
                wrong.append(f"{place(module, line)}: the judge imports {target}")
            if target == "analytic" and room not in MAY_ASK_JUDGE:
                wrong.append(f"{place(module, line)}: {room} asks the judge")
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


def test_what_is_loaded_first_loads_nothing_heavy() -> None:
    wrong = [
        f"{place(module, line)}: {target}"
        for module in MODULES
        if module.relative_to(PACKAGE).as_posix() in QUICK_TO_IMPORT
        for target, line, when_loaded in imports_in(module)
        if when_loaded and target.split(".")[0] in HEAVY
    ]
    assert not wrong, "import these inside the function that needs them:\n" + "\n".join(wrong)


def test_modules_fit_in_a_head() -> None:
    lengths = {str(m.relative_to(PACKAGE)): len(m.read_text(encoding="utf-8").splitlines()) for m in MODULES}
    assert not {name: length for name, length in lengths.items() if length > LONGEST_MODULE}


def test_only_the_command_line_prints() -> None:
    wrong = [
        place(module, node.lineno)
        for module in INNER
        if room_of(module) != "cli"
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8")))
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
