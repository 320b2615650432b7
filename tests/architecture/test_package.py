"""What the package says of itself is true: versions, citation, and the packages that it needs."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

NAMES = {
    "colour": "colour-science",
    "erfa": "pyerfa",
    "yaml": "PyYAML",
    "PIL": "pillow",
    "cv2": "opencv-python-headless",
    "zmq": "pyzmq",
    "quickjs": "quickjs-ng",
}
"""Packages whose modules have another name."""
ONLY_CAMPAIGNS = {"dask"}
"""What `distributed` brings in its own version."""
EXTRAS = ("campaign", "e57", "las", "meshes", "ros", "serve")
"""Optional parts of the installation whose modules the package imports."""
ONLY_LOADED = {"lazrs", "lxml", "networkx", "pycollada"}
"""What another of them loads by itself."""
ELSEWHERE = {"scanner_sim", "reference_pages", "_pytest", "uv"}
"""Our own and the documents', what an extra of its own brings, and what belongs to a package that is named."""

IMPORTED = re.compile(r"^ *(?:import (\w+)|from (\w+)[\w.]* import )", re.MULTILINE)
"""A line that imports, in texts too: programs that tests start are written as such. Imports of several are refused by
the linter."""

# Citation File Format 1.2.0, sections "Root keys" and "definitions.reference", as far as they are used.
ROOT_KEYS = {"cff-version", "message", "title", "abstract", "type", "version", "license", "authors"} | {
    "keywords",
    "references",
}
REFERENCE_KEYS = {"type", "title", "authors", "institution", "number", "year", "month"}


@pytest.fixture(scope="module")
def project(repo_root: Path) -> dict[str, Any]:
    """The section of pyproject.toml that is about the package."""
    found: dict[str, Any] = tomllib.loads((repo_root / "pyproject.toml").read_text(encoding="utf-8"))[
        "project"
    ]
    return found


def asked(requirements: list[str]) -> set[str]:
    return {re.split(r"[\[<>=~ ]", requirement)[0].lower() for requirement in requirements}


def imported(folder: Path) -> set[str]:
    """Return the packages that the modules of a folder import, without Python's own and the tests' shared ones."""
    found = set()
    own = {path.stem for path in folder.rglob("*.py")} | {
        path.name for path in folder.rglob("*") if path.is_dir()
    }
    for path in folder.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        found |= {plain or of for plain, of in IMPORTED.findall(text)}
    return found - sys.stdlib_module_names - ELSEWHERE - own


def test_what_is_imported_is_declared(project: dict[str, Any], repo_root: Path) -> None:
    if not (repo_root / "scanner_sim").is_dir():
        pytest.skip("the sources lie in the installed wheel")
    needed, extras = asked(project["dependencies"]), project["optional-dependencies"]
    optional = [asked(extras[extra]) for extra in EXTRAS]
    assert {
        NAMES.get(name, name).replace("_", "-").lower() for name in imported(repo_root / "scanner_sim")
    } == needed | ONLY_CAMPAIGNS | set().union(*optional) - ONLY_LOADED
    tests = {NAMES.get(name, name).replace("_", "-").lower() for name in imported(repo_root / "tests")}
    brought = ("test", "las", "meshes", "serve")
    assert tests <= needed.union(*(asked(extras[extra]) for extra in brought))


def test_the_citation_is_valid_and_of_this_version(project: dict[str, Any], repo_root: Path) -> None:
    """Citation File Format 1.2.0: known keys only, those that must be there, and the version of the package."""
    found = yaml.safe_load((repo_root / "CITATION.cff").read_text(encoding="utf-8"))
    assert set(found) == ROOT_KEYS
    assert (found["cff-version"], found["type"]) == ("1.2.0", "software")
    assert str(found["version"]) == project["version"]
    assert found["license"] == project["license"]
    for reference in found["references"]:
        assert set(reference) <= REFERENCE_KEYS
        assert {"type", "title", "authors"} <= set(reference)
    assert f"## {project['version']} " in (repo_root / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_package_page_has_a_text_and_links(project: dict[str, Any], repo_root: Path) -> None:
    assert (repo_root / project["readme"]).is_file()
    assert project["urls"]
