"""Canonical tables from DataFlash messages as each age of the firmware writes them."""

import math

import numpy as np
import pandas as pd
import pytest

from logparse.tables import COLUMNS
from tests.logparse.builders import tables_of
from tests.timed import timed

QUAD = {"FRAME_CLASS": 1, "FRAME_TYPE": 1}


def build(messages, parameters=QUAD, kind="dataflash"):
    return tables_of(messages, kind, parameters)


def reasons(findings):
    return [finding.reason for finding in findings]


@pytest.mark.parametrize("label", ["C{}", "Ch{}", "Chan{}"])
def test_motor_outputs_under_every_name(label):
    outputs = {label.format(k): [1100 + k, 1200 + k] for k in range(1, 15)}
    tables, _ = build({"RCOU": timed([1.0, 1.1], **outputs)})
    assert list(tables.motors) == ["m1", "m2", "m3", "m4"]
    assert tables.motors["m3"].tolist() == [1103, 1203]


def test_motor_outputs_before_3_1_have_a_message_of_their_own():
    frame = timed([1.0, 2.0], **{f"Mot{k}": [1000 + k, 1100 + k] for k in range(1, 9)})
    tables, _ = build({"MOT": frame}, {"FRAME": 1}, "dataflash-text")
    assert list(tables.motors) == [f"m{k}" for k in range(1, 9)]


def test_motors_on_outputs_above_14_are_in_rco2():
    parameters = QUAD | {"SERVO1_FUNCTION": 33, "SERVO2_FUNCTION": 34, "SERVO15_FUNCTION": 35, "SERVO18_FUNCTION": 36}
    t = np.arange(5) * 0.1
    first = timed(t, **{f"C{k}": np.full(5, 1000 + k) for k in range(1, 15)})
    second = timed(t, **{f"C{k}": 1000 + k + np.arange(5) for k in range(15, 19)})
    tables, findings = build({"RCOU": first, "RCO2": second}, parameters)
    assert list(tables.motors) == ["m1", "m2", "m3", "m4"]
    assert tables.motors.iloc[2].tolist() == [1001, 1002, 1017, 1020]
    assert not findings


def test_impossible_pulses_are_missing_and_counted_once():
    outputs = {"C1": [65535, 100, 0, 1500], "C2": [1500, 1500, 0, -11714], "C3": [1500] * 4, "C4": [1500] * 4}
    tables, findings = build({"RCOU": timed([1, 2, 3, 4], **outputs)})
    assert tables.motors["m1"].isna().tolist() == [True, True, True, False]
    assert tables.motors["m2"].isna().tolist() == [False, False, True, True]
    # Outputs of 0 are no pulse, which is how a disarmed craft logs them.
    assert [finding.evidence["removed"] for finding in findings] == [3]


@pytest.mark.parametrize("parameters", [{}, {"FRAME_CLASS": 6, "FRAME_TYPE": 0}])
def test_outputs_of_no_known_frame_are_not_taken_for_motors(parameters):
    # A helicopter, an aeroplane, or a log that lost its parameters.
    tables, findings = build({"RCOU": timed([1, 2], C1=[1500, 1600], C2=[1500, 1600])}, parameters)
    assert tables.motors is None
    assert [finding.id for finding in findings] == ["frame-unknown"]


def test_a_frozen_compass_is_none():
    """A flight of 2015 has 786 readings of 6.7 uT, alike to the last digit, while the craft turned."""
    t = np.arange(120) * 0.1
    stuck = {f"Mag{axis}": np.full(120, value) for axis, value in zip("XYZ", (-40.0, 1.0, -53.0), strict=True)}
    tables, findings = build({"MAG": timed(t, **stuck)})
    assert tables.mag is None or tables.mag["mag_x"].isna().all()
    assert "one reading of the magnetometer throughout in 120 of 120 samples" in findings[0].reason
    alive = stuck | {"MagX": np.where(t < 3.0, -40.0, -41.0)}
    assert build({"MAG": timed(t, **alive)})[0].mag["mag_x"].notna().all()


