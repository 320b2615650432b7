"""A result in numbers: counts, quantiles and, apart, how far the measurements lie from the truth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.channels import CHANNEL
from scanner_sim.foundation.status import Status
from scanner_sim.products.image import RangeImage
from scanner_sim.products.json_text import json_text
from scanner_sim.products.layers import LayeredResult, numbered
from scanner_sim.products.shots import ShotTable

_BEYOND = (3, 5, 6)
"""Standard deviations beyond which errors are counted."""
_QUANTILES = {"min": 0.0, "5%": 0.05, "25%": 0.25, "median": 0.5, "75%": 0.75, "95%": 0.95, "max": 1.0}

_MEASURED = (
    "range_m",
    "sigma_range_m",
    "sigma_texture_m",
    "Y",
    "snr",
    "snr_detection",
    "peak_px",
    "sigma_peak_px",
)
"""Layers of which the summary gives extremes and quantiles."""


def summary(image: RangeImage) -> dict[str, object]:
    """Return the summary of an image as plain numbers, texts, lists and dictionaries.

    Quantiles and errors are taken over the valid voxels and are None where there is none. The section
    ``truth`` is what a real instrument could not know. No time is in it: same image, same summary.
    """
    rows, columns = image.shape
    return {
        "rows": rows,
        "columns": columns,
        "theta_rad": [float(image.theta[0]), float(image.theta[-1])],
        "phi_rad": [float(image.phi[0]), float(image.phi[-1])],
        **_layers(image, "voxels"),
    }


def shots_summary(shots: ShotTable) -> dict[str, object]:
    """Return the summary of a table of shots, as :func:`summary` does of an image."""
    return {
        "shots": len(shots),
        "time_s": [float(shots.time.min()), float(shots.time.max())],
        "theta_rad": [float(shots.theta.min()), float(shots.theta.max())],
        "phi_rad": [float(shots.phi.min()), float(shots.phi.max())],
        **_layers(shots, "shots"),
    }


def _layers(image: LayeredResult, unit: str) -> dict[str, object]:
    """Return what layers of any shape hold; ``unit`` is the word for one of their entries."""
    status, valid = image["status"], image.valid
    counts = {code: int(np.count_nonzero(status == code)) for code in Status}
    result: dict[str, object] = {
        "seed": image.seed,
        "valid_share": counts[Status.VALID] / status.size,
        "status": [
            {"code": int(code), "name": code.name, "meaning": code.sentence, unit: number}
            for code, number in counts.items()
        ],
    }
    for name in _MEASURED:
        # Without Sun and Earth every voxel's laser light stands over nothing: no quantile says that.
        if name in image and (np.isfinite(image[name][valid]).any() or not valid.any()):
            result[name] = {"unit": CHANNEL[name].unit, **_quantiles(image[name][valid])}
    for name in ("tof.range_m", "tof.sigma_range_m", "fused.range_m", "fused.sigma_range_m"):
        if name in image:
            result[name] = {"unit": CHANNEL[name].unit, **_quantiles(image[name])}
    result["truth"] = _truth(image, unit)
    result["channels"] = {
        name: {"unit": CHANNEL[name].unit, "meaning": CHANNEL[name].meaning} for name in image.channels
    }
    result["versions"] = dict(image.made_by)
    result["warnings"] = list(image.warnings)
    return result


def share_beyond(image: LayeredResult, sigmas: float, prefix: str = "") -> float | None:
    """Return the share of ranges whose error is larger than some σ; None where there is no truth.

    Parameters
    ----------
    image
        The image.
    sigmas
        How many σ.
    prefix
        Of the method of ranging: ``tof.``, ``fused.`` or none.
    """
    names = [f"{prefix}range_m", f"{prefix}sigma_range_m", "truth.range_m"]
    if not all(name in image for name in names):
        return None
    measured, sigma, truth = (image[name].astype(np.float64) for name in names)
    error = np.abs(measured - truth)
    known = np.isfinite(error) & (sigma > 0.0)
    return float(np.mean(error[known] > sigmas * sigma[known])) if known.any() else None


def summary_json(image: RangeImage) -> str:
    """Return :func:`summary` as the text of ``summary.json``."""
    return json_text(summary(image))


def shots_json(shots: ShotTable) -> str:
    """Return :func:`shots_summary` as the text of ``summary.json``."""
    return json_text(shots_summary(shots))


def _truth(image: LayeredResult, unit: str) -> dict[str, object]:
    """Return what only the simulator knows: errors of the valid voxels, and hits of each object."""
    result: dict[str, object] = {} if image.poses is None else {"poses": image.poses.plain()}
    if {"range_m", "truth.range_m"} <= image.channels.keys():
        known = image.valid & np.isfinite(image["truth.range_m"])
        error = image["range_m"][known].astype(np.float64) - image["truth.range_m"][known]
        result[f"{unit}_compared"] = int(error.size)
        result[f"{unit}_without_truth"] = int(np.count_nonzero(image.valid & ~known))
        result["error_m"] = {
            "mean": _finite(np.mean, error),
            "rms": _finite(_rms, error),
            **_quantiles(error),
        }
        if "sigma_range_m" in image:
            sigma = image["sigma_range_m"][known].astype(np.float64)
            stated = sigma > 0.0
            pull = error[stated] / sigma[stated]
            result["error_over_sigma"] = {"rms": _finite(_rms, pull), **_quantiles(pull)}
            result["share_beyond"] = {
                f"{sigmas} sigma": _finite(np.mean, (np.abs(pull) > sigmas).astype(np.float64))
                for sigmas in _BEYOND
            }
    for method in ("tof", "fused"):
        if {f"{method}.range_m", "truth.range_m"} <= image.channels.keys():
            error = image[f"{method}.range_m"].astype(np.float64) - image["truth.range_m"]
            error = error[np.isfinite(error)]
            result[f"{method}.error_m"] = {"rms": _finite(_rms, error), **_quantiles(error)}
    for name, names in (("truth.object", image.objects), ("truth.material", image.materials)):
        if name in image:
            hits = np.bincount(image[name].astype(np.int64).ravel(), minlength=len(names) + 1)
            labels = {0: "nothing", **numbered(names)}
            result[f"{unit}_by_{name.removeprefix('truth.')}"] = [
                {"number": number, "name": label, unit: int(hits[number])} for number, label in labels.items()
            ]
    return result


def _quantiles(values: NDArray[np.floating]) -> dict[str, float | None]:
    """Return the quantiles of the finite ``values`` (shape (n,)); None where there are none."""
    finite = values[np.isfinite(values)].astype(np.float64)
    if not finite.size:
        return dict.fromkeys(_QUANTILES)
    return dict(zip(_QUANTILES, np.quantile(finite, list(_QUANTILES.values())).tolist(), strict=True))


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _finite(statistic: Callable[[NDArray[np.float64]], float], values: NDArray[np.float64]) -> float | None:
    """Return a statistic of ``values`` (shape (n,)), or None where there are none."""
    return float(statistic(values)) if values.size else None
