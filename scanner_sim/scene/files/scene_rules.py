"""What of a Mitsuba scene in XML counts: checked, and written anew for the renderer.

The renderer sees nothing of the file itself. It gets shapes and materials of known types, with finite numbers and
absolute paths; lights, cameras and media stay out.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import file_beside, noted_files
from scanner_sim.scene.files.scene_xml import Element, only, read_scene, required_attribute

SHAPES = ("sphere", "rectangle", "disk", "cube", "cylinder", "ply", "obj")
BSDFS = (
    "diffuse", "twosided", "conductor", "roughconductor", "blendbsdf", "retroreflector", "plastic", "roughplastic",
    "dielectric", "thindielectric", "roughdielectric", "mask", "null", "principled", "principledthin",
)  # fmt: skip
TEXTURES = ("uniform", "checkerboard")
KNOWN = {"shape": SHAPES, "bsdf": BSDFS, "texture": TEXTURES}
"""Types that are built, by the element that names them."""
LEFT_OUT = ("emitter", "integrator", "sensor", "film", "sampler", "rfilter", "medium", "phase", "volume")
"""Elements that say nothing about where light meets a surface: never built, whatever their type."""
HELD = {"blendbsdf": (2, 2), "twosided": (1, 2), "mask": (1, 1)}
"""Fewest and most materials within those that are made of others; the renderer dies of some that are not there."""
MOST_PARTS = 200
"""Parts of a material, those that it shares counted each time: light is computed for all of them."""
MESHES = {"ply": ".ply", "obj": ".obj"}

_LARGEST = 1e9
_ID = re.compile(r"[\w .:+()/#@=,-]{1,200}")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,99}")
_ATTRIBUTES = {
    "float": ("name", "value"), "integer": ("name", "value"), "boolean": ("name", "value"),
    "string": ("name", "value"), "spectrum": ("name", "value"), "point": ("name", "value", "x", "y", "z"),
    "vector": ("name", "value", "x", "y", "z"), "ref": ("id", "name"), "transform": ("name",),
    "translate": ("value", "x", "y", "z"), "scale": ("value", "x", "y", "z"), "matrix": ("value",),
    "rotate": ("value", "x", "y", "z", "angle"), "lookat": ("origin", "target", "up"),
}  # fmt: skip
_STEPS = ("translate", "rotate", "scale", "matrix", "lookat")
_STRINGS = ("filename", "distribution", "kind", "wrap_mode", "filter_type")
"""Properties that are words; the names of renderers' metals hold for visible light."""

_Range = Callable[[float], bool]
_SHARE: tuple[_Range, str] = (lambda value: 0.0 <= value <= 1.0, "from 0 to 1")
_POSITIVE: tuple[_Range, str] = (lambda value: value > 0.0, "more than 0")
_NOT_NEGATIVE: tuple[_Range, str] = (lambda value: value >= 0.0, "at least 0")
_RANGES = {
    **dict.fromkeys(
        ("reflectance", "diffuse_reflectance", "specular_reflectance", "specular_transmittance", "transmittance",
         "base_color", "color0", "color1", "weight", "opacity", "retro_share", "roughness", "metallic", "anisotropic",
         "spec_trans", "diff_trans", "clearcoat", "clearcoat_gloss", "spec_tint", "sheen", "sheen_tint", "flatness"),
        _SHARE,
    ),
    **dict.fromkeys(("radius", "eta", "int_ior", "ext_ior", "alpha", "alpha_u", "alpha_v", "half_width"), _POSITIVE),
    **dict.fromkeys(("k",), _NOT_NEGATIVE),
}  # fmt: skip


def files_of_scene(path: Path) -> set[Path]:
    """Return the files of an XML scene: those that it includes, and the meshes of its shapes.

    Raises
    ------
    InputError
        If the scene cannot be read, or names files out of its folder.
    """
    with noted_files() as read:
        scene = read_scene(path)
    return {*read, *_meshes(scene, path.parent.resolve())}


def _meshes(element: Element, folder: Path) -> Iterator[Path]:
    """Yield the files of the meshes within an element."""
    for inner in element.inside:
        if inner.tag in LEFT_OUT:
            continue
        if element.tag == "shape" and inner.tag == "string" and inner.attributes.get("name") == "filename":
            yield file_beside(inner.attributes.get("value", ""), folder)
        yield from _meshes(inner, folder)


def renderers_scene(path: Path) -> str:
    """Return what counts of an XML scene, checked, as XML for the renderer; meshes by absolute paths.

    Raises
    ------
    InputError
        At the first thing that is not known, not possible, or leads out of the scene's folder.
    """
    scene = read_scene(path)
    only(scene, "version")
    version = required_attribute(scene, "version")
    if not re.fullmatch(r"[0-9]{1,4}(\.[0-9]{1,4}){2}", version):
        scene.fault(f"{version[:80]!r} is no version.", 'Write version="3.0.0".')
    kept = [element for element in scene.inside if element.tag not in LEFT_OUT]
    names, folder = _Names(scene.inside), path.parent.resolve()
    for element in kept:
        if element.tag not in (*KNOWN, "alias"):
            _refuse_unknown(element, (*KNOWN, *LEFT_OUT))
        if element.tag != "alias":
            _check(element, folder, names)
    names.refuse_endless(kept)
    inside = "\n".join(_as_xml(element) for element in kept if element.tag != "alias")
    return f"<scene version={quoteattr(version)}>\n{inside}\n</scene>\n"


