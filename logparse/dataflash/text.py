"""Read DataFlash text logs (.log): what ground stations made of binary logs, and what old autopilots dumped.

Each line is a message: its name, then its values, separated by commas. FMT lines declare the columns as in the binary
format, but values of the legacy characters are printed scaled and flight modes often by name. Lines before the first
FMT line and lines that do not fit their format are passed over.
"""

import re
from collections.abc import Collection, Iterable, Iterator
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from core.errors import LogError
from core.findings import Finding, info, warning
from logparse.containers import Buffer
from logparse.dataflash import _decode
from logparse.dataflash.chain import boots_of
from logparse.dataflash.format import FMT, FMT_ID, Definition, Field, UnitTable, boot_clock
from logparse.source import Boot, MessageSource, listed, mended_times, several_boots
from logparse.timebase import mend_times

_FMT_LINE = re.compile(rb"^\s*FMT\s*,\s*\d+\s*,\s*\d+\s*,\s*\w+\s*,", re.MULTILINE)
_SEPARATOR = re.compile(r"[,\s]\s*")
_MOST_BOOTS = 64

#: Lines before the first message that are kept, and characters of each.
_MOST_PRELUDE, _LONGEST_PRELUDE = 64, 200


def looks_like(head: bytes) -> bool:
    """Whether a file that begins so is a DataFlash text log."""
    return _FMT_LINE.search(head) is not None


class _Group:
    """Lines of one message type under one definition."""

    def __init__(self, definition: Definition):
        self.definition = definition
        self.lines: list[int] = []
        self.texts: list[str] = []
        self.fields: tuple[Field, ...] = _fields(definition)
        self.time, self.time_scale = boot_clock(definition.name, self.fields)
        self.units = ""
        self.multipliers = ""

    @cached_property
    def _split(self) -> tuple[npt.NDArray[np.int64], list[tuple[str, ...]]]:
        """Line numbers and cells of the lines that fit the format."""
        n = len(self.fields)
        # A comma within the last text belongs to the text.
        splits = n - 1 if n and self.fields[-1].type.is_text else -1
        numeric = [k for k, field in enumerate(self.fields) if not _may_be_text(field)]
        numbers, rows = [], []
        for number, text in zip(self.lines, self.texts, strict=True):
            cells = [cell.strip() for cell in text.split(",", splits)] if n else []
            if len(cells) != n:
                cells = _SEPARATOR.split(text)
            if len(cells) == n and _are_numbers(cells[k] for k in numeric):
                numbers.append(number)
                rows.append(tuple(cells))
        return np.array(numbers, np.int64), rows

    @property
    def numbers(self) -> npt.NDArray[np.int64]:
        """Line of each row."""
        return self._split[0]

    @property
    def rows(self) -> int:
        """Rows that fit the format."""
        return len(self._split[0])

    @property
    def misfits(self) -> int:
        """Lines that do not."""
        return len(self.lines) - self.rows

    @cached_property
    def cells(self) -> list[tuple[str, ...]]:
        """Cells by column."""
        return list(zip(*self._split[1], strict=True)) if self.rows else [() for _ in self.fields]

    @property
    def is_gps_clock(self) -> bool:
        """Whether the clock of this message is that of the GPS receiver, in firmware that logs no other."""
        return self.time is not None and self.time.name == "Time"

    def times(self) -> npt.NDArray[np.int64]:
        """Boot clock of each row, us; -1 where there is none."""
        if self.time is None:
            return np.full(self.rows, -1, np.int64)
        values = _numbers(self.cells[self.fields.index(self.time)], self.time)
        seconds = np.asarray(values, np.float64) / self.time_scale
        if self.is_gps_clock:
            seconds[seconds == 0.0] = -1.0  # no fix yet
        return np.rint(np.where((seconds >= 0) & (seconds < 1e11), seconds * 1e6, -1.0)).astype(np.int64)


