"""What happened and the plots of signals on a page: peaks kept, markup escaped, nothing drawn that was not logged."""

import dataclasses

import numpy as np
import pytest

from core.findings import Severity
from logparse import read_log
from pipeline.flight.account.readings import Readings
from pipeline.flight.signals import flight_signals, thin
from pipeline.results.failure import Failure
from pipeline.results.span import Span
from reports.figures.figure import line
from reports.figures.signals import signal_figures
from reports.views.flight import happened, reported
from tests.reports.accounts import account, happening, signals
from tests.reports.builders import page_of


def test_messages_whose_times_damage_has_put_out_of_order_are_drawn_in_order():
    log = read_log("sample_logs/octa01_zurich_calm.bin")
    rows = log.messages["VIBE"]
    times = rows.index.to_numpy().copy()
    times[[50, 51]] = times[[51, 50]]
    log.messages.replace("VIBE", rows.set_axis(times))
    (panel,) = flight_signals(Readings.of(log, Span(log.flight.start + 0.03, log.flight.stop - 0.03))).vibration
    assert all((np.diff(signal.t) > 0.0).all() for signal in panel.signals)


def test_a_heading_about_south_does_not_jump():
    log = read_log("sample_logs/octa01_zurich_calm.bin")
    rows = log.messages["ATT"]
    t = np.arange(len(rows)) * 0.1
    flown, asked = 180.0 + 5.0 * np.sin(t), 180.0 + 5.0 * np.sin(t + 0.1)
    log.messages.replace("ATT", rows.assign(Yaw=flown % 360.0, DesYaw=asked % 360.0))
    panel = flight_signals(Readings.of(log, Span(log.flight.start, log.flight.stop))).attitude[2]
    assert panel.title == "yaw"
    by_name = {signal.name: signal.y for signal in panel.signals}
    for values in by_name.values():
        assert np.ptp(values) == pytest.approx(np.radians(10.0), abs=0.02)
    assert np.abs(by_name["asked"] - by_name["flown"]).max() < np.radians(0.6)


def test_turns_before_take_off_do_not_count():
    """A real craft was carried about twice: its heading was drawn from -200 to -500 deg."""
    log = read_log("sample_logs/octa01_zurich_calm.bin")
    start = read_log("sample_logs/octa01_zurich_calm.bin").flight.start  # what a log has shown is not read again
    rows = log.messages["ATT"]
    t = rows.index.to_numpy()
    carried = np.interp(t, [t[0], start], [0.0, 790.0])
    log.messages.replace("ATT", rows.assign(Yaw=carried % 360.0, DesYaw=carried % 360.0))
    panel = flight_signals(Readings.of(log, Span(log.flight.start, log.flight.stop))).attitude[2]
    for signal in panel.signals:
        assert np.degrees(np.median(signal.y)) == pytest.approx(70.0, abs=1.0)


def test_thinning_keeps_every_peak():
    rng = np.random.default_rng(0)
    t = np.arange(100_000) * 0.0025
    y = rng.normal(0.0, 1.0, len(t))
    y[77_777], y[12_345], y[50] = 50.0, -60.0, np.nan
    thin_t, thin_y = thin(t, y, 1000)
    assert len(thin_t) <= 1000
    assert np.all(np.diff(thin_t) > 0.0)
    assert (np.nanmax(thin_y), np.nanmin(thin_y)) == (50.0, -60.0)
    assert thin_t[np.nanargmax(thin_y)] == t[77_777]
    same_t, same_y = thin(t[:100], y[:100], 1000)
    np.testing.assert_array_equal((same_t, same_y), (t[:100], y[:100]))


@pytest.fixture
def shaken(flight):
    quiet = happening("failsafe", 80.0, Severity.INFO)
    flight_account = account(happening("crash", 60.0, reason="Hit <b>hard</b>."), happening("vibration", 55.0), quiet)
    return dataclasses.replace(flight, account=flight_account, signals=signals())


def test_plots_are_drawn_of_what_was_logged_in_degrees(flight, shaken):
    figures = {figure.id: figure for figure in signal_figures(shaken)}
    assert set(figures) == {f"health-{name}" for name in ("attitude", "rates", "vibration", "battery", "gps")}
    attitude = figures["health-attitude"]
    assert max(v for v in attitude.data[0]["y"] if v is not None) == pytest.approx(np.degrees(0.1), abs=0.01)
    assert "°" in attitude.layout["yaxis"]["title"]["text"]
    assert {shape["x0"] for shape in attitude.layout["shapes"]} == {55.0, 60.0}, "quiet happenings are not marked"
    assert signal_figures(dataclasses.replace(flight, signals=Failure("signals", "none"))) == []


def test_the_page_shows_what_happened_escaped(shaken):
    page = page_of(shaken)
    assert "Hit &lt;b&gt;hard&lt;/b&gt;." in page
    assert "Hit <b>" not in page
    table, quiet = happened(shaken.account), reported(shaken.account)
    assert [(str(row.label), *map(str, (row.cells[0], row.cells[2]))) for row in table.rows] == [
        ("20 s", "60.0", "crash"),
        ("15 s", "55.0", "vibration"),
    ]
    assert [str(row.cells[2]) for row in quiet.rows] == ["failsafe"]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("samples", [0, 1])
def test_a_signal_of_one_sample_is_drawn(samples):
    trace = line(np.arange(samples) + 5.0, np.ones(samples), "x", "#000000")
    assert trace["x"] == [5.0][:samples]
