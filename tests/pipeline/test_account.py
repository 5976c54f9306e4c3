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
from tests.timed import timed

FLIGHT = Span(10.0, 70.0)
PARAMETERS = {"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0, "MOT_SPIN_MIN": 0.15, "MOT_SPIN_MAX": 0.95}


def table(rate: float, **columns):
    """Make a table from 0 to 80 s whose columns are functions of time, or constants."""
    t = np.arange(0.0, 80.0, 1.0 / rate)
    return timed(t, **{name: value(t) if callable(value) else value for name, value in columns.items()})


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
        "modes": timed([0.0], mode=["LOITER"]),
        "parameters": PARAMETERS,
    }
    return Tables(**(parts | changes))


def events_at(*rows):
    """Make a table of events of (time, event, detail)."""
    times, names, details = zip(*rows, strict=True)
    return timed(times, event=pd.array(names, dtype="str"), detail=pd.array(details, dtype="str"))


def account(tables, messages=None, flight=FLIGHT) -> Account:
    return account_of(Readings(tables, messages or {}, Vehicle(), flight, Span(0.0, 80.0)))


def notable(tables, messages=None, flight=FLIGHT):
    return sorted(account(tables, messages, flight).notable, key=lambda event: event.t)


def only(identity, events) -> Finding:
    assert [event.id for event in events] == [identity]
    return events[0]


def told(**changes):
    """Return what is notable of a flight with these changes, as (id, first, last)."""
    return [(event.id, event.t, event.end) for event in notable(flown(**changes))]


def struck(*blows, imu=None):
    """Return the IMU with blows of (first, last, m/s^2)."""
    imu = (flown().imu if imu is None else imu).copy()
    for first, last, force in blows:
        imu.loc[first:last, "accel_z"] = -force
    return imu


def baro_of(*points, noise=0.0):
    """Return a barometer over a course of (time, height); none repeats itself exactly."""
    times, heights = zip((0, 0), (10, 0), (14, 20), *points, strict=True)
    alt = lambda t: np.interp(t, times, heights) + noise + 0.01 * np.sin(9.0 * t)  # noqa: E731
    return table(10.0, alt=alt, pressure=1e5, temperature=290.0)


def leaning(roll, pitch=0.0, **throttle):
    return table(10.0, roll=roll, pitch=pitch, yaw=0.0, **throttle)


def turning(**rates):
    return table(50.0, **(dict.fromkeys(("w_x_ref", "w_y_ref", "w_z_ref", "w_x", "w_y", "w_z"), 0.0) | rates))


def between(first, last, inside, outside=0.0):
    return lambda t: np.where((t >= first) & (t < last), inside, outside)


def test_a_healthy_flight_has_no_notable_event():
    assert notable(flown()) == []
    # A receiver may rest on the ground without a fix, and one that never had one loses none; heading is no deviation.
    gps = flown().gps.copy()
    gps.loc[:5.0, "fix"] = 0.0
    assert told(gps=gps, events=events_at((70.3, "DISARMED", ""))) == []
    assert told(gps=gps.assign(fix=0.0, satellites=0.0), attitude=table(10.0, roll=0.0, pitch=0.0, yaw=2.0)) == []


def test_disarming_in_the_air_ends_in_a_crash():
    # Falls 10 m from t = 40 on: 1.43 s.
    def falling(t):
        return np.where(t < 40.0, height(t), np.maximum(20.0 - 0.5 * 9.8 * (t - 40.0) ** 2, 0.0))

    imu = struck((40.0, 42.0, 0.0), (42.02, 42.1, 120.0))
    baro = table(10.0, alt=falling, pressure=1e5, temperature=290.0)
    tables = flown(imu=imu, baro=baro, events=events_at((40.0, "DISARMED", "")))
    events = notable(tables, flight=Span(10.0, 42.0))
    assert [event.id for event in events] == ["disarmed-in-air", "crash"]
    assert events[0].t == 40.0
    assert events[0].evidence["height_m"] == pytest.approx(20.0, abs=0.5)
    assert events[1].t == pytest.approx(42.04, abs=0.05)
    assert events[1].evidence["sink_m_s"] > 10.0


