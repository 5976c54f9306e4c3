"""What a person waiting at a terminal sees on stderr: which logs are at work, how many are done, how long it takes."""

import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from time import perf_counter
from typing import TYPE_CHECKING

from logparse.lazy import lazy
from pipeline.execution.stages import Progress, overall
from pipeline.names import file_name

if TYPE_CHECKING:
    from rich import console as rich_console
    from rich import progress as rich_progress
else:
    rich_console, rich_progress = lazy("rich.console"), lazy("rich.progress")

#: Of the whole, the part after which the time to go can be told from the time gone.
TELLING = 0.03

#: Bytes of a log that take as long as what every log takes, whatever its size.
EACH = 2_000_000

#: Logs at work that are named.
MOST_NAMED = 4


def part_of(progress: Progress, start: float, stop: float) -> Progress:
    """Report something that is a part of the whole."""
    return lambda stage, fraction: progress(stage, start + (stop - start) * fraction)


class Watch:
    """Watches over logs being analysed.

    Parameters
    ----------
    progress : callable
    sizes : mapping of str to int
        Bytes of the files by path or URL: large ones take longer.
    known : int
        Files that need no analysis, for people.
    executor : Executor or None
        Of its calls as many are at work as it has workers; the others wait.
    """

    def __init__(self, progress: Progress, sizes: Mapping[str, int], known: int, executor: Executor | None) -> None:
        self._progress = progress
        self._weights = {url: EACH + size for url, size in sizes.items()}
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
        return overall(lambda stage, fraction: self._progress(f"{what}: {stage}", done + part * fraction))

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


def to_go(elapsed: float, fraction: float) -> str:
    """Report how long it takes from here if it goes on as it went, such as ``"about 3 min to go"``; empty at first."""
    if not TELLING <= fraction < 1.0:
        return ""
    seconds = elapsed * (1.0 - fraction) / fraction
    if seconds < 5.0:
        return ""
    if seconds < 90.0:
        return f"about {10 * max(1, round(seconds / 10.0))} s to go"
    if seconds < 5400.0:
        return f"about {round(seconds / 60.0)} min to go"
    return f"about {seconds / 3600.0:.1f} h to go"


@contextmanager
def _bar() -> Iterator[Progress]:
    columns = (
        rich_progress.BarColumn(bar_width=24),
        rich_progress.TextColumn("{task.percentage:3.0f} %"),
        rich_progress.TimeElapsedColumn(),
        rich_progress.TextColumn("{task.fields[to_go]}", style="dim"),
        rich_progress.TextColumn("{task.description}", markup=False),
    )
    start = perf_counter()
    with rich_progress.Progress(*columns, console=rich_console.Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0, to_go="")
        yield lambda stage, fraction: bar.update(
            task, description=stage, completed=fraction, to_go=to_go(perf_counter() - start, fraction)
        )


class _Lines:
    """A line for each stage as it begins, with the time since the start and the time to go."""

    def __init__(self) -> None:
        self.start = perf_counter()
        self.stage = ""

    def __call__(self, stage: str, fraction: float) -> None:
        """Note progress."""
        if stage != self.stage:
            self.stage = stage
            elapsed = perf_counter() - self.start
            left = to_go(elapsed, fraction)
            print(f"{elapsed:6.1f} s  {stage}{left and f' ({left})'}", file=sys.stderr, flush=True)  # noqa: T201
