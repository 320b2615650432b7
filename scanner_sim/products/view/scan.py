"""A range image or a table of shots as the data of a page: layers, how they become colours, and their meanings."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from scanner_sim.foundation.channels import CHANNEL
from scanner_sim.foundation.status import Status
from scanner_sim.products.image import RangeImage
from scanner_sim.products.layers import LayeredResult
from scanner_sim.products.pictures.style import RANGE_MAP, SIGNAL_MAP, STATUS_COLOUR
from scanner_sim.products.shots import ShotTable
from scanner_sim.products.view.packing import WHOLE_MANTISSA, packed
from scanner_sim.products.view.signals import SignalWindows, packed_windows
from scanner_sim.products.view.surroundings import Surroundings
from scanner_sim.ranging.axes import Axes

_FINE, _COARSE = WHOLE_MANTISSA, 11
"""Bits of the fraction of ranges and of angles, and of σ and signals: a relative error of 2.4e-4 of these."""
_POINT = 18
"""Of coordinates: 0.02 mm at 10 m."""
LAYERS = {
    **dict.fromkeys(("range_m", "truth.range_m", "tof.range_m", "fused.range_m", "peak_px"), _FINE),
    **dict.fromkeys(
        (
            *(
                "sigma_range_m",
                "tof.sigma_range_m",
                "fused.sigma_range_m",
                "sigma_texture_m",
                "sigma_peak_px",
            ),
            *("Y", "tof.Y", "snr", "snr_detection", "tof.snr_detection", "background", "truth.incidence_rad"),
        ),
        _COARSE,
    ),
}
"""Layers of a page, and how many bits of their fractions it keeps."""
CODES = ("status", "tof.status", "fused.status", "tof.echoes", "truth.object", "truth.material")
"""Layers of small whole numbers."""
WAYS = {"": "", "tof.": ", time of flight", "fused.": ", both"}
"""Prefixes of the layers of each range, and what colours by them are called besides."""
_MAPS = {"range": RANGE_MAP, "signal": SIGNAL_MAP, "sigma": "cividis", "dark": "inferno", "error": "RdBu_r"}
"""Matplotlib's colour maps, perceptually even ones; errors have one with two ends, red where a range is too long."""
_ON_WHITE = {"error": "berlin_r"}
"""In their place on white ground: the middle is dark there."""
_VALID_COLOUR = "#2b6f8f"
_ON_DARK = {Status.VALID: "#4a94b5", Status.BELOW_THRESHOLD: "#343a40"}
"""Colours of statuses that would glare, or be lost, on dark ground."""
PALETTE = (
    *(
        "#3f7fb5",
        "#d08a3c",
        "#4f9d69",
        "#b5534f",
        "#8a6fb0",
        "#8c6d4f",
        "#c678a8",
        "#7f8a94",
        "#a3a63f",
        "#4aa3ad",
    ),
)
"""Colours of objects, in turn."""