@pytest.mark.parametrize(("speed", "expected"), [(0.0, "hard-landing"), (4.8, "hard-landing"), (7.5, "crash")])
def test_an_upright_craft_that_comes_down_fast_has_landed_hard_and_from_a_fall_it_has_crashed(speed, expected):
    baro = baro_of((69.8 - 20.0 / speed, 20), (69.8, 0)) if speed else flown().baro
    event = only(expected, notable(flown(imu=struck((69.8, 69.85, 80.0)), baro=baro)))
    assert event.t == pytest.approx(69.8, abs=0.05)
    assert event.evidence["sink_m_s"] == pytest.approx(speed or 1.3, abs=0.3)


def test_a_craft_that_comes_to_rest_on_its_side_has_crashed_whatever_shows_it():
    attitude = leaning(between(70.2, 80.0, 1.5))
    assert only("crash", notable(flown(attitude=attitude, imu=None))).evidence["lean_rad"] == pytest.approx(1.5)
    lying = struck((69.8, 69.85, 60.0))
    lying.loc[70.2:, ["accel_y", "accel_z"]] = [9.8, 0.0]
    assert only("crash", notable(flown(attitude=None, imu=lying))).evidence["lean_rad"] == pytest.approx(np.pi / 2.0)


def test_a_touch_from_which_the_craft_rises_again_is_no_crash():
    baro = baro_of((38, 20), (40, 0), (44, 20), (55, 20), (70, 0))
    events = notable(flown(imu=struck((40.0, 40.1, 60.0)), attitude=leaning(between(39.0, 40.2, 0.6)), baro=baro))
    assert [event.id for event in events] == ["control-lost", "shock-in-flight"]


def test_loss_of_control_is_timed_and_what_follows_a_crash_is_left_out():
    tables = flown(
        attitude=leaning(between(50.0, 53.0, 1.2)), imu=struck((52.0, 52.1, 150.0)), baro=baro_of((50, 20), (52, 0))
    )
    events = notable(tables, flight=Span(10.0, 52.05))
    assert [event.id for event in events] == ["control-lost", "crash"]
    assert events[0].t == pytest.approx(50.0, abs=0.11)
    assert events[0].evidence["worst_rad"] == pytest.approx(1.2)
    assert events[1].t == pytest.approx(52.0, abs=0.05)


def test_swings_again_and_again_are_loss_of_control_and_one_of_them_is_not():
    """Pitch swung by 50 degrees at 0.7 Hz for ten seconds, a third of a second beyond 30 at a time (5-12-2014_218)."""
    swing = lambda t: np.where((t > 30.0) & (t < 40.0), np.radians(40.0) * np.sin(1.4 * np.pi * t) ** 9, 0.0)  # noqa: E731
    event = only("control-lost", notable(flown(attitude=leaning(0.0, swing))))
    assert (event.t, event.end) == pytest.approx((30.5, 39.5), abs=1.0)
    assert "swung" in event.reason
    once = lambda t: np.where((t > 30.0) & (t < 30.7), swing(t), 0.0)  # noqa: E731
    assert told(attitude=leaning(0.0, once)) == []
    # What is off in one row, as where telemetry lost what was asked for, is off for no time.
    lone = lambda t: np.where(np.abs(t - 35.2) < 0.01, 1.2, 0.0)  # noqa: E731
    rows = flown().attitude.index[::4]
    assert told(attitude=leaning(0.0, lone).loc[rows], setpoints=flown().setpoints.loc[rows]) == []
    # Of two rows a second nobody knows what was asked for between them.
    assert told(attitude=leaning(0.0, swing).iloc[::5], setpoints=flown().setpoints.iloc[::5]) == []


def thrown(t):
    """Sticks thrown from stop to stop, 45 degrees, every one and a half seconds."""
    return np.radians(45.0) * np.sign(np.sin(2.0 * np.pi * t / 3.0))


def followed(t, tau=0.35):
    """Attitude of a craft that follows the sticks of `thrown` as a first-order lag of `tau` seconds."""
    target, flown_, step = thrown(t), np.zeros(len(t)), t[1] - t[0]
    for k in range(1, len(t)):
        flown_[k] = flown_[k - 1] + (target[k] - flown_[k - 1]) * (1.0 - np.exp(-step / tau))
    return flown_


