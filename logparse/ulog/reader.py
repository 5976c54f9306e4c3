"""Read PX4 logs (.ulg) through pyulog, PX4's own reader.

Messages are the logged topics; further instances of a topic are ``topic_1``, ``topic_2`` ... Two more hold what is no
topic: ``information`` (firmware, hardware: columns ``key``, ``value``) and ``logged_messages`` (texts of the autopilot:
columns ``level``, ``message``).
"""

import contextlib
import io
import traceback
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from pyulog import ULog

from core.errors import LogError
from core.findings import Finding, Severity, warning
from logparse.containers import Buffer
from logparse.source import COPY_AGAIN, Boot, MessageSource, mended_times
from logparse.timebase import mend_times
from logparse.ulog.chain import whole_messages

_HEADER_BYTES = 3
#: Severities of the kernel's log, from emergency to debug, count from this character.
_LEVEL_ZERO = ord("0")
#: A flight controller is not up longer, us; later time stamps are damaged.
_LONGEST_UPTIME = 400 * 86_400_000_000
#: Fields of all subscriptions of a log together (a real one of 87 topics has 1,910), and formats within formats.
_MOST_FIELDS, _DEEPEST = 40_000, 8


def looks_like(head: bytes) -> bool:
    """Whether a file that begins so is a PX4 log."""
    return head.startswith(ULog.HEADER_BYTES)


class _Log(ULog):  # type: ignore[misc]
    """A log whose subscriptions have no more fields than any autopilot publishes.

    pyulog makes an object and a column of each. A format that damage has given an array of 60,000, or that holds
    itself, would take gigabytes before the first row is read.
    """

    _fields = 0

    def _MessageAddLogged(self, data: bytes, header: object, message_formats: Mapping[str, Any]) -> object:  # noqa: N802
        """Make a subscription, as pyulog does, if there is room for its fields."""
        self._fields += _count_fields(ULog.parse_string(data[3:]), message_formats)
        if self._fields > _MOST_FIELDS:
            raise ValueError("more fields than a log has")
        return ULog._MessageAddLogged(data, header, message_formats)


def _count_fields(name: str, formats: Mapping[str, Any], depth: int = 0) -> int:
    """Count the fields of a topic, formats within it included; above `_MOST_FIELDS` no further."""
    count = 0
    for kind, size, _ in formats[name].fields:
        nested = 1 if kind in ULog._UNPACK_TYPES else 1 + _count_fields(kind, formats, depth + 1)
        count += max(size, 1) * nested
        if count > _MOST_FIELDS or depth > _DEEPEST:
            return _MOST_FIELDS + 1
    return count


class _Handle(io.BytesIO):
    """A file in memory that never steps back behind the message being read.

    Where a message of a kind unknown to pyulog claims to go on behind the end of the file, pyulog steps back by what it
    claims, and so for ever.
    """

    _header = 0
    _asked = 0

    def read(self, size: int | None = -1, /) -> bytes:
        """Read, and note where the message's header (three bytes) began."""
        if size == _HEADER_BYTES:
            self._header = self.tell()
        elif size is not None:
            self._asked = size
        return super().read(size)

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        """Seek; steps back end at the message's second byte, or at its first where all of it is given back."""
        if whence != io.SEEK_CUR or offset >= 0:
            return super().seek(offset, whence)
        target = self.tell() + offset
        if target == self._header and -offset == _HEADER_BYTES + self._asked:
            return super().seek(target)
        return super().seek(max(target, self._header + 1))


