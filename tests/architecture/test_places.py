"""What stands where: the parts of a fault, and values that have the name of a parameter."""

from __future__ import annotations

import ast
import gc
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import scanner_sim

_WORDS = ("location", "problem", "remedy", "line")
_ELSEWHERE = {
    ("config/replacing.py", "put"),
    ("calibration/adjustment.py", "_assembled"),
    ("campaign/dataset/pack.py", "Dataset"),
    ("cli/dataset.py", "write_dataset"),
    ("cli/running.py", "write_run"),
    ("cli/running.py", "write_shots"),
    ("cli/tracking.py", "write_track"),
    ("foundation/units.py", "_convert"),
    ("foundation/units.py", "_scale"),
    ("instrument/closed_loop/frozen_instrument.py", "Situation"),
    ("instrument/closed_loop/situation.py", "Situation"),
    ("instrument/time_of_flight.py", "pulse_detector"),
    ("instrument/time_of_flight.py", "ranges_with_points"),
    ("instrument/voxel_records.py", "_window"),
    ("optics/line_image.py", "LineImage"),
    ("pose/collinearity.py", "arctan2"),
    ("pose/dot_images.py", "DotImages"),
    ("pose/solution.py", "_distance"),
    ("products/signal_set.py", "checked_columns"),
    ("ranging/coordinates.py", "arctan2"),
    ("render/beam/pattern.py", "probe_beams"),
    ("signals/line/search.py", "StrongestPeak"),
    ("tracking/scan.py", "TrackTarget"),
    ("validation/compare/targets.py", "square_points"),
    ("validation/compare/targets.py", "square_joint"),
    ("validation/reproduce/family/crossing.py", "Row"),
    ("validation/reproduce/family/tiles.py", "View"),
    ("validation/reproduce/run.py", "Book"),
    ("pose/solution.py", "trace"),
    ("serve/session.py", "with_state"),
    ("instrument/closed_loop/records.py", "PatternRecord"),
    ("instrument/closed_loop/tracker.py", "with_light"),
    ("instrument/closed_loop/tracker.py", "with_move"),
    ("instrument/camera_poses.py", "estimate_camera_pose"),
    ("optics/filter.py", "passband"),
    ("pose/series.py", "PoseSeries"),
    ("products/formats/writers.py", "bag_files"),
    ("products/pictures/docking.py", "plot"),
    ("products/pictures/pose_study.py", "plot"),
}
"""Calls whose value has the name of another parameter and stands where it is meant: each was looked at."""

STATED = tomllib.loads(Path(__file__).with_name("stated_defaults.toml").read_text(encoding="utf-8"))
Parameters = list[str]


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    """The modules of the package, by their path within it."""
    package = Path(scanner_sim.__file__).parent
    gc.disable()  # Nothing of a million nodes is garbage, and to look for it takes four times as long as to read.
    try:
        return {
            path.relative_to(package).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
            for path in sorted(package.rglob("*.py"))
        }
    finally:
        gc.enable()


@pytest.fixture(scope="module")
def nodes(trees: dict[str, ast.Module]) -> list[tuple[str, Any]]:
    """All calls, tables and assignments, with the module that each stands in."""
    kinds = (ast.Call, ast.Dict, ast.Assign)
    return [
        (path, node) for path, tree in trees.items() for node in ast.walk(tree) if isinstance(node, kinds)
    ]


def test_parts_of_a_fault_stand_in_their_order(nodes: list[tuple[str, Any]]) -> None:
    """Claim: wherever a fault is made, the place is a path of keys without a full stop, problem and remedy are
    sentences with one, and what has the name of one part is not given as another."""
    found = 0
    for path, call in nodes:
        if not isinstance(call, ast.Call) or getattr(call.func, "id", "") != "Fault":
            continue
        found += 1
        for word, part in zip(_WORDS, call.args, strict=False):
            where = f"{path}:{call.lineno}: {word}"
            named = getattr(part, "attr", getattr(part, "id", word))
            assert named == word or named not in _WORDS, where
            assert _ends_with_full_stop(part) in (None, word != "location"), where
            assert word != "line" or not isinstance(part, ast.JoinedStr), where
    assert found > 200


