"""Findings of a log, tables for people, results kept for their objects, splines as those of scipy."""

import numpy as np
import pandas as pd
import pytest
from rich.console import Console
from scipy.interpolate import CubicSpline

from core.cubic_spline import cubic_spline
from core.findings import Finding, Severity, apart, gathered
from core.table import Cell, Row, Table


def finding(reason: str, advice: str = "", severity: Severity = Severity.WARNING, **evidence: float | str) -> Finding:
    return Finding("log-gaps", severity, reason, advice, evidence)


def test_findings_that_differ_in_numbers_are_said_once_with_their_count():
    parts = finding("GPS is silent for 1.5 s.", gap=1.5), finding("GPS is silent for 12 s.", gap=12.0)
    (shown,) = gathered(parts)
    assert shown.reason == "GPS is silent for 1.5 s; 1 more such."
    assert shown.parts == parts


def test_all_sentences_of_a_kind_are_said_the_gravest_first_and_advice_once():
    note = finding("The IMU is silent for 2 s.", "Use a faster card.", Severity.INFO)
    (shown,) = gathered([note, finding("GPS is silent for 2 s", "use a faster card.")])
    assert shown.reason == "GPS is silent for 2 s. The IMU is silent for 2 s."
    assert (shown.severity, shown.advice) == (Severity.WARNING, "Use a faster card.")


def test_what_two_stages_say_of_the_same_thing_is_said_once():
    both = finding("No compass.", what="mag"), finding("No magnetometer: heading drifts.", what="mag")
    (shown,) = gathered(both)
    assert shown.reason == "No compass."
    assert tuple(apart(gathered([shown, finding("No GPS.", what="gps")])))[:2] == both


TABLE = Table("model", ["error (m)", "use"], [Row("a|b", ["0.120", Cell("[yes]", "good")])], texts=[1])


def shown(table: Table, width: int = 60) -> str:
    console = Console(width=width, highlight=False, color_system=None)
    with console.capture() as capture:
        console.print(table.terminal())
    return capture.get()


def test_text_is_text_everywhere():
    assert TABLE.markdown().splitlines()[1:] == ["| --- | ---: | --- |", r"| a\|b | 0.120 | \[yes\] |"]
    assert "<td style='text-align:left'>[yes]</td>" in TABLE.html()
    assert "[yes]" in shown(TABLE)


def test_a_narrow_terminal_folds_text_and_no_number():
    long = Table("name", ["rate (Hz)", "columns"], [Row("imu", ["25.125", "gyro_x gyro_y gyro_z accel_x"])], texts=[1])
    assert "25.125" in shown(long, 32)
    assert "accel_x" in " ".join(shown(long, 32).split())


def test_a_frame_shows_numbers_with_five_digits_and_texts_as_they_are():
    table = Table.from_frame(pd.DataFrame({"case": ["<1>"], "pwm": [1523.456789], "word": ["yes"]}), "What flew.")
    assert table.rows[0] == Row("<1>", ["1523.5", "yes"])
    assert list(table.texts) == [1]
    assert "&lt;1&gt;" in table.html()


@pytest.mark.parametrize("samples", [2, 3, 4, 5, 400])
def test_it_is_the_spline_of_scipy_within_and_beyond_the_samples(samples: int) -> None:
    rng = np.random.default_rng(samples)
    t = np.cumsum(rng.uniform(0.005, 0.03, samples)) + 100.0
    values = rng.standard_normal((samples, 3))
    at = np.sort(np.concatenate([t, rng.uniform(t[0] - 0.02, t[-1] + 0.02, 300)]))
    expected = CubicSpline(t, values)(at)
    assert cubic_spline(t, values, at) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
