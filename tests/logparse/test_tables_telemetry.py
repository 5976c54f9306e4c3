"""Canonical tables from MAVLink telemetry."""

import math

import numpy as np
import pandas as pd
import pytest

from logparse.flights import find_flights
from logparse.tables import COLUMNS
from tests.logparse.builders import tables_of
from tests.timed import timed

QUAD = {"FRAME_CLASS": 1, "FRAME_TYPE": 1}
HOME = (47.0, 8.0, 488.0)


def message(t, sender=(1, 1), **columns):
    return timed(t, **columns, system=sender[0], component=sender[1])


def heartbeats(t, armed=True, mode=4, sender=(1, 1), kind=2, autopilot=3):
    return message(t, sender, type=kind, autopilot=autopilot, base_mode=81 + 128 * armed, custom_mode=mode)


def build(messages, parameters=QUAD):
    messages = {"HEARTBEAT": heartbeats([0.0, 1.0])} | messages
    return tables_of(messages, "tlog", parameters)


def test_only_the_vehicle_speaks_for_the_vehicle():
    # A gimbal and the ground station send attitudes and heartbeats too.
    t = np.arange(5) * 0.25
    own = message(t, roll=0.1, pitch=0.0, yaw=3.0, rollspeed=0.0, pitchspeed=0.0, yawspeed=[0.0] * 5)
    gimbal = own.assign(roll=0.9, component=154)
    beats = pd.concat([heartbeats(t), heartbeats(t, sender=(255, 190), kind=6, autopilot=8, mode=9)])
    tables, _ = build({"ATTITUDE": pd.concat([own, gimbal]), "HEARTBEAT": beats})
    assert tables.attitude["roll"].tolist() == [0.1] * 5
    assert tables.modes["mode"].tolist() == ["GUIDED"]


def test_position_and_velocity_are_put_in_metres_from_the_origin():
    t = np.arange(20) * 0.25
    north = 2.0 * t
    lat = np.round((HOME[0] + north / 111_172.0) * 1e7).astype(int)
    position = message(t, lat=lat, lon=round(HOME[1] * 1e7), alt=498_000, vx=200, vy=-50, vz=10)
    position.iloc[0, :2] = 0
    home = message([0.0], latitude=[470000000], longitude=[80000000], altitude=[488000])
    attitude = message(
        t, roll=0.0, pitch=0.1, yaw=np.linspace(3.0, 3.3, 20), rollspeed=0.0, pitchspeed=0.0, yawspeed=0.0
    )
    tables, _ = build({"GLOBAL_POSITION_INT": position, "GPS_GLOBAL_ORIGIN": home, "ATTITUDE": attitude})
    assert list(tables.ekf) == list(COLUMNS["ekf"])
    assert tables.ekf["p_n"].iloc[0] != tables.ekf["p_n"].iloc[0]
    assert tables.ekf["p_n"].iloc[1:].tolist() == pytest.approx(north[1:].tolist(), abs=0.02)
    assert tables.ekf.iloc[5][["p_d", "v_n", "v_e", "v_d"]].tolist() == pytest.approx([-10.0, 2.0, -0.5, 0.1], abs=1e-3)
    # Yaw passes south: no sample in between may point north.
    assert (np.abs(tables.ekf["yaw"]) > 2.9).all()
    # The local position is preferred where it is sent.
    t = np.arange(4) * 0.1
    local = message(t, x=1.0, y=2.0, z=-3.0, vx=0.1, vy=0.2, vz=0.3)
    tables, _ = build({"LOCAL_POSITION_NED": local})
    assert tables.ekf.iloc[0, :6].tolist() == [1.0, 2.0, -3.0, 0.1, 0.2, 0.3]


