"""`read_log`: any flight log in, a `FlightLog` out."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from copy import copy
from datetime import UTC, datetime
from functools import cached_property
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Self, TypeVar, TypeVarTuple, overload

import numpy as np
import pandas as pd

from core.errors import LogError, RotoridError
from core.findings import Finding, warning
from core.lazy import lazy
from core.summary import Summarised, listed
from core.units import numbers
from logparse.containers import Buffer, open_buffer, read_head
from logparse.craft.quadplane import HoveringSource
from logparse.formats import TELEMETRY
from logparse.kept import Kept
from logparse.messages import IntactMessages, Messages
from logparse.source import Boot, MessageSource
from logparse.tables import COLUMNS
from logparse.timebase import utc_from_gps

if TYPE_CHECKING:
    from logparse import canonical
    from logparse import flights as airborne
    from logparse.craft import vehicle as craft
    from logparse.craft.frames import Vehicle
    from logparse.flights import Flight
    from logparse.tables import Tables
else:
    canonical, airborne, craft = lazy("logparse.canonical"), lazy("logparse.flights"), lazy("logparse.craft.vehicle")

_HEAD = 1 << 16

#: UTC that a log may have, s since 1970: from 2001 to 2100. What is outside is damage, not a date.
_FIRST_UTC, _LAST_UTC = 1.0e9, 4.1e9
#: The GPS week in which 2100 begins.
_LAST_WEEK = 6261

#: Reader modules in the order of asking; the surest signs first.
_READERS = (
    ("logparse.ulog.reader", "UlogSource"),
    ("logparse.dataflash.binary", "DataflashSource"),
    ("logparse.dataflash.text", "DataflashTextSource"),
    ("logparse.mavlink.tlog", "TlogSource"),
)

#: Boots that are looked into for the longest flight; in a file with more, the longest boots.
_MOST_BOOTS = 8
#: Messages of outputs with the first under its names, and how far above its least a driven one is [us].
_OUTPUTS, _DRIVEN = {"RCOU": ("C1", "Ch1", "Chan1"), "MOT": ("Mot1",), "SERVO_OUTPUT_RAW": ("servo1_raw",)}, 20.0
#: A flight of this part of the time that motors ran is taken for the longest.
_IN_FLIGHT = 0.8

Given = TypeVarTuple("Given")
Made = TypeVar("Made")


class FlightLog(Summarised):
    """One boot of a flight log.

    Attributes
    ----------
    path : Path
    format : str
        ``"dataflash"``, ``"dataflash-text"``, ``"tlog"``, ``"mavlink-raw"`` or ``"ulog"``.
    boots : tuple of Boot
        Power-ups in the file.
    boot : Boot
        The one that this log shows.
    messages : Messages
        Mapping from message name to DataFrame, as logged: index `t` [s, boot clock], scaled columns, units of the
        columns in ``frame.attrs["units"]``.
    intact : IntactMessages
        The same without damaged values.
    """

    def __init__(self, path: Path, source: MessageSource, boot: Boot, findings: tuple[Finding, ...] = ()):
        self.path = path
        self.format = source.format
        self.boots = source.boots
        self.boot = boot
        self._kept = Kept(sum(source.counts(boot).values()))
        self.messages = Messages(source, boot, self._kept)
        self.intact = IntactMessages(self.messages, self._kept, checked=source.format in TELEMETRY)
        self._source = source
        self._own_findings = list(findings)
        self._shown: int | None = None

    @cached_property
    def parameters(self) -> Mapping[str, float]:
        """Autopilot parameters: the last value of each in this boot, or of a boot without any in those before it.

        They outlast a restart, and a clock that jumps back is none.
        """
        kept = self._source.parameters(self.boot)
        before = self.boots[: self.boots.index(self.boot)][::-1]
        boots = chain([self.messages], (Messages(self._source, each) for each in before))
        found = next(filter(None, map(_parameters, boots)), {}) if kept is None else dict(kept)
        odd = sorted(name for name, value in found.items() if not _possible(value))
        if odd:
            self._own_findings.append(
                warning(
                    "impossible-values",
                    f"Parameters with a value that none can have are left out: {', '.join(odd[:8])}"
                    + (f" and {len(odd) - 8} more." if len(odd) > 8 else "."),
                    "Set them again on the autopilot.",
                    count=len(odd),
                )
            )
        return {name: value for name, value in found.items() if _possible(value)}

    @cached_property
    def parameters_flown(self) -> Mapping[str, float]:
        """Parameters as they were when `flight` ended: what was set after it belongs to flights to come."""
        return self.parameters if self.flight is None else self.parameters_at(self.flight.stop)

    def parameters_at(self, t: float) -> Mapping[str, float]:
        """Return parameters as they were at a time, or first became known after it.

        Parameters
        ----------
        t : float
            s on the boot clock.
        """
        if "PARM" not in self.messages:
            return self.parameters
        rows = self.messages["PARM"]
        later = rows.index.to_numpy(np.float64) > t
        if not later.any():
            return self.parameters
        first, before = _last_values(rows[::-1], "Name", "Value"), _last_values(rows[~later], "Name", "Value")
        return {name: value for name, value in (first | before).items() if _possible(value)}

    @cached_property
    def vehicle(self) -> "Vehicle":
        """The craft as the log describes it."""
        others = (Messages(self._source, boot) for boot in self.boots[:_MOST_BOOTS] if boot != self.boot)
        elsewhere = chain(self._source.prelude, *map(craft.printed, others))
        return craft.describe(self.messages, format=self.format, parameters=self.parameters, elsewhere=elsewhere)

    @cached_property
    def _built(self) -> tuple["Tables", Callable[[], tuple[Finding, ...]]]:
        return canonical.gather_tables(
            self.intact, format=self.format, parameters=self.parameters, vehicle=self.vehicle, kept=self._kept
        )

    @property
    def tables(self) -> "Tables":
        """Canonical tables, the same for every format and firmware."""
        return self._built[0]

    @cached_property
    def flights(self) -> tuple["Flight", ...]:
        """Airborne intervals in this boot; none of an aeroplane or a rover, unless motors lift it (a quadplane)."""
        if self.vehicle.other_craft and not self.parameters.get("Q_ENABLE"):
            return ()
        return airborne.find_flights(self.tables)

    @property
    def flight(self) -> "Flight | None":
        """The flight that `of_flight` chose, else the longest; None where the craft never left the ground."""
        if self._shown is not None:
            return self.flights[self._shown]
        return max(self.flights, key=lambda flight: flight.stop - flight.start, default=None)

    @property
    def of_one_flight(self) -> bool:
        """Whether `of_flight` chose the flight, so that nothing of others is asked for."""
        return self._shown is not None

    @property
    def name(self) -> str:
        """Name of the file, with the number of the flight where `of_flight` chose one of several."""
        if self._shown is None or len(self.flights) == 1 or len(self.boots) > 1:
            return self.path.name
        return f"{self.path.name}#{self._shown + 1}"

    def derived(self, make: Callable[["FlightLog", *Given], Made], *given: *Given) -> Made:
        """Return what a function makes of this log and of further arguments, kept as tables are while there is room.

        Parameters
        ----------
        make : callable
            A module's function, whose result is not altered by those who ask for it.
        *given
            Its further arguments, hashable.
        """
        return self._kept.get((make, self._shown, given), lambda: make(self, *given))

    def of_boot(self, boot: Boot) -> Self:
        """Return another power-up of the same file."""
        return type(self)(self.path, self._source, boot)

    def of_flight(self, number: int) -> Self:
        """Return this log with another of its flights as `flight`; messages and tables are shared.

        Parameters
        ----------
        number : int
            1 for the first.

        Raises
        ------
        LogError
            There are fewer flights.
        """
        if not 1 <= number <= len(self.flights):
            count = len(self.flights)
            raise LogError(f"{self.path.name} holds {count} flight{'' if count == 1 else 's'}, not {number}")
        shown = copy(self)
        shown._shown = number - 1
        vars(shown).pop("parameters_flown", None)
        return shown

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What reading the file and building the tables had to say."""
        tables = self._built[1]()
        return (*self._own_findings, *self._source.findings, *tables)

    @cached_property
    def start_utc(self) -> datetime | None:
        """UTC at t = 0 of the boot clock, from GPS or the ground station's clock; None where nothing tells."""
        return _start_utc(self.messages)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last message of this boot."""
        return self.boot.t_end - self.boot.t_start

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this log."""
        craft = (self.vehicle.autopilot, self.vehicle.frame_class, self.vehicle.frame_type)
        flights = [f"{flight.start:.0f} to {flight.stop:.0f} s" for flight in self.flights]
        return {
            "file": f"{self.path.name} ({self.format})",
            "start": "not known" if self.start_utc is None else f"{self.start_utc:%Y-%m-%d %H:%M:%S} UTC",
            "duration": f"{self.duration:.1f} s" + (f", {len(self.boots)} power-ups" if len(self.boots) > 1 else ""),
            "craft": " ".join(word for word in craft if word) or "not known",
            "flights": listed(flights, 4) or "none",
            "messages": f"{len(self.messages)} types, {len(self.parameters)} parameters",
            "tables": listed([name for name in COLUMNS if self.tables.has(name)], 8) or "none",
        }


