"""The timeline and the health plots of a page: peaks kept, markup escaped, nothing drawn that was not logged."""

import dataclasses

import numpy as np
import pytest
from reports.views.health import sentence, timeline

from logparse import FlightEvent, Severity, read_log
from pipeline.flight.signals import flight_signals, thin
from pipeline.results.report import HealthReport
from pipeline.results.signals import FlightHealth, FlightSignals, Panel, Signal, Spectrum
from pipeline.results.span import Span
from reports.figures.signals import signal_figures
from reports.numbers.flight import flight_report
from reports.pages.html import flight_page


def event(identity, t, severity=Severity.WARNING, reason="It happened.", **more):
    return FlightEvent(id=identity, t=t, end=t + 1.0, severity=severity, reason=reason, **more)


@pytest.fixture
def health():
    t = np.arange(40.0, 100.0, 0.1)
    asked, flown = Signal("asked", t, 0.1 * np.sin(t)), Signal("flown", t, 0.1 * np.sin(t - 0.1))
    hz = np.arange(5.0, 100.0)
    return FlightHealth(
        events=(
            event("mode-change", 40.0, Severity.INFO, "Flight mode LOITER."),
            event("crash", 60.0, Severity.ERROR, "Hit <b>hard</b>."),
            event("motor-at-limit", 55.0),
        ),
        sound=Span(40.0, 59.7),
        signals=FlightSignals(
            attitude=(Panel(title="roll", unit="rad", signals=(asked, flown)),),
            vibration=(Panel(title="vibration", unit="m/s²", signals=(flown,), limits={"limit": 30.0}),),
            spectrum=Spectrum(source="gyro", unit="rad/s", hz=hz, amplitudes={"roll": 1.0 / hz}, filters={"F": 20.0}),
            motor_limits={"MOT_SPIN_MAX": 1950.0},
        ),
    )


def test_messages_whose_times_damage_has_put_out_of_order_are_drawn_in_order():
    log = read_log("sample_logs/octa01_zurich_calm.bin")
    rows = log.messages["VIBE"]
    times = rows.index.to_numpy().copy()
    times[[50, 51]] = times[[51, 50]]
    log.messages.replace("VIBE", rows.set_axis(times))
    (panel,) = flight_signals(log, Span(log.flight.start + 0.03, log.flight.stop - 0.03)).vibration
    assert all((np.diff(signal.t) > 0.0).all() for signal in panel.signals)


def test_a_heading_about_south_does_not_jump():
    log = read_log("sample_logs/octa01_zurich_calm.bin")
    rows = log.messages["ATT"]
    t = np.arange(len(rows)) * 0.1
    flown, asked = 180.0 + 5.0 * np.sin(t), 180.0 + 5.0 * np.sin(t + 0.1)
    log.messages.replace("ATT", rows.assign(Yaw=flown % 360.0, DesYaw=asked % 360.0))
    panel = flight_signals(log, log.flight).attitude[2]
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
    panel = flight_signals(log, log.flight).attitude[2]
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


def test_plots_are_drawn_of_what_was_logged_in_degrees(flight, health):
    figures = {figure.id: figure for figure in signal_figures(dataclasses.replace(flight, health=health))}
    assert set(figures) == {"health-attitude", "health-vibration", "health-spectrum"}
    attitude = figures["health-attitude"]
    assert max(v for v in attitude.data[0]["y"] if v is not None) == pytest.approx(np.degrees(0.1), abs=0.01)
    assert "°" in attitude.layout["yaxis"]["title"]["text"]
    # Notable events are marked, quiet ones are not.
    assert {shape["x0"] for shape in attitude.layout["shapes"]} == {55.0, 60.0}
    assert signal_figures(flight) == []


def test_the_page_shows_the_timeline_escaped(flight, health):
    with_health = dataclasses.replace(flight, health=health)
    numbers = flight_report(with_health)
    page = flight_page(with_health, numbers)
    assert "What happened" in page
    assert "Hit &lt;b&gt;hard&lt;/b&gt;." in page
    assert "Hit <b>" not in page
    view = timeline(numbers.health)
    assert [row.t for row in view.rows] == ["55.0", "60.0"]
    assert view.quiet_count == 1
    assert sentence(numbers.health).startswith("Happened in flight: crash at 60.0 s")


def test_a_million_events_do_not_fill_the_page(flight, health):
    many = dataclasses.replace(health, events=tuple(event("gps-glitch", 40.0 + 1e-4 * k) for k in range(20_000)))
    crowded = flight_report(dataclasses.replace(flight, health=many)).health
    (row,) = timeline(crowded).rows
    assert row.reason.startswith("20000 times until 42.0 s")
    kinds = tuple(event(f"kind-{k}", 40.0 + 1e-4 * k) for k in range(20_000))
    view = timeline(flight_report(dataclasses.replace(flight, health=dataclasses.replace(health, events=kinds))).health)
    assert len(view.rows) == 40
    assert view.more == 20_000 - 40
    assert len(sentence(crowded)) < 200


def test_a_log_without_a_flight_is_not_told_what_happened_in_flight():
    quiet = HealthReport(events=(), sound=None, motors_missing="")
    assert sentence(quiet) == "The log shows no flight; nothing notable happened."
    assert sentence(dataclasses.replace(quiet, sound=Span(1.0, 2.0))) == "Nothing notable happened in flight."
    noticed = dataclasses.replace(quiet, events=(event("battery-low", 60.0),))
    assert sentence(noticed) == "Happened without a flight: battery low at 60.0 s."
