"""From one object of a scene to Mitsuba shapes, and from a material to a BSDF.

Shapes with a closed form stay analytic, so that truth is exact; meshes come from PLY, OBJ (Mitsuba's own
readers) or STL (trimesh). A Mitsuba XML file is parsed, moved as one body and stripped of everything but its shapes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.errors import InputError
from scanner_sim.frames import pose_matrix, rotation_about
from scanner_sim.scene import materials
from scanner_sim.scene.objects import (
    Box,
    Cylinder,
    Disc,
    MaterialChoice,
    Mesh,
    MitsubaFile,
    Rectangle,
    Retroreflector,
    Sphere,
    Surface,
    TargetArray,
)
from scanner_sim.scene.polarisation import speckle_contrast
from scanner_sim.scene.targets import target_array, target_positions

_FACING = pose_matrix(rotation_about((1.0, 0.0, 0.0), np.pi), (0.0, 0.0, 0.0))
"""Turns Mitsuba's flat shapes, whose normal is +z, to face the scanner."""


def shapes_of(item: Any, surfaces: Surfaces) -> list[Any]:
    """Return the Mitsuba shapes of an object of a scene, where its position and rotation put it.

    Raises
    ------
    InputError
        If a file is missing, broken or empty.
    """
    return list(_SHAPES[type(item)](item, surfaces))


class Surfaces:
    """The BSDFs of one scene: one plugin per material, shared by its shapes."""

    def __init__(self) -> None:
        self._made: dict[str, Any] = {}
        self._described: dict[str, materials.Material] = dict(materials.MATERIALS)

    def out_of_band_ratio(self, name: str) -> float:
        """Return the reflectance out of the filter's band over that in it."""
        known = self._described.get(name)
        if known is None or known.reflectance == 0.0 or known.reflectance_out_of_band is None:
            return 1.0
        return known.reflectance_out_of_band / known.reflectance

    def coherence(self, name: str) -> float:
        """Return the squared contrast of a material's speckle."""
        known = self._described.get(name)
        return speckle_contrast(1.0 if known is None else known.depolarised_share) ** 2

    def __call__(self, choice: MaterialChoice) -> Any:
        """Return the BSDF of a material, made when it is first asked for."""
        if isinstance(choice, str):
            name, chosen = choice, materials.material(choice)
        else:
            chosen = _described(choice)
            name = chosen.name
        self._described[name] = chosen
        if name not in self._made:
            self._made[name] = mi.load_dict(materials.mitsuba_bsdf(chosen))
            self._made[name].set_id(name)
        return self._made[name]


def _described(choice: Surface | Retroreflector) -> materials.Material:
    """Return the material that a scenario describes, under a name that tells it from all others."""
    other = choice.reflectance_out_of_band
    numbers: list[Any] = [choice.reflectance, other]
    lobe = choice.lobe if isinstance(choice, Retroreflector) else None
    if lobe is not None:
        numbers = [lobe.kind, *numbers, lobe.retro_share, lobe.half_width, lobe.entrance[1]]
    unlike = choice.depolarisation if isinstance(choice, Surface) else 1.0
    numbers.append(None if unlike == 1.0 else f"depolarising_{unlike}")
    spelt = "_".join(str(number) for number in numbers if number is not None)
    return materials.Material(
        name=f"{'reflectance' if lobe is None else 'retroreflector'}_{spelt}",
        kind="diffuse" if lobe is None else "retroreflector",
        reflectance=choice.reflectance,
        reflectance_out_of_band=choice.reflectance if other is None else other,
        retro=lobe,
        depolarisation=unlike if lobe is None else None,
        source="the scenario",
    )


def _transform(matrix: NDArray[np.float64]) -> Any:
    return mi.ScalarTransform4f(matrix.tolist())


def _scaling(x: float, y: float, z: float) -> NDArray[np.float64]:
    return np.diag([x, y, z, 1.0])


def _plugin(kind: str, matrix: NDArray[np.float64], bsdf: Any, **settings: Any) -> Any:
    name = bsdf.id()  # loading renames a nested plugin to its key
    shape = mi.load_dict({"type": kind, "to_world": _transform(matrix), "bsdf": bsdf, **settings})
    bsdf.set_id(name)
    return shape


def _rectangle(item: Rectangle, bsdfs: Surfaces) -> list[Any]:
    width, height = item.size
    matrix = item.scanner_from_object() @ _FACING @ _scaling(0.5 * width, 0.5 * height, 1.0)
    return [_plugin("rectangle", matrix, bsdfs(item.material))]


def _disc(item: Disc, bsdfs: Surfaces) -> list[Any]:
    radius = 0.5 * item.diameter
    matrix = item.scanner_from_object() @ _FACING @ _scaling(radius, radius, 1.0)
    return [_plugin("disk", matrix, bsdfs(item.material))]


def _sphere(item: Sphere, bsdfs: Surfaces) -> list[Any]:
    return [_plugin("sphere", item.scanner_from_object(), bsdfs(item.material), radius=0.5 * item.diameter)]


