"""Mutations of what counts and lengths in a file say: PX4 logs, tables, archives and descriptions of columns."""

from __future__ import annotations

import gzip
import io
import re
import struct
import zipfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import scipy

from core.errors import RotoridError
from logparse.foreign.motion import read_motion
from tests.fuzz.px4_seed import px4_log
from tests.fuzz.reading import read_whole
from tests.fuzz.spans import messages

_COUNTS = tuple(b"0, 1, -1, 2, 255, 256, 9999, 65535, 65536, 99999999, 1e999, x, ".split(b", "))
_NUMBERS = (0, 1, 2, 0x7F, 0xFF, 0x100, 0x7FFF, 0xFFFF, 0x10000, 0x7FFFFFFF, 0xFFFFFFFF, 1 << 40, (1 << 63) - 1)
_WORDS = (
    *b"inf nan abc 1e400 -1 99999999999999999999 [1,2,3] [[1],[2,3]] 2024-01-01 1e-320 0x10 True 1,5 t None".split(),
    *(b"", b'"', b"\xff\xfe", b"[" * 300, b"9" * 400),
)
_YAML = (
    b"!!int abc", b"!!timestamp 99999-99-99", b"!!float x", b"!!binary =", b"!!set {a}", b"!!omap [a]", b"&a [*a]",
    b"*a", b"{? [1] : 2}", b"[" * 2000, b"{}", b"[]", b"~", b"-", b"!!python/object:os.system x", b"2024-13-45",
    b"12:99:99", b".inf", b".nan", b"0o777777777777777777777777", b"[x, x]", b"[t]", b"t", b"{columns: t}",
    b"!!bool maybe", b"!!null x", b"{unit: deg}", b"[[1, 2, cw]]", b"9" * 400, b"rad/s", b"angles", b"!!pairs [1]",
    b"{columns: 3}", b"1.0e+9999",
)  # fmt: skip

_COLUMNS = """\
name: bench
time: t
position: {columns: [x, y, z], unit: m}
attitude: {columns: q, order: wxyz}
motors: {columns: [m1, m2, m3, m4], quantity: pwm, frame: quad/x}
voltage: {column: v, unit: V}
frame: {world: NED}
mass: 1.5
"""


@cache
def _table() -> pd.DataFrame:
    t = np.arange(0.0, 12.0, 0.05)
    columns = {"t": t, "x": np.sin(t), "y": np.cos(0.7 * t), "z": -2.0 - 0.3 * np.sin(0.5 * t)}
    roll, pitch = -0.05 * np.cos(0.7 * t), 0.1 * np.sin(t)  # which speed it up so
    columns |= {"q[0]": np.cos(0.5 * np.hypot(roll, pitch)), "q[1]": 0.5 * roll, "q[2]": 0.5 * pitch, "q[3]": 0.0 * t}
    turn = {"m1": (-1, 1), "m2": (1, -1), "m3": (1, 1), "m4": (-1, -1)}  # by roll and pitch
    columns |= {m: np.rint(1500 + 90 * a * np.cos(0.7 * t) - 90 * b * np.sin(t)) for m, (a, b) in turn.items()}
    return pd.DataFrame(columns | {"v": 12.0 - 0.01 * t})


@cache
def seed(kind: str) -> bytes:
    """Return an undamaged file of a kind."""
    file = io.BytesIO()
    match kind:
        case "px4":
            return px4_log(20)
        case "yaml":
            return _COLUMNS.encode()
        case "parquet":
            _table().to_parquet(file)
        case "mat":
            columns = {name: column.to_numpy() for name, column in _table().items() if "[" not in name}
            scipy.io.savemat(file, columns | {"q": _table().filter(like="[").to_numpy()})
        case "gz":
            return gzip.compress(px4_log(20), mtime=0)
        case "zip":
            with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
                archive.writestr("readme.txt", "a flight")
                archive.writestr("flight.ulg", px4_log(20))
        case _:
            text = _table().round(5).to_csv(index=False).encode()
            return text if kind == "csv" else gzip.compress(text, mtime=0)
    return file.getvalue()


def mutate(kind: str, rng: np.random.Generator) -> bytes:
    """Return a file of a kind with one to five changes."""
    if kind == "csv.gz":
        return gzip.compress(mutate("csv", rng), 1, mtime=0)
    if kind in ("gz", "zip") and rng.random() < 0.05:
        return _bomb(kind, int(rng.integers(1, 300)) << 20)
    data = bytearray(seed(kind))
    for _ in range(int(rng.integers(1, 6))):
        change = _CHANGES[kind][int(rng.integers(len(_CHANGES[kind])))]
        if data:
            change(data, rng)
    return bytes(data)


