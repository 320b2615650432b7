"""The reference, generated from the code while the site is built: nothing in it can fall behind.

Each function returns one page of Markdown. ``docs/site_hooks.py`` puts them into the site.
"""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Any

import scanner_sim
from scanner_sim.config import json_schema
from scanner_sim.config.outline import EACH, outline
from scanner_sim.products.image import CHANNELS
from scanner_sim.scenario import Scenario
from scanner_sim.scene.materials import MATERIALS
from scanner_sim.status import Status

FILES: Mapping[str, str] = {
    "range.exr": "every layer of a raster scan, float32, with scenario, versions, units and legends in its header",
    "scenario.yaml": "the scenario with every default written out; running it gives the same bytes",
    "summary.json": "counts, quantiles and, apart, the distance from the truth",
    "range.png": "range in colours; voxels without one in the colour of their status",
    "shaded.png": "derivative of the range in grey levels",
    "signal.png": "returned signal on a logarithmic scale",
    "points.ply": "the points with intensity and σ, binary little-endian PLY",
    "tof.png": "range by time of flight in grey levels, a dot for each voxel",
    "background.png": "charge of sunlight and Earthshine about the spot, on a logarithmic scale",
    "camera.png": "what an ordinary video camera at the scanner sees",
    "waveforms.nc": "waveforms of time of flight as NetCDF, for xarray",
}
"""The files of a run, in the order of presentation."""


def scenario_page() -> str:
    """Every key of a scenario with its form, default, bounds and meaning, part by part."""
    schema = json_schema()
    parts = {"Scenario": schema, **schema["$defs"]}
    units, places = _units(), _places()
    order = list(_reached("Scenario", parts, {}))
    lines = [
        "# Keys of a scenario",
        "",
        "Written from the program's own types. In a file every number with a dimension needs a unit; the",
        "column *form* shows the SI unit in which the program holds it, and any unit of the same dimension is",
        "understood. `scanner-sim check` prints a scenario with all defaults, and `scanner-sim schema` the",
        "JSON schema by which editors complete keys.",
        "",
    ]
    for name in order:
        lines += _part(name, parts[name], units, places.get(name, []))
    return "\n".join(lines) + "\n"


def _units() -> dict[tuple[str, str], str]:
    """Return the SI unit of each key that has one, and its bounds, by part and key."""
    places = outline()
    units = {}
    for place, slot in places.items():
        if not place or place[-1] == EACH:
            continue
        part = places[place[:-1]].part if place[:-1] in places else None
        entry = slot if slot.dimension is not None else places.get((*place, EACH))
        if part is not None and entry is not None and entry.dimension is not None:
            bounds = (
                [] if slot.dimension is None or slot.field is None else _bounds(slot.field, slot.dimension)
            )
            unit = "ratio" if entry.dimension.unit == "1" else entry.dimension.unit
            units[part.__name__, place[-1]] = ", ".join([unit, *bounds])
    return units


def _bounds(field: Any, dimension: Any) -> list[str]:
    """Return the bounds of a dimensioned key as a file would spell them."""
    signs = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
    return [
        f"{sign} {dimension.format(float(getattr(limit, name)))}"
        for limit in field.metadata
        for name, sign in signs.items()
        if getattr(limit, name, None) is not None
    ]


def _reached(name: str, parts: Mapping[str, Any], seen: dict[str, None]) -> dict[str, None]:
    """Return the names of all parts below one, each once, in the order in which a reader meets them."""
    seen[name] = None
    for below in _names_in(parts[name].get("properties", {})):
        if below not in seen:
            _reached(below, parts, seen)
    return seen


def _names_in(node: Any) -> Iterator[str]:
    if isinstance(node, dict):
        if isinstance(node.get("$ref"), str):
            yield node["$ref"].rpartition("/")[2]
        for value in node.values():
            yield from _names_in(value)
    elif isinstance(node, list):
        for value in node:
            yield from _names_in(value)


def _places() -> dict[str, list[str]]:
    """Return where each part may stand in a scenario, as a user would write it."""
    places: dict[str, dict[str, None]] = {}
    for place, slot in outline().items():
        if slot.part is not None:
            steps = (step for step in place if not step.startswith("("))
            spelled = ".".join(steps).replace(f".{EACH}", "[…]")
            places.setdefault(slot.part.__name__, {})[spelled] = None
    return {name: [place for place in found if place] for name, found in places.items()}