def test_what_is_named_as_a_parameter_is_given_as_it(
    trees: dict[str, ast.Module], nodes: list[tuple[str, Any]]
) -> None:
    """Claim: where a function or a class of the package is given a variable or an attribute with the name of one of its
    parameters, it is given as this one: what is swapped, or is its neighbour, has another's name."""
    known = {path: _named(tree) for path, tree in trees.items()}
    methods = _methods(trees)
    names = {path: _imported(path, tree, known) for path, tree in trees.items()}
    seen, unlike = 0, {}
    for path, call in (one for one in nodes if isinstance(one[1], ast.Call)):
        name, parameters = _called(call, *names[path], methods)
        starred = any(isinstance(one, ast.Starred) for one in call.args)
        given = [] if starred else list(zip(call.args, parameters, strict=False))
        given += [(one.value, str(one.arg).lstrip("_")) for one in call.keywords if one.arg]
        for value, meant in given:
            own = getattr(value, "id", getattr(value, "attr", "")).lstrip("_")
            seen += bool(own)
            if own != meant and own in parameters:
                unlike[path, name] = f"line {call.lineno}: {own} is given as {meant}"
    assert unlike.keys() == _ELSEWHERE, {at: unlike.get(at) for at in unlike.keys() ^ _ELSEWHERE}
    assert seen > 10_000


def test_entries_do_not_hold_what_others_are_named_for(nodes: list[tuple[str, Any]]) -> None:
    """Claim: in tables, named arguments and assignments of several names, no two entries are swapped, and none holds a
    second time what another is named for."""
    seen, wrong = 0, []
    for path, node in nodes:
        entries = _entries(node)
        within = {name: _mentioned(value) for name, value in entries.items()}
        seen += sum(name in mentioned for name, mentioned in within.items())
        for name, value in entries.items():
            for other in () if name in within[name] else within[name] & entries.keys():
                if name in within[other] or ast.dump(value) == ast.dump(entries[other]):
                    wrong.append(f"{path}: {name} is {ast.unparse(value)}")
    # What is now is before the next; a surface may reflect in visible light as it does at the laser's line.
    assert wrong == [
        "render/beam/edge_chords.py: before is now",
        "scene/visible.py: reflectance_visible is known.reflectance",
    ]
    assert seen > 2_000


def test_data_classes_are_frozen_and_say_only_what_is_not_the_default(nodes: list[tuple[str, Any]]) -> None:
    """Claim: a data class that says anything cannot be changed; beside that it says only that it is not compared, as
    arrays are not, or not printed."""
    wanted = {"frozen": "True", "eq": "False", "repr": "False"}
    found = [
        (path, node) for path, node in nodes if getattr(getattr(node, "func", None), "id", "") == "dataclass"
    ]
    for path, node in found:
        said = {one.arg: ast.unparse(one.value) for one in node.keywords}
        assert said.items() <= wanted.items(), f"{path}:{node.lineno}"
        assert "frozen" in said, f"{path}:{node.lineno}"
    assert len(found) > 200


def _entries(node: ast.AST) -> dict[str, ast.expr]:
    """Return the values of a table by their keys, of a call by the names, or of an assignment by the variables."""
    if isinstance(node, ast.Dict):
        pairs = zip(node.keys, node.values, strict=True)
        return {str(key.value): value for key, value in pairs if isinstance(key, ast.Constant)}
    if isinstance(node, ast.Call):
        return {one.arg: one.value for one in node.keywords if one.arg}
    if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple):
        targets = getattr(node.targets[0], "elts", [])
        if len(targets) == len(node.value.elts):
            return {
                getattr(one, "id", ""): value for one, value in zip(targets, node.value.elts, strict=True)
            }
    return {}


def _mentioned(value: ast.expr) -> set[str]:
    """Return the names of variables and attributes in a value."""
    nodes = list(ast.walk(value))
    names = {one.id.lstrip("_") for one in nodes if isinstance(one, ast.Name)}
    return names | {one.attr.lstrip("_") for one in nodes if isinstance(one, ast.Attribute)}


def _ends_with_full_stop(text: ast.expr) -> bool | None:
    """Return whether a text that is written out ends so; None where its end is computed, or it is empty."""
    last = text.values[-1] if isinstance(text, ast.JoinedStr) else text
    if isinstance(last, ast.Constant) and isinstance(last.value, str) and last.value:
        return last.value.endswith(".")
    return None


def _parameters(function: ast.FunctionDef, *, bound: bool) -> Parameters:
    every = (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)
    names = [one.arg.lstrip("_") for one in every]
    return names[1:] if bound else names