class UlogSource(MessageSource):
    """An opened PX4 log; LogError where pyulog cannot read the file, or it holds no data."""

    format = "ulog"

    def __init__(self, buffer: Buffer):
        said = io.StringIO()
        sound, self._skipped = whole_messages(buffer)
        try:
            # pyulog reports damage by printing.
            with contextlib.redirect_stdout(said):
                self._log = _Log(_Handle(sound))
        except MemoryError:
            raise
        except Exception as error:  # damage makes pyulog raise whatever its parsing stumbles over
            if _is_ours(error):
                raise
            raise LogError(f"pyulog cannot read this PX4 log, it is damaged: {error}") from error
        self._topics: dict[str, list[Any]] = {}
        for topic in self._log.data_list:
            stamps = topic.data.get("timestamp", np.empty(0))
            if len(stamps) and stamps.dtype == np.uint64:  # damage gives it other types
                name = topic.name if topic.multi_id == 0 else f"{topic.name}_{topic.multi_id}"
                self._topics.setdefault(name, []).append(topic)
        for topics in self._topics.values():
            topics.sort(key=lambda topic: int(topic.data["timestamp"][0]))
        if not self._topics:
            raise LogError(
                "the PX4 log holds no data: logging stopped at once or the file is cut off behind its header"
            )
        self._boots = (Boot(0, len(buffer), *self._span()),)
        self._mended: dict[str, int] = {}
        self._found = tuple(self._log_findings(said.getvalue()))

    def _span(self) -> tuple[float, float]:
        """First and last time of the topics, s on the boot clock."""
        stamps = np.concatenate([topic.data["timestamp"] for topics in self._topics.values() for topic in topics])
        good = stamps[(stamps > 0) & (stamps < _LONGEST_UPTIME)]
        if not len(good):
            return 0.0, 0.0
        start = self._log.start_timestamp if self._log.start_timestamp < _LONGEST_UPTIME else 0
        # A few damaged stamps must not stretch the log.
        low, high = np.percentile(good, (1.0, 99.0))
        margin = (high - low) * 0.1 + 10e6
        good = good[(good > low - margin) & (good < high + margin)]
        first, last = int(good.min()), int(good.max())
        return (max(first, start) if start < last else first) / 1e6, last / 1e6

    @property
    def boots(self) -> tuple[Boot, ...]:
        """Return the one power-up of the log."""
        return self._boots

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What reading had to say."""
        return (*self._found, *mended_times(self._mended))

    def counts(self, boot: Boot) -> Mapping[str, int]:
        """Rows of each topic, and of what is no topic."""
        counts = {name: sum(len(topic.data["timestamp"]) for topic in topics) for name, topics in self._topics.items()}
        counts["information"] = len(self._log.msg_info_dict)
        counts["logged_messages"] = len(self._texts())
        return {name: count for name, count in counts.items() if count}

    def parameters(self, boot: Boot) -> Mapping[str, float]:
        """Autopilot parameters, the last value of each."""
        found = {name: float(value) for name, value in self._log.initial_parameters.items() if _is_number(value)}
        found.update({name: float(value) for _, name, value in self._log.changed_parameters if _is_number(value)})
        return found

    def decode_many(
        self, names: Iterable[str], boot: Boot, fields: Collection[str] | None = None
    ) -> dict[str, pd.DataFrame]:
        """Return several topics; arrays have a column for each element (``q[0]``), text has one."""
        return {name: self._decode(name, boot) for name in names}

    def _decode(self, name: str, boot: Boot) -> pd.DataFrame:
        if name == "information":
            facts = self._log.msg_info_dict
            columns: dict[str, Any] = {
                "key": pd.array(list(facts), dtype="str"),
                "value": pd.array(_texts_of(facts), dtype="str"),
            }
            return _frame(columns, np.full(len(facts), boot.t_start))
        if name == "logged_messages":
            texts = self._texts()
            columns = {
                "level": np.array([level for _, level, _ in texts], np.int8),
                "message": pd.array([text for _, _, text in texts], dtype="str"),
            }
            return _frame(columns, self._times(name, np.array([stamp for stamp, _, _ in texts], np.uint64)))
        parts = [_columns(topic) for topic in self._topics[name]]
        joined = parts[0]
        if len(parts) > 1:
            # Topics that were subscribed to again, perhaps in another layout.
            shared = [column for column in parts[0] if all(column in part for part in parts)]
            joined = {column: np.concatenate([part[column] for part in parts]) for column in shared}
        stamps = np.concatenate([topic.data["timestamp"] for topic in self._topics[name]])
        return _frame(joined, self._times(name, stamps))

    def _times(self, name: str, stamps: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """Boot clock, s."""
        # What was last published before logging began is older than the log.
        t, mended = mend_times(stamps.astype(np.float64) / 1e6, 0.0, self._boots[0].t_end)
        if mended:
            self._mended[name] = mended
        return t

    def _texts(self) -> list[tuple[int, int, str]]:
        """Time [us], severity (0 emergency .. 7 debug) and text of the autopilot's messages."""
        plain = self._log.logged_messages
        tagged = [message for messages in self._log.logged_messages_tagged.values() for message in messages]
        rows = [
            (message.timestamp, min(max(message.log_level - _LEVEL_ZERO, 0), 7), message.message.strip("\0\t "))
            for message in (*plain, *tagged)
        ]
        return sorted(rows, key=lambda row: row[0])

    def _log_findings(self, said: str) -> Iterator[Finding]:
        if self._skipped or self._log.file_corruption or said:
            text = "The PX4 log is damaged; what could be read around the damage was read."
            evidence = {"pyulog": first} if (first := said.strip().partition("\n")[0]) else {}
            yield warning("file-damaged", text, COPY_AGAIN, bytes=self._skipped, **evidence)
        if dropouts := [dropout.duration / 1e3 for dropout in self._log.dropouts]:
            total, longest = sum(dropouts), max(dropouts)
            yield warning(
                "log-gaps",
                f"The autopilot's logger stopped {len(dropouts)} times for {total:.2f} s in all, {longest:.2f} s at "
                "most, because its card was too slow.",
                "Use a faster card or log fewer topics (SDLOG_PROFILE).",
                dropouts=len(dropouts),
                seconds=total,
                longest=longest,
            )
        if any(key.startswith("hardfault") for key in self._log.msg_info_multiple_dict):
            yield Finding(
                "autopilot-error",
                Severity.ERROR,
                "The log carries a crash dump (hard fault) of the autopilot.",
                "Update the firmware and do not fly before the cause is known.",
            )


