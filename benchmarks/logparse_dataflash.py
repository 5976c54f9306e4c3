"""DataFlash binary to columns: speed and memory against pymavlink, signalviewer-lite and a plain memory copy.

The inputs are a real log's body repeated to 100 MB and 1 GB with the clock running on. Each measurement is a process of
its own that first reads a small log (compiled code, imports) and then takes the least CPU time of a few passes; peak
memory is what the first pass adds to the process. All readers must give the same messages, which is checked.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from pymavlink import DFReader

ROOT = Path(__file__).parents[1]
FIVE = ("IMU", "GPS", "BARO", "RCOU", "ATT")

Row = tuple[str, str, str, str, str]


def base_log() -> Path:
    """Find a log to repeat: a full-rate log of the shared ones, else the largest sample log."""
    shared = ROOT.parent / "shared" / "logs" / "sitl" / "octa09_systemid_mixer.BIN"
    if shared.exists():
        return shared
    return max((ROOT / "sample_logs").glob("*.bin"), key=lambda path: path.stat().st_size)


def repeat(source: Path, target: Path, size: int) -> None:
    """Repeat the messages of a log to `size` bytes, each time later by the length of the log."""
    reader = DFReader.DFReader_binary(str(source))
    data = np.fromfile(source, np.uint8)
    places = []
    end = 0
    for message_id, offsets in enumerate(reader.offsets):
        form = reader.formats.get(message_id)
        if form is None or not len(offsets):
            continue
        whole = np.array([o for o in offsets if o + form.len <= len(data)], np.int64)
        end = max(end, int(whole[-1]) + form.len)
        if form.columns[:1] == ["TimeUS"]:
            places.append(whole)
    reader.close()
    clocks = np.concatenate(places)[:, None] + np.arange(3, 11)
    first = data[clocks].view("<u8")[:, 0]
    span = int(first.max() - first.min()) + 100_000
    with target.open("wb") as file:
        k = 0
        while file.tell() < size:
            data[clocks] = (first + np.uint64(k * span)).astype("<u8")[:, None].view(np.uint8)
            file.write(data[:end].data)
            k += 1


def ours(path: str, names: tuple[str, ...] | None) -> tuple[int, float]:
    """Read a log and decode some or all message types; gives messages read and a sum over one column."""
    from logparse import read_log

    log = read_log(path)
    log.messages.load(log.messages if names is None else names)
    read = sum(len(log.messages[name]) for name in (log.messages if names is None else names))
    return read, float(log.messages["ATT"]["Roll"].to_numpy().sum(dtype=np.float64))


def scan(path: str) -> tuple[int, float]:
    """Follow the header chain only."""
    from logparse import read_log

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


def measure(what: str, path: str, small: str, passes: int) -> dict[str, float]:
    """Run in a process of its own: least CPU time, peak memory over that before, and what was read."""
    read = MEASURES[what]
    read(small)
    before = memory("VmRSS")
    best, peak, result = np.inf, 0.0, (0, 0.0)
    for k in range(passes):
        begun = time.process_time()
        result = read(path)
        best = min(best, time.process_time() - begun)
        if k == 0:
            peak = memory("VmHWM") - before
    return {"cpu": best, "peak": peak, "messages": result[0], "sum": result[1]}


def memory(kind: str) -> float:
    """Bytes of this process in memory: now (VmRSS) or at most so far (VmHWM); nan where Linux does not tell."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return float("nan")
    return 1024.0 * int(status.split(kind + ":")[1].split()[0])


def measured(what: str, path: Path, small: Path, passes: int) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.logparse_dataflash", what, str(path), str(small), str(passes)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def copy_speed() -> float:
    """Bytes a second of a memory copy into memory already in use."""
    source, target = np.ones(1 << 28, np.uint8), np.ones(1 << 28, np.uint8)
    times = []
    for _ in range(5):
        begun = time.process_time()
        np.copyto(target, source)
        times.append(time.process_time() - begun)
    return len(source) / min(times)


def run() -> list[Row]:
    rows: list[Row] = []
    small = base_log()
    copy = copy_speed()
    with tempfile.TemporaryDirectory() as folder:
        peers: dict[str, float] = {}
        for label, size in (("100 MB", 100_000_000), ("1 GB", 1_000_000_000)):
            path = Path(folder) / "log.bin"
            repeat(small, path, size)
            size = path.stat().st_size
            found = {what: measured(what, path, small, 3) for what in ("scan", "ours, all", "ours, five")}
            everything = found["ours, all"]
            rate = {what: size / result["cpu"] for what, result in found.items()}
            if label == "100 MB":
                # At 2 MB/s once is enough, and a larger file would tell nothing else.
                theirs = measured("pymavlink", path, small, 1)
                assert theirs["messages"] == everything["messages"]
                assert np.isclose(theirs["sum"], everything["sum"], rtol=1e-6)
                peers["pymavlink"] = size / theirs["cpu"]
            if find_spec("signalviewer") is not None:
                theirs = measured("signalviewer", path, small, 1)
                assert np.isclose(theirs["sum"], everything["sum"], rtol=1e-6)
                peers["signalviewer-lite"] = size / theirs["cpu"]
            for peer, target in (("signalviewer-lite", "> 9"), ("pymavlink", "> 500")):
                what = f"{label}, all messages to columns, CPU"
                if peer in peers:
                    ratio = f"{rate['ours, all'] / peers[peer]:.0f}"
                    rows.append((what, _speed(rate["ours, all"]), f"{peer} {_speed(peers[peer])}", ratio, target))
                else:
                    rows.append((what, _speed(rate["ours, all"]), f"{peer} not installed", "-", target))
            for what, target in (("scan", "-"), ("ours, all", "-"), ("ours, five", "800 MB/s")):
                rows.append(
                    (
                        f"{label}, {what}, of a memory copy",
                        _speed(rate[what]),
                        f"copy {_speed(copy)}",
                        f"{rate[what] / copy:.2f}",
                        target,
                    )
                )
            if label == "1 GB":
                for what, target in (("ours, all", "< 1.3"), ("ours, five", "< 0.3")):
                    share = f"{found[what]['peak'] / size:.2f}"
                    rows.append((f"{label}, {what}, peak memory over file", share, "-", "-", target))
    return rows


def _speed(bytes_per_second: float) -> str:
    return f"{bytes_per_second / 1e6:.3g} MB/s"


if __name__ == "__main__":
    sys.stdout.write(json.dumps(measure(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]))))
