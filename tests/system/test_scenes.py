"""The shipped scenes: they load, hold the library's numbers, face the scanner and can be made again."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

from scanner_sim.scene.materials import MATERIALS

SCENES = ("node_z1", "target_board", "plane", "tilted_plane", "step", "material_edge", "sphere")


@pytest.fixture(scope="module")
def load(device, repo_root):
    import mitsuba as mi

    loaded = {}

    def read(name):
        if name not in loaded:
            loaded[name] = mi.load_file(str(repo_root / "scenes" / f"{name}.xml"), optimize=False)
        return loaded[name]

    return read


def mesh_arrays(shape):
    import mitsuba as mi

    held = mi.traverse(shape)
    vertices = np.asarray(held["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    return vertices, np.asarray(held["faces"]).reshape(-1, 3)


def shoot(scene, origins, directions):
    """Nearest hits: validity, distance, geometric normal, name of the BSDF."""
    import drjit as dr
    import mitsuba as mi

    origins, directions = np.broadcast_arrays(np.atleast_2d(origins), np.atleast_2d(directions))
    columns = [
        [mi.Float(np.ascontiguousarray(rays[:, i], dtype=np.float32)) for i in range(3)]
        for rays in (origins, directions)
    ]
    hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(*columns[0]), mi.Vector3f(*columns[1])))
    index = np.asarray(dr.reinterpret_array(mi.UInt32, hit.shape))
    by_index = {
        int(np.asarray(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0]): shape.bsdf().id()
        for shape in scene.shapes()
    }
    surface = [by_index.get(int(number)) for number in index]
    return np.asarray(hit.is_valid()), np.asarray(hit.t), np.asarray(hit.n).T, surface


def look_through(scene, eye, centre, half_width, count=120):
    """Rays from an eye through a square grid about a centre, facing the eye."""
    eye, centre = np.asarray(eye, dtype=float), np.asarray(centre, dtype=float)
    forward = (centre - eye) / np.linalg.norm(centre - eye)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    grid = np.linspace(-half_width, half_width, count)
    x, y = (values.ravel()[:, None] for values in np.meshgrid(grid, grid))
    directions = centre + x * right + y * down - eye
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return (*shoot(scene, np.broadcast_to(eye, directions.shape), directions), directions)


@pytest.mark.parametrize("name", SCENES)
def test_every_shape_is_a_named_mesh_with_area(name, load):
    shapes = load(name).shapes()
    assert len({shape.id() for shape in shapes}) == len(shapes)
    for shape in shapes:
        vertices, faces = mesh_arrays(shape)
        assert len(faces)
        assert np.isfinite(vertices).all()
        a, b, c = (vertices[faces[:, i]] for i in range(3))
        assert (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0.0).all()


@pytest.mark.parametrize("name", SCENES)
def test_materials_are_the_library_s(name, load):
    import mitsuba as mi

    for shape in load(name).shapes():
        entry = MATERIALS[shape.bsdf().id()]
        held = mi.traverse(shape.bsdf())

        def value(suffix, held=held):
            found = [key for key in held.keys() if key.startswith("brdf_0") and key.endswith(suffix)]  # noqa: SIM118
            return float(np.asarray(held[found[0]]).ravel()[0])

        if entry.kind != "rough_conductor":
            assert value("reflectance.value") == np.float32(entry.diffuse_reflectance)
        if entry.kind != "diffuse":
            assert value("eta.value") == np.float32(entry.eta)
            assert value("k.value") == np.float32(entry.k)
            assert value("alpha.value") == np.float32(entry.alpha)
        if entry.kind == "mixed":
            assert value("weight.value") == np.float32(entry.specular_share)


@pytest.mark.parametrize("name", SCENES)
def test_surfaces_seen_from_the_scanner_face_it(name, load):
    # Off the axis of symmetry: a ray exactly along an edge shared by two faces may slip between them.
    valid, _, normal, _, direction = look_through(load(name), [0.013, -0.007, -12.0], [0.0, 0.0, 0.0], 6.0)
    assert valid.sum() > 50
    assert np.einsum("ij,ij->i", normal, direction)[valid].max() < 0.0


@pytest.mark.parametrize("degrees", range(0, 360, 60))
def test_node_is_closed_from_all_sides(degrees, load):
    """No ray from outside may meet the back of a face: that would be a hole or a turned normal."""
    centre = np.array([0.0, -1.7, 3.0])
    angle = np.radians(degrees)
    eye = centre + np.array([14.0 * np.sin(angle), -4.0, -14.0 * np.cos(angle)])
    valid, _, normal, _, direction = look_through(load("node_z1"), eye, centre, 6.0, 160)
    assert valid.sum() > 4000
    # Grazing hits on shared edges are left out: their side is a matter of rounding.
    assert (np.einsum("ij,ij->i", normal, direction)[valid] < 1e-3).all()


def test_node_is_a_module_of_real_size(load):
    shapes = load("node_z1").shapes()
    assert 20 <= len(shapes) <= 60
    assert 80_000 <= sum(shape.face_count() for shape in shapes) <= 120_000
    hull = next(shape for shape in shapes if shape.id().startswith("node_shields_weathered"))
    vertices, _ = mesh_arrays(hull)
    assert np.hypot(vertices[:, 0], vertices[:, 1]).max() == pytest.approx(2.25, abs=0.02)


def test_node_has_relief(load):
    """The picture must tell: depths from centimetres to metres, and many materials, in one view from 9 m."""
    valid, distance, _, surface, direction = look_through(
        load("node_z1"), [0.0, -2.0, -9.0], [0.0, -2.0, 0.0], 5.0, 300
    )
    depth = np.where(valid, distance * direction[:, 2], np.nan).reshape(300, 300)
    jump = np.abs(np.diff(depth, axis=1))
    jump = jump[np.isfinite(jump)]
    for low, high in ((0.01, 0.03), (0.03, 0.1), (0.1, 0.3), (0.3, 1.0), (1.0, 3.0)):
        assert ((jump > low) & (jump < high)).sum() > 50, (low, high)
    assert len({name for name, hit in zip(surface, valid, strict=True) if hit}) >= 10


def test_node_has_no_faces_on_top_of_one_another(load):
    """Claim: no two faces share a place, so what a ray hits never depends on rounding.

    Set-up: three random points on each triangle; a ray of ±0.3 mm through each, from both sides.
    Expected: it meets its own triangle. Tolerance: a triangle is at fault when another one lies within 20 µm in
    at least four of six tries; lines where solids pass through one another give single ones. At most 10
    triangles (of 120 000) may be at fault by such lines; a single overlapping pair of lids gives more.
    """
    import drjit as dr
    import mitsuba as mi

    scene = load("node_z1")
    corners, owner, number = [], [], []
    for shape in scene.shapes():
        vertices, faces = mesh_arrays(shape)
        corners.append(vertices[faces])
        owner.append(np.full(len(faces), np.asarray(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0]))
        number.append(np.arange(len(faces)))
    triangles, owner, number = np.concatenate(corners), np.concatenate(owner), np.concatenate(number)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    reach, faults = 3e-4, np.zeros(len(triangles), dtype=int)
    rng = np.random.default_rng(5)
    for _ in range(3):
        weight = rng.dirichlet([1.0, 1.0, 1.0], len(triangles))
        points = np.einsum("nk,nkc->nc", weight, triangles)
        for side in (reach, -reach):
            start = (points + side * normal).astype(np.float32)
            towards = (-np.sign(side) * normal).astype(np.float32)
            ray = mi.Ray3f(
                mi.Point3f(*[mi.Float(np.ascontiguousarray(start[:, i])) for i in range(3)]),
                mi.Vector3f(*[mi.Float(np.ascontiguousarray(towards[:, i])) for i in range(3)]),
                mi.Float(2.0 * reach),
            )
            hit = scene.ray_intersect_preliminary(ray)
            other = np.asarray(dr.reinterpret_array(mi.UInt32, hit.shape)) != owner
            other |= np.asarray(hit.prim_index) != number
            faults += np.asarray(hit.is_valid()) & other & (np.abs(np.asarray(hit.t) - reach) < 2e-5)
    assert (faults >= 4).sum() <= 10


def test_listed_targets_are_black_on_white_and_seen_from_their_front(load, repo_root):
    scene = load("node_z1")
    targets = json.loads((repo_root / "scenes" / "node_z1_targets.json").read_text(encoding="utf-8"))
    assert len(targets) >= 12
    assert len({target["name"] for target in targets}) == len(targets)
    for target in targets:
        centre, normal = np.array(target["centre_m"]), np.array(target["normal"])
        side = np.cross(normal, [0.0, 1.0, 0.0])
        side /= np.linalg.norm(side)
        spots = centre + target["diameter_m"] * np.outer([0.0, 0.48, 0.52, -0.48, -0.52], side)
        valid, distance, hit_normal, surface = shoot(scene, spots + 2.0 * normal, -normal)
        assert valid.all()
        assert surface == ["target_black", "target_black", "target_white", "target_black", "target_white"]
        assert distance == pytest.approx(2.0, abs=1e-5)
        assert hit_normal @ normal == pytest.approx(1.0, abs=1e-4)


def test_board_has_four_targets_on_a_square_metre(load):
    scene = load("target_board")
    areas = {}
    for shape in scene.shapes():
        if shape.bsdf().id() == "target_black":
            vertices, faces = mesh_arrays(shape)
            a, b, c = (vertices[faces[:, i]] for i in range(3))
            weight = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
            centre = np.average((a + b + c) / 3.0, axis=0, weights=weight)
            areas[tuple(np.round(centre, 6) + 0.0)] = weight.sum()
    assert set(areas) == {(x, y, 0.0) for x in (-0.5, 0.5) for y in (-0.5, 0.5)}
    # float32 files: the area is exact to rounding of the vertices.
    assert list(areas.values()) == pytest.approx([np.pi * 0.05**2 / 4] * 4, rel=1e-5)
    names = {shape.id(): mesh_arrays(shape)[0].mean(axis=0) for shape in scene.shapes()}
    upper_left = names["upper_left_target_black"]
    assert upper_left[0] < 0.0
    assert upper_left[1] < 0.0


def depth_at(scene, x, y):
    points = np.column_stack([x, y, np.full(len(x), -5.0)])
    valid, distance, _, surface = shoot(scene, points, [0.0, 0.0, 1.0])
    assert valid.all()
    return distance - 5.0, surface


def test_measuring_scenes_have_their_stated_form(load):
    x, y = np.array([-1.5, -0.01, 0.01, 1.5]), np.array([-1.0, 0.3, -0.7, 1.9])
    assert depth_at(load("plane"), x, y)[0] == pytest.approx(0.0, abs=1e-5)
    assert depth_at(load("tilted_plane"), x, y)[0] == pytest.approx(np.tan(np.radians(30.0)) * x, abs=1e-5)
    assert depth_at(load("step"), x, y)[0] == pytest.approx([0.0, 0.0, 0.1, 0.1], abs=1e-5)
    depth, surface = depth_at(load("material_edge"), x, y)
    assert depth == pytest.approx(0.0, abs=1e-5)
    assert surface == ["target_black", "target_black", "target_white", "target_white"]


def test_sphere_is_round(load):
    vertices, _ = mesh_arrays(load("sphere").shapes()[0])
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(0.5, abs=1e-6)
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-0.3, 0.3, (2, 2000))
    depth, _ = depth_at(load("sphere"), x, y)
    inside = 0.5 - np.sqrt(x**2 + y**2 + depth**2)
    assert inside.max() < 1e-4
    assert inside.min() > -2e-6


@pytest.mark.slow
def test_generator_gives_the_committed_bytes(tmp_path, repo_root):
    scenes = repo_root / "scenes"
    subprocess.run(
        [sys.executable, str(scenes / "generate.py"), "--output", str(tmp_path)], check=True, timeout=120
    )
    made = {path.relative_to(tmp_path): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    kept = {
        path.relative_to(scenes): path.read_bytes()
        for pattern in ("*.xml", "*.json", "meshes/**/*.ply")
        for path in scenes.glob(pattern)
    }
    assert sorted(made) == sorted(kept)
    assert [str(path) for path in made if made[path] != kept[path]] == []
    assert sum(len(data) for data in kept.values()) < 12e6
