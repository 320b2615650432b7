"""Colours in the material libraries (MTL) of OBJ files: Kd and map_Kd, from files in the mesh's own folder."""

from __future__ import annotations

from pathlib import Path

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import LARGEST_MESH, LARGEST_TEXT, file_beside, read_ordinary
from scanner_sim.scene.files.file_meshes import Colour
from scanner_sim.scene.files.triangles import MeshError

_OPTIONS = {
    "-blendu": 1,
    "-blendv": 1,
    "-boost": 1,
    "-cc": 1,
    "-clamp": 1,
    "-imfchan": 1,
    "-mm": 2,
    "-texres": 1,
}
_MOVED = {"-o", "-s", "-t"}


def colours_of_libraries(names: tuple[str, ...], folder: Path) -> dict[str, Colour]:
    """Return the colours of materials by name; of equal names the first counts.

    Raises
    ------
    InputError
        If a library or a texture cannot be read, or lies outside of the folder.
    MeshError
        If a colour or a texture is not understood.
    """
    found: dict[str, Colour] = {}
    for name in names:
        path = file_beside(_plain(name), folder)
        for material, colour in _colours(
            read_ordinary(path, LARGEST_TEXT).decode("latin-1"), path.parent, folder
        ):
            found.setdefault(material, colour)
    return found


def files_of_libraries(names: tuple[str, ...], folder: Path) -> set[Path]:
    """Return the libraries that are there, and their textures; what cannot be read is left out."""
    found: set[Path] = set()
    for name in names:
        try:
            path = file_beside(_plain(name), folder)
            text = read_ordinary(path, LARGEST_TEXT).decode("latin-1")
        except InputError:
            continue
        found.add(path)
        for words in map(str.split, text.split("\n")):
            if words and words[0].lower() == "map_kd":
                try:
                    found.add(_texture(words, path.parent, folder))
                except (InputError, MeshError):
                    continue
    return {path for path in found if path.is_file()}


def _plain(name: str) -> str:
    """Return a name with forward slashes; programs on Windows write the others."""
    return name.replace("\\", "/")


def _colours(text: str, beside: Path, folder: Path) -> list[tuple[str, Colour]]:
    found: list[tuple[str, Colour]] = []
    for line, words in enumerate((entry.split() for entry in text.split("\n")), start=1):
        if not words:
            continue
        if words[0] == "newmtl":
            found.append((" ".join(words[1:])[:200], Colour((1.0, 1.0, 1.0))))
        elif words[0] == "Kd" and found:
            try:
                red, green, blue = (float(word) for word in words[1:4])
            except ValueError:
                raise MeshError(
                    f"line {line} of its material library is no colour of three numbers"
                ) from None
            if not all(0.0 <= value <= 1.0 for value in (red, green, blue)):
                raise MeshError(f"line {line} of its material library has a colour that is not from 0 to 1")
            found[-1] = found[-1][0], found[-1][1]._replace(factor=(red, green, blue))
        elif words[0].lower() == "map_kd" and found:
            image = read_ordinary(_texture(words, beside, folder), LARGEST_MESH)
            found[-1] = found[-1][0], found[-1][1]._replace(image=image)
    return found


def _texture(words: list[str], beside: Path, folder: Path) -> Path:
    """Return the file that a line ``map_Kd`` names, which counts from the library's folder."""
    at = 1
    while at < len(words) and words[at].startswith("-"):
        if words[at] in _MOVED:
            raise MeshError(f"a texture is moved or stretched by '{words[at]}', which is not understood")
        at += 1 + _OPTIONS.get(words[at], 1)
    name = _plain(" ".join(words[at:]))
    inside = beside.relative_to(folder).as_posix()
    return file_beside(name if inside == "." else f"{inside}/{name}", folder)
