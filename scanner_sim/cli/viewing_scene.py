"""The verb ``scene``: what stands before the scanner."""

from __future__ import annotations

import math
from functools import partial

import typer

from scanner_sim.cli.call import Call
from scanner_sim.cli.report import scenario_of
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.instrument.scene_warnings import scene_warnings
from scanner_sim.instrument.view_scene import view_scene
from scanner_sim.products.files.exchange import write_file
from scanner_sim.products.pictures.scene import draw_scene
from scanner_sim.products.scene_view import SceneView


def show_scene(call: Call) -> None:
    """Print what stands before the scanner of a scenario, and draw it.

    Raises
    ------
    ScannerSimError
        If the scenario, its files or the device cannot be used, or the picture cannot be written.
    """
    scenario = call.scenario()
    with scenario_of(call.config):
        view = view_scene(scenario, device=call.device)
        call.warn(scene_warnings(scenario, device=call.device))
    title = f"{call.config.name}: what stands before the scanner when the scan begins"
    path = write_file(call.output, partial(draw_scene, view, title), overwrite=call.overwrite)
    if call.quiet:
        return
    if view.objects:
        print_rows(list(_table(view)), left=(0, 1, 5, 6))
        typer.echo("")
    field = view.field
    ends = [f"{math.degrees(end):.4g}" for end in (*field.horizontal, *field.vertical)]
    print_table(
        {
            "field of view": f"Θ {ends[0]} to {ends[1]} deg, φ {ends[2]} to {ends[3]} deg",
            "ranges seen": f"{field.near:.4g} m to {'infinity' if field.far == float('inf') else f'{field.far:.4g} m'}",
            "picture": str(path),
        }
    )


def _table(view: SceneView) -> list[tuple[str, ...]]:
    """Return the objects of a scene as rows of a table."""
    rows: list[tuple[str, ...]] = [
        ("object", "kind", "size x × y × z [m]", "distance [m]", "triangles", "materials", "seen")
    ]
    for one in view.objects:
        size = " × ".join(f"{extent:.3g}" for extent in one.size)
        kind = f"{one.kind}, moves" if one.moves else one.kind
        materials = ", ".join(one.materials[:6]) + (" …" if len(one.materials) > 6 else "")
        rows.append(
            (one.name, kind, size, f"{one.distance:.4g}", f"{one.triangles:,}", materials, view.seen(one))
        )
    return rows
