"""Closed forms beside the rows of a pose study."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from scanner_sim.analytic.pose import facing_errors
from scanner_sim.pose.target_layouts import Layout
from scanner_sim.products.pose_study import COMPONENTS, PoseRow, TargetRow


def with_closed_forms(
    rows: Sequence[PoseRow], arrays: Sequence[Layout], targets: Sequence[TargetRow], reference: float
) -> tuple[PoseRow, ...]:
    """Return the rows with their closed forms: see :class:`~scanner_sim.products.pose_study.PoseRow`.

    Parameters
    ----------
    rows
        Of a study.
    arrays
        The layouts that stand in them.
    targets
        Errors of single targets, at the same ranges.
    reference
        Range whose errors the constant law takes [m]; the nearest to it that was measured.
    """
    layouts = {(item.name, item.size): item for item in arrays}
    found = {(row.range_m, row.quantity): row for row in targets}
    middle = min({row.range_m for row in targets}, key=lambda distance: abs(distance - reference))

    def errors(row: PoseRow, at: float, growth: float = 1.0, *, single: bool = False) -> float:
        """Return a closed form with the single targets' errors at a range, those of ranges times a growth."""
        # Angles alone have no ranges: any will do, and none.
        ranging = "triangulation" if row.ranging == "none" else row.ranging
        own = [found[at, name] for name in ("theta", "phi", f"range_{ranging}")]
        common = [item.common for item in own]
        alone = [math.sqrt(max(item.scatter**2 - item.common**2, 0.0)) for item in own]
        if single:
            alone[2] = math.hypot(own[2].voxel, alone[2])
        if row.ranging != "none" and not alone[2] > 0.0:
            return math.nan
        alone[2], common[2] = alone[2] * growth, common[2] * growth
        every = facing_errors(
            layouts[row.array, row.size_m].points,
            row.range_m,
            row.method,
            (alone[0], alone[1], alone[2]),
            (common[0], common[1], common[2]),
        )
        return float(every[COMPONENTS.index(row.component)])

    return tuple(
        replace(
            row,
            analytic=errors(row, row.range_m),
            constant=errors(
                row, middle, (row.range_m / middle) ** 2 if row.ranging == "triangulation" else 1.0
            ),
            voxel=errors(row, row.range_m, single=True),
        )
        for row in rows
    )