def _part(
    name: str, schema: Mapping[str, Any], units: Mapping[tuple[str, str], str], places: list[str]
) -> list[str]:
    properties = schema.get("properties", {})
    lines = [f"## {name} {{#{name.lower()}}}", "", _cell(schema.get("description", "")), ""]
    if places:
        lines += ["At " + ", ".join(f"`{place}`" for place in places[:4]) + ".", ""]
    if not properties:
        return lines
    lines += ["| key | form | default | meaning |", "|---|---|---|---|"]
    required = schema.get("required", ())
    for key, node in properties.items():
        default = "**required**" if key in required else _default(node)
        form = _cell(_form(node, units.get((name, key), "")))
        meaning = node.get("description") or ("Says what kind of part this is." if "const" in node else "")
        lines.append(f"| `{key}` | {form} | {default} | {_cell(meaning)} |")
    return [*lines, ""]


def _default(node: Mapping[str, Any]) -> str:
    value = node.get("default")
    if isinstance(value, dict):
        return "see there" if value else "none"
    if value is None or value == []:
        return "none"
    return f"`{_cell(_yaml(value))}`"


def _yaml(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_yaml, value)) + "]"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _form(node: Mapping[str, Any], unit: str) -> str:
    """Return what may be written at a key, in words."""
    if "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    for word in ("oneOf", "anyOf"):
        if word in node:
            forms = dict.fromkeys(
                _form(choice, unit) for choice in node[word] if choice.get("type") != "null"
            )
            return " or ".join(forms)
    if "const" in node:
        return f"`{_yaml(node['const'])}`"
    if "enum" in node:
        return ", ".join(f"`{_yaml(choice)}`" for choice in node["enum"])
    if node.get("type") == "array":
        items = node.get("prefixItems")
        if items:
            return f"[{', '.join(_form(item, unit) for item in items)}]"
        return f"list of {_form(node.get('items', {}), unit)}"
    if node.get("type") == "object":
        return "mapping"
    kinds = {"integer": "whole number", "number": "number", "boolean": "true or false", "string": "text"}
    form = kinds.get(str(node.get("type")), "value")
    if form == "text" and unit:
        form = unit
    bounds = [
        f"{sign} {node[key]:g}"
        for key, sign in (
            ("minimum", "≥"),
            ("exclusiveMinimum", ">"),
            ("maximum", "≤"),
            ("exclusiveMaximum", "<"),
        )
        if key in node
    ]
    return form + (f", {', '.join(bounds)}" if bounds else "")


def _cell(text: str) -> str:
    return " ".join(str(text).split()).replace("|", "\\|")


def command_page() -> str:
    """Every verb of the command line with its arguments and options."""
    import typer

    from scanner_sim.cli import app

    group: Any = typer.main.get_command(app)
    lines = [
        "# Command line",
        "",
        "Written from the program itself; `scanner-sim VERB --help` says the same. It ends with 0 when the",
        "work is done, 1 when it failed, 2 when the input was bad. A result appears whole or not at all, and",
        "an existing one is replaced only with `--overwrite`.",
        "",
    ]
    for name, command in group.commands.items():
        lines += [f"## scanner-sim {name} {{#{name}}}", "", inspect.cleandoc(command.help or ""), ""]
        rows = [row for row in map(_option, command.params) if row]
        if rows:
            lines += ["| option | default | meaning |", "|---|---|---|", *rows, ""]
    return "\n".join(lines) + "\n"


def _option(option: Any) -> str:
    if option.name == "help":
        return ""
    argument = "Argument" in type(option).__name__
    spelled = f"`{option.metavar or option.name.upper()}`"
    if not argument:
        names = ", ".join(f"`{name}`" for name in option.opts)
        spelled = names + (f" `{option.metavar}`" if option.metavar else "")
    shown = option.show_default if isinstance(option.show_default, str) else None
    default = shown or ("" if argument or option.default in (None, False, [], ()) else f"`{option.default}`")
    return f"| {spelled} | {_cell(default or '–')} | {_cell(option.help or '')} |"


