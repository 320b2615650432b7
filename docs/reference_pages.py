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
from scanner_sim.config.preset import MARKS, read_preset, shipped_presets
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.channels import CHANNELS, DERIVATIVES
from scanner_sim.foundation.status import Status
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.lines import LineSet
from scanner_sim.products.shots import AIMED
from scanner_sim.products.track import track_columns, voxel_columns
from scanner_sim.products.waveforms import WaveformSet
from scanner_sim.ranging.axes import Axes
from scanner_sim.scene.materials import MATERIALS
from scanner_sim.scene.visible import VISIBLE
from scanner_sim.tracking.record import Track, TrackStatus

PAGE = {"view.html": "by `view`: the result as one page, to turn and to look into"}

CONVERTED = {
    "points.laz": "with `output.formats`, as the five below, or by `convert`: points as LAS 1.4, compressed",
    "points.las": "the same, not compressed",
    "points.e57": "all shots as E57, structured where there are rows",
    "points.pcd": "all shots as PCD, organised where there are rows",
    "points_ascii.pcd": "the same as text",
    "metadata.yaml": "with points.mcap: makes the folder a bag of ROS 2",
    "points.mcap": "messages of that bag: the cloud, and targets and poses of a track",
}
"""What a result holds for other programs."""

FOLDERS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "run, of a raster": (
        "RUN",
        {
            "range.exr": "every layer below, float32, with scenario, versions, units and legends in its header",
            "scenario.yaml": "the scenario with every default written out; running it gives the same bytes",
            "summary.json": "counts, quantiles and, apart, the distance from the truth",
            **{picture.file: picture.meaning for channel in CHANNELS for picture in channel.pictures},
            "believed.yaml": "with `processing.calibration`: the calibration that was believed, with its covariance",
            "points.ply": "the points with intensity and σ, binary little-endian PLY",
            "camera.png": "under the Sun: what an ordinary video camera at the scanner sees",
            **CONVERTED,
            **PAGE,
            "lines.parquet": "lines of the voxels under `output.lines`, and the light before noise; columns below",
            "waveforms.parquet": "the same of the waveforms under `output.waveforms`",
        },
    ),
    "reprocess, of some voxels; of all as run": (
        "SIGNALS",
        {
            "scenario.yaml": "the scenario with every default written out; running it gives the same bytes",
            "lines.parquet": "lines with other noise; columns below",
            "waveforms.parquet": "waveforms with other noise; columns below",
        },
    ),
    "run, of a scan without rows": (
        "SHOTS",
        {
            "shots.parquet": "a line for each shot: columns below, then every layer of an image; scenario, units and "
            "legends in the file's metadata",
            "shots.csv": "the same columns as text",
            "believed.yaml": "as of a raster",
            "scenario.yaml": "the scenario with every default written out",
            "summary.json": "counts, quantiles and, apart, the distance from the truth",
            "range.png": "dots at the angles of the shots, in the colours of their ranges",
            "status.png": "the same in the colours of their status",
            "points.ply": "the points with intensity, σ and number of the shot, binary little-endian PLY",
            "camera.png": "under the Sun: what an ordinary video camera at the scanner sees",
            **CONVERTED,
            **PAGE,
        },
    ),
    "run, of a track": (
        "TRACK",
        {
            "track.csv": "a line for each visit to a target; columns below",
            "track.parquet": "the same, with scenario and legends in the file's metadata",
            "patterns.parquet": "every voxel of every pattern; `output.patterns: false` leaves it out",
            "scenario.yaml": "the scenario with every default written out",
            "summary.json": "counts of status, errors and σ of each target",
            "pose.csv": "poses of objects with three followed targets or more, by each method of `pose.methods`",
            "pose.parquet": "the same, with scenario and legends",
            "relative_pose.csv": "the same of one object seen from another, where there are two",
            "relative_pose.parquet": "the same, with scenario and legends",
            "pattern.png": "a pattern over its target; `show DIR --pattern N` draws any other",
            "track.png": "errors of the targets over time with ±2σ, and the tracker's state",
            "field.png": "all targets in the field of view",
            "pose.png": "errors of the poses over time with ±2σ",
            "outline.png": "the objects at true and at estimated pose, displacement enlarged",
            "frames.json": "with `output.frames: true`: the video camera as believed, also in OpenCV's words, and for "
            "each frame_00000.png, PNG of 16 bits, its times, exposure and poses",
            "dots.csv": "centres of the dots in each frame, with covariance and status",
            "frames.png": "the frame with most dots, and the ellipses that were fitted to them",
            **CONVERTED,
            **PAGE,
        },
    ),
    "orbit": (
        "ORBIT",
        {
            "orbit.json": "shares of time in each condition of Table 1, for each target",
            "orbit.csv": "a line for each moment and target",
            "orbit.png": "timeline of conditions, light and charge",
            "scenario.yaml": "the scenario with every default written out",
        },
    ),
    "budget": (
        "BUDGET",
        {
            "budget.json": "all rows, reflectance, versions; with `--image` shares of voxels, and their way of ranging",
            "budget.csv": "a line for each source and range; columns below",
            "budget.png": "σ of the range against range, source by source",
            "budget_tof.png": "the same for time of flight",
            "curves.png": "σ of both ways of ranging and of their fusion, as in Figure 12",
            "dominance.png": "with `--image`: the source that makes most of σ in each voxel",
            "scenario.yaml": "the scenario with every default written out",
        },
    ),
    "pose-study": (
        "POSE_STUDY",
        {
            "pose_study.json": "all tables",
            "pose_study.csv": "error of each component of each array's pose, by method and range",
            "exponents.csv": "exponents of range, size and number of targets",
            "gains.csv": "by how much other methods are better than points alone",
            "targets.csv": "errors of single targets, from simulated pixels",
            "figure_15.png": "errors against range, a panel for each component",
            "arrays.png": "arrays compared at one range",
            "scenario.yaml": "the scenario with every default written out",
        },
    ),
    "compare": (
        "COMPARISON",
        {
            "compare.json": "every law with its checks, verdict and power; what `--baseline` reads",
            "compare.html": "the same as a page with pictures, in one file",
            "compare.png": "deviations of all checks with their intervals",
            "scenario.yaml": "the scenario with every default written out",
        },
    ),
    "difference": (
        "DIFFERENCE",
        {
            "difference.json": "numbers of each range that both results have, changes of status, keys that differ",
            "difference.png": "difference over σ of both as a map, and its histogram with the normal curve",
        },
    ),
}
"""For each verb that writes a folder: where the names of its files stand, and what each holds."""


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
        "JSON schema by which editors complete keys. The defaults of the scanner are those of `nrc_2000`, whose",
        "sources stand under [Instruments](instruments.md).",
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
    for name, command in _commands(group):
        lines += [
            f"## scanner-sim {name} {{#{name.replace(' ', '-')}}}",
            "",
            inspect.cleandoc(command.help or ""),
            "",
        ]
        rows = [row for row in map(_option, command.params) if row]
        if rows:
            lines += ["| option | default | meaning |", "|---|---|---|", *rows, ""]
    return "\n".join(lines) + "\n"