Log = TypeVar("Log", bound=FlightLog)


@overload
def read_log(path: str | Path, boot: int | None = None) -> FlightLog: ...


@overload
def read_log(path: str | Path, boot: int | None = None, *, kind: type[Log]) -> Log: ...


def read_log(path: str | Path, boot: int | None = None, *, kind: type[FlightLog] = FlightLog) -> FlightLog:
    """Read a flight log of any known format, recognised by its content.

    Parameters
    ----------
    path : path-like
        DataFlash binary or text, MAVLink telemetry or PX4 ulog; also inside a gzip or zip archive.
    boot : int, optional
        Which power-up of the autopilot to show, an index into ``log.boots``; default the one with the longest flight.
    kind : type of FlightLog
        Subclass to return.

    Raises
    ------
    LogError
        The file is missing, empty, of an unknown format, or holds no intact message.
    """
    path = Path(path)
    buffer, findings = open_buffer(path, lambda head: _reader(head) is not None)
    head = bytes(buffer[:_HEAD])
    opener = _reader(head)
    if opener is None:
        raise LogError(f"{path.name} is not a flight log: {_what_it_is(head)}")
    try:
        opened = opener(buffer)
        source = opened if opened.format == "ulog" else HoveringSource(opened)
    except LogError as error:
        raise LogError(f"{path.name}: {error}") from error
    boots = source.boots
    if boot is not None:
        if not -len(boots) <= boot < len(boots):
            raise LogError(f"{path.name} holds {len(boots)} power-up{'s' if len(boots) > 1 else ''}, not {boot + 1}")
        return kind(path, source, boots[boot], findings)
    if len(boots) == 1:
        return kind(path, source, boots[0], findings)
    longest = sorted(boots, key=lambda b: b.t_start - b.t_end)[:_MOST_BOOTS]
    logs = {log: _driven(log) for log in (kind(path, source, each, findings) for each in longest)}
    shown, most = next(iter(logs)), (-1.0, 0.0)
    for log in sorted(logs, key=lambda log: -logs[log]):
        if most[0] >= _IN_FLIGHT * logs[log]:
            break  # nor did the motors of any behind it run for longer: no need to build its tables
        flown = _flown(log)
        if flown > most:
            shown, most = log, flown
    return shown


