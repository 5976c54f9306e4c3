"""The account of a flight on tables of known course: what happens is named with its time, nothing else is."""

import numpy as np
import pandas as pd
import pytest

from core.findings import Finding
from logparse import Tables, Vehicle
from pipeline.flight.account.account import account_of
from pipeline.flight.account.readings import Readings
from pipeline.results.account import Account
from pipeline.results.span import Span

FLIGHT = Span(10.0, 70.0)
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


def account(tables, messages=None, flight=FLIGHT) -> Account:
    return account_of(Readings(tables, messages or {}, Vehicle(), flight, Span(0.0, 80.0)))


def notable(tables, messages=None, flight=FLIGHT):
    return sorted(account(tables, messages, flight).notable, key=lambda each: each.t)


def only(identity, found) -> Finding:
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
    found = notable(tables, flight=Span(10.0, 42.0))
    assert [event.id for event in found] == ["disarmed-in-air", "fall", "crash"]
    assert found[0].t == 40.0
    assert found[0].evidence["height_m"] == pytest.approx(20.0, abs=0.5)
    assert found[1].end - found[1].t == pytest.approx(2.0, abs=0.15)  # averaged over a tenth of a second
    assert found[2].t == pytest.approx(42.04, abs=0.05)
    assert found[2].evidence["sink_m_s"] > 10.0


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
    assert event.evidence["sink_m_s"] == pytest.approx(speed, abs=0.3)
    assert f"at {speed:.0f} m/s" in event.reason


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
    assert [event.id for event in notable(tables)] == ["control-lost", "shock-in-flight"]


def test_loss_of_control_is_timed_and_what_follows_a_crash_is_left_out():
    roll = between(50.0, 53.0, 1.2)
    imu = flown().imu.copy()
    imu.loc[52.0:52.1, "accel_z"] = -150.0  # and down for good
    course = lambda t: np.interp(t, (0, 10, 14, 50, 52), (0, 0, 20, 20, 0))  # noqa: E731
    baro = table(10.0, alt=course, pressure=1e5, temperature=290.0)
    tables = flown(attitude=table(10.0, roll=roll, pitch=0.0, yaw=0.0), imu=imu, baro=baro)
    found = notable(tables, flight=Span(10.0, 52.05))
    assert [event.id for event in found] == ["control-lost", "crash"]
    assert found[0].t == pytest.approx(50.0, abs=0.11)
    assert found[0].evidence["worst_rad"] == pytest.approx(1.2)
    assert found[1].t == pytest.approx(52.0, abs=0.05)


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
    assert {event.id for event in notable(flown(attitude=swinging))} == {"control-lost"}


def test_a_throttle_that_was_closed_lets_a_craft_fall():
    imu = flown().imu.assign(accel_z=between(30.0, 30.8, -0.5, -9.8)(flown().imu.index.to_numpy()))
    closed = table(10.0, roll=0.0, pitch=0.0, yaw=0.0, throttle=between(30.0, 30.8, 0.0, 0.35))
    assert notable(flown(imu=imu, setpoints=closed)) == []
    assert only("fall", notable(flown(imu=imu))).t == pytest.approx(30.0, abs=0.05)


def test_flips_are_no_loss_of_control():
    modes = pd.DataFrame({"mode": ["LOITER", "FLIP", "LOITER"]}, index=pd.Index([0.0, 49.0, 54.0], name="t"))
    roll = between(50.0, 53.0, 3.0)
    assert notable(flown(attitude=table(10.0, roll=roll, pitch=0.0, yaw=0.0), modes=modes)) == []


def test_heading_does_not_count_as_a_deviation():
    assert notable(flown(attitude=table(10.0, roll=0.0, pitch=0.0, yaw=2.0))) == []


def test_yaw_that_runs_away_is_told_from_a_stick_let_go():
    spins = between(30.0, 33.0, 4.0)
    rates = table(50.0, w_x_ref=0.0, w_y_ref=0.0, w_z_ref=0.0, w_x=0.0, w_y=0.0, w_z=spins)
    event = only("yaw-lost", notable(flown(rates=rates)))
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


