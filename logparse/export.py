"""Messages and canonical tables of a log as files for other programs."""

import re
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from core.errors import RotoridError
from core.lazy import lazy
from core.table import as_cell
from logparse.tables import COLUMNS

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq
    from scipy import io

    from logparse.log import FlightLog
else:
    pa, pq, io = lazy("pyarrow"), lazy("pyarrow.parquet"), lazy("scipy.io")

FORMATS = ("parquet", "csv", "mat")


def export(
    log: "FlightLog",
    folder: str | Path,
    *,
    format: str = "parquet",  # noqa: A002 -- the word of the command line
    messages: Iterable[str] | None = None,
    start: float | None = None,
    stop: float | None = None,
) -> tuple[Path, ...]:
    """Write messages as logged and canonical tables, one file each; for MATLAB one file with all of them."""
    if format not in FORMATS:
        raise RotoridError(f"unknown export format {format!r}; there are {', '.join(FORMATS)}")
    tables, raw = _selection(log, messages)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    frames = _frames(log, tables, raw, start, stop)
    if messages is None and log.parameters:
        values = pd.DataFrame({"name": list(log.parameters), "value": list(log.parameters.values())})
        frames = chain(frames, [("parameters", "parameters", values)])
    if format == "mat":
        return (_write_mat(frames, folder / f"{_file_name(log.path.stem)}.mat"),)
    return tuple(_write(frame, folder / group / f"{_file_name(name)}.{format}") for group, name, frame in frames)


def _selection(log: "FlightLog", names: Iterable[str] | None) -> tuple[list[str], list[str]]:
    """Canonical tables and messages to export."""
    tables = [name for name in COLUMNS if getattr(log.tables, name) is not None]
    if names is None:
        return tables, sorted(log.messages)
    wanted = list(dict.fromkeys(names))
    unknown = [name for name in wanted if name not in tables and name not in log.messages]
    if unknown:
        raise RotoridError(
            f"{log.path.name} has no {', '.join(unknown)}; it has the tables {', '.join(tables)} "
            f"and the messages {', '.join(sorted(log.messages))}"
        )
    return [name for name in wanted if name in tables], [name for name in wanted if name in log.messages]


def _frames(
    log: "FlightLog", tables: list[str], raw: list[str], start: float | None, stop: float | None
) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Group, name and rows of each table, time as first column."""
    for group, names in (("tables", tables), ("messages", raw)):
        for name in names:
            frame: pd.DataFrame = getattr(log.tables, name) if group == "tables" else log.messages[name]
            units = dict(frame.attrs.get("units", {}))
            if group == "tables":
                units = {str(column): unit(name, str(column)) for column in frame}
            t = frame.index.to_numpy()
            inside = np.ones(len(t), dtype=bool)
            if start is not None:
                inside &= t >= start
            if stop is not None:
                inside &= t <= stop
            chosen = frame if inside.all() else frame[inside]
            rows = chosen.rename_axis("t").reset_index(allow_duplicates=True)
            rows.attrs = {"units": {"t": "s", **units}}
            yield group, name, rows


def unit(table: str, column: str) -> str:
    """Return the unit of a canonical column: the part of its description before the semicolon; empty without one."""
    columns = COLUMNS[table]
    described = columns.get(column) or columns.get(re.sub(r"\d+$", "{k}", column), "")
    first = described.partition(";")[0]
    return "" if " " in first or first == "1" else first


def _file_name(name: str) -> str:
    """Name for a file: what could leave the folder or upset a file system becomes an underscore."""
    return re.sub(r"[^\w.\-]+", "_", name).lstrip(".") or "log"


def _write(frame: pd.DataFrame, path: Path) -> Path:
    """Write one table as Parquet or CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    frame = _flat(frame)
    if path.suffix == ".csv":
        cells = _spread(frame)
        for name in cells.select_dtypes(exclude=["number", "bool"]):
            cells[name] = [as_cell(value) if isinstance(value, str) else value for value in cells[name]]
        cells.rename(columns=as_cell).to_csv(path, index=False)
        return path
    units: Mapping[str, str] = frame.attrs.get("units", {})
    bare = frame.copy(deep=False)
    bare.attrs = {}
    arrow = pa.Table.from_pandas(bare, preserve_index=False)
    fields = [
        field.with_metadata({"unit": units[field.name]}) if units.get(field.name) else field for field in arrow.schema
    ]
    pq.write_table(arrow.cast(pa.schema(fields, arrow.schema.metadata)), path)
    return path