def test_a_pilot_who_throws_the_stick_about_or_flips_or_cuts_the_throttle_does_not_lose_control():
    assert told(setpoints=leaning(thrown, throttle=0.35), attitude=leaning(followed)) == []
    # The target rests, and the craft swings as far for a while.
    swinging = leaning(lambda t: np.where((t > 30.0) & (t < 36.0), followed(t), 0.0))
    assert {event for event, *_ in told(attitude=swinging)} == {"control-lost"}
    modes = timed([0.0, 49.0, 54.0], mode=["LOITER", "FLIP", "LOITER"])
    assert told(attitude=leaning(between(50.0, 53.0, 3.0)), modes=modes) == []
    closed = leaning(0.0, throttle=between(50.0, 52.5, 0.0, 0.35))
    assert told(attitude=leaning(between(50.5, 53.0, 1.0)), setpoints=closed) == []


def test_yaw_that_runs_away_is_told_from_a_stick_let_go():
    motors = table(10.0, m1=1500.0, m2=1500.0, m3=between(30.0, 33.2, 1150.0, 1500.0), m4=1500.0)
    event = only("yaw-lost", notable(flown(rates=turning(w_z=between(30.0, 33.0, 4.0)), motors=motors)))
    assert (event.t, event.end) == pytest.approx((30.0, 33.0), abs=0.1)
    assert event.reason.endswith("motor 3 at its minimum.")
    # A yaw stick let go at 30 s: the craft slows down from 3 rad/s within half a second.
    slowing = lambda t: np.where(t < 30.0, 3.0, 3.0 * np.exp(-(t - 30.0) / 0.5))  # noqa: E731
    assert told(rates=turning(w_z_ref=between(0.0, 30.0, 3.0), w_z=slowing)) == []


@pytest.mark.parametrize("hz", [4.0, 18.0])
def test_an_oscillation_is_named_with_axis_and_frequency(hz):
    swing = lambda t: np.where((t > 30.0) & (t < 40.0), np.sin(2.0 * np.pi * hz * t), 0.0)  # noqa: E731
    event = only("oscillation", notable(flown(rates=turning(w_y=swing))))
    assert event.evidence["axis"] == "pitch"
    assert event.evidence["frequency_hz"] == pytest.approx(hz, abs=0.5)
    assert event.evidence["amplitude_rad_s"] == pytest.approx(1.0, rel=0.1)
    assert (event.t, event.end) == pytest.approx((30.0, 40.0), abs=1.1)


def test_what_was_asked_for_and_noise_are_no_oscillation():
    swing = lambda t: np.sin(2.0 * np.pi * 3.0 * t)  # noqa: E731
    assert told(rates=turning(w_x_ref=swing, w_x=swing)) == []
    # A chirp of SYSTEMID enters behind the target.
    assert told(rates=turning(w_x=swing), systemid=table(50.0, axis=10.0, target=swing)) == []
    rng = np.random.default_rng(1)
    assert told(rates=turning(**{f"w_{axis}": lambda t: rng.normal(0.0, 0.5, len(t)) for axis in "xyz"})) == []


@pytest.mark.parametrize(("rate", "target"), [(25.0, "swung"), (10.0, "swung"), (25.0, "level"), (4.0, "level")])
def test_sticks_swung_by_hand_are_no_oscillation_where_only_angles_have_targets(rate, target):
    def swung(t):
        return np.where((t > 30.0) & (t < 40.0), np.radians(4.0) * np.sin(2.0 * np.pi * 2.5 * t), 0.0)

    gyro = flown().imu.assign(gyro_x=np.gradient(swung(flown().imu.index.to_numpy()), 1.0 / 25.0))
    asked = table(rate, roll=swung if target == "swung" else 0.0, pitch=0.0, yaw=0.0, throttle=0.35)
    events = told(rates=None, imu=gyro, attitude=table(25.0, roll=swung, pitch=0.0, yaw=0.0), setpoints=asked)
    # A target that is logged slower than the swing does not tell whether it was asked for.
    assert [event for event, *_ in events] == (["oscillation"] if (rate, target) == (25.0, "level") else [])


