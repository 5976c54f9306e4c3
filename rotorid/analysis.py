"""Whole analyses by one call: a log, a folder, two reports against each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

import logparse
import pipeline
import reports
from core.serialization import plain
from core.summary import Summarised, listed
from pipeline.config import AnalysisConfig
from pipeline.errors import ConfigError
from pipeline.execution.executors import processes
from pipeline.execution.stages import Progress
from pipeline.fleet.result import FleetResult
from pipeline.names import is_url
from pipeline.results.entry import FlightEntry
from pipeline.results.fleet import LogFailure
from pipeline.results.flight import FlightResult
from pipeline.results.model_report import ParameterRow
from pipeline.storage.sources import find
from pipeline.storage.store import Store
from reports.numbers.comparison import compare_reports
from reports.numbers.reading import read_report
from rotorid.workers import PRELOAD

_PARAMETER_COLUMNS = ["value", "sigma", "unit", "method", "reason"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Craft(Summarised):
    """One aircraft of a folder of logs.

    Attributes
    ----------
    name : str
        The craft in words.
    training, held_out : tuple of str
        Names of the flights fitted jointly, and of those kept to validate.
    parameters : DataFrame
        Index ``parameter``; columns ``value sigma unit method reason`` (reason: why not determined).
    """

    name: str
    training: tuple[str, ...]
    held_out: tuple[str, ...]
    parameters: pd.DataFrame

    def summary(self) -> Mapping[str, str]:
        """Return the few facts by which a reader knows this craft."""
        known = self.parameters.index[self.parameters["value"].notna()].unique().tolist()
        return {
            "craft": self.name,
            "training": listed(self.training),
            "held out": listed(self.held_out) or "none",
            "determined": listed(known, 5) or "nothing",
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Fleet(Summarised):
    """A folder of logs, analysed.

    Attributes
    ----------
    flights : tuple of FlightEntry
        Every log that gave something, in short.
    crafts : tuple of Craft
        Those with most flights first; single flights count as craft of one flight.
    failures : tuple of LogFailure
        Logs that gave nothing, with the reason.
    report : str
        Path or URL of report.html; empty when nothing was kept.
    """

    flights: tuple[FlightEntry, ...]
    crafts: tuple[Craft, ...]
    failures: tuple[LogFailure, ...]
    report: str

    def summary(self) -> Mapping[str, str]:
        """Return the few facts by which a reader knows this fleet."""
        return {
            "flights": f"{len(self.flights)}: {listed([flight.name for flight in self.flights])}",
            "craft": listed([craft.name for craft in self.crafts]) or "none",
            "failures": listed([f"{failure.file} ({failure.reason})" for failure in self.failures], 2) or "none",
            "report": self.report or "not kept; give out=FOLDER",
        }


def analyze(
    paths: str | Path | Sequence[str | Path],
    out: str | Path | None = None,
    *,
    jobs: int = 1,
    redo: bool = False,
    progress: Progress | None = None,
    **settings: Any,
) -> FlightResult | Fleet:
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
        Called with what is at work and the fraction of the whole that is done.
    **settings
        Fields of `AnalysisConfig`, such as ``mass=1.6``.

    Returns
    -------
    FlightResult or Fleet
        Of a log of one flight; of several flights or logs.

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
    found = find([str(path) for path in several], exclude=exclude)
    if not found.sources:
        reasons = [f"{each.file}: {each.reason}" for each in (*found.failures, *found.passed_over)]
        raise ConfigError(f"there is no log to analyse{'; ' if reasons else ''}{listed(reasons, 3)}")
    workers: AbstractContextManager[Executor | None] = nullcontext()
    if jobs > 1:
        workers = processes(jobs, [source.size for source in found.sources], PRELOAD)
    with workers as executor:
        fleet = pipeline.analyze_fleet(found, config, executor, progress, store=out, publish=reports.publish, redo=redo)
        if not fleet.reported:
            reports.write_fleet(fleet)
            fleet.confirm_report()
    return Fleet(
        flights=fleet.flights,
        crafts=_crafts(fleet),
        failures=fleet.failures,
        report="" if out is None else f"{str(out).rstrip('/')}/report.html",
    )


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
    found = compare_reports(read_report(before), read_report(after), (str(before), str(after)))
    return pd.DataFrame([{"craft": pair.a.name} | plain(row) for pair in found.pairs for row in pair.parameters])


def _crafts(fleet: FleetResult) -> tuple[Craft, ...]:
    joint = [
        _craft(fleet.store, f"crafts/{group.folder}", group.name, group.training, group.held_out)
        for group in fleet.groups
    ]
    grouped = {name for craft in joint for name in (*craft.training, *craft.held_out)}
    single = [
        _craft(fleet.store, f"flights/{flight.folder}", flight.craft_name, (flight.name,), ())
        for flight in fleet.flights
        if flight.name not in grouped
    ]
    return (*joint, *single)


@dataclass(frozen=True, slots=True)
class _Parameters:
    parameters: tuple[ParameterRow, ...] | None


def _craft(store: Store, folder: str, name: str, training: tuple[str, ...], held_out: tuple[str, ...]) -> Craft:
    found = store.read_as(f"{folder}/report.json", _Parameters)
    rows = pd.DataFrame(
        plain(() if found is None else found.parameters or ()), columns=["parameter", *_PARAMETER_COLUMNS[:4], "note"]
    )
    table = rows.rename(columns={"note": "reason"}).set_index("parameter")[_PARAMETER_COLUMNS]
    return Craft(name=name, training=training, held_out=held_out, parameters=table)