def test_an_imu_logged_raw_alone_is_read():
    """LOG_BITMASK may ask for raw samples without IMU: rate and force are messages of their own, with clocks apart."""
    t = np.arange(100) * 0.0025
    gyro = timed(t, I=0, SampleUS=1e6 * t, GyrX=0.1, GyrY=0.2, GyrZ=0.3)
    accel = timed(t + 0.001, I=0, SampleUS=1e6 * (t + 0.001), AccX=0.2, AccY=0.3, AccZ=-9.8)
    table = build({"GYR": gyro, "ACC": accel})[0].imu
    assert table[["gyro_x", "gyro_y", "gyro_z"]].iloc[50].tolist() == pytest.approx([0.1, 0.2, 0.3])
    assert table[["accel_x", "accel_y", "accel_z"]].iloc[50].tolist() == pytest.approx([0.2, 0.3, -9.8])


def imu(t, offset=0.0, **more):
    return timed(t, **{f"Gyr{axis}": 0.1 + offset for axis in "XYZ"}, AccX=0.2, AccY=0.3, AccZ=-9.8, **more)


def test_imu_as_numbered_messages_and_as_instances_are_the_same():
    t = np.arange(10) * 0.02
    numbered, _ = build({"IMU": imu(t), "IMU2": imu(t, 1.0)})
    both = pd.concat([imu(t, I=np.zeros(10, int)), imu(t, 1.0, I=np.ones(10, int))]).sort_index(kind="stable")
    instances, _ = build({"IMU": both})
    pd.testing.assert_frame_equal(numbered.imu, instances.imu)
    pd.testing.assert_frame_equal(numbered.further["imu"][0], instances.further["imu"][0])
    assert list(numbered.imu) == list(COLUMNS["imu"])


def test_times_are_made_strictly_increasing():
    # 4.x logs step slightly backwards all the time; of two rows with one time the later one counts.
    frame = imu([0.0, 0.04, 0.02, 0.06, 0.06, math.nan])
    frame["GyrX"] = [0, 2, 1, 3, 4, 9]
    tables, _ = build({"IMU": frame})
    assert tables.imu.index.tolist() == [0.0, 0.02, 0.04, 0.06]
    assert tables.imu["gyro_x"].tolist() == [0, 1, 2, 4]


def test_an_unhealthy_or_wild_imu_sample_is_missing():
    frame = imu(np.arange(6) * 0.1, GH=[1, 1, 0, 1, 1, 1], AH=1)
    frame.loc[frame.index[4], "AccX"] = np.inf
    frame.loc[frame.index[5], "GyrZ"] = 1e6
    tables, findings = build({"IMU": frame})
    assert tables.imu["accel_z"].isna().tolist() == [False, False, True, False, True, True]
    assert len(findings) == 3


def gps(t, **more):
    place = {"Lat": 47.0, "Lng": 8.0, "Alt": 488.0, "Spd": 2.0, "GCrs": 90.0, "VZ": 0.5}
    return timed(t, **({"Status": 3, "NSats": 12, "HDop": 0.8} | place | more))


def test_gps_in_si_and_ned():
    tables, _ = build({"GPS": gps([1.0, 1.2])}, QUAD | {"GPS_DELAY_MS": 150})
    row = tables.gps.iloc[0]
    assert build({"GPS": gps([1.0, 1.2], VZ=[0.0, 0.0])})[0].gps["v_d"].isna().all(), "receivers that do not measure it"
    assert list(tables.gps) == list(COLUMNS["gps"])
    assert (row["lat"], row["lon"]) == pytest.approx((math.radians(47.0), math.radians(8.0)))
    assert (row["v_n"], row["v_e"], row["v_d"]) == pytest.approx((0.0, 2.0, 0.5), abs=1e-12)
    assert row["t_valid"] == pytest.approx(0.85)