def test_a_jammed_receiver_is_timed():
    gps = flown().gps.copy()
    gps.loc[40.0:46.0, ["fix", "satellites"]] = [1.0, 3.0]
    gps.loc[43.0, ["fix", "satellites"]] = [3.0, 10.0]  # one stray fix does not end it
    event = only("gps-lost", notable(flown(gps=gps)))
    assert (event.t, event.end) == pytest.approx((40.0, 46.0), abs=0.21)
    assert event.evidence["satellites_before"] == 12.0
    assert "jammed" in event.reason
    # Lost with two rows, of which nothing was heard again, it was lost to the end (7-9-2014_24).
    gps = gps.loc[:40.3]
    event = only("gps-lost", notable(flown(gps=gps)))
    assert (event.t, event.end) == pytest.approx((40.0, 70.0), abs=0.21)
    # Rows that damage changed are no loss, and who flew without a fix from the start loses none.
    gps = flown().gps.copy()
    gps.loc[[43.0, 44.0], ["fix", "satellites"]] = 0.0
    gps.loc[50.0, "lat"], gps.loc[50.2, "satellites"] = np.nan, 2.0
    assert told(gps=gps) == told(gps=gps.loc[:5.0]) == []


def test_a_glitch_is_a_jump_against_its_own_speed():
    gps = flown().gps.copy()
    assert account(flown(gps=gps)).distance is None  # a position that never moves at all has stopped
    gps = gps.assign(lat=0.8 + 1e-7 * gps.index.to_numpy(), v_n=0.64)
    gps.loc[40.0:, "lat"] += 30.0 / 6.371e6
    event = only("gps-glitch", notable(flown(gps=gps)))
    assert event.t == pytest.approx(40.0, abs=0.01)
    assert event.evidence["jump_m"] == pytest.approx(30.0, abs=1.0)
    # Where it leapt to, the craft has not been, for good or for a while.
    assert account(flown(gps=gps)).distance.value == pytest.approx(0.64 * 60.0, abs=1.0)
    gps.loc[44.0:, "lat"] -= 30.0 / 6.371e6
    assert account(flown(gps=gps)).distance.value == pytest.approx(0.64 * 60.0, abs=1.0)
    # One fix alone that leads back is damage, also beside one whose speed is not known.
    lone = gps.assign(lat=0.8 + 1e-7 * gps.index.to_numpy())
    row = int(np.argmax(lone.index >= 40.0))
    lone.iloc[row, lone.columns.get_loc("lat")] += 30.0 / 6.371e6
    lone.iloc[row - 1, lone.columns.get_loc("v_n")] = np.nan
    assert not notable(flown(gps=lone))
    # It leapt before its fix was lost, and was right when it came back (gps_jam_octa).
    jammed = gps.assign(fix=np.where((gps.index > 41.0) & (gps.index < 46.0), 1.0, 3.0))
    assert account(flown(gps=jammed)).distance.value == pytest.approx(0.64 * 60.0, abs=1.0)
    # Nor is it believed while the autopilot does not.
    checked = flown(gps=gps, events=events_at((30.0, "ERROR", "GPS 2"), (65.0, "ERROR", "GPS 2")))
    assert account(checked).distance.value == pytest.approx(0.64 * 19.0, abs=1.0)
    # Flown at 15 m/s the same way is no jump.
    assert told(gps=gps.assign(v_n=15.0, lat=0.8 + 15.0 * gps.index.to_numpy() / 6.371e6)) == []


def test_an_estimate_that_stands_at_zero_is_no_height_though_one_row_is_damaged():
    ekf = table(10.0, p_n=0.0, p_e=0.0, p_d=0.0, v_n=0.0, v_e=0.0, v_d=0.0)
    ekf.loc[40.0, "p_d"] = -64.0
    read = account(flown(baro=None, ekf=ekf)).height
    assert read.source == "GPS"
    assert read.others == {}


