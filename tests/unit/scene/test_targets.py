"""Circular targets: exact areas, one plane, one shared boundary, facing the scanner."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.targets import (
    circular_target,
    polygon_radius,
    target_array,
    target_positions,
    write_ply,
)

SEGMENTS = st.integers(8, 40).map(lambda n: 8 * n)


def signed_areas(vertices, faces):
    """Area of each triangle, positive where its normal points towards −z."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return -0.5 * np.cross(b - a, c - a)[:, 2]


@given(st.floats(1e-3, 2.0), st.floats(1.05, 10.0), SEGMENTS)
def test_areas_are_exact_and_all_faces_look_forward(diameter, ratio, segments):
    plate = diameter * ratio
    parts = circular_target(diameter, plate, segments)
    black = signed_areas(*parts["black"])
    white = signed_areas(*parts["white"])
    assert black.min() > 0.0
    assert white.min() > 0.0
    assert black.sum() == pytest.approx(np.pi * diameter**2 / 4, rel=1e-12)
    assert black.sum() + white.sum() == pytest.approx(plate**2, rel=1e-12)


def test_disc_and_surround_share_their_boundary_in_one_plane():
    parts = circular_target(0.1, 0.2, 64)
    black, white = parts["black"][0], parts["white"][0]
    assert (black[:, 2] == 0.0).all()
    assert (white[:, 2] == 0.0).all()
    ring = black[np.hypot(black[:, 0], black[:, 1]) > 0.0]
    assert len(ring) == 64
    assert all((white == vertex).all(axis=1).any() for vertex in ring)


def test_every_inner_edge_has_two_faces():
    parts = circular_target(0.1, 0.2, 64)
    edges: dict[tuple[bytes, bytes], int] = {}
    for vertices, faces in parts.values():
        for face in faces:
            for start, end in ((0, 1), (1, 2), (2, 0)):
                key = (vertices[face[start]].tobytes(), vertices[face[end]].tobytes())
                edges[key] = edges.get(key, 0) + 1
    assert set(edges.values()) == {1}
    unmatched = [edge for edge in edges if edge[::-1] not in edges]
    assert len(unmatched) == 64
    ends = np.array([np.frombuffer(end) for edge in unmatched for end in edge])
    assert np.abs(ends[:, :2]).max(axis=1) == pytest.approx(0.1)


def test_polygon_stays_close_to_the_circle():
    radius = polygon_radius(2.0, 64)
    assert 1.0 < radius < 1.0009
    assert radius * np.cos(np.pi / 64) > 0.999


@pytest.mark.parametrize(
    ("diameter", "plate", "segments"),
    [
        (0.1, 0.1, 64),
        (0.1, 0.05, 64),
        (0.0, 0.1, 64),
        (-0.1, 0.1, 64),
        (np.nan, 0.1, 64),
        (0.1, 0.2, 32),
        (0.1, 0.2, 65),
    ],
)
def test_impossible_targets_are_refused(diameter, plate, segments):
    with pytest.raises(InputError):
        circular_target(diameter, plate, segments)


def test_positions_run_by_rows_from_the_top_left():
    positions = target_positions(2, 3, 0.5, 1.0)
    assert positions.tolist() == [
        [-0.5, -0.5, 0.0],
        [0.0, -0.5, 0.0],
        [0.5, -0.5, 0.0],
        [-0.5, 0.5, 0.0],
        [0.0, 0.5, 0.0],
        [0.5, 0.5, 0.0],
    ]
    assert target_positions(1, 1, 0.0, 0.0).tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize("layout", [(0, 2, 1.0, 1.0), (2, 0, 1.0, 1.0), (2, 2, 0.0, 1.0), (2, 2, 1.0, -1.0)])
def test_impossible_layouts_are_refused(layout):
    with pytest.raises(InputError):
        target_positions(*layout)


def test_array_repeats_the_target():
    positions = target_positions(2, 2, 1.0, 1.0)
    single = circular_target(0.1, 0.2, 64)
    for part, (vertices, faces) in target_array(positions, 0.1, 0.2, 64).items():
        areas = signed_areas(vertices, faces)
        assert areas.min() > 0.0
        assert areas.sum() == pytest.approx(4 * signed_areas(*single[part]).sum())
        groups = vertices[faces].reshape(4, -1, 3).mean(axis=1)
        assert groups == pytest.approx(positions + groups.mean(axis=0), abs=1e-12)


def test_overlapping_plates_are_refused():
    for apart in ([0.15, 0.0], [0.199, 0.199], [-0.1, 0.19999]):
        with pytest.raises(InputError, match="targets 0 and 1 overlap"):
            target_array([[0.0, 0.0, 0.0], [*apart, 0.0]], 0.1, 0.2)
    target_array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]], 0.1, 0.2)
    target_array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5]], 0.1, 0.2)


@pytest.mark.parametrize("positions", [[], [[0.0, 0.0]], [[0.0, 0.0, np.inf]]])
def test_impossible_positions_are_refused(positions):
    with pytest.raises(InputError):
        target_array(positions, 0.1, 0.2)


@pytest.mark.parametrize("with_normals", [False, True])
def test_ply_reads_back_and_is_deterministic(tmp_path, with_normals):
    import trimesh

    vertices, faces = circular_target(0.1, 0.2)["white"]
    normals = np.tile([0.0, 0.0, -1.0], (len(vertices), 1)) if with_normals else None
    write_ply(tmp_path / "one.ply", vertices, faces, normals)
    write_ply(tmp_path / "two.ply", vertices, faces, normals)
    assert (tmp_path / "one.ply").read_bytes() == (tmp_path / "two.ply").read_bytes()
    mesh = trimesh.load_mesh(tmp_path / "one.ply", process=False)
    assert (mesh.vertices == vertices.astype(np.float32)).all()
    assert (mesh.faces == faces).all()
    if with_normals:
        assert mesh.vertex_normals == pytest.approx(normals)


def test_broken_meshes_are_not_written(tmp_path):
    with pytest.raises(ValueError, match="outside"):
        write_ply(tmp_path / "x.ply", np.zeros((3, 3)), [[0, 1, 3]])
    with pytest.raises(ValueError, match="alike"):
        write_ply(tmp_path / "x.ply", np.zeros((3, 3)), [[0, 1, 2]], np.zeros((2, 3)))
    assert not (tmp_path / "x.ply").exists()
