"""Whole analyses by one call: a log, a folder, two reports against each other."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import pandas as pd

import logparse
import pipeline
import reports
from core.serialization import plain
from core.summary import listed
from pipeline.config import AnalysisConfig, ConfigError
from pipeline.execution.executors import processes
from pipeline.execution.stages import Progress
from pipeline.fleet.comparison import compare_reports
from pipeline.fleet.result import FleetResult
from pipeline.names import is_url
from pipeline.results.flight import FlightResult
from pipeline.storage.sources import find
from reports import PRELOAD
from reports.report_json import read_report


def analyze(
    paths: str | Path | Sequence[str | Path],
    out: str | Path | None = None,
    *,
    jobs: int = 1,
    redo: bool = False,
    progress: Progress | None = None,
    **settings: Any,
) -> FlightResult | FleetResult:
    """Analyse one log, or all logs of a folder or list.

    Parameters
    ----------
    paths : path-like or sequence of path-like
        A log, a folder, or several of both; URLs likewise.
    out : path-like, optional
        Folder (or URL) for report.html and everything else; of several logs it also keeps what is done, so that the
        next run does only what is new. Without it nothing is kept.
    jobs : int
        Logs analysed at the same time, each in a process of its own when more than 1 (a script then needs
        ``if __name__ == "__main__":``).
    redo : bool
        Analyse all logs anew.
    progress : callable, optional
        Called with the stage at work and the fraction of the whole that is done.
    **settings
        Fields of `AnalysisConfig`, such as ``mass=1.6``.

    Returns
    -------
    FlightResult or FleetResult
        The former of a log with one flight, the latter of several flights or logs.

    Raises
    ------
    RotoridError
        The one log is not readable, or holds neither a flight nor a trajectory; there is no log; or a setting does
        not exist.
    """
    unknown = sorted(set(settings) - set(AnalysisConfig.__dataclass_fields__))
    if unknown:
        raise ConfigError(
            f"no setting is called {', '.join(unknown)}; there are {', '.join(AnalysisConfig.__dataclass_fields__)}"
        )
    config = AnalysisConfig(**settings)
    several = [paths] if isinstance(paths, str | Path) else paths
    if not isinstance(several, Sequence) or not all(isinstance(path, str | Path) for path in several):
        raise ConfigError("name a log, a folder, or a list of them; logs that are loaded offer `experiment`")
    if len(several) == 1 and Path(several[0]).is_file() and not (config.training or config.validation):
        logs = logparse.read_flights(several[0])
        if len(logs) == 1:
            (result,) = pipeline.analyze_flights(logs, config, progress)
            if out is not None:
                reports.write(result, out)
            return result
    exclude = None if out is None or is_url(out) else Path(out)
    files = find([str(path) for path in several], exclude=exclude)
    if not files.sources:
        reasons = [f"{failure.file}: {failure.reason}" for failure in (*files.failures, *files.passed_over)]
        raise ConfigError(f"there is no log to analyse{'; ' if reasons else ''}{listed(reasons, 3)}")
    workers: AbstractContextManager[Executor | None] = nullcontext()
    if jobs > 1:
        workers = processes(jobs, [source.size for source in files.sources], PRELOAD)
    with workers as executor:
        fleet = pipeline.analyze_fleet(files, config, executor, progress, store=out, publish=reports.publish, redo=redo)
        reports.write_fleet(fleet)
    return fleet


def compare(before: str | Path, after: str | Path) -> pd.DataFrame:
    """Compare the parameters of two reports, such as before and after a change of propellers.

    Parameters
    ----------
    before, after : path-like
        Folders that `analyze` wrote, or their report.json.

    Returns
    -------
    DataFrame
        A row for each craft and parameter that both have: before, after, their difference, and whether that is more
        than flights differ anyway (``significant``).
    """
    comparison = compare_reports(read_report(before), read_report(after), (str(before), str(after)))
    return pd.DataFrame([{"craft": pair.a.name} | plain(row) for pair in comparison.pairs for row in pair.parameters])
