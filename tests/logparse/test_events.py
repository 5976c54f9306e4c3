"""Events of a flight's timeline, on tables of known course: what happens is named with its time, nothing else is."""

import numpy as np
import pandas as pd
import pytest

from logparse import FlightEvent, Severity, flight_events
from logparse.flights import Flight
from logparse.tables import Tables

FLIGHT = (Flight(10.0, 70.0),)
PARAMETERS = {"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0, "MOT_SPIN_MIN": 0.15, "MOT_SPIN_MAX": 0.95}


def table(rate: float, **columns):
    """Make a table from 0 to 80 s whose columns are functions of time, or constants."""
    t = np.arange(0.0, 80.0, 1.0 / rate)
    values = {name: value(t) if callable(value) else np.full(len(t), value) for name, value in columns.items()}
    return pd.DataFrame(values, index=pd.Index(t, name="t"))


def height(t):
    return np.interp(t, (0.0, 10.0, 14.0, 55.0, 70.0, 80.0), (0.0, 0.0, 20.0, 20.0, 0.0, 0.0))


def flown(**changes):
    """Return the tables of a healthy flight, with changes."""
    parts = {
        "motors": table(10.0, **{f"m{k}": 1500.0 for k in range(1, 5)}),
        "imu": table(25.0, gyro_x=0.0, gyro_y=0.0, gyro_z=0.0, accel_x=0.0, accel_y=0.0, accel_z=-9.8),
        "attitude": table(10.0, roll=0.0, pitch=0.0, yaw=0.0),
        "setpoints": table(10.0, roll=0.0, pitch=0.0, yaw=0.0, throttle=0.35),
        "rates": table(50.0, w_x_ref=0.0, w_y_ref=0.0, w_z_ref=0.0, w_x=0.0, w_y=0.0, w_z=0.0),
        "baro": table(10.0, alt=height, pressure=1e5, temperature=290.0),
        "gps": table(5.0, lat=0.8, lon=0.1, alt=height, v_n=0.0, v_e=0.0, v_d=0.0, fix=3.0, satellites=12.0, hdop=0.8),
        "battery": table(10.0, voltage=12.3, current=10.0),
        "modes": pd.DataFrame({"mode": ["LOITER"]}, index=pd.Index([0.0], name="t")),
        "parameters": PARAMETERS,
    }
    return Tables(**(parts | changes))


def events_at(*rows):
    """Make a table of events of (time, event, detail)."""
    times, names, details = zip(*rows, strict=True)
    return pd.DataFrame(
        {"event": pd.array(names, dtype="str"), "detail": pd.array(details, dtype="str")},
        index=pd.Index(times, name="t", dtype=float),
    )


def notable(tables, messages=None, flights=FLIGHT):
    return [event for event in flight_events(tables, messages or {}, flights) if event.notable]


def only(identity, found) -> FlightEvent:
    assert [event.id for event in found] == [identity]
    return found[0]


def between(first, last, inside, outside=0.0):
    return lambda t: np.where((t >= first) & (t < last), inside, outside)


def test_a_healthy_flight_has_no_notable_event():
    assert notable(flown()) == []
    # The landing shakes, and the receiver may rest on the ground without a fix.
    gps = flown().gps.copy()
    gps.loc[:5.0, "fix"] = 0.0
    assert notable(flown(gps=gps)) == []


def test_a_log_without_tables_has_no_event():
    assert flight_events(Tables(), {}, ()) == ()


def test_arming_modes_and_errors_are_reported_once():
    events = events_at(
        (9.0, "MESSAGE", "Arming motors"),
        (9.1, "ARMED", ""),
        (30.0, "ERROR", "FAILSAFE_RADIO 1"),
        (33.0, "ERROR", "FAILSAFE_RADIO 0"),
        (40.0, "ERROR", "EKF_PRIMARY 1"),
        (75.0, "DISARMED", ""),
        (75.1, "ERROR", "EKF_PRIMARY 0"),
    )
    found = flight_events(flown(events=events), {}, FLIGHT)
    assert [(event.id, event.t) for event in found] == [
        ("mode-change", 0.0),
        ("motors-armed", 9.0),
        ("failsafe-triggered", 30.0),
        ("estimator-lane-switch", 40.0),
        ("motors-disarmed", 75.0),
        ("estimator-lane-switch", 75.1),
    ]
    # On the ground the estimator may switch as it likes.
    assert [event.severity for event in found if event.id == "estimator-lane-switch"] == [
        Severity.WARNING,
        Severity.INFO,
    ]


def test_disarming_in_the_air_ends_in_a_crash():
    # Falls 10 m from t = 40 on: 1.43 s.
    def falling(t):
        return np.where(t < 40.0, height(t), np.maximum(20.0 - 0.5 * 9.8 * (t - 40.0) ** 2, 0.0))

    force = between(40.0, 42.0, 0.0, -9.8)
    imu = table(25.0, gyro_x=0.0, gyro_y=0.0, gyro_z=0.0, accel_x=0.0, accel_y=0.0, accel_z=force)
    imu.loc[42.02:42.1, "accel_z"] = -120.0
    tables = flown(
        imu=imu,
        baro=table(10.0, alt=falling, pressure=1e5, temperature=290.0),
        events=events_at((40.0, "DISARMED", "")),
    )
    found = notable(tables, flights=(Flight(10.0, 40.0),))
    assert [event.id for event in found] == ["disarmed-in-air", "free-fall", "crash"]
    assert found[0].t == 40.0
    assert found[0].evidence["height_m"] == pytest.approx(20.0, abs=0.5)
    assert found[1].duration == pytest.approx(2.0, abs=0.1)
    assert found[2].t == pytest.approx(42.04, abs=0.05)
    assert found[2].evidence["descent_m_s"] > 10.0


def test_disarming_after_landing_is_no_event():
    assert notable(flown(events=events_at((70.3, "DISARMED", "")))) == []


def test_a_hard_landing_is_no_crash():
    imu = flown().imu.copy()
    imu.loc[69.8:69.85, "accel_z"] = -60.0
    event = only("hard-landing", notable(flown(imu=imu)))
    assert event.t == pytest.approx(69.8, abs=0.05)


@pytest.mark.parametrize(("speed", "expected"), [(4.8, "hard-landing"), (7.5, "crash")])
def test_an_upright_craft_that_comes_down_fast_has_landed_hard_and_from_a_fall_it_has_crashed(speed, expected):
    imu = flown().imu.copy()
    imu.loc[69.8:69.85, "accel_z"] = -80.0
    course = lambda t: np.interp(t, (0, 10, 14, 69.8 - 20.0 / speed, 69.8), (0, 0, 20, 20, 0))  # noqa: E731
    found = notable(flown(imu=imu, baro=table(10.0, alt=course, pressure=1e5, temperature=290.0)))
    event = only(expected, found)
    assert event.evidence["descent_m_s"] == pytest.approx(speed, abs=0.3)
    assert f"{event.evidence['descent_m_s']:.1f} m/s down" in event.reason


def test_a_touch_from_which_the_craft_rises_again_is_no_crash():
    imu = flown().imu.copy()
    imu.loc[40.0:40.1, "accel_z"] = -60.0
    roll = between(39.0, 40.2, 0.6)
    course = lambda t: np.interp(t, (0, 10, 14, 38, 40, 44, 55, 70), (0, 0, 20, 20, 0, 20, 20, 0))  # noqa: E731
    tables = flown(
        imu=imu,
        attitude=table(10.0, roll=roll, pitch=0.0, yaw=0.0),
        baro=table(10.0, alt=course, pressure=1e5, temperature=290.0),
    )
    assert [event.id for event in notable(tables)] == ["loss-of-control", "blow-in-flight"]


def test_loss_of_control_is_timed_and_what_follows_a_crash_is_left_out():
    roll = between(50.0, 53.0, 1.2)
    imu = flown().imu.copy()
    imu.loc[52.0:52.1, "accel_z"] = -150.0  # and down for good
    tables = flown(attitude=table(10.0, roll=roll, pitch=0.0, yaw=0.0), imu=imu)
    found = notable(tables)
    assert [event.id for event in found] == ["loss-of-control", "crash"]
    assert found[0].t == pytest.approx(50.0, abs=0.11)
    assert found[0].evidence["worst_rad"] == pytest.approx(1.2)
    assert found[0].end == found[1].t == pytest.approx(52.0, abs=0.05)


def followed(t, tau=0.35):
    """Attitude of a craft that follows the sticks of `thrown` as a first-order lag of `tau` seconds."""
    target, flown_, step = thrown(t), np.zeros(len(t)), t[1] - t[0]
    for k in range(1, len(t)):
        flown_[k] = flown_[k - 1] + (target[k] - flown_[k - 1]) * (1.0 - np.exp(-step / tau))
    return flown_


def thrown(t):
    """Sticks thrown from stop to stop, 45 degrees, every one and a half seconds."""
    return np.radians(45.0) * np.sign(np.sin(2.0 * np.pi * t / 3.0))


def test_a_pilot_who_throws_the_stick_about_does_not_lose_control():
    asked = table(10.0, roll=thrown, pitch=0.0, yaw=0.0, throttle=0.35)
    assert notable(flown(setpoints=asked, attitude=table(10.0, roll=followed, pitch=0.0, yaw=0.0))) == []
    # The target rests, and the craft swings as far for a while.
    swinging = table(10.0, roll=lambda t: np.where((t > 30.0) & (t < 36.0), followed(t), 0.0), pitch=0.0, yaw=0.0)
    assert {event.id for event in notable(flown(attitude=swinging))} == {"loss-of-control"}


def test_overshoot_is_a_deviation_and_no_loss_of_control():
    lean = between(30.0, 30.5, np.radians(40.0))
    assert only("attitude-deviation", notable(flown(attitude=table(10.0, roll=lean, pitch=0.0, yaw=0.0)))).t == 30.0


def test_sinking_at_a_lean_is_no_loss_of_lift():
    sinking = table(25.0, p_n=0.0, p_e=0.0, p_d=lambda t: -height(t), v_n=0.0, v_e=0.0, v_d=between(30.0, 34.0, 3.0))
    lean = np.radians(40.0)
    asked = table(10.0, roll=lean, pitch=0.0, yaw=0.0, throttle=between(30.0, 34.0, 1.0, 0.35))
    assert notable(flown(ekf=sinking, setpoints=asked, attitude=table(10.0, roll=lean, pitch=0.0, yaw=0.0))) == []


def test_a_throttle_that_was_closed_lets_a_craft_fall():
    imu = flown().imu.assign(accel_z=between(30.0, 30.6, -0.5, -9.8)(flown().imu.index.to_numpy()))
    closed = table(10.0, roll=0.0, pitch=0.0, yaw=0.0, throttle=between(30.0, 30.6, 0.0, 0.35))
    assert notable(flown(imu=imu, setpoints=closed)) == []
    assert only("free-fall", notable(flown(imu=imu))).t == pytest.approx(30.0, abs=0.05)


def test_flips_are_no_loss_of_control():
    modes = pd.DataFrame({"mode": ["LOITER", "FLIP", "LOITER"]}, index=pd.Index([0.0, 49.0, 54.0], name="t"))
    roll = between(50.0, 53.0, 3.0)
    assert notable(flown(attitude=table(10.0, roll=roll, pitch=0.0, yaw=0.0), modes=modes)) == []


def test_heading_does_not_count_as_a_deviation():
    assert notable(flown(attitude=table(10.0, roll=0.0, pitch=0.0, yaw=2.0))) == []


def test_a_bench_run_is_told_from_loss_of_control():
    tables = flown(attitude=table(10.0, roll=1.0, pitch=0.0, yaw=0.0))
    assert only("attitude-not-held", notable(tables)).severity is Severity.WARNING


def test_yaw_that_runs_away_is_told_from_a_stick_let_go():
    spins = between(30.0, 33.0, 4.0)
    rates = table(50.0, w_x_ref=0.0, w_y_ref=0.0, w_z_ref=0.0, w_x=0.0, w_y=0.0, w_z=spins)
    event = only("loss-of-yaw-authority", notable(flown(rates=rates)))
    assert (event.t, event.end) == pytest.approx((30.0, 33.0), abs=0.1)
    # A yaw stick let go at 30 s: the craft slows down from 3 rad/s within half a second.
    slowing = lambda t: np.where(t < 30.0, 3.0, 3.0 * np.exp(-(t - 30.0) / 0.5))  # noqa: E731
    asked = between(0.0, 30.0, 3.0)
    rates = table(50.0, w_x_ref=0.0, w_y_ref=0.0, w_z_ref=asked, w_x=0.0, w_y=0.0, w_z=slowing)
    assert notable(flown(rates=rates)) == []


@pytest.mark.parametrize("hz", [4.0, 9.0, 18.0])
def test_an_oscillation_is_named_with_axis_and_frequency(hz):
    swing = lambda t: np.where((t > 30.0) & (t < 40.0), np.sin(2.0 * np.pi * hz * t), 0.0)  # noqa: E731
    rates = table(50.0, w_x_ref=0.0, w_y_ref=0.0, w_z_ref=0.0, w_x=0.0, w_y=swing, w_z=0.0)
    event = only("oscillation", notable(flown(rates=rates)))
    assert event.evidence["axis"] == "pitch"
    assert event.evidence["frequency_hz"] == pytest.approx(hz, abs=0.5)
    assert event.evidence["amplitude_rad_s"] == pytest.approx(1.0, rel=0.1)
    assert (event.t, event.end) == pytest.approx((30.0, 40.0), abs=1.1)


def test_what_was_asked_for_is_no_oscillation():
    swing = lambda t: np.sin(2.0 * np.pi * 3.0 * t)  # noqa: E731
    rates = table(50.0, w_x_ref=swing, w_y_ref=0.0, w_z_ref=0.0, w_x=swing, w_y=0.0, w_z=0.0)
    assert notable(flown(rates=rates)) == []
    # A chirp of SYSTEMID enters behind the target.
    rates = table(50.0, w_x_ref=0.0, w_y_ref=0.0, w_z_ref=0.0, w_x=swing, w_y=0.0, w_z=0.0)
    assert notable(flown(rates=rates, systemid=table(50.0, axis=10.0, target=swing))) == []


def test_sticks_swung_by_hand_are_no_oscillation_where_only_angles_have_targets():
    w = 2.0 * np.pi * 2.5

    def swung(t):
        return np.where((t > 30.0) & (t < 40.0), np.radians(4.0) * np.sin(w * t), 0.0)

    gyro = flown().imu.assign(gyro_x=np.gradient(swung(flown().imu.index.to_numpy()), 1.0 / 25.0))
    attitude = table(25.0, roll=swung, pitch=0.0, yaw=0.0)
    asked = table(25.0, roll=swung, pitch=0.0, yaw=0.0, throttle=0.35)
    assert notable(flown(rates=None, imu=gyro, attitude=attitude, setpoints=asked)) == []
    assert only("oscillation", notable(flown(rates=None, imu=gyro, attitude=attitude))).evidence["axis"] == "roll"


def test_wind_noise_is_no_oscillation():
    rng = np.random.default_rng(1)
    rates = table(50.0, w_x_ref=0.0, w_y_ref=0.0, w_z_ref=0.0, w_x=0.0, w_y=0.0, w_z=0.0)
    rates[["w_x", "w_y", "w_z"]] = rng.normal(0.0, 0.5, (len(rates), 3))
    assert notable(flown(rates=rates)) == []


def test_a_jammed_receiver_is_timed():
    gps = flown().gps.copy()
    gps.loc[40.0:46.0, ["fix", "satellites"]] = [1.0, 3.0]
    gps.loc[43.0, ["fix", "satellites"]] = [3.0, 10.0]  # one stray fix does not end it
    event = only("gps-lost", notable(flown(gps=gps)))
    assert (event.t, event.end) == pytest.approx((40.0, 46.0), abs=0.21)
    assert event.evidence["satellites_before"] == 12.0
    assert "jammed" in event.reason


def test_a_glitch_is_a_jump_against_its_own_speed():
    gps = flown().gps.copy()
    gps.loc[40.0:, "lat"] += 30.0 / 6.371e6
    event = only("gps-glitch", notable(flown(gps=gps)))
    assert event.t == pytest.approx(40.0, abs=0.01)
    assert event.evidence["jump_m"] == pytest.approx(30.0, abs=1.0)
    # Flown at 15 m/s the same way is no jump.
    moving = flown().gps.copy()
    moving["v_n"] = 15.0
    moving["lat"] = 0.8 + 15.0 * moving.index.to_numpy() / 6.371e6
    assert notable(flown(gps=moving)) == []


def test_a_receiver_that_never_had_a_fix_loses_none():
    gps = flown().gps.assign(fix=0.0, satellites=0.0)
    assert notable(flown(gps=gps)) == []


def test_a_silent_receiver_is_told_from_a_log_that_stopped():
    gps = flown().gps
    gps = gps[(gps.index < 40.0) | (gps.index > 46.0)]
    event = only("gps-lost", notable(flown(gps=gps)))
    assert (event.t, event.end) == pytest.approx((39.8, 46.2), abs=0.21)
    attitude = flown().attitude
    attitude = attitude[(attitude.index < 40.0) | (attitude.index > 46.0)]
    assert notable(flown(gps=gps, attitude=attitude)) == []


def test_motors_at_their_limit_and_lack_of_lift():
    motors = table(10.0, m1=between(30.0, 34.0, 1950.0, 1500.0), m2=1500.0, m3=1500.0, m4=1500.0)
    event = only("motor-at-limit", notable(flown(motors=motors)))
    assert (event.t, event.end) == pytest.approx((30.0, 34.0), abs=0.11)
    assert event.evidence["motors"] == "1"
    # One sample at the limit belongs to flying.
    motors = table(10.0, m1=between(30.0, 30.1, 1950.0, 1500.0), m2=1500.0, m3=1500.0, m4=1500.0)
    assert notable(flown(motors=motors)) == []

    sinking = table(25.0, p_n=0.0, p_e=0.0, p_d=lambda t: -height(t), v_n=0.0, v_e=0.0, v_d=between(30.0, 34.0, 2.0))
    setpoints = table(10.0, roll=0.0, pitch=0.0, yaw=0.0, throttle=between(30.0, 34.0, 1.0, 0.35))
    event = only("loss-of-lift", notable(flown(ekf=sinking, setpoints=setpoints)))
    assert (event.t, event.end) == pytest.approx((30.0, 34.0), abs=0.21)
    # Full throttle while climbing is a climb.
    rising = sinking.assign(v_d=-sinking["v_d"])
    assert notable(flown(ekf=rising, setpoints=setpoints)) == []


def test_lack_of_lift_shows_in_the_barometer_and_the_motors_alone():
    # Neither an estimate of speed nor a throttle is logged: all motors at full output from 30 to 34 s, 2 m/s down.
    course = lambda t: np.interp(t, (0, 10, 14, 30, 34, 55, 70), (0, 0, 20, 20, 12, 12, 0))  # noqa: E731
    noise = np.random.default_rng(3).normal(0.0, 0.1, 800)
    motors = table(10.0, **{f"m{k}": between(30.0, 34.0, 1950.0, 1500.0) for k in range(1, 5)})
    baro = table(10.0, alt=lambda t: course(t) + noise, pressure=1e5, temperature=290.0)
    found = notable(flown(motors=motors, setpoints=None, baro=baro))
    event = next(each for each in found if each.id == "loss-of-lift")
    assert (event.t, event.end) == pytest.approx((30.0, 34.0), abs=0.5)
    assert event.evidence["descent_m_s"] == pytest.approx(2.0, abs=0.5)
    # The same descent at the throttle of hover is a descent.
    assert notable(flown(setpoints=None, baro=baro)) == []


def test_hovering_above_half_thrust_lacks_reserve():
    setpoints = table(10.0, roll=0.0, pitch=0.0, yaw=0.0, throttle=0.55)
    event = only("low-thrust-reserve", notable(flown(setpoints=setpoints)))
    assert event.t == pytest.approx(10.0, abs=0.5)
    assert event.evidence["thrust_to_weight"] == pytest.approx(1.0 / 0.55)
    # Throttle of firmware before 3.4 is no part of thrust.
    assert notable(flown(setpoints=setpoints, parameters={})) == []
    # A log without throttle shows it by its motors, through the same curve: 0.35 and 0.55 of the thrust.
    strained = table(10.0, **{f"m{k}": 1150.0 + 800.0 * 0.689 for k in range(1, 5)})
    assert notable(flown(setpoints=None)) == []
    event = only("low-thrust-reserve", notable(flown(setpoints=None, motors=strained)))
    assert event.evidence["thrust_to_weight"] == pytest.approx(1.0 / 0.55, rel=0.01)


def test_vibration_and_clipping_by_the_published_limits():
    vibe = table(5.0, IMU=0.0, VibeX=10.0, VibeY=12.0, VibeZ=between(30.0, 35.0, 45.0, 15.0), Clip=0.0)
    event = only("vibration-high", notable(flown(), {"VIBE": vibe}))
    assert (event.t, event.end) == pytest.approx((30.0, 35.0), abs=0.21)
    assert (event.evidence["axis"], event.severity) == ("z", Severity.WARNING)
    harmful = vibe.assign(VibeZ=2.0 * vibe["VibeZ"])
    assert only("vibration-high", notable(flown(), {"VIBE": harmful})).severity is Severity.ERROR
    # Damage puts rows in another order: a slice of them by time was an unexpected error.
    shuffled = vibe.iloc[np.random.default_rng(0).permutation(len(vibe))]
    assert only("vibration-high", notable(flown(), {"VIBE": shuffled})) == event
    clips = vibe.assign(VibeZ=15.0, Clip=np.where(vibe.index >= 50.0, 7.0, 2.0))
    event = only("clipping", notable(flown(), {"VIBE": clips}))
    assert event.t == pytest.approx(50.0, abs=0.21)
    assert event.evidence["hits"] == 5


def shaken(t, before, after, when):
    """Accelerations at 400 Hz with a line at 90 Hz whose amplitude changes."""
    line = np.sqrt(2.0) * np.where(t < when, before, after) * np.sin(2.0 * np.pi * 90.0 * t)
    columns = ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z")
    return pd.DataFrame(dict.fromkeys(columns, 0.0) | {"accel_z": line - 9.8}, index=t)


@pytest.mark.parametrize(("before", "after", "names"), [(1.0, 15.0, ["vibration-rise"]), (4.0, 8.0, [])])
def test_vibration_that_rises_suddenly_is_timed_also_without_vibe(before, after, names):
    t = np.arange(0.0, 80.0, 0.0025)
    when = 38.2
    found = notable(flown(imu=shaken(t, before, after, when)), {})
    assert [event.id for event in found] == names
    for event in found:
        assert event.t == pytest.approx(when, abs=0.3)
        assert event.evidence["level_m_s2"] == pytest.approx(after, rel=0.05)


def test_battery_low_and_sagging():
    low = table(10.0, voltage=lambda t: np.where(t > 50.0, 10.2, 12.3), current=10.0)
    found = {event.id: event for event in notable(flown(battery=low))}
    assert found["battery-low"].t == pytest.approx(50.1, abs=0.11)
    assert found["battery-sag"].evidence["sag_v"] == pytest.approx(2.1)
    # A power module that reads nonsense from the start is no empty battery.
    assert notable(flown(battery=table(10.0, voltage=9.0, current=10.0), parameters={"BATT_LOW_VOLT": 10.5})) == []


def test_dropped_messages_and_doubts_of_the_estimator():
    counts = table(1.0, Dp=lambda t: np.where(t >= 30.0, 12.0, 0.0))
    event = only("messages-dropped", notable(flown(), {"DSF": counts}))
    assert (event.t, event.evidence["messages"]) == (pytest.approx(30.0, abs=0.01), 12)
    ratios = table(10.0, C=0.0, SV=0.1, SP=between(30.0, 33.0, 1.4, 0.2), SH=0.1, SM=0.1, PI=0.0)
    event = only("estimator-doubt", notable(flown(), {"XKF4": ratios}))
    assert (event.t, event.evidence["quantity"]) == (pytest.approx(30.0, abs=0.11), "position")


def test_columns_that_are_not_numbers_or_all_missing_do_no_harm():
    nothing = dict.fromkeys(("roll", "pitch", "yaw"), np.nan)
    tables = flown(
        attitude=table(10.0, **nothing),
        setpoints=table(10.0, throttle=np.nan, **nothing),
        gps=flown().gps.assign(lat=np.nan, lon=np.nan, fix=np.nan, satellites=np.nan),
        motors=table(10.0, m1=np.nan, m2=np.nan),
        imu=table(25.0, **dict.fromkeys(("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"), np.nan)),
        rates=table(50.0, w_x=np.nan, w_y=np.nan, w_z=np.nan, w_x_ref=np.nan, w_y_ref=np.nan, w_z_ref=np.nan),
        battery=table(10.0, voltage=np.nan, current=np.nan),
        baro=None,
    )
    messages = {"VIBE": table(5.0, VibeX=np.nan, VibeY=np.nan, VibeZ=np.nan, Clip=np.nan)}
    messages |= {"DSF": table(1.0, Dp=np.nan), "XKF4": table(10.0, SV=np.nan)}
    assert notable(tables, messages) == []
