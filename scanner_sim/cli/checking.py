"""The verbs ``check`` and ``info``."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Sequence
from pathlib import Path

from scanner_sim.cli.plan import slow
from scanner_sim.cli.report import scenario_of, warn
from scanner_sim.cli.tables import print_table
from scanner_sim.config import load_scenario, resolved_yaml, scenario_warnings
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError


def check_scenario(config: Path, overrides: Sequence[str]) -> None:
    """Print the resolved scenario; the files of its scene are opened to see whether they are sound.

    Raises
    ------
    ScannerSimError
        If the scenario or its files have faults.
    """
    scenario = load_scenario(config, overrides)
    for sentence in (*scenario_warnings(scenario), *slow(scenario)):
        warn(sentence)
    with scenario_of(config):
        _open_scene(scenario)
    print_yaml(resolved_yaml(scenario))


def print_yaml(text: str) -> None:
    """Print YAML, in colour on a terminal."""
    if not sys.stdout.isatty():
        sys.stdout.write(text)
        return
    from rich.console import Console
    from rich.syntax import Syntax

    Console().print(Syntax(text.rstrip(), "yaml", background_color="default", word_wrap=True))


def _open_scene(scenario: Scenario) -> None:
    from scanner_sim.render.device import activate

    try:
        activate("auto")
    except InputError as error:
        warn(f"the files of the scene were not opened, because nothing here can render: {error}")
        return
    from scanner_sim.instrument.scene_warnings import scene_warnings

    for sentence in scene_warnings(scenario):
        warn(sentence)


def print_info() -> None:
    """Print what the program runs on.

    Raises
    ------
    InputError
        If there is nothing to compute on; what is known is printed before.
    """
    from scanner_sim.products.provenance import versions
    from scanner_sim.render.device import activate
    from scanner_sim.render.libraries import OLDEST_LLVM

    rows = dict(versions())
    rows["Python"] = f"{platform.python_version()} ({sys.executable})"
    rows["system"] = f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors"
    try:
        device = activate("auto")
    except InputError:
        print_table(rows)
        raise
    llvm = device.llvm
    found = f"{'.'.join(map(str, llvm.version))} ({llvm.path})" if llvm is not None else "none"
    rows["LLVM"] = f"{found}; {OLDEST_LLVM} or newer will do"
    rows["GPU"] = device.gpu or "none that is usable"
    rows["variant"] = device.variant
    rows["threads"] = str(device.threads)
    print_table(rows)