def test_sensors_in_their_integer_units():
    t = [0.0, 0.5]
    still = dict.fromkeys(("yacc", "ygyro", "zgyro", "ymag"), 0)
    raw = message(t, xacc=[0, 1000], zacc=[0, -1000], xgyro=[0, 500], xmag=[0, 200], zmag=[0, 400], **still)
    gps = message(
        t,
        fix_type=[3, 3],
        lat=470000000,
        lon=80000000,
        alt=488000,
        eph=[65535, 121],
        vel=[150, 65535],
        cog=9000,
        satellites_visible=[255, 12],
        h_acc=[0, 300],
        v_acc=[0, 400],
        vel_acc=[0, 150],
    )
    status = message(t, voltage_battery=[12600, 65535], current_battery=[1234, -1])
    pulses = message(t, port=[0, 0], servo1_raw=[1500, 65535], servo2_raw=1501, servo3_raw=1502, servo4_raw=[0, 1503])
    tables, findings = build({"RAW_IMU": raw, "GPS_RAW_INT": gps, "SYS_STATUS": status, "SERVO_OUTPUT_RAW": pulses})
    assert tables.imu.iloc[0].isna().all()
    assert tables.imu.iloc[1].tolist() == pytest.approx([0.5, 0.0, 0.0, 9.80665, 0.0, -9.80665])
    assert tables.mag.iloc[1].tolist() == pytest.approx([2e-5, 0.0, 4e-5])
    first, second = tables.gps.iloc[0], tables.gps.iloc[1]
    assert (first["lat"], first["alt"], first["v_e"]) == pytest.approx((math.radians(47.0), 488.0, 1.5))
    assert first[["hdop", "satellites", "h_acc", "v_d"]].isna().all()
    assert second[["hdop", "satellites", "h_acc", "v_acc", "s_acc"]].tolist() == pytest.approx(
        [1.21, 12, 0.3, 0.4, 0.15]
    )
    assert second[["v_n", "v_e"]].isna().all()
    assert tables.battery["voltage"].tolist() == pytest.approx([12.6, math.nan], nan_ok=True)
    assert tables.battery["current"].tolist() == pytest.approx([12.34, math.nan], nan_ok=True)
    assert tables.motors.isna().to_numpy().tolist() == [[False, False, False, True], [True, False, False, False]]
    assert len(findings) == 3


def test_pressure_altitude_is_above_the_calibrated_ground():
    pressure = message([0.0, 1.0], press_abs=[949.0, 948.0], press_diff=[0.0, 0.0], temperature=[3500, 3500])
    for parameters, height in (({"BARO1_GND_PRESS": 95000.0}, 8.8), ({"BARO1_GND_PRESS": 101325.0}, 0.0), ({}, 0.0)):
        tables, _ = build({"SCALED_PRESSURE": pressure}, QUAD | parameters)
        # The first samples stand for the ground: half of the 8.8 m between the two.
        assert tables.baro["alt"].iloc[0] == pytest.approx(height or -4.4, abs=0.1)
        assert np.diff(tables.baro["alt"]) == pytest.approx(8.83, abs=0.05)


def test_escs_come_in_groups_of_four():
    t = np.arange(3.0)
    group = {
        f"{name}[{k}]": [value + k] * 3
        for name, value in (("rpm", 6000), ("voltage", 1600), ("current", 100))
        for k in range(4)
    }
    tables, _ = build({"ESC_TELEMETRY_1_TO_4": message(t, **group)})
    assert tables.esc["w2"].iloc[0] == pytest.approx(6001 * 2 * math.pi / 60)
    assert (tables.esc["voltage1"].iloc[0], tables.esc["current4"].iloc[0]) == pytest.approx((16.0, 1.03))


