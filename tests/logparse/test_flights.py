"""Airborne intervals: the whole fit rests on them, and bench runs must not pass for flights."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

from logparse.flights import Flight, find_flights
from logparse.tables import Tables

#: ArduCopter 4: idle at 1150 us, as SITL flies.
PARAMETERS = {"MOT_PWM_MIN": 1000, "MOT_PWM_MAX": 2000, "MOT_SPIN_ARM": 0.1, "MOT_SPIN_MIN": 0.15}


def profile(t, *points):
    """Piecewise linear course through (time, value) points."""
    times, values = zip(*points, strict=True)
    return np.interp(t, times, values)


def table(t, **columns):
    return pd.DataFrame(columns, index=pd.Index(np.asarray(t, dtype=float), name="t"))


def tables(t, pwm, height, parameters=PARAMETERS, **more):
    rng = np.random.default_rng(2)
    motors = {f"m{k}": pwm + np.where(pwm > 1200, rng.normal(0.0, 20.0, len(t)), 0.0) for k in range(1, 5)}
    zeros = np.zeros(len(t))
    ekf = table(t, p_n=zeros, p_e=zeros, p_d=-height)
    return Tables(motors=table(t, **motors), ekf=ekf, parameters=parameters, **more)


T = np.arange(0.0, 100.0, 0.1)
#: Armed at 10, motors up at 12, off the ground at 14, on it again at 80, motors down at 82.
PWM = profile(T, (0, 1000), (10, 1000), (10.1, 1150), (12, 1150), (13, 1500), (82, 1500), (82.5, 1150), (85, 1000))
HEIGHT = profile(T, (0, 0), (14, 0), (18, 10), (70, 10), (80, 0), (100, 0))


def test_a_flight_is_from_lift_off_to_touch_down():
    (flight,) = find_flights(tables(T, PWM, HEIGHT))
    assert (flight.start, flight.stop) == pytest.approx((14.0, 80.0), abs=0.4)
    assert flight.duration == flight.stop - flight.start


def test_landing_elsewhere_is_measured_from_the_ground_there():
    height = profile(T, (0, 0), (14, 0), (18, 10), (70, 10), (80, -30), (100, -30))
    (flight,) = find_flights(tables(T, PWM, height))
    assert flight.stop == pytest.approx(80.0, abs=0.4)


def test_two_flights_in_one_log():
    t = np.arange(0.0, 200.0, 0.1)
    twice = tables(t, np.concatenate((PWM, PWM)), np.concatenate((HEIGHT, HEIGHT)))
    first, second = find_flights(twice)
    assert (first.start, second.start) == pytest.approx((14.0, 114.0), abs=0.4)


def test_a_log_that_begins_and_ends_in_the_air():
    (flight,) = find_flights(tables(T, np.full(len(T), 1500.0), 10.0 + np.sin(T)))
    assert (flight.start, flight.stop) == pytest.approx((T[0], T[-1]))


def test_heights_beside_the_outputs_of_a_log_cut_in_the_air_are_no_ground():
    """Faster heights go on for a moment after the last output, and begin before the first: at 10 m, not at 0."""
    fast = np.arange(19.9, 60.1, 0.02)
    slow = np.arange(20.0, 60.0, 0.1)
    flown = tables(slow, np.full(len(slow), 1500.0), np.zeros(len(slow)))
    height = 10.0 + np.where((fast > 25.0) & (fast < 40.0), 2.0, 0.0)
    flown = dataclasses.replace(flown, ekf=table(fast, p_n=0.0 * fast, p_e=0.0 * fast, p_d=-height))
    (flight,) = find_flights(flown)
    assert (flight.start, flight.stop) == pytest.approx((slow[0], slow[-1]))


def test_a_log_that_ends_with_disarming():
    ended = T <= 82.0
    events = pd.DataFrame({"event": ["DISARMED"], "detail": [""]}, index=pd.Index([82.0], name="t"))
    (flight,) = find_flights(tables(T[ended], PWM[ended], HEIGHT[ended], events=events))
    assert flight.stop == pytest.approx(80.0, abs=0.4)


def test_dropping_with_closed_throttle_is_still_flying():
    pwm = np.where((T > 40) & (T < 43), 1150.0, PWM)
    (flight,) = find_flights(tables(T, pwm, HEIGHT))
    assert flight.duration > 60.0


def test_a_gap_in_the_log_ends_a_flight():
    kept = (T < 40) | (T > 55)
    first, second = find_flights(tables(T[kept], PWM[kept], HEIGHT[kept]))
    assert first.stop < 40.1
    assert second.start > 54.9


@pytest.mark.parametrize("pwm", [1000.0, 1150.0])
def test_motors_that_idle_on_the_bench_are_no_flight(pwm):
    assert find_flights(tables(T, np.full(len(T), pwm), np.zeros(len(T)))) == ()


def test_full_throttle_on_a_stand_is_no_flight():
    # The propellers feign a metre of height (Javiercerna's log does), and GPS wanders while it searches.
    noise = np.random.default_rng(3).normal(0.0, 0.05, len(T))
    wander = table(
        T[::2], fix=3.0, lat=0.8 + 1e-6 * np.sin(T[::2] / 30.0), lon=0.1, alt=0.0, v_n=0.3, v_e=0.4, hdop=2.0
    )
    still = table(T, **{name: np.zeros(len(T)) for name in ("gyro_x", "gyro_y", "gyro_z")})
    bench = tables(T, PWM, 1.0 * (PWM > 1300) + noise, gps=wander, imu=still)
    assert find_flights(bench) == ()


def test_a_low_hover_indoors_is_a_flight():
    rng = np.random.default_rng(4)
    shaken = table(T, **{name: rng.normal(0.0, 0.1, len(T)) for name in ("gyro_x", "gyro_y", "gyro_z")})
    (flight,) = find_flights(tables(T, PWM, 0.1 * HEIGHT, imu=shaken))
    assert (flight.start, flight.stop) == pytest.approx((14.0, 80.0), abs=4.0)


def test_idle_is_what_the_parameters_of_the_time_say():
    # Firmware 3.2 with THR_MIN 190 over 1100..1900 us idles at 1252 us; a flight is above that.
    old = {"RC3_MIN": 1100, "RC3_MAX": 1900, "THR_MIN": 190, "MOT_SPIN_ARMED": 100}
    rising = profile(T, (0, 0), (99, 5))
    assert find_flights(tables(T, np.full(len(T), 1252.0), rising, old)) == ()
    assert len(find_flights(tables(T, np.full(len(T), 1300.0), rising, old))) == 1


def test_an_estimate_that_runs_away_gives_way_to_the_barometer():
    lost = tables(T, PWM, HEIGHT + 3.0 * (T - 14).clip(0))
    lost = Tables(motors=lost.motors, ekf=lost.ekf, baro=table(T, alt=HEIGHT), parameters=PARAMETERS)
    (flight,) = find_flights(lost)
    assert (flight.start, flight.stop) == pytest.approx((14.0, 80.0), abs=0.4)


def test_a_filter_that_starts_in_flight_does_not_shorten_it():
    late = tables(T, PWM, HEIGHT)
    late = Tables(motors=late.motors, ekf=late.ekf.loc[40.0:], baro=table(T, alt=HEIGHT), parameters=PARAMETERS)
    (flight,) = find_flights(late)
    assert flight.start == pytest.approx(14.0, abs=0.4)


def test_nothing_to_go_by_is_no_flight():
    assert find_flights(Tables()) == ()
    assert find_flights(Tables(motors=table([], m1=[]))) == ()
    assert find_flights(Tables(motors=table([1.0, 2.0], m1=[np.nan, np.nan]))) == ()


def test_flights_are_values():
    assert Flight(1.0, 3.0) == Flight(1.0, 3.0)
    assert Flight(1.0, 3.0).duration == 2.0


@pytest.mark.parametrize(("follows", "flown"), [(1.0, 1), (0.1, 0), (0.0, 1)])
def test_motors_driven_hard_on_a_stand_are_no_flight(follows, flown):
    """A barometer that drifts by metres made nine minutes of flight of a craft on a bench; its force stood still.

    A force that never changes at all is that of a sensor that has stopped: then the height counts as before.
    """
    rng = np.random.default_rng(7)
    pwm = PWM + np.where(PWM > 1200, 150.0 * np.sign(np.sin(2.0 * np.pi * T / 3.0)), 0.0)
    height = profile(T, (0, 0), (14, 0), (70, 3), (80, 0), (100, 0))
    force = 9.8 + (follows > 0.0) * (0.02 * rng.normal(size=len(T)) + follows * 9.8 * (pwm - PWM) / 400.0)
    imu = table(T, accel_x=0.0 * T, accel_y=0.0 * T, accel_z=-force, gyro_x=0.0 * T, gyro_y=0.0 * T, gyro_z=0.0 * T)
    assert len(find_flights(tables(T, pwm, height, imu=imu))) == flown


@pytest.mark.parametrize("step", [61.0, 4000.0, 1e7])
def test_rows_that_lie_minutes_or_years_apart_are_no_flight(step):
    """Such a clock is wrong; as a flight of years it would be looked at second by second."""
    t = 10.0 * step * T  # T is in tenths of a second
    stretched = tables(t, PWM, HEIGHT)
    assert find_flights(stretched) == ()