def test_a_silent_receiver_is_told_from_a_log_that_stopped():
    def cut(name):
        frame = getattr(flown(), name)
        return frame[(frame.index < 40.0) | (frame.index > 46.0)]

    event = only("gps-lost", notable(flown(gps=cut("gps"))))
    assert (event.t, event.end) == pytest.approx((39.8, 46.2), abs=0.21)
    assert told(gps=cut("gps"), attitude=cut("attitude")) == []
    # Telemetry repeats what the receiver said last: what is missing the link has lost.
    assert notable(flown(gps=cut("gps")), {"GPS_RAW_INT": cut("gps")}) == []


def test_lack_of_lift_shows_in_the_barometer_and_the_motors_alone():
    # Neither an estimate of speed nor a throttle is logged: all motors at full output from 30 to 34 s, 2 m/s down.
    baro = baro_of((30, 20), (34, 12), (55, 12), (70, 0), noise=np.random.default_rng(3).normal(0.0, 0.1, 800))
    motors = table(10.0, **{f"m{k}": between(30.0, 34.0, 1950.0, 1500.0) for k in range(1, 5)})
    event = next(
        sinking for sinking in notable(flown(motors=motors, setpoints=None, baro=baro)) if sinking.id == "lift-lost"
    )
    assert (event.t, event.end) == pytest.approx((30.0, 34.0), abs=0.5)
    assert event.evidence["sink_m_s"] == pytest.approx(2.0, abs=0.5)
    # The same descent at the throttle of hover is a descent.
    assert told(setpoints=None, baro=baro) == []


@pytest.mark.parametrize("throttle", [1.0, 0.6])
def test_sinking_under_more_throttle_than_usual_is_lift_lost_unless_it_leans_or_is_caught(throttle):
    baro, more = baro_of((30, 20), (34, 12), (55, 12), (70, 0)), between(30.0, 34.0, throttle, 0.35)
    event = only("lift-lost", notable(flown(baro=baro, setpoints=leaning(0.0, throttle=more))))
    assert (event.t, event.end) == pytest.approx((30.0, 34.0), abs=0.5)
    lean = np.radians(40.0)
    assert told(baro=baro, setpoints=leaning(lean, throttle=more), attitude=leaning(lean)) == []
    caught = table(10.0, alt=lambda t: 20.0 - 8.0 * np.clip(t - 30.0, 0.0, None) * np.exp(-0.7 * (t - 30.0)))
    assert (
        told(baro=caught.assign(alt=np.where(abs(caught.index - 34.0) < 20.0, caught["alt"], height(caught.index))))
        == []
    )


def climbing(**asked):
    """Return a craft that climbs by 30 m under full throttle, whose own height falls."""
    baro = baro_of((30, 20), (34, 50), (55, 50), (70, 0))
    wrong = lambda t: -np.interp(t, (0, 10, 14, 30, 34, 55, 70), (0, 0, 20, 20, 10, 10, -40))  # noqa: E731
    ekf = table(10.0, **dict.fromkeys(("p_n", "p_e", "v_n", "v_e", "v_d"), 0.0), p_d=wrong)
    setpoints = leaning(0.0, throttle=between(30.0, 34.0, 1.0, 0.35), **asked)
    return {"baro": baro, "setpoints": setpoints, "ekf": ekf}


def test_throttle_that_runs_away_is_the_autopilots_when_no_climb_was_asked_for():
    flight_account = account(flown(**climbing()))
    assert [event.id for event in flight_account.story] == ["throttle-runaway"]
    assert "behind the barometer's" in flight_account.headline
    assert flight_account.height.value == pytest.approx(50.0, abs=0.5)
    assert flight_account.height.others["autopilot"] == pytest.approx(20.0, abs=0.5)
    assert "unasked" in account(flown(**climbing(p_d=-20.0) | {"ekf": None})).headline
    # Of a climb that was asked for, and of a pilot's own full throttle, nothing is said.
    modes = timed([0.0], mode=["STABILIZE"])
    assert account(flown(**climbing(v_d=-5.0))).story == account(flown(**climbing(), modes=modes)).story == ()
    # A hole may have swallowed that the pilot took over (6-3-2014_7 with 140 to 155 s cut out).
    tables = {name: getattr(flown(**climbing()), name) for name in ("attitude", "baro", "ekf", "modes", "setpoints")}
    cut = {name: rows[(rows.index < 20.0) | (rows.index > 26.0)] for name, rows in tables.items()}
    assert [event.id for event in account(Tables(**cut)).notable] == ["height-estimate-wrong"]


