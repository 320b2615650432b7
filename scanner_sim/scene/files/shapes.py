"""From one object of a scene to Mitsuba shapes, and from a material to a BSDF.

Shapes with a closed form stay analytic, so that truth is exact. Meshes and Mitsuba XML files are read and checked by
this package, and the renderer is given what it wrote anew: nothing else of a file reaches it.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_types import BSDF, Shape
from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.foundation.frames import pose_matrix, rotation_about
from scanner_sim.scene import materials
from scanner_sim.scene.files.file_meshes import MeshExtent
from scanner_sim.scene.files.mesh_files import read_mesh, read_mesh_file
from scanner_sim.scene.files.mesh_pieces import pieces_of, unit_of
from scanner_sim.scene.files.plugins import (
    SHAPE_LIST,
    build_plugin,
    installed_plugins,
    register_shape_list,
)
from scanner_sim.scene.files.scene_rules import MESHES, renderers_scene
from scanner_sim.scene.files.triangles import Triangles, canonical_ply
from scanner_sim.scene.labels import label_of_part
from scanner_sim.scene.objects import Box, Cylinder, Disc, Mesh, MitsubaFile, Rectangle, Sphere, TargetArray
from scanner_sim.scene.polarisation import speckle_contrast
from scanner_sim.scene.poses import FARTHEST
from scanner_sim.scene.surfaces import MaterialChoice, Retroreflector, Surface
from scanner_sim.scene.targets import target_array, target_positions
from scanner_sim.scene.visible import Band, in_visible_light, is_known_in_visible_light

_FACING = pose_matrix(rotation_about((1.0, 0.0, 0.0), np.pi), (0.0, 0.0, 0.0))
"""Turns Mitsuba's flat shapes, whose normal is +z, to face the scanner."""

MOST_TRIANGLES = 100_000_000
"""Triangles of an XML scene: a small file can name a large mesh often."""
_NARROW = 0.1
"""Roughness up to which a lobe is narrow: at 2 m one of 0.05 moves the light of a swept spot by 0.009 pixel, half of
its σ, and one of 0.15 by a fifth of that."""
_ROUGHNESSES = ("alpha", "alpha_u", "alpha_v")
_FLATTEST = 1e-12
"""Least determinant of a transform whose largest entry is 1."""


def shapes_of(item: Any, surfaces: Surfaces) -> list[Shape]:
    """Return the Mitsuba shapes of an object of a scene, where its position and rotation put it.

    Raises
    ------
    InputError
        If a file is missing, broken or empty.
    """
    return list(_SHAPES[type(item)](item, surfaces))


