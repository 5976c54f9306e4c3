"""What every change is measured by: a few ratios in seconds, of CPU times taken in turn in one process.

Against peers that tests need anyway where they do the same work, else against a yardstick of the same kind of work
(SciPy's filter and eigenvalues, many small calls); a ratio says more than a time on a machine that others use too.
"""

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pymavlink import DFReader
from scipy.signal import lfilter

from benchmarks._measure import SAMPLES, Row, cpu, row
from benchmarks.estimation import filterpy_seconds, forward_and_back, problem_of
from benchmarks.logparse import grown, pymavlink, read_tlog
from benchmarks.sysid import rao_garnier_record
from estimation.filter import run as filter_forward
from logparse import read_log
from pipeline import AnalysisConfig, analyze
from pipeline.flight.account import account_of_flight
from pipeline.results.span import Span
from sysid import fit_transfer_functions
from tests.estimation.simulated_flight import fly

LOG, TELEMETRY = str(SAMPLES / "octa01_zurich_calm.bin"), str(SAMPLES / "octa02_alain_breeze.tlog")
LARGE = str(SAMPLES / "quad02_delft_systemid.bin")


#: Power-ups in the file of which the one with the longest flight is looked for, and bytes of a long flight's log.
POWER_UPS, LONG = 15, 65_000_000


def run() -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        several, long, text = (Path(folder) / name for name in ("several.bin", "long.bin", "text.log"))
        several.write_bytes(Path(LOG).read_bytes() * POWER_UPS)
        grown(Path(LARGE), long, LONG)
        write_text(LOG, text)
        return _rows(str(several), str(long), str(text))


def _rows(several: str, long: str, text: str) -> list[Row]:
    tables = fly(0, duration=15.0).tables
    problem = problem_of(tables, 50.0)()
    forward = filter_forward(problem)
    record = rao_garnier_record(0)
    return [
        _ratio("all messages of a .bin, pymavlink", every_message, lambda: pymavlink(LOG), 1),
        _ratio("all messages of a .bin one by one, all at once", one_by_one, lambda: every_message(LARGE), 3),
        _ratio("tables and flights of a .bin, yardstick", lambda: read_log(LARGE).flights, yardstick, 3),
        _ratio(f"{POWER_UPS} power-ups of a .bin, pymavlink one", lambda: read_log(several), lambda: pymavlink(LOG), 1),
        _ratio(
            "tables and flights of a text .log, pymavlink", lambda: read_log(text).flights, lambda: peer_text(text), 1
        ),
        _ratio(
            "what happened in a .bin of 65 MB, pymavlink of 7", lambda: account(long), lambda: pymavlink(LARGE), 1, 1
        ),
        _ratio("whole analysis of a .bin, pymavlink", analysed, lambda: pymavlink(LOG), 1, repeated=1),
        _ratio("all messages of a .tlog, pymavlink", lambda: read_tlog(TELEMETRY), lambda: pymavlink(TELEMETRY), 1),
        _ratio(
            "filter and smoother at 50 Hz, filterpy",
            forward_and_back(problem_of(tables, 50.0)),
            lambda: filterpy_seconds(problem, forward),
            1,
        ),
        _ratio("Rao-Garnier fit, yardstick", lambda: fit_transfer_functions([record], 4, 1, seed=0), yardstick, 3),
    ]


def _ratio(what: str, ours: Callable[[], object], theirs: Callable[[], object], passes: int, repeated: int = 3) -> Row:
    """Time the two in turn, after one of ours that loads compiled code; least times of each."""
    ours()
    pairs = [(cpu(ours, repeated), cpu(theirs)) for _ in range(passes)]
    mine, other = (min(times) for times in zip(*pairs, strict=True))
    return row(what, f"{1e3 * mine:.1f} ms", peer=f"{1e3 * other:.1f} ms", ratio=f"{other / mine:.3g}")


def every_message(path: str = LOG) -> None:
    """Decode every message in one pass."""
    messages = read_log(path).messages
    messages.load(messages)


def write_text(source: str, target: Path) -> None:
    """Write a log as text, as ground stations do."""
    reader = DFReader.DFReader_binary(source)
    with target.open("w") as file:
        for kind in sorted(reader.formats.values(), key=lambda kind: kind.name != "FMT"):
            file.write(f"FMT, {kind.type}, {kind.len}, {kind.name}, {kind.format}, {','.join(kind.columns)}\n")
        while (message := reader.recv_msg()) is not None:
            if (name := message.get_type()) != "FMT":
                cells = (getattr(message, field) for field in message.get_fieldnames())
                written = (f"{cell:.7f}" if isinstance(cell, float) else str(cell) for cell in cells)
                file.write(f"{name}, {', '.join(written)}\n")
    reader.close()


def peer_text(path: str) -> None:
    """Read every field of every message of a text log."""
    reader = DFReader.DFReader_text(path)
    while (message := reader.recv_msg()) is not None:
        message.to_dict()
    reader.close()


def account(path: str) -> None:
    """Read a log and find out what happened in it."""
    log = read_log(path)
    assert log.flight is not None
    account_of_flight(log, Span(log.flight.start, log.flight.stop))


def analysed() -> None:
    """Analyse a flight: what happened, trajectory, models and their validation, without pages."""
    analyze(Path(LOG), AnalysisConfig())


def one_by_one() -> None:
    """Decode message after message."""
    messages = read_log(LARGE).messages
    for name in messages:
        messages[name]


def yardstick() -> None:
    """Do what identification does, by SciPy and NumPy alone: filters, eigenvalues, and many small products."""
    rng = np.random.default_rng(0)
    noise, small = rng.standard_normal(200_000), rng.standard_normal((12, 12))
    for _ in range(4):
        noise = lfilter([0.1, 0.1], [1.0, -0.8, 0.1], noise)
    for _ in range(300):
        np.linalg.eigvals(small)
        np.linalg.solve(small, small @ small)
