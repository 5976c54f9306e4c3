"""DataFlash binary to columns: speed and memory against pymavlink, signalviewer-lite and a plain memory copy.

The inputs are a real log's body repeated to 100 MB and 1 GB with the clock running on. Each measurement is a process of
its own that first reads a small log (compiled code, imports) and then takes the least CPU time of a few passes; peak
memory is what the first pass adds to the process. All readers must give the same messages, which is checked.
"""

import json
import sys
import tempfile
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from pymavlink import DFReader

from benchmarks._measure import SAMPLES, SITL, Row, copy_speed, in_process, read_timed, row
from benchmarks.flight_large import repeat
from logparse import read_log

MODULE = "logparse_dataflash"
FIVE = ("IMU", "GPS", "BARO", "RCOU", "ATT")


def base_log() -> Path:
    """Find a log to repeat: a full-rate log of the shared ones, else the largest sample log."""
    shared = SITL / "octa09_systemid_mixer.BIN"
    return shared if shared.exists() else max(SAMPLES.glob("*.bin"), key=lambda path: path.stat().st_size)


def grown(source: Path, target: Path, size: int) -> Path:
    """Repeat the messages of a log to `size` bytes, each time later by the length of the log."""
    times = read_log(source).messages["ATT"].index
    return repeat(source, target, size, float(times[0]), float(times[-1]))


def ours(path: str, names: tuple[str, ...] | None) -> tuple[int, float]:
    """Read a log and decode some or all message types; return messages read and a sum over one column."""
    log = read_log(path)
    log.messages.load(log.messages if names is None else names)
    read = sum(len(log.messages[name]) for name in (log.messages if names is None else names))
    return read, float(log.messages["ATT"]["Roll"].to_numpy().sum(dtype=np.float64))


def scan(path: str) -> tuple[int, float]:
    """Follow the header chain only."""
    return sum(read_log(path).messages.counts.values()), 0.0


def pymavlink(path: str) -> tuple[int, float]:
    """Every field of every message into arrays, scaled as pymavlink scales."""
    reader = DFReader.DFReader_binary(path)
    columns: dict[str, dict[str, list[object]]] = {}
    read = 0
    while (message := reader.recv_msg()) is not None:
        fields = columns.setdefault(message.get_type(), {name: [] for name in message.get_fieldnames()})
        for name, values in fields.items():
            values.append(getattr(message, name))
        read += 1
    arrays = {kind: {name: np.array(v) for name, v in fields.items()} for kind, fields in columns.items()}
    reader.close()
    return read, float(arrays["ATT"]["Roll"].sum())


def signalviewer(path: str) -> tuple[int, float]:
    """Every numeric field into an array with its time vector; it keeps no text."""
    import_module("signalviewer")  # puts its reader on the path
    from svcore import csv_loader  # type: ignore[import-not-found]
    from svcore.bin_loader import load_bin  # type: ignore[import-not-found]

    # Its index on disk would make every pass but the first a different task.
    csv_loader.CACHE_ENABLED = False
    run, _info = load_bin(path, "benchmark")
    signals = {signal.name: (signal.time, signal.data) for signal in run.signals.values()}
    roll = next(values for name, (_time, values) in signals.items() if name.split(" [")[0] == "ATT.Roll")
    return 0, float(np.sum(roll, dtype=np.float64))


MEASURES: dict[str, Callable[[str], tuple[int, float]]] = {
    "scan": scan,
    "ours, all": lambda path: ours(path, None),
    "ours, five": lambda path: ours(path, FIVE),
    "pymavlink": pymavlink,
    "signalviewer": signalviewer,
}


def run() -> list[Row]:
    rows: list[Row] = []
    small = base_log()
    copy = 1e6 * copy_speed(1 << 28)
    with tempfile.TemporaryDirectory() as folder:
        peers: dict[str, float] = {}
        for label, size in (("100 MB", 100_000_000), ("1 GB", 1_000_000_000)):
            path = Path(folder) / "log.bin"
            size = grown(small, path, size).stat().st_size
            found = {what: in_process(MODULE, what, path, small, 3) for what in ("scan", "ours, all", "ours, five")}
            everything = found["ours, all"]
            rate = {what: size / result["cpu"] for what, result in found.items()}
            if label == "100 MB":
                # At 2 MB/s once is enough, and a larger file would tell nothing else.
                theirs = in_process(MODULE, "pymavlink", path, small, 1)
                assert theirs["read"][0] == everything["read"][0]
                assert np.isclose(theirs["read"][1], everything["read"][1], rtol=1e-6)
                peers["pymavlink"] = size / theirs["cpu"]
            if find_spec("signalviewer") is not None:
                theirs = in_process(MODULE, "signalviewer", path, small, 1)
                assert np.isclose(theirs["read"][1], everything["read"][1], rtol=1e-6)
                peers["signalviewer-lite"] = size / theirs["cpu"]
            for peer, target in (("signalviewer-lite", "> 9"), ("pymavlink", "> 500")):
                what = f"{label}, all messages to columns, CPU"
                if peer in peers:
                    ratio = f"{rate['ours, all'] / peers[peer]:.0f}"
                    rows.append((what, _speed(rate["ours, all"]), f"{peer} {_speed(peers[peer])}", ratio, target))
                else:
                    rows.append(row(what, _speed(rate["ours, all"]), peer=f"{peer} not installed", goal=target))
            for what, target in (("scan", "-"), ("ours, all", "-"), ("ours, five", "800 MB/s")):
                share = f"{rate[what] / copy:.2f}"
                peer = f"copy {_speed(copy)}"
                rows.append(row(f"{label}, {what}, of a memory copy", _speed(rate[what]), peer, share, target))
            if label == "1 GB":
                for what, target in (("ours, all", "< 1.3"), ("ours, five", "< 0.3")):
                    share = f"{found[what]['peak'] / size:.2f}"
                    rows.append(row(f"{label}, {what}, peak memory over file", share, goal=target))
    return rows


def _speed(bytes_per_second: float) -> str:
    return f"{bytes_per_second / 1e6:.3g} MB/s"


if __name__ == "__main__":
    what, path, small, passes = sys.argv[1:]
    sys.stdout.write(json.dumps(read_timed(MEASURES[what], path, small, int(passes))))
