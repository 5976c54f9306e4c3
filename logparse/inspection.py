"""A log at a glance: vehicle, flights, tables with their rates and gaps, messages, and what is wrong."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from core.findings import Finding, gathered
from core.summary import Summarised, listed
from logparse import completeness
from logparse.craft.frames import Vehicle
from logparse.flights import Flight
from logparse.tables import COLUMNS, Tables

if TYPE_CHECKING:
    from logparse.log import FlightLog


#: Rows of a column that are looked at first: one with a value has it here.
_FIRST = 1000


@dataclass(frozen=True, slots=True)
class TableSummary:
    """Extent of one canonical table.

    `rate` is the usual sample rate [Hz] (of the median interval), `start` and `stop` seconds on the boot clock,
    `gaps` the number of intervals much longer than usual and `longest_gap` the longest of them [s].
    """

    name: str
    rows: int
    rate: float
    start: float
    stop: float
    gaps: int
    longest_gap: float
    columns: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MessageSummary:
    """Number of messages of one type and their mean rate [Hz] over the log."""

    name: str
    rows: int
    rate: float


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Inspection(Summarised):
    """What `inspect` finds in one boot of a log."""

    file: str  #: Name of the file.
    format: str
    boots: int  #: Power-ups in the file; `boot` is the index of the one shown.
    boot: int
    start_utc: str | None  #: UTC at the start of the boot clock, ISO 8601.
    duration: float  #: Length of the log [s].
    vehicle: Vehicle
    flights: tuple[Flight, ...]
    tables: tuple[TableSummary, ...]  #: Canonical tables that the log has.
    messages: tuple[MessageSummary, ...]  #: All messages, most frequent first.
    findings: tuple[Finding, ...]  #: Of reading, of the tables, and of `completeness.check`, worst first.
    happened: tuple[str, ...] = ()  #: In each flight, a sentence; of those who have looked.

    def summary(self) -> dict[str, str]:
        """Return the key facts of this log."""
        told = {f"flight {number}": sentence for number, sentence in enumerate(self.happened, start=1)}
        tables = listed([table.name for table in self.tables])
        return {
            "log": f"{self.file}, {self.format}, {self.duration:.0f} s",
            **dict(list(told.items())[:4]),
            "tables": tables,
        }


def inspect(log: "FlightLog") -> Inspection:
    """Summarise a log; of one that `FlightLog.of_flight` made, the tables and the findings of that flight."""
    duration = log.duration
    counts = sorted(log.messages.counts.items(), key=lambda item: (-item[1], item[0]))
    flights = log.flights
    shown = slice(None)
    if log.of_one_flight and log.flight is not None:
        flights = (log.flight,)
        duration = log.flight.duration
        shown = slice(log.flight.start, log.flight.stop)
    # In this order, in which each long table is built once.
    findings = log.findings
    findings += completeness.check(log)
    tables = [summarise(name, log.tables, shown) for name in COLUMNS if log.tables.has(name)]
    return Inspection(
        file=log.name,
        format=log.format,
        boots=len(log.boots),
        boot=log.boots.index(log.boot),
        start_utc=None if log.start_utc is None else log.start_utc.isoformat(timespec="milliseconds"),
        duration=duration,
        vehicle=log.vehicle,
        flights=flights,
        tables=tuple(table for table in tables if table.rows),
        messages=tuple(
            MessageSummary(name, rows, rows / log.duration if log.duration > 0.0 else math.nan) for name, rows in counts
        ),
        findings=gathered(findings),
    )


def summarise(name: str, tables: Tables, shown: slice) -> TableSummary:
    """Measure extent, rate and gaps of a canonical table; modes and events have no rate."""
    columns = {}
    t = np.zeros(0)
    for column in tables.columns(name):
        part = column.loc[shown]
        t = part.index.to_numpy(np.float64)
        columns[str(column.name)] = part.iloc[:_FIRST].notna().any() or part.notna().any()
    rate = math.nan
    gaps = np.zeros(0)
    if name not in ("modes", "events") and len(t) > 1:
        steps = np.diff(t)
        rate = 1.0 / float(np.median(steps))
        gaps = steps[steps > completeness.longest_step(rate)]
    return TableSummary(
        name=name,
        rows=len(t),
        rate=rate,
        start=float(t[0]) if len(t) else math.nan,
        stop=float(t[-1]) if len(t) else math.nan,
        gaps=len(gaps),
        longest_gap=float(gaps.max()) if len(gaps) else 0.0,
        columns=tuple(name for name, known in columns.items() if known),
    )