def _named(tree: ast.Module) -> dict[str, Parameters]:
    """Return the parameters of the functions and classes of a module."""
    found = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            found[node.name] = _parameters(node, bound=False)
        elif isinstance(node, ast.ClassDef):
            own = [one for one in node.body if isinstance(one, ast.FunctionDef) and one.name == "__init__"]
            fields = [ast.unparse(one.target) for one in node.body if isinstance(one, ast.AnnAssign)]
            about = " ".join(map(ast.unparse, (*node.decorator_list, *node.bases)))
            if own:
                found[node.name] = _parameters(own[0], bound=True)
            elif "dataclass" in about or "NamedTuple" in about:
                found[node.name] = [name.lstrip("_") for name in fields]
    return found


def _methods(trees: dict[str, ast.Module]) -> dict[str, Parameters]:
    """Return the parameters of methods that are the same in all classes that have one of the name."""
    found: dict[str, list[Parameters]] = {}
    for tree in trees.values():
        for kind in (node for node in tree.body if isinstance(node, ast.ClassDef)):
            for one in (node for node in kind.body if isinstance(node, ast.FunctionDef)):
                about = " ".join(map(ast.unparse, one.decorator_list))
                if "property" not in about:
                    bound = "staticmethod" not in about
                    found.setdefault(one.name, []).append(_parameters(one, bound=bound))
    return {name: every[0] for name, every in found.items() if all(one == every[0] for one in every)}


def _imported(
    path: str, tree: ast.Module, known: dict[str, dict[str, Parameters]]
) -> tuple[dict[str, Parameters], dict[str, dict[str, Parameters]]]:
    """Return what a module knows by name: functions and classes, and modules."""
    here, modules = dict(known[path]), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("scanner_sim"):
            folder = str(node.module).partition(".")[2].replace(".", "/")
            own = known.get(f"{folder}.py", known.get(f"{folder}/__init__.py", {}))
            for one in node.names:
                name, module = one.asname or one.name, f"{folder}/{one.name}.py"
                if one.name in own:
                    here[name] = own[one.name]
                elif module in known:
                    modules[name] = known[module]
    return here, modules


def _called(
    call: ast.Call,
    here: dict[str, Parameters],
    modules: dict[str, dict[str, Parameters]],
    methods: dict[str, Parameters],
) -> tuple[str, Parameters]:
    """Return the name of what is called and its parameters, none where it is not of the package."""
    if isinstance(call.func, ast.Name):
        return call.func.id, here.get(call.func.id, [])
    if isinstance(call.func, ast.Attribute):
        name, of = call.func.attr, getattr(call.func.value, "id", "")
        return name, modules[of].get(name, []) if of in modules else methods.get(name, [])
    return "", []


def defaults(node: ast.AST, inside: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the names and values of what parameters and parts of data classes are if nobody says, where that is a
    number, a word or several."""
    for child in ast.iter_child_nodes(node):
        within = inside
        found: list[tuple[str, ast.expr]] = []
        if isinstance(child, ast.ClassDef | ast.FunctionDef):
            within = f"{inside}{child.name}."
        if isinstance(child, ast.FunctionDef):
            own = child.args
            placed = [*own.posonlyargs, *own.args][-len(own.defaults) :] if own.defaults else []
            named = zip([*placed, *own.kwonlyargs], [*own.defaults, *own.kw_defaults], strict=True)
            found = [(one.arg, value) for one, value in named if value is not None]
        elif isinstance(child, ast.ClassDef):
            parts = [one for one in child.body if isinstance(one, ast.AnnAssign) and one.value is not None]
            found = [(ast.unparse(one.target), one.value) for one in parts if one.value is not None]
        for name, value in found:
            try:
                given = ast.literal_eval(value)
            except ValueError:
                continue
            if given not in (None, "", ()) and not isinstance(given, bytes):
                yield f"{within}{name}", list(given) if isinstance(given, tuple) else given
        yield from defaults(child, within)


def test_what_holds_if_nobody_says_is_what_is_stated(trees: dict[str, ast.Module]) -> None:
    """Claim: numbers, flags and words that parameters and parts have by default stand once more in
    ``stated_defaults.toml``: who leaves them out relies on them, and most calls in the package name others. Who changes
    one on purpose changes it there, too."""
    found = {path: dict(defaults(tree)) for path, tree in trees.items()}
    found = {path: values for path, values in found.items() if values}
    assert sorted(found) == sorted(STATED)
    for path, values in found.items():
        assert [f"{name}: {value!r}" for name, value in values.items()] == [
            f"{name}: {value!r}" for name, value in STATED[path].items()
        ], path
