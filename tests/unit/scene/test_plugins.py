"""Where the renderer looks for its plugins while this package has it build something."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import pytest

from scanner_sim.scene.files.plugins import installed_plugins_only

pytestmark = pytest.mark.usefixtures("device")


def test_a_plugin_of_the_working_folder_is_not_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: within the guard the name of a plugin of the renderer leads to its own file, though the working
    folder has one of that name; after it files are sought where they were before."""
    renderer: Any = mi  # its type stubs lack the resolver
    own = next((Path(str(mi.__file__)).parent / "plugins").glob("diffuse.*"))
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / own.name).touch()
    monkeypatch.chdir(tmp_path)

    def found() -> Path:
        return Path(str(renderer.file_resolver().resolve(f"plugins/{own.name}"))).absolute()

    before = renderer.file_resolver()
    with installed_plugins_only():
        assert found() == own
    assert renderer.file_resolver() is before