def test_lack_of_lift_shows_in_the_barometer_and_the_motors_alone():
    # Neither an estimate of speed nor a throttle is logged: all motors at full output from 30 to 34 s, 2 m/s down.
    course = lambda t: np.interp(t, (0, 10, 14, 30, 34, 55, 70), (0, 0, 20, 20, 12, 12, 0))  # noqa: E731
    noise = np.random.default_rng(3).normal(0.0, 0.1, 800)
    motors = table(10.0, **{f"m{k}": between(30.0, 34.0, 1950.0, 1500.0) for k in range(1, 5)})
    baro = table(10.0, alt=lambda t: course(t) + noise, pressure=1e5, temperature=290.0)
    found = notable(flown(motors=motors, setpoints=None, baro=baro))
    event = next(each for each in found if each.id == "lift-lost")
    assert (event.t, event.end) == pytest.approx((30.0, 34.0), abs=0.5)
    assert event.evidence["sink_m_s"] == pytest.approx(2.0, abs=0.5)
    # The same descent at the throttle of hover is a descent.
    assert notable(flown(setpoints=None, baro=baro)) == []


def shaken(t, before, after, when):
    """Accelerations at 400 Hz with a line at 90 Hz whose amplitude changes."""
    line = np.sqrt(2.0) * np.where(t < when, before, after) * np.sin(2.0 * np.pi * 90.0 * t)
    columns = ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z")
    return pd.DataFrame(dict.fromkeys(columns, 0.0) | {"accel_z": line - 9.8}, index=t)


@pytest.mark.parametrize(("before", "after", "names"), [(1.0, 15.0, ["vibration"]), (4.0, 8.0, [])])
def test_vibration_that_rises_suddenly_is_timed_also_without_vibe(before, after, names):
    t = np.arange(0.0, 80.0, 0.0025)
    when = 38.2
    found = notable(flown(imu=shaken(t, before, after, when)), {})
    assert [event.id for event in found] == names
    for event in found:
        assert event.t == pytest.approx(when, abs=0.3)
        assert event.evidence["level_m_s2"] == pytest.approx(after, rel=0.05)


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


def test_errors_are_reported_once_and_on_the_ground_only_noted():
    events = events_at(
        (5.0, "ERROR", "COMPASS 1"),
        (30.0, "ERROR", "FAILSAFE_RADIO 1"),
        (33.0, "ERROR", "FAILSAFE_RADIO 0"),
        (35.0, "ERROR", "FAILSAFE_RADIO 1"),
        (40.0, "MESSAGE", "Battery 1 is low 10.1V used 4000 mAh"),
    )
    found = account(flown(events=events))
    failsafes = [each for each in found.notable if each.id == "failsafe"]
    assert [(each.t, each.evidence["subsystem"], each.evidence["times"]) for each in failsafes] == [
        (30.0, "FAILSAFE_RADIO", 2),
        (40.0, "FAILSAFE_BATTERY", 1),
    ]
    assert [each.evidence["subsystem"] for each in found.happenings if not each.notable] == ["COMPASS"]
    assert "radio failsafe" in found.headline


def test_sinking_under_full_throttle_is_lift_lost_and_at_a_lean_it_is_not():
    course = lambda t: np.interp(t, (0, 10, 14, 30, 34, 55, 70), (0, 0, 20, 20, 12, 12, 0))  # noqa: E731
    baro = table(10.0, alt=course, pressure=1e5, temperature=290.0)
    full = between(30.0, 34.0, 1.0, 0.35)
    event = only(
        "lift-lost", notable(flown(baro=baro, setpoints=table(10.0, roll=0.0, pitch=0.0, yaw=0.0, throttle=full)))
    )
    assert (event.t, event.end) == pytest.approx((30.0, 34.0), abs=0.5)
    lean = np.radians(40.0)
    asked = table(10.0, roll=lean, pitch=0.0, yaw=0.0, throttle=full)
    assert notable(flown(baro=baro, setpoints=asked, attitude=table(10.0, roll=lean, pitch=0.0, yaw=0.0))) == []


