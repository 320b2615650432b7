"""STL files, binary and in text: which bytes are triangles, which solids are parts, and where a file breaks off."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from scanner_sim.scene.files import stl_files
from scanner_sim.scene.files.stl_files import stl_mesh
from scanner_sim.scene.files.triangles import MeshError

CORNERS = np.float32(
    [
        [0, 0, 0],
        [1.5, 0, 0],
        [0, 2, 0.25],
        [0, 0, 1],
        [0, 3, 1],
        [-1, 0, 2.5],
        [4, 0, 0],
        [4, 1, 0],
        [5, 0, 3],
    ]
)


def binary(name: bytes = b"made by hand", said: int = 3, more: bytes = b"") -> bytes:
    """Return three triangles with normals and remarks that nobody reads."""
    rows = b"".join(
        struct.pack("<3f", 9.0, 8.0, 7.0) + CORNERS[3 * n : 3 * n + 3].tobytes() + b"\xab\xcd"
        for n in range(3)
    )
    return name.ljust(80, b" ") + struct.pack("<I", said) + rows + more


def facet(number: int) -> str:
    rows = "".join("vertex {} {} {}\n".format(*one) for one in CORNERS[3 * number : 3 * number + 3])
    return f"facet normal 0 0 0\nouter loop\n{rows}endloop\nendfacet\n"


def text(*solids: tuple[str, tuple[int, ...]]) -> str:
    return "".join(f"solid {name}\n{''.join(map(facet, own))}endsolid {name}\n" for name, own in solids)


@pytest.mark.parametrize(
    ("content", "names", "part_of", "notes"),
    [
        (binary(), ["unnamed"], [0, 0, 0], ()),
        (binary(b"solid in name only"), ["unnamed"], [0, 0, 0], ()),
        (binary(more=b"remark"), ["unnamed"], [0, 0, 0], ("6 bytes after the last triangle left out",)),
        (text(("bus", (0,)), ("wing left", (1, 2))), ["bus", "wing left"], [0, 1, 1], ()),
        (text(("none", ()), ("bus", (0, 1)), ("no", ()), ("wing", (2,)), ("end", ())), ["bus", "wing"], [0, 0, 1], ()),
        (text(("bus", (0, 1, 2))).replace("\n", "\r\n").upper(), ["BUS"], [0, 0, 0], ()),
        ("  \n" + text(("", (0, 1, 2))), ["unnamed"], [0, 0, 0], ()),
    ],
)  # fmt: skip
def test_triangles_and_parts_are_those_of_the_file(
    content: bytes | str, names: list[str], part_of: list[int], notes: tuple[str, ...]
) -> None:
    """Claim: each triangle has corners of its own, in the order of the file; a solid without any is no part."""
    mesh = stl_mesh(content if isinstance(content, bytes) else content.encode("latin-1"))
    np.testing.assert_array_equal(mesh.triangles.vertices[mesh.triangles.faces].reshape(-1, 3), CORNERS)
    assert [part.shown for part in mesh.parts] == names
    assert mesh.part_of.tolist() == part_of
    assert mesh.notes == notes
    assert (mesh.flat, mesh.split, mesh.triangles.normals, mesh.unit) == (True, True, None, None)


GOOD = text(("bus", (0, 1)))


@pytest.mark.parametrize(
    "content",
    [
        binary(said=4), binary(said=0), binary(said=2, name=b"solid"), binary()[:-1], binary()[:84], binary()[:83], b"",
        b"  solid", GOOD.replace("endfacet\n", "", 1), GOOD.rpartition("endfacet")[0],
        GOOD.replace("vertex 1.5 0.0 0.0\n", ""),
        GOOD.replace("vertex 1.5 0.0 0.0\n", 2 * "vertex 1.5 0.0 0.0\n"), GOOD.replace("1.5 0.0 0.0", "1.5 0.0"),
        GOOD.replace("1.5", "one"), GOOD.replace("1.5", "nan"),
        GOOD.replace("outer loop\n", "", 1).replace("vertex 1.5", "endfacet\nvertex 1.5", 1),
    ],
)  # fmt: skip
def test_a_file_that_is_not_whole_is_refused(content: bytes | str) -> None:
    stl_mesh(GOOD.encode())
    with pytest.raises(MeshError):
        stl_mesh(content if isinstance(content, bytes) else content.encode("latin-1"))


def test_as_many_solids_as_parts_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    solids = text(("a", (0,)), ("b", (1,)), ("c", (2,))).encode()
    monkeypatch.setattr(stl_files, "MOST_PARTS", 3)
    assert len(stl_mesh(solids).parts) == 3
    monkeypatch.setattr(stl_files, "MOST_PARTS", 2)
    with pytest.raises(MeshError, match="more than 2 solids"):
        stl_mesh(solids)
