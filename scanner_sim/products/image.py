"""A range image: the result of a run, as named layers over rows of φ and columns of Θ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.html_text import html_picture
from scanner_sim.products.grey import thumbnail
from scanner_sim.products.layers import LayeredResult, attributes, closed, layer_variables

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class RangeImage(LayeredResult):
    """Measurements of a raster and the truth behind them, layer by layer.

    Parameters
    ----------
    channels, objects, materials, seed, scenario_yaml, warnings, made_by, poses, calibration_yaml
        As of :class:`~scanner_sim.products.layers.LayeredResult`; each layer has the shape (rows, columns).
    theta, phi
        Deflections of the columns, shape (columns,), and of the rows, shape (rows,) [rad]: ascending and
        evenly spaced.

    Raises
    ------
    ValueError
        If names, shapes, types, angles or the marks of invalid voxels contradict each other.
    """

    theta: NDArray[np.float64]
    phi: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check the image and close its arrays to writing."""
        object.__setattr__(self, "theta", closed(_angles("theta", self.theta)))
        object.__setattr__(self, "phi", closed(_angles("phi", self.phi)))
        super().__post_init__()

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return len(self.phi), len(self.theta)

    def plot(self, name: str = "range_m", axes: Axes | None = None) -> Axes:
        """Draw a layer with matplotlib: axes in degrees, units at the colour bar, voxels without a value explained.

        Parameters
        ----------
        name
            Layer.
        axes
            Where to draw; by default in a new figure of pyplot.

        Returns
        -------
        matplotlib.axes.Axes
            With ``axes.figure``, for further drawing or ``savefig``.

        Raises
        ------
        KeyError
            If there is no such layer; the message names those that there are.
        """
        # Late: most simulations draw nothing, and pyplot takes a third of a second.
        from scanner_sim.products.pictures.plot import plot_layer

        return plot_layer(self, self.theta, self.phi, name, axes)

    def to_xarray(self) -> xarray.Dataset:
        """Return the image as an xarray dataset.

        Returns
        -------
        xarray.Dataset
            Variables by channel name over ``phi`` and ``theta`` [rad], with ``units`` and ``long_name``;
            status and truth numbers are int32 with CF ``flag_values`` and ``flag_meanings``. Seed,
            scenario, versions and warnings are attributes of the dataset.
        """
        import xarray

        variables = layer_variables(self, ("phi", "theta"))
        coordinates = {
            "phi": ("phi", self.phi, {"units": "rad", "long_name": "deflection downwards, per row"}),
            "theta": (
                "theta",
                self.theta,
                {"units": "rad", "long_name": "deflection to the right, per column"},
            ),
        }
        return xarray.Dataset(variables, coordinates, attributes(self, "range image"))

    def _html_picture(self) -> str:
        if "range_m" not in self:
            return ""
        wide = min(256, max(96, 256 * self.shape[1] // self.shape[0]))
        return html_picture(thumbnail(self["range_m"], 128), "range, near bright and far dark", wide)

    def _title(self) -> str:
        rows, columns = self.shape
        spans = [
            f"{name} {np.degrees(angle[0]):.4g}° to {np.degrees(angle[-1]):.4g}°"
            for name, angle in (("Θ", self.theta), ("φ", self.phi))
        ]
        return f"RangeImage of {rows} rows × {columns} columns, {spans[0]}, {spans[1]}"


def _angles(name: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``values`` (shape (n,)) if they are finite, ascending and evenly spaced float64."""
    if values.ndim != 1 or not values.size or values.dtype != np.float64 or not np.isfinite(values).all():
        raise ValueError(f"{name} must be a list of finite float64 angles")
    even = np.linspace(values[0], values[-1], values.size)
    step = (values[-1] - values[0]) / max(values.size - 1, 1)
    if values.size > 1 and (step <= 0.0 or np.abs(values - even).max() > 1e-6 * step):
        raise ValueError(f"{name} must ascend in even steps")
    return values
