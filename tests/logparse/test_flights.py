"""Airborne intervals: the whole account rests on them, and bench runs must not pass for flights."""

import numpy as np
import pytest

from logparse.craft.pwm_range import pwm_range
from logparse.flights import find_flights
from logparse.tables import Tables
from tests.timed import timed

#: ArduCopter 4: idle at 1150 us, as SITL flies.
PARAMETERS = {"MOT_PWM_MIN": 1000, "MOT_PWM_MAX": 2000, "MOT_SPIN_ARM": 0.1, "MOT_SPIN_MIN": 0.15}
GRAVITY, HOVER = 9.8, 1500.0


def profile(t, *points):
    """Piecewise linear course through (time, value) points."""
    times, values = zip(*points, strict=True)
    return np.interp(t, times, values)


def still(t, force):
    zeros = np.zeros(len(t))
    return timed(t, gyro_x=zeros, gyro_y=zeros, gyro_z=zeros, accel_x=zeros, accel_y=zeros, accel_z=-force + zeros)


def flown(t, pwm, height, parameters=PARAMETERS, air=None, **more):
    """Tables of a craft whose specific force is gravity on the ground and what its motors give in the air."""
    rng = np.random.default_rng(2)
    levels = pwm_range(parameters)
    pwm = pwm + np.where(pwm > 1200, rng.normal(0.0, 10.0, len(t)), 0.0)
    thrust = levels.thrust(np.asarray(pwm, dtype=float)) / levels.thrust(np.array(HOVER))
    air = height > 0.05 if air is None else air
    force = GRAVITY * np.where(air, thrust, 1.0) + 0.1 * rng.normal(size=len(t))
    motors = timed(t, **{f"m{k}": pwm for k in range(1, 5)})
    zeros = np.zeros(len(t))
    log = Tables(motors=motors, imu=still(t, force), baro=timed(t, alt=height, pressure=zeros), parameters=parameters)
    return log.changed(**more)


T = np.arange(0.0, 100.0, 0.1)
#: Armed at 10, motors up at 12, off the ground at 14, on it again at 80, motors down by 82.
PWM = profile(
    T, (0, 1000), (10, 1000), (10.1, 1150), (13, 1150), (14, 1500), (80, 1500), (80.5, 1200), (82, 1150), (82.1, 1000)
)
HEIGHT = profile(T, (0, 0), (14, 0), (18, 10), (70, 10), (80, 0), (100, 0))


def cut(kept, **more):
    """Return the flight with some of its rows only."""
    return flown(T[kept], PWM[kept], HEIGHT[kept], **more)


def struck():
    """Return a craft that hits the ground with 57 m/s^2 and stands there at hover's throttle for two seconds."""
    log = flown(T, np.where((T > 80.0) & (T < 81.5), HOVER, PWM), HEIGHT)
    force = log.imu["accel_z"].where(np.abs(T - 80.0) > 0.05, -57.0)
    return log.changed(imu=log.imu.assign(accel_z=force))


def shaken():
    """Return a craft whose |acc| was 9 at rest and 5.6 in flight: the ground seemed to carry one and a half craft."""
    log = flown(T, PWM, HEIGHT)
    return log.changed(imu=log.imu.assign(accel_z=log.imu["accel_z"] * np.where(HEIGHT > 0.05, 0.6, 1.0)))


def fallen():
    """Return a craft that fell from 10 m and lies where it hit the ground, with motors that nobody stops."""
    log = flown(T, np.where(T > 14, 1500.0, PWM), profile(T, (0, 0), (14, 0), (18, 10), (58, 10), (60, 0), (100, 0)))
    force = log.imu["accel_z"].where(np.abs(T - 60.0) > 0.11, -90.0)
    return log.changed(imu=log.imu.assign(accel_z=force))


