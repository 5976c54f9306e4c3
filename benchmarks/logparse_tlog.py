"""Telemetry logs to columns, checksums verified: against signalviewer-lite and pymavlink.

The input is a real log repeated to 100 MB (and 1 GB). Everyone reads all messages into one column per field and reports
CPU time, the best of a few runs in a process of its own, after one run on the small log (which also compiles ours).

- ours: `TlogSource` and `decode_many` of everything: typed columns, boot clock, senders. Checksums verified.
- signalviewer-lite: `load_tlog`: float64 columns. It verifies no checksums and leaves the ground station's messages
  out.
- pymavlink: `recv_msg` to the end and a numpy array of each field; on a tenth of the input, since its speed does not
  depend on the size. Checksums verified (by fastcrc).
"""

import json
import mmap
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np

from benchmarks._measure import LOGS, SAMPLES, Row, copy_speed, in_process, read_timed, row

#: A long MAVLink 1 log and a MAVLink 2 log; where the shared logs are missing, the project's own.
SOURCES = (
    ("MAVLink 1", LOGS / "real" / "pypi-fasttlogparser__pymavlink_flight.tlog"),
    ("MAVLink 2", LOGS / "sitl" / "quad06_auto.tlog"),
)
MEGABYTE = 1_000_000
FIVE = ("ATTITUDE", "GLOBAL_POSITION_INT", "SERVO_OUTPUT_RAW", "RAW_IMU", "GPS_RAW_INT")


def run() -> list[Row]:
    rows: list[Row] = []
    sources = [(what, path) for what, path in SOURCES if path.exists()]
    if not sources:
        sources = [("sample log", path) for path in sorted(SAMPLES.glob("*.tlog"))[:1]]
    with tempfile.TemporaryDirectory() as folder:
        for what, path in sources:
            big = repeat(path, 100 * MEGABYTE, Path(folder) / "100.tlog")
            small = repeat(path, 10 * MEGABYTE, Path(folder) / "10.tlog")
            ours = measure("ours", big, path)
            title = f"tlog {what} 100 MB, all columns, MB/s"
            rows += [
                compared(f"{title}, vs signalviewer-lite", ours, measure("signalviewer", big, path), ">= 30"),
                compared(f"{title}, vs pymavlink", ours, measure("pymavlink", small, path), ">= 300"),
                row(f"tlog {what}, part of memory copy's speed", ours["speed"] / copy_speed()),
                row(f"tlog {what}, five messages, MB/s", measure("five", big, path)["speed"]),
            ]
            big.unlink()
        what, path = sources[0]
        huge = repeat(path, 1000 * MEGABYTE, Path(folder) / "1000.tlog")
        for kind, title, target in (("ours", "all columns", "<= 1.3"), ("five", "five messages", "<= 0.3")):
            speed = measure(kind, huge, path)["speed"]
            memory = measure(kind, huge, path, 1)["memory"]
            rows += [
                row(f"tlog {what} 1 GB, {title}, MB/s", speed),
                row(f"tlog {what} 1 GB, {title}, peak memory / file", memory, goal=target),
            ]
    return rows


def repeat(source: Path, size: int, target: Path) -> Path:
    """Write a log over and over until the file has the size."""
    body = source.read_bytes()
    with target.open("wb") as file:
        for _ in range(max(1, size // len(body))):
            file.write(body)
    return target


def compared(what: str, ours: dict[str, float], peer: dict[str, float] | None, goal: str) -> Row:
    if peer is None:
        return row(what, ours["speed"], "not installed", goal=goal)
    return row(what, ours["speed"], peer["speed"], ours["speed"] / peer["speed"], goal)


def measure(reader: str, path: Path, warm_up: Path, runs: int = 3) -> dict[str, float] | None:
    """Return speed [MB/s] and peak memory [parts of the file] of a reader; None where it is not installed."""
    found = in_process("logparse_tlog", reader, path, warm_up, runs)
    size = path.stat().st_size
    return found and {"speed": size / MEGABYTE / found["cpu"], "memory": found["peak"] / size}


def read_ours(path: str, names: tuple[str, ...] | None = None) -> object:
    from logparse.mavlink.tlog import TlogSource
    from logparse.source import Boot

    with Path(path).open("rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    source = TlogSource(data)
    whole = Boot(0, len(data), 0.0, 0.0)
    return source.decode_many(names or source.counts(whole), whole)


def read_five(path: str) -> object:
    return read_ours(path, FIVE)


def read_signalviewer(path: str) -> object:
    import signalviewer

    core = str(Path(signalviewer.__file__).parent / "_core")
    if core not in sys.path:
        sys.path.insert(0, core)
    from svcore.tlog_loader import load_tlog

    return load_tlog(path, Path(path).name)


def read_pymavlink(path: str) -> object:
    from pymavlink import mavutil

    connection = mavutil.mavlogfile(path)
    rows = defaultdict(list)
    fields = {}
    while (message := connection.recv_msg()) is not None:
        name = message.get_type()
        if name != "BAD_DATA":
            fields[name] = names = message.get_fieldnames()
            rows[name].append((message._timestamp, *(getattr(message, field) for field in names)))
    connection.close()
    return {
        name: {
            field: np.array(values)
            for field, values in zip(("t", *fields[name]), zip(*found, strict=True), strict=True)
        }
        for name, found in rows.items()
    }


READERS = {"ours": read_ours, "five": read_five, "signalviewer": read_signalviewer, "pymavlink": read_pymavlink}

if __name__ == "__main__":
    reader, path, warm_up, runs = sys.argv[1:]
    print(json.dumps(read_timed(READERS[reader], path, warm_up, int(runs))))
