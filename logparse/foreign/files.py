"""Read a table of any of the usual kinds into a DataFrame of numbers, one column for every number of a row."""

from __future__ import annotations

import ast
import bz2
import gzip
import io
import lzma
import math
import struct
import tempfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import scipy

from core.errors import RotoridError
from core.findings import Finding, Severity
from core.lazy import lazy
from logparse.containers import most_unpacked, unpack

if TYPE_CHECKING:
    import h5py
    from pyarrow import parquet
else:
    h5py, parquet = lazy("h5py"), lazy("pyarrow.parquet")

#: How a packed table is opened, by the end of its name.
_OPENERS: Mapping[str, Callable[[Path], io.BufferedIOBase]] = {
    ".gz": gzip.GzipFile,
    ".xz": lzma.LZMAFile,
    ".bz2": bz2.BZ2File,
}

#: Bytes of a text of which its separator and decimal mark are read.
_SAMPLE = 4096

#: Classes of MATLAB's variables that are no arrays of numbers.
_NO_NUMBERS = ("cell", "struct", "char", "object", "function", "opaque", "sparse")

#: Kinds of elements of a MATLAB file of version 5: packed ones, an array's first, those that arrays of numbers have.
#: And the classes of arrays of numbers.
_COMPRESSED, _FLAGS, _HELD, _NUMERIC = 15, 6, {*range(1, 8), 9, 12, 13, 16}, range(6, 16)

#: File names that a table may have.
SUFFIXES = (".csv", ".txt", ".tsv", ".csv.xz", ".csv.gz", ".csv.bz2", ".parquet", ".mat")


class TableError(RotoridError):
    """A table that cannot be read, or whose columns are missing or contradict each other; the text names them."""


def table_finding(
    column: str, text: str, advice: str, severity: Severity = Severity.WARNING, **evidence: str | float
) -> Finding:
    """Make a finding about a column, or several with commas between them."""
    words = f"column{'s' if ', ' in column else ''} {column}: {text}"
    return Finding("table-doubtful", severity, words, advice, {"column": column, **evidence})


def is_table(path: Path) -> bool:
    """Return whether a file's name is that of a table."""
    return path.name.lower().endswith(SUFFIXES)


def read_columns(path: Path) -> pd.DataFrame:
    """Read a file; lists and matrices become columns ``NAME[0]``, ``NAME[1]`` ..."""
    name = path.name.lower()
    if not path.exists():
        raise TableError(f"{path}: no such file")
    if name.endswith(".mat"):
        return _matlab(path)
    try:
        frame = _parquet(path) if name.endswith(".parquet") else _text(path)
        if frame.empty:
            raise TableError(f"{path.name}: the table has no rows")
        return flatten(frame)
    except RotoridError:
        raise
    except Exception as error:  # damage ends in whatever the libraries and their decompressors happen to raise
        raise TableError(f"{path.name}: not a readable table: {error}") from error


def _text(path: Path) -> pd.DataFrame:
    """Read comma-separated values, unpacked first where they are packed."""
    name = path.name.lower()
    opener = next((_OPENERS[ending] for ending in _OPENERS if name.endswith(ending)), None)
    if opener is None:
        with path.open("rb") as plain:
            return _values(plain, path.name)
    with opener(path) as packed, tempfile.TemporaryFile() as plain:
        _, damage = unpack(packed, plain, path)
        if damage is not None:
            raise damage
        plain.seek(0)
        return _values(plain, path.name)


def _values(file: IO[bytes], name: str) -> pd.DataFrame:
    """Read text by the separator that its first line has most of; beside another, decimals may have commas too."""
    head, _, rows = file.read(_SAMPLE).decode("utf-8", "replace").partition("\n")
    separator = max(",;\t", key=head.count) if any(mark in head for mark in ",;\t") else r"\s+"
    decimal = "," if separator != "," and "," in rows and "." not in rows else "."
    _check_header(file, name)
    file.seek(0)
    return pd.read_csv(file, sep=separator, decimal=decimal, encoding_errors="replace")


