"""The DataFlash binary format as ArduPilot writes it: field types, FMT rows, units and multipliers.

Every message is ``A3 95 id`` and a payload whose layout a FMT row has declared. A FMT row is itself such a message
(id 128). FMTU rows name a unit and a multiplier for each field by one-letter ids, which UNIT and MULT rows explain.
Source: ArduPilot, libraries/AP_Logger/LogStructure.h and README.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from logparse.source import clean_text

HEADER = b"\xa3\x95"
HEADER_LENGTH = 3
FMT_ID = 128
#: Bytes of a FMT row with its header; the one layout that a reader must know beforehand.
FMT_LENGTH = 89
#: Most bytes that a FMT row can say of a message: its length, its name, its format and its labels.
LONGEST_MESSAGE = 255
_LONGEST = LONGEST_NAME, LONGEST_FORMAT, LONGEST_LABELS = 4, 16, 64


@dataclass(frozen=True, slots=True)
class FieldType:
    """What one format character stands for."""

    dtype: np.dtype  #: Little-endian type in the file; for ``a`` the element type.
    divisor: int = 1  #: Legacy scale: the value is the stored integer divided by this.
    items: int = 1  #: Elements of an array field, else 1.

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return int(self.dtype.itemsize) * self.items

    @property
    def is_text(self) -> bool:
        """Whether the field holds characters."""
        return self.dtype.kind == "S"


#: `M` (flight mode) is unsigned: modes above 127 exist.
FIELD_TYPES = MappingProxyType(
    {
        "a": FieldType(np.dtype("<i2"), items=32),
        "b": FieldType(np.dtype("i1")),
        "B": FieldType(np.dtype("u1")),
        "h": FieldType(np.dtype("<i2")),
        "H": FieldType(np.dtype("<u2")),
        "i": FieldType(np.dtype("<i4")),
        "I": FieldType(np.dtype("<u4")),
        "q": FieldType(np.dtype("<i8")),
        "Q": FieldType(np.dtype("<u8")),
        "g": FieldType(np.dtype("<f2")),
        "f": FieldType(np.dtype("<f4")),
        "d": FieldType(np.dtype("<f8")),
        "M": FieldType(np.dtype("u1")),
        "n": FieldType(np.dtype("S4")),
        "N": FieldType(np.dtype("S16")),
        "Z": FieldType(np.dtype("S64")),
        "c": FieldType(np.dtype("<i2"), divisor=100),
        "C": FieldType(np.dtype("<u2"), divisor=100),
        "e": FieldType(np.dtype("<i4"), divisor=100),
        "E": FieldType(np.dtype("<u4"), divisor=100),
        "L": FieldType(np.dtype("<i4"), divisor=10_000_000),
    }
)

_SIZES = {char: kind.size for char, kind in FIELD_TYPES.items()}

#: Unit ids of FMTU rows (log_Units of LogStructure.h).
UNITS = MappingProxyType(
    {
        "-": "",
        "?": "UNKNOWN",
        "A": "A",
        "a": "Ah",
        "d": "deg",
        "b": "B",
        "B": "B/s",
        "k": "deg/s",
        "D": "deglatitude",
        "e": "deg/s/s",
        "E": "rad/s",
        "G": "Gauss",
        "h": "degheading",
        "i": "A.s",
        "J": "W.s",
        "l": "l",
        "L": "rad/s/s",
        "m": "m",
        "n": "m/s",
        "o": "m/s/s",
        "O": "degC",
        "%": "%",
        "S": "satellites",
        "s": "s",
        "t": "N.m",
        "q": "rpm",
        "r": "rad",
        "U": "deglongitude",
        "u": "ppm",
        "v": "V",
        "P": "Pa",
        "w": "Ohm",
        "W": "Watt",
        "X": "W.h",
        "y": "l/s",
        "Y": "us",
        "z": "Hz",
        "#": "instance",
    }
)

#: Multiplier ids of FMTU rows (log_Multipliers of LogStructure.h); 0 means "no multiplier".
MULTIPLIERS = MappingProxyType(
    {
        "-": 0.0,
        "?": 1.0,
        "2": 1e2,
        "1": 1e1,
        "0": 1.0,
        "A": 1e-1,
        "B": 1e-2,
        "C": 1e-3,
        "D": 1e-4,
        "E": 1e-5,
        "F": 1e-6,
        "G": 1e-7,
        "I": 1e-9,
        "!": 3.6,
        "/": 3600.0,
    }
)

#: Columns that hold a clock when they come first in a message; their values stay as logged.
TIME_COLUMNS = frozenset({"TimeUS", "TimeMS"})


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message: its name, format character and place in the message, counted from the header."""

    name: str
    char: str
    offset: int

    @property
    def type(self) -> FieldType:
        """What the format character stands for."""
        return FIELD_TYPES[self.char]

    @property
    def is_number(self) -> bool:
        """Whether the field holds one number."""
        return self.type.items == 1 and not self.type.is_text


