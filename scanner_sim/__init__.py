"""Scanner Sim: a physically based simulator of an auto-synchronised 3-D laser scanner.

The public names are loaded when first used, so that ``import scanner_sim`` costs nothing and
``scanner-sim --help`` does not wait for the renderer.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scanner_sim.closed_loop.poses import poses_of as poses_of
    from scanner_sim.closed_loop.track import track as track
    from scanner_sim.closed_loop.tracker import Tracker as Tracker
    from scanner_sim.config import load_scenario as load_scenario
    from scanner_sim.pose.estimate import estimate_pose as estimate_pose
    from scanner_sim.pose.filter import PoseFilter as PoseFilter
    from scanner_sim.products.track import read_track as read_track
    from scanner_sim.scenario import Scenario as Scenario
    from scanner_sim.simulate import simulate as simulate

    __version__: str

__all__ = [
    "PoseFilter",
    "Scenario",
    "Tracker",
    "__version__",
    "estimate_pose",
    "load_scenario",
    "poses_of",
    "read_track",
    "simulate",
    "track",
]

_HOMES = {
    "PoseFilter": "scanner_sim.pose.filter",
    "Scenario": "scanner_sim.scenario",
    "Tracker": "scanner_sim.closed_loop.tracker",
    "estimate_pose": "scanner_sim.pose.estimate",
    "load_scenario": "scanner_sim.config",
    "poses_of": "scanner_sim.closed_loop.poses",
    "read_track": "scanner_sim.products.track",
    "simulate": "scanner_sim.simulate",
    "track": "scanner_sim.closed_loop.track",
}


class _Package(ModuleType):
    """The package itself, in which ``simulate`` is always the function.

    The import system binds each submodule to its package under the submodule's name. Without this
    class ``from scanner_sim import simulate`` would give the function or the module of that name,
    depending on what was imported before.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _HOMES and isinstance(value, ModuleType):
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    """Load a public name from its home on first use (PEP 562)."""
    value: Any
    if name == "__version__":
        value = importlib.metadata.version("scanner-sim")
    elif name in _HOMES:
        value = getattr(importlib.import_module(_HOMES[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, loaded or not."""
    return sorted({*globals(), *__all__})
