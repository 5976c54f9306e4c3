"""Interactive queries of logs and reports, run in the process of `api.work.desk`."""

import math
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from api.machine.answers import (
    LoggedField,
    LoggedFields,
    LoggedMessages,
    LoggedParameter,
    LoggedParameters,
    MessageCount,
    Moment,
    NoSignal,
    Signal,
    Signals,
    SignalSpectrum,
)
from core.serialization import plain, restored
from logparse import FlightLog, RotoridError, check_is_log, read_log
from logparse.canonical.fields import instance_column
from logparse.expressions import evaluate
from logparse.signals import LoggedSignal
from logparse.source import INSTANCE_NAMES
from pipeline.fleet.comparison import compare_reports
from pipeline.fleet.review import review
from pipeline.flight.signals import thin
from pipeline.flight.spectrum import rotor_speeds
from pipeline.results.drift import CraftNote, CraftReview, ParameterChange
from pipeline.results.fleet import FlightEntry
from pipeline.results.span import Span
from reports.pages.comparison import comparison_page
from reports.pages.fleet import craft_page as render_craft
from reports.report_json import parse_report, report_of
from sysid.loops.proof import BY_THEMSELVES
from sysid.records.filtering import welch

#: Limits of the caches: open logs, signals, and bytes of signals.
_LOGS, _SIGNALS, _BYTES = 3, 64, 512 << 20

#: Most moments listed, and fewest and most samples of a spectrum.
_MOMENTS, _FEWEST, _TRANSFORMED = 2000, 256, 1 << 21

#: Time fields, which are listed last, because time is the axis of every plot.
_TIMES = frozenset({"TimeUS", "TimeMS", "timestamp", "timestamp_sample", "time_boot_ms", "time_usec"})

_logs: OrderedDict[Path, FlightLog] = OrderedDict()
_signals: OrderedDict[tuple[Path, str], LoggedSignal] = OrderedDict()


class QuestionError(Exception):
    """There is no answer, for a reason to show to the user."""


def recognise(path: Path, name: str) -> None:
    """Raise QuestionError if a file is not a log; `name` is the user's name of it."""
    with _with_users_name(path, name):
        check_is_log(path)


def list_messages(path: Path, name: str) -> LoggedMessages:
    """List the messages of a log with more than one row, and its modes, events and texts."""
    with _with_users_name(path, name):
        log = _opened(path)
        counts = sorted(log.messages.counts.items())
        messages = [MessageCount(message, rows) for message, rows in counts if rows > 1]
        return LoggedMessages(float(log.boot.t_start), float(log.boot.t_end), messages, _moments(log))


def _moments(log: FlightLog) -> list[Moment]:
    modes, events = log.tables.modes, log.tables.events
    moments = [] if modes is None else [Moment(t, "mode", mode) for t, mode in _rows(modes, "mode")]
    for t, event, detail in () if events is None else _rows(events.head(_MOMENTS), "event", "detail"):
        moments.append(
            Moment(t, "message", detail) if event == "MESSAGE" else Moment(t, "event", f"{event} {detail}".strip())
        )
    return sorted(moments, key=lambda moment: moment.t)


def _rows(table: pd.DataFrame, *names: str) -> "zip[tuple[Any, ...]]":
    """Return the times of a table and its columns as text, row by row."""
    columns = (table[name].astype(str).tolist() for name in names)
    return zip(table.index.to_numpy(np.float64).tolist(), *columns, strict=True)


def list_parameters(path: Path, name: str, before: tuple[Path, str] | None) -> LoggedParameters:
    """List the autopilot's parameters beside those of another log, given as path and name."""
    with _with_users_name(path, name):
        values, earlier = _parameters(path), {} if before is None else _parameters(before[0])
        rows = [
            LoggedParameter(parameter, value, earlier.get(parameter), _changed(parameter, value, earlier))
            for parameter, value in values.items()
        ]
        rows.sort(key=lambda row: (not row.changed, row.name))
        return LoggedParameters(None if before is None else before[1], rows)


def _parameters(path: Path) -> Mapping[str, float]:
    return {name: value for name, value in _opened(path).parameters.items() if math.isfinite(value)}


def _changed(name: str, value: float, earlier: Mapping[str, float]) -> bool:
    """Return whether a parameter changed that the autopilot does not change itself."""
    same = name not in earlier or math.isclose(value, earlier[name], rel_tol=1e-6)
    return not same and not name.startswith(BY_THEMSELVES)


def list_fields(path: Path, name: str, message: str) -> LoggedFields:
    """List the numeric fields of one message, as written in expressions."""
    with _with_users_name(path, name):
        log = _opened(path)
        if message not in log.messages:
            raise QuestionError(f"{name} has no {message}.")
        # Only instance columns are read where the format names the fields: a log may have millions of rows.
        frame = log.messages.once(message, set(INSTANCE_NAMES))
        own = frame.attrs.get("instance")
        if own is not None and own not in frame:
            frame = log.messages.once(message, {*INSTANCE_NAMES, own})
        if "numeric" not in frame.attrs:
            frame = log.messages.once(message)
        units = frame.attrs.get("units", {})
        column = instance_column(frame) or frame.attrs.get("instance")
        numbers = [] if column is None else [int(number) for number in np.unique(frame[column].dropna())]
        sensors = [f"{message}[{number}]" for number in numbers] if len(numbers) > 1 else [message]
        numeric = frame.attrs.get("numeric") or [name for name in frame.columns if frame[name].dtype.kind in "iufb"]
        fields = sorted((str(field) for field in numeric if field != column), key=_TIMES.__contains__)
        return LoggedFields(
            [LoggedField(f"{sensor}.{field}", str(units.get(field) or "")) for sensor in sensors for field in fields]
        )