@dataclass(frozen=True)
class Definition:
    """One FMT row."""

    id: int  #: Message id, 0..255.
    length: int  #: Bytes of the message with its header, as declared.
    #: As declared.
    name: str
    format: str
    labels: tuple[str, ...]  #: Column names as declared; their number may differ from that of the format characters.

    @cached_property
    def format_length(self) -> int | None:
        """Bytes that the format characters ask for, with the header; None when a character is unknown."""
        if any(char not in FIELD_TYPES for char in self.format):
            return None
        return HEADER_LENGTH + sum(_SIZES[char] for char in self.format)

    @property
    def is_writable(self) -> bool:
        """Whether a FMT row can say it."""
        texts = zip((self.name, self.format, ",".join(self.labels)), _LONGEST, strict=True)
        return self.length <= LONGEST_MESSAGE and all(len(text.encode()) <= longest for text, longest in texts)

    def fields(self, length: int | None = None) -> tuple[Field, ...]:
        """Fields that lie within `length` bytes (default: the declared length) and before any unknown character.

        Fields without a label are called ``field5`` (counted from 1); a label that comes twice gets ``_2``.
        """
        end = self.length if length is None else length
        fields: list[Field] = []
        names: set[str] = set()
        offset = HEADER_LENGTH
        for k, char in enumerate(self.format):
            size = _SIZES.get(char)
            if size is None or offset + size > end:
                break
            label = self.labels[k] if k < len(self.labels) and self.labels[k] else f"field{k + 1}"
            name, repeat = label, 1
            while name in names:
                repeat += 1
                name = f"{label}_{repeat}"
            names.add(name)
            fields.append(Field(name, char, offset))
            offset += size
        return tuple(fields)

    def pack(self) -> bytes:
        """Return the FMT row that declares this message, with its header."""
        return (
            HEADER
            + bytes((FMT_ID, self.id, self.length))
            + self.name.encode().ljust(LONGEST_NAME, b"\0")
            + self.format.encode().ljust(LONGEST_FORMAT, b"\0")
            + ",".join(self.labels).encode().ljust(LONGEST_LABELS, b"\0")
        )

    @classmethod
    def unpack(cls, row: bytes) -> "Definition":
        """Read a FMT row of `FMT_LENGTH` bytes, with its header."""
        name, form, labels = (clean_text(row[a:b]) for a, b in ((5, 9), (9, 25), (25, 89)))
        return cls(row[3], row[4], name, form, tuple(label.strip() for label in labels.split(",")) if labels else ())


FMT = Definition(FMT_ID, FMT_LENGTH, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))


def boot_clock(name: str, fields: Sequence[Field]) -> tuple[Field | None, int]:
    """Find the field of a message that holds the boot clock, and the clock's counts per second."""
    by_name = {item.name: item for item in fields}
    if "Week" in by_name and "T" in by_name and by_name["T"].char in "Ii":
        # GPS rows of 3.1/3.2: TimeMS is the receiver's ms of week, T is the boot clock.
        return by_name["T"], 1000
    if name == "GPS" and "Time" in by_name and by_name["Time"].char in "Ii":
        # Logs of 3.0 have no boot clock: the receiver's ms of week is the only one.
        return by_name["Time"], 1000
    if not fields:
        return None, 0
    first = fields[0]
    if first.name in ("TimeUS", "US") and first.char in "Qq":
        return first, 1_000_000
    if first.name == "TimeMS" and first.char in "Ii" and "Week" not in by_name and name[:3] not in ("ACC", "GYR"):
        # TimeMS of ACC and GYR rows is a count of the sensor, not of the autopilot.
        return first, 1000
    return None, 0


class UnitTable:
    """What the UNIT and MULT rows of a log say about the ids in its FMTU rows."""

    def __init__(self) -> None:
        self._labels: dict[str, str] = {}
        self._multipliers: dict[str, float] = {}

    def add_unit(self, unit_id: int, label: str) -> None:
        """Read a UNIT row."""
        self._labels[chr(unit_id & 0xFF)] = label

    def add_multiplier(self, multiplier_id: int, multiplier: float) -> None:
        """Read a MULT row."""
        # What ArduPilot knows lies between 1e-9 and 3600; the rest comes from damaged rows.
        if multiplier == 0.0 or 1e-12 < multiplier < 1e12:
            self._multipliers[chr(multiplier_id & 0xFF)] = decimal_multiplier(multiplier)

    def units(self, fields: Sequence[Field], unit_ids: str, clock: Field | None, counts: int) -> dict[str, str]:
        """Name the unit of each field that has one."""
        units = {}
        for item, unit_id in zip(fields, unit_ids, strict=False):
            label = self._labels.get(unit_id, "")
            if label and label not in ("UNKNOWN", "instance"):
                units[item.name] = label
        if clock is not None:
            units[clock.name] = "us" if counts == 1_000_000 else "ms"
        return units

    def scale(self, item: Field, multiplier_id: str, clock: Field | None) -> tuple[float, float]:
        """Factor and divisor from the stored number to the unit.

        A legacy character carries its own scale; a multiplier beside it says the same once more. The clock stays
        as logged.
        """
        if item.type.divisor != 1:
            return 1.0, float(item.type.divisor)
        stated = self._multipliers.get(multiplier_id, 0.0)
        if item is clock or item.type.is_text or item.type.items != 1 or stated in (0.0, 1.0):
            return 1.0, 1.0
        # Dividing by 1000 is exact to the last digit where multiplying by 0.001 is not.
        inverse = 1.0 / stated
        return (1.0, float(round(inverse))) if abs(inverse - round(inverse)) < 1e-9 * inverse else (stated, 1.0)


def decimal_multiplier(stored: float) -> float:
    """Undo single precision: ArduPilot keeps 0.01 as a float and logs it as the double 0.009999999776."""
    single = np.float32(stored)
    return float(str(single)) if float(single) == stored else stored
