"""What is asked of logs and reports while somebody waits: run in the process of `api.work.desk`, never here."""

import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from api.machine.answers import LoggedField, LoggedFields, LoggedMessages, MessageCount, NoSignal, Signal, Signals
from core.serialization import plain, restored
from logparse import FlightLog, RotoridError, check_is_log, read_log
from logparse.canonical.instances import INSTANCE_NAMES, instance_column
from logparse.expressions import evaluate
from logparse.signals import LoggedSignal
from pipeline.fleet.review import review
from pipeline.flight.signals import thin
from pipeline.results.craft_review import CraftReview, Note
from pipeline.results.entry import FlightEntry
from pipeline.results.quantity import ParameterChange
from reports.numbers.comparison import compare_reports
from reports.numbers.reading import parse_report, report_of
from reports.pages.comparison import comparison_page
from reports.pages.craft import craft_page as render_craft

#: Logs kept open, signals kept, and bytes of signals kept.
_LOGS, _SIGNALS, _BYTES = 3, 64, 512 << 20

Answer = TypeVar("Answer")

_logs: OrderedDict[Path, FlightLog] = OrderedDict()
_signals: OrderedDict[tuple[Path, str], LoggedSignal] = OrderedDict()


class QuestionError(Exception):
    """There is no answer, for a reason that the user should read."""


def recognise(path: Path, name: str) -> None:
    """Refuse a file that does not begin like a log; `name` is what its user calls it."""
    _in_users_words(lambda: check_is_log(path), path, name)


def list_messages(path: Path, name: str) -> LoggedMessages:
    """List the messages of a log that come more than once, without decoding any."""

    def answer() -> LoggedMessages:
        log = _opened(path)
        counts = sorted(log.messages.counts.items())
        messages = [MessageCount(message, rows) for message, rows in counts if rows > 1]
        return LoggedMessages(float(log.boot.t_start), float(log.boot.t_end), messages)

    return _in_users_words(answer, path, name)


def list_fields(path: Path, name: str, message: str) -> LoggedFields:
    """List the numeric fields of one message, as they are written in expressions."""

    def answer() -> LoggedFields:
        log = _opened(path)
        if message not in log.messages:
            raise QuestionError(f"{name} has no {message}.")
        # What tells instances apart is enough where the format names the fields: a log may hold millions of rows.
        frame = log.messages.once(message, set(INSTANCE_NAMES))
        own = frame.attrs.get("instance")
        if own is not None and own not in frame:
            frame = log.messages.once(message, {*INSTANCE_NAMES, own})
        if "numeric" not in frame.attrs:
            frame = log.messages.once(message)
        units = frame.attrs.get("units", {})
        column = instance_column(frame) or frame.attrs.get("instance")
        numbers = [] if column is None else [int(each) for each in np.unique(frame[column].dropna())]
        sensors = [f"{message}[{number}]" for number in numbers] if len(numbers) > 1 else [message]
        numeric = frame.attrs.get("numeric") or [name for name in frame.columns if frame[name].dtype.kind in "iufb"]
        fields = [str(field) for field in numeric if field != column]
        return LoggedFields(
            [LoggedField(f"{sensor}.{field}", str(units.get(field) or "")) for sensor in sensors for field in fields]
        )

    return _in_users_words(answer, path, name)


def read_signals(
    path: Path, name: str, texts: Sequence[str], start: float | None, stop: float | None, points: int
) -> Signals:
    """Evaluate expressions over a stretch of time, thinned to `points` values each such that no peak is lost."""

    def answer() -> Signals:
        log = _opened(path)
        return Signals([_signal(log, path, text, start, stop, points) for text in texts])

    return _in_users_words(answer, path, name)


def review_craft(entries: list[dict[str, Any]], notes: list[dict[str, Any]]) -> dict[str, Any]:
    """Look at a craft as a whole, see `pipeline.fleet.review`."""
    found: dict[str, Any] = plain(review(restored(entries, list[FlightEntry]), restored(notes, list[Note])))
    return found


def craft_page(found: dict[str, Any], name: str, notes: list[dict[str, Any]]) -> str:
    """Render what the flights of a craft say together."""
    return render_craft(restored(found, CraftReview), name, restored(notes, list[Note]))


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
        t=[round(each, 5) for each in t.tolist()],
        y=[float(f"{each:.7g}") if math.isfinite(each) else None for each in y.tolist()],
    )


def _evaluated(log: FlightLog, path: Path, text: str) -> LoggedSignal:
    key = (path, text)
    if key not in _signals:
        _signals[key] = evaluate(log, text)
        while len(_signals) > _SIGNALS or (
            len(_signals) > 1 and sum(each.t.nbytes + each.y.nbytes for each in _signals.values()) > _BYTES
        ):
            _signals.popitem(last=False)
    _signals.move_to_end(key)
    return _signals[key]


def _opened(path: Path) -> FlightLog:
    if path not in _logs:
        _logs[path] = read_log(path)
        while len(_logs) > _LOGS:
            gone, _ = _logs.popitem(last=False)
            for key in [key for key in _signals if key[0] == gone]:
                del _signals[key]
    _logs.move_to_end(path)
    return _logs[path]


def _in_users_words(answer: Callable[[], Answer], path: Path, name: str) -> Answer:
    try:
        return answer()
    except RotoridError as error:
        raise QuestionError(str(error).replace(path.name, name)) from None