@pytest.mark.parametrize(
    ("parameters", "texts", "lag"),
    [
        ({"GPS1_DELAY_MS": 80}, [], 0.08),
        ({"SIM_RATE_HZ": 1200}, [], 0.1),
        ({}, ["u-blox 1 HW: 00080000 SW: 2.01 (75331)"], 0.12),
        ({}, ["u-blox 1 HW: 00040007 SW: 7.03 (45969)"], 0.22),
        ({"GPS_DELAY_MS": 0}, ["ArduCopter V3.3.3 (acf2e0c8)"], 0.22),
    ],
)
def test_lag_of_the_receiver(parameters, texts, lag):
    messages = {"GPS": gps([1.0, 1.2]), "MSG": timed(range(len(texts)), Message=texts)}
    tables, _ = build(messages, QUAD | parameters)
    assert tables.gps["t_valid"].iloc[0] == pytest.approx(1.0 - lag)


def test_accuracies_and_arrival_time_come_from_gpa():
    accuracy = timed([1.0, 1.2], HAcc=[0.5, 655.35], VAcc=[0.8, 0.9], SAcc=[0.2, 0.0], VV=[1, 0], SMS=[970, 1165])
    tables, _ = build({"GPS": gps([1.0, 1.2]), "GPA": accuracy}, QUAD | {"GPS_DELAY_MS": 100})
    assert tables.gps["h_acc"].iloc[0] == 0.5
    assert tables.gps[["h_acc", "s_acc"]].iloc[1].isna().all()
    # The fix arrived 30 and 35 ms before its row was written.
    assert tables.gps["t_valid"].tolist() == pytest.approx([0.87, 1.065])
    assert tables.gps["v_d"].isna().tolist() == [False, True]


def test_positions_that_no_receiver_has_are_missing():
    frame = gps([1, 2, 3, 4], Lat=[0.0, 47.0, 47.0, 470.0], Lng=[0.0, 8.0, 8.0, 8.0], Status=[3, 3, 1, 3])
    tables, findings = build({"GPS": frame})
    assert tables.gps["lat"].isna().tolist() == [True, False, True, True]
    assert tables.gps["fix"].notna().all()
    assert len(findings) == 3
    assert any("latitude and longitude zero" in reason for reason in reasons(findings))
    # A damaged longitude beside an intact latitude left a distance of nothing from there on.
    half, _ = build({"GPS": gps([1, 2, 3], Lat=[47.0, 47.0, 47.0], Lng=[8.0, np.nan, 8.0])})
    assert half.gps[["lat", "lon"]].isna().to_numpy().tolist() == [[False, False], [True, True], [False, False]]


def test_units_of_the_magnetometer_by_declaration():
    # The same field of 0.2, 0.0, 0.4 G, as raw milligauss and with FMTU's multiplier applied.
    raw = timed([1, 2], MagX=[200, 200], MagY=[0, 0], MagZ=[400, 400])
    scaled = timed(
        [1, 2], dict.fromkeys(("MagX", "MagY", "MagZ"), "Gauss"), MagX=[0.2, 0.2], MagY=[0, 0], MagZ=[0.4, 0.4]
    )
    for frame in (raw, scaled):
        tables, _ = build({"MAG": frame})
        assert tables.mag.iloc[0].tolist() == pytest.approx([2e-5, 0.0, 4e-5])
    # A declared unit of another kind is a slip.
    frame = timed([1, 2], {"Roll": "m/s"}, Roll=[90.0, 90.0], Pitch=[0.0, 0.0], Yaw=[270.0, 270.0])
    tables, _ = build({"ATT": frame})
    assert tables.attitude.iloc[0].tolist() == pytest.approx([math.pi / 2, 0.0, -math.pi / 2])


def test_a_dead_magnetometer_gives_way_to_the_second():
    dead = timed([1, 2, 3], MagX=[0, 0, 0], MagY=[0, 0, 0], MagZ=[0, 0, 0])
    alive = timed([1, 2, 3], MagX=[1, 2, 3], MagY=[1, 1, 1], MagZ=[400, 400, 400])
    tables, findings = build({"MAG": dead, "MAG2": alive})
    assert tables.mag["mag_x"].tolist() == pytest.approx([1e-7, 2e-7, 3e-7])
    assert reasons(findings) == ["MAG: all three axes of the magnetometer zero in 3 of 3 samples; taken as missing."]


