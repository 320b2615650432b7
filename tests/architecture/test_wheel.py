"""What a user gets who installs the wheel."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

IGNORED = {"__pycache__"}


@pytest.fixture(scope="module")
def wheel(repo_root: Path, tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """The wheel of this source tree."""
    if not (repo_root / "scanner_sim").is_dir():
        pytest.skip("these tests run against an installed wheel, without the sources")
    folder = tmp_path_factory.mktemp("wheel")
    code = f"from hatchling.build import build_wheel; build_wheel({str(folder)!r})"
    done = subprocess.run([sys.executable, "-c", code], cwd=repo_root, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (path,) = folder.glob("*.whl")
    return zipfile.ZipFile(path)


def test_wheel_holds_every_file_of_the_package_and_nothing_else(
    wheel: zipfile.ZipFile, repo_root: Path
) -> None:
    """Modules, ``py.typed`` and data alike; no tests, scenes or environments."""
    package = {
        path.relative_to(repo_root).as_posix()
        for path in (repo_root / "scanner_sim").rglob("*")
        if path.is_file() and not IGNORED & set(path.parts)
    }
    contents = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert contents == package
    assert "scanner_sim/py.typed" in contents


def test_wheel_says_what_it_needs_and_under_which_licence(wheel: zipfile.ZipFile) -> None:
    (name,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    metadata = Parser().parsestr(wheel.read(name).decode())
    assert metadata["Requires-Python"] == ">=3.11"
    assert metadata["License-Expression"] == "MIT"
    assert any(member.endswith("licenses/LICENSE") for member in wheel.namelist())
    needed = [need for need in metadata.get_all("Requires-Dist") if "extra ==" not in need]
    unbounded = [need for need in needed if ">=" not in need]
    assert needed
    assert not unbounded


def test_the_installed_command_is_the_command_line() -> None:
    """Also true of the installed wheel, where the sources are out of reach."""
    (command,) = importlib.metadata.entry_points(group="console_scripts", name="scanner-sim")
    assert command.value == "scanner_sim.cli:main"
    assert callable(command.load())


def test_type_information_is_installed() -> None:
    import scanner_sim

    assert Path(scanner_sim.__file__).with_name("py.typed").is_file()
