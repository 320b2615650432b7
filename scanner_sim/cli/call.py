"""What all verbs for a scenario share: reading it, its folder, the bar of its progress, and the closing words."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import scenario_of, warn
from scanner_sim.cli.tables import named_files
from scanner_sim.config import load_scenario, scenario_warnings
from scanner_sim.config.scenario import Scenario
from scanner_sim.products.files.folder import ResultFolder, claim_folder, write_folder, write_text
from scanner_sim.render.libraries import DeviceChoice


@dataclass(frozen=True)
class Call:
    """One call of a verb.

    Attributes
    ----------
    config
        File of the scenario.
    output
        Folder or file of the result.
    overrides
        Replaced values of the scenario, as KEY=VALUE.
    device
        Where to compute.
    overwrite
        Whether an existing result is replaced.
    quiet
        Whether nothing but errors is printed.
    """

    config: Path
    output: Path
    overrides: Sequence[str]
    device: DeviceChoice
    overwrite: bool
    quiet: bool

    def scenario(self) -> Scenario:
        """Return the scenario; warn of what looks unintended.

        Raises
        ------
        ScenarioError
            With all faults of the file.
        """
        scenario = load_scenario(self.config, self.overrides)
        self.warn(scenario_warnings(scenario))
        return scenario

    def claimed(self, kind: ResultFolder) -> contextlib.AbstractContextManager[None]:
        """Keep the folder of the result: see :func:`~scanner_sim.products.files.folder.claim_folder`."""
        return claim_folder(self.output, self.overwrite, kind)

    @contextlib.contextmanager
    def work(
        self, stage: str, unit: str = ""
    ) -> Iterator[tuple[Callable[[int, int], None], Callable[[str], None]]]:
        """Show a bar while the work goes on, as :func:`~scanner_sim.cli.progress.progress_bar`.

        Faults of the scenario that are found now, when the files of its scene are opened, name its file.
        """
        with progress_bar(stage, self.quiet, unit) as (advance, say), scenario_of(self.config):
            yield advance, say

    def write(
        self, kind: ResultFolder, contents: Mapping[str, str | Callable[[Path], None]]
    ) -> tuple[Path, ...]:
        """Write the files of a result, each a text or by what writes it to a path, in the order of presentation.

        Raises
        ------
        InputError, RunError
            As :func:`~scanner_sim.products.files.folder.write_folder`.
        """
        writers = {
            name: partial(write_text, text=content) if isinstance(content, str) else content
            for name, content in contents.items()
        }
        return write_folder(self.output, kind, writers, overwrite=self.overwrite)

    def warn(self, sentences: Sequence[str]) -> None:
        """Print warnings."""
        for sentence in () if self.quiet else sentences:
            warn(sentence)


def files_of(paths: Sequence[Path]) -> dict[str, str]:
    """Return in words which files were written, and into which folder."""
    return (
        {"folder": str(paths[0].parent), "files": named_files([path.name for path in paths])} if paths else {}
    )