def _check_header(file: IO[bytes], name: str) -> None:
    """Refuse a text whose header names more columns than its rows have room for: short rows are filled up in memory."""
    file.seek(0)
    header, *_ = file.readline().replace(b"\r", b"\n").lstrip().splitlines() or [b""]
    columns, ends, size = 1 + max(map(header.count, (b",", b";", b"\t"))), Counter[bytes](), file.seek(0, io.SEEK_END)
    file.seek(0)
    for piece in iter(partial(file.read, 1 << 20), b""):
        ends.update({mark: piece.count(mark) for mark in (b"\n", b"\r")})
    # Every number takes a mark at least: that which parts it from the next, or the end of its row.
    if columns * max(ends.values()) > size:
        raise TableError(
            f"{name}: the header names {columns} columns, more than the rows have: is it of another table?"
        )


def _parquet(path: Path) -> pd.DataFrame:
    """Read a Parquet file, which may hold a billion equal numbers in a few bytes."""
    facts = parquet.read_metadata(path)
    groups, numbers = [facts.row_group(k) for k in range(facts.num_row_groups)], facts.num_rows * facts.num_columns
    # Lists alone have more numbers than rows. Damage at which PyArrow 26 ends the process where a column's facts are
    # looked at, it raises where the column is read.
    if any(facts.schema.column(k).max_repetition_level for k in range(facts.num_columns)):
        parquet.ParquetFile(path).scan_contents()
        numbers = sum(group.column(k).num_values for group in groups for k in range(group.num_columns))
    _check_size(path, max(sum(group.total_byte_size for group in groups), 8 * numbers))
    return pd.read_parquet(path)


def _check_size(path: Path, size: int) -> None:
    """Refuse a table that is larger in memory than an archive may unpack to."""
    if size > (most := most_unpacked(path.stat().st_size)):
        raise TableError(
            f"{path.name} holds {size / 1e9:.3g} GB of numbers, more than the {most / 1e9:.3g} GB that are read here: "
            "cut the table into shorter flights"
        )


def flatten(frame: pd.DataFrame) -> pd.DataFrame:
    """Part columns of lists, or of lists in strings, into columns of numbers; other text becomes NaN."""
    out: dict[str, np.ndarray] = {}
    # Rows longer than the header make an index of hundreds of levels, which every look at a column would copy.
    frame = frame.reset_index(drop=True).set_axis([str(column).strip() for column in frame.columns], axis=1)
    if not frame.columns.is_unique:
        twice = ", ".join(dict.fromkeys(frame.columns[frame.columns.duplicated()]))
        raise TableError(f"column {twice} stands in the table more than once; give each its own name")
    for column in frame.columns:
        series = frame[column]
        if series.dtype.kind in "biuf":
            out[str(column)] = series.to_numpy(np.float64)
            continue
        first = series.dropna()
        sample = first.iloc[0] if len(first) else None
        if isinstance(sample, list | tuple | np.ndarray) or (isinstance(sample, str) and sample.lstrip()[:1] == "["):
            out |= _parted(str(column), series)
        else:
            out[str(column)] = _numbers(series)
    return pd.DataFrame(out)


def _numbers(series: pd.Series) -> np.ndarray:
    """Dates and durations in seconds; of text the numbers, or dates where it has none; NaN for what is neither."""
    if series.dtype.kind not in "mM":
        values = pd.to_numeric(series, errors="coerce").to_numpy(np.float64)
        if np.isfinite(values).any() or not series.dropna().astype(str).str.contains(r"\d[:/-]\d").any():
            return values
        series = pd.to_datetime(series, errors="coerce", format="mixed")
    stamps = series.to_numpy(f"{'timedelta' if series.dtype.kind == 'm' else 'datetime'}64[ns]")
    return np.where(np.isnat(stamps), np.nan, stamps.astype(np.int64) * 1e-9)