def test_barometer_of_firmware_before_3_2_is_in_ctun():
    tables, _ = build({"CTUN": timed([1, 2], ThrIn=[0, 0], ThrOut=[500, 600], BarAlt=[1.5, 1.6])})
    assert tables.baro["alt"].tolist() == [1.5, 1.6]
    assert tables.baro["pressure"].isna().all()
    assert tables.setpoints["throttle"].tolist() == [0.5, 0.6]


def test_attitude_without_att():
    t = np.arange(4) * 0.1
    yaw = np.radians([0.0, 90.0, 180.0, 270.0])
    quaternion = timed(t, Q1=np.cos(yaw / 2), Q2=0.0, Q3=0.0, Q4=np.sin(yaw / 2), C=np.zeros(4, int))
    tables, _ = build({"XKQ": quaternion})
    assert np.degrees(tables.attitude["yaw"]).tolist() == pytest.approx([0.0, 90.0, 180.0, -90.0])
    fast = timed(t, Roll=1.0, Pitch=2.0, Yaw=350.0, DesRoll=3.0, DesPitch=0.0, DesYaw=[0.0] * 4)
    tables, _ = build({"XKQ": quaternion, "ANG": fast})
    assert np.degrees(tables.attitude.iloc[0]).tolist() == pytest.approx([1.0, 2.0, -10.0])
    assert np.degrees(tables.setpoints["roll"]).tolist() == pytest.approx([3.0] * 4)


def xkf1(t, core, north):
    others = dict.fromkeys(("Roll", "Pitch", "Yaw", "VN", "VE", "VD", "PE", "PD"), 0.5)
    return timed(t, C=core, PN=north, **others)


def test_own_estimate_is_that_of_the_core_in_use_once_it_runs():
    t = np.arange(5) * 0.1
    cores = pd.concat([xkf1(t, 0, 1.0), xkf1(t, 1, 2.0)]).sort_index(kind="stable")
    tables, _ = build({"XKF1": cores, "XKF4": timed(t, C=0, PI=[0, 1, 1, 1, 1])})
    assert tables.ekf["p_n"].tolist() == [2.0] * 5
    # One that does not run yet has no estimate.
    frame = timed(
        [1, 2, 3], **{name: [0.0, 0.0, 1.0] for name in ("PN", "PE", "PD", "VN", "VE", "VD", "Roll", "Pitch", "Yaw")}
    )
    frame.iloc[1, 2:4] = [3.0, np.nan]  # damaged values, of which one was left out
    tables, _ = build({"EKF1": frame})
    assert tables.ekf["p_d"].isna().tolist() == [True, True, False]


def test_position_targets_of_every_age_in_metres_and_down():
    t = np.arange(3) * 0.1
    new = {
        f"PSC{axis}": timed(t, **{f"TP{axis}": value, f"TV{axis}": 0.1})
        for axis, value in (("N", 1.0), ("E", 2.0), ("D", -3.0))
    }
    middle = {"PSC": timed(t, TPX=1.0, TPY=2.0, TVX=0.1, TVY=0.1), "PSCZ": timed(t, TPZ=3.0, TVZ=-0.1)}
    old = {
        "NTUN": timed(t, DPosX=100.0, DPosY=200.0, DVelX=10.0, DVelY=10.0),
        "CTUN": timed(t, DAlt=3.0, DCRt=-10.0, ThO=0.4),
    }
    for messages in (new, middle, old):
        tables, _ = build(messages)
        row = tables.setpoints[["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"]].iloc[1]
        assert row.tolist() == pytest.approx([1.0, 2.0, -3.0, 0.1, 0.1, 0.1])
    # The velocity asked for is apart from the corrected target.
    north = timed(t, TPN=1.0, DVN=0.5, TVN=0.7)
    tables, _ = build({"PSCN": north})
    assert tables.setpoints[["v_n", "v_n_ref"]].iloc[1].tolist() == pytest.approx([0.7, 0.5])
    tables, _ = build({"PSCN": north.drop(columns="DVN")})
    assert tables.setpoints["v_n_ref"].isna().all()