def test_targets_that_the_mask_ignores_are_missing():
    t = np.arange(3.0)
    zeros = dict.fromkeys(("vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.0)
    target = message(
        t, coordinate_frame=5, type_mask=0b111_000, lat_int=470000900, lon_int=80000000, alt=498.0, **zeros
    )
    home = message([0.0], latitude=[470000000], longitude=[80000000], altitude=[488000])
    hud = message(t, airspeed=0.0, throttle=37)
    tables, _ = build({"POSITION_TARGET_GLOBAL_INT": target, "GPS_GLOBAL_ORIGIN": home, "VFR_HUD": hud})
    row = tables.setpoints.iloc[0]
    assert (row["p_n"], row["p_d"], row["throttle"]) == pytest.approx((10.0, -10.0, 0.37), abs=0.05)
    assert row[["v_n", "v_e", "v_d"]].isna().all()


def test_arming_and_texts_become_events():
    t = np.arange(6.0)
    beats = heartbeats(t)
    beats["base_mode"] = [81, 81, 209, 209, 81, 81]
    texts = message([3.5], text=["PreArm: <script>"], severity=[4])
    tables, _ = build({"HEARTBEAT": beats, "STATUSTEXT": texts})
    assert tables.events["event"].tolist() == ["ARMED", "MESSAGE", "DISARMED"]
    assert tables.events.index.tolist() == pytest.approx([2.0, 3.5, 4.0], abs=1e-5)


def test_px4_modes_over_mavlink():
    beats = heartbeats(np.arange(3.0), autopilot=12)
    beats["custom_mode"] = [0x00030000, 0x04040000, 0x00990000]
    tables, _ = build({"HEARTBEAT": beats})
    assert tables.modes["mode"].tolist() == ["POSITION", "MISSION", "MODE_153.0"]


def test_a_flight_shows_without_motor_outputs():
    t = np.arange(0.0, 60.0, 0.25)
    height = np.interp(t, [0, 10, 14, 40, 45, 60], [0, 0, 10, 10, 0, 0])
    local = message(t, **{name: np.zeros(len(t)) for name in ("x", "y", "vx", "vy", "vz")}, z=-height)
    beats = heartbeats(np.arange(60.0))
    beats["base_mode"] = np.where((beats.index > 8) & (beats.index < 50), 209, 81)
    tables, _ = build({"LOCAL_POSITION_NED": local, "HEARTBEAT": beats})
    (flight,) = find_flights(tables)
    assert (flight.start, flight.stop) == pytest.approx((10.0, 45.0), abs=1.0)


def test_motors_whose_function_was_not_downloaded_are_on_the_output_of_their_number():
    """Four of eight functions missing: eight motors, and a warning which are assumed; never half of the thrust."""
    parameters = {"FRAME_CLASS": 3, "FRAME_TYPE": 0} | {f"SERVO{k}_FUNCTION": 32 + k for k in range(1, 5)}
    pulses = message([0.0, 1.0], port=[0, 0], **{f"servo{k}_raw": [1500 + k] * 2 for k in range(1, 9)})
    tables, findings = build({"SERVO_OUTPUT_RAW": pulses}, parameters)
    assert tables.motors.iloc[0].tolist() == [1501, 1502, 1503, 1504, 1505, 1506, 1507, 1508]
    finding = next(finding for finding in findings if finding.id == "frame-unknown")
    assert finding.evidence["motors"] == "5, 6, 7, 8"
    # They are not guessed where outputs differ from numbers or drive something else.
    swapped = {"SERVO1_FUNCTION": 34, "SERVO2_FUNCTION": 33, "SERVO3_FUNCTION": 35}
    taken = {"SERVO1_FUNCTION": 33, "SERVO2_FUNCTION": 34, "SERVO3_FUNCTION": 35, "SERVO4_FUNCTION": 10}
    pulses = message([0.0, 1.0], port=[0, 0], **{f"servo{k}_raw": [1500 + k] * 2 for k in range(1, 5)})
    for functions in (swapped, taken):
        tables, findings = build({"SERVO_OUTPUT_RAW": pulses}, QUAD | functions)
        assert list(tables.motors) == ["m1", "m2", "m3"]
        assert "not-logged" in [finding.id for finding in findings]


@pytest.mark.parametrize(("leaning", "kept"), [(-0.4, 120), (0.01, 240)])
def test_targets_that_stand_still_while_a_pilot_flies_are_none(leaning, kept):
    """Old ArduCopter sent zeros in STABILIZE: 50 s of flying by stick read as an attitude 60 degrees off its target."""
    t = np.arange(240) * 0.25
    manual = t >= 30.0
    asked = np.where(manual, 0.0, np.degrees(0.2 * np.sin(t)))
    rates = {name: np.zeros(240) for name in ("rollspeed", "pitchspeed", "yawspeed")}
    pitch = np.where(manual, leaning + 0.05 * np.sin(2.0 * t), np.radians(asked))
    own = message(t, roll=0.0, pitch=pitch, yaw=0.0, **rates)
    tables, _ = build({"ATTITUDE": own, "NAV_CONTROLLER_OUTPUT": message(t, nav_roll=0.0 * t, nav_pitch=asked)})
    assert len(tables.setpoints.dropna(subset=["pitch"])) == kept
