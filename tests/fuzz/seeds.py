"""Small logs of every format, made here, that mutations begin with."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pandas as pd

from logparse import read_log
from tests.fuzz.px4_seed import px4_log

ROOT = Path(__file__).parents[2]

#: Rows kept of each message: enough for every table, few enough for thousands of mutations.
_ROWS = 25


@cache
def seeds() -> dict[str, bytes]:
    """Return small logs by the ending of their format."""
    flight = ROOT / "sample_logs" / "octa02_alain_breeze"
    return {
        "bin": _thinned(flight.with_suffix(".bin")),
        "log": _as_text(flight.with_suffix(".bin")),
        "tlog": _head(flight.with_suffix(".tlog"), 60_000),
        "ulg": px4_log(),
    }


def _head(path: Path, size: int) -> bytes:
    with path.open("rb") as file:
        return file.read(size)


def _thinned(path: Path) -> bytes:
    """Return the head of a log, where formats and parameters are, and two seconds of its flight."""
    data = path.read_bytes()
    middle = len(data) // 2
    return data[:30_000] + data[middle : middle + 20_000]


def _as_text(path: Path) -> bytes:
    """Return some rows of each message of a log as the autopilot's tools write them."""
    log = read_log(path)
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    rows: list[tuple[float, str]] = []
    for number, name in enumerate(log.messages, start=1):
        frame = log.messages[name]
        columns = ["TimeUS", *(str(column) for column in frame.columns)]
        types = "Q" + "".join(_type(frame[column]) for column in frame.columns)
        lines.append(f"FMT, {number}, 50, {name}, {types}, {','.join(columns)}")
        step = max(1, len(frame) // _ROWS)
        for t, row in zip(frame.index[::step], frame.iloc[::step].itertuples(index=False), strict=False):
            rows.append((float(t), f"{name}, {round(float(t) * 1e6)}, {', '.join(str(value) for value in row)}"))
    return ("\n".join([*lines, *(text for _, text in sorted(rows))]) + "\n").encode()


def _type(column: pd.Series) -> str:
    return "f" if pd.api.types.is_numeric_dtype(column) else "Z"
