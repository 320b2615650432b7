"""The verb ``view``."""

from __future__ import annotations

from pathlib import Path

from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.tables import print_table
from scanner_sim.products.files.contents import PAGE
from scanner_sim.products.files.exchange import check_files
from scanner_sim.products.formats.convert import result_in
from scanner_sim.render.libraries import DeviceChoice


def view_result(
    result: Path,
    output: Path | None,
    *,
    lines: bool,
    largest_mb: float,
    device: DeviceChoice,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Write the page of a result.

    Raises
    ------
    InputError
        If there is no result, the page is there already or cannot be written, or the scene can no longer be loaded.
    """
    folder = result if result.is_dir() else result.parent
    found, poses = result_in(result)
    page = output or folder / PAGE
    # As the pictures of `show`: what stands beside the result is ours to draw anew.
    overwrite = overwrite or output is None
    check_files([page], overwrite)
    from scanner_sim.instrument.viewing import view

    with progress_bar("lines", quiet, "voxels") as (advance, _):
        path = view(
            found,
            page,
            title=folder.resolve().name,
            lines=lines,
            folder=folder,
            poses=poses,
            largest_mb=largest_mb,
            device=device,
            progress=advance,
            overwrite=overwrite,
        )
    if not quiet:
        print_table({"page": str(path), "size": f"{path.stat().st_size / 1e6:.3g} MB"})
