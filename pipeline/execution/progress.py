"""What a person waiting at a terminal sees on stderr: which logs are at work, how many are done, how long it takes."""

import math
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from time import perf_counter
from typing import TYPE_CHECKING

from core.lazy import lazy
from pipeline.execution.stages import Overall, Progress
from pipeline.names import file_name

if TYPE_CHECKING:
    from rich import console as rich_console
    from rich import progress as rich_progress
    from rich import table as rich_table
    from rich import text as rich_text
else:
    rich_console, rich_progress = lazy("rich.console"), lazy("rich.progress")
    rich_table, rich_text = lazy("rich.table"), lazy("rich.text")

#: Logs at work that are named.
MOST_NAMED = 4


def part_of(progress: Progress, start: float, stop: float) -> Progress:
    """Return a progress for something that is a part of the whole."""
    return lambda stage, fraction: progress(stage, start + (stop - start) * fraction)


class Watch:
    """Watches over logs being analysed, by the bytes of their files: large ones take longer."""

    def __init__(self, progress: Progress, sizes: Mapping[str, int], known: int, executor: Executor | None) -> None:
        self._progress = progress
        # Bytes of a log that take as long as what every log takes, whatever its size.
        self._weights = {url: 2_000_000 + size for url, size in sizes.items()}
        self._whole = sum(self._weights.values())
        self._unchanged = f", {known} unchanged" if known else ""
        self._workers = getattr(executor, "count", MOST_NAMED)
        self._begun: list[str] = []
        self._done: set[str] = set()

    def begin(self, url: str) -> None:
        """Note that a log was handed to a worker."""
        self._begun.append(url)
        self._tell()

    def end(self, url: str) -> None:
        """Note that a log is done."""
        self._done.add(url)
        self._tell()

    def within(self, url: str) -> Progress:
        """Return a log's own progress its part."""
        done, part = self._fraction, self._weights[url] / self._whole
        what = f"{self._counted}; {file_name(url)}"
        return Overall(lambda stage, fraction: self._progress(f"{what}: {stage}", done + part * fraction))

    @property
    def _fraction(self) -> float:
        return sum(self._weights[url] for url in self._done) / self._whole

    @property
    def _counted(self) -> str:
        return f"{len(self._done)} of {len(self._weights)} files done{self._unchanged}"

    def _tell(self) -> None:
        at_work = [url for url in self._begun if url not in self._done][: self._workers]
        named = ", ".join(map(file_name, at_work[:MOST_NAMED])) + (" ..." if len(at_work) > MOST_NAMED else "")
        self._progress(f"{self._counted}{named and f'; at work: {named}'}", self._fraction)


@contextmanager
def shown(quiet: bool = False) -> Iterator[Progress]:
    """Return a progress callback that draws a bar on a terminal and writes a line per stage elsewhere."""
    if quiet:
        yield lambda stage, fraction: None
    elif sys.stderr.isatty():
        with _bar() as progress:
            yield progress
    else:
        yield _Lines()


def in_words(seconds: float) -> str:
    """Write a time to go; empty where it is shorter than anybody reads."""
    if seconds < 2.5:
        return ""
    if seconds < 22.5:
        return f"about {5 * round(seconds / 5.0)} s to go"
    if seconds < 90.0:
        return f"about {10 * round(seconds / 10.0)} s to go"
    if seconds < 5400.0:
        return f"about {round(seconds / 60.0)} min to go"
    return f"about {seconds / 3600.0:.1f} h to go"


@contextmanager
def _bar() -> Iterator[Progress]:
    clock = Clock()

    class ToGo(rich_progress.ProgressColumn):
        """Counts down between two reports."""

        def render(self, task: "rich_progress.Task") -> "rich_text.Text":
            """Write the time."""
            return rich_text.Text(in_words(clock.left(perf_counter())), style="dim")

    columns = (
        rich_progress.BarColumn(bar_width=24),
        rich_progress.TextColumn("{task.percentage:3.0f} %"),
        rich_progress.TimeElapsedColumn(),
        ToGo(table_column=rich_table.Column(no_wrap=True, min_width=17)),
        rich_progress.TextColumn(
            "{task.description}", markup=False, table_column=rich_table.Column(no_wrap=True, overflow="ellipsis")
        ),
    )
    with rich_progress.Progress(*columns, console=rich_console.Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)

        def report(stage: str, fraction: float) -> None:
            clock.reach(fraction, perf_counter())
            bar.update(task, description=stage, completed=fraction)

        yield report


class Clock:
    """Estimates the time to go from how far the work had come when, s.

    What was done before the first report of a fraction, such as loading packages, is no measure of the rest; nor is
    what is reported with a fraction of 0 later, as compiling.
    """

    def __init__(self) -> None:
        self._began: tuple[float, float] | None = None
        self._fraction = 0.0
        self._end = math.inf

    def reach(self, fraction: float, now: float) -> None:
        """Note a part of the whole."""
        if self._began is None or fraction == 0.0:
            self._began = (fraction, now) if fraction else None
            return
        # A report that brings nothing new leaves the countdown going.
        if fraction <= self._fraction:
            return
        self._fraction = fraction
        first, start = self._began
        # Of the whole, the part after which the time to go can be told from the time gone.
        if fraction - first >= 0.1 and now > start:
            self._end = now + (now - start) * (1.0 - fraction) / (fraction - first)

    def left(self, now: float) -> float:
        """Return the time to go; 0 while that cannot be told, and when it should be over."""
        return 0.0 if math.isinf(self._end) else max(self._end - now, 0.0)


class _Lines:
    """A line for each stage as it begins, with the time since the start and the time to go."""

    def __init__(self) -> None:
        self.start = perf_counter()
        self.stage = ""
        self._clock = Clock()

    def __call__(self, stage: str, fraction: float) -> None:
        """Note progress."""
        now = perf_counter()
        self._clock.reach(fraction, now)
        if stage != self.stage:
            self.stage = stage
            elapsed = now - self.start
            left = in_words(self._clock.left(now))
            print(f"{elapsed:6.1f} s  {stage}{left and f' ({left})'}", file=sys.stderr, flush=True)  # noqa: T201