def test_throttle_that_runs_away_is_the_autopilots_when_its_height_fell_behind():
    course = lambda t: np.interp(t, (0, 10, 14, 30, 34, 55, 70), (0, 0, 10, 10, 40, 40, 0))  # noqa: E731
    wrong = lambda t: -np.interp(t, (0, 10, 14, 30, 34, 55, 70), (0, 0, 10, 10, 0, 0, -40))  # noqa: E731
    baro = table(10.0, alt=course, pressure=1e5, temperature=290.0)
    setpoints = table(10.0, roll=0.0, pitch=0.0, yaw=0.0, throttle=between(30.0, 34.0, 1.0, 0.35))
    names = ("p_n", "p_e", "v_n", "v_e", "v_d")
    ekf = table(10.0, **dict.fromkeys(names, 0.0), p_d=wrong)
    found = account(flown(baro=baro, setpoints=setpoints, ekf=ekf))
    assert [each.id for each in found.story] == ["throttle-runaway"]
    assert found.height.value == pytest.approx(40.0, abs=0.5)
    assert found.height.others["autopilot"] == pytest.approx(10.0, abs=0.5)
    # Of a pilot's own full throttle nothing is said.
    modes = pd.DataFrame({"mode": ["STABILIZE"]}, index=pd.Index([0.0], name="t"))
    assert account(flown(baro=baro, setpoints=setpoints, ekf=ekf, modes=modes)).story == ()


def test_doubts_of_the_estimator_are_remarks_and_no_story():
    ratios = table(10.0, C=0.0, SV=0.1, SP=between(30.0, 33.0, 1.4, 0.2), SH=0.1, SM=0.1, PI=0.0)
    found = account(flown(), {"XKF4": ratios})
    event = only("estimator-doubt", found.notable)
    assert (event.t, event.evidence["quantity"]) == (pytest.approx(30.0, abs=0.11), "position")
    assert found.story == ()
    assert found.headline.startswith("Nothing happened in 60 s of flight, up to 20 m high")


def test_the_state_of_the_craft_is_read_off():
    vibe = table(5.0, IMU=0.0, VibeX=10.0, VibeY=12.0, VibeZ=between(30.0, 35.0, 45.0, 15.0), Clip=0.0)
    vibe["Clip"] = np.where(vibe.index >= 50.0, 7.0, 2.0)
    motors = table(10.0, m1=between(30.0, 34.0, 1950.0, 1500.0), m2=1500.0, m3=1500.0, m4=1500.0)
    voltage = lambda t: np.where(t < 10.0, 12.4, np.where(t > 70.0, 11.9, 11.5 - 0.01 * (t - 10.0)))  # noqa: E731
    # Damage puts rows in another order: a slice of them by time was an unexpected error.
    shuffled = vibe.iloc[np.random.default_rng(0).permutation(len(vibe))]
    found = account(flown(motors=motors, battery=table(10.0, voltage=voltage, current=10.0)), {"VIBE": shuffled})
    assert (found.vibration.worst, found.vibration.axis, found.vibration.clips) == (45.0, "Z", 5)
    assert (found.battery.start, found.battery.end, found.battery.cells) == (12.4, 11.9, 3)
    assert found.battery.lowest == pytest.approx(10.9, abs=0.01)
    assert (found.motors.hardest, found.motors.at_limit) == ("1", pytest.approx(4.0 / 60.0, abs=0.01))
    assert found.gps.satellites_least == 12
    assert found.hover.start == pytest.approx(0.35)
    assert found.hover.thrust_to_weight == pytest.approx(1.0 / 0.35)
    # A constant is no battery: nothing loads it.
    assert account(flown()).battery is None


def test_a_log_that_lacks_sensors_says_so_and_goes_on():
    found = account(Tables(attitude=flown().attitude))
    assert found.height is None
    assert any("barometer" in each for each in found.unknown)
    assert found.headline == "Nothing happened in 60 s of flight."