def _commands(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each verb with its name; a family's by the names of both."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _commands(command, f"{before}{name} ")
        else:
            yield before + name, command


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
    """The folders that verbs write, the layers of range.exr, the codes of status, and columns of tables."""
    lines = ["# Files and channels", ""]
    for verb, (_, files) in FOLDERS.items():
        lines += [f"## scanner-sim {verb}", "", "| file | holds |", "|---|---|"]
        lines += [f"| `{name}` | {sentence} |" for name, sentence in files.items()]
        lines.append("")
    lines += [
        "A folder appears whole or not at all. Pictures and files are the same bytes for the same scenario, seed and",
        "versions.",
        "",
        "## Layers of range.exr",
        "",
        "One part, one float32 channel per layer, rows of φ from the top, columns of Θ from the left. Layers of",
        "whole numbers have their legend in the header. Where there is no range, the measured layers are NaN and",
        "`status` says why. With `ranging: tof` the layers without a prefix hold time of flight, with `both`",
        "triangulation. Normals and incidence are there where `output.truth` asks for them.",
        "",
        "| channel | unit | meaning |",
        "|---|---|---|",
    ]
    lines += [f"| `{channel.name}` | {channel.unit} | {_cell(channel.meaning)} |" for channel in CHANNELS]
    lines += [
        "",
        "### Derivatives",
        "",
        "With `output.jacobian: true`, for each parameter whose calibration has an error. Names end in what moves with",
        "the parameter: `.X`, `.Y`, `.Z` of the point, `.R` of the range. Those of other ways of ranging begin with",
        "`tof.` and `fused.`. The parameter is the *believed* one: an instrument that is built so, and does not know",
        "it, errs by the negative.",
        "",
        "| channels | unit | by |",
        "|---|---|---|",
    ]
    lines += [
        f"| `{channel.name.removesuffix('X')}…` | {channel.unit} | {_cell(channel.meaning.partition(': ')[2])} |"
        for channel in DERIVATIVES
        if not channel.prefix and channel.name.endswith(".X")
    ]
    lines += ["", "## First columns of shots.parquet", "", "| column | unit | meaning |", "|---|---|---|"]
    lines += [f"| `{column.name}` | {column.unit} | {_cell(column.meaning)} |" for column in AIMED]
    for kind in (LineSet, WaveformSet):
        name = "lines" if kind is LineSet else "waveforms"
        lines += [
            "",
            f"## Columns of {name}.parquet",
            "",
            "| column | unit | each row | meaning |",
            "|---|---|---|---|",
        ]
        each = {
            "one": "a number",
            "samples": f"one for each {kind.SAMPLE}",
            "vector": "x, y, z",
            "clusters": "one for each cluster",
        }
        lines += [
            f"| `{column.name}` | {column.unit} | {each[column.form]} | {_cell(column.meaning)} |"
            for column in kind.COLUMNS
        ]
    lines += ["", "## Status", "", "| code | name | why there is no range |", "|---|---|---|"]
    lines += [f"| {int(code)} | `{code.name}` | {code.sentence} |" for code in Status]
    lines += ["", "## Status of visits and poses", "", "| code | name | meaning |", "|---|---|---|"]
    lines += [f"| {int(code)} | `{code.name}` | {code.sentence} |" for code in TrackStatus]
    lines += [f"| {int(code)} | `{code.name}` of a pose | {code.sentence} |" for code in PoseStatus]
    empty = Track((), (), 0, "", "", Axes(0.0))
    for name, columns in (("track.csv", track_columns(empty)), ("patterns.parquet", voxel_columns(empty))):
        lines += ["", f"## Columns of {name}", "", ", ".join(f"`{column}`" for column in columns) + ".", ""]
        lines.append(
            _plain(_first_part((track_columns if name == "track.csv" else voxel_columns).__doc__ or ""))
        )
    for name, module, kind in TABLES:
        lines += ["", f"## Columns of {name}", "", *_columns(getattr(import_module(module), kind))]
    return "\n".join(lines) + "\n"


TABLES: tuple[tuple[str, str, str], ...] = (
    ("budget.csv", "scanner_sim.products.budget", "BudgetRow"),
    ("pose_study.csv", "scanner_sim.products.pose_study", "PoseRow"),
    ("exponents.csv", "scanner_sim.products.pose_study", "Exponent"),
    ("targets.csv", "scanner_sim.products.pose_study", "TargetRow"),
)
"""Tables of which each line is an object: file, module and type."""


def _columns(row: type) -> list[str]:
    """Return the attributes of a documented type as a table."""
    text = inspect.cleandoc(row.__doc__ or "")
    first, _, listed_ = text.partition("Attributes\n----------\n")
    lines = [_cell(first), "", "| column | meaning |", "|---|---|"]
    for names, meaning in re.findall(r"^(\S[^\n]*)\n((?:[ \t]+[^\n]*\n?)+)", listed_, re.MULTILINE):
        shown = ", ".join(f"`{name.strip()}`" for name in names.split(","))
        lines.append(f"| {shown} | {_plain(meaning)} |")
    return lines


def _first_part(docstring: str) -> str:
    """Return a docstring up to its first section."""
    return inspect.cleandoc(docstring).partition("\n\nParameters")[0]


def _plain(text: str) -> str:
    """Return a piece of a docstring without reStructuredText's marks."""
    return _cell(re.sub(r":\w+:`~?([^`]*)`", r"`\1`", text).replace("``", "`"))


def materials_page() -> str:
    """The library of materials with numbers and sources."""
    lines = [
        "# Materials",
        "",
        "Reflectances at 1.5 µm, and metals' indices of refraction. `material: NAME` in a scenario, or",
        "numbers of your own, as `material: {reflectance: 0.3}`; see [Surface](scenario.md#surface) and",
        "[Retroreflector](scenario.md#retroreflector). What the video camera sees of them stands below.",
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
    lines += [
        "",
        "## In visible light",
        "",
        "For the video camera, at 550 nm or as a mean from 400 to 700 nm.",
        "",
        "| name | reflectance | n, k | source |",
        "|---|---|---|---|",
    ]
    for name, seen in VISIBLE.items():
        index = "–" if seen.eta is None else f"{seen.eta:g}, {seen.k:g}"
        lines.append(f"| `{name}` | {seen.reflectance:g} | {index} | {_cell(seen.source)} |")
    return "\n".join(lines) + "\n"


def instruments_page() -> str:
    """The shipped instruments: each value with its mark and its source."""
    lines = [
        "# Instruments",
        "",
        "`scanner: {preset: NAME}` in a scenario takes one of these; without it, it is `nrc_2000`. What the scenario",
        "says itself goes before. For an instrument of your own, save what `scanner-sim instruments nrc_2000 --yaml`",
        "prints, change it, and give that file in the place of NAME. It needs every value, each with mark and source,",
        "or `extends: NAME_OR_FILE` and those that are unlike the instrument that it extends.",
        "",
        "| mark | the value is |",
        "|---|---|",
        *(f"| {mark} | {meaning} |" for mark, meaning in MARKS.items()),
        "",
    ]
    for name in shipped_presets():
        preset = read_preset(name)
        lines += [f"## {name}", "", preset.about, "", "| key | value | mark | source |", "|---|---|---|---|"]
        for location, stated in preset.stated.items():
            key = ".".join(map(str, location[1:]))
            lines.append(f"| `{key}` | {_yaml(stated.value)} | {stated.mark} | {_cell(stated.source)} |")
        lines.append("")
    return "\n".join(lines) + "\n"


def python_page() -> str:
    """The public names: functions, and the types that they give and take."""
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
    return "\n".join(lines) + "\n"


def _home(thing: Any) -> str:
    return f"{thing.__module__}.{thing.__qualname__}"


PAGES: Mapping[str, Callable[[], str]] = {
    "reference/scenario.md": scenario_page,
    "reference/command_line.md": command_page,
    "reference/files.md": files_page,
    "reference/materials.md": materials_page,
    "reference/instruments.md": instruments_page,
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
