"""Lines and waveforms of a raster's voxels: their light as columns, and what the detector makes of it.

Light is followed to the detector once and kept before speckle (:meth:`SignalRecorder.light`). All that a seed or the
detector decides comes after that, from the columns alone (:meth:`SignalRecorder.signals`): so lines that are drawn
again are those of a whole run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config import resolved_yaml
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.line.exposure import electrons_per_watt
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.line_readings import LineReadings
from scanner_sim.instrument.rangefinder import Reading
from scanner_sim.instrument.time_of_flight import EchoDelays
from scanner_sim.products.files.signal_files import voxels_together
from scanner_sim.products.lines import LINE_LIGHT, LineSet
from scanner_sim.products.provenance import versions
from scanner_sim.products.signal_set import SignalAbout, SignalSet, number_kind
from scanner_sim.products.waveforms import WAVEFORM_LIGHT, WaveformSet
from scanner_sim.ranging.ranges import Deflections
from scanner_sim.render.beam.kept_light import KeptLight
from scanner_sim.render.beam.light import Truth
from scanner_sim.render.beam.line_projection import chief_image
from scanner_sim.render.incident import LinkBudget
from scanner_sim.render.shots import Shots
from scanner_sim.scan.protocol import Aim
from scanner_sim.scan.raster import raster_aim
from scanner_sim.scene.files.loader import LoadedScene
from scanner_sim.signals.line.calibration import SensorCalibration

Columns = Mapping[str, NDArray[Any]]
Progress = Callable[[int, int], None]

_SURFACE = {
    "clusters": "clusters",
    "range": "truth.range_m",
    "object": "surface_number",
    "material": "truth.material",
    "point": "surface_point_m",
    "along": "beam_along",
    "across": "beam_across",
    "normal": "beam_normal",
    "radius": "beam_radius_m",
    "distance": "beam_distance_m",
}
_LINE = _SURFACE | {
    "amount": "cluster_w",
    "position": "cluster_px",
    "sigma": "cluster_sigma_px",
    "coherence": "cluster_coherence",
}
_ECHO = _SURFACE | {
    "amount": "echo_share",
    "position": "echo_path_m",
    "sigma": "echo_sigma_m",
    "reference": "reference_m",
}
"""Column of each part of :class:`~scanner_sim.render.beam.kept_light.KeptLight`."""
_BUDGET = {
    "laser": "laser_total_w",
    "field": "laser_field_w",
    "background": "background_window_w",
    "background_error": "background_window_error_w",
}
"""Column of each part of :class:`~scanner_sim.render.incident.LinkBudget`."""
_PEAKS = {
    "peak_px": "position",
    "sigma_peak_px": "sigma",
    "Y": "signal",
    "sigma_Y": "sigma_signal",
    "snr_detection": "snr",
}
"""Part of :class:`~scanner_sim.instrument.line_readings.LineReadings` of each column."""


class SignalRecorder(Protocol):
    """Makes the columns of lines or waveforms, before an instrument's scene or without it."""

    @property
    def kind(self) -> type[SignalSet]:
        """What the columns make."""

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the columns of the light."""

    @property
    def samples(self) -> int:
        """Samples or pixels of a record."""

    def light(self, shots: Shots) -> dict[str, NDArray[Any]]:
        """Return the columns of the light, from the scene."""

    def signals(self, light: Columns, shots: Shots) -> dict[str, NDArray[Any]]:
        """Return the columns that noise and processing make of light, without the scene."""

    def reading(self, light: Columns, shots: Shots, deflections: Deflections) -> Reading:
        """Return what is measured of light, as the rangefinder itself would."""

    def numbers(self) -> dict[str, float]:
        """Return what the digital numbers mean."""


class LineRecorder:
    """Makes the columns of lines."""

    kind: type[SignalSet] = LineSet
    kept = tuple(column.name for column in LINE_LIGHT)

    def __init__(self, instrument: Instrument) -> None:
        self._way, self._scanner = instrument.triangulation, instrument.scenario.scanner
        self._loaded = instrument.loaded
        sensor = self._scanner.position_sensor
        ends = sensor.noise.quantisation and sensor.noise.saturation
        self.number_kind = number_kind(ends, 0, sensor.largest_number)

    @property
    def samples(self) -> int:
        """Pixels of the line."""
        return self._scanner.position_sensor.pixels

    def light(self, shots: Shots) -> dict[str, NDArray[Any]]:
        """Return the columns of the light, from the scene."""
        kept, groups = self._way.keep(shots)
        n = len(kept.clusters)
        found = {name: getattr(kept, part) for part, name in _LINE.items()}
        found |= {name: np.zeros(n, dtype=np.float32) for name in (*_BUDGET.values(), "background_peak_w")}
        for incident in groups:
            index, lines = incident.light.index.numpy(), incident.lines()
            budget = incident.link_budget()
            for part, name in _BUDGET.items():
                found[name][index] = getattr(budget, part).numpy()
            for name, values in zip(("laser_w", "background_w"), lines, strict=True):
                if values is not None:
                    if name == "background_w":
                        found["background_peak_w"][index] = values.max(axis=1)
                    whole = found.setdefault(name, np.empty((n, self.samples), dtype=np.float32))
                    whole[index] = values
        peak = chief_image(self._way.optics, shots, kept.truth())
        return found | _labelled(kept, self._loaded) | {"truth.peak_px": peak}

    def signals(self, light: Columns, shots: Shots) -> dict[str, NDArray[Any]]:
        """Return the columns that noise and processing make of light, without the scene."""
        exposures = ("number", "number_off") if self._scanner.laser_off > 0.0 else ("number",)
        n = len(light["clusters"])
        found: dict[str, NDArray[Any]] = {
            name: np.empty((n, self.samples), dtype=self.number_kind) for name in exposures
        }
        groups = list(self._groups(light, shots, whole=True))
        for group in groups:
            for exposure, name in enumerate(exposures):
                found[name][group.index] = group.signal.lines(exposure)
        line = self._way.gathered(n, groups)
        found |= {name: getattr(line, part).astype(np.float32) for name, part in _PEAKS.items()}
        return found | {"status": line.status.astype(np.int32)}

    def reading(self, light: Columns, shots: Shots, deflections: Deflections) -> Reading:
        """Return what is measured of light, as the rangefinder itself would."""
        line: LineReadings = self._way.gathered(
            len(light["clusters"]), self._groups(light, shots, whole=False)
        )
        return self._way.reading(_truth_of(light, _LINE), line, deflections)

    def _groups(self, light: Columns, shots: Shots, *, whole: bool) -> Iterator[Any]:
        budget = LinkBudget(*(light[_BUDGET[field.name]] for field in fields(LinkBudget)))
        kept = _kept_of(light, _LINE)
        return self._way.read_kept(kept, shots, budget, light.get("background_w"), whole=whole)

    def numbers(self) -> dict[str, float]:
        """Return what the digital numbers mean."""
        scanner, sensor = self._scanner, self._scanner.position_sensor
        calibration = SensorCalibration.of(sensor, scanner.dwell, scanner.laser_off)
        return {
            "pitch_m": sensor.pitch,
            "offset_m": sensor.offset,
            "bias": calibration.bias,
            "electrons_per_number": calibration.gain,
            "dark_electron": calibration.dark,
            "off_scale": calibration.off_scale,
            "electrons_per_watt": electrons_per_watt(sensor, scanner.laser.wavelength, scanner.exposure),
            "stray_light": self._way.throughput.stray,
        }


class WaveformRecorder:
    """Makes the columns of waveforms."""

    kind: type[SignalSet] = WaveformSet
    kept = tuple(column.name for column in WAVEFORM_LIGHT)

    def __init__(self, instrument: Instrument) -> None:
        self._way, self._unit = instrument.time_of_flight, instrument.scenario.scanner.lidar
        self._loaded = instrument.loaded
        noise, bits = self._unit.photodiode.noise, self._unit.digitiser.bits
        ends = noise.quantisation and noise.saturation
        self.number_kind = number_kind(ends, -(2**bits), 2**bits)

    @property
    def samples(self) -> int:
        """Samples of a record."""
        return self._unit.digitiser.samples

    def light(self, shots: Shots) -> dict[str, NDArray[Any]]:
        """Return the columns of the light, from the scene."""
        kept, coherence, background = self._way.keep(shots)
        found = {name: getattr(kept, part) for part, name in _ECHO.items()}
        return found | _labelled(kept, self._loaded) | {"coherence": coherence, "background_w": background}

    def signals(self, light: Columns, shots: Shots) -> dict[str, NDArray[Any]]:
        """Return the columns that noise and processing make of light, without the scene."""
        n = len(light["clusters"])
        number, delays = np.empty((n, self.samples), dtype=self.number_kind), EchoDelays.empty(n)
        for group in self._groups(light, shots):
            number[group.index] = group.waveforms.records()
            delays.fill(group.index, group.delays, self._unit.digitiser)
        return {
            "number": number,
            "expected_a": self._way.expected(_kept_of(light, _ECHO), shots),
            "delay_s": np.where(delays.status == 0, delays.delay, np.nan),
            "sigma_delay_s": delays.sigma,
            "height_a": delays.signal.astype(np.float32),
            "tof.snr_detection": delays.snr.astype(np.float32),
            "echoes": delays.echoes.astype(np.int32),
            "status": delays.status.astype(np.int32),
        }

    def reading(self, light: Columns, shots: Shots, deflections: Deflections) -> Reading:
        """Return what is measured of light, as the rangefinder itself would."""
        delays = self._way.gathered(len(light["clusters"]), self._groups(light, shots))
        return self._way.reading(_truth_of(light, _ECHO), delays, light["background_w"], deflections)

    def _groups(self, light: Columns, shots: Shots) -> Iterator[Any]:
        kept = _kept_of(light, _ECHO)
        return self._way.read_kept(kept, shots, light["coherence"], light["background_w"])

    def numbers(self) -> dict[str, float]:
        """Return what the digital numbers mean."""
        clock = self._unit.digitiser
        step = clock.step(self._unit.photodiode.saturation)
        return {"start_s": clock.start, "rate_hz": clock.rate, "step_a": step}


RECORDERS: Mapping[str, Callable[[Instrument], SignalRecorder]] = {
    "triangulation": LineRecorder,
    "tof": WaveformRecorder,
}
"""What makes the columns of each rangefinder."""


def _kept_of(light: Columns, names: Mapping[str, str]) -> KeptLight:
    """Return columns as light."""
    parts: dict[str, Any] = {"coherence": None, "reference": None}
    return KeptLight(**parts | {part: light[name] for part, name in names.items()})


def _truth_of(light: Columns, names: Mapping[str, str]) -> Truth:
    """Return what chief rays meet, by the numbers that stand in results."""
    return _kept_of(light, {**names, "object": "truth.object"}).truth()


def _labelled(kept: KeptLight, loaded: LoadedScene) -> dict[str, NDArray[Any]]:
    """Return what chief rays meet by the numbers that stand in results."""
    return {
        "truth.object": loaded.object_labels.number_of[kept.object].astype(np.int32),
        "truth.material": loaded.material_labels.number_of[kept.material].astype(np.int32),
    }


def about_of(scenario: Scenario, recorder: SignalRecorder, objects: Any, materials: Any) -> SignalAbout:
    """Return what is said of lines or waveforms of a scenario whose scene has such names."""
    text, numbers = resolved_yaml(scenario), recorder.numbers()
    return SignalAbout(recorder.kind.FORM, text, tuple(objects), tuple(materials), numbers, versions())


def recorded(
    instrument: Instrument,
    recorder: SignalRecorder,
    shots: NDArray[np.uint32],
    progress: Progress | None = None,
) -> Iterator[SignalSet]:
    """Yield lines or waveforms of shots of an instrument's raster in parts, as they stand in a file."""
    scenario, loaded = instrument.scenario, instrument.loaded
    about = about_of(scenario, recorder, loaded.object_labels.names, loaded.material_labels.names)
    together = voxels_together(recorder.samples)
    for start in range(0, len(shots), together):
        aim = raster_aim(scenario.raster, shots[start : start + together], scenario.scanner.dwell)
        light = recorder.light(instrument.fire(aim)[0])
        yield recorder.kind(_where(scenario, aim) | light | drawn(instrument, recorder, aim, light), about)
        if progress is not None:
            progress(min(start + together, len(shots)), len(shots))


def drawn(
    instrument: Instrument, recorder: SignalRecorder, aim: Aim, light: Columns
) -> dict[str, NDArray[Any]]:
    """Return all columns of shots that noise and processing make of light, without the scene."""
    shots, pointing = instrument.fire(aim)
    read = instrument.deflections(aim, pointing)
    return recorder.signals(light, shots) | {"theta_read_rad": read.theta, "phi_read_rad": read.phi}


def _where(scenario: Scenario, aim: Aim) -> dict[str, NDArray[Any]]:
    """Return the columns that say which voxels these are."""
    row, column = np.divmod(aim.shot.astype(np.int64), scenario.raster.columns)
    return {
        "row": row.astype(np.int32),
        "column": column.astype(np.int32),
        "theta_rad": aim.theta,
        "phi_rad": aim.phi,
    }