def files_page() -> str:
    """The files that a run writes, the layers of range.exr and the codes of status."""
    lines = ["# Files and channels", "", "## The folder of a run", "", "| file | holds |", "|---|---|"]
    lines += [f"| `{name}` | {sentence} |" for name, sentence in FILES.items()]
    lines += [
        "",
        "The Sun adds `background.png` and `camera.png`, time of flight `tof.png`, `output.waveforms`",
        "`waveforms.nc`. All pictures and files are the same bytes for the same scenario, seed and versions.",
        "",
        "## Layers of range.exr",
        "",
        "One part, one float32 channel per layer, rows of φ from the top, columns of Θ from the left. Layers",
        "of whole numbers have their legend in the header, beside the resolved scenario, the seed, the",
        "versions and each layer's unit. Where there is no range, the measured layers are NaN and `status`",
        "says why. With `ranging: tof` the layers without a prefix hold time of flight, with `both`",
        "triangulation.",
        "",
        "| channel | unit | meaning |",
        "|---|---|---|",
    ]
    lines += [f"| `{channel.name}` | {channel.unit} | {_cell(channel.sentence)} |" for channel in CHANNELS]
    lines += ["", "## Status", "", "| code | name | why there is no range |", "|---|---|---|"]
    lines += [f"| {int(code)} | `{code.name}` | {code.sentence} |" for code in Status]
    lines += ["", *_tables()]
    return "\n".join(lines) + "\n"


TABLES: tuple[tuple[str, str, str], ...] = (
    ("budget.csv, budget.json", "scanner_sim.products.budget", "BudgetRow"),
    ("orbit.csv, orbit.json", "scanner_sim.products.timeline", "Timeline"),
)
"""Tables that other verbs write: file, module and type of a row."""


def _tables() -> list[str]:
    lines = ["## Tables of other verbs", ""]
    for name, module, kind in TABLES:
        row = getattr(import_module(module), kind)
        lines += [f"### {name}", "", inspect.cleandoc(row.__doc__ or ""), ""]
    return lines


def materials_page() -> str:
    """The library of materials with numbers and sources."""
    lines = [
        "# Materials",
        "",
        "Reflectances at 1.5 µm, and metals' indices of refraction. `material: NAME` in a scenario, or",
        "numbers of your own, as `material: {reflectance: 0.3}`; see [Surface](scenario.md#surface) and",
        "[Retroreflector](scenario.md#retroreflector).",
        "",
        "| name | kind | reflectance | out of band | n, k | roughness | source |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, item in MATERIALS.items():
        outside = "same" if item.reflectance_out_of_band is None else f"{item.reflectance_out_of_band:g}"
        index = "–" if item.eta is None else f"{item.eta:g}, {item.k:g}"
        rough = "–" if item.alpha is None else f"{item.alpha:g}"
        kind = item.kind.replace("_", " ")
        lines.append(
            f"| `{name}` | {kind} | {item.reflectance:g} | {outside} | {index} | {rough} | {_cell(item.source)} |"
        )
    return "\n".join(lines) + "\n"


def python_page() -> str:
    """The public names, and the types that they give and take."""
    lines = [
        "# From Python",
        "",
        "What `scanner_sim` itself offers is stable: names are only taken away with a new major version.",
        "Everything below comes from the code's own documentation.",
        "",
    ]
    shown = [name for name in scanner_sim.__all__ if not name.startswith("__")]
    for name in sorted(shown, key=str.lower):
        lines += [f"::: {_home(getattr(scanner_sim, name))}", ""]
    lines += ["## What they give", ""]
    for path in RESULTS:
        lines += [f"::: {path}", ""]
    return "\n".join(lines) + "\n"


RESULTS = (
    "scanner_sim.products.image.RangeImage",
    "scanner_sim.products.waveforms.WaveformSet",
    "scanner_sim.pose.result.PoseEstimate",
    "scanner_sim.simulate.simulate_waveforms",
    "scanner_sim.simulate.simulate_voxel",
    "scanner_sim.photo.take_photo",
    "scanner_sim.errors",
)
"""Further names that a user of the public ones meets."""


def _home(thing: Any) -> str:
    return f"{thing.__module__}.{thing.__qualname__}"


PAGES: Mapping[str, Callable[[], str]] = {
    "reference/scenario.md": scenario_page,
    "reference/command_line.md": command_page,
    "reference/files.md": files_page,
    "reference/materials.md": materials_page,
    "reference/python.md": python_page,
}
"""Every generated page by its path in the site."""


def keys_of_scenarios() -> set[str]:
    """Return all keys of all parts: what the page of keys must hold."""
    places = outline()
    return {key for slot in places.values() for key in slot.keys if slot.part is not None} | set(
        Scenario.model_fields
    )


def listed(page: str) -> set[str]:
    """Return the names that stand in the first column of a page's tables."""
    return set(re.findall(r"^\| `([^`]+)`", page, flags=re.MULTILINE))