def read_flights(path: str | Path) -> tuple[FlightLog, ...]:
    """Read every flight of a file: a log for each, in the order in which they were flown.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    tuple of FlightLog
        Each with another `FlightLog.flight`. Those of one power-up share their messages and tables. Without a flight
        one log, as `read_log` returns it.

    Raises
    ------
    LogError
        As `read_log` raises it.
    """
    log = read_log(path, 0)  # any: which flew longest is not asked
    if len(log.boots) == 1:
        return tuple(log.of_flight(k + 1) for k in range(len(log.flights))) or (log,)
    flights: list[FlightLog] = []
    for other in _power_ups(log):
        with suppress(RotoridError):  # a power-up without tables has no flight
            flights += (other.of_flight(k + 1) for k in range(len(other.flights)))
    return tuple(flights) or (read_log(path),)


def read_power_ups(path: str | Path) -> tuple[FlightLog, ...]:
    """Open every power-up of a log file, in order of time; the longest of a file with very many.

    Raises
    ------
    LogError
        As `read_log` raises it.
    """
    return _power_ups(read_log(path, 0))


def _power_ups(log: FlightLog) -> tuple[FlightLog, ...]:
    longest = sorted(log.boots, key=lambda b: b.t_start - b.t_end)[:_MOST_BOOTS]
    return tuple(log if boot == log.boot else log.of_boot(boot) for boot in log.boots if boot in longest)


def check_is_log(path: Path) -> None:
    """Raise LogError unless a file begins like a log: a look at its first 64 kB."""
    head = read_head(path, lambda head: _reader(head) is not None)
    if _reader(head) is None:
        raise LogError(f"{path.name} is not a flight log: {_what_it_is(head)}")


#: What every function that asks for logs takes.
GivenLogs = FlightLog | str | Path | Sequence[FlightLog | str | Path]


def logs_of(given: GivenLogs) -> list[FlightLog]:
    """Return the logs, read where only their paths were given.

    Parameters
    ----------
    given : FlightLog, path-like, or a sequence of either

    Raises
    ------
    LogError
        Where something is neither a log nor the path of one.
    """
    several = [given] if isinstance(given, FlightLog | str | Path) else given
    if not isinstance(several, Sequence):
        raise LogError(f"a flight log, its path or a list of them is needed, not {type(given).__name__}")
    return [_log_of(each) for each in several]


def _log_of(given: object) -> FlightLog:
    if isinstance(given, FlightLog):
        return given
    if isinstance(given, str | Path):
        return read_log(given)
    raise LogError(f"a flight log or its path is needed, not {type(given).__name__}")


