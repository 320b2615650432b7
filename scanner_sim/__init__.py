"""Scanner Sim: a physically based simulator of an auto-synchronised 3-D laser scanner.

The public names are loaded when first used, so that ``import scanner_sim`` costs nothing and
``scanner-sim --help`` does not wait for the renderer.
"""

from __future__ import annotations

import importlib
import importlib.metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scanner_sim.campaign.result import open_campaign as open_campaign
    from scanner_sim.config import load_scanner as load_scanner
    from scanner_sim.config import load_scenario as load_scenario
    from scanner_sim.config.scanner import Scanner as Scanner
    from scanner_sim.config.scenario import Scenario as Scenario
    from scanner_sim.foundation.errors import InputError as InputError
    from scanner_sim.foundation.errors import RunError as RunError
    from scanner_sim.foundation.errors import ScenarioError as ScenarioError
    from scanner_sim.foundation.status import Status as Status
    from scanner_sim.instrument.closed_loop.every_pose import every_pose as every_pose
    from scanner_sim.instrument.closed_loop.poses import poses_of as poses_of
    from scanner_sim.instrument.closed_loop.track import track as track
    from scanner_sim.instrument.closed_loop.track import track_many as track_many
    from scanner_sim.instrument.closed_loop.tracker import Tracker as Tracker
    from scanner_sim.instrument.instrument import Instrument as Instrument
    from scanner_sim.instrument.parameter_jacobian import parameter_jacobian as parameter_jacobian
    from scanner_sim.instrument.photograph import take_frames as take_frames
    from scanner_sim.instrument.photograph import take_photo as take_photo
    from scanner_sim.instrument.samples import Samples as Samples
    from scanner_sim.instrument.shots import simulate_shots as simulate_shots
    from scanner_sim.instrument.simulate import simulate as simulate
    from scanner_sim.instrument.simulate import simulate_many as simulate_many
    from scanner_sim.instrument.simulate import simulate_voxel as simulate_voxel
    from scanner_sim.instrument.simulate_signals import simulate_lines as simulate_lines
    from scanner_sim.instrument.simulate_signals import simulate_waveforms as simulate_waveforms
    from scanner_sim.instrument.viewing import view as view
    from scanner_sim.pose.estimate import estimate_pose as estimate_pose
    from scanner_sim.pose.filter import FilterModel as FilterModel
    from scanner_sim.pose.pose_filter import FilteredPose as FilteredPose
    from scanner_sim.pose.pose_filter import PoseFilter as PoseFilter
    from scanner_sim.pose.result import PoseEstimate as PoseEstimate
    from scanner_sim.products.difference import difference_of as difference_of
    from scanner_sim.products.files.exr import read_range_image as read_range_image
    from scanner_sim.products.files.run_folder import write_run as write_run
    from scanner_sim.products.files.shots_folder import read_shots as read_shots
    from scanner_sim.products.files.shots_folder import write_shots as write_shots
    from scanner_sim.products.files.signal_files import read_signals as read_signals
    from scanner_sim.products.formats.convert import convert as convert
    from scanner_sim.products.image import RangeImage as RangeImage
    from scanner_sim.products.lines import LineSet as LineSet
    from scanner_sim.products.shots import ShotTable as ShotTable
    from scanner_sim.products.track import read_track as read_track
    from scanner_sim.products.waveforms import WaveformSet as WaveformSet
    from scanner_sim.scan.protocol import Aim as Aim
    from scanner_sim.scene.light.draw import draw_lightings as draw_lightings
    from scanner_sim.signals.line.own_peak import KnownLines as KnownLines
    from scanner_sim.signals.processing import register_peak as register_peak
    from scanner_sim.signals.waveform.own_pulse import KnownRecords as KnownRecords
    from scanner_sim.signals.waveform.settings import register_pulse as register_pulse
    from scanner_sim.validation.compare.run import compare as compare

    __version__: str

__all__ = [
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
]

_HOMES = {
    "Aim": "scanner_sim.scan.protocol",
    "InputError": "scanner_sim.foundation.errors",
    "Instrument": "scanner_sim.instrument.instrument",
    "KnownLines": "scanner_sim.signals.line.own_peak",
    "KnownRecords": "scanner_sim.signals.waveform.own_pulse",
    "LineSet": "scanner_sim.products.lines",
    "PoseEstimate": "scanner_sim.pose.result",
    "FilterModel": "scanner_sim.pose.filter",
    "FilteredPose": "scanner_sim.pose.pose_filter",
    "PoseFilter": "scanner_sim.pose.pose_filter",
    "RangeImage": "scanner_sim.products.image",
    "RunError": "scanner_sim.foundation.errors",
    "Samples": "scanner_sim.instrument.samples",
    "Scanner": "scanner_sim.config.scanner",
    "Scenario": "scanner_sim.config.scenario",
    "ScenarioError": "scanner_sim.foundation.errors",
    "ShotTable": "scanner_sim.products.shots",
    "Status": "scanner_sim.foundation.status",
    "Tracker": "scanner_sim.instrument.closed_loop.tracker",
    "WaveformSet": "scanner_sim.products.waveforms",
    "compare": "scanner_sim.validation.compare.run",
    "convert": "scanner_sim.products.formats.convert",
    "difference_of": "scanner_sim.products.difference",
    "draw_lightings": "scanner_sim.scene.light.draw",
    "estimate_pose": "scanner_sim.pose.estimate",
    "every_pose": "scanner_sim.instrument.closed_loop.every_pose",
    "load_scanner": "scanner_sim.config",
    "load_scenario": "scanner_sim.config",
    "open_campaign": "scanner_sim.campaign.result",
    "parameter_jacobian": "scanner_sim.instrument.parameter_jacobian",
    "poses_of": "scanner_sim.instrument.closed_loop.poses",
    "read_range_image": "scanner_sim.products.files.exr",
    "read_shots": "scanner_sim.products.files.shots_folder",
    "read_signals": "scanner_sim.products.files.signal_files",
    "read_track": "scanner_sim.products.track",
    "register_peak": "scanner_sim.signals.processing",
    "register_pulse": "scanner_sim.signals.waveform.settings",
    "simulate": "scanner_sim.instrument.simulate",
    "simulate_lines": "scanner_sim.instrument.simulate_signals",
    "simulate_many": "scanner_sim.instrument.simulate",
    "simulate_shots": "scanner_sim.instrument.shots",
    "simulate_voxel": "scanner_sim.instrument.simulate",
    "simulate_waveforms": "scanner_sim.instrument.simulate_signals",
    "take_frames": "scanner_sim.instrument.photograph",
    "take_photo": "scanner_sim.instrument.photograph",
    "track": "scanner_sim.instrument.closed_loop.track",
    "track_many": "scanner_sim.instrument.closed_loop.track",
    "view": "scanner_sim.instrument.viewing",
    "write_run": "scanner_sim.products.files.run_folder",
    "write_shots": "scanner_sim.products.files.shots_folder",
}


def __getattr__(name: str) -> Any:
    """Load a public name from its home on first use (PEP 562)."""
    value: Any
    if name == "__version__":
        value = importlib.metadata.version("scanner-sim")
    elif name in _HOMES:
        from scanner_sim.render.libraries import need_system_libraries

        need_system_libraries()
        value = getattr(importlib.import_module(_HOMES[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, loaded or not."""
    return sorted({*globals(), *__all__})