def shaken(rate, before, after, when):
    """Accelerations with a line at a quarter of their rate whose amplitude changes."""
    t = np.arange(0.0, 80.0, 1.0 / rate)
    line = np.sqrt(2.0) * np.where(t < when, before, after) * np.sin(0.5 * np.pi * rate * t)
    columns = ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z")
    return pd.DataFrame(dict.fromkeys(columns, 0.0) | {"accel_z": line - 9.8}, index=t)


@pytest.mark.parametrize(
    ("rate", "before", "after", "names"),
    [(400.0, 1.0, 15.0, ["vibration"]), (400.0, 4.0, 8.0, []), (50.0, 0.5, 2.0, ["vibration"])],
)
def test_vibration_that_rises_suddenly_is_timed_also_without_vibe(rate, before, after, names):
    events = notable(flown(imu=shaken(rate, before, after, 38.2)))
    assert [event.id for event in events] == names
    for event in events:
        assert event.t == pytest.approx(38.2, abs=0.3)
        # A first-order filter at 5 Hz takes a part of what is at 12 Hz.
        assert event.evidence["level_m_s2"] == pytest.approx(after, rel=0.05 if rate > 100.0 else 0.4)


def test_vibration_that_passes_is_told_in_the_words_of_the_autopilot_alone():
    burst = table(10.0, VibeX=0.0, VibeY=0.0, VibeZ=lambda t: 16.0 + 33.0 * ((t > 30.0) & (t < 36.5)))
    assert notable(flown(), {"VIBE": burst}) == []
    events = events_at((31.0, "MESSAGE", "Vibration compensation ON"), (38.0, "MESSAGE", "Vibration compensation OFF"))
    event = only("failsafe", notable(flown(events=events), {"VIBE": burst}))
    assert (event.t, event.end) == (31.0, 31.0)


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
    flight_account = account(flown(events=events))
    failsafes = [event for event in flight_account.notable if event.id == "failsafe"]
    assert [(failsafe.t, failsafe.evidence["subsystem"], failsafe.evidence["times"]) for failsafe in failsafes] == [
        (30.0, "FAILSAFE_RADIO", 2),
        (40.0, "FAILSAFE_BATTERY", 1),
    ]
    assert [happening.evidence["subsystem"] for happening in flight_account.happenings if not happening.notable] == [
        "COMPASS"
    ]
    assert "radio failsafe" in flight_account.headline


@pytest.mark.parametrize(
    ("text", "subsystem"),
    [
        ("Failsafe enabled: no RC", "FAILSAFE_RADIO"),
        ("Failsafe enabled: no datalink", "FAILSAFE_GCS"),
        ("Critical battery level! Return now", "FAILSAFE_BATTERY"),
        ("Failsafe activated: Autopilot disengaged, switching to Descend", "FAILSAFE"),
    ],
)
def test_failsafes_of_px4_are_in_its_texts(text, subsystem):
    event = only("failsafe", notable(flown(events=events_at((40.0, "MESSAGE", text)))))
    assert event.evidence["subsystem"] == subsystem


def test_a_craft_that_was_caught_hits_the_ground_as_it_sank_last():
    """4 m/s a second and a half before the blow, and 1 m/s at last (31-3-2015_83)."""
    caught = table(10.0, alt=lambda t: np.interp(t, (0, 10, 14, 65, 69, 70), (0.0, 0.0, 20.0, 17.0, 1.0, 0.0)))
    imu = flown().imu.copy()
    imu.loc[70.0, "accel_z"] = -70.0
    landing = only("hard-landing", notable(flown(baro=caught, imu=imu)))
    assert landing.evidence["sink_m_s"] == pytest.approx(1.0, abs=0.3)