def test_firmware_of_2013_has_fewer_columns():
    t = np.arange(4) * 0.1
    messages = {
        "ATT": timed(t, RollIn=10.0, Roll=9.0, PitchIn=0.0, Pitch=1.0, YawIn=0.0, Yaw=182.0, NavYaw=180.0),
        "GPS": gps(t, Status=[0, 1, 2, 2], Time=[1, 2, 3, 4]).drop(columns="VZ"),
        "CURR": timed(t, Thr=0, ThrInt=0, Volt=1529, Curr=125, Vcc=5283, CurrTot=[16.6] * 4),
    }
    tables, _ = build(messages, {"FRAME": 1}, "dataflash-text")
    assert np.degrees(tables.attitude.iloc[0]).tolist() == pytest.approx([9.0, 1.0, -178.0])
    assert np.degrees(tables.setpoints["roll"].iloc[0]) == pytest.approx(10.0)
    assert tables.gps["fix"].tolist() == [0, 1, 3, 3]
    assert tables.gps["v_d"].isna().all()
    assert (tables.battery["voltage"].iloc[0], tables.battery["current"].iloc[0]) == pytest.approx((15.29, 1.25))


def test_targets_are_interpolated_but_not_over_pauses():
    manual = timed(np.arange(100) * 0.1, DesRoll=0.0, DesPitch=0.0, DesYaw=0.0, Roll=0.0, Pitch=0.0, Yaw=0.0)
    guided = timed(np.concatenate((np.arange(10) * 0.1, 8.0 + np.arange(10) * 0.1)), TPN=np.ones(20), TVN=0.0)
    tables, _ = build({"ATT": manual, "PSCN": guided})
    assert tables.setpoints.loc[0.1:0.8, "p_n"].notna().all()
    assert tables.setpoints.loc[2.0:7.0, "p_n"].isna().all()
    # Yaw is interpolated across north.
    names = ("RDes", "R", "ROut", "PDes", "P", "POut", "YDes", "Y", "YOut", "AOut")
    fast = timed(np.arange(21) * 0.05, **dict.fromkeys(names, 0.0)).assign(R=90.0, ROut=0.1)
    slow = timed([0.0, 0.1], DesRoll=0, DesPitch=0, DesYaw=[359.0, 1.0], Roll=0, Pitch=0, Yaw=0)
    position = timed([0.0, 0.05, 0.1], TPN=1.0, TVN=0.0)
    tables, _ = build({"ATT": slow, "PSCN": position, "RATE": fast})
    assert tables.setpoints["yaw"].iloc[1] == pytest.approx(0.0, abs=1e-12)
    assert tables.rates[["w_x", "out_roll"]].iloc[0].tolist() == pytest.approx([math.pi / 2, 0.1])


def test_rates_of_the_pid_messages_where_rate_is_missing():
    roll = timed([1.0, 1.1, 1.2], Tar=0.2, Act=0.1, P=0.01, I=0.02, D=0.03, FF=[0.04] * 3)
    pitch = timed([1.02, 1.12], Tar=-0.2, Act=-0.1, P=0.0, I=0.0, D=-0.03, FF=0.0)
    rates = build({"PIDR": roll, "PIDP": pitch})[0].rates
    row = rates.loc[1.1]
    assert row[["w_x_ref", "w_x", "out_roll"]].tolist() == pytest.approx([0.2, 0.1, 0.1])
    assert row[["w_y_ref", "w_y", "out_pitch"]].tolist() == pytest.approx([-0.2, -0.1, -0.03])
    assert row[["w_z", "out_thrust"]].isna().all()


def test_chirps_of_systemid_mode_know_their_axis():
    data = timed(
        [1.0, 2.0, 5.0],
        units={"Gx": "deg/s", "Ax": "m/s/s"},
        Time=[0.0, 1.0, 0.0],
        Targ=[0.0, 0.1, 0.0],
        F=[0.5, 1.0, 0.5],
        **{f"G{axis}": [0.0, 180.0, 0.0] for axis in "xyz"},
        **{f"A{axis}": [0.0, -9.8, 0.0] for axis in "xyz"},
    )
    table = build({"SIDD": data, "SIDS": timed([0.9, 4.9], Ax=[10, 11])})[0].systemid
    assert table["axis"].tolist() == [10.0, 10.0, 11.0]
    assert table.loc[2.0, ["frequency", "w_x", "f_z", "target"]].tolist() == pytest.approx(
        [2.0 * math.pi, math.pi, -9.8, 0.1]
    )
    assert list(table.columns) == list(COLUMNS["systemid"])


