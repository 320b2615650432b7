"""Mutations of meshes and of scenes in XML that know their form.

``mutants(seed)`` yields without end a name and a function that writes the mutant into an empty folder and returns the
path of the scenario there. The name is the address ``KIND/SEED/NUMBER``; ``mutant(address)`` makes the same one again.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from mutate_gltf import gltf, orbit

Writer = Callable[[Path], Path]
Bytes = Callable[[random.Random], bytes]

SCENARIO = """\
schema: 1
scanner: {preset: nrc_2000}
scene:
  objects:
    - {name: part, %s, position: [0 m, 0 m, 5 m]}
scan: {type: raster, rows: 4, columns: 4, horizontal: [-1 deg, 1 deg], vertical: [-1 deg, 1 deg]}
output: {pictures: false}
"""
VERTICES = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.1), (-1.0, 1.0, 0.1), (0.0, 0.0, -0.5)]
FACES = [(0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)]
NUMBERS = (
    "nan", "inf", "-inf", "0", "-0", "1e39", "-1e39", "1e300", "1e999", "1e-45", "-1", "0.5", "3", "1e5", "1e8",
    "2e-7", "", "x", "1_0", "0x10", "1e", "٣", "1,5", "1 2 3", "1 2", "9" * 400, "$r", "\\$r", "%s", "\x00"[:0],
    "1f", "+1", ".5.",
)  # fmt: skip
INDICES = (-1, -2, 4, 5, 6, 255, 256, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**63, 0, 1, 10**30)
TYPES = (
    "char", "uchar", "short", "ushort", "int", "uint", "float", "double", "int8", "uint8", "int16", "float32",
    "float64", "long", "half", "list", "string", "", "float128",
)  # fmt: skip
FORMS = ("ascii", "binary_little_endian", "binary_big_endian")
FORMATS = {
    "char": "b",
    "uchar": "B",
    "short": "h",
    "ushort": "H",
    "int": "i",
    "uint": "I",
    "float": "f",
    "double": "d",
}


def mutants(seed: int) -> Iterator[tuple[str, Writer]]:
    """Yield mutants without end, meshes and XML scenes in turn."""
    for number in count():
        for kind in WRITERS:
            address = f"{kind}/{seed}/{number}"
            yield address, mutant(address)


def mutant(address: str) -> Writer:
    """Return the mutant of an address."""
    kind = address.split("/")[0]

    def write(folder: Path) -> Path:
        return WRITERS[kind](random.Random(address), folder)

    return write


class Unchanging(random.Random):
    """Draws by which nothing is changed: what is rare never happens, and of several things the first is taken."""

    def __init__(self, share: float) -> None:
        super().__init__(0)
        self._share = share

    def random(self) -> float:
        """Return the same number each time."""
        return self._share

    def choice(self, options: Any) -> Any:
        """Return the first."""
        return options[0]


def sound_scenes(folder: Path) -> Iterator[Path]:
    """Yield what mutants are made from: scenarios with a mesh of each form, and with each XML scene, unchanged."""
    text, binary = Unchanging(0.6), Unchanging(0.35)
    meshes = [(f"{form}.ply", ply(text, sound=form)) for form in FORMS]
    meshes += [("part.obj", obj(text)), ("text.stl", stl(text)), ("binary.stl", stl(binary))]
    meshes += [
        (f"part.{suffix}", content) for suffix, content in (gltf(Unchanging(share)) for share in (0.3, 0.6))
    ]
    for name, content in meshes:
        home = folder / name.replace(".", "_")
        home.mkdir()
        (home / name).write_bytes(content)
        yield _scenario(home, f"mesh: {name}, material: z93_white")
    for number in range(8):
        home = folder / f"xml_{number}"
        home.mkdir()
        _beside_xml(home)
        (home / "scene.xml").write_text(_spelt(_base(random.Random(number))))
        yield _scenario(home, "file: scene.xml")


def _mesh(rng: random.Random, folder: Path) -> Path:
    """Write a mutant of a mesh: PLY and glTF oftener than the others, which have less to go wrong."""
    suffix, content = rng.choice(
        [("ply", ply), ("ply", ply), ("obj", obj), ("stl", stl), *[("gltf", gltf)] * 3]
    )
    if suffix == "gltf":
        suffix, made = gltf(rng)
    else:
        made = content(rng)
    name, material = f"part.{suffix}", rng.choice(MATERIALS)
    (folder / name).write_bytes(spoilt(rng, made))
    (folder / "part.mtl").write_bytes(spoilt(rng, b"newmtl panel\nKd 0.5 0.5 0.5\nmap_Kd part.png\n"))
    if rng.random() < 0.2:
        (folder / "part.oem").write_bytes(spoilt(rng, orbit(rng)))
        material += ", motion: {type: ccsds, orbit: part.oem}"
    return _scenario(folder, f"mesh: {name}, {material}")


MATERIALS = (
    "material: z93_white",
    'materials: {"*a*": z93_white, default: {reflectance: 0.5}}',
    "materials: {panel: z93_white}",
    "material: {type: file_colours, scale: 0.5}",
    "material: z93_white, label_parts: true",
)


def _xml(rng: random.Random, folder: Path) -> Path:
    """Write a mutant of an XML scene, with the files that it names."""
    _beside_xml(folder)
    content = xml(rng).encode("utf-8", "surrogatepass")
    if rng.random() < 0.1:
        content = b'<?xml version="1.0" encoding="' + rng.choice(ENCODINGS) + b'"?>' + content
    (folder / "scene.xml").write_bytes(spoilt(rng, content, rarely=True))
    if rng.random() < 0.3:
        text = (
            SCENARIO.replace("scene:\n", "scene:\n  file: scene.xml\n")
            % "shape: sphere, diameter: 1 m, material: nickel"
        )
        (folder / "scenario.yaml").write_text(text)
        return folder / "scenario.yaml"
    return _scenario(folder, "file: scene.xml")


def _beside_xml(folder: Path) -> None:
    """Write the files that an XML scene names."""
    (folder / "meshes").mkdir()
    (folder / "meshes" / "part.ply").write_bytes(ply(random.Random(0), sound=FORMS[1]))
    (folder / "more.xml").write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    (folder / "itself.xml").write_text('<scene version="3.0.0"><include filename="itself.xml"/></scene>')
    (folder / "plugins").mkdir()
    (folder / "plugins" / "evil.so").write_bytes(b"no library")


WRITERS: dict[str, Callable[[random.Random, Path], Path]] = {"mesh": _mesh, "xml": _xml}


def _scenario(folder: Path, what: str) -> Path:
    path = folder / "scenario.yaml"
    path.write_text(SCENARIO % what)
    return path


def spoilt(rng: random.Random, content: bytes, *, rarely: bool = False) -> bytes:
    """Return a file with bytes lost, doubled or changed; most often as it is."""
    if rng.random() < (0.9 if rarely else 0.7) or not content:
        return content
    at, length = rng.randrange(len(content)), rng.choice((1, 1, 2, 7, 100))
    match rng.randrange(6):
        case 0:
            return content[:at]
        case 1:
            return content[:at] + content[at + length :]
        case 2:
            return content[:at] + content[at : at + length] * 2 + content[at + length :]
        case 3:
            return content[:at] + rng.randbytes(length) + content[at + length :]
        case 4:
            return content + rng.randbytes(length)
    return content.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b" ", b"\x00")))


def ply(rng: random.Random, *, sound: str = "") -> bytes:
    """Return a PLY file whose parts are each wrong with a small chance; ``sound`` is the form of one that is right."""
    wrong = (lambda share: False) if sound else (lambda share: rng.random() < share)
    form = sound or rng.choice(FORMS)
    kinds = [rng.choice(["float", "double"]) if wrong(0.2) else "float" for _ in range(3)]
    if wrong(0.1):
        kinds[rng.randrange(3)] = rng.choice(TYPES)
    columns = list(zip("xyz", kinds, strict=True))
    if wrong(0.2):
        columns += [(name, "float") for name in ("nx", "ny", "nz")]
    if wrong(0.1):
        columns += [(rng.choice(["u", "x", "red", "é", "q" * 300]), rng.choice(TYPES))]
    if wrong(0.05):
        rng.shuffle(columns)
    vertices = [
        tuple(rng.uniform(-1, 1) if k > 2 else vertex[k] for k in range(len(columns))) for vertex in VERTICES
    ]
    if wrong(0.15):
        value = rng.choice([float("nan"), float("inf"), 1e30, -1e300, 1e-45])
        vertices[rng.randrange(5)] = (value,) * len(columns)
    if wrong(0.05):
        vertices = [vertices[0]] * 5
    faces: list[tuple[int, ...]] = list(FACES)
    for _ in range(3 if wrong(0.3) else 0):
        face = list(rng.choice(faces) or (0, 1, 2))
        face[rng.randrange(len(face))] = rng.choice(INDICES)
        faces[rng.randrange(4)] = tuple(face)
    if wrong(0.2):
        faces[rng.randrange(4)] = tuple(rng.randrange(5) for _ in range(rng.choice((0, 1, 2, 4, 6, 300))))
    if wrong(0.05):
        faces = []
    length_kind, index_kind = ("uchar", "int")
    if wrong(0.2):
        length_kind, index_kind = rng.choice(TYPES), rng.choice(TYPES)
    elements = [_element(form, "vertex", columns, vertices)]
    listed = [("vertex_indices", f"list {length_kind} {index_kind}")]
    if wrong(0.1):
        listed = [(rng.choice(["vertex_index", "corner"]), listed[0][1])]
    rows: list[tuple[object, ...]] = [(face,) for face in faces]
    if wrong(0.1):
        listed.append(("flags", "uchar"))
        rows = [(*row, 1) for row in rows]
    if wrong(0.05):
        listed.append(("extra", "list uchar float"))
        rows = [(*row, (0.5,) * rng.choice((1, 2, 2))) for row in rows]
    elements.append(_element(form, "face", listed, rows))
    if wrong(0.1):
        edges = [((0, 1),), ((1, 2, 3),)]
        elements.insert(rng.randrange(3), _element(form, "edge", [("ends", "list uchar int")], edges))
    if wrong(0.05):
        elements.append(rng.choice(elements))
    if wrong(0.05):
        elements.reverse()
    head = ["ply", f"format {form} 1.0", "comment made for a test"]
    if wrong(0.05):
        head[2] = "comment \xe9\xff " * rng.choice((1, 5000))
    if wrong(0.05):
        head[1] = rng.choice(["format ascii 2.0", "format", "format binary 1.0", head[0], ""])
    text = "\n".join([*head, *(line for line, _ in elements)])
    if wrong(0.2):
        old = rng.choice(["vertex 5", "face 4"])
        said = rng.choice((0, 1, 3, 6, 10**9, 2**31, 2**32, 2**63, 10**30, -1, "5.0", "x"))
        text = text.replace(old, f"{old.split()[0]} {said}")
    end = rng.choice(["", "end_header", "end_header\r\n", "END_HEADER\n"]) if wrong(0.05) else "end_header\n"
    return f"{text}\n{end}".encode("latin-1", "replace") + b"".join(data for _, data in elements)


def _element(
    form: str,
    name: str,
    columns: list[tuple[str, str]],
    values: list[tuple[object, ...]],
) -> tuple[str, bytes]:
    """Return header and data of an element; what a type cannot hold is cut down to it."""
    header = [f"element {name} {len(values)}", *(f"property {kind} {column}" for column, kind in columns)]
    data = []
    for row in values:
        for value, (_, kind) in zip(row, columns, strict=False):
            if kind.startswith("list "):
                _, length, entry = (kind + " ").split(" ")[:3]
                assert isinstance(value, tuple)
                data += [_packed(form, length, len(value)), *(_packed(form, entry, one) for one in value)]
            else:
                data.append(_packed(form, kind, value))
        if form == "ascii":
            data.append(b"\n")
    return "\n".join(header), b"".join(data)


def _packed(form: str, kind: str, value: object) -> bytes:
    if form == "ascii":
        return f"{value} ".encode()
    letter = FORMATS.get(kind, "f")
    order = "<" if "little" in form else ">"
    number = float(value)  # type: ignore[arg-type]
    try:
        return struct.pack(order + letter, number if letter in "fd" else int(number))
    except (OverflowError, ValueError, struct.error):
        size = struct.calcsize(letter)
        return (int(number) % 256**size).to_bytes(size, "little") if abs(number) < 1e40 else b"\xff" * size


def obj(rng: random.Random) -> bytes:
    """Return an OBJ file with lines changed, lost, doubled and put in."""
    lines = [f"v {x} {y} {z}" for x, y, z in VERTICES] + ["vt 0 0", "vt 1 1", "vn 0 0 -1"]
    corner = rng.choice(["{}", "{}/1", "{}//1", "{}/2/1", "{}/1/", "{}/"])
    lines += ["f " + " ".join(corner.format(index + 1) for index in face) for face in FACES]
    extra = [
        "mtllib /dev/zero", "mtllib part.mtl", "usemtl panel",
        "usemtl é", "o \xff", "g a b", "s off", "f", "f 1", "f 1 2", "f 1 2 3 4 5", "f -1 -2 -3",
        "f 1/1/1/1 2 3", "v", "v 1", "v 1 2 3 4", "v nan 0 0", "v 1e39 0 0", "vn 0 0 0", "vn nan 0 0", "vt", "vt 1",
        "vt inf 0", "l 1 2", "p 1", "# " + "x" * 3000, "call /etc/passwd", "\\", "f 1 2 \\", "curv 0 1 2",
    ]  # fmt: skip
    extra += [f"f 1 2 {index}" for index in INDICES] + [f"f 1/{index} 2/1 3/1" for index in INDICES]
    extra += [f"f 1//{index} 2//1 3//1" for index in INDICES] + [f"v 0 {number} 1" for number in NUMBERS]
    for _ in range(rng.choice((0, 1, 1, 2, 5))):
        at = rng.randrange(len(lines) + 1)
        match rng.randrange(4):
            case 0:
                del lines[at:][:1]
                lines = lines[:at] + lines[at + 1 :]
            case 1:
                lines[at:at] = lines[max(at - 1, 0) : at]
            case _:
                lines.insert(at, rng.choice(extra))
    return ("\n".join(lines) + "\n").encode("latin-1", "replace")


def stl(rng: random.Random) -> bytes:
    """Return an STL file, binary or text, perhaps with another number of triangles than it says."""
    corners = [[VERTICES[index] for index in face] for face in FACES]
    if rng.random() < 0.3:
        bad = rng.choice([float("nan"), float("inf"), 1e30, 3e38])
        corners[rng.randrange(4)][rng.randrange(3)] = (bad, 0.0, 0.0)
    if rng.random() < 0.1:
        corners = [[VERTICES[0]] * 3] * 4
    if rng.random() < 0.5:
        said = rng.choice((4, 4, 4, 0, 3, 5, 2**31, 2**32 - 1))
        head = rng.choice((b"\0" * 80, b"solid".ljust(80), b"\xff" * 80, b"x"))
        records = (
            struct.pack("<3f9f", 0, 0, 1, *(c for corner in face for c in corner)) + b"\0\0"
            for face in corners
        )
        return head + struct.pack("<I", said) + b"".join(records)
    lines = [rng.choice(["solid", "solid \xe9", "SOLID x", "facet", "solid\tfacet"])]
    for face in corners:
        points = [f"vertex {x} {y} {z}" for x, y, z in face]
        lines += ["facet normal 0 0 1", "outer loop", *points, "endloop", "endfacet"]
    for _ in range(rng.choice((0, 0, 1, 3))):
        at = rng.randrange(len(lines))
        lines[at] = rng.choice(
            ["", "vertex 1 2", "vertex a b c", "endfacet", "facet", "vertex", lines[at - 1]]
        )
    return "\n".join([*lines, "endsolid"]).encode("latin-1")


ENCODINGS = (b"utf-8", b"latin-1", b"utf-16", b"ascii", b"nonsense", b"utf-7", b"", b"cp1252", b"punycode")
TAGS = (
    "shape", "bsdf", "texture", "emitter", "sensor", "integrator", "film", "medium", "volume", "phase", "sampler",
    "rfilter", "float", "integer", "boolean", "string", "spectrum", "rgb", "point", "vector", "transform",
    "translate", "rotate", "scale", "matrix", "lookat", "ref", "alias", "default", "include", "path", "scene", "x",
    "Shape", "shäpe",
)  # fmt: skip
PLUGINS = (
    "sphere", "rectangle", "disk", "cube", "cylinder", "ply", "obj", "serialized", "instance", "shapegroup",
    "merge", "blender", "linearcurve", "sdfgrid", "ellipsoids", "diffuse", "twosided", "conductor",
    "roughconductor", "dielectric", "blendbsdf", "mask", "principled", "plastic", "roughplastic", "hair",
    "measured", "bumpmap", "null", "retroreflector", "orbit_sky", "area", "constant", "envmap", "bitmap",
    "checkerboard", "uniform", "irregular", "evil", "../evil", "./plugins/evil", "plugins/evil", "/tmp/evil", "",
    "a" * 300, "spher\ne", "sphere\x00"[:6], "scene", "principledthin", "thindielectric", "roughdielectric",
)  # fmt: skip
ATTRIBUTES = (
    "type",
    "name",
    "value",
    "id",
    "x",
    "y",
    "z",
    "angle",
    "filename",
    "as",
    "version",
    "origin",
    "target",
    "up",
    "q",
)
NAMES = (
    "radius", "center", "p0", "p1", "to_world", "reflectance", "alpha", "eta", "k", "weight", "distribution",
    "int_ior", "specular_reflectance", "filename", "material", "flip_normals", "face_normals", "kind", "half_width",
    "opacity", "to_uv", "color0", "roughness", "metallic", "nested", "_arg_0", "", "é", "type",
)  # fmt: skip
FILES = (
    "meshes/part.ply", "../part.ply", "meshes/../../x.ply", "/etc/passwd", "/dev/zero", "/dev/stdin", "meshes",
    "gone.ply", "", "a\nb.ply", "meshes/part.obj", "x" * 300 + ".ply", "more.xml", "itself.xml", "scene.xml",
    "~/x.ply", "file:///etc/passwd", "C:\\x.ply", "/proc/self/environ", "meshes/part.ply\x0b"[:15],
)  # fmt: skip
WORDS = (
    "ggx",
    "beckmann",
    "nonsense",
    "true",
    "false",
    "yes",
    "Au",
    "bk7",
    "bead_sheet",
    "corner_cube",
    "é\u202e",
    "[b]",
    "<b>",
)

Node = tuple[str, dict[str, str], list["Node"]]  # type: ignore[misc]


def xml(rng: random.Random) -> str:
    """Return an XML scene with some of its elements and attributes changed."""
    scene = _base(rng)
    for _ in range(rng.choice((0, 1, 1, 1, 2, 3, 6))):
        _change(rng, scene)
    text = _spelt(scene)
    if rng.random() < 0.05:
        bomb = '<!DOCTYPE s [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;"><!ENTITY x SYSTEM "/etc/passwd">]>'
        text = bomb + text.replace("</scene>", rng.choice(["&b;", "&x;", "&nothing;", ""]) + "</scene>")
    return text


def _base(rng: random.Random) -> Node:
    """Return a sound scene: a sphere, a mesh, a disk and their materials."""
    paint: Node = (
        "bsdf",
        {"type": "diffuse", "name": "nested"},
        [("spectrum", {"name": "reflectance", "value": "0.3"}, [])],
    )
    metal: Node = ("bsdf", {"type": "roughconductor"}, [
        ("string", {"name": "distribution", "value": "ggx"}, []), ("float", {"name": "alpha", "value": "0.2"}, []),
        ("spectrum", {"name": "eta", "value": "1.4"}, []), ("spectrum", {"name": "k", "value": "16"}, []),
    ])  # fmt: skip
    turn: Node = ("transform", {"name": "to_world"}, [
        ("scale", {"value": "0.5"}, []), ("rotate", {"y": "1", "angle": "30"}, []),
        ("translate", {"x": "1", "z": "0.2"}, []),
    ])  # fmt: skip
    mirror: Node = ("bsdf", {"type": "retroreflector"}, [
        ("string", {"name": "kind", "value": "bead_sheet"}, []), ("float", {"name": "reflectance", "value": "0.5"}, []),
        ("float", {"name": "retro_share", "value": "0.2"}, []), ("float", {"name": "half_width", "value": "0.01"}, []),
    ])  # fmt: skip
    mixed: Node = (
        "bsdf",
        {"type": "blendbsdf"},
        [("float", {"name": "weight", "value": "0.3"}, []), metal, paint],
    )
    inside = [
        ("default", {"name": "r", "value": "0.5"}, []),
        ("integrator", {"type": "path"}, []),
        ("bsdf", {"type": "twosided", "id": "paint"}, [rng.choice([paint, metal, mirror, mixed])]),
        ("alias", {"id": "paint", "as": "colour"}, []),
        ("shape", {"type": "sphere", "id": "ball"}, [
            ("float", {"name": "radius", "value": "$r"}, []),
            ("point", {"name": "center", "x": "0", "y": "0", "z": "0"}, []),
            ("ref", {"id": rng.choice(["paint", "colour"])}, []),
        ]),
        ("shape", {"type": "ply"}, [
            ("string", {"name": "filename", "value": "meshes/part.ply"}, []), turn,
            ("ref", {"id": "paint", "name": "bsdf"}, []),
        ]),
        ("shape", {"type": "disk"}, [
            ("transform", {"name": "to_world"}, [("matrix", {"value": "1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1"}, [])]),
            ("bsdf", {"type": "diffuse"}, [("texture", {"type": "checkerboard", "name": "reflectance"}, [])]),
        ]),
        ("emitter", {"type": "constant"}, []),
    ]  # fmt: skip
    return ("scene", {"version": "3.0.0"}, inside)


def _nodes(node: Node) -> list[Node]:
    return [node, *(one for part in node[2] for one in _nodes(part))]


def _copied(node: Node) -> Node:
    return node[0], dict(node[1]), [_copied(part) for part in node[2]]


def _value(rng: random.Random, name: str) -> str:
    """Return a value for an attribute: mostly of its own kind, and often impossible."""
    if name == "type":
        return rng.choice(PLUGINS)
    if name in ("id", "as", "name"):
        return rng.choice(
            (*NAMES, "paint", "ball", "colour", "a\nb", "\x1b[31m", "<b>", "x" * 500, "p;q", "é")
        )
    if name == "filename":
        return rng.choice(FILES)
    return rng.choice(rng.choice((NUMBERS, NUMBERS, WORDS, FILES, tuple(map(str, INDICES)))))


def _change(rng: random.Random, scene: Node) -> None:
    """Change one thing of a scene in place."""
    everything = _nodes(scene)
    _, attributes, inside = rng.choice(everything)
    match rng.randrange(8):
        case 0 | 1 | 2 if attributes:
            name = rng.choice(list(attributes))
            attributes[name] = _value(rng, "filename" if attributes.get("name") == "filename" else name)
        case 3 if attributes:
            attributes.pop(rng.choice(list(attributes)))
        case 4:
            name = rng.choice(ATTRIBUTES)
            attributes[name] = _value(rng, name)
        case 5 if inside:
            del inside[rng.randrange(len(inside))]
        case 6:
            inside.insert(rng.randrange(len(inside) + 1), _copied(rng.choice(everything)))
        case _:
            inside.insert(rng.randrange(len(inside) + 1), _put_in(rng))


def _put_in(rng: random.Random) -> Node:
    """Return an element that is not there yet, from any that the format knows, or deeper than any scene."""
    tag = rng.choice(TAGS)
    names = rng.sample(ATTRIBUTES, rng.randrange(4))
    node: Node = (tag, {name: _value(rng, name) for name in names}, [])
    special: list[Node] = [
        ("include", {"filename": rng.choice(FILES)}, []),
        ("path", {"value": rng.choice(FILES)}, []),
        (
            "shape",
            {"type": rng.choice(PLUGINS)},
            [("string", {"name": "filename", "value": rng.choice(FILES)}, [])],
        ),
        ("bsdf", {"type": rng.choice(PLUGINS), "id": "own"}, [("ref", {"id": "own"}, [])]),
        ("shape", {"type": "sphere"}, [("bsdf", {"type": rng.choice(PLUGINS)}, [])]),
        ("shape", {"type": "sphere"}, [("emitter", {"type": rng.choice(PLUGINS)}, [])]),
        ("spectrum", {"name": "reflectance", "filename": rng.choice(FILES)}, []),
        ("float", {"name": rng.choice(NAMES), "value": rng.choice(NUMBERS)}, []),
        ("default", {"name": "r", "value": "$r$r"}, []),
    ]
    if rng.random() < 0.6:
        node = rng.choice(special)
    if rng.random() < 0.03:
        for _ in range(200):
            node = ("bsdf", {"type": "twosided"}, [node])
    return node


def _spelt(node: Node) -> str:
    tag, attributes, inside = node
    spelt = "".join(f" {name}={quoteattr(value)}" for name, value in attributes.items())
    return f"<{tag}{spelt}>{''.join(map(_spelt, inside))}</{tag}>"
