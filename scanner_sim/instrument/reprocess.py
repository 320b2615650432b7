"""Other noise and other ranges of light that was kept, without the scene.

Lines and waveforms of a run hold their light before speckle and noise. Whatever comes after it (speckle, noise, the
encoders' readings, processing, what neighbours say) is made again by the kernels of a run, so that the numbers are
those of a whole run with the same values. What comes before it cannot change: the errors of the mirrors, too, move the
light. With another seed the scenario therefore has ``transport.light_seed``, the seed that the light was made with.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config import scenario_from_text
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.photodiode.photodiode import Photodiode
from scanner_sim.foundation.channels import CHANNEL
from scanner_sim.foundation.errors import Fault, InputError, ScenarioError
from scanner_sim.foundation.named_files import read_text_file
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.signal_records import RECORDERS, SignalRecorder, about_of, drawn
from scanner_sim.instrument.simulate import Progress, image_of
from scanner_sim.instrument.simulate_signals import voxel_shots
from scanner_sim.products.files.contents import LINES, WAVEFORMS
from scanner_sim.products.files.signal_files import read_columns, read_signals_about, voxels_together
from scanner_sim.products.image import RangeImage
from scanner_sim.products.lines import LineSet
from scanner_sim.products.signal_set import WHERE, SignalAbout, SignalSet
from scanner_sim.products.waveforms import WaveformSet
from scanner_sim.ranging.ranges import Layers
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.raster import raster_aim
from scanner_sim.scene.labels import LabelTable
from scanner_sim.scene.objects import Scene

_FILES = {"triangulation": LINES, "tof": WAVEFORMS}
_KINDS: Mapping[str, type[SignalSet]] = {"triangulation": LineSet, "tof": WaveformSet}
_SENSOR = (
    "quantum_efficiency",
    "full_well",
    "read_noise",
    "dark_current",
    "prnu",
    "adc_bits",
    "gain",
    "bias",
    "noise",
)
_DIODE = ("response", "field_of_view", "place")
"""Keys of the position sensor that act on light which is kept, and those of the photodiode that change it."""
AFTER_LIGHT = (
    "seed",
    "transport.light_seed",
    "transport.background_seed",
    "processing",
    "output.pictures",
    "output.points",
    "output.formats",
    "output.compression",
    "output.jacobian",
    "scanner.laser.speckle",
    "scanner.mirrors.readout_noise",
    "scanner.mirrors.readout_step",
    *(f"scanner.position_sensor.{key}" for key in _SENSOR),
    "scanner.lidar.pulse",
    "scanner.lidar.digitiser",
    *(f"scanner.lidar.photodiode.{key}" for key in Photodiode.model_fields if key not in _DIODE),
)
"""Keys, and blocks of keys, that act on light which is kept; of the seeds those that leave the light as it is."""
_KEEPING = ("output.lines", "output.waveforms")
"""Keys by which signals are kept; they may be left out where there is an image to make of all of them."""


@dataclass(frozen=True)
class KeptSignals:
    """The lines and waveforms in the folder of a run.

    Attributes
    ----------
    folder
        The folder.
    scenario
        The scenario that made them.
    about
        What is said of the file of each rangefinder.
    """

    folder: Path
    scenario: Scenario
    about: Mapping[str, SignalAbout]

    @classmethod
    def find(cls, folder: Path) -> KeptSignals:
        """Look what a folder holds.

        Raises
        ------
        InputError
            If there is nothing, it is damaged or of another version, or it does not belong together.
        """
        about = {
            name: read_signals_about(folder / file, _KINDS[name])
            for name, file in _FILES.items()
            if (folder / file).exists()
        }
        if not about:
            raise InputError(
                f"There are no lines or waveforms in {folder}.",
                remedy="Run its scenario with output.lines: all, or output.waveforms: all.",
            )
        text = next(iter(about.values())).scenario
        beside = folder / "scenario.yaml"
        others = [said.scenario for said in about.values()]
        if beside.exists():
            others.append(beside.read_bytes().decode("utf-8", "replace"))
        if any(other != text for other in others):
            files = ", ".join(
                [*(_FILES[name] for name in about), *(["scenario.yaml"] if beside.exists() else [])]
            )
            raise InputError(
                f"{files} in {folder} are of different scenarios.", remedy="Run the scenario again."
            )
        return cls(folder, scenario_from_text(text, name=str(folder), stored=True), about)

    def scene_warnings(self) -> tuple[str, ...]:
        """Return what the run said of its scene; nothing where its summary is gone."""
        try:
            said = json.loads(read_text_file(self.folder / "summary.json"))["warnings"]
        except (InputError, ValueError, KeyError, TypeError, RecursionError):
            return ()
        return (
            tuple(one for one in said if isinstance(one, str) and one.startswith("scene: ")) if said else ()
        )

    @property
    def whole(self) -> bool:
        """Whether all voxels of the raster are kept, of every rangefinder: only then neighbours can judge."""
        return all(name in self.about and self._chosen(name) is None for name in self.scenario.rangefinders)

    def _chosen(self, name: str) -> Any:
        output = self.scenario.output
        chosen = output.lines if name == "triangulation" else output.waveforms
        return None if chosen == "all" else chosen

    def changed(self, overrides: Sequence[str]) -> Scenario:
        """Return the scenario with other values, as KEY=VALUE; where the seed is another, with that of the light.

        Raises
        ------
        ScenarioError
            If a value is wrong, or its key changes the light.
        """
        old = self.scenario
        name = f"{self.folder} with other values"
        new = scenario_from_text(next(iter(self.about.values())).scenario, name=name, overrides=overrides)
        if new.seed != old.seed and new.transport.light_seed is None:
            light = {"light_seed": old.transport.seed_of_light(old.seed)}
            new = new.model_copy(update={"transport": new.transport.model_copy(update=light)})
        left_out = [
            key for key in _KEEPING if self.whole and getattr(new.output, key.split(".")[1]) == "none"
        ]
        # Of the truth less may be asked for, for some of it is not kept.
        if set(new.output.truth) <= set(old.output.truth):
            left_out.append("output.truth")
        keys = [key for key in changed_keys(old, new) if key not in left_out]
        faults = [_refusal(key, self.folder) for key in keys if not _acts_after_light(key)]
        for key in ("seed_of_light", "seed_of_background"):
            if getattr(new.transport, key)(new.seed) != getattr(old.transport, key)(old.seed):
                faults.append(_refusal(f"transport.{key.removeprefix('seed_of_')}_seed", self.folder))
        if self.whole and not {"point", "normal", "incidence"}.isdisjoint(new.output.truth):
            problem = "true points, normals and incidence are not kept with the light."
            faults.append(
                Fault("output.truth", problem, "Add --set output.truth=[], or run the scenario again.")
            )
        if faults:
            raise ScenarioError(faults, source=name)
        return new

    def columns(
        self, scenario: Scenario, recorders: Mapping[str, SignalRecorder]
    ) -> Iterator[tuple[NDArray[np.uint32], dict[str, dict[str, NDArray[Any]]]]]:
        """Yield the numbers of shots and the columns of their light for each recorder, a few thousand together.

        Raises
        ------
        InputError
            If a file is damaged, or has other voxels than its scenario.
        """
        together = min(voxels_together(recorder.samples) for recorder in recorders.values())
        chosen = {name: voxel_shots(scenario, self._chosen(name)) for name in recorders}
        count = {name: len(shots) for name, shots in chosen.items()}
        names = {
            name: {*recorder.kept, *(each.name for each in WHERE)} for name, recorder in recorders.items()
        }
        files = {
            name: read_columns(self.folder / _FILES[name], recorder.kind, names[name], together)
            for name, recorder in recorders.items()
        }
        for start in range(0, max(count.values()), together):
            found, shots = {}, next(iter(chosen.values()))[start : start + together]
            for name, recorder in recorders.items():
                found[name] = next(files[name], {})
                self._check(name, found[name], shots, scenario, recorder)
            yield shots, found
        for name, rest in files.items():
            if next(rest, None) is not None:
                raise self._other_voxels(name)

    def _other_voxels(self, name: str) -> InputError:
        return InputError(
            f"{self.folder / _FILES[name]} has other voxels than its scenario asks for: a part may be missing.",
            remedy="Run the scenario again.",
        )

    def _check(
        self,
        name: str,
        part: Mapping[str, NDArray[Any]],
        shots: NDArray[np.uint32],
        scenario: Scenario,
        recorder: SignalRecorder,
    ) -> None:
        """Raise an InputError where columns cannot be of the shots of a scenario."""
        if not part or not np.array_equal(
            part["row"].astype(np.int64) * scenario.raster.columns + part["column"], shots
        ):
            raise self._other_voxels(name)
        path, lit = self.folder / _FILES[name], not scenario.lighting.sky().dark
        problem = ""
        about = self.about[name]
        if name == "triangulation":
            pixels = part["laser_w"].shape[1]
            if pixels != scenario.scanner.position_sensor.pixels or ("background_w" in part) != lit:
                problem = f"its lines have {pixels} pixels, or the background is missing"
        for column in recorder.kept:
            if column in part and not column.startswith("truth.") and not (np.abs(part[column]) < 1e30).all():
                problem = f"the column {column} holds something else than finite numbers"
        for column, names in (("truth.object", about.objects), ("truth.material", about.materials)):
            if ((part[column] < 0) | (part[column] > len(names))).any():
                problem = f"the column {column} has numbers without a name"
        if problem:
            raise InputError(f"{path} is damaged: {problem}.", remedy="Run the scenario again.")


class Reprocessing:
    """Makes other noise and ranges of kept lines and waveforms.

    Parameters
    ----------
    kept
        Where they are.
    scenario
        From :meth:`KeptSignals.changed`.
    device
        Where to compute.
    """

    def __init__(self, kept: KeptSignals, scenario: Scenario, *, device: DeviceChoice = "auto") -> None:
        self.kept, self.scenario = kept, scenario
        with guest():
            # The light is there already: what stands before the instrument does not matter.
            self.instrument = Instrument(scenario.model_copy(update={"scene": Scene()}), device=device)
        about = next(iter(kept.about.values()))
        # Its truth has the numbers of results already.
        self.instrument.loaded = replace(
            self.instrument.loaded,
            object_labels=LabelTable.same(about.objects),
            material_labels=LabelTable.same(about.materials),
        )
        self.recorders: dict[str, SignalRecorder] = {
            name: RECORDERS[name](self.instrument) for name in kept.about
        }

    def image(self, progress: Progress | None = None) -> RangeImage:
        """Return the range image of a raster all of whose voxels are kept."""
        scenario, shots = self.scenario, self.scenario.raster.shots
        layers: Layers = {}
        with guest():
            used: dict[str, SignalRecorder] = {name: self.recorders[name] for name in scenario.rangefinders}
            for numbers, light in self.kept.columns(scenario, used):
                aim = raster_aim(scenario.raster, numbers, scenario.scanner.dwell)
                fired, pointing = self.instrument.fire(aim)
                deflections = self.instrument.deflections(aim, pointing)
                found = [recorder.reading(light[name], fired, deflections) for name, recorder in used.items()]
                samples = self.instrument.samples(aim, pointing, deflections, found)
                for name in [name for name in samples if name in CHANNEL]:
                    layers.setdefault(name, np.empty(shots, dtype=np.float32))[numbers] = samples[name]
                if progress is not None:
                    progress(int(numbers[-1]) + 1, shots)
            about = next(iter(self.kept.about.values()))
            said = self.kept.scene_warnings()
            return image_of(scenario, layers, about.objects, about.materials, said=said)

    def parts(self, name: str) -> Iterator[SignalSet] | None:
        """Return the lines or waveforms of a rangefinder with other noise, part by part; None where none are wanted."""
        output = self.scenario.output
        chosen = output.lines if name == "triangulation" else output.waveforms
        return None if chosen == "none" else self._parts(name)

    def _parts(self, name: str) -> Iterator[SignalSet]:
        recorder, scenario = self.recorders[name], self.scenario
        said = self.kept.about[name]
        about = about_of(scenario, recorder, said.objects, said.materials)
        with guest():
            for numbers, light in self.kept.columns(scenario, {name: recorder}):
                aim = raster_aim(scenario.raster, numbers, scenario.scanner.dwell)
                columns = light[name] | drawn(self.instrument, recorder, aim, light[name])
                yield recorder.kind(columns, about)


def changed_keys(old: Scenario, new: Scenario) -> list[str]:
    """Return the keys whose values differ."""
    before, after = (dict(_leaves(each.model_dump(mode="json", by_alias=True))) for each in (old, new))
    return [key for key in {**before, **after} if before.get(key) != after.get(key)]


def _leaves(data: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in data.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _acts_after_light(key: str) -> bool:
    return any(key == known or key.startswith(f"{known}.") for known in AFTER_LIGHT)


def _refusal(key: str, folder: Path) -> Fault:
    return Fault(
        key,
        "it is no key of detector or processing: it changes the light, which is kept as it was.",
        f"Run the scenario again: scanner-sim run {folder / 'scenario.yaml'} --set {key}=… -o DIR.",
    )
