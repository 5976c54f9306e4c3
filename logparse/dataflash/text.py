"""Read DataFlash text logs (.log): what ground stations made of binary logs, and what old autopilots dumped.

Each line is a message: its name, then its values, separated by commas. FMT lines declare the columns as in the binary
format, but values of the legacy characters are printed scaled and flight modes often by name. Lines before the first
FMT line and lines that do not fit their format are passed over. The others are written as the binary log that they came
from, with wider columns where the text holds more than the format says, and read as such.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from core.errors import LogError
from core.findings import Finding, warning
from core.summary import listed
from logparse.containers import Buffer
from logparse.dataflash.binary import DataflashSource
from logparse.dataflash.format import (
    FIELD_TYPES,
    FMT,
    FMT_ID,
    HEADER_LENGTH,
    LONGEST_NAME,
    Definition,
    Field,
    boot_clock,
)
from logparse.dataflash.writer import MessageLayout, interleaved

_FMT_LINE = re.compile(rb"^\s*FMT\s*,\s*\d+\s*,\s*\d+\s*,\s*\w+\s*,", re.MULTILINE)
_SEPARATOR = re.compile(r"[,\s]\s*")
#: A number of a few digits: `isdigit` takes powers for some, and Python converts none of thousands.
_WHOLE = re.compile("[0-9]{1,4}")

#: Names that one byte tells apart, but for the one of FMT and one more.
_MOST_NAMES = 254
#: Lines before the first message that are kept, and characters of each.
_MOST_PRELUDE, _LONGEST_PRELUDE = 64, 200


def looks_like(head: bytes) -> bool:
    """Whether a file that begins so is a DataFlash text log."""
    return _FMT_LINE.search(head) is not None


class DataflashTextSource(DataflashSource):
    """An opened DataFlash text log; LogError where not one line fits a FMT line."""

    format = "dataflash-text"

    def __init__(self, buffer: Buffer):
        text = _Text(bytes(buffer[:]))
        binary = text.as_binary()
        if not binary:
            raise LogError("no line of this DataFlash text log fits a FMT line")
        super().__init__(binary)
        #: What the autopilot printed before its first message: firmware, board.
        self.prelude = text.prelude
        self._line_findings = tuple(text.findings())

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What reading the lines and the decoding so far had to say."""
        return (*self._line_findings, *super().findings)


class _Group:
    """Lines of one message type under one definition."""

    def __init__(self, definition: Definition):
        self.declared = definition
        self.lines: list[int] = []
        self.texts: list[str] = []

    def pack(self, message_id: int) -> None:
        """Write the lines that fit the format as rows: `definition`, the `rows` and the lines of these, `numbers`."""
        fields = _fields(self.declared)
        self.numbers, cells = self._split(fields)
        columns = {item.name: _column(column, item) for item, column in zip(fields, cells, strict=True)}
        form = "".join(char for char, _ in columns.values())
        length = HEADER_LENGTH + sum(FIELD_TYPES[char].size for char in form)
        self.definition = Definition(message_id, length, self.declared.name, form, tuple(columns))
        if not self.definition.is_writable:  # no autopilot's
            self.numbers = self.numbers[:0]
            self.definition = Definition(message_id, HEADER_LENGTH, self.declared.name, "", ())
        values = {name: values for name, (_, values) in columns.items()}
        self.rows = MessageLayout(self.definition, "").pack(values, len(self.numbers))

    def _split(self, fields: Sequence[Field]) -> tuple[npt.NDArray[np.int64], list[list[str]]]:
        """Line numbers, and cells by column, of the lines that fit the format."""
        n = len(fields)
        # A comma within the last text belongs to the text.
        splits = n - 1 if n and fields[-1].type.is_text else -1
        numbers, rows = [], []
        for number, text in zip(self.lines, self.texts, strict=True):
            cells = text.split(",", splits) if n else []
            if len(cells) != n:
                cells = _SEPARATOR.split(text.strip())
            if len(cells) == n:
                numbers.append(number)
                rows.append(cells)
        columns = [[cells[k] for cells in rows] for k in range(n)]
        clock, _ = boot_clock(self.declared.name, fields)
        fit = np.ones(len(rows), bool)
        for item, column in zip(fields, columns, strict=True):
            if not _may_be_text(item):
                fit &= _numeric(column, _limits(item) if item is clock or item.type.divisor != 1 else None)
            if item is clock:
                fit &= np.array([cell.strip().isdecimal() for cell in column], bool)
        if not fit.all():
            columns = [[cell for cell, kept in zip(column, fit, strict=True) if kept] for column in columns]
        return np.array(numbers, np.int64)[fit], columns


