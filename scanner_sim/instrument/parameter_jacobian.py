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
from scanner_sim.instrument.common_errors import ranged_by
from scanner_sim.products.image import RangeImage
from scanner_sim.products.shots import ShotTable
from scanner_sim.ranging.calibration import parameter_effects


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
        ``tof.`` for the ranges by time of flight of a result that has both; empty for the first rangefinder.

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
        If there is no such parameter or no such rangefinder, or the scenario of the result cannot be read.
    """
    scenario = scenario_from_text(result.scenario_yaml, name="scenario of the result", stored=True)
    geometry = believed_geometry(scenario)
    known, ways = geometry.calibration, ranged_by(scenario.rangefinders, geometry)
    if len(ways.get(prefix, ())) != 1:
        raise InputError(
            f"the result has no points of one rangefinder under '{prefix}'.", remedy="Write '' or 'tof.'."
        )
    free = NAMES
    if known is not None and known.is_uncertain:
        free = known.uncertain
    chosen = list(free if parameters is None else parameters)
    for name in chosen:
        if name not in INDEX:
            raise InputError(f"there is no parameter '{name}'.", remedy=choice(name, NAMES))
    layers = {
        name: result.channels[prefix + name].astype(np.float64) for name in ("range_m", "P.X", "P.Y", "P.Z")
    }
    _, theta, phi = geometry.sight_of(*(layers[f"P.{axis}"] for axis in "XYZ"))
    period = math.tau if known is None else known.encoder_period
    by = ways[prefix][0]
    found = parameter_effects(design_of(scenario.scanner), by, layers["range_m"], theta, phi, period)
    index = [INDEX[name] for name in chosen]
    dims = ("row", "column") if theta.ndim == 2 else ("shot",)
    data = {
        "point": ((*dims, "axis", "parameter"), found.by_parameters[..., index]),
        "range": ((*dims, "parameter"), found.range_by_parameters[..., index]),
    }
    if known is not None:
        data["covariance"] = (("parameter", "other"), known.covariance[np.ix_(index, index)])
    units = [PARAMETERS[number].dimension.unit for number in index]
    coordinates = {"axis": list("xyz"), "parameter": chosen, "other": chosen, "unit": ("parameter", units)}
    return xarray.Dataset(
        data, {name: values for name, values in coordinates.items() if name != "other" or known}
    )