class Surfaces:
    """The BSDFs of one scene: one plugin per material, shared by its shapes."""

    def __init__(self, band: Band = "laser") -> None:
        self.band = band
        self._made: dict[str, Any] = {}
        self._described: dict[str, materials.Material] = dict(materials.MATERIALS)
        self._known_as: dict[str, str] = {}
        self._notes: dict[str, None] = {}
        self._unknown_visible: dict[str, None] = {}
        self.extents: dict[str, MeshExtent] = {}

    def note(self, name: str, sentences: Iterable[str], extent: MeshExtent) -> None:
        """Keep what is to be said of the file of an object, and how large its mesh is."""
        self.extents[name] = extent
        self._notes.update(dict.fromkeys(f"'{name}': {sentence}" for sentence in sentences))

    @property
    def notes(self) -> tuple[str, ...]:
        """What is to be said of the files of objects."""
        return tuple(self._notes)

    @property
    def unknown_visible(self) -> tuple[str, ...]:
        """Names by which results know the materials of which nobody said what they reflect in visible light."""
        return tuple(self._unknown_visible)

    def dress(self, shape: Shape) -> None:
        """Give a shape of a Mitsuba file the library's material of the name that its own has, in visible light."""
        name = shape.bsdf().id()
        if name not in materials.MATERIALS:
            self._unknown_visible[name] = None
        elif self.band == "visible":
            shape.set_bsdf(self(name))

    def mapped(self, choice: MaterialChoice, chart: NDArray[np.float32]) -> BSDF:
        """Return the BSDF of a Lambertian surface whose reflectance is a map, shape (rows, columns)."""
        assert isinstance(choice, Surface)
        name = f"{choice.known_as}:map_{len(self._made)}"
        self._known_as[name] = choice.known_as
        texture = {
            "type": "bitmap",
            "data": mi.TensorXf(chart[:, :, None]),
            "raw": True,
            "filter_type": "bilinear",
            "wrap_mode": "repeat",
        }
        diffuse = {"type": "diffuse", "reflectance": texture}
        self._made[name] = build_plugin({"type": "twosided", "nested": diffuse})
        self._made[name].set_id(name)
        return self._made[name]

    def known_as(self, name: str) -> str:
        """Return the name by which results know a material."""
        return self._known_as.get(name, name)

    def out_of_band_ratio(self, name: str) -> float:
        """Return the reflectance out of the filter's band over that in it, or by itself where that in it is 0."""
        known = self._described.get(name)
        if known is None or known.reflectance_out_of_band is None:
            return 1.0
        return known.reflectance_out_of_band / (known.reflectance or 1.0)

    def is_dark_in_band(self, name: str) -> bool:
        """Return whether a material reflects nothing in the filter's band, but something out of it."""
        known = self._described.get(name)
        return known is not None and known.reflectance == 0.0 and bool(known.reflectance_out_of_band)

    def coherence(self, name: str) -> float:
        """Return the squared contrast of a material's speckle."""
        known = self._described.get(name)
        return speckle_contrast(1.0 if known is None else known.depolarised_share) ** 2

    def is_narrow(self, name: str, shape: Shape) -> bool:
        """Return whether a material has a narrow lobe; one that nobody described tells by the shape that has it."""
        known = self._described.get(name)
        if known is not None:
            return known.retro is not None or (known.alpha is not None and known.alpha <= _NARROW)
        return any(_tells_narrow(parameter, value) for parameter, value in mi.traverse(shape.bsdf()))

    def __call__(self, choice: MaterialChoice) -> BSDF:
        """Return the BSDF of a material, made when it is first asked for."""
        if isinstance(choice, str):
            name, chosen = choice, materials.material(choice)
        else:
            chosen = _material_of(choice)
            name = chosen.name
            self._known_as[name] = choice.known_as
        seen = self._described[name] = chosen if self.band == "laser" else in_visible_light(chosen)
        if name not in self._made:
            if not is_known_in_visible_light(chosen):
                self._unknown_visible[self.known_as(name)] = None
            self._made[name] = build_plugin(materials.mitsuba_bsdf(seen))
            self._made[name].set_id(name)
        return self._made[name]


def _tells_narrow(parameter: str, value: Any) -> bool:
    """Return whether a parameter of a BSDF is that of a narrow lobe."""
    own = parameter.removesuffix(".value").rpartition(".")[2]
    if own in _ROUGHNESSES:
        return bool(np.float32(np.ravel(value)[0]) <= np.float32(_NARROW))
    return own == "retro_share"


def _material_of(choice: Surface | Retroreflector) -> materials.Material:
    """Return the material that a scenario describes, under a name of its own.

    One that a scenario names has its numbers in its name as well: two of one name may differ.
    """
    other = choice.reflectance_out_of_band
    lobe = choice.lobe if isinstance(choice, Retroreflector) else None
    spelt = choice.changed(name=None).known_as
    seen = "" if choice.reflectance_visible is None else f"_visible_{choice.reflectance_visible}"
    return materials.Material(
        name=spelt + seen if choice.name is None else f"{choice.name}:{spelt}{seen}",
        kind="diffuse" if lobe is None else "retroreflector",
        reflectance=choice.reflectance,
        reflectance_out_of_band=choice.reflectance if other is None else other,
        reflectance_visible=choice.reflectance_visible,
        retro=lobe,
        depolarisation=choice.depolarisation if isinstance(choice, Surface) else None,
        source="the scenario",
    )


def _transform(matrix: NDArray[np.float64]) -> Any:
    return mi.ScalarTransform4f(matrix.tolist())


def _scaling(x: float, y: float, z: float) -> NDArray[np.float64]:
    return np.diag([x, y, z, 1.0])


def _plugin(kind: str, matrix: NDArray[np.float64], bsdf: BSDF, **settings: Any) -> Shape:
    name = bsdf.id()  # loading renames a nested plugin to its key
    shape = mi.load_dict({"type": kind, "to_world": _transform(matrix), "bsdf": bsdf, **settings})
    bsdf.set_id(name)
    return shape


def _rectangle(item: Rectangle, bsdfs: Surfaces) -> list[Shape]:
    width, height = item.size
    matrix = item.scanner_from_object() @ _FACING @ _scaling(0.5 * width, 0.5 * height, 1.0)
    return [_plugin("rectangle", matrix, bsdfs(item.material))]


