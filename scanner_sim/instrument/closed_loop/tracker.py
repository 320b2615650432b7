"""The closed loop: mirrors, voxels, centroid, tracker, visit after visit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from scanner_sim.config import resolved_yaml, scenario_from_text
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop.raster_between import between_visits
from scanner_sim.instrument.closed_loop.saved_state import TrackerState, load_state, save_state
from scanner_sim.instrument.closed_loop.start import start_of
from scanner_sim.instrument.closed_loop.told import check_knowledge, with_light, with_move
from scanner_sim.instrument.closed_loop.visits import Visits, with_track
from scanner_sim.instrument.closed_loop.whole_track import made_by, track_of
from scanner_sim.products.image import RangeImage
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scene.motion import LATEST
from scanner_sim.tracking.record import PatternRecord, Track, is_place
from scanner_sim.tracking.state import TrackState, init, pointed


class Tracker:
    """A tracking run that is made visit by visit: an iterator of :class:`~scanner_sim.tracking.record.PatternRecord`.

    Commands between two visits change what comes next. ``state`` is immutable: with it and ``scenario`` a run can be
    saved, continued and repeated, and what follows is the same to the last bit, whatever the number of threads.

    Parameters
    ----------
    scenario
        Instrument, scene and a scan of type ``track``.
    device, threads
        Where to compute.
    state
        Where to go on; None begins.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used, or the scenario scans a raster.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        device: DeviceChoice = "auto",
        threads: int | None = None,
        state: TrackerState | None = None,
    ) -> None:
        self.scenario, self._scan, self.targets = scenario, scenario.following, scenario.targets
        self.state = start_of(scenario, device) if state is None else state
        if len(self.state.tracks) != len(self.targets):
            raise InputError(
                f"the state tells of {len(self.state.tracks)} targets, and the scenario follows {len(self.targets)}.",
                remedy="Go on with the scenario that the state was saved with.",
            )
        self._visits = Visits((scenario,), device=device, threads=threads)

    @classmethod
    def resume(
        cls, file: str | Path, *, device: DeviceChoice = "auto", threads: int | None = None
    ) -> Tracker:
        """Return the run that a file of :meth:`save` holds, to be continued.

        Raises
        ------
        InputError, ScenarioError
            If the file cannot be read, or its scenario no longer can (meshes may have gone).
        """
        state, text = load_state(Path(file))
        scenario = scenario_from_text(text, name=str(file))
        return cls(scenario, device=device, threads=threads, state=state)

    def save(self, file: str | Path) -> None:
        """Write the scenario and the state between two visits, for :meth:`resume`.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        save_state(Path(file), self.state, self.scenario_yaml, made_by())

    @property
    def scenario_yaml(self) -> str:
        """The resolved scenario, with all moves and changes of the light so far."""
        return resolved_yaml(self.scenario)

    @property
    def time(self) -> float:
        """Until when everything is measured [s]: what is told of the world holds from then on."""
        return self.state.clock

    @property
    def finished(self) -> bool:
        """Whether the next pattern would begin after the scan's duration, or nothing is followed any more."""
        return self._visits.finished(self.state)

    def __iter__(self) -> Iterator[PatternRecord]:
        """Iterate over the visits that are left."""
        return self

    def __next__(self) -> PatternRecord:
        """Make the next visit."""
        if self.finished:
            raise StopIteration
        record, self.state = self.visit(self.state)
        return record

    def look_ahead(self) -> bool:
        """Do a part of the next visit that nothing told of the world changes; return whether one was left to do.

        For whoever waits for a controller: order, mirrors and encoders do not depend on its moves, and the next visit
        takes up what is done. After a command that changes the state they are made again. No result depends on it.
        """
        return self._visits.look_ahead(self.state)

    def search(self, target: str) -> None:
        """Search for a target where it is expected, whatever was known of it, and follow it from then on."""
        index = self._index(target)
        track = init(self.state.tracks[index].expected, self._scan.tracker, self.state.clock)
        self._set(index, track=replace(track, patterns=self.state.tracks[index].patterns), followed=True)

    def point(
        self,
        target: str,
        theta: float,
        phi: float,
        distance: float,
        *,
        rates: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
    ) -> None:
        """Expect a target at Θ, φ [rad] and a range [m], and search for it there.

        Parameters
        ----------
        target
            Its name.
        theta, phi, distance
            Where it is at :attr:`time`.
        rates
            Of these three, per second, shape (3,): it is then looked for where it goes, and followed so once it is
            found where they and the covariance allow.
        covariance
            Of (Θ, φ, R), shape (3, 3), or with the rates, shape (6, 6): patterns reach three standard deviations.

        Raises
        ------
        InputError
            If these are no angles of a beam or no range of a target, or there is no such target.
        """
        index = self._index(target)
        position = np.array([theta, phi, distance], dtype=np.float64)
        if not is_place(position):
            raise InputError(
                f"({theta}, {phi}, {distance}) is no place.", remedy="Name two angles and a range."
            )
        check_knowledge(rates, covariance)
        track = pointed(position, self._scan.tracker, self.state.clock, rates, covariance)
        self._set(index, track=replace(track, patterns=self.state.tracks[index].patterns), followed=True)

    def wait(self, time: float) -> None:
        """Let the clock go on to a time [s] without a visit; the mirrors come to rest.

        Raises
        ------
        InputError
            If the time is past, or beyond all times of a run.
        """
        if time > LATEST:
            raise InputError(f"{time:.9g} s is too late.", remedy=f"A run may last for {LATEST:g} s.")
        if not time >= self.time:
            raise InputError(f"{time:.9g} s is before {self.time:.9g} s.", remedy="Time goes on only.")
        self.state = replace(self.state, clock=float(time))

    def scan(
        self,
        rows: int,
        columns: int,
        horizontal: tuple[float, float],
        vertical: tuple[float, float],
        *,
        layers: Sequence[str] | None = None,
    ) -> RangeImage:
        """Measure a raster between two visits: its voxels take their time, and the clock goes on by it.

        Parameters
        ----------
        rows, columns
            Voxels.
        horizontal, vertical
            First and last Θ and φ [rad].
        layers
            Names of the layers that are kept, beside ``status``; None keeps all.

        Returns
        -------
        RangeImage
            Ranges, points and σ, as of :func:`~scanner_sim.instrument.simulate.simulate`.

        Raises
        ------
        InputError
            If there is no such raster or layer, or the mirrors cannot reach it; the clock stays then.
        """
        asked = between_visits(self.scenario, rows, columns, horizontal, vertical)
        image, after = self._visits.scan(asked, self.scenario, self.state)
        kept = image if layers is None else image.keeping(layers)
        self.state = after
        return kept

    def drop(self, target: str) -> None:
        """Visit a target no more; :meth:`search` takes it up again."""
        self._set(self._index(target), followed=False)

    def amplitude(self, target: str, amplitude: float | None) -> None:
        """Run a target's patterns with an amplitude [rad]; None leaves it to the tracker again.

        Raises
        ------
        InputError
            If the amplitude is not between 0 and 1.5 rad, or there is no such target.
        """
        index = self._index(target)
        if amplitude is not None and not 0.0 < amplitude < 1.5:
            raise InputError(f"{amplitude} is no amplitude.", remedy="Name one between 0 and 1.5 rad.")
        amplitudes = list(self.state.amplitudes)
        amplitudes[index] = amplitude
        self.state = replace(self.state, amplitudes=tuple(amplitudes))

    def move(
        self,
        name: str,
        pose: ArrayLike,
        *,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        turn_rate: ArrayLike = (0.0, 0.0, 0.0),
        time: float | None = None,
    ) -> None:
        """Tell where an object is and how it moves; it goes on evenly until it is told again.

        Parameters
        ----------
        name
            An object of the scene with a ``motion``, of which ``{type: twist}`` will do.
        pose
            ``scanner_from_object``, shape (4, 4); of what is fixed to another object ``parent_from_object``.
        velocity, turn_rate
            Of the object's origin [m/s] and about it [rad/s], shape (3,), along the axes in which the pose is given.
        time
            From when on [s]: :attr:`time` or later, by default that.

        Raises
        ------
        InputError
            If there is no such object, it has no motion, the numbers are no state, or the time is past.

        Notes
        -----
        Within a visit x = x₀ + v t and R = exp([ω t]×) R₀. Truth and laser follow at once; the background follows in
        steps of a quarter of a bin (:mod:`scanner_sim.instrument.closed_loop.situation`). The move becomes part of
        :attr:`scenario`: it is saved, and :func:`~scanner_sim.instrument.closed_loop.track.track` of that scenario
        makes the same run where nothing but moves and light was commanded.
        """
        changed = with_move(
            self.scenario, name, pose, velocity=velocity, turn_rate=turn_rate, time=time, clock=self.time
        )
        self.follow(changed)

    def light(
        self,
        *,
        sun: ArrayLike | None = None,
        earth: ArrayLike | None = None,
        visible: float | None = None,
        time: float | None = None,
    ) -> None:
        """Tell where Sun and Earth stand, and what of the Sun's light arrives; it holds until it is told again.

        Parameters
        ----------
        sun, earth
            Directions from the scene, in the scanner's frame, of any length, shape (3,); None leaves them where the
            scenario has them, by an orbit's clock if there is one.
        visible
            Share of the Sun's light that arrives, 0 in an eclipse; None leaves it to the Earth's disc, which counts
            as well where it hides more.
        time
            As of :meth:`move`.

        Raises
        ------
        InputError
            If the scenario has no Sun, the numbers are none of a light, or the time is past.

        Notes
        -----
        Light that is in use stays until a direction differs by half a milliradian or the share by 0.5 %
        (:mod:`scanner_sim.scene.light.clock`).
        """
        self.follow(
            with_light(self.scenario, sun=sun, earth=earth, visible=visible, time=time, clock=self.time)
        )

    def follow(self, scenario: Scenario) -> None:
        """Go on with :attr:`scenario` of which more was told (:mod:`scanner_sim.instrument.closed_loop.told`)."""
        self._visits.follow(scenario)
        self.scenario = scenario

    def track(self, records: Iterable[PatternRecord]) -> Track:
        """Return the run that records of this tracker make up, with all that was told of the world."""
        said = (*self._visits.said[0], *self.state.said)
        return track_of(self.scenario, tuple(records), self._visits.axes, said)

    def visit(self, state: TrackerState) -> tuple[PatternRecord, TrackerState]:
        """Return the next visit after a state, and the state after it: a function of the state and of what was told.

        Raises
        ------
        InputError
            If no target is followed.
        """
        (made,) = self._visits.after([state], [0])
        return made

    def _index(self, target: str) -> int:
        for index, known in enumerate(self.targets):
            if known.name == target:
                return index
        names = ", ".join(known.name for known in self.targets)
        raise InputError(f"there is no target '{target}'.", remedy=f"The targets: {names}.")

    def _set(self, index: int, *, followed: bool, track: TrackState | None = None) -> None:
        """Change what is remembered of a target, and whether it is visited."""
        state = self.state if track is None else with_track(self.state, index, track)
        visited = list(state.followed)
        visited[index] = followed
        self.state = replace(state, followed=tuple(visited))
