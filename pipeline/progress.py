"""What a person waiting at a terminal sees on stderr: which stage of which log, how far, how long."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter

from pipeline.stages import Progress


@contextmanager
def shown(quiet: bool = False) -> Iterator[Progress]:
    """Give a progress callback that draws a bar on a terminal and writes a line per stage elsewhere."""
    if quiet:
        yield lambda stage, fraction: None
    elif sys.stderr.isatty():
        with _bar() as progress:
            yield progress
    else:
        yield _Lines()


@contextmanager
def _bar() -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        BarColumn(bar_width=24),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.description}", markup=False),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda stage, fraction: bar.update(task, description=stage, completed=fraction)


class _Lines:
    """A line for each stage as it begins, with the time since the start."""

    def __init__(self) -> None:
        self.start = perf_counter()
        self.stage = ""

    def __call__(self, stage: str, fraction: float) -> None:
        """Take note of progress."""
        if stage != self.stage:
            self.stage = stage
            print(f"{perf_counter() - self.start:6.1f} s  {stage}", file=sys.stderr, flush=True)  # noqa: T201
