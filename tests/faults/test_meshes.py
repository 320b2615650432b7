"""What a mesh can do: be read, or be refused with one message. It never reaches the renderer unchecked."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.files.mesh_files import read_mesh
from scanner_sim.scene.files.ply_files import ply_triangles
from scanner_sim.scene.files.triangles import Triangles, canonical_ply

HEADER = """\
ply
format {form} 1.0
comment caf\xe9
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
"""
CORNERS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.5)]
ASCII = HEADER.format(form="ascii") + "0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n3 0 1 2\n3 0 2 3\n"
OBJ = "# caf\xe9\nmtllib /dev/zero\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nf 1 2 3\nf -4 -2 -1\n"


def binary(order: str, corners: list[tuple[float, ...]] = CORNERS) -> bytes:
    """Return the same mesh as a binary PLY file, in an order of bytes, ``<`` or ``>``."""
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    faces = b"".join(struct.pack(f"{order}B3i", 3, *face) for face in ((0, 1, 2), (0, 2, 3)))
    return HEADER.format(form=form).encode("latin-1") + struct.pack(f"{order}12f", *np.ravel(corners)) + faces


def stl(count: int, said: int) -> bytes:
    return b"\0" * 80 + struct.pack("<I", said) + (struct.pack("<12f", *range(9), 0, 1, 5) + b"\0\0") * count


def as_text(faces: str) -> bytes:
    """Return the mesh with other faces."""
    return ASCII.replace("3 0 1 2\n3 0 2 3\n", faces).encode("latin-1")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.ply", ASCII.encode("latin-1")),
        ("a.ply", ASCII.replace("\n", "\r\n").encode("latin-1")),
        ("a.ply", binary("<")),
        ("a.ply", binary(">")),
        ("a.ply", as_text("4 0 1 2 3\n3 0 2 3\n").replace(b"4 0 1 2 3", b"3 0 1 2")),
        ("a.obj", OBJ.encode("latin-1")),
        ("a.obj", OBJ.replace("f 1 2 3\nf -4 -2 -1", "f 1 2 \\\n3 4").encode("latin-1")),
    ],
)
def test_every_spelling_gives_the_same_mesh(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    mesh = read_mesh(tmp_path / name)
    assert mesh.vertices[mesh.faces].tolist() == [
        [list(CORNERS[k]) for k in face] for face in ((0, 1, 2), (0, 2, 3))
    ]


def test_what_the_renderer_reads_is_what_was_read() -> None:
    """The file that is written for the renderer holds the same numbers, also normals and texture coordinates."""
    rng = np.random.default_rng(1)
    places, normals = rng.normal(size=(2, 5, 3)).astype(np.float32)
    mesh = Triangles(places, np.array([[0, 1, 2], [2, 3, 4]], np.uint32), normals, normals[:, :2].copy())
    again = ply_triangles(canonical_ply(mesh))
    for one, other in zip(mesh, again, strict=True):
        assert one is not None
        assert other is not None
        assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.ply", b"", "empty"),
        ("a.ply", b"hello\n", "no PLY header"),
        ("a.ply", ASCII.replace("end_header", "end_heade").encode("latin-1"), "no PLY header"),
        ("a.ply", ASCII.replace("float z", "quad z").encode("latin-1"), "header is not understood"),
        ("a.ply", ASCII.replace("uchar int", "float int").encode("latin-1"), "header is not understood"),
        ("a.ply", ASCII.replace("float z", "float y").encode("latin-1"), "twice"),
        ("a.ply", ASCII.replace("face 2", "face 4000000000").encode("latin-1"), "announces 4000000000 rows"),
        ("a.ply", ASCII.replace("vertex 4", "vertex 3").encode("latin-1"), ""),
        ("a.ply", binary("<")[:-1], "the data end"),
        ("a.ply", binary("<") + b"\0", "more data"),
        ("a.ply", as_text("3 0 1 4\n3 0 2 3\n"), "names the vertex 4"),
        ("a.ply", as_text("3 0 1 -1\n3 0 2 3\n"), "names the vertex -1"),
        ("a.ply", as_text("3 0 1 nan\n3 0 2 3\n"), "not whole"),
        ("a.ply", as_text("2 0 1\n3 0 2 3\n"), "fewer than three"),
        ("a.ply", as_text("-3 0 1 2\n3 0 2 3\n"), "length of a list"),
        ("a.ply", as_text("3 0 0 0\n3 1 1 2\n"), "has an area"),
        ("a.ply", as_text("").replace(b"face 2", b"face 0"), "no faces"),
        ("a.ply", ASCII.replace("1 1 0", "1 inf 0").encode("latin-1"), "not finite"),
        ("a.ply", ASCII.replace("1 1 0", "1 1e39 0").encode("latin-1"), "not finite"),
        ("a.ply", ASCII.replace("1 1 0", "1 secret 0").encode("latin-1"), "not a number"),
        ("a.ply", binary("<", [*CORNERS[:3], (float("nan"),) * 3]), "not finite"),
        ("a.obj", b"v 0 0 0\n", "no faces"),
        ("a.obj", OBJ.replace("f 1 2 3", "f 1 2 5").encode("latin-1"), "line 7: a face names entry 5 of 4"),
        ("a.obj", OBJ.replace("f 1 2 3", "f 0 1 2").encode("latin-1"), "names entry 0"),
        ("a.obj", OBJ.replace("f 1 2 3", "f 1/1/1/1 2 3").encode("latin-1"), "corner of a face"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2\n", "no faces"),
        ("a.obj", OBJ.replace("v 1 1 0", "v 1 secret 0").encode("latin-1"), "line 5"),
        ("a.obj", OBJ.replace("v 1 1 0", "v 1 1e60 0").encode("latin-1"), "not finite"),
        ("a.stl", stl(1, 1000), "its length"),
        ("a.stl", stl(0, 0), "no faces"),
        ("a.stl", b"solid x\nfacet\nvertex 0 0 0\n", "breaks off"),
        ("a.stl", b"\x89PNG\r\n", "no STL file"),
    ],
)
def test_a_broken_mesh_has_one_clear_fault(name: str, content: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_mesh(tmp_path / name)
    assert words in str(caught.value)
    assert name in str(caught.value)
    assert "secret" not in str(caught.value)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("kind", ["pipe", "device", "large"])
def test_a_mesh_is_an_ordinary_file_of_bounded_size(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "device":
            path.symlink_to("/dev/zero")
        case "large":
            path.touch()
            os.truncate(path, 1 << 40)
    with pytest.raises(InputError, match=r"ordinary file|at most"):
        read_mesh(path)


def test_a_small_file_asks_for_little_memory() -> None:
    """Counts that the file cannot hold are refused before anything of their size is made."""
    import tracemalloc

    content = binary("<").replace(b"face 2", b"face 900000000000")
    tracemalloc.start()
    with pytest.raises(Exception, match="announces"):
        ply_triangles(content)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6
