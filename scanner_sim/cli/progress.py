"""The bar of a long work: on a terminal with time left, nothing in a pipe."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from rich.console import Console


@contextlib.contextmanager
def progress_bar(
    stage: str, quiet: bool, unit: str = ""
) -> Iterator[tuple[Callable[[int, int], None], Callable[[str], None]]]:
    """Show a bar while the work goes on.

    Parameters
    ----------
    stage
        What is done first.
    quiet
        Show nothing.
    unit
        What is counted, in the plural, where its rate is of interest.

    Yields
    ------
    advance, say
        A function that takes what is done and what there is in all, and one that says what is done now.
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield (lambda done, total: None), (lambda stage: None)
        return
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        Task,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        """What is counted, per second."""

        def render(self, task: Task) -> Text:
            if task.speed is None or not unit:
                return Text("")
            fast = task.speed >= 1e4
            return Text(f"{task.speed / 1e3:.0f} k {unit}/s" if fast else f"{task.speed:.3g} {unit}/s")

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        Rate(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(stage, total=None)
        yield (
            lambda done, total: bar.update(task, completed=done, total=total),
            lambda stage: bar.update(task, description=stage, completed=0, total=None),
        )
