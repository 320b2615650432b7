"""Experiments on pulsed ranging: walk, noise at a given signal, reflectance, incidence, intensity."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.validation.reproduce.bench import Array, aim, bench, grid, layers_of, plate, slope
from scanner_sim.validation.reproduce.drawing import BLUE, COLOURS, GREEN, RED, logarithms, sheet
from scanner_sim.validation.reproduce.family.judging import Finding, Measured
from scanner_sim.validation.reproduce.item import Task, row_of_claim

_HALF = 0.01
"""Half the field over which the shots of a plate are spread [rad]."""
_TO_SIGMA = 1.0 / (2.0 * math.sqrt(2.0 * math.log(2.0)))


class _Shots:
    """Ranges of one plate by time of flight."""

    def __init__(self, layers: Mapping[str, Array]) -> None:
        prefix = "tof." if "tof.range_m" in layers else ""
        self.error = layers[f"{prefix}range_m"] - layers["truth.range_m"]
        self.snr = float(np.nanmedian(layers["tof.snr_detection"]))
        self.signal = float(np.nanmedian(layers[f"{prefix}Y"]))
        self.count = int(np.isfinite(self.error).sum())

    @property
    def mean(self) -> float:
        """Mean error [m]."""
        return float(np.nanmean(self.error))

    @property
    def sigma(self) -> float:
        """Standard deviation of the ranges [m]."""
        return float(np.nanstd(self.error, ddof=1))

    @property
    def mean_error(self) -> float:
        """Standard error of the mean [m]."""
        return self.sigma / math.sqrt(self.count)

    @property
    def sigma_share(self) -> float:
        """Standard error of σ over σ, for normal errors."""
        return 1.0 / math.sqrt(2.0 * max(self.count - 1, 1))


def _shots(
    task: Task,
    instrument: str,
    distance: float,
    reflectance: float,
    step: int,
    *,
    side: int,
    tilt: float = 0.0,
    processing: Mapping[str, object] | None = None,
    changes: Mapping[str, object] | None = None,
) -> _Shots:
    """Return shots at a plate, turned about the vertical by a tilt [rad], with changes to the instrument."""
    target = plate(distance, _HALF, reflectance)
    height = 2.4 * math.tan(_HALF) * distance + 0.2
    target["size"] = (height / math.cos(tilt) + 0.5, height)
    target["rotation"] = [{"axis": "y", "angle": tilt}]
    scanner = {"preset": instrument, **(changes or {})}
    pulse = {"pulse": dict(processing or {})}
    made = bench(task, [target], scanner, ranging="tof", step=step, processing=pulse)
    return _Shots(layers_of(made, aim(*grid(_HALF, side))))


def walk(task: Task, instrument: str) -> Measured:
    """Time echoes whose amplitudes differ tenfold by a constant fraction."""
    distance, side = 50.0, task.choose(48, 16)
    timing = {"timing": "constant_fraction"}
    reflectances = np.geomspace(0.09, 0.9, task.choose(9, 4))
    made = [
        _shots(task, instrument, distance, reflectance, step, side=side, processing=timing)
        for step, reflectance in enumerate(reflectances.tolist())
    ]
    mean, error = np.array([one.mean for one in made]), np.array([one.mean_error for one in made])
    half = 0.5 * float(mean.max() - mean.min())
    ends = [int(mean.argmax()), int(mean.argmin())]
    amplitude = np.array([one.snr for one in made])

    def draw(axes: Sequence[Axes]) -> None:
        middle = 0.5 * (mean.max() + mean.min())
        axes[0].axhspan(-1.0, 1.0, color=RED, alpha=0.12, lw=0, label="as published")
        axes[0].errorbar(amplitude, 1e3 * (mean - middle), 3e3 * error, fmt="o", ms=4, lw=0.9, color=BLUE)
        axes[0].set(
            xlabel="height of the echo over the noise",
            ylabel="mean range less their middle [mm]",
        )
        logarithms(axes[0], "x")
        axes[0].legend()

    about = f"a plate at {distance:g} m, reflectance 0.09 to 0.9, {side**2} shots each; constant fraction of a half"
    return Measured(
        Finding(1e3 * half, 0.5e3 * float(np.hypot(*error[ends]))),
        expected="0: a fraction of the peak belongs to one time",
        rows=(
            row_of_claim(
                "amplitudes, largest over smallest",
                "",
                "10",
                f"{amplitude.max() / amplitude.min():.1f}",
                amplitude.max() / amplitude.min() > 9.0,
            ),
        ),
        draw=lambda path: sheet(path, "Walk of a constant fraction", about, draw),
    )


def edge_noise(task: Task, instrument: str) -> Measured:
    """Time rising edges of pulses of 3 ns whose echo is ten times the noise."""
    width, wanted, side, distance = 3e-9, 10.0, task.choose(48, 20), 300.0
    # Electronics that leave the pulse its 3 ns, and noise of the receiver alone: the ratio is then that of one number.
    diode = {"bandwidth": 1e9, "noise": {"shot": False}}
    unit = {"pulse": {"width": width}, "photodiode": diode, "digitiser": {"rate": 4e9}}
    changes = {"lidar": unit, "laser": {"speckle": False}}

    def shots(reflectance: float, step: int, **timing: object) -> _Shots:
        return _shots(
            task, instrument, distance, reflectance, step, side=side, processing=timing, changes=changes
        )

    edge: dict[str, object] = {"timing": "leading_edge", "walk_correction": False}
    # A strong echo tells the ratio; the highest sample of a weak one is mostly noise.
    reflectance = 0.9 * wanted / shots(0.9, 0, **edge).snr
    made, fraction = shots(reflectance, 1, **edge), shots(reflectance, 2, timing="constant_fraction")
    closed = 0.5 * SPEED_OF_LIGHT * width * _TO_SIGMA * math.exp(0.5) / wanted
    error = 1e3 * (made.error - made.mean)

    def draw(axes: Sequence[Axes]) -> None:
        axes[0].hist(error, bins=60, color=BLUE)
        axes[0].set(xlabel="range less its mean [mm]", ylabel="shots")

    about = f"{made.count} echoes of pulses of 3 ns at {wanted:g} times the noise, leading edge"
    return Measured(
        Finding(1e3 * made.sigma, 1e3 * made.sigma * made.sigma_share),
        expected=f"{1e3 * closed:.0f} mm: c/2 · √e σ_pulse/SNR, the steepest slope of a Gaussian",
        rows=(
            row_of_claim(
                "σ if a constant fraction is timed, whose level errs with the peak",
                "",
                "more",
                f"{1e3 * fraction.sigma:.0f} mm",
                fraction.sigma > made.sigma,
            ),
        ),
        draw=lambda path: sheet(path, "Noise of a rising edge at ten times the noise", about, draw),
    )


def reflectance_bias(task: Task, instrument: str) -> Measured:
    """Compare mean ranges of dark and bright plates, near and far."""
    side, places = task.choose(48, 16), (3.0, 53.0)
    reflectances = (0.05, 0.15, 0.5, 0.9)
    mean, error = np.empty((2, 4)), np.empty((2, 4))
    for row, distance in enumerate(places):
        for column, reflectance in enumerate(reflectances):
            made = _shots(task, instrument, distance, reflectance, 4 * row + column, side=side)
            mean[row, column], error[row, column] = made.mean, made.mean_error
    spread = np.ptp(mean, axis=1)
    worst = int(spread.argmax())
    ends = [int(mean[worst].argmax()), int(mean[worst].argmin())]

    def draw(axes: Sequence[Axes]) -> None:
        for row, (distance, colour) in enumerate(zip(places, COLOURS, strict=False)):
            label = f"{distance:g} m"
            shown = 1e3 * (mean[row] - mean[row].mean())
            axes[0].errorbar(
                reflectances, shown, 3e3 * error[row], fmt="o-", ms=4, lw=0.9, color=colour, label=label
            )
        axes[0].set(xlabel="reflectance", ylabel="mean range less that of all [mm]")
        axes[0].legend()

    about = f"facing plates, {side**2} shots each, the instrument's own timing; three standard errors"
    return Measured(
        Finding(1e3 * float(spread[worst]), 1e3 * float(np.hypot(*error[worst, ends]))),
        expected="0",
        draw=lambda path: sheet(path, "Range against reflectance", about, draw),
    )


def incidence(task: Task, instrument: str) -> Measured:
    """Find the incidence from which its own share of the variance is the larger one."""
    side = task.choose(48, 20)
    steps = task.choose([0, 15, 30, 40, 50, 55, 60, 65, 70, 75, 80], [0, 30, 50, 60, 70, 80])
    degrees = np.array(steps, dtype=np.float64)
    cases = {
        "as it is, 20 m": (20.0, None),
        "clock without jitter, 100 m": (100.0, {"lidar": {"digitiser": {"jitter": 0.0}}}),
    }
    sigma = np.empty((len(cases), len(degrees)))
    for row, (distance, changes) in enumerate(cases.values()):
        for column, angle in enumerate(degrees.tolist()):
            made = _shots(
                task,
                instrument,
                distance,
                0.5,
                row * len(degrees) + column,
                side=side,
                tilt=math.radians(angle),
                changes=changes,
            )
            sigma[row, column] = made.sigma
    share = 1.0 - (sigma[:, :1] / sigma) ** 2
    error = (1.0 - share) * 2.0 / side
    found = [_first_above(degrees, *pair) for pair in zip(share, error, strict=True)]

    def draw(axes: Sequence[Axes]) -> None:
        axes[1].axvspan(55.0, 65.0, color=RED, alpha=0.12, lw=0, label="as published")
        axes[1].axhline(0.5, color="black", lw=0.8)
        for name, colour, *curve in zip(cases, (BLUE, GREEN), sigma, share, error, strict=True):
            axes[0].plot(degrees, 1e3 * curve[0], "o-", ms=4, lw=0.9, color=colour)
            axes[1].errorbar(
                degrees, curve[1], 3.0 * curve[2], fmt="o-", ms=4, lw=0.9, color=colour, label=name
            )
        axes[0].set(xlabel="incidence [°]", ylabel="σ of the range [mm]")
        logarithms(axes[0], "y")
        axes[1].set(xlabel="incidence [°]", ylabel="share of the variance")
        axes[1].legend()

    alone = found[1]
    about = f"a plate of reflectance 0.5, {side**2} shots each; three standard errors"
    return Measured(
        found[0],
        rows=(
            row_of_claim(
                "the same for the noise of the signal alone: clock without jitter, 100 m",
                "",
                "45° if the amplifier's noise rules, 60° if the light's own does",
                alone.text("°"),
                45.0 - 3.0 * alone.error < alone.value < 60.0 + 3.0 * alone.error,
            ),
        ),
        draw=lambda path: sheet(path, "Noise against incidence", about, draw, 2),
    )


def _first_above(place: Array, share: Array, error: Array, level: float = 0.5) -> Finding:
    """Return where a share first exceeds a level, by interpolation; infinite where it does not."""
    above = np.flatnonzero(share > level)
    if not above.size:
        return Finding(math.inf, 0.0)
    pair = slice(max(int(above[0]), 1) - 1, max(int(above[0]), 1) + 1)
    steep = float(np.diff(share[pair])[0] / np.diff(place[pair])[0])
    return Finding(float(np.interp(level, share[pair], place[pair])), float(error[pair].max()) / steep)


def intensity(task: Task, instrument: str) -> Measured:
    """Compare σ of echoes of one intensity that come from several ranges and reflectances."""
    side = task.choose(64, 24)
    cases = ((40.0, 0.05), (80.0, 0.2), (160.0, 0.8))
    levels = np.geomspace(0.05, 1.0, task.choose(5, 3))
    sigma, signal = np.empty((len(levels), len(cases))), np.empty((len(levels), len(cases)))
    for row, level in enumerate(levels.tolist()):
        for column, (distance, reflectance) in enumerate(cases):
            step = row * len(cases) + column
            made = _shots(task, instrument, distance, level * reflectance, step, side=side)
            sigma[row, column], signal[row, column] = made.sigma, made.signal
    share = 1.0 / math.sqrt(2.0 * side**2)
    ratio = float(np.exp(np.mean(np.log(sigma[:, -1] / sigma[:, 0]))))
    steep = slope(signal[:2].mean(axis=1), sigma[:2].mean(axis=1))
    fall = 1e3 * sigma.mean(axis=1)

    def draw(axes: Sequence[Axes]) -> None:
        for column, ((distance, reflectance), colour) in enumerate(
            zip(cases, (BLUE, RED, GREEN), strict=True)
        ):
            axes[0].errorbar(
                signal[:, column],
                1e3 * sigma[:, column],
                3e3 * share * sigma[:, column],
                fmt="o-",
                ms=4,
                lw=0.9,
                color=colour,
                label=f"{distance:g} m, reflectance up to {reflectance:g}",
            )
        axes[0].set(xlabel="signal [electron]", ylabel="σ of the range [mm]")
        logarithms(axes[0])
        axes[0].legend()

    about = f"facing plates whose light is alike at three ranges, {side**2} shots each; three standard errors"
    return Measured(
        Finding(ratio, ratio * math.sqrt(2.0 / len(levels)) * share),
        expected="1",
        rows=(
            row_of_claim(
                "σ from the weakest to the strongest echo",
                "falls with intensity",
                "",
                ", ".join(f"{value:.1f}" for value in fall) + " mm",
                bool((np.diff(fall) < 0.0).all()),
            ),
            row_of_claim(
                "exponent of σ in the signal, weakest echoes",
                "",
                "−1 by the amplifier's noise, −1/2 by the light's own, 0 by the clock",
                f"{steep:.2f}",
                -1.1 < steep < 0.0,
            ),
        ),
        draw=lambda path: sheet(path, "Range noise against intensity", about, draw),
    )
