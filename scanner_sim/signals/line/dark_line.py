"""Lines that nothing but the laser lights: the pixels that can matter are exposed, and read by kernels traced once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.detector.line.exposure import Signal, Window, unlit_numbers
from scanner_sim.detector.line.position_sensor import PositionSensor
from scanner_sim.foundation.device_types import Float
from scanner_sim.render.frozen import Frozen
from scanner_sim.signals.line.bias import Bias
from scanner_sim.signals.line.calibration import SensorCalibration
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.peaks import Peaks, find_peaks
from scanner_sim.signals.line.speckle import ExpectedSpeckle
from scanner_sim.signals.line.window import NoisePeak
from scanner_sim.signals.processing import Processing

Exposure = Callable[[Window, "Signal | None"], Signal]
"""Exposes windows of lines, into the memory of a signal if there is one."""
White = tuple[Float, Float, Float]
"""The light of a white surface, as of :class:`~scanner_sim.signals.line.expected.ExpectedSpot`, Dr.Jit."""


class DarkLine:
    """Exposes and reads lines that nothing but the laser lights.

    Parameters
    ----------
    noise
        The highest peak of pixels without light.
    calibration, sensor, processing, dwell, spot, bias
        What :func:`~scanner_sim.signals.line.peaks.find_peaks` knows, but the laser's power: the light of a white
        surface is told with each group of lines.
    """

    def __init__(
        self,
        noise: NoisePeak,
        calibration: SensorCalibration,
        sensor: PositionSensor,
        processing: Processing,
        dwell: float,
        spot: ExpectedSpot,
        bias: Bias | None,
    ) -> None:
        self._noise, self._calibration, self._processing, self._spot = noise, calibration, processing, spot
        self._reads = [] if bias is None else [bias.values]

        def find(
            number: Float, window: Window, theta: Float, speckle: ExpectedSpeckle | None, white: White
        ) -> Peaks:
            signal, known = (
                Signal(number, dr.width(theta), sensor.pixels, window=window),
                spot.lit(*white),
            )
            return find_peaks(signal, sensor, processing, dwell, known, theta, bias, speckle, noise)

        self._find = find
        self._frozen: dict[ExpectedSpeckle | None, Frozen] = {}

    @classmethod
    def of(
        cls,
        sensor: PositionSensor,
        processing: Processing,
        dwell: float,
        spot: ExpectedSpot,
        bias: Bias | None,
    ) -> DarkLine | None:
        """Return it, or None where all pixels count: where the brightest one is asked for, or noise fills one."""
        calibration, numbers = SensorCalibration.of(sensor, dwell), unlit_numbers(sensor, dwell)
        filled = calibration.charge(numbers[1]) + calibration.dark >= calibration.full
        if filled or not processing.validation.background:
            return None
        noise = NoisePeak.of(numbers, calibration)
        return cls(noise, calibration, sensor, processing, dwell, spot, bias)

    def read(
        self,
        expose: Exposure,
        light: tuple[Float, Float, Float],
        theta: Float,
        speckle: ExpectedSpeckle | None,
        white: White,
    ) -> tuple[Signal, Peaks]:
        """Return what was exposed of the lines of m shots, and their peaks.

        Parameters
        ----------
        expose
            Exposes them.
        light
            As of :meth:`~scanner_sim.signals.line.window.NoisePeak.windows`.
        theta
            Commanded deflections Θ [rad], shape (m,).
        speckle
            What is known of the laser's speckle; None without.
        white
            The light of a white surface, and the sweep (:meth:`~scanner_sim.signals.line.expected.ExpectedSpot.lit`).
        """
        deflection = auto.Float(theta)
        dr.eval(deflection, white)
        known = self._spot.lit(*white)
        windows = self._noise.windows(light, known, self._processing, self._calibration, deflection)
        signal = expose(windows[0], None)
        peaks = self._peaks(signal, deflection, speckle, white)
        signal = expose(windows[1].where(~peaks.settled), signal)
        return signal, peaks.settled_by(self._peaks(signal, deflection, speckle, white))

    def _peaks(self, signal: Signal, theta: Float, speckle: ExpectedSpeckle | None, white: White) -> Peaks:
        """Return the peaks, by kernels that are traced for the first group of shots and serve all others."""
        known = None if speckle is None else replace(speckle, travel=(0.0, 0.0))
        # As arrays: what kernels are traced with is the same for all scans then.
        travel = [
            dr.opaque(auto.Float, way) if isinstance(way, float) else way
            for way in ([] if speckle is None else speckle.travel)
        ]
        if known not in self._frozen:
            self._frozen[known] = Frozen(
                lambda reads, number, window, theta, travel, white: self._find(
                    number, window, theta, None if known is None else replace(known, travel=travel), white
                )
            )
        peaks: Peaks = self._frozen[known](self._reads, signal.number, signal.window, theta, travel, white)
        return peaks


def dark_line(
    sensor: PositionSensor, processing: Processing, dwell: float, spot: ExpectedSpot, bias: Bias | None
) -> DarkLine | None:
    """Return the same as :meth:`DarkLine.of`, traced once for all instruments that know the same of their lines."""
    return _traced(auto.Float, sensor, processing, dwell, spot.lit(0.0, 0.0), bias)


@lru_cache(maxsize=8)
def _traced(kind: Any, *known: Any) -> DarkLine | None:  # noqa: ARG001 (arrays of another device are of no use)
    return DarkLine.of(*known)