def test_esc_telemetry_is_by_motor_and_not_by_output():
    parameters = QUAD | {f"SERVO{k + 4}_FUNCTION": 32 + k for k in range(1, 5)}
    rows = [timed([1.0, 1.1], Instance=[k, k], RPM=[600 * k] * 2, Volt=16.0, Curr=1.0) for k in range(8)]
    tables, _ = build({"ESC": pd.concat(rows).sort_index(kind="stable")}, parameters)
    # Motor 1 is on output 5, which is ESC instance 4.
    assert tables.esc["w1"].iloc[0] == pytest.approx(2400 * 2 * math.pi / 60)
    assert [name for name in tables.esc if name.startswith("w")] == ["w1", "w2", "w3", "w4"]
    tables, _ = build({"ESC": pd.concat([rows[0].assign(Instance=-1), rows[1]]).sort_index(kind="stable")})
    assert [name for name in tables.esc if name.startswith("w")] == ["w2"]  # damage numbers one below the first


def test_rangefinder_is_the_one_that_looks_down():
    frame = timed([1, 2, 3, 4], Instance=[0, 1, 0, 1], Dist=[5.0, 1.0, 5.0, 1.1], Stat=4, Orient=[0, 25, 0, 25])
    tables, _ = build({"RFND": frame})
    assert tables.rangefinder["distance"].tolist() == [1.0, 1.1]


def test_truth_of_the_simulator():
    t = np.arange(11) * 0.02
    place = timed(t, **{name: np.full(11, k + 1.0) for k, name in enumerate(("PN", "PE", "PD", "VN", "VE", "VD"))})
    # The log may write either of the two quaternions of an attitude.
    turned = timed([0.0, 0.1, 0.2], Roll=0, Pitch=0, Yaw=0, Q1=[1, -1, 1], Q2=0, Q3=0, Q4=[0] * 3)
    tables, _ = build({"SIM2": place, "SIM": turned})
    assert list(tables.truth) == list(COLUMNS["truth"])
    assert tables.truth["q_w"].abs().tolist() == pytest.approx([1.0] * 11)
    # Damaged attitudes leave the position.
    broken = turned.assign(Q1=math.nan)
    assert build({"SIM2": place, "SIM": broken})[0].truth["p_d"].tolist() == [3.0] * 11


def test_attitude_of_the_simulator_between_its_rows():
    """Rows of 10 Hz joined by lines erred by 0.2 degrees where a craft began to turn: more than the estimate."""
    t, slow = np.arange(0.0, 4.0, 0.02), np.arange(0.0, 4.01, 0.1)
    place = timed(t, **{name: np.zeros(len(t)) for name in ("PN", "PE", "PD", "VN", "VE", "VD")})
    half = 0.1 * np.sin(2.0 * np.pi * slow)
    zero = np.zeros(len(slow))
    turned = timed(slow, Roll=zero, Pitch=zero, Yaw=zero, Q1=np.cos(half), Q2=np.sin(half), Q3=zero, Q4=zero)
    truth = build({"SIM2": place, "SIM": turned})[0].truth
    roll = 2.0 * np.arctan2(truth["q_x"], truth["q_w"])
    assert np.abs(roll - 0.2 * np.sin(2.0 * np.pi * t)).loc[0.3:3.7].max() < np.radians(0.03)


def test_origin_is_logged_or_found_from_fixes():
    logged = timed([1, 2], Type=[1, 0], Lat=[47.1, 47.0], Lng=[8.0, 8.0], Alt=[490.0, 488.0])
    tables, _ = build({"ORGN": logged, "GPS": gps([1.0, 1.2])})
    assert tables.origin.alt == 488.0
    t = np.arange(20) * 0.2
    north = 2.0 * t
    filter_state = {name: np.zeros(20) for name in ("PE", "VN", "VE", "VD", "Roll", "Pitch", "Yaw")}
    fixes = gps(t + 0.1, Lat=47.0 + north / 111_180.0, Alt=500.0)
    tables, _ = build(
        {"EKF1": timed(t, PN=north + 10.0, PD=-2.0, **filter_state), "GPS": fixes}, QUAD | {"GPS_DELAY_MS": 100}
    )
    # The filter was 10 m north of its origin at the first fix, 2 m above it.
    assert math.degrees(tables.origin.lat) == pytest.approx(47.0 - 10.0 / 111_180.0, abs=2e-7)
    assert tables.origin.alt == pytest.approx(498.0, abs=0.01)


