"""What users may import, and what importing costs them."""

from __future__ import annotations

import importlib.metadata
import inspect
import subprocess
import sys

import pytest

import scanner_sim


def python(code: str) -> str:
    """Run code in a fresh interpreter and return what it prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_the_public_names_are_these() -> None:
    assert set(scanner_sim.__all__) == {
        "Aim",
        "InputError",
        "Instrument",
        "KnownLines",
        "KnownRecords",
        "LineSet",
        "PoseEstimate",
        "FilterModel",
        "FilteredPose",
        "PoseFilter",
        "RangeImage",
        "RunError",
        "Samples",
        "Scanner",
        "Scenario",
        "ScenarioError",
        "ShotTable",
        "Status",
        "Tracker",
        "WaveformSet",
        "__version__",
        "compare",
        "convert",
        "difference_of",
        "draw_lightings",
        "estimate_pose",
        "every_pose",
        "load_scanner",
        "load_scenario",
        "open_campaign",
        "parameter_jacobian",
        "poses_of",
        "read_range_image",
        "read_shots",
        "read_signals",
        "read_track",
        "register_peak",
        "register_pulse",
        "simulate",
        "simulate_lines",
        "simulate_many",
        "simulate_shots",
        "simulate_voxel",
        "simulate_waveforms",
        "take_frames",
        "take_photo",
        "track",
        "track_many",
        "view",
        "write_run",
        "write_shots",
    }


@pytest.mark.parametrize("name", scanner_sim.__all__)
def test_every_public_name_exists(name: str) -> None:
    assert getattr(scanner_sim, name) is not None
    assert name in dir(scanner_sim)


def test_the_names_are_what_they_say() -> None:
    """Capitals are types, the others are functions: no module of the same name takes their place."""
    for name in set(scanner_sim.__all__) - {"__version__"}:
        kind = inspect.isclass if name[0].isupper() else inspect.isfunction
        assert kind(getattr(scanner_sim, name)), name


def test_version_is_that_of_the_installed_distribution() -> None:
    assert scanner_sim.__version__ == importlib.metadata.version("scanner-sim")


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        scanner_sim.simulat  # noqa: B018


def test_importing_the_package_loads_no_library() -> None:
    """Nothing outside the standard library is loaded until a name is used."""
    code = (
        "import sys; before = set(sys.modules); import scanner_sim; "
        "new = {name.split('.')[0] for name in set(sys.modules) - before}; "
        "print(sorted(new - set(sys.stdlib_module_names) - {'scanner_sim'}))"
    )
    assert python(code) == "[]"


LATE = {"colour", "scipy.signal", "scipy.stats", "xarray"}
"""What few simulations need."""
HEAVY = LATE | {"OpenEXR", "drjit", "matplotlib", "mitsuba", "pyarrow", "scipy.io", "trimesh"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("scanner_sim.cli", HEAVY | {"numpy", "pydantic", "yaml"}),
        ("scanner_sim.config", HEAVY),
        ("scanner_sim.cli.running", LATE),
    ],
)
def test_what_is_not_needed_is_not_loaded(module: str, heavy: set[str]) -> None:
    """Help and faults of a scenario are there before renderer and pictures, a simulation before what it may call."""
    assert python(f"import sys, {module}; print(sorted({heavy!r} & set(sys.modules)))") == "[]"