def scan_data(
    result: RangeImage | ShotTable,
    surroundings: Surroundings,
    *,
    title: str,
    step: int = 1,
    signals: Sequence[SignalWindows] = (),
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the data of the page of a scan.

    Parameters
    ----------
    result
        The scan.
    surroundings
        What is drawn about it.
    title
        Its name.
    step
        Of an image each ``step``-th row and column is shown, of shots every ``step``-th.
    signals
        Lines and waveforms of its voxels.
    notes
        Sentences on what was left out.
    """
    thin = (slice(None, None, step),) * len(result.shape)
    theta, phi = _aims(result)
    theta, phi = theta[thin], phi[thin]
    layers = {name: result[name][thin] for name in (*LAYERS, *CODES) if name in result}
    ranges = result["range_m"][result.valid]
    farthest = 1.03 * float(ranges.max()) if len(ranges) else max(2.0 * surroundings.near, 1.0)
    return {
        "kind": "scan",
        "title": title,
        "about": _about(result),
        "notes": [*notes, *result.warnings],
        "shape": list(theta.shape),
        "step": step,
        "raster": isinstance(result, RangeImage),
        "statuses": [
            {
                "name": code.name.lower().replace("_", " "),
                "sentence": code.sentence,
                "colour": STATUS_COLOUR.get(code, _VALID_COLOUR),
                "colour_on_dark": _ON_DARK.get(code) or STATUS_COLOUR.get(code, _VALID_COLOUR),
            }
            for code in Status
        ],
        "objects": list(result.objects),
        "materials": list(result.materials),
        "palette": list(PALETTE),
        "theta": packed(theta.ravel()),
        "phi": packed(phi.ravel()),
        "time": packed(result.time[thin]) if isinstance(result, ShotTable) else None,
        "position": packed(_positions(layers, result, thin, (theta, phi), surroundings.axes), _POINT),
        "layers": {name: _layer(name, values) for name, values in layers.items()},
        "shades": shades(result),
        "maps": colour_maps(),
        "surroundings": surroundings.drawn(farthest),
        "signals": [packed_windows(one) for one in signals],
        "scenario": result.scenario_yaml,
        "made_by": dict(result.made_by),
    }


def shades(result: LayeredResult) -> list[dict[str, Any]]:
    """Return by what the points of a result can be coloured.

    Each has a name, a unit, a colour map, a scale, and a sum of layers: ``layer``, less ``minus``, over ``over``, times
    ``factor``.
    """
    found = [
        _shade("range", "range_m", "m", "range"),
        _shade("signal", "Y", "electrons", "signal", scale="logarithmic"),
        _shade("σ of the range", "sigma_range_m", "mm", "sigma", scale="logarithmic"),
        _shade("status", "status", "", "", scale="status"),
    ]
    for prefix, by in WAYS.items():
        if f"{prefix}range_m" in result and "truth.range_m" in result:
            error = {"minus": "truth.range_m", "scale": "both"}
            found.append(_shade(f"error{by}", f"{prefix}range_m", "mm", "error", **error))
            over = error | {"over": f"{prefix}sigma_range_m", "unit": "σ"}
            found.append(_shade(f"error over σ{by}", f"{prefix}range_m", colours="error", **over))
    found.append(_shade("object", "truth.object", "", "", scale="object"))
    if "sigma_texture_m" in result:
        found.append(_shade("σ by uneven spots", "sigma_texture_m", "mm", "sigma", scale="logarithmic"))
    if "background" in result and (result["background"] > 0.0).any():
        found.append(_shade("background", "background", "electrons", "dark", scale="logarithmic"))
    if "truth.incidence_rad" in result:
        found.append(_shade("true incidence", "truth.incidence_rad", "°", "range"))
    return [one for one in found if {one["layer"], one["minus"], one["over"]} - {""} <= set(result.channels)]


def _shade(
    name: str, layer: str, unit: str, colours: str, scale: str = "linear", minus: str = "", over: str = ""
) -> dict[str, Any]:
    factor = {"mm": 1e3, "°": math.degrees(1.0)}.get(unit, 1.0)
    return {
        "name": name,
        "layer": layer,
        "unit": unit,
        "map": colours,
        "scale": scale,
        "minus": minus,
        "over": over,
        "factor": factor,
    }


def colour_maps() -> dict[str, dict[str, str]]:
    """Return the colour maps on dark and on white ground, 256 colours of three bytes each, in base64."""

    def bytes_of(name: str) -> str:
        colours = np.rint(255.0 * colormaps[name](np.linspace(0.0, 1.0, 256))[:, :3]).astype(np.uint8)
        return base64.b64encode(colours.tobytes()).decode("ascii")

    return {
        key: {"dark": bytes_of(name), "light": bytes_of(_ON_WHITE.get(key, name))}
        for key, name in _MAPS.items()
    }


def _about(result: LayeredResult) -> str:
    valid = result.valid
    if isinstance(result, RangeImage):
        shape = f"{result.shape[0]} × {result.shape[1]} voxels"
    else:
        shape = f"{result.shape[0]:,} shots"
    return f"{shape}, {np.count_nonzero(valid):,} with a range, seed {result.seed}"


def _aims(result: RangeImage | ShotTable) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Θ and φ of all voxels or shots [rad]."""
    if isinstance(result, ShotTable):
        return result.theta, result.phi
    phi, theta = np.meshgrid(result.phi, result.theta, indexing="ij")
    return theta, phi


def _positions(
    layers: dict[str, NDArray[np.float32]],
    result: LayeredResult,
    thin: tuple[slice, ...],
    aims: tuple[NDArray[np.float64], NDArray[np.float64]],
    axes: Axes,
) -> NDArray[np.float64]:
    """Return the points [m], shape (n, 3); without a range the true one, and NaN where there is nothing.

    True ones lie along the true deflections, or along the ``aims`` (Θ, φ) where a result does not keep these, about the
    ``axes`` as built; the platform's shaking is not in them.
    """
    measured = np.stack([result[name][thin] for name in ("P.X", "P.Y", "P.Z")], axis=-1).astype(np.float64)
    valid = np.equal(layers["status"], Status.VALID)[..., None]
    true = np.full_like(measured, np.nan)
    if "truth.range_m" in layers:
        names = ("truth.theta_rad", "truth.phi_rad")
        angles = (
            result[name][thin] if name in result else aim for name, aim in zip(names, aims, strict=True)
        )
        true = np.stack(axes.point(layers["truth.range_m"], *angles), axis=-1)
    return np.where(valid, measured, true).reshape(-1, 3)


def _layer(name: str, values: NDArray[np.float32]) -> dict[str, Any]:
    about = {"unit": CHANNEL[name].unit, "meaning": CHANNEL[name].meaning}
    if name in CODES:
        return about | packed(values.ravel().astype(np.uint8 if values.max(initial=0) < 256 else np.int32))
    return about | packed(values.ravel(), LAYERS[name])
