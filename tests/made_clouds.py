"""A scan made by hand, of which formats hold the points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config import load_scenario, resolved_yaml
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.status import Status
from scanner_sim.products.formats.cloud import cloud_of_scan
from scanner_sim.products.image import RangeImage
from scanner_sim.products.true_poses import TruePoses
from scanner_sim.scan.raster import raster_aim

ROWS, COLUMNS, RATE = 6, 9, 20e3
ISS = {
    "line1": "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
    "line2": "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
    "time": "2008-09-20T12:25:40Z",
}


def scenario(**more: Any) -> Scenario:
    """The scenario of the scan, with more keys."""
    return load_scenario(
        {
            "schema": 1,
            "scan": {
                "type": "raster",
                "rows": ROWS,
                "columns": COLUMNS,
                "horizontal": [-0.2, 0.3],
                "vertical": [-0.1, 0.1],
            },
            "scanner": {"rate": RATE},
            **more,
        }
    )


def make_image(ranging: str = "both", echo: str = "last", **more: Any) -> RangeImage:
    """A made-up image with every status, whose numbers have no short spelling."""
    random, shape = np.random.default_rng(7), (ROWS, COLUMNS)
    status = (np.arange(ROWS * COLUMNS) % (2 * len(Status))).reshape(shape)
    status[status > max(Status)] = 0
    valid = status == 0
    given = scenario(ranging=ranging, processing={"pulse": {"echo": echo}}, **more)
    layers: dict[str, NDArray[Any]] = {"status": status, "tof.status": status}
    for prefix, far in (("", 0.0), ("tof.", 0.5)):
        for name in ("range_m", "P.X", "P.Y", "P.Z"):
            layers[prefix + name] = random.uniform(5.0, 9.0, shape) + far
        for axis in "xyz":
            layers[f"{prefix}sigma_{axis}_m"] = random.uniform(2e-4, 1e-3, shape)
        layers[f"{prefix}sigma_range_m"] = random.uniform(2e-4, 1e-3, shape)
        for pair in ("xy", "xz", "yz"):
            layers[f"{prefix}cov_{pair}_m2"] = random.normal(0.0, 1e-8, shape)
    layers = {
        name: layer if "status" in name else np.where(valid, layer, np.nan) for name, layer in layers.items()
    }
    layers |= {"Y": random.uniform(1e3, 1e6, shape), "tof.Y": random.uniform(1e2, 1e4, shape)}
    layers |= {f"truth.normal.{axis}": random.uniform(-1.0, 1.0, shape) for axis in "XYZ"}
    layers["truth.incidence_rad"] = random.uniform(0.0, 1.5, shape)
    layers["tof.echoes"] = random.integers(1, 4, shape)
    layers["truth.object"] = random.integers(0, 3, shape)
    layers["truth.material"] = random.integers(0, 2, shape)
    pose = np.tile(np.eye(4), (2, 1, 1))
    pose[:, :3, 3] = (0.1, -0.2, 7.0)
    return RangeImage(
        channels={name: layer.astype(np.float32) for name, layer in layers.items()},
        theta=np.linspace(-0.2, 0.3, COLUMNS),
        phi=np.linspace(-0.1, 0.1, ROWS),
        objects=("node", "handrail 2"),
        materials=("beta cloth",),
        seed=11,
        scenario_yaml=resolved_yaml(given),
        made_by={"scanner-sim": "0.0.9"},
        poses=TruePoses((0.0, 0.0027), {"node-1": pose}),
    )


def times() -> NDArray[np.float64]:
    """When each shot of the scan is fired."""
    scan = scenario().scan
    return raster_aim(scan, np.arange(ROWS * COLUMNS, dtype=np.uint32), 1.0 / RATE).time  # type: ignore[arg-type]


def wanted(image: RangeImage) -> dict[str, NDArray[Any]]:
    """What the columns of a file hold, by their names; independent of the table that makes them."""
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    layers = {
        "status": "status",
        "range": "range_m",
        "signal": "Y",
        "echoes": "tof.echoes",
        "object": "truth.object",
        "material": "truth.material",
        "incidence": "truth.incidence_rad",
        **{f"normal_{axis}": f"truth.normal.{axis.upper()}" for axis in "xyz"},
        **{f"sigma_{axis}": f"sigma_{axis}_m" for axis in ("range", "x", "y", "z")},
        **{f"cov_{pair}": f"cov_{pair}_m2" for pair in ("xy", "xz", "yz")},
    }
    return {name: image[layer].ravel() for name, layer in layers.items()} | {"row": row, "column": column}


def cloud_time(image: RangeImage) -> NDArray[np.float64]:
    """The times of a cloud, which must have them."""
    found = cloud_of_scan(image).time
    assert found is not None
    return found
