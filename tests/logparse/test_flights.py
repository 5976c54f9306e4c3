"""Airborne intervals: the whole account rests on them, and bench runs must not pass for flights."""

import dataclasses

import numpy as np
import pytest

from logparse.craft.pwm_range import pwm_range
from logparse.flights import find_flights
from logparse.tables import Tables
from tests.logparse.builders import message as table

#: ArduCopter 4: idle at 1150 us, as SITL flies.
PARAMETERS = {"MOT_PWM_MIN": 1000, "MOT_PWM_MAX": 2000, "MOT_SPIN_ARM": 0.1, "MOT_SPIN_MIN": 0.15}
GRAVITY, HOVER = 9.8, 1500.0


def profile(t, *points):
    """Piecewise linear course through (time, value) points."""
    times, values = zip(*points, strict=True)
    return np.interp(t, times, values)


def still(t, force):
    zeros = np.zeros(len(t))
    return table(t, gyro_x=zeros, gyro_y=zeros, gyro_z=zeros, accel_x=zeros, accel_y=zeros, accel_z=-force + zeros)


def flown(t, pwm, height, parameters=PARAMETERS, air=None, **more):
    """Tables of a craft whose specific force is gravity on the ground and what its motors give in the air."""
    rng = np.random.default_rng(2)
    levels = pwm_range(parameters)
    pwm = pwm + np.where(pwm > 1200, rng.normal(0.0, 10.0, len(t)), 0.0)
    thrust = levels.thrust(np.asarray(pwm, dtype=float)) / levels.thrust(np.array(HOVER))
    air = height > 0.05 if air is None else air
    force = GRAVITY * np.where(air, thrust, 1.0) + 0.1 * rng.normal(size=len(t))
    motors = table(t, **{f"m{k}": pwm for k in range(1, 5)})
    zeros = np.zeros(len(t))
    log = Tables(motors=motors, imu=still(t, force), baro=table(t, alt=height, pressure=zeros), parameters=parameters)
    return dataclasses.replace(log, **more)


T = np.arange(0.0, 100.0, 0.1)
#: Armed at 10, motors up at 12, off the ground at 14, on it again at 80, motors down by 82.
PWM = profile(
    T, (0, 1000), (10, 1000), (10.1, 1150), (13, 1150), (14, 1500), (80, 1500), (80.5, 1200), (82, 1150), (82.1, 1000)
)
HEIGHT = profile(T, (0, 0), (14, 0), (18, 10), (70, 10), (80, 0), (100, 0))


def test_a_flight_is_from_lift_off_to_touch_down():
    (flight,) = find_flights(flown(T, PWM, HEIGHT))
    assert (flight.start, flight.stop) == pytest.approx((14.0, 80.0), abs=0.4)
    assert flight.duration == flight.stop - flight.start


def test_landing_elsewhere_is_measured_from_the_ground_there():
    height = profile(T, (0, 0), (14, 0), (18, 10), (70, 10), (80, -30), (100, -30))
    (flight,) = find_flights(flown(T, PWM, height, air=(T > 14) & (T < 80)))
    assert flight.stop == pytest.approx(80.0, abs=0.4)


def test_two_flights_in_one_log():
    t = np.arange(0.0, 200.0, 0.1)
    twice = flown(t, np.concatenate((PWM, PWM)), np.concatenate((HEIGHT, HEIGHT)))
    first, second = find_flights(twice)
    assert (first.start, second.start) == pytest.approx((14.0, 114.0), abs=0.4)


def test_a_landing_between_ends_a_flight_though_the_motors_go_on():
    """Pilots touch down for two seconds at low throttle and go on; a bump of half a second is part of the flight."""
    pwm = np.where((T > 40) & (T < 43), 1250.0, PWM)
    height = profile(T, (0, 0), (14, 0), (18, 10), (30, 10), (40, 0), (43, 0), (47, 10), (70, 10), (80, 0), (100, 0))
    first, second = find_flights(flown(T, pwm, height))
    assert (first.stop, second.start) == pytest.approx((40.0, 43.0), abs=0.5)
    bumped = np.where((T > 40) & (T < 40.5), 1250.0, PWM)
    assert len(find_flights(flown(T, bumped, height))) == 1


def test_a_log_that_begins_and_ends_in_the_air():
    (flight,) = find_flights(flown(T, np.full(len(T), 1500.0), 10.0 + np.sin(T)))
    assert (flight.start, flight.stop) == pytest.approx((T[0], T[-1]))


