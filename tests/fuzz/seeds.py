"""Logs of every format, small or whole, that mutations begin with."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from logparse import read_log
from tests.fuzz.px4_seed import px4_log
from tests.fuzz.spans import messages
from tests.paths import ROOT

#: Rows kept of each message: enough for every table, few enough for thousands of mutations.
_ROWS = 25
#: Bytes of a log's head, where formats and parameters are.
_HEAD = 30_000
#: Most bytes of flight behind it, in all but one of so many mutations, which begins with a whole log.
_MOST, _WHOLE = 150_000, 500


@cache
def seeds() -> dict[str, bytes]:
    """Return small logs by the ending of their format."""
    flight = ROOT / "sample_logs" / "octa02_alain_breeze"
    whole = _read(flight.with_suffix(".bin"))
    return {
        "bin": whole[:_HEAD] + whole[len(whole) // 2 :][:20_000],
        "log": _as_text(flight.with_suffix(".bin")),
        "tlog": _read(flight.with_suffix(".tlog"))[:60_000],
        "ulg": px4_log(),
    }


def draw(ending: str, rng: np.random.Generator) -> bytes:
    """Return one of many logs of a format: the small one, a window of another flight, seldom a whole log."""
    if rng.random() < 0.4:
        return seeds()[ending]
    if ending == "ulg":
        return px4_log(int(rng.integers(2, 120)))
    logs = sorted((ROOT / "sample_logs").glob("*.tlog" if ending == "tlog" else "*.bin"))
    path = logs[int(rng.integers(len(logs)))]
    if ending == "log":
        return _as_text(logs[int(rng.integers(3))])
    whole = _read(path) if ending == "bin" or rng.random() < 0.7 else _unstamped(path)
    if rng.integers(_WHOLE) == 0 and len(whole) < 2_000_000:
        return whole
    at = int(rng.integers(_HEAD, len(whole)))
    return whole[:_HEAD] + whole[at : at + int(np.exp(rng.uniform(np.log(2_000), np.log(_MOST))))]


@cache
def _read(path: Path) -> bytes:
    return path.read_bytes()


@cache
def _unstamped(path: Path) -> bytes:
    """Return telemetry as a radio gives it, without the logger's times."""
    data = _read(path)
    return b"".join(data[span.start + 8 : span.stop] for _, span in messages(data, "tlog"))


@cache
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
