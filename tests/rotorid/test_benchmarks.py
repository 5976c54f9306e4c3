"""What `make bench` and CI make of measured rows."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as runner
from benchmarks.flight_large import repeat
from logparse import read_log
from tests.paths import SAMPLES


@pytest.mark.parametrize(
    ("ours", "ratio", "goal", "verdict"),
    [
        ("34 ms", "130", "< 20 ms", "MISSED"),
        ("0.01 s", "130 x", "> 20", "yes"),
        ("10 of 10", "-", ">= 10 of 10", "yes"),
        ("not measured", "-", "< 3 s", ""),
    ],
)
def test_a_goal_is_of_the_ratio_or_of_ours(ours: str, ratio: str, goal: str, verdict: str) -> None:
    assert runner.met(("what", ours, "peer", ratio, goal)) == verdict


def test_a_ratio_that_fell_by_more_than_half_is_named() -> None:
    rows = [("fit", "1 s", "2 s", "0.8", "-"), ("read", "1 s", "2 s", "9", "-")]
    assert runner.fallen(rows, {"fit": 1.5, "read": 10.0}) == []
    assert runner.fallen(rows, {"fit": 1.7}) == ["fit: 0.80, stored 1.70"]
    assert runner.fallen(rows, {"gone": 1.0}) == ["gone: not measured, stored 1.00"]


def test_a_benchmark_that_fails_or_does_not_end_is_a_row() -> None:
    assert runner.measure("no_such_benchmark", [], 60.0)[0][0].startswith("failed: ")
    assert runner.measure("short", [], 0.01)[0][0] == "not run: out of time"


def test_a_repeated_stretch_goes_on_in_time(tmp_path: Path) -> None:
    """Boot clock and receiver's clock both, or the large log would be one of a broken autopilot."""
    source = SAMPLES / "octa01_zurich_calm.bin"
    once = read_log(source)
    assert once.flight is not None
    start = once.flight.start + 10.0
    path = repeat(source, tmp_path / "longer.bin", 2.5 * source.stat().st_size, start, start + 20.0)
    longer = read_log(path)
    assert path.stat().st_size > 2.5 * source.stat().st_size
    assert longer.start_utc == once.start_utc
    extra = longer.duration - once.duration
    assert extra > 20.0
    assert extra == pytest.approx(20.0 * round(extra / 20.0), abs=1e-3)
    assert np.diff(longer.messages["IMU"].index).max() < 1.5 * np.diff(once.messages["IMU"].index).max()
    assert longer.findings == once.findings
