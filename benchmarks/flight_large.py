"""One flight of five hours, 1 GB of log: CPU of an analysis and its memory, and CPU of a look into it.

The simulator flies no more than an hour. So a flight of 20 min in calm air, which begins and ends hovering over one
place, is written one time behind the other, with its clocks going on. Not part of `make bench`: it takes minutes, and
some 3 GB of memory.
"""

import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks._measure import Row, command_cpu, row
from benchmarks.flight import rows_of, write_long_log
from logparse.dataflash.chain import Chain

Bytes = npt.NDArray[np.uint8]

#: Bytes of the log, and the seconds of hovering at either end of the flight that is repeated.
SIZE, HOVER = 1e9, 20.0
#: Seconds after the craft has left the ground, and before it is back on it, that are within those.
RISEN, LANDING = 18.0, 22.0
#: Clocks in a log, and how often they tick in a second: the autopilot's, and the receiver's week.
CLOCKS = {"TimeUS": 1_000_000, "GMS": 1_000}


def write_large_log(folder: Path, size: float = SIZE) -> Path:
    """Write the log, of `size` bytes or somewhat more."""
    source = write_long_log(folder, "octa01_zurich_calm", HOVER)
    truth = json.loads(source.with_suffix(".json").read_text())
    start, stop = truth["time_s"]["airborne"]
    return repeat(source, folder / "large.bin", size, start + RISEN, stop - LANDING)


def repeat(source: Path, target: Path, size: float, start: float, stop: float) -> Path:
    """Write a log in which the whole seconds between two times on the boot clock come again and again, to a size.

    The craft must be in the same state at both times.
    """
    chain = Chain(source.read_bytes())
    places = np.sort(chain.positions)
    clocks = list(_clocks(chain, places))
    boot = np.zeros(len(places))
    for rows, at, ticks in clocks:
        if ticks == CLOCKS["TimeUS"]:
            boot[rows] = _value(chain.data, at).ravel() / ticks
    # Rows come a little out of the order of time, and some have none.
    order = np.maximum.accumulate(boot)
    period = int(stop - start)
    first, last = (int(places[np.searchsorted(order, t)]) for t in (start, start + period))
    times = max(int(np.ceil((size - first) / (last - first))), 1)
    with target.open("wb") as file:
        file.write(chain.data[:first].tobytes())
        for number in range(times):
            later = _later(chain.data, clocks, number * period)
            file.write(later[first : last if number < times - 1 else None].tobytes())
    return target


def _clocks(chain: Chain, places: npt.NDArray[Any]) -> Iterator[tuple[npt.NDArray[np.intp], npt.NDArray, int]]:
    """Yield for each clock of each message its rows, the bytes that hold it, and its ticks in a second."""
    for number, slot in enumerate(chain.slots):
        rows = np.searchsorted(places, chain.placed(number))
        for field in slot.fields:
            if field.name in CLOCKS:
                at = places[rows, None].astype(np.int64) + field.offset + np.arange(field.type.size)
                yield rows, at, CLOCKS[field.name]


def _value(data: Bytes, at: npt.NDArray[np.int64]) -> npt.NDArray[np.uint64]:
    return np.ascontiguousarray(data[at]).view(f"u{at.shape[1]}")


def _later(data: Bytes, clocks: list[tuple[npt.NDArray, npt.NDArray, int]], seconds: int) -> Bytes:
    """Return the messages as they would have been written so much later."""
    moved = data.copy()
    for _, at, ticks in clocks:
        moved[at] = (_value(data, at) + np.array(seconds * ticks).astype(f"u{at.shape[1]}")).view(np.uint8)
    return moved


def run() -> list[Row]:
    """Measure."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_large_log(Path(folder))
        looked = command_cpu("inspect", str(path), "--json")
        rows = rows_of("5 h octocopter", path, "< 60 s", "< 1.2")
    return [*rows, row("... rotorid inspect, CPU", f"{looked:.1f} s", goal="< 2 s")]


if __name__ == "__main__":
    print(write_large_log(Path(sys.argv[1])))
