"""The rows of a campaign as arrays over the axes of its plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray
from numpy.typing import NDArray

from scanner_sim.campaign.measures import MEASURES
from scanner_sim.campaign.sensitivity import BESIDE_KEYS, LEVEL, indices_of, pages_of
from scanner_sim.campaign.store import Store, axis_names, column_of, reopened, units_of
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.html_text import html_box, html_rows
from scanner_sim.products.files.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class CampaignResult:
    """What the folder of a campaign holds, finished or not.

    ``to_xarray`` gives measures over the axes of the plan, ``to_pandas`` a row for each run that is done. DuckDB and
    Polars read ``parts/*.parquet`` in the folder themselves.
    """

    def __init__(self, store: Store) -> None:
        self._store = store

    @property
    def folder(self) -> Path:
        """The folder."""
        return self._store.folder

    @property
    def done(self) -> NDArray[np.bool_]:
        """Which runs have a row, shape (runs,)."""
        return self._store.done

    @property
    def measures(self) -> tuple[str, ...]:
        """Names of the measures."""
        return self._store.measures

    def table(self) -> Table:
        """Return a row for each run that is done, ordered by their numbers, as columns."""
        parts = list(self._store.rows())
        if not parts:
            return {}
        order = np.argsort(np.concatenate([part["run"] for part in parts]), kind="stable")
        return {name: np.concatenate([part[name] for part in parts])[order] for name in parts[0]}

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame with a row for each run that is done, by its number."""
        plain = xarray.Dataset({name: ("row", values) for name, values in self.table().items()})
        frame: Any = plain.to_dataframe()
        return frame.set_index("run") if "run" in frame else frame

    def to_xarray(self) -> xarray.Dataset:
        """Return the measures over the axes of the plan: a group of keys each, and ``repeat``.

        NaN where a run is not done or failed; ``fault`` has its message. Values of the keys are coordinates, numbers in
        SI units.
        """
        campaign, shape = self._store.campaign, self._store.campaign.plan.shape
        axes, units = (*axis_names(campaign.plan), "repeat"), units_of(campaign, self.measures)
        table, variables = self.table(), dict[str, Any]()
        for name in (*self.measures, "seconds", "fault", "seed"):
            kind: Any = object if name == "fault" else np.int64 if name == "seed" else np.float64
            whole = np.full(len(campaign), {object: "", np.int64: -1}.get(kind, np.nan), dtype=kind)
            if table:
                whole[table["run"]] = table[name]
            about = {"units": units[name]} if name in units else {}
            about |= {"long_name": MEASURES[name].meaning} if name in MEASURES else {}
            variables[name] = (axes, whole.reshape(shape), about)
        coordinates: dict[str, Any] = {"repeat": np.arange(shape[-1])}
        for number, (axis, group) in enumerate(zip(axes, campaign.plan.vary, strict=False)):
            points = [campaign.points(number).at(point) for point in range(group.length)]
            for key in group.keys:
                values = column_of(campaign, key, [point[key] for point in points])
                coordinates[key] = (axis, values, {"units": units[key]} if key in units else {})
            if group.sample == "saltelli":
                pages = pages_of(tuple(group.keys))
                coordinates |= {"design": (axis, np.tile(pages, group.count or 0))}
                coordinates |= {"design_row": (axis, np.repeat(np.arange(group.count or 0), len(pages)))}
        # Seeds that vary by themselves are values of a key.
        variables = {name: one for name, one in variables.items() if name not in coordinates}
        title = {"title": "campaign", "runs": len(campaign), "done": int(self.done.sum())}
        return xarray.Dataset(variables, coordinates, title)

    def measured(self, measure: str) -> NDArray[np.float64]:
        """Return a measure over the axes of the plan; NaN where a run is not done, failed or had nothing to measure.

        Raises
        ------
        KeyError
            If there is no such measure; the message names those that there are.
        """
        if measure not in self.measures:
            raise KeyError(f"there is no measure {measure!r}; there are {', '.join(self.measures)}")
        plan = self._store.campaign.plan
        found = np.full(plan.runs, np.nan)
        for part in self._store.rows():
            found[part["run"]] = part[measure]
        return found.reshape(plan.shape)

    def sensitivity(self, measure: str) -> xarray.Dataset:
        """Return Sobol's indices of a measure, of a plan with a group of ``sample: saltelli``.

        Parameters
        ----------
        measure
            Its name.

        Returns
        -------
        xarray.Dataset
            ``first_order`` and ``total_order`` over ``key``, the last of which is the seed, and the other axes of the
            plan; ``first_order_interval`` and ``total_order_interval`` have ``end`` besides, the lower and the upper of
            95 %. ``rows`` of the design are counted, ``rows_left_out`` are not, as a run of theirs has no measure.
            Repetitions are averaged.

        Raises
        ------
        InputError
            If no group has Saltelli's design.
        KeyError
            If there is no such measure.
        """
        plan = self._store.campaign.plan
        axis = next((n for n, group in enumerate(plan.vary) if group.sample == "saltelli"), None)
        if axis is None:
            raise InputError(
                "Sobol's indices need Saltelli's design.",
                remedy="Write sample: saltelli into the group of the keys.",
            )
        group, names = plan.vary[axis], axis_names(plan)
        values = np.moveaxis(self.measured(measure).mean(axis=-1), axis, -1)
        outer = values.shape[:-1]
        state = np.random.SeedSequence([plan.seed, 2, axis]).generate_state(1, np.uint64)
        rows = values.reshape(-1, group.count or 0, len(group.keys) + BESIDE_KEYS)
        found = [indices_of(one, int(state[0])) for one in rows]
        others = [name for number, name in enumerate(names) if number != axis]

        def over(name: str, *inner: str) -> Any:
            stacked = np.array([getattr(one, name) for one in found])
            return ([*others, *inner], stacked.reshape((*outer, *stacked.shape[1:])))

        whole = self.to_xarray()
        beside = {
            name: one.variable for name, one in whole.coords.items() if one.dims and one.dims[0] in others
        }
        return xarray.Dataset(
            {
                "first_order": over("first", "key"),
                "first_order_interval": over("first_interval", "key", "end"),
                "total_order": over("total", "key"),
                "total_order_interval": over("total_interval", "key", "end"),
                "rows": over("rows"),
                "rows_left_out": over("left_out"),
            },
            {"key": [*group.keys, "seed"], "end": ["low", "high"], **beside},
            {"title": "Sobol's indices", "measure": measure, "level": LEVEL},
        )

    def plot_sensitivity(self, measure: str) -> Figure:
        """Draw Sobol's indices of a measure with matplotlib; faults as of :meth:`sensitivity`.

        Returns
        -------
        matplotlib.figure.Figure
            A new figure of pyplot: first and total order of each key, a panel for each value of the plan's other axes.
        """
        # Late: most campaigns are drawn by their report, and pyplot takes a third of a second.
        from matplotlib import pyplot

        from scanner_sim.campaign.report_pictures import panel_sensitivity, sensitivity_size
        from scanner_sim.products.pictures.style import house_style

        found = self.sensitivity(measure)
        with house_style():
            figure = pyplot.figure(figsize=sensitivity_size(found), layout="constrained")
            panel_sensitivity(figure, found)
        return figure

    def __repr__(self) -> str:
        """Return a line."""
        left = len(self.done) - int(self.done.sum())
        return f"Campaign of {len(self.done):,} runs in {self.folder}: {left:,} left, {self._store.failed:,} failed"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: medians of the measures."""
        table = self.table()
        rows = [
            (name, f"{np.nanmedian(table[name]):.4g} {units}".removesuffix(" 1"))
            for name, units in units_of(self._store.campaign, self.measures).items()
            if name in self.measures and name in table and np.isfinite(table[name]).any()
        ]
        return html_box(repr(self), html_rows(rows, ("measure", "median")))


def open_campaign(folder: str | Path) -> CampaignResult:
    """Return the campaign that a folder holds, while it runs or after.

    Raises
    ------
    InputError
        If there is none, or its files are broken.
    """
    return CampaignResult(reopened(Path(folder)))
