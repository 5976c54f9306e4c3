"""Read a table of any of the usual kinds into a DataFrame of numbers, one column for every number of a row."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import scipy

from logparse.errors import RotoridError
from logparse.lazy import lazy

if TYPE_CHECKING:
    import h5py
else:
    h5py = lazy("h5py")

#: File names that a table may have.
SUFFIXES = (".csv", ".txt", ".tsv", ".csv.xz", ".csv.gz", ".csv.bz2", ".parquet", ".mat")


class TableError(RotoridError):
    """A table that cannot be read, or whose columns are missing or contradict each other; the text names them."""


def is_table(path: Path) -> bool:
    """Return whether a file's name is that of a table."""
    return path.name.lower().endswith(SUFFIXES)


def read_columns(path: Path) -> pd.DataFrame:
    """Read a file; lists and matrices become columns ``NAME[0]``, ``NAME[1]`` ...

    Parameters
    ----------
    path : Path
        CSV (plain or compressed), Parquet, or MATLAB of any version; lists may stand in strings.

    Raises
    ------
    TableError
        When the file is no such table.
    """
    name = path.name.lower()
    if not path.exists():
        raise TableError(f"{path}: no such file")
    if name.endswith(".mat"):
        return _matlab(path)
    try:
        if name.endswith(".parquet"):
            frame = pd.read_parquet(path)
        else:
            frame = pd.read_csv(path, sep=None if name.endswith((".txt", ".tsv")) else ",", engine=_engine(name))
    except Exception as error:  # damage ends in whatever the libraries and their decompressors happen to raise
        raise TableError(f"{path.name}: not a readable table: {error}") from error
    if frame.empty:
        raise TableError(f"{path.name}: the table has no rows")
    return flatten(frame)


def _engine(name: str) -> Any:
    return "python" if name.endswith((".txt", ".tsv")) else "c"


def flatten(frame: pd.DataFrame) -> pd.DataFrame:
    """Part columns of lists, or of lists in strings, into columns of numbers; other text becomes NaN."""
    out: dict[str, np.ndarray] = {}
    for column in frame.columns:
        series = frame[column]
        if series.dtype.kind in "biuf":
            out[str(column)] = series.to_numpy(np.float64)
            continue
        first = series.dropna()
        sample = first.iloc[0] if len(first) else None
        if isinstance(sample, list | tuple | np.ndarray) or (isinstance(sample, str) and sample.lstrip()[:1] == "["):
            out |= _parted(str(column), series)
        elif series.dtype.kind == "M":
            out[str(column)] = series.to_numpy("datetime64[ns]").astype(np.int64) * 1e-9
        else:
            out[str(column)] = pd.to_numeric(series, errors="coerce").to_numpy(np.float64)
    return pd.DataFrame(out)


def _parted(name: str, series: Iterable[Any]) -> dict[str, np.ndarray]:
    rows = []
    for value in series:
        try:
            parsed = ast.literal_eval(value) if isinstance(value, str) else value
            rows.append(np.asarray(parsed, dtype=np.float64).ravel())
        except (ValueError, SyntaxError, TypeError):
            rows.append(np.empty(0))
    width = max(len(row) for row in rows)
    matrix = np.full((len(rows), width), np.nan)
    for k, row in enumerate(rows):
        matrix[k, : len(row)] = row
    return {f"{name}[{k}]": matrix[:, k] for k in range(width)}


def _matlab(path: Path) -> pd.DataFrame:
    try:
        content = scipy.io.loadmat(path, squeeze_me=False)
    except NotImplementedError:
        content = _matlab_hdf5(path)  # version 7.3, which SciPy leaves to HDF5 libraries
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
            return {
                key: np.asarray(value).T
                for key, value in file.items()
                if isinstance(value, h5py.Dataset) and value.attrs.get("MATLAB_class") not in (b"char", b"cell")
            }
    except Exception as error:  # as of tables
        raise TableError(f"{path.name}: not a readable MATLAB file of version 7.3: {error}") from error
