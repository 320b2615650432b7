"""The verb ``calibrate``."""

from __future__ import annotations

import numpy as np

from scanner_sim.cli.call import Call
from scanner_sim.cli.tables import print_table
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files.exchange import check_files, write_files
from scanner_sim.signals.processing import PEAKS


def calibrate_scenario(call: Call) -> None:
    """Measure the systematic error of a scenario's estimator; write its table, and a picture beside it.

    Raises
    ------
    ScannerSimError
        If the scenario has faults, the files or the device cannot be used, or the target is not found.
    OSError
        If the disk fails.
    """
    from scanner_sim.products.pictures.bias import BiasCurve, draw_bias

    file = call.output
    if file.suffix.lower() != ".csv":
        raise InputError(f"{file.name} is no name of a table.", remedy="Write one that ends in .csv.")
    if not file.parent.is_dir():
        raise InputError(f"there is no folder {file.parent}.", remedy="Make it, or name another.")
    picture = file.with_suffix(".png")
    check_files((file, picture), call.overwrite)
    scenario = call.scenario()
    if PEAKS.is_own(scenario.processing.peak):
        raise InputError(
            f"tables correct the program's estimators, and {scenario.processing.peak} is none of them.",
            remedy="Its bias is judged by scanner-sim compare.",
        )
    from scanner_sim.validation.studies.calibrate import measure_bias

    with call.work("along the line") as (advance, _):
        table, passages = measure_bias(scenario, device=call.device, progress=advance)
    from scanner_sim.signals.line.bias import computed_bias
    from scanner_sim.signals.line.bias_table import write_bias

    computed = computed_bias(scenario.processing.peak, passages[0].width, passages[-1].width)
    curves = []
    for passage in passages:
        taken = computed.at(np.array([passage.width]), passage.phase + passage.bias)[0]
        label = f"s = {passage.width:.2f} px, {passage.range:.3g} m"
        curves.append(BiasCurve(label, passage.phase, passage.bias, passage.bias - taken))
    writers = {
        file.name: lambda path: write_bias(table, path),
        picture.name: lambda path: draw_bias(scenario.processing.peak, curves, path),
    }
    write_files(file.parent, writers, overwrite=call.overwrite)
    if call.quiet:
        return
    largest, left = (max(float(np.abs(getattr(c, name)).max()) for c in curves) for name in ("bias", "left"))
    print_table(
        {
            "estimator": scenario.processing.peak,
            "measured at": f"{len(passages)} places, {passages[0].width:.2f} to {passages[-1].width:.2f} px wide",
            "largest error": f"{largest:.4f} px; the computed table would leave {left:.4f} px",
            "files": f"{file}, {picture}",
            "use": f"processing.bias_correction: {file.name}",
        }
    )