def _bomb(kind: str, size: int) -> bytes:
    """Pack a log with so many bytes of nothing behind it."""
    file = io.BytesIO()
    if kind == "gz":
        with gzip.open(file, "wb", 1) as packed:
            packed.write(px4_log(2) + bytes(size))
    else:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            archive.writestr("flight.ulg", px4_log(2) + bytes(size))
    return file.getvalue()


def _pick(choices: tuple[bytes, ...], rng: np.random.Generator) -> bytes:
    return choices[int(rng.integers(len(choices)))]


def _number(data: bytearray, at: int, size: int, rng: np.random.Generator) -> None:
    """Put a number at an end of its range, or one that is a little off, at a place."""
    if at + size > len(data):
        return
    value = int.from_bytes(data[at : at + size], "little")
    odd = _NUMBERS[int(rng.integers(len(_NUMBERS)))] if rng.random() < 0.7 else value + int(rng.integers(-9, 10))
    data[at : at + size] = (odd & ((1 << 8 * size) - 1)).to_bytes(size, "little")


def _somewhere(data: bytearray, rng: np.random.Generator) -> None:
    _number(data, int(rng.integers(len(data))), int(rng.choice((1, 2, 4, 8))), rng)


def _end(data: bytearray, rng: np.random.Generator) -> None:
    _number(data, len(data) - 1 - int(rng.integers(min(len(data), 2000))), int(rng.choice((1, 4))), rng)


def _cut(data: bytearray, rng: np.random.Generator) -> None:
    del data[int(rng.integers(len(data))) :]


def _repeat(data: bytearray, rng: np.random.Generator) -> None:
    at, size = int(rng.integers(len(data))), int(rng.integers(1, 400))
    data[at:at] = data[at : at + size] * int(rng.choice((1, 2, 50)))


def _message(data: bytearray, rng: np.random.Generator, kinds: str = "") -> range:
    every = [span for kind, span in messages(bytes(data), "ulg") if not kinds or kind in kinds]
    return every[int(rng.integers(len(every)))] if every else range(0)


def _ulog_length(data: bytearray, rng: np.random.Generator) -> None:
    _number(data, _message(data, rng).start, 2, rng)


def _ulog_kind(data: bytearray, rng: np.random.Generator) -> None:
    if span := _message(data, rng):
        data[span.start + 2] = int(rng.choice(list(b"BFIMPQADLCRSO\0x")))


def _ulog_count(data: bytearray, rng: np.random.Generator) -> None:
    """Change the number of elements in a format."""
    span = _message(data, rng, "F")
    text = bytes(data[span.start + 3 : span.stop])
    if matches := list(re.finditer(rb"(\[)(\d*)(\])|( )", text)):
        at = matches[int(rng.integers(len(matches)))]
        count = _pick(_COUNTS, rng)
        _replace(data, span, text[: at.start()] + b"[" + count + (b"]" if at[1] else b"] ") + text[at.end() :])


def _ulog_nest(data: bytearray, rng: np.random.Generator) -> None:
    """Put one format into another, or into itself, many times over."""
    span = _message(data, rng, "F")
    text = bytes(data[span.start + 3 : span.stop])
    other = bytes(data[(inner := _message(data, rng, "F")).start + 3 : inner.stop]).partition(b":")[0]
    field = other + b"[" + _pick(_COUNTS, rng) + b"] a" + str(int(rng.integers(100))).encode() + b";"
    _replace(data, span, text + field * int(rng.choice((1, 3, 200))))


def _ulog_type(data: bytearray, rng: np.random.Generator) -> None:
    span = _message(data, rng, "FIP")
    text = bytes(data[span.start + 3 : span.stop])
    kinds = (b"float", b"double", b"uint8_t", b"int32_t", b"uint64_t", b"bool", b"char", b"char[9]", b"none")
    _replace(data, span, text.replace(_pick(kinds, rng), _pick(kinds, rng)))


def _replace(data: bytearray, span: range, text: bytes) -> None:
    if span and len(text) < 1 << 16:
        data[span.start : span.stop] = struct.pack("<HB", len(text), data[span.start + 2]) + text


def _ulog_again(data: bytearray, rng: np.random.Generator) -> None:
    """Repeat a message, often a subscription."""
    if span := _message(data, rng, str(rng.choice(("", "A", "F", "D")))):
        data[span.stop : span.stop] = data[span.start : span.stop] * int(rng.choice((1, 30, 3000)))


def _ulog_row(data: bytearray, rng: np.random.Generator) -> None:
    """Change topic, time or values of a row."""
    span = _message(data, rng, "D")
    at, size = ((3, 2), (5, 8), (13, 4), (17, 4))[int(rng.integers(4))]
    _number(data, span.start + at, size, rng)