#: Landing 30 m below the place of the take-off.
ELSEWHERE = profile(T, (0, 0), (14, 0), (18, 10), (70, 10), (80, -30), (100, -30))
T2 = np.arange(0.0, 200.0, 0.1)
DIVED = profile(T, (0, 5), (30, 5), (34, 3), (40, 3), (50, 12), (70, 10), (80, 0), (100, 0))
KEPT = (T < 40) | (T > 55)
T3, PWM3, HEIGHT3 = np.where(T < 40, T, T + 60.0)[KEPT], PWM[KEPT], HEIGHT[KEPT]
TOUCHED = profile(T, (0, 0), (14, 0), (18, 10), (30, 10), (40, 0), (43, 0), (47, 10), (70, 10), (80, 0), (100, 0))
#: Firmware that disarmed 8 m up fell for 1.3 s.
FALLEN = np.where(T < 60.0, HEIGHT, np.maximum(10.0 - 4.9 * (T - 60.0) ** 2, 0.0))
DRIFT = profile(T, (0, 0), (14, 0), (70, 3), (80, 0), (100, 0))
DRIVEN = PWM + np.where(PWM > 1200, 150.0 * np.sign(np.sin(2.0 * np.pi * T / 3.0)), 0.0)
LIVELY = PWM + np.where(PWM > 1450, 40.0 * np.sin(T), 0.0)
RISING = profile(T, (0, 0), (99, 5))
NOWHERE = np.zeros(len(T), bool)
LOST = -(HEIGHT + 3.0 * (T - 14).clip(0))
#: Firmware 3.2 with THR_MIN 190 over 1100..1900 us idles at 1252 us; a flight is above that.
OLD = {"RC3_MIN": 1100, "RC3_MAX": 1900, "THR_MIN": 190, "MOT_SPIN_ARMED": 100}

#: What was logged, and the flights in it: lift-off and touch-down, and how exactly they are found, s.
SCENES = {
    "one flight": (flown(T, PWM, HEIGHT), [(14.0, 80.0)], 0.4),
    "landing elsewhere": (
        flown(T, PWM, ELSEWHERE, air=(T > 14) & (T < 80)),
        [(14.0, 80.0)],
        0.4,
    ),
    "two flights": (flown(T2, np.tile(PWM, 2), np.tile(HEIGHT, 2)), [(14.0, 80.0), (114.0, 180.0)], 0.4),
    # Pilots touch down for two seconds at low throttle and go on; a bump of half a second is part of the flight.
    "touch-and-go": (flown(T, np.where((T > 40) & (T < 43), 1250.0, PWM), TOUCHED), [(14.0, 40.0), (43.0, 80.0)], 0.5),
    "bump": (flown(T, np.where((T > 40) & (T < 40.5), 1250.0, PWM), TOUCHED), [(14.0, 80.0)], 0.5),
    "in the air throughout": (flown(T, np.full(len(T), 1500.0), 10.0 + np.sin(T)), [(T[0], T[-1])], 1e-6),
    "log ends at touch-down": (cut(T <= 80.8), [(14.0, 80.0)], 0.4),
    "fall with the motors off": (
        flown(T, np.where(T < 60.0, PWM, 1000.0), FALLEN, air=(T > 14) & (T < 61.4)),
        [(14.0, 61.4)],
        0.4,
    ),
    "closed throttle": (flown(T, np.where((T > 40) & (T < 43), 1150.0, PWM), HEIGHT), [(14.0, 80.0)], 0.4),
    # A craft upside down turned its motors for minutes: 289 s of flight for 78.
    "crash": (
        flown(
            T,
            np.where(T > 60.0, 1300.0, PWM),
            profile(T, (0, 0), (14, 0), (18, 10), (58, 10), (60, 0), (100, 0)),
        ),
        [(14.0, 60.0)],
        0.4,
    ),
    # One that lay with its motors turning as in hover until the log ended (lost_motor_quad: 9 s).
    "crash with its motors on": (fallen(), [(14.0, 60.0)], 0.4),
    "shock": (struck(), [(14.0, 80.0)], 0.4),
    "hole in the air": (cut((T < 40) | (T > 55)), [(14.0, 80.0)], 0.4),
    "more than a minute": (flown(T3, PWM3, HEIGHT3), [(14.0, 40.0), (115.0, 140.0)], 0.4),
    # A row or two of a manoeuvre, as which the ground would show, are no ground that it lifts off from.
    "begins in a dive": (
        flown(
            T[T > 30], np.where(T < 30.3, 1250.0, PWM)[T > 30], DIVED[T > 30], air=(T[T > 30] > 30.3) & (T[T > 30] < 80)
        ),
        [(30.1, 80.0)],
        0.3,
    ),
    # Telemetry leaves off below trees: the last rows are 2 m up, the next ones minutes later on the ground.
    "hole at the landing": (cut((T < 78) | (T > 90)), [(14.0, 80.0)], 0.4),
    "two rows a second": (cut(slice(None, None, 5)), [(14.0, 80.0)], 0.75),
    "one row a second": (cut(slice(None, None, 10)), [(14.0, 80.0)], 1.5),
    "shaken accelerometer": (shaken(), [(14.0, 80.0)], 0.5),
    "lost estimate": (flown(T, PWM, HEIGHT, ekf=timed(T, p_n=0.0 * T, p_e=0.0 * T, p_d=LOST)), [(14.0, 80.0)], 0.4),
    "low hover": (flown(T, LIVELY, 0.08 * HEIGHT), [(14.0, 80.0)], 1.0),
    "disarmed": (flown(T, np.full(len(T), 1000.0), 0.0 * T), [], 0.0),
    "idle": (flown(T, np.full(len(T), 1150.0), 0.0 * T), [], 0.0),
    "idle of old firmware": (flown(T, np.full(len(T), 1252.0), RISING, OLD), [], 0.0),
    "above idle of old firmware": (flown(T, np.full(len(T), 1300.0), RISING, OLD), [(0.0, 99.9)], 3.0),
    # The propellers feign a metre of height.
    "stand": (
        flown(T, PWM, 1.0 * (PWM > 1300) + np.random.default_rng(3).normal(0.0, 0.05, len(T)), air=NOWHERE),
        [],
        0.0,
    ),
    # A barometer that drifts by metres made nine minutes of flight of a craft on a bench; its force stood still.
    "driven hard on a stand": (flown(T, DRIVEN, DRIFT, air=NOWHERE), [], 0.0),
    "as hard in the air": (flown(T, DRIVEN, DRIFT), [(14.0, 80.0)], 6.0),
    "nothing": (Tables(), [], 0.0),
    "no rows": (Tables(motors=timed([], m1=[])), [], 0.0),
    "no numbers": (Tables(motors=timed([1.0, 2.0], m1=[np.nan, np.nan])), [], 0.0),
    "outputs alone": (Tables(motors=timed(T, m1=PWM)), [], 0.0),
    # As flights of years they would be looked at second by second.
    "rows a minute apart": (flown(610.0 * T, PWM, HEIGHT), [], 0.0),
    "rows months apart": (flown(1e8 * T, PWM, HEIGHT), [], 0.0),
}