def _disc(item: Disc, bsdfs: Surfaces) -> list[Shape]:
    radius = 0.5 * item.diameter
    matrix = item.scanner_from_object() @ _FACING @ _scaling(radius, radius, 1.0)
    return [_plugin("disk", matrix, bsdfs(item.material))]


def _sphere(item: Sphere, bsdfs: Surfaces) -> list[Shape]:
    return [_plugin("sphere", item.scanner_from_object(), bsdfs(item.material), radius=0.5 * item.diameter)]


def _box(item: Box, bsdfs: Surfaces) -> list[Shape]:
    matrix = item.scanner_from_object() @ _scaling(*(0.5 * edge for edge in item.size))
    return [_plugin("cube", matrix, bsdfs(item.material))]


def _cylinder(item: Cylinder, bsdfs: Surfaces) -> list[Shape]:
    """Return a tube along y and its two lids."""
    pose, bsdf = item.scanner_from_object(), bsdfs(item.material)
    radius, half = 0.5 * item.diameter, 0.5 * item.length
    tube = _plugin("cylinder", pose, bsdf, p0=[0.0, -half, 0.0], p1=[0.0, half, 0.0], radius=radius)
    lids = []
    for end, angle in ((half, -0.5 * np.pi), (-half, 0.5 * np.pi)):
        outward = pose_matrix(rotation_about((1.0, 0.0, 0.0), angle), (0.0, end, 0.0))
        lids.append(_plugin("disk", pose @ outward @ _scaling(radius, radius, 1.0), bsdf))
    return [tube, *lids]


def _mesh_file(item: Mesh, bsdfs: Surfaces) -> list[Shape]:
    mesh = read_mesh_file(item.mesh)
    pieces, notes = pieces_of(item, mesh, bsdfs.band)
    unit = unit_of(item, mesh)
    bsdfs.note(item.name, notes, MeshExtent.of(mesh.triangles, unit))
    matrix = item.scanner_from_object() @ _scaling(unit, unit, unit)
    settings = {"face_normals": True} if mesh.flat else {}
    shapes = []
    with _folder_for_meshes() as folder:
        for number, piece in enumerate(pieces):
            bsdf = bsdfs(piece.material) if piece.map is None else bsdfs.mapped(piece.material, piece.map)
            path = _rewrite(piece.triangles, folder, number)
            if mesh.rows_from_below:
                settings["flip_tex_coords"] = True
            shape = _check(_plugin("ply", matrix, bsdf, filename=path, **settings), item.mesh)
            shape.set_id(label_of_part(item.name, piece.part) if item.label_parts else item.name)
            shapes.append(shape)
    return shapes


@contextmanager
def _folder_for_meshes() -> Iterator[Path]:
    """Make a folder for the files that the renderer reads."""
    try:
        with tempfile.TemporaryDirectory(prefix="scanner-sim-", ignore_cleanup_errors=True) as folder:
            yield Path(folder)
    except OSError as error:
        raise RunError(
            f"a temporary copy of a mesh cannot be written: {error.strerror}.",
            remedy="Make room on the disk, or set TMPDIR to another folder.",
        ) from None


def _rewrite(mesh: Triangles, folder: Path, number: int = 0) -> str:
    """Write a mesh that was read and checked for the renderer; return the path."""
    path = folder / f"{number}.ply"
    path.write_bytes(canonical_ply(mesh))
    return str(path)


def _mesh(
    name: str,
    vertices: NDArray[np.float64],
    faces: NDArray[Any],
    matrix: NDArray[np.float64],
    bsdf: BSDF,
) -> Shape:
    """Return a mesh from arrays, with flat faces."""
    settings = mi.Properties()
    settings["bsdf"] = bsdf
    settings["face_normals"] = True
    mesh = mi.Mesh(name, len(vertices), len(faces), settings)
    placed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(placed.astype(np.float32).ravel())
    parameters["faces"] = mi.UInt32(faces.astype(np.uint32).ravel())
    parameters.update()
    return _check(mesh, Path(name))


def _check(shape: Any, path: Path) -> Shape:
    """Return a shape that lies where single precision resolves it, and has an extent."""
    box = shape.bbox()
    corners = np.array([box.min, box.max], dtype=np.float64)
    if not (np.abs(corners) <= 10.0 * FARTHEST).all():
        raise InputError(
            f"a shape of {str(path)!r} reaches beyond {10.0 * FARTHEST:g} m, or nowhere.",
            remedy="Check the unit of length and the transforms.",
        )
    if not np.ptp(corners, axis=0).any():
        raise InputError(
            f"a shape of {str(path)!r} is no larger than a point.", remedy="Check its transforms."
        )
    return shape


