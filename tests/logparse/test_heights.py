"""Height and speed of a flight: the first numbers that a pilot sees, and can check in a viewer."""

import numpy as np
import pandas as pd
import pytest

from logparse.flights import Flight
from logparse.heights import climb_and_sink, ground_speed, height_above_ground, height_readings, slope_down, speed_down
from logparse.tables import Tables

T = np.arange(0.0, 60.0, 0.1)
FLIGHT = Flight(10.0, 50.0)
HEIGHT = np.interp(T, (0.0, 10.0, 20.0, 40.0, 50.0, 60.0), (5.0, 5.0, 25.0, 25.0, 5.0, 5.0))


def table(t, **columns):
    return pd.DataFrame(columns, index=pd.Index(np.asarray(t, dtype=float), name="t"))


def baro(height=HEIGHT):
    return table(T, alt=height)


def ekf(height=HEIGHT, sink=0.0):
    return table(T, p_d=-height, v_d=sink + 0.0 * T)


def gps(v_n, **columns):
    values = {"alt": HEIGHT, "v_n": v_n, "v_e": 0.0 * T, "fix": 3.0, "hdop": 1.0, "satellites": 10.0} | columns
    return table(T, **values)


def test_height_is_counted_from_the_ground_that_the_flight_left():
    readings = height_readings(Tables(baro=baro(), ekf=ekf(HEIGHT + 100.0), gps=gps(0.0 * T)), FLIGHT)
    assert readings.source == "baro"
    assert readings.value == pytest.approx(20.0)
    assert readings.by_source == pytest.approx({"baro": 20.0, "autopilot": 20.0, "gps": 20.0})


def test_a_spike_of_the_barometer_is_no_height():
    spiked = np.where(np.abs(T - 30.0) < 0.05, 80.0, HEIGHT)
    assert height_readings(Tables(baro=baro(spiked)), FLIGHT).value == pytest.approx(20.0)


def test_the_barometer_is_believed_before_an_estimate_that_runs_away():
    """Vibration dragged the inertial height 20 m down while the barometer rose by 22 (31-3-2015_83)."""
    readings = height_readings(Tables(baro=baro(), ekf=ekf(-HEIGHT)), FLIGHT)
    assert (readings.value, readings.by_source["autopilot"]) == pytest.approx((20.0, 0.0), abs=0.1)
    assert speed_down(Tables(baro=baro(), ekf=ekf(-HEIGHT, 1.0))) is None
    assert speed_down(Tables(baro=baro(), ekf=ekf(HEIGHT, 1.0))).iloc[0] == 1.0


def test_without_a_barometer_or_with_one_that_has_stopped_the_next_source_counts():
    assert height_readings(Tables(baro=baro(0.0 * T), ekf=ekf()), FLIGHT).source == "autopilot"
    assert height_readings(Tables(gps=gps(0.0 * T)), FLIGHT).source == "gps"
    assert height_readings(Tables(gps=gps(0.0 * T, fix=1.0)), FLIGHT) is None
    assert height_above_ground(Tables()) is None


def test_a_log_that_begins_in_the_air_counts_from_where_it_landed():
    late = Tables(baro=baro().loc[30.0:])
    assert height_readings(late, Flight(30.0, 50.0)).value == pytest.approx(20.0, abs=0.3)


def test_ground_speed_is_the_median_of_three_good_fixes_in_flight():
    speed = np.where((T > 20.0) & (T < 30.0), 8.0 * np.sin(np.pi * (T - 20.0) / 10.0), 0.0)
    assert ground_speed(Tables(gps=gps(speed)), FLIGHT) == pytest.approx(8.0, abs=0.01)
    assert ground_speed(Tables(gps=gps(speed)), Flight(35.0, 50.0)) == 0.0


@pytest.mark.parametrize("bad", [{"fix": 2.0}, {"hdop": 5.0}, {"satellites": 4.0}])
def test_fixes_that_are_no_good_give_no_speed(bad):
    assert ground_speed(Tables(gps=gps(5.0 + 0.0 * T, **bad)), FLIGHT) is None


def test_jumps_of_a_receiver_are_no_speed():
    """A receiver with nine satellites jumped to 72 m/s beside a craft that hovered (26-11-2014_181)."""
    jumping = np.where((T > 30.0) & (T < 30.8), 40.0, 3.0)
    assert ground_speed(Tables(gps=gps(jumping)), FLIGHT) == pytest.approx(3.0)


def test_climb_and_sink_have_their_own_numbers():
    height = np.interp(T, (0.0, 10.0, 15.0, 40.0, 50.0, 60.0), (0.0, 0.0, 20.0, 20.0, 0.0, 0.0))
    assert climb_and_sink(Tables(baro=baro(height)), FLIGHT) == pytest.approx((4.0, 2.0), abs=0.05)
    assert climb_and_sink(Tables(), FLIGHT) is None
    assert np.isnan(slope_down(pd.Series([1.0], index=[0.0])).iloc[0])
