"""What happens in the process of one analysis, apart from the server so that a crash takes nothing else down."""

import os
import resource
import signal
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TypeAlias

Progress: TypeAlias = Callable[[str, float], None]

#: Analyses the log in a file, which its user calls by a name, writes the results into a folder and reports progress.
Analyze: TypeAlias = Callable[[Path, str, Path, Progress], None]


@dataclass(frozen=True, slots=True)
class Advanced:
    """The analysis has come to a stage."""

    stage: str
    progress: float


@dataclass(frozen=True, slots=True)
class Finished:
    """The results are written."""


@dataclass(frozen=True, slots=True)
class Refused:
    """The log cannot be analysed, for a reason that its user should read."""

    reason: str


@dataclass(frozen=True, slots=True)
class OutOfMemory:
    """The analysis needed more memory than it may have."""


@dataclass(frozen=True, slots=True)
class Crashed:
    """The analysis met a bug of ours."""

    traceback: str


Report: TypeAlias = Advanced | Finished | Refused | OutOfMemory | Crashed


def analyze_log(log: Path, name: str, folder: Path, progress: Progress) -> None:
    """Run the pipeline on a log and write its report."""
    # Imported here and not above: the server itself never needs the 200 MB of numpy, numba and pandas.
    import pipeline
    import reports
    from pipeline.stages import overall

    advance = overall(progress)
    result = pipeline.analyze(log, progress=advance, name=Path(name).stem)
    # The report names the file as its user does, not as it is kept here.
    result = replace(result, log=replace(result.log, path=Path(name)))
    advance("report", 0.0)
    reports.write(result, folder)


def run(
    reports_to: Connection,
    analyze: Analyze,
    log: Path,
    name: str,
    folder: Path,
    time_limit: float,
    memory_limit: int,
) -> None:
    """Run one analysis within its limits and report how it goes, ending with anything but `Advanced`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which ends its workers itself.
    os.nice(5)  # Requests come first.
    # The server ends what takes too long. Should the server be gone, the alarm does.
    signal.setitimer(signal.ITIMER_REAL, time_limit + 10.0)
    # Not RLIMIT_AS: mapped files and numba's reservations are address space but not memory.
    resource.setrlimit(resource.RLIMIT_DATA, (memory_limit, memory_limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    last = Advanced("", -1.0)

    def progress(stage: str, fraction: float) -> None:
        nonlocal last
        if stage != last.stage or fraction >= last.progress + 0.01:
            last = Advanced(stage, min(max(fraction, last.progress, 0.0), 1.0))
            reports_to.send(last)

    from logparse import RotoridError

    try:
        analyze(log, name, folder, progress)
    except RotoridError as error:
        reason = str(error)
        if reason.startswith(log.name):  # Errors name the file as it is kept here; its user calls it otherwise.
            reason = name + reason.removeprefix(log.name)
        reports_to.send(Refused(reason))
    except MemoryError:
        reports_to.send(OutOfMemory())
    except Exception:
        reports_to.send(Crashed(traceback.format_exc()))
    else:
        reports_to.send(Finished())