def _ulog_subscription(data: bytearray, rng: np.random.Generator) -> None:
    if span := _message(data, rng, "A"):
        _number(data, span.start + 3, int(rng.choice((1, 2, 3))), rng)


def _archive_header(data: bytearray, rng: np.random.Generator) -> None:
    """Change a size, count, offset or method in a header of a zip archive."""
    places = [match.start() for match in re.finditer(rb"PK(?:\x01\x02|\x03\x04|\x05\x06)", bytes(data))]
    if places:
        at = places[int(rng.integers(len(places)))]
        _number(data, at + 4 + 2 * int(rng.integers(21)), int(rng.choice((2, 4))), rng)


def _gzip_header(data: bytearray, rng: np.random.Generator) -> None:
    at = int(rng.choice((2, 3, 4, 8, 9, 10, len(data) - 8, len(data) - 4)))
    _number(data, max(0, at), int(rng.choice((1, 2, 4))), rng)


def _append_member(data: bytearray, rng: np.random.Generator) -> None:
    data += gzip.compress(bytes(int(rng.integers(1, 5 << 20))), 1, mtime=0)


def _cell(data: bytearray, rng: np.random.Generator) -> None:
    """Put an odd word in the place of a cell, often of the header."""
    at = int(rng.integers(60 if rng.random() < 0.3 else len(data)))
    begin, stop = data.rfind(b",", 0, at) + 1, data.find(b",", at)
    if stop > begin:
        data[begin:stop] = _pick(_WORDS, rng)


def _row(data: bytearray, rng: np.random.Generator) -> None:
    """Put a row of another length, empty or not, into a table; or a column of words."""
    at = data.find(b"\n", int(rng.integers(len(data)))) + 1
    data[at:at] = b",".join([_pick(_WORDS, rng)] * int(rng.choice((0, 1, 13, 14, 500)))) + b"\n"


def _separator(data: bytearray, rng: np.random.Generator) -> None:
    marks = (b",", b";", b"\t", b" ", b"\n", b"\r\n", b".", b'"')
    data[:] = data.replace(_pick(marks, rng), _pick(marks, rng))


def _matlab_tag(data: bytearray, rng: np.random.Generator) -> None:
    """Change a type, size or dimension in a tag: tags lie at multiples of eight behind the header."""
    _number(data, 128 + 8 * int(rng.integers(8 if rng.random() < 0.5 else max(1, len(data) // 8 - 16))), 4, rng)


def _yaml_value(data: bytearray, rng: np.random.Generator) -> None:
    places = [match.span(1) for match in re.finditer(rb"[:,\[{] ?([^,:\]}\n]+)", bytes(data))]
    if places:
        start, stop = places[int(rng.integers(len(places)))]
        data[start:stop] = _pick(_YAML, rng)


def _yaml_line(data: bytearray, rng: np.random.Generator) -> None:
    lines = bytes(data).split(b"\n")
    at = int(rng.integers(len(lines)))
    key = lines[int(rng.integers(len(lines)))].partition(b":")[0] or b"inputs"
    lines[at : at + int(rng.integers(2))] = [key + b": " + _pick(_YAML, rng)]
    data[:] = b"\n".join(lines)


_Change = Callable[[bytearray, np.random.Generator], None]
_CHANGES: Mapping[str, tuple[_Change, ...]] = {
    "px4": (
        _ulog_length, _ulog_kind, _ulog_count, _ulog_count, _ulog_nest, _ulog_type, _ulog_again, _ulog_row, _ulog_row,
        _ulog_subscription, _somewhere, _cut,
    ),
    "zip": (_archive_header, _archive_header, _archive_header, _somewhere, _cut, _repeat),
    "gz": (_gzip_header, _append_member, _somewhere, _cut, _repeat),
    "csv": (_cell, _cell, _cell, _row, _separator, _somewhere, _cut, _repeat),
    "parquet": (_end, _end, _somewhere, _cut, _repeat),
    "mat": (_matlab_tag, _matlab_tag, _matlab_tag, _somewhere, _cut, _repeat),
    "yaml": (_yaml_value, _yaml_value, _yaml_line, _repeat, _cut),
}  # fmt: skip

#: Kinds of files that are changed.
KINDS = (*_CHANGES, "csv.gz")


def read(kind: str, data: bytes, folder: Path) -> None:
    """Read a file as a user would have it read; any exception but those for people passes."""
    path = folder / f"mutated.{'ulg.' * (kind in ('gz', 'zip'))}{kind}"
    path.write_bytes(data)
    if kind in ("px4", "zip", "gz"):
        read_whole(path)
        return
    columns, table = folder / "columns.yaml", folder / "table.csv"
    columns.write_text(_COLUMNS)
    table.write_bytes(seed("csv"))
    try:
        read_motion(*((table, path) if kind == "yaml" else (path, columns)))
    except RotoridError:
        return