class DataflashTextSource(MessageSource):
    """An opened DataFlash text log; positions are line numbers from 0. LogError where not one line fits a FMT line."""

    format = "dataflash-text"

    def __init__(self, buffer: Buffer):
        self._unknown: dict[str, int] = {}
        self._mended: dict[str, int] = {}
        self._groups: list[_Group] = []
        self._units = UnitTable()
        self._size = 0
        self._read_lines(bytes(buffer[:]))
        if not any(group.rows for group in self._groups):
            raise LogError("no line of this DataFlash text log fits a FMT line")
        self._read_units()
        self._find_boots()

    def _read_lines(self, raw: bytes) -> None:
        in_force: dict[str, _Group] = {}
        unknown = self._unknown
        start = _FMT_LINE.search(raw)
        lines = raw.decode("utf-8", "replace").split("\n")
        before = raw[: start.start()].count(b"\n") if start else 0
        #: What the autopilot printed before its first message: firmware, board.
        self.prelude = tuple(line.strip()[:_LONGEST_PRELUDE] for line in lines[: min(before, _MOST_PRELUDE)])
        number = before - 1
        for number, line in enumerate(lines[before:], start=before):
            name, comma, text = line.partition(",")
            name = name.strip()
            if not comma:
                # Some writers separate by blanks alone.
                name, _, text = name.partition(" ")
            if name == "FMT":
                definition = _definition(text)
                if definition is not None:
                    known = in_force.get(definition.name)
                    if known is None or known.definition != definition:
                        in_force[definition.name] = _Group(definition)
                        self._groups.append(in_force[definition.name])
                    if FMT.name not in in_force:
                        in_force[FMT.name] = _Group(FMT)
                        self._groups.append(in_force[FMT.name])
            group = in_force.get(name)
            if group is not None:
                group.lines.append(number)
                group.texts.append(text)
            elif name:
                unknown[name] = unknown.get(name, 0) + 1
        self._size = number + 1

    def _read_units(self) -> None:
        """Read the UNIT, MULT and FMTU lines; ids are printed as numbers or as the characters they are."""
        by_id = {group.definition.id: group for group in self._groups}
        for group in self._groups:
            columns = dict(zip((field.name for field in group.fields), group.cells, strict=True))
            name = group.definition.name
            if name == "UNIT" and {"Id", "Label"} <= set(columns):
                for unit_id, label in zip(columns["Id"], columns["Label"], strict=True):
                    self._units.add_unit(_character(unit_id), label)
            elif name == "MULT" and {"Id", "Mult"} <= set(columns):
                for multiplier_id, multiplier in zip(columns["Id"], columns["Mult"], strict=True):
                    self._units.add_multiplier(_character(multiplier_id), float(multiplier))
            elif name == "FMTU" and {"FmtType", "UnitIds", "MultIds"} <= set(columns):
                for row in zip(columns["FmtType"], columns["UnitIds"], columns["MultIds"], strict=True):
                    target = by_id.get(_character(row[0]))
                    if target is not None:
                        target.units, target.multipliers = row[1], row[2]

    def _find_boots(self) -> None:
        numbers = np.concatenate([group.numbers for group in self._groups])
        times = np.concatenate([group.times() for group in self._groups])
        formats = [group.definition.name == FMT.name for group in self._groups]
        is_format = np.repeat(formats, [group.rows for group in self._groups])
        begins = is_format.copy()
        defined = [group.cells[0] for group, is_one in zip(self._groups, formats, strict=True) if is_one]
        begins[is_format] = np.concatenate([np.empty(0, "U3"), *defined]) == str(FMT_ID)
        order = np.argsort(numbers, kind="stable")
        self._clock_lines, self._clock = numbers[order], times[order]
        rows, state = np.zeros((_MOST_BOOTS, 4), np.int64), np.zeros(_decode.STATE_SIZE, np.int64)
        state[_decode.FORMAT_INDEX] = -1
        _decode.follow_clock(self._clock, is_format[order], begins[order], rows, state)
        n = int(state[_decode.BOOTS])
        # From row numbers to line numbers.
        rows[1 : n + 1, 1] = self._clock_lines[rows[1 : n + 1, 1]]
        self._boots = boots_of(rows, state, self._size)

    @property
    def boots(self) -> tuple[Boot, ...]:
        """Power-ups in the file."""
        return self._boots

    def counts(self, boot: Boot) -> dict[str, int]:
        """Rows of each message type in this boot."""
        counts: dict[str, int] = {}
        for group in self._groups:
            rows = len(self._selected(group, boot))
            if rows:
                counts[group.definition.name] = counts.get(group.definition.name, 0) + rows
        return counts

    @staticmethod
    def _selected(group: _Group, boot: Boot) -> range:
        a, b = np.searchsorted(group.numbers, (boot.start, boot.stop))
        return range(int(a), int(b))

    def decode_many(
        self, names: Iterable[str], boot: Boot, fields: Collection[str] | None = None
    ) -> dict[str, pd.DataFrame]:
        """Return several message types."""
        return {name: self._decode(name, boot) for name in names}

    def _decode(self, name: str, boot: Boot) -> pd.DataFrame:
        groups = [g for g in self._groups if g.definition.name == name and len(self._selected(g, boot))]
        if not groups:
            raise KeyError(name)
        frames = [self._frame(group, self._selected(group, boot), boot) for group in groups]
        if len(frames) == 1:
            return frames[0]
        attrs = {key: value for frame in frames for key, value in frame.attrs.items()}
        order = np.argsort(np.concatenate([group.numbers[self._selected(group, boot)] for group in groups]))
        for frame in frames:
            frame.attrs = {}
        joined = pd.concat(frames).iloc[order]
        joined.attrs = attrs
        return joined

    def _frame(self, group: _Group, selected: range, boot: Boot) -> pd.DataFrame:
        columns: dict[str, object] = {}
        multipliers: dict[str, float] = {}
        stated = group.multipliers.ljust(len(group.fields), "-")
        for field, cells, multiplier_id in zip(group.fields, group.cells, stated, strict=False):
            values = _column(cells[selected.start : selected.stop], field)
            if field.type.divisor == 1 and isinstance(values, np.ndarray):
                up, down = self._units.scale(field, multiplier_id, group.time)
                if up != down:
                    values = values * up / down
                    multipliers[field.name] = up / down
            columns[field.name] = values
        frame = pd.DataFrame(columns, index=pd.Index(self._times(group, selected, boot), name="t"))
        frame.attrs["units"] = self._units.units(group.fields, group.units, group.time, group.time_scale)
        frame.attrs["multipliers"] = multipliers
        instance = group.units.find("#")
        if 0 <= instance < len(group.fields):
            frame.attrs["instance"] = group.fields[instance].name
        return frame

    def _times(self, group: _Group, selected: range, boot: Boot) -> npt.NDArray[np.float64]:
        """Boot clock of rows, s; those without one lie between the timed lines around them."""
        if group.time is not None:
            seconds = group.times()[selected.start : selected.stop].astype(np.float64) * 1e-6
            t, mended = mend_times(seconds, boot.t_start, boot.t_end)
            if mended:
                self._mended[group.definition.name] = mended
            return t
        a, b = np.searchsorted(self._clock_lines, (boot.start, boot.stop))
        lines, clock = self._clock_lines[a:b], self._clock[a:b] * 1e-6
        timed = (clock >= max(boot.t_start - 5.0, 0.0)) & (clock <= boot.t_end + 5.0)
        numbers = group.numbers[selected.start : selected.stop]
        if not timed.any():
            return np.zeros(len(numbers))
        return np.interp(numbers, lines[timed], clock[timed])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What reading the lines and the decoding so far had to say."""
        return (*self._line_findings(), *several_boots(self._boots), *mended_times(self._mended))

    def _line_findings(self) -> Iterator[Finding]:
        if misfits := {g.definition.name: g.misfits for g in self._groups if g.misfits}:
            total = sum(misfits.values())
            text = f"{total} lines do not fit their format ({listed(misfits)}); they were skipped."
            yield warning("file-damaged", text, lines=total)
        if self._unknown:
            total, names = sum(self._unknown.values()), listed(repr(name[:20]) for name in self._unknown)
            yield warning(
                "message-layout",
                f"{total} lines begin with a name that no FMT line explains ({names}); they were skipped.",
                messages=total,
            )
        if any(group.is_gps_clock for group in self._groups):
            yield info(
                "clock-doubtful",
                "The firmware of this log wrote no boot clock; times are the GPS receiver's, seconds of the week.",
            )


#: A number of a few digits: `isdigit` takes powers for some, and Python converts none of thousands.
_WHOLE = re.compile("[0-9]{1,4}")


def _definition(text: str) -> Definition | None:
    """FMT line without its name; None when it is damaged."""
    cells = [cell.strip() for cell in text.split(",")]
    if len(cells) < 4 or not all(map(_WHOLE.fullmatch, cells[:2])) or not cells[2].isidentifier():
        return None
    labels = tuple(cell for cell in cells[4:] if cell)
    if cells[2] == FMT.name:
        return FMT  # Old logs list four labels for its five fields.
    return Definition(int(cells[0]), int(cells[1]), cells[2], cells[3], labels)


def _fields(definition: Definition) -> tuple[Field, ...]:
    """Fields by their labels: in a text, a label without a format character is a column all the same."""
    form = definition.format.ljust(len(definition.labels), "d")
    # No message is longer than a byte can say, so that nothing is cut off here.
    return Definition(definition.id, 10**6, definition.name, form, definition.labels).fields()


def _may_be_text(field: Field) -> bool:
    # Flight modes are printed by name, arrays in no agreed way, and ids of units perhaps as the character they are.
    return field.type.is_text or field.char in "Ma" or (field.name == "Id" and field.char == "b")


def _character(cell: str) -> int:
    return int(cell) if _WHOLE.fullmatch(cell.removeprefix("-")) else ord(cell[:1] or "-")


def _are_numbers(cells: Iterable[str]) -> bool:
    try:
        for cell in cells:
            float(cell)
    except ValueError:
        return False
    return True


def _numbers(cells: tuple[str, ...], field: Field) -> npt.NDArray[Any]:
    """Numbers of the declared type, or wider where the text holds more than that type."""
    dtype = field.type.dtype
    if field.type.divisor == 1 and dtype.kind in "iu":
        try:
            values, limits = list(map(int, cells)), np.iinfo(dtype)
            if not values or (min(values) >= limits.min and max(values) <= limits.max):
                return np.array(values, dtype)
        except ValueError:
            pass
    return np.array(list(map(float, cells)), np.float64)


def _column(cells: tuple[str, ...], field: Field) -> Any:
    is_text = field.type.is_text or field.char == "a"
    if is_text or (_may_be_text(field) and not _are_numbers(cells)):
        return pd.array(list(cells), dtype="str")
    return _numbers(cells, field)