def read_signals(
    path: Path, name: str, texts: Sequence[str], start: float | None, stop: float | None, points: int
) -> Signals:
    """Evaluate expressions between two times, thinned to `points` values each without losing peaks."""
    with _with_users_name(path, name):
        log = _opened(path)
        return Signals([_signal(log, path, text, start, stop, points) for text in texts])


def read_spectra(path: Path, name: str, texts: Sequence[str], start: float | None, stop: float | None) -> Signals:
    """Compute spectra of expressions between two times, by default of the longest flight, with the rotors' speeds."""
    with _with_users_name(path, name):
        log = _opened(path)
        first, last = (log.flight.start, log.flight.stop) if log.flight else (log.boot.t_start, log.boot.t_end)
        stretch = Span(first if start is None else start, last if stop is None else stop)
        return Signals([_spectrum(log, path, text, stretch) for text in texts], rotor_speeds(log.tables, stretch))


def _spectrum(log: FlightLog, path: Path, text: str, stretch: Span) -> SignalSpectrum | NoSignal:
    """Estimate amplitudes by Welch's method from resampled values."""
    try:
        signal = _evaluated(log, path, text)
    except RotoridError as error:
        return NoSignal(text, str(error).replace(path.name, "the log"))
    inside = (signal.t >= stretch.start) & (signal.t <= stretch.stop) & np.isfinite(signal.y)
    t, y = signal.t[inside][:_TRANSFORMED], signal.y[inside][:_TRANSFORMED]
    if len(t) < _FEWEST or not (step := float(np.median(np.diff(t)))) > 0.0:
        return NoSignal(text, f"{text} has too few samples in this stretch for a spectrum.")
    count = min(_TRANSFORMED, int((t[-1] - t[0]) / step) + 1)
    even = np.interp(t[0] + step * np.arange(count), t, y)
    size = min(count, max(_FEWEST, round(1.0 / step)))
    with np.errstate(over="ignore", invalid="ignore"):  # absurdly large values
        hz, density = welch(even, 1.0 / step, size)
        amplitudes = np.sqrt(2.0 * density * (hz[1] - hz[0]))
    rounded = [float(f"{amplitude:.5g}") if math.isfinite(amplitude) else None for amplitude in amplitudes[1:].tolist()]
    return SignalSpectrum(text, signal.unit, len(t), [round(frequency, 3) for frequency in hz[1:].tolist()], rounded)


def review_craft(entries: list[dict[str, Any]], notes: list[dict[str, Any]]) -> dict[str, Any]:
    """Review a craft, see `pipeline.fleet.review`."""
    reviewed: dict[str, Any] = plain(review(restored(entries, list[FlightEntry]), restored(notes, list[CraftNote])))
    return reviewed


def craft_page(reviewed: dict[str, Any], name: str, notes: list[dict[str, Any]]) -> str:
    """Render the page of a craft's review."""
    return render_craft(restored(reviewed, CraftReview), name, restored(notes, list[CraftNote]))


def compare_numbers(a: bytes, b: bytes, names: tuple[str, str]) -> Sequence[ParameterChange]:
    """Compare the parameters of two reports."""
    try:
        older, newer = (parse_report(content, name) for content, name in zip((a, b), names, strict=True))
        return [row for pair in compare_reports(older, newer, names).pairs for row in pair.parameters]
    except RotoridError as error:
        raise QuestionError(str(error)) from None


def compare(a: dict[str, Any], b: dict[str, Any], names: tuple[str, str]) -> str:
    """Render the comparison of two reports as a page."""
    try:
        older, newer = (report_of(facts, name) for facts, name in zip((a, b), names, strict=True))
        return comparison_page(compare_reports(older, newer, names))
    except RotoridError as error:
        raise QuestionError(str(error)) from None


def _signal(
    log: FlightLog, path: Path, text: str, start: float | None, stop: float | None, points: int
) -> Signal | NoSignal:
    try:
        signal = _evaluated(log, path, text)
    except RotoridError as error:
        return NoSignal(text, str(error).replace(path.name, "the log"))
    first = 0 if start is None else int(np.searchsorted(signal.t, start))
    last = len(signal.t) if stop is None else int(np.searchsorted(signal.t, stop, side="right"))
    # One sample beyond each end, so that lines reach the edges.
    part = slice(max(first - 1, 0), last + 1)
    t, y = thin(signal.t[part], signal.y[part], points)
    return Signal(
        text=text,
        unit=signal.unit,
        samples=last - first,
        t=[round(time, 5) for time in t.tolist()],
        y=[float(f"{value:.7g}") if math.isfinite(value) else None for value in y.tolist()],
    )


def _evaluated(log: FlightLog, path: Path, text: str) -> LoggedSignal:
    key = (path, text)
    if key not in _signals:
        _signals[key] = evaluate(log, text)
        while len(_signals) > _SIGNALS or (
            len(_signals) > 1 and sum(signal.t.nbytes + signal.y.nbytes for signal in _signals.values()) > _BYTES
        ):
            _signals.popitem(last=False)
    _signals.move_to_end(key)
    return _signals[key]


def _opened(path: Path) -> FlightLog:
    if path not in _logs:
        _logs[path] = read_log(path)
        while len(_logs) > _LOGS:
            closed, _ = _logs.popitem(last=False)
            for key in [key for key in _signals if key[0] == closed]:
                del _signals[key]
    _logs.move_to_end(path)
    return _logs[path]


@contextmanager
def _with_users_name(path: Path, name: str) -> Iterator[None]:
    """Replace the path of a log in errors by the name its user gave it."""
    try:
        yield
    except RotoridError as error:
        raise QuestionError(str(error).replace(path.name, name)) from None