class _Names:
    """What the ids of a scene stand for."""

    def __init__(self, elements: list[Element]) -> None:
        self._meant: dict[str, Element] = {}
        for element in _all(elements):
            if element.tag == "alias":
                only(element, "id", "as")
                name, meant = required_attribute(element, "as"), required_attribute(element, "id")
                self._put(element, name, self.of(element, meant))
            elif "id" in element.attributes and element.tag != "ref":
                self._put(element, element.attributes["id"], element)

    def _put(self, where: Element, name: str, meant: Element) -> None:
        if not _ID.fullmatch(name):
            where.fault(
                f"{name[:80]!r} cannot be an id.",
                "Write letters, digits, spaces and . : + ( ) / # @ = , - _ only.",
            )
        if name in self._meant:
            where.fault(f"the id {name!r} is given twice.", "Give each thing an id of its own.")
        self._meant[name] = meant

    def of(self, where: Element, name: str) -> Element:
        """Return what an id stands for."""
        if name not in self._meant:
            near = difflib.get_close_matches(name, self._meant, n=1)
            hint = (
                f"Did you mean {near[0]!r}?" if near else "Give the id of a material that stands before it."
            )
            where.fault(f"nothing has the id {name[:80]!r}.", hint)
        return self._meant[name]

    def refuse_endless(self, elements: list[Element]) -> None:
        """Find materials that hold themselves, or so many parts that light could not be computed."""
        sizes: dict[int, int] = {}
        for element in _all(elements):
            if element.tag in ("bsdf", "texture"):
                self._size(element, sizes, ())

    def _size(self, element: Element, sizes: dict[int, int], holders: tuple[int, ...]) -> int:
        if id(element) in holders or len(holders) > MOST_PARTS:
            element.fault("a material holds itself.", "Let it refer to another one.")
        if id(element) not in sizes:
            parts = (
                self.of(part, part.attributes["id"]) if part.tag == "ref" else part
                for part in element.inside
                if part.tag in ("bsdf", "texture", "ref")
            )
            size = 1 + sum(self._size(part, sizes, (*holders, id(element))) for part in parts)
            if size > MOST_PARTS:
                element.fault(f"a material has more than {MOST_PARTS} parts.")
            sizes[id(element)] = size
        return sizes[id(element)]


def _all(elements: list[Element]) -> Iterator[Element]:
    for element in elements:
        yield element
        yield from _all(element.inside)


def _refuse_unknown(element: Element, known: tuple[str, ...]) -> None:
    if element.tag == "rgb":
        element.fault("a colour belongs to visible light.", "Write <spectrum> with one number at 1.5 µm.")
    near = difflib.get_close_matches(element.tag, known, n=1)
    element.fault(
        f"<{element.tag[:80]}> is not possible here.",
        f"Did you mean <{near[0]}>?" if near else f"Possible: {', '.join(known)}.",
    )


def _check(element: Element, folder: Path, names: _Names) -> None:
    """Find the first fault of a shape, a material or a texture, and put absolute paths into it."""
    kind = required_attribute(element, "type")
    only(element, "type", "id", "name")
    if kind not in KNOWN[element.tag]:
        near = difflib.get_close_matches(kind, KNOWN[element.tag], n=1)
        element.fault(
            f"there is no {element.tag} of type {kind[:80]!r} here.",
            f"Did you mean {near[0]!r}?" if near else f"Possible: {', '.join(KNOWN[element.tag])}.",
        )
    if "name" in element.attributes and not _NAME.fullmatch(element.attributes["name"]):
        element.fault(f"{element.attributes['name'][:80]!r} is no name.")
    element.inside = [part for part in element.inside if not _left_out(part, names)]
    for part in element.inside:
        if part.tag in KNOWN and part.tag != "shape":
            _check(part, folder, names)
        elif part.tag in _ATTRIBUTES and part.tag not in _STEPS:
            _check_value(part)
        else:
            _refuse_unknown(part, ("bsdf", "texture", *_ATTRIBUTES))
    if element.tag == "shape":
        _name_mesh(element, kind, folder)
    elif kind in HELD:
        _check_held(element, kind, names)


def _check_held(element: Element, kind: str, names: _Names) -> None:
    """Find a material that lacks the materials it is made of, or has too many, and a blend without its weight."""
    held = [names.of(part, part.attributes["id"]) if part.tag == "ref" else part for part in element.inside]
    count, (fewest, most) = sum(part.tag == "bsdf" for part in held), HELD[kind]
    if not fewest <= count <= most:
        wanted = str(fewest) if fewest == most else f"{fewest} or {most}"
        element.fault(f"a material of type {kind!r} is made of {wanted} others, and {count} stand in it.")
    if kind == "blendbsdf" and not any(part.attributes.get("name") == "weight" for part in element.inside):
        element.fault("a blend lacks its weight.", 'Write <float name="weight" value="0.5"/>.')