def test_the_state_of_the_craft_is_read_off():
    vibe = table(5.0, IMU=0.0, VibeX=10.0, VibeY=12.0, VibeZ=between(30.0, 35.0, 45.0, 15.0), Clip=0.0)
    vibe["Clip"] = np.where(vibe.index >= 50.0, 7.0, 2.0)
    motors = table(10.0, m1=between(30.0, 34.0, 1950.0, 1500.0), m2=1500.0, m3=1500.0, m4=1500.0)
    voltage = lambda t: np.where(t < 10.0, 12.4, np.where(t > 70.0, 11.9, 11.5 - 0.01 * (t - 10.0)))  # noqa: E731
    # Damage puts rows in another order: a slice of them by time was an unexpected error.
    shuffled = vibe.iloc[np.random.default_rng(0).permutation(len(vibe))]
    flight_account = account(
        flown(motors=motors, battery=table(10.0, voltage=voltage, current=10.0)), {"VIBE": shuffled}
    )
    assert (flight_account.vibration.worst, flight_account.vibration.axis, flight_account.vibration.clips) == (
        45.0,
        "Z",
        5,
    )
    assert (flight_account.battery.start, flight_account.battery.end, flight_account.battery.cells) == (12.4, 11.9, 3)
    assert flight_account.battery.lowest == pytest.approx(10.9, abs=0.01)
    assert (flight_account.motors.hardest, flight_account.motors.at_limit) == ("1", pytest.approx(4.0 / 60.0, abs=0.01))
    assert flight_account.gps.satellites_least == 12
    assert flight_account.hover.start == pytest.approx(0.35)
    # A constant is no battery: nothing loads it.
    assert account(flown()).battery is None


def test_a_log_that_lacks_sensors_says_so_and_goes_on():
    flight_account = account(Tables(attitude=flown().attitude))
    assert flight_account.height is None
    assert any("barometer" in sentence for sentence in flight_account.unknown)
    assert flight_account.headline == "Nothing happened in 60 s of flight."
    # Where neither shocks nor attitude are known, a crash would not be seen.
    assert not account(Tables(baro=flown().baro)).headline.startswith("Nothing happened")
    slow = "motor outputs or the IMU too slow: no motor was looked at"
    assert slow not in account(flown()).unknown
    assert slow in account(flown(motors=flown().motors.iloc[::10])).unknown


def test_a_log_that_was_cut_in_the_air_says_so():
    tables = {name: getattr(flown(), name) for name in ("baro", "imu", "attitude")}
    for part, words in ((slice(20.0, None), "begins"), (slice(None, 50.0), "ends")):
        cut = Tables(**{name: rows.loc[part] for name, rows in tables.items()})
        flight = Span(max(10.0, part.start or 0.0), min(70.0, part.stop or 70.0))
        assert account(cut, flight=flight).headline.endswith(f"The log {words} in the air.")
    cut = Tables(**{name: rows[(rows.index < 30.0) | (rows.index > 50.0)] for name, rows in tables.items()})
    assert account(cut).headline.endswith("of flight, up to 20 m high. Nothing was logged from 30 to 50 s.")
    # In level flight alone no ground tells how high it is.
    tables["baro"] = baro_of((55, 20), (70, 0), noise=0.1 * np.sin(np.arange(800)))
    level = account(Tables(**{name: rows.loc[30.0:50.0] for name, rows in tables.items()}), flight=Span(30.0, 50.0))
    assert level.headline == "Nothing happened in 20 s of flight. The log begins in the air. The log ends in the air."
    assert level.height is None
    assert "the ground is not in the log: how high it flew" in level.unknown
    # A hill on which it lands is no air.
    landed = flown(baro=table(10.0, alt=lambda t: np.maximum(height(t), np.where(t > 40.0, 5.0, 0.0))))
    assert "air" not in account(landed).headline


