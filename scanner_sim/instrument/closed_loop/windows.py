"""The background of patterns: windows of panoramas, rendered where a pattern's pixels look and kept while they hold.

The angles (Θ − atan(p/f), φ) that pixels see form a lattice: bins of a pixel along it, rows of half a pixel's height. A
window is a part of it about a pattern, widened to multiples of a few bins, so that the next patterns of the same target
fall into the same one. While objects move it is rendered anew for each time slot, whose length is a power of two in
which the fastest of them moves by one bin at most: for its middle; and whenever the sky is another one. Which window
a pattern sees depends on its aim and its situation alone, never on what was measured before.

Approximations: objects stand still for a slot, at most half a bin away from where they are (those faster than a bin in
1/64 s are farther: no slot is shorter); two rows are interpolated; sharp light has 16 samples a bin everywhere, where a
raster's has 4 to 48, and 8 where objects move; smooth light then has 2; and what
:mod:`scanner_sim.render.background.panorama` leaves out.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from functools import cached_property
from typing import TypeAlias

import numpy as np

from scanner_sim.foundation.device_streams import device_seeds
from scanner_sim.foundation.device_types import Float, UInt64
from scanner_sim.instrument.closed_loop.situation import Situation
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.time_slots import TimeSlots, middle
from scanner_sim.render.background.panorama import Panorama, render_panorama
from scanner_sim.render.background.sky import SkyLight, light_of
from scanner_sim.render.background.view import (
    Window,
    WindowsBeside,
    join_windows,
    row_spacing,
    window_heights,
    window_position,
)
from scanner_sim.render.frozen import Frozen
from scanner_sim.render.rays import one_kernel, pose_scene
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scan.protocol import Aim
from scanner_sim.scene.files.loader import Pose, packed_poses, poses_from
from scanner_sim.scene.light.lighting import Sky
from scanner_sim.scene.objects import Posed

_SHIFT_BINS = 8
"""Bins by which windows are shifted."""
_BINS_TOGETHER, _ROWS_TOGETHER = 64, 16
"""Sizes of windows are multiples of them: few sizes make few kernels."""
_SHARP_SAMPLES = {False: 8, True: 4}
"""Samples of the sharp light of each bin, in each half: where all rests, and where something moves."""
_MOVING_SAMPLES = 2
"""Long paths of each bin where something moves: windows are then wanted again and again."""
_MOST_WINDOWS = 16
"""Windows that are kept."""
Key = tuple[int, int, int, int, bytes, Sky]
WindowArrays: TypeAlias = list[Float]
"""What kernels need of the windows of patterns: first angles, rows, bins and starts, by pattern, and the layers."""
_MOST_COMPANIES = 8
"""Companies of windows that are kept joined."""


class Windows:
    """The windows of a sensor before a scene under the Sun.

    Parameters
    ----------
    instrument
        Instrument, scene and lighting.
    optics
        The optics whose pixels are a window's bins.
    seen
        Least and largest angle less Θ that the sensor sees [rad].
    like
        Windows of another run before the same scene under the same light, whose kernels serve these too.
    """

    def __init__(
        self,
        instrument: Instrument,
        optics: OpticalLayout,
        seen: tuple[float, float],
        like: Windows | None = None,
    ) -> None:
        self._instrument, self._optics, self._seen = instrument, optics, seen
        self.step = optics.pitch / optics.receiver.focal_length
        self.row_step = row_spacing(optics)
        self._kept: OrderedDict[Key, list[Float]] = OrderedDict()
        self._joined: OrderedDict[Company, WindowArrays] = OrderedDict()
        self.first: Windows = self if like is None else like.first
        self._renderers: dict[tuple[int, int], Frozen] = {} if like is None else like._renderers
        self._slots = TimeSlots(instrument.loaded, self.step)
        self._lights: tuple[Sky, SkyLight] | None = None
        self.rendered = 0

    def panorama(self, parts: WindowArrays, shots: int) -> Panorama:
        """Return the panorama of what :func:`seen_by` returned, for patterns of so many shots."""
        first, phi, rows, bins, start, *layers = parts
        windows = WindowsBeside(first, phi, rows, bins, self.step, self.row_step, start=start, shots=shots)
        return Panorama(windows, *layers)

    def layers(self, key: Key) -> list[Float]:
        """Return the layers of a window's panorama, rendered when they are first asked for."""
        if key in self._kept:
            self._kept.move_to_end(key)
        else:
            self._kept[key] = self._render(*key)
            self.rendered += 1
            if len(self._kept) > _MOST_WINDOWS:
                self._kept.popitem(last=False)
        return self._kept[key]

    def key(self, aim: Aim, situation: Situation) -> Key:
        """Return first bin, bins, first row, rows, the objects' poses in single precision and the sky of a window."""
        reach = 0.5 * np.abs(aim.travel_theta), 0.5 * np.abs(aim.travel_phi)
        left = float((aim.theta - reach[0]).min()) + self._seen[0]
        right = float((aim.theta + reach[0]).max()) + self._seen[1]
        first, bins = _span(left, right, self.step, _SHIFT_BINS, _BINS_TOGETHER)
        top, bottom = float((aim.phi - reach[1]).min()), float((aim.phi + reach[1]).max())
        first_row, rows = _span(top, bottom, self.row_step, 1, _ROWS_TOGETHER)
        poses = self._poses(0.5 * float(aim.time[0] + aim.time[-1]), situation.background)
        return (first, bins, first_row, rows, poses, situation.sky)

    def _poses(self, time: float, items: tuple[Posed, ...]) -> bytes:
        """Return the poses of moving objects in the middle of the time slot of a moment [s], packed."""
        if not items:
            return b""
        if self._slots.items is not items:
            self._slots = TimeSlots(self._instrument.loaded, self.step, items)
        at = middle(self._slots.at(time))
        return packed_poses([item.pose_at(at) for item in items]).tobytes()

    def join(self, company: Company) -> WindowArrays:
        """Return the windows of patterns side by side, each of this sensor in its own run."""
        if company in self._joined:
            self._joined.move_to_end(company)
            return self._joined[company]
        positions = [
            (first * self.step, row * self.row_step, rows, bins)
            for _, (first, bins, row, rows, *_) in company
        ]
        self._joined[company] = join_windows(positions, [own.layers(key) for own, key in company])
        if len(self._joined) > _MOST_COMPANIES:
            self._joined.popitem(last=False)
        return self._joined[company]

    @cached_property
    def _heights(self) -> Float:
        return window_heights(self._optics, self.row_step)

    def _light(self, sky: Sky) -> SkyLight:
        """Return the light of a sky, which serves many windows."""
        if self._lights is None or self._lights[0] is not sky:
            self._lights = sky, light_of(sky)
        return self._lights[1]

    def _render(
        self, first: int, bins: int, first_row: int, rows: int, packed: bytes, sky: Sky
    ) -> list[Float]:
        loaded = self._instrument.loaded
        reads = [
            loaded.mitsuba,
            *(body.mitsuba for body in loaded.bodies),
            loaded.object_of,
            loaded.material_of,
            loaded.out_of_band_ratio,
            loaded.dark_in_band,
            self.first._heights,
        ]
        corner = window_position(first * self.step, first_row * self.row_step)
        poses = poses_from(np.frombuffer(packed, dtype=np.float32), len(loaded.bodies))
        scenario = self._instrument.scenario
        seed = device_seeds([scenario.transport.seed_of_background(scenario.seed)])
        return list(self._renderer(rows, bins)(reads, self._light(sky), corner, poses, seed))

    def _renderer(self, rows: int, bins: int) -> Frozen:
        """Return the frozen kernels that render windows of a size."""
        if (rows, bins) not in self._renderers:
            # Loops that a GPU runs turn by turn cannot be recorded.
            self._renderers[rows, bins] = Frozen(
                lambda reads, light, corner, poses, seed: self.first._layers(
                    light, corner, poses, seed, rows, bins
                ),
                enabled=one_kernel(self._instrument.loaded),
            )
        return self._renderers[rows, bins]

    def _layers(
        self,
        light: SkyLight,
        corner: list[Float],
        poses: tuple[Pose, ...],
        seed: UInt64,
        rows: int,
        bins: int,
    ) -> list[Float]:
        """Return the layers of a panorama over a window."""
        scenario, moving = self._instrument.scenario, bool(self._instrument.loaded.bodies)
        settings = scenario.transport
        found = render_panorama(
            pose_scene(self._instrument.loaded, poses),
            self._optics,
            light,
            Window(corner[0], corner[1], rows, bins, self.step, self.row_step, self._heights),
            bounces=settings.background_bounces,
            samples=_MOVING_SAMPLES if moving else settings.background_samples,
            seed=seed,
            sharp_samples=_SHARP_SAMPLES[moving],
        )
        return [found.in_band, found.out_of_band, found.error, found.error_out]


Company: TypeAlias = tuple[tuple[Windows, Key], ...]
"""The window of each pattern of a launch, with the run's windows to which it belongs."""


def seen_by(windows: Sequence[Windows], aims: Sequence[Aim], situations: Sequence[Situation]) -> WindowArrays:
    """Return what kernels need of the windows of patterns, for :meth:`Windows.panorama`.

    ``windows`` of one sensor in the run of each pattern, and ``aims`` and ``situations`` of these.
    """
    each = zip(windows, aims, situations, strict=True)
    return windows[0].first.join(tuple((own, own.key(aim, situation)) for own, aim, situation in each))


def _span(low: float, high: float, step: float, quantum: int, together: int) -> tuple[int, int]:
    """Return the first of the steps of a lattice that cover a span with one more at each end, and their number."""
    first = math.floor((low / step - 1.0) / quantum) * quantum
    last = math.ceil(high / step + 1.0)
    return first, math.ceil((last - first + 1) / together) * together