@pytest.mark.parametrize("scene", SCENES)
def test_flights_are_from_lift_off_to_touch_down(scene):
    log, expected, within = SCENES[scene]
    flights = find_flights(log)
    assert len(flights) == len(expected)
    for flight, times in zip(flights, expected, strict=True):
        assert (flight.start, flight.stop) == pytest.approx(times, abs=within)
        assert flight.duration == flight.stop - flight.start


@pytest.mark.parametrize(("output", "flights"), [(1500.0, 2), (1400.0, 1)])
def test_a_low_run_is_a_flight_where_its_thrust_is_known_to_carry(output, flights):
    """Propellers feign a metre on the ground, and hops are no higher: thrust that carried the craft before tells."""
    hop = np.minimum(0.08 * HEIGHT, 0.8)
    pwm = np.concatenate((PWM, np.where(PWM > 1200, PWM + (output - HOVER) * (PWM - 1150.0) / 350.0, PWM)))
    height = np.concatenate((HEIGHT, hop))
    spans = find_flights(flown(T2, pwm, height, air=(height > 0.05) & ((T2 < 100) | (output == HOVER))))
    assert len(spans) == flights


@pytest.mark.parametrize("missing", ["imu", "baro", "motors", "all"])
def test_a_log_without_one_of_its_sources(missing):
    """Without a barometer the autopilot's height serves, without outputs its throttle, else the height alone."""
    log = flown(T, PWM, HEIGHT, ekf=timed(T, p_d=-HEIGHT, v_d=0.0 * T))
    throttle = timed(T, throttle=((PWM - 1150.0) / 850.0).clip(0.0))
    without = {"motors": None, "setpoints": throttle} if missing == "motors" else {missing: None}
    if missing == "all":
        without = {"motors": None, "imu": None, "baro": None}
    (flight,) = find_flights(log.changed(**without))
    assert (flight.start, flight.stop) == pytest.approx((14.0, 80.0), abs=0.6)