def _parted(name: str, series: Iterable[Any]) -> dict[str, np.ndarray]:
    rows = []
    for value in series:
        try:
            parsed = ast.literal_eval(value) if isinstance(value, str) else value
            rows.append(np.asarray(parsed, dtype=np.float64).ravel())
        except (ValueError, SyntaxError, TypeError, OverflowError, MemoryError, RecursionError):
            rows.append(np.empty(0))  # no list of numbers; nested too deep ends in one of the last two
    width = max(len(row) for row in rows)
    if 8 * width * len(rows) > most_unpacked(8 * sum(map(len, rows))):
        raise TableError(f"column {name}: lists of up to {width} numbers in {len(rows)} rows are too much to read")
    matrix = np.full((len(rows), width), np.nan)
    for k, row in enumerate(rows):
        matrix[k, : len(row)] = row
    return {f"{name}[{k}]": matrix[:, k] for k in range(width)}


def _check_tags(path: Path) -> None:
    """Raise ValueError if a MATLAB file of version 5 has elements of kinds that SciPy would crash at."""
    data = path.read_bytes()
    order = {b"\0\1IM": "<", b"\1\0MI": ">"}.get(data[124:128])
    if order is None:
        return  # of another version
    most = most_unpacked(len(data))
    for kind, content in _elements(data[128:], order):
        if kind == _COMPRESSED:
            unpacking = zlib.decompressobj()
            content = unpacking.decompress(content, most)
            _check_size(path, len(content) + len(unpacking.unconsumed_tail) if unpacking.unconsumed_tail else 0)
            ((_, content),) = list(_elements(content, order))[:1]
        kinds, contents = zip(*_elements(content, order), strict=True)
        numeric = contents[0][0 if order == "<" else 3] in _NUMERIC
        if kinds[0] != _FLAGS or (numeric and not _HELD.issuperset(kinds)):
            raise ValueError(f"an array of elements of the kinds {kinds[:9]}")


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of each element of a MATLAB file of version 5; short ones have both in eight bytes."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        start = at + 8
        if kind >> 16:
            kind, size, start = kind & 0xFFFF, min(kind >> 16, 4), at + 4
        yield kind, data[start : start + size]
        at = start + size if kind == _COMPRESSED else at + 8 + (-(-size // 8) * 8 if start == at + 8 else 0)


def _matlab(path: Path) -> pd.DataFrame:
    try:
        _check_tags(path)
        named = {name: shape for name, shape, kind in scipy.io.whosmat(path) if kind not in _NO_NUMBERS}
        _check_size(path, 8 * sum(math.prod(shape) for shape in named.values()))
        content = scipy.io.loadmat(path, squeeze_me=False, variable_names=list(named))
    except NotImplementedError:
        content = _matlab_hdf5(path)  # version 7.3, which SciPy leaves to HDF5 libraries
    except TableError:
        raise
    except Exception as error:  # as of tables
        raise TableError(f"{path.name}: not a readable MATLAB file: {error}") from error
    arrays = {
        key: np.asarray(value, dtype=np.float64)
        for key, value in content.items()
        if not key.startswith("__") and isinstance(value, np.ndarray) and value.dtype.kind in "biuf" and value.ndim == 2
    }
    if not arrays:
        raise TableError(f"{path.name}: no arrays of numbers in the file")
    length = max(max(value.shape) for value in arrays.values())
    out: dict[str, np.ndarray] = {}
    for key, value in arrays.items():
        rows = value if value.shape[0] == length else value.T
        if rows.shape[0] != length:
            continue
        if rows.shape[1] == 1:
            out[key] = rows[:, 0]
        else:
            out |= {f"{key}[{k}]": rows[:, k] for k in range(rows.shape[1])}
    return pd.DataFrame(out)


def _matlab_hdf5(path: Path) -> dict[str, np.ndarray]:
    """Arrays of numbers of a MATLAB file of version 7.3, whose axes HDF5 has in reverse; no text, structs or cells."""
    try:
        with h5py.File(path) as file:
            found = {
                key: value
                for key, value in file.items()
                if isinstance(value, h5py.Dataset) and value.attrs.get("MATLAB_class") not in (b"char", b"cell")
            }
            _check_size(path, 8 * sum(value.size for value in found.values()))
            return {key: np.asarray(value).T for key, value in found.items()}
    except TableError:
        raise
    except Exception as error:  # as of tables
        raise TableError(f"{path.name}: not a readable MATLAB file of version 7.3: {error}") from error