def test_a_log_that_ends_at_touch_down():
    ended = T <= 80.8
    (flight,) = find_flights(flown(T[ended], PWM[ended], HEIGHT[ended]))
    assert flight.stop == pytest.approx(80.0, abs=0.4)


def test_a_fall_with_the_motors_off_is_still_flying():
    """Thrust and specific force are nothing until the ground: firmware that disarmed 8 m up fell for 1.3 s."""
    fallen = (T >= 60.0) & (T < 61.4)
    pwm = np.where(T < 60.0, PWM, 1000.0)
    height = np.where(T < 60.0, HEIGHT, np.maximum(10.0 - 4.9 * (T - 60.0) ** 2, 0.0))
    (flight,) = find_flights(flown(T, pwm, height, air=(T > 14) & ((T < 60) | fallen)))
    assert flight.stop == pytest.approx(61.4, abs=0.4)


def test_dropping_with_closed_throttle_is_still_flying():
    pwm = np.where((T > 40) & (T < 43), 1150.0, PWM)
    (flight,) = find_flights(flown(T, pwm, HEIGHT))
    assert flight.duration > 60.0


def test_after_a_crash_the_motors_that_run_on_are_no_flight():
    """A craft upside down turned its motors for minutes: 289 s of flight for 78."""
    pwm = np.where(T > 60.0, 1300.0, PWM)
    height = profile(T, (0, 0), (14, 0), (18, 10), (58, 10), (60, 0), (100, 0))
    (flight,) = find_flights(flown(T, pwm, height))
    assert flight.stop == pytest.approx(60.0, abs=0.4)


def test_the_flight_ends_at_the_first_shock_though_the_motors_run_on():
    """A craft hit the ground with 57 m/s^2 and stood there at hover's throttle for two seconds."""
    log = flown(T, np.where((T > 80.0) & (T < 81.5), HOVER, PWM), HEIGHT)
    struck = log.imu["accel_z"].where(np.abs(T - 80.0) > 0.05, -57.0)
    (flight,) = find_flights(dataclasses.replace(log, imu=log.imu.assign(accel_z=struck)))
    assert flight.stop == pytest.approx(80.0, abs=0.1)


def test_a_gap_in_the_log_ends_a_flight():
    kept = (T < 40) | (T > 55)
    first, second = find_flights(flown(T[kept], PWM[kept], HEIGHT[kept]))
    assert first.stop < 40.1
    assert second.start > 54.9


def test_a_craft_that_sinks_into_a_hole_of_the_log_lands_by_its_rate_of_descent():
    """Telemetry leaves off below trees: the last rows are 2 m up, the next ones minutes later on the ground."""
    kept = (T < 78) | (T > 90)
    (flight,) = find_flights(flown(T[kept], PWM[kept], HEIGHT[kept]))
    assert flight.stop == pytest.approx(80.0, abs=0.4)


@pytest.mark.parametrize("step", [5, 10])
def test_telemetry_of_one_or_two_messages_a_second(step):
    (flight,) = find_flights(flown(T[::step], PWM[::step], HEIGHT[::step]))
    assert (flight.start, flight.stop) == pytest.approx((14.0, 80.0), abs=0.15 * step)


@pytest.mark.parametrize("pwm", [1000.0, 1150.0])
def test_motors_that_idle_on_the_bench_are_no_flight(pwm):
    assert find_flights(flown(T, np.full(len(T), pwm), np.zeros(len(T)))) == ()


def test_full_throttle_on_a_stand_is_no_flight():
    # The propellers feign a metre of height (Javiercerna's log does).
    noise = np.random.default_rng(3).normal(0.0, 0.05, len(T))
    bench = flown(T, PWM, 1.0 * (PWM > 1300) + noise, air=np.zeros(len(T), bool))
    assert find_flights(bench) == ()


def test_motors_driven_hard_on_a_stand_are_no_flight():
    """A barometer that drifts by metres made nine minutes of flight of a craft on a bench; its force stood still."""
    pwm = PWM + np.where(PWM > 1200, 150.0 * np.sign(np.sin(2.0 * np.pi * T / 3.0)), 0.0)
    drift = profile(T, (0, 0), (14, 0), (70, 3), (80, 0), (100, 0))
    assert find_flights(flown(T, pwm, drift, air=np.zeros(len(T), bool))) == ()
    assert len(find_flights(flown(T, pwm, drift))) == 1