def _box(item: Box, bsdfs: Surfaces) -> list[Any]:
    matrix = item.scanner_from_object() @ _scaling(*(0.5 * edge for edge in item.size))
    return [_plugin("cube", matrix, bsdfs(item.material))]


def _cylinder(item: Cylinder, bsdfs: Surfaces) -> list[Any]:
    """Return a tube along y and its two lids."""
    pose, bsdf = item.scanner_from_object(), bsdfs(item.material)
    radius, half = 0.5 * item.diameter, 0.5 * item.length
    tube = _plugin("cylinder", pose, bsdf, p0=[0.0, -half, 0.0], p1=[0.0, half, 0.0], radius=radius)
    lids = []
    for end, angle in ((half, -0.5 * np.pi), (-half, 0.5 * np.pi)):
        outward = pose_matrix(rotation_about((1.0, 0.0, 0.0), angle), (0.0, end, 0.0))
        lids.append(_plugin("disk", pose @ outward @ _scaling(radius, radius, 1.0), bsdf))
    return [tube, *lids]


def _mesh_file(item: Mesh, bsdfs: Surfaces) -> list[Any]:
    bsdf = bsdfs(item.material)
    kind = item.mesh.suffix.lower()
    if not item.mesh.is_file():
        raise InputError(f"the mesh '{item.mesh}' does not exist.", remedy="Give its path from the scenario.")
    unit = item.length_unit
    matrix = item.scanner_from_object() @ _scaling(unit, unit, unit)
    if kind == ".stl":
        return [_mesh(item.name, *_read_stl(item.mesh), matrix, bsdf)]
    if kind not in (".ply", ".obj"):
        raise InputError(f"'{item.mesh.name}' is no PLY, OBJ or STL file.", remedy="Convert the mesh.")
    try:
        shape = _plugin(kind[1:], matrix, bsdf, filename=str(item.mesh))
    except RuntimeError as error:
        raise InputError(f"the mesh '{item.mesh}' cannot be read: {_reason(error)}") from None
    return [_checked(shape, item.mesh)]


def _read_stl(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    import trimesh

    try:
        mesh = trimesh.load_mesh(path, process=False)
        return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    except Exception as error:
        raise InputError(f"the mesh '{path}' cannot be read: {error}") from None


def _mesh(
    name: str,
    vertices: NDArray[np.float64],
    faces: NDArray[Any],
    matrix: NDArray[np.float64],
    bsdf: Any,
) -> Any:
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
    return _checked(mesh, Path(name))


def _checked(mesh: Any, path: Path) -> Any:
    """Return a mesh that has faces and finite vertices, or say what is wrong with it; other shapes pass."""
    parameters = mi.traverse(mesh)
    if "vertex_positions" not in parameters:
        return mesh
    if mesh.face_count() == 0:
        raise InputError(f"the mesh '{path}' has no faces.", remedy="A point cloud cannot be scanned.")
    if not np.isfinite(parameters["vertex_positions"].numpy()).all():
        raise InputError(f"the mesh '{path}' has vertices that are not finite.")
    if int(parameters["faces"].numpy().max()) >= mesh.vertex_count():
        raise InputError(f"the mesh '{path}' has faces that name missing vertices.")
    return mesh


def _mitsuba_file(item: MitsubaFile, _: Surfaces) -> list[Any]:
    """Return the shapes of an XML scene, moved as one body."""
    if not item.file.is_file():
        raise InputError(
            f"the scene '{item.file}' does not exist.", remedy="Give its path from the scenario."
        )
    settings = mi.parser.ParserConfig(str(mi.variant()))
    settings.merge_meshes = False
    settings.merge_equivalent = False
    pose = mi.ScalarAffineTransform4d(item.scanner_from_object())
    renderer: Any = mi  # its type stubs lack the resolver
    own_resolver = renderer.file_resolver()
    beside_file = renderer.FileResolver(own_resolver)
    beside_file.prepend(str(item.file.resolve().parent))
    renderer.set_file_resolver(beside_file)
    try:
        state = mi.parser.parse_file(settings, str(item.file))
        mi.parser.transform_all(settings, state)
        for node in state.nodes:
            if node.type == mi.ObjectType.Shape:
                own = node.props.get("to_world", None)
                node.props["to_world"] = pose if own is None else pose @ own
        root = mi.parser.instantiate(settings, state)
    except Exception as error:
        raise InputError(f"the scene '{item.file}' cannot be loaded: {_reason(error)}") from None
    finally:
        renderer.set_file_resolver(own_resolver)
    if not isinstance(root, mi.Scene) or not root.shapes():
        raise InputError(f"the scene '{item.file}' holds no shapes.")
    return [_checked(shape, item.file) for shape in root.shapes()]


def _target_array(item: TargetArray, bsdfs: Surfaces) -> list[Any]:
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
    """Return the sentence of a renderer's error, without its source position."""
    return " ".join(str(error).split("] ", 1)[-1].split())


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