def test_modes_by_number_or_name():
    tables, _ = build({"MODE": timed([1, 2, 3, 4], Mode=[0, 5, 5, 99], ModeNum=[0, 5, 5, 99])})
    assert tables.modes["mode"].tolist() == ["STABILIZE", "LOITER", "MODE_99"]
    tables, _ = build({"MODE": timed([1, 2], Mode=["Stabilize", "Alt Hold"], ThrCrs=[424, 424])})
    assert tables.modes["mode"].tolist() == ["STABILIZE", "ALT_HOLD"]


def test_events_keep_all_that_happened_at_one_time():
    messages = {
        "EV": timed([5.0, 5.0, 9.0], Id=[10, 15, 11]),
        "ERR": timed([7.0], Subsys=[6], ECode=[1]),
        "MSG": timed([5.0], Message=["<b>Frame: QUAD</b>"]),
    }
    tables, _ = build(messages)
    assert tables.events["event"].tolist() == ["ARMED", "AUTO_ARMED", "MESSAGE", "ERROR", "DISARMED"]
    assert tables.events["detail"].iloc[3] == "FAILSAFE_BATTERY 1"
    assert (np.diff(tables.events.index) > 0).all()
    assert tables.events.index.tolist() == pytest.approx([5.0, 5.0, 5.0, 7.0, 9.0], abs=1e-5)


@pytest.mark.parametrize("scale", [1, 1e-6], ids=["microseconds", "seconds, as logs that name multipliers"])
def test_batches_are_timed_by_their_samples(scale):
    # Two bursts of 64 samples at 1 kHz, written half a second late and interleaved; the counter N comes again.
    heads = timed(
        [1.0, 1.01, 9.0],
        N=[7, 8, 7],
        type=[1, 0, 1],
        instance=[0, 0, 0],
        mul=[100, 10, 100],
        smp_cnt=64,
        SampleUS=[scale * period for period in (500_000, 600_000, 8_500_000)],
        smp_rate=1000.0,
    )
    ramp = np.arange(32)
    blocks = [(1.1, 7, 0), (1.12, 8, 0), (1.14, 7, 1), (1.16, 8, 1), (9.1, 7, 1), (9.2, 99, 0)]
    data = timed(
        [t for t, _, _ in blocks],
        N=[n for _, n, _ in blocks],
        seqno=[k for _, _, k in blocks],
        x=[ramp + 32 * k for _, _, k in blocks],
        y=[-ramp] * 6,
        z=[0 * ramp] * 6,
    )
    tables, _ = build({"ISBH": heads, "ISBD": data})
    (gyro,), (accel,) = tables.further["gyro_batch"], tables.further["accel_batch"]
    assert gyro.index[:64].tolist() == pytest.approx((0.5 + np.arange(64) * 1e-3).tolist())
    assert gyro["gyro_x"].iloc[:64].tolist() == pytest.approx((np.arange(64) / 100).tolist())
    # Of the last burst only the second block came through.
    assert gyro["batch"].value_counts().tolist() == [64, 32]
    assert gyro.index[64] == pytest.approx(8.532)
    assert accel["accel_x"].iloc[-1] == pytest.approx(6.3)


def test_messages_without_a_row_are_as_missing():
    tables, findings = build(
        {name: timed([]) for name in ("IMU", "GPS", "BARO", "MAG", "ATT", "RCOU", "EV", "MODE", "RATE")}
    )
    assert all(getattr(tables, name) is None for name in COLUMNS)
    assert not findings
    assert build({"CURR": timed([1, 2], Volt=[0.0, 0.0], Curr=[0.0, 0.0])})[0].battery is None, "no battery"