@pytest.mark.parametrize(
    ("changes", "source"),
    [
        ({}, "barometer"),
        ({"baro": None}, "GPS"),
        (
            {"baro": baro_of((55, 0), (70, 0)).assign(alt=3.0), "ekf": table(10.0, p_d=lambda t: -height(t))},
            "autopilot",
        ),
        # Motion capture gives it; propellers feign metres to the barometer indoors.
        (
            {
                "baro": table(10.0, alt=lambda t: 1.5 * height(t)),
                "ekf": table(10.0, p_d=lambda t: -height(t)),
                "parameters": PARAMETERS | {"EKF2_HGT_REF": 3.0},
            },
            "autopilot",
        ),
    ],
)
def test_heights_and_speeds_are_of_sources_that_can_be_believed(changes, source):
    """Vibration drags the inertial height by 20 m (31-3-2015_83), nine satellites jump to 72 m/s (26-11-2014_181)."""
    speed = lambda t: 3.0 + 5.0 * ((t > 20.0) & (t < 23.0)) + 40.0 * ((t > 30.0) & (t < 30.5))  # noqa: E731
    spiked = flown().gps.assign(v_n=speed(flown().gps.index.to_numpy()))
    flight_account = account(flown(gps=spiked, **changes))
    assert (flight_account.height.source, flight_account.height.value) == (source, pytest.approx(20.0, abs=0.3))
    assert flight_account.ground_speed.value == pytest.approx(8.0)
    assert (flight_account.climb.value, flight_account.sink.value) == pytest.approx((5.0, 4.0 / 3.0), abs=0.3)
    assert account(flown(gps=spiked.assign(hdop=5.0), **changes)).ground_speed is None


def test_rows_of_a_height_that_damage_changed_are_no_height():
    spiked = lambda t: height(t) + 300.0 * np.isin(np.round(10.0 * t), (300, 340, 500))  # noqa: E731
    tables = flown(baro=table(10.0, alt=spiked), ekf=table(10.0, p_d=lambda t: -height(t)))
    flight_account = account(tables)
    assert flight_account.notable == ()
    assert (flight_account.height.value, flight_account.climb.value) == pytest.approx((20.0, 5.0), abs=0.3)


@pytest.mark.parametrize("first", [0.0, 30.0])
def test_a_barometer_that_repeats_itself_has_stopped(first):
    """Whether the log shows the ground that the craft left, or begins in the air (spark404, stopped at 427 s)."""
    wrong = lambda t: np.where(t > 40.0, 20.0, height(t) + 0.01 * np.sin(9.0 * t))  # noqa: E731
    tables = {"baro": table(10.0, alt=wrong), "ekf": table(10.0, p_d=lambda t: -height(t))}
    tables = flown(**{name: rows.loc[first:] for name, rows in tables.items()})
    flight_account = account(tables, flight=Span(max(first, 10.0), 70.0))
    named = only("height-estimate-wrong", flight_account.happenings)
    assert named.t == pytest.approx(40.1, abs=0.11)
    assert named.reason.startswith("The barometer stopped")
    assert (flight_account.height.source, flight_account.height.value) == ("autopilot", pytest.approx(20.0, abs=0.3))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda t: np.where(t > 40.0, 20.0 + 0.01 * np.sin(9.0 * t), height(t)),
        lambda t: height(t) + 15.0 * np.clip((t - 20.0) / 50.0, 0.0, 1.0),
    ],
    ids=["stuck", "drifting"],
)
def test_a_barometer_that_stays_in_the_air_when_the_craft_is_back_is_wrong_and_not_the_autopilot(wrong):
    """Where autopilot and receiver came back to the ground; elsewhere the ground may be as high."""
    changes = {"baro": table(10.0, alt=wrong), "ekf": table(10.0, p_d=lambda t: -height(t))}
    flight_account = account(flown(**changes))
    named = only("height-estimate-wrong", flight_account.happenings)
    assert named.reason.startswith(f"The barometer was {wrong(np.array([75.0]))[0]:.0f} m above the ground")
    assert (flight_account.height.source, flight_account.height.value) == ("autopilot", pytest.approx(20.0, abs=0.3))
    elsewhere = flown().gps.assign(lat=lambda rows: 0.8 + 1e-5 * (rows.index > 50.0))
    assert account(flown(gps=elsewhere, **changes)).height.source == "barometer"


def test_each_advice_stands_once_at_the_gravest_that_it_is_for():
    """A report gave it with the happening and with the story, and for two of a kind twice."""
    blows = struck((30.0, 30.05, 60.0), (45.0, 45.05, 50.0))
    told = account(flown(imu=blows))
    advices = [finding.advice for finding in (*told.happenings, *told.story) if finding.advice]
    assert advices
    assert len(advices) == len(set(advices))
