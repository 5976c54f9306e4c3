"""Logs to columns: speed and memory against pymavlink, signalviewer-lite and a plain memory copy.

The inputs are real logs, DataFlash and telemetry, repeated to 100 MB and 1 GB. Each measurement is a process of its own
that first reads a small log (compiled code, imports) and then takes the least CPU time of a few passes; peak memory is
what the first pass adds to the process. Everyone reads all messages into a column for each field: ours typed, with boot
clock, checksums verified; signalviewer-lite as float64, without checksums and text; pymavlink by `recv_msg`, on a
tenth of a large telemetry log, since its speed does not depend on the size.
"""

import json
import mmap
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np
from pymavlink import DFReader, mavutil

from benchmarks._measure import LOGS, SAMPLES, SITL, Row, copy_speed, in_process, read_timed, row
from benchmarks.flight_large import repeat
from logparse import read_log
from logparse.mavlink.tlog import TlogSource
from logparse.source import Boot

MB = 1_000_000
FIVE = {
    "bin": ("IMU", "GPS", "BARO", "RCOU", "ATT"),
    "tlog": ("ATTITUDE", "GLOBAL_POSITION_INT", "SERVO_OUTPUT_RAW", "RAW_IMU", "GPS_RAW_INT"),
}
#: The log that is repeated of each kind, with the goals against signalviewer-lite and pymavlink; where the shared logs
#: are missing, the project's own.
SOURCES = {
    "bin": (SITL / "octa09_systemid_mixer.BIN", "> 9", "> 500"),
    "tlog": (LOGS / "real" / "pypi-fasttlogparser__pymavlink_flight.tlog", "> 30", "> 300"),
}


def read_bin(path: str, names: tuple[str, ...] | None = None) -> tuple[int, float]:
    """Decode some or all message types; return messages read and a sum over one column."""
    messages = read_log(path).messages
    messages.load(messages if names is None else names)
    read = sum(len(messages[name]) for name in (messages if names is None else names))
    return read, float(messages["ATT"]["Roll"].to_numpy().sum(dtype=np.float64))


def read_tlog(path: str, names: tuple[str, ...] | None = None) -> object:
    """Decode some or all messages of telemetry."""
    with Path(path).open("rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    source = TlogSource(data)
    whole = Boot(0, len(data), 0.0, 0.0)
    return source.decode_many(names or source.counts(whole), whole)


def pymavlink(path: str) -> tuple[int, float]:
    """Decode every field of every message into arrays, scaled as pymavlink scales."""
    binary = path.endswith(".bin")
    reader = DFReader.DFReader_binary(path) if binary else mavutil.mavlogfile(path)
    columns: dict[str, dict[str, list[object]]] = defaultdict(lambda: defaultdict(list))
    read = 0
    while (message := reader.recv_msg()) is not None:
        fields = columns[message.get_type()]
        for name in message.get_fieldnames():
            fields[name].append(getattr(message, name))
        read += 1
    arrays = {kind: {name: np.array(v) for name, v in fields.items()} for kind, fields in columns.items()}
    reader.close()
    return read, float(arrays["ATT"]["Roll"].sum()) if binary else 0.0


def signalviewer(path: str) -> tuple[int, float]:
    """Read every numeric field into an array with its time vector."""
    core = Path(str(import_module("signalviewer").__file__)).parent / "_core"
    sys.path.insert(0, str(core))
    loader = import_module("svcore.bin_loader" if path.endswith(".bin") else "svcore.tlog_loader")
    # Its index on disk would make every pass but the first a different task.
    import_module("svcore.csv_loader").CACHE_ENABLED = False
    if not path.endswith(".bin"):
        loader.load_tlog(path, "benchmark")
        return 0, 0.0
    run, _info = loader.load_bin(path, "benchmark")
    roll = next(s.data for s in run.signals.values() if s.name.split(" [")[0] == "ATT.Roll")
    return 0, float(np.sum(roll, dtype=np.float64))


READERS: dict[str, Callable[[str], object]] = {
    "scan": lambda path: sum(read_log(path).messages.counts.values()),
    "bin, all messages": read_bin,
    "bin, five messages": lambda path: read_bin(path, FIVE["bin"]),
    "tlog, all messages": read_tlog,
    "tlog, five messages": lambda path: read_tlog(path, FIVE["tlog"]),
    "pymavlink": pymavlink,
    "signalviewer-lite": signalviewer,
}


def grown(source: Path, target: Path, size: int) -> Path:
    """Repeat the messages of a log to `size` bytes; those of a DataFlash log each time later by its length."""
    if target.suffix == ".bin":
        times = read_log(source).messages["ATT"].index
        return repeat(source, target, size, float(times[0]), float(times[-1]))
    target.write_bytes(source.read_bytes() * max(1, size // source.stat().st_size))
    return target


def run() -> list[Row]:
    """Measure both kinds of log."""
    rows: list[Row] = []
    copy = copy_speed(1 << 28)
    with tempfile.TemporaryDirectory() as folder:
        for kind, (source, *goals) in SOURCES.items():
            if not source.exists():
                source = max(SAMPLES.glob(f"*.{kind}"), key=lambda path: path.stat().st_size)
            peers = dict(zip(("signalviewer-lite", "pymavlink"), goals, strict=True))
            rows += _rows(kind, source, Path(folder) / f"log.{kind}", peers, copy)
    return rows


def _rows(kind: str, source: Path, path: Path, peers: dict[str, str], copy: float) -> list[Row]:
    rows: list[Row] = []
    small = source if kind == "tlog" else grown(source, path.with_stem("small"), 1)
    for label, target in (("100 MB", 100 * MB), ("1 GB", 1000 * MB)):
        size = grown(source, path, target).stat().st_size
        for what, most in (("all messages", "< 1.3"), ("five messages", "< 0.3")):
            ours = in_process("logparse", f"{kind}, {what}", path, small, 3)
            speed = size / MB / ours["cpu"]
            rows.append(row(f"{kind} {label}, {what}, MB/s; memory copy", speed, copy, speed / copy))
            if target > 100 * MB:
                rows.append(row(f"{kind} {label}, {what}, peak memory over file", ours["peak"] / size, goal=most))
            elif what == "all messages":
                rows += [_compared(kind, name, goal, path, small, ours, speed) for name, goal in peers.items()]
    return rows


def _compared(kind: str, peer: str, goal: str, path: Path, small: Path, ours: dict, speed: float) -> Row:
    """Compare with a peer that reads the same log, checking that it reads the same."""
    what = f"{kind} 100 MB, all messages, MB/s; {peer}"
    whole = path if kind == "bin" or peer != "pymavlink" else small
    theirs = in_process("logparse", peer, whole, small, 1)
    if theirs is None:
        return row(what, speed, "not installed", goal=goal)
    assert kind != "bin" or np.isclose(theirs["read"][1], ours["read"][1], rtol=1e-6)
    their_speed = whole.stat().st_size / MB / theirs["cpu"]
    return row(what, speed, their_speed, speed / their_speed, goal)


if __name__ == "__main__":
    what, path, small, passes = sys.argv[1:]
    sys.stdout.write(json.dumps(read_timed(READERS[what], path, small, int(passes))))