def _is_ours(error: Exception) -> bool:
    """Return whether an error was raised by our own code, which pyulog calls: then it is a bug and no damage."""
    *_, last = traceback.walk_tb(error.__traceback__)
    return last[0].f_code.co_filename == __file__


def _is_number(value: object) -> bool:
    return isinstance(value, int | float)


def _texts_of(facts: Mapping[str, Any]) -> list[str]:
    return [
        value.hex() if isinstance(value, bytes | bytearray) else str(value).rstrip("\0") for value in facts.values()
    ]


def _columns(topic: Any) -> dict[str, Any]:
    """Columns of a topic by name; pyulog has already spread arrays over their elements."""
    columns: dict[str, Any] = {}
    characters: dict[str, list[npt.NDArray[np.uint8]]] = {}
    for field in topic.field_data:
        if field.field_name not in topic.data:  # a name that damage has emptied
            continue
        values = topic.data[field.field_name]
        base, bracket, _ = field.field_name.partition("[")
        if field.type_str == "char" and bracket:
            characters.setdefault(base, []).append(values.view(np.uint8))
            columns[base] = None
        else:
            columns[field.field_name] = np.ascontiguousarray(values)
    for base, cells in characters.items():
        rows = np.stack(cells, axis=1)
        texts = [row.tobytes().partition(b"\0")[0].decode(errors="replace") for row in rows]
        columns[base] = pd.array(texts, dtype="str")
    return columns


def _frame(columns: Mapping[str, Any], t: npt.NDArray[np.float64]) -> pd.DataFrame:
    frame = pd.DataFrame(dict(columns), index=pd.Index(t, name="t"))
    frame.attrs["units"] = {}
    return frame
