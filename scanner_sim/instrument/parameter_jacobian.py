"""How measured points go by the parameters of the instrument: for calibrations and adjustments of one's own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import xarray

from scanner_sim.config import scenario_from_text
from scanner_sim.config.calibration import believed_geometry, design_of
from scanner_sim.config.wording import choice
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parameters import INDEX, NAMES, PARAMETERS
from scanner_sim.instrument.common_errors import ReadingsOfTheta, derivatives, ranged_by
from scanner_sim.products.image import RangeImage
from scanner_sim.products.shots import ShotTable
from scanner_sim.scan.raster import raster_aim


def parameter_jacobian(
    result: RangeImage | ShotTable, parameters: Sequence[str] | None = None, *, prefix: str = ""
) -> xarray.Dataset:
    """Return the derivatives of a result's points and ranges by the parameters of its instrument.

    Parameters
    ----------
    result
        An image, or a table of shots.
    parameters
        Names of parameters; by default those of the scenario's calibration that have an error, or all without one.
    prefix
        ``tof.`` for the ranges by time of flight of a result that has both, ``fused.`` for those of both at once, whose
        weights are held; empty for the first rangefinder.

    Returns
    -------
    xarray.Dataset
        ``point`` (row, column, axis, parameter) or (shot, axis, parameter) and ``range`` without the axis, per SI unit
        of each parameter, as the deviation that is *believed* grows: an instrument that is built so, and does not know
        it, errs by the negative. NaN where nothing was measured. With a calibration also ``covariance`` (parameter,
        other).

    Raises
    ------
    InputError
        If there is no such parameter or no such way of ranging, or the scenario of the result cannot be read.
    """
    scenario = scenario_from_text(result.scenario_yaml, name="scenario of the result", stored=True)
    geometry = believed_geometry(scenario)
    known, ways = geometry.calibration, ranged_by(scenario.rangefinders, geometry)
    if prefix not in ways:
        told = " or ".join(f"'{name}'" for name in ways)
        raise InputError(f"the result has no points under '{prefix}'.", remedy=f"Write {told}.")
    free = NAMES
    if known is not None and known.is_uncertain:
        free = known.uncertain
    chosen = list(free if parameters is None else parameters)
    for name in chosen:
        if name not in INDEX:
            raise InputError(f"there is no parameter '{name}'.", remedy=choice(name, NAMES))
    shape = result.channels[f"{prefix}range_m"].shape
    period = math.tau if known is None else known.encoder_period
    if isinstance(result, ShotTable):
        theta, time = result.theta, result.time
    else:
        aim = raster_aim(
            scenario.raster, np.arange(scenario.raster.shots, dtype=np.uint32), scenario.scanner.dwell
        )
        theta, time = aim.theta, aim.time
    readings = ReadingsOfTheta(scenario.scanner.mirrors, theta, time)
    by_range, by_point = derivatives(
        result.channels, prefix, ways[prefix], geometry, readings, design_of(scenario.scanner), period
    )
    index = [INDEX[name] for name in chosen]
    dims = ("row", "column") if len(shape) == 2 else ("shot",)
    data = {
        "point": ((*dims, "axis", "parameter"), by_point[..., index].reshape(*shape, 3, -1)),
        "range": ((*dims, "parameter"), by_range[..., index].reshape(*shape, -1)),
    }
    if known is not None:
        data["covariance"] = (("parameter", "other"), known.covariance[index][:, index])
    units = [PARAMETERS[number].dimension.unit for number in index]
    coordinates = {"axis": list("xyz"), "parameter": chosen, "other": chosen, "unit": ("parameter", units)}
    return xarray.Dataset(
        data, {name: values for name, values in coordinates.items() if name != "other" or known}
    )