def _flat(frame: pd.DataFrame) -> pd.DataFrame:
    """Text for columns of bytes, unique column names."""
    result = frame.copy(deep=False)
    result.columns = pd.Index(_unique(str(column) for column in frame.columns))
    for k, name in enumerate(result.columns):
        column = frame.iloc[:, k]
        if column.dtype == object and any(isinstance(value, bytes) for value in column.head(10)):
            result[name] = [value.hex() if isinstance(value, bytes) else value for value in column]
    result.attrs = frame.attrs
    return result


def _spread(frame: pd.DataFrame) -> pd.DataFrame:
    """One column for each element of array fields: x[0], x[1] ..."""
    parts: dict[str, object] = {}
    for name in frame.columns:
        if _is_array(frame[name]):
            matrix = _matrix(frame[name])
            parts |= {f"{name}[{k}]": matrix[:, k] for k in range(matrix.shape[1])}
        else:
            parts[name] = frame[name]
    return pd.DataFrame(parts, index=frame.index)


def _is_array(column: "pd.Series[Any]") -> bool:
    """Whether the values are arrays of numbers, as those of ISBD."""
    return "list" in str(column.dtype)


def _matrix(column: "pd.Series[Any]") -> np.ndarray:
    """Rows of an array field, shape (N, elements)."""
    return np.array([np.asarray(row) for row in column]) if len(column) else np.zeros((0, 0))


def _unique(names: Iterable[str]) -> list[str]:
    """Names with a number after those that come again; a message can have a field called t."""
    result: list[str] = []
    for name in names:
        again = (f"{name}_{k}" for k in count(2))
        result.append(next(each for each in chain([name], again) if each not in result))
    return result


def _write_mat(frames: Iterable[tuple[str, str, pd.DataFrame]], path: Path) -> Path:
    """Write all tables as structs of column vectors: `tables.motors.m1`, `messages.RCOU.C1`."""
    content: dict[str, dict[str, dict[str, np.ndarray]]] = {}
    for group, name, frame in frames:
        flat = _flat(frame)
        columns = {}
        for column in flat.columns:
            values = flat[column]
            if _is_array(values):
                columns[column] = _matrix(values)
            elif pd.api.types.is_numeric_dtype(values.dtype) or pd.api.types.is_bool_dtype(values.dtype):
                columns[column] = values.to_numpy()[:, None]
            else:
                cells = np.empty((len(values), 1), dtype=object)
                cells[:, 0] = ["" if pd.isna(value) is True else str(value) for value in values]
                columns[column] = cells
        names = _matlab_names(columns)
        content.setdefault(group, {})[name] = {names[column]: values for column, values in columns.items()}
    flattened = {}
    for group, parts in content.items():
        names = _matlab_names(parts)
        flattened[group] = {names[name]: columns for name, columns in parts.items()}
    io.savemat(path, flattened, long_field_names=True, do_compression=True, oned_as="column")
    return path


def _matlab_names(names: Iterable[str]) -> dict[str, str]:
    """Field names that MATLAB takes: letters, digits and underscores, a letter first, 63 at most, each once."""
    given: dict[str, str] = {}
    for name in names:
        field = re.sub(r"\W", "_", name, flags=re.ASCII)[:60]
        if not field[:1].isalpha():
            field = f"x{field}"
        while field in given.values():
            field += "_"
        given[name] = field
    return given
