"""The rows of a campaign as arrays over the axes of its plan."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray
from numpy.typing import NDArray

from scanner_sim.campaign.measures import MEASURES
from scanner_sim.campaign.store import Store, axis_names, column_of, reopened, units_of
from scanner_sim.foundation.html_text import html_box, html_rows
from scanner_sim.products.files.tables import Table


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
        title = {"title": "campaign", "runs": len(campaign), "done": int(self.done.sum())}
        return xarray.Dataset(variables, coordinates, title)

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