@pytest.mark.parametrize(("output", "flights"), [(1500.0, 2), (1400.0, 1)])
def test_a_low_run_is_a_flight_where_its_thrust_is_known_to_carry(output, flights):
    """Propellers feign a metre on the ground, and hops are no higher: thrust that carried the craft before tells."""
    t = np.arange(0.0, 200.0, 0.1)
    hop = np.minimum(0.08 * HEIGHT, 0.8)
    pwm = np.concatenate((PWM, np.where(PWM > 1200, PWM + (output - HOVER) * (PWM - 1150.0) / 350.0, PWM)))
    height = np.concatenate((HEIGHT, hop))
    found = find_flights(flown(t, pwm, height, air=(height > 0.05) & ((t < 100) | (output == HOVER))))
    assert len(found) == flights


def test_a_low_hover_alone_is_a_flight_where_forces_follow_the_motors():
    lively = PWM + np.where(PWM > 1450, 40.0 * np.sin(T), 0.0)
    (flight,) = find_flights(flown(T, lively, 0.08 * HEIGHT))
    assert (flight.start, flight.stop) == pytest.approx((14.0, 80.0), abs=1.0)


def test_idle_is_what_the_parameters_of_the_time_say():
    # Firmware 3.2 with THR_MIN 190 over 1100..1900 us idles at 1252 us; a flight is above that.
    old = {"RC3_MIN": 1100, "RC3_MAX": 1900, "THR_MIN": 190, "MOT_SPIN_ARMED": 100}
    rising = profile(T, (0, 0), (99, 5))
    assert find_flights(flown(T, np.full(len(T), 1252.0), rising, old)) == ()
    assert len(find_flights(flown(T, np.full(len(T), 1300.0), rising, old))) == 1


def test_vibration_that_spoils_the_accelerometer_in_the_air_costs_nothing():
    """On one craft |acc| was 9 at rest and 5.6 in flight: the ground seemed to carry one and a half craft."""
    log = flown(T, PWM, HEIGHT)
    spoiled = log.imu.assign(accel_z=log.imu["accel_z"] * np.where(HEIGHT > 0.05, 0.6, 1.0))
    (flight,) = find_flights(dataclasses.replace(log, imu=spoiled))
    assert (flight.start, flight.stop) == pytest.approx((14.0, 80.0), abs=0.5)


def test_an_estimate_that_runs_away_gives_way_to_the_barometer():
    lost = -(HEIGHT + 3.0 * (T - 14).clip(0))
    (flight,) = find_flights(flown(T, PWM, HEIGHT, ekf=table(T, p_n=0.0 * T, p_e=0.0 * T, p_d=lost)))
    assert (flight.start, flight.stop) == pytest.approx((14.0, 80.0), abs=0.4)


@pytest.mark.parametrize("missing", ["imu", "baro", "motors", "all"])
def test_a_log_without_one_of_its_sources(missing):
    """Without a barometer the autopilot's height serves, without outputs its throttle, else the height alone."""
    log = flown(T, PWM, HEIGHT, ekf=table(T, p_d=-HEIGHT, v_d=0.0 * T))
    throttle = table(T, throttle=((PWM - 1150.0) / 850.0).clip(0.0))
    without = {"motors": None, "setpoints": throttle} if missing == "motors" else {missing: None}
    if missing == "all":
        without = {"motors": None, "imu": None, "baro": None}
    (flight,) = find_flights(dataclasses.replace(log, **without))
    assert (flight.start, flight.stop) == pytest.approx((14.0, 80.0), abs=0.6)


def test_nothing_to_go_by_is_no_flight():
    assert find_flights(Tables()) == ()
    assert find_flights(Tables(motors=table([], m1=[]))) == ()
    assert find_flights(Tables(motors=table([1.0, 2.0], m1=[np.nan, np.nan]))) == ()
    assert find_flights(Tables(motors=table(T, m1=PWM))) == ()


@pytest.mark.parametrize("step", [61.0, 4000.0, 1e7])
def test_rows_that_lie_minutes_or_years_apart_are_no_flight(step):
    """Such a clock is wrong; as a flight of years it would be looked at second by second."""
    stretched = flown(10.0 * step * T, PWM, HEIGHT)  # T is in tenths of a second
    assert find_flights(stretched) == ()