def _left_out(part: Element, names: _Names) -> bool:
    """Return whether a part of a shape is a light or a medium, or refers to one; and write ids for aliases."""
    if part.tag != "ref":
        return part.tag in LEFT_OUT
    meant = names.of(part, required_attribute(part, "id"))
    if meant.tag == "shape":
        part.fault("it refers to a shape.", "Refer to a material.")
    part.attributes["id"] = meant.attributes["id"]
    return meant.tag in LEFT_OUT


def _check_value(part: Element) -> None:
    """Find the fault of a property: a name or a number that is not possible."""
    only(part, *_ATTRIBUTES[part.tag])
    name = part.attributes.get("name", "")
    if not _NAME.fullmatch(name) and (name or part.tag != "ref"):
        part.fault(f"<{part.tag}> lacks a name that is possible.")
    match part.tag:
        case "transform":
            for step in part.inside:
                _check_step(step)
            return
        case "string":
            value = required_attribute(part, "value")
            # A conductor of the material "none" is a perfect mirror.
            mirror = name == "material" and value == "none"
            if not mirror and (name not in _STRINGS or not value.isprintable()):
                part.fault(f"{name!r} cannot be the word {value[:80]!r}.", "Give numbers at 1.5 µm.")
        case "boolean":
            if part.attributes.get("value") not in ("true", "false"):
                part.fault(f"{name!r} is neither true nor false.")
        case "float" | "integer" | "spectrum":
            (value_of,) = numbers(part, required_attribute(part, "value"), 1)
            if part.tag == "integer" and value_of != int(value_of):
                part.fault(f"{name!r} is not a whole number.")
            possible, words = _RANGES.get(name, (lambda _: True, ""))
            if not possible(value_of):
                part.fault(f"{name!r} is {value_of:g}; it must be {words}.")
        case "point" | "vector":
            _check_coordinates(part)
    if part.inside:
        part.inside[0].fault(f"<{part.inside[0].tag[:80]}> is not possible within <{part.tag}>.")


def _check_step(step: Element) -> None:
    """Find the fault of a step of a transform."""
    if step.tag not in _STEPS:
        step.fault(
            f"<{step.tag[:80]}> is not possible in a transform.",
            "Possible: translate, rotate, scale, matrix, lookat.",
        )
    only(step, *_ATTRIBUTES[step.tag])
    match step.tag:
        case "matrix":
            numbers(step, required_attribute(step, "value"), 9, 16)
        case "lookat":
            for name in ("origin", "target", "up"):
                numbers(step, required_attribute(step, name), 3)
        case _:
            _check_coordinates(step)
            if step.tag == "rotate":
                numbers(step, required_attribute(step, "angle"), 1)


def _check_coordinates(part: Element) -> None:
    given = [name for name in ("value", "x", "y", "z") if name in part.attributes]
    if not given or ("value" in given and len(given) > 1):
        part.fault(f"<{part.tag}> has either a value or x, y and z.")
    for name in given:
        numbers(part, part.attributes[name], *((1, 3) if name == "value" else (1,)))


def numbers(where: Element, text: str, *counts: int) -> list[float]:
    """Return numbers that stand in a text, separated by spaces or commas; all finite and of sensible size."""
    words = text.replace(",", " ").split()
    try:
        found = [float(word) for word in words if "_" not in word]
    except ValueError:
        found = []
    if len(found) != len(words) or len(found) not in counts:
        wanted = " or ".join(map(str, counts))
        where.fault(f"{text[:80]!r} is not {wanted} number{'s' if counts != (1,) else ''}.")
    if not all(math.isfinite(value) and abs(value) <= _LARGEST for value in found):
        where.fault(f"{text[:80]!r} is not finite, or beyond {_LARGEST:g}.")
    return found


def _name_mesh(shape: Element, kind: str, folder: Path) -> None:
    """Make the name of a shape's file absolute; shapes of closed form have none."""
    named = [part for part in shape.inside if part.tag == "string" and part.attributes["name"] == "filename"]
    if (kind in MESHES) != (len(named) == 1):
        shape.fault(f"a shape of type {kind!r} has {'one' if kind in MESHES else 'no'} filename.")
    for part in named:
        name = part.attributes["value"]
        if not name.lower().endswith(MESHES[kind]):
            part.fault(
                f"{name[:80]!r} is no file for the type {kind!r}.",
                f"Name a file that ends with {MESHES[kind]}.",
            )
        try:
            part.attributes["value"] = str(file_beside(name, folder))
        except InputError as error:
            part.fault(error.message, error.remedy)


def _as_xml(element: Element) -> str:
    attributes = "".join(f" {name}={quoteattr(value)}" for name, value in element.attributes.items())
    inside = "".join(map(_as_xml, element.inside))
    return f"<{element.tag}{attributes}>{inside}</{element.tag}>"