def _driven(log: FlightLog) -> float:
    """Return for how long an output was driven [s]: no flight is longer. The whole power-up where none is logged."""
    for name, fields in _OUTPUTS.items():
        if name in log.messages:
            frame = log.messages.once(name, fields)
            for pulses in (numbers(frame, field) for field in fields if field in frame):
                t = frame.index.to_numpy(np.float64)[pulses > np.nanmin(pulses, initial=np.inf) + _DRIVEN]
                return float(np.ptp(t)) if len(t) else 0.0
    return log.duration


def _flown(log: FlightLog) -> tuple[float, float]:
    """Longest flight, then duration: what makes one boot more interesting than another."""
    try:
        flight = log.flight
    except RotoridError:
        flight = None
    return (flight.stop - flight.start if flight else 0.0, log.duration)


def _reader(head: bytes) -> Callable[[Buffer], MessageSource] | None:
    """Find the reader for a file that begins with `head`; only what is asked is imported."""
    for module, opener in _READERS:
        reader = import_module(module)
        if reader.looks_like(head):
            found: Callable[[Buffer], MessageSource] = getattr(reader, opener)
            return found
    return None


def _what_it_is(head: bytes) -> str:
    """Report of an unknown file what it seems to be, for the person who gave it."""
    stripped = head.lstrip()
    if not stripped.strip(b"\0\xff"):
        return "it holds nothing but zeros or erased flash"
    try:
        text = stripped[:4096].decode()
    except UnicodeDecodeError as error:
        text = stripped[: error.start].decode() if error.start > 4000 else ""
    if not text or not all(c.isprintable() or c in "\r\n\t" for c in text):
        return "binary data of an unknown kind. Readable are DataFlash .bin and .log, MAVLink .tlog and PX4 .ulg"
    first = text.splitlines()[0][:60]
    if text[0] in "{[":
        return f"it is JSON ({first!r}), perhaps exported from another program. Give the log that it was made from"
    return f"it is a text that begins {first!r} and has no FMT lines"


def _possible(value: float) -> bool:
    """Return whether a parameter can have a value: the largest are bit masks of 32 bits."""
    return abs(value) <= 2.0**32


def _parameters(messages: Messages) -> dict[str, float]:
    """Return the last value of each parameter that a boot logged."""
    return _last_values(messages["PARM"], "Name", "Value") if "PARM" in messages else {}


def _last_values(rows: pd.DataFrame, name: str, value: str) -> dict[str, float]:
    """Last value by name; nothing where a damaged definition has made something else of the columns."""
    if not {name, value} <= set(rows.columns):
        return {}
    rows = rows[rows[name].notna()]  # damage leaves numbers where names are, and these have holes
    with np.errstate(invalid="ignore"):  # signalling NaNs of damaged rows
        values = pd.to_numeric(rows[value], errors="coerce").astype(float)
    return dict(zip(rows[name].astype(str), values, strict=True))


def _start_utc(messages: Mapping[str, pd.DataFrame]) -> datetime | None:
    for name in ("GPS", "GPS2"):
        if name in messages:
            start = _start_from_gps(messages[name])
            if start is not None:
                return start
    for name, column in (("SYSTEM_TIME", "time_unix_usec"), ("vehicle_gps_position", "time_utc_usec")):
        if name in messages and column in messages[name]:
            rows = messages[name]
            stamps = numbers(rows, column)
            known = (stamps > _FIRST_UTC * 1e6) & (stamps < _LAST_UTC * 1e6)
            if known.any():
                offset = np.median(stamps[known] * 1e-6 - rows.index.to_numpy(np.float64)[known])
                return datetime.fromtimestamp(float(offset), UTC)
    return None


def _start_from_gps(rows: pd.DataFrame) -> datetime | None:
    """From DataFlash GPS rows: week and ms of week; named TimeMS and Week before 3.3."""
    names = ("GWk", "GMS") if "GWk" in rows else ("Week", "TimeMS")
    if not set(names) <= set(rows.columns):
        return None
    week, ms = (numbers(rows, name) for name in names)
    ms = np.rint(ms / rows.attrs.get("multipliers", {}).get(names[1], 1.0))
    fixed = (week > 1000) & (week < _LAST_WEEK) & (ms >= 0.0) & (ms <= 604_800_000.0)
    if "Status" in rows:
        fixed &= numbers(rows, "Status") >= 3
    if not fixed.any():
        return None
    seconds = week * 604800.0 + ms * 1e-3 - rows.index.to_numpy(np.float64)
    start = float(np.median(seconds[fixed]))
    return utc_from_gps(0, start * 1e3)