def _mitsuba_file(item: MitsubaFile, bsdfs: Surfaces) -> list[Shape]:
    """Return the shapes of an XML scene, moved as one body."""
    text = renderers_scene(item.file)
    settings = mi.parser.ParserConfig(str(mi.variant()))
    settings.merge_meshes = False
    settings.merge_equivalent = False
    pose = mi.ScalarAffineTransform4d(item.scanner_from_object())
    register_shape_list()
    with _folder_for_meshes() as folder:
        try:
            state = mi.parser.parse_string(settings, text)
            mi.parser.transform_all(settings, state)
            _prepare(state.nodes, pose, folder)
            state.root.type = mi.ObjectType.Texture
            state.root.props.set_plugin_name(SHAPE_LIST)
            holder: Any = mi.parser.instantiate(settings, state)
        except InputError as error:
            problem = f"the scene {str(item.file)!r} cannot be loaded: {error.message}"
            raise InputError(problem, remedy=error.remedy) from None
        except OSError:
            raise
        except Exception as error:
            raise InputError(f"the scene {str(item.file)!r} cannot be loaded: {_reason(error)}") from None
    if not holder.shapes:
        raise InputError(f"the scene {str(item.file)!r} holds no shapes.")
    for shape in holder.shapes:
        bsdfs.dress(_check(shape, item.file))
    return list(holder.shapes)


def _prepare(nodes: Any, pose: Any, folder: Path) -> None:
    """Move the shapes of a parsed scene, and give them meshes that were read and checked."""
    copies: dict[str, tuple[str, int]] = {}
    total = 0
    for node in nodes:
        kind = node.props.plugin_name()
        if kind not in installed_plugins():
            raise InputError(f"there is no plugin {kind!r}.")
        for name in node.props:
            if node.props.type(name) == mi.Properties.Type.Transform:
                _refuse_singular(name, node.props[name])
        if node.type != mi.ObjectType.Shape:
            continue
        own = node.props.get("to_world", None)
        node.props["to_world"] = pose if own is None else pose @ own
        if kind in MESHES:
            named = node.props["filename"]
            if named not in copies:
                mesh = read_mesh(Path(named))
                copies[named] = _rewrite(mesh, folder, len(copies)), len(mesh.faces)
            node.props["filename"], faces = copies[named]
            total += faces
            if total > MOST_TRIANGLES:
                raise InputError(
                    f"the meshes of a scene have more than {MOST_TRIANGLES:.0e} triangles.",
                    remedy="Simplify them.",
                )
            if kind == "obj":
                node.props.set_plugin_name("ply")
                node.props["flip_tex_coords"] = node.props.get("flip_tex_coords", True)


def _refuse_singular(name: str, transform: Any) -> None:
    """Find transforms that leave no volume, or no number."""
    matrix = np.array(transform.matrix, dtype=np.float64)
    linear = matrix[:-1, :-1]
    size = np.abs(linear).max()
    if not np.isfinite(matrix).all() or not size > 0.0 or not abs(np.linalg.det(linear / size)) > _FLATTEST:
        raise InputError(f"the transform {name!r} of a shape flattens it, or is not finite.")


def _target_array(item: TargetArray, bsdfs: Surfaces) -> list[Shape]:
    layout = item.array
    positions = target_positions(layout.rows, layout.columns, *layout.spacing)
    parts = target_array(positions, layout.diameter, layout.plate)
    pose = item.scanner_from_object()
    bsdf = {"black": bsdfs(item.disc), "white": bsdfs(item.material)}
    return [
        _mesh(f"{item.name}-{part}", vertices, faces, pose, bsdf[part])
        for part, (vertices, faces) in parts.items()
    ]


def _reason(error: Exception) -> str:
    """Return the sentence of a renderer's error, without its source position or the lines of a plugin in Python."""
    said, _, trace = str(error).partition("Traceback (most recent call last):")
    if raised := re.search(r"^\w+: (.*)", trace, re.MULTILINE | re.DOTALL):
        said += raised[1]
    return " ".join(said.split("] ", 1)[-1].split())


_SHAPES: dict[type, Any] = {
    Rectangle: _rectangle,
    Disc: _disc,
    Sphere: _sphere,
    Box: _box,
    Cylinder: _cylinder,
    Mesh: _mesh_file,
    MitsubaFile: _mitsuba_file,
    TargetArray: _target_array,
}