class _Text:
    """The lines of a log, sorted by message."""

    def __init__(self, raw: bytes):
        self._groups: list[_Group] = []
        self._declared: list[tuple[int, _Group]] = []  # Line of each FMT line, and what it declares.
        self._unknown: Counter[str] = Counter()
        self._misfits: Counter[str] = Counter()
        start = _FMT_LINE.search(raw)
        lines = raw.decode("utf-8", "replace").split("\n")
        before = raw[: start.start()].count(b"\n") if start else 0
        self.prelude = tuple(line.strip()[:_LONGEST_PRELUDE] for line in lines[: min(before, _MOST_PRELUDE)])
        in_force: dict[str, _Group] = {}
        for number, line in enumerate(lines[before:], start=before):
            name, comma, text = line.partition(",")
            name = name.strip()
            if not comma:
                # Some writers separate by blanks alone.
                name, _, text = name.partition(" ")
            if name == FMT.name:
                self._declare(number, text, in_force)
            elif name in in_force:
                in_force[name].lines.append(number)
                in_force[name].texts.append(text)
            elif name:
                self._unknown[name] += 1

    def _declare(self, number: int, text: str, in_force: dict[str, _Group]) -> None:
        definition = _definition(text)
        if definition is None or (len(in_force) > _MOST_NAMES and definition.name not in in_force):
            self._misfits[FMT.name] += 1
            return
        known = in_force.get(definition.name)
        if known is None or known.declared != definition:
            known = in_force[definition.name] = _Group(definition)
            self._groups.append(known)
        self._declared.append((number, known))

    def as_binary(self) -> bytes:
        """Return the lines that fit as a binary log; empty where there is none."""
        ids = _message_ids([group.declared for group in self._groups])
        for group in self._groups:
            group.pack(ids[group.declared.name])
            if misfits := len(group.lines) - len(group.numbers):
                self._misfits[group.declared.name] += misfits
        if not self._declared:
            return b""
        formats = np.frombuffer(b"".join(group.definition.pack() for _, group in self._declared), np.uint8)
        packed = [formats.reshape(len(self._declared), -1), *(group.rows for group in self._groups)]
        numbers = [np.array([number for number, _ in self._declared]), *(group.numbers for group in self._groups)]
        return interleaved(packed, numbers).tobytes()

    def findings(self) -> Iterator[Finding]:
        """Name the lines that were passed over."""
        if total := sum(self._misfits.values()):
            text = f"{total} lines do not fit their format ({listed(self._misfits)}); they were skipped."
            yield warning("file-damaged", text, lines=total)
        if self._unknown:
            total, names = sum(self._unknown.values()), listed(repr(name[:20]) for name in self._unknown)
            yield warning(
                "message-layout",
                f"{total} lines begin with a name that no FMT line explains ({names}); they were skipped.",
                messages=total,
            )


def _message_ids(definitions: Iterable[Definition]) -> dict[str, int]:
    """Return the id of each name as declared, or another where two names share one."""
    ids = {FMT.name: FMT_ID}
    for definition in definitions:
        if definition.name not in ids:
            taken = set(ids.values())
            ids[definition.name] = next(k for k in (definition.id, *range(256)) if k not in taken)
    return ids


def _definition(text: str) -> Definition | None:
    """FMT line without its name; None when it is damaged."""
    cells = [cell.strip() for cell in text.split(",")]
    if len(cells) < 4 or not all(map(_WHOLE.fullmatch, cells[:2])) or not cells[2].isidentifier():
        return None
    if len(cells[2].encode()) > LONGEST_NAME:
        return None
    labels = tuple(cell for cell in cells[4:] if cell)
    if cells[2] == FMT.name:
        return FMT  # Old logs list four labels for its five fields.
    return Definition(int(cells[0]) & 0xFF, int(cells[1]), cells[2], cells[3], labels)


def _fields(definition: Definition) -> tuple[Field, ...]:
    """Fields by their labels: in a text, a label without a format character is a column all the same."""
    form = definition.format.ljust(len(definition.labels), "d")
    # No message is longer than a byte can say, so that nothing is cut off here.
    return Definition(definition.id, 10**6, definition.name, form, definition.labels).fields()


def _may_be_text(item: Field) -> bool:
    # Flight modes are printed by name, arrays in no agreed way, and ids of units perhaps as the character they are.
    return item.type.is_text or item.char in "Ma" or _is_character(item)


def _is_character(item: Field) -> bool:
    return item.name == "Id" and item.char == "b"


def _limits(item: Field) -> tuple[float, float]:
    """Return the least and the largest number that a column holds which is written as declared; others may be wider."""
    limits = np.iinfo(item.type.dtype)
    return limits.min / item.type.divisor, limits.max / item.type.divisor


def _numeric(cells: Sequence[str], limits: tuple[float, float] | None = None) -> npt.NDArray[np.bool_]:
    """Return which cells are numbers, within limits where there are any."""
    try:
        values = np.array([float(cell) for cell in cells])
    except ValueError:
        half = len(cells) // 2
        halves = [_numeric(part, limits) for part in (cells[:half], cells[half:])] if half else []
        return np.concatenate(halves) if half else np.zeros(1, bool)
    return np.ones(len(cells), bool) if limits is None else (values >= limits[0]) & (values <= limits[1])


def _character(cell: str) -> str:
    """Return the number of a character, which may be printed as it is."""
    return cell if _WHOLE.fullmatch(cell.removeprefix("-")) else str(ord(cell[:1] or "-"))


def _column(cells: list[str], item: Field) -> tuple[str, npt.NDArray[Any] | list[bytes]]:
    """Return a column as numbers or texts, and the format character that holds them."""
    kind = item.type
    if _is_character(item):
        cells = [_character(cell.strip()) for cell in cells]
    elif kind.is_text or item.char == "a" or (item.char == "M" and not _numeric(cells).all()):
        texts = [cell.strip().encode()[: FIELD_TYPES["Z"].size] for cell in cells]
        longest = max(map(len, texts), default=0)
        wide = [char for char in (item.char, "n", "N", "Z") if FIELD_TYPES[char].is_text]
        return next(char for char in wide if FIELD_TYPES[char].size >= longest), texts
    if kind.divisor == 1 and kind.dtype.kind in "iu":
        try:
            counts, limits = [int(cell) for cell in cells], np.iinfo(kind.dtype)
            if not counts or (min(counts) >= limits.min and max(counts) <= limits.max):
                return item.char, np.array(counts, kind.dtype)
        except ValueError:  # such as 1e3
            pass
    return "d" if kind.divisor == 1 else item.char, np.array([float(cell) for cell in cells])
