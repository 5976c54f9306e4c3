"""Canonical tables from PX4 topics of several ages."""

import math

import numpy as np
import pytest

from tests.logparse.builders import tables_of
from tests.timed import timed

QUAD = {"SYS_AUTOSTART": 4001}


def topic(t, **columns):
    return timed(t, **{name.replace("__", "[") + "]" * ("__" in name): values for name, values in columns.items()})


def build(messages, parameters=QUAD):
    return tables_of(messages, "ulog", parameters)


def outputs(*rows):
    values = np.array(rows, dtype=float)
    return topic(np.arange(len(values)) * 0.1, **{f"output__{k}": values[:, k] for k in range(values.shape[1])})


def test_pulses_dshot_and_normalised_commands_are_all_microseconds():
    pulses, _ = build({"actuator_outputs": outputs([900, 900, 900, 900], [1500, 1501, 1502, 1503])})
    dshot, _ = build(
        {"actuator_outputs": outputs([0, 0, 0, 0], [1000, 1002, 1004, 1006])}, QUAD | {"PWM_MAIN_TIM0": -3}
    )
    commands = topic([0.0, 0.1], **{f"control__{k}": [0.0, 0.5 + 0.001 * k] for k in range(4)})
    normalised, _ = build({"actuator_motors": commands})
    for tables in (pulses, dshot, normalised):
        assert list(tables.motors) == ["m1", "m2", "m3", "m4"]
        assert tables.motors.iloc[1].tolist() == pytest.approx([1500, 1501, 1502, 1503])


def test_fixes_before_and_after_1_14():
    names = ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s", "eph", "epv", "s_variance_m_s", "hdop")
    common = dict.fromkeys(names, 0.1)
    common |= {"fix_type": 3, "satellites_used": 12}
    old = topic([1, 2], lat=470000000, lon=80000000, alt=488000, **common)
    new = topic([1, 2], latitude_deg=47.0, longitude_deg=8.0, altitude_msl_m=488.0, **common)
    for frame in (old, new):
        tables, _ = build({"vehicle_gps_position": frame}, QUAD | {"EKF2_GPS_DELAY": 150})
        row = tables.gps.iloc[0]
        assert (row["lat"], row["alt"], row["t_valid"]) == pytest.approx((math.radians(47.0), 488.0, 0.85))


@pytest.mark.filterwarnings("error")
def test_what_no_sensor_gives_is_not_known():
    """Damage makes infinite floats, and NaN that signal when they are widened."""
    damaged = np.array([0x7F800001, 0x7F800000, 0x3F800000], np.uint32).view(np.float32)
    frame = topic([0.0, 0.1, 0.2], **dict.fromkeys(("x", "y", "z", "vx", "vy", "vz"), damaged))
    tables, _ = build({"vehicle_local_position_setpoint": frame})
    assert tables.setpoints["p_n"].tolist() == [1.0, 1.0, 1.0], "held from the only sample, 0.2 s away"
    # No fix leaves no position.
    frame = topic(
        [1, 2], latitude_deg=[0.0, 0.0], longitude_deg=[0.0, 0.0], altitude_msl_m=-17.0, fix_type=[0, 0], eph=4294967.5
    )
    tables, findings = build({"sensor_gps": frame})
    assert tables.gps is None or tables.gps[["lat", "alt", "h_acc"]].isna().all().all()
    assert len(findings) == 1


def test_sensors_of_2017_are_all_in_one_topic():
    n = 20
    frame = topic(
        np.arange(n) * 0.004,
        **{f"gyro_rad__{k}": np.full(n, 0.1) for k in range(3)},
        **{f"accelerometer_m_s2__{k}": np.full(n, -9.8) for k in range(3)},
        **{f"magnetometer_ga__{k}": np.repeat([0.2, 0.3], 10) for k in range(3)},
        baro_alt_meter=328.0,
        baro_temp_celcius=27.0,
    )
    tables, _ = build({"sensor_combined": frame})
    assert len(tables.imu) == n
    # The magnetometer is repeated at the rate of the gyro; only fresh samples count.
    assert tables.mag["mag_x"].tolist() == pytest.approx([2e-5, 3e-5])
    assert tables.baro["alt"].tolist() == [0.0] * n


def test_estimate_counts_where_it_is_valid():
    t = np.arange(4) * 0.1
    half = math.sqrt(0.5)
    turned = topic(t, q__0=[half] * 4, q__1=0.0, q__2=0.0, q__3=[half] * 4)
    valid = {"xy_valid": [0, 1, 1, 1], "z_valid": 1, "v_xy_valid": [0, 1, 1, 1], "v_z_valid": 1}
    origin = {"ref_lat": 47.0, "ref_lon": 8.0, "ref_alt": 488.0}
    place = topic(t, x=1.0, y=2.0, z=-3.0, vx=0.1, vy=0.2, vz=0.3, **valid, **origin)
    tables, _ = build({"vehicle_attitude": turned, "vehicle_local_position": place})
    assert tables.ekf["p_n"].isna().tolist() == [True, False, False, False]
    assert tables.ekf.iloc[1].tolist() == pytest.approx([1.0, 2.0, -3.0, 0.1, 0.2, 0.3, 0.0, 0.0, math.pi / 2])
    assert math.degrees(tables.origin.lat) == pytest.approx(47.0)


def test_thrust_is_positive_up_to_the_mixer():
    t = np.arange(5) * 0.02
    n = len(t)
    messages = {
        "vehicle_angular_velocity": topic(t, **{f"xyz__{k}": np.full(n, 0.1 * k) for k in range(3)}),
        "vehicle_rates_setpoint": topic(t, roll=0.0, pitch=0.2, yaw=0.0),
        "vehicle_torque_setpoint": topic(t, **{f"xyz__{k}": np.full(n, 0.01 * k) for k in range(3)}),
        "vehicle_thrust_setpoint": topic(t, **{f"xyz__{k}": np.full(n, -0.2 * k) for k in range(3)}),
    }
    tables, _ = build(messages)
    row = tables.rates.iloc[2]
    assert row[["w_y", "w_y_ref", "out_pitch", "out_thrust"]].tolist() == pytest.approx([0.1, 0.2, 0.01, 0.4])


def test_modes_and_events():
    status = topic([1, 2, 3], nav_state=[2, 3, 3], arming_state=[1, 2, 1])
    landed = topic([1.5, 2.5], landed=[0, 1])
    tables, _ = build({"vehicle_status": status, "vehicle_land_detected": landed})
    assert tables.modes["mode"].tolist() == ["POSITION", "MISSION"]
    assert tables.events["event"].tolist() == ["TAKEOFF", "ARMED", "LAND_COMPLETE", "DISARMED"]


def test_signals_that_autotuning_adds_are_those_of_system_identification():
    t = np.arange(0.0, 30.0, 0.1)
    roll = np.where((t >= 5.0) & (t < 15.0), 0.5 * np.sin(3.0 * t), 0.0)
    pitch = np.where((t >= 18.0) & (t < 28.0), 0.5 * np.sin(3.0 * t), 0.0)
    columns = {"rate_sp[0]": roll, "rate_sp[1]": pitch, "rate_sp[2]": 0.0 * t}
    tables, _ = build({"autotune_attitude_control_status": timed(t, **columns)})
    injection = tables.systemid
    assert set(injection["axis"]) == {7.0, 8.0}
    assert injection.index[[0, -1]].tolist() == pytest.approx([5.0, 27.9], abs=0.11)
    first = injection[injection["axis"] == 7.0]
    assert first["elapsed"].iloc[[0, -1]].tolist() == pytest.approx([0.0, 9.9], abs=0.11)
    assert first["target"].max() == pytest.approx(np.degrees(0.5), rel=0.01)
    assert injection["frequency"].isna().all()


def test_a_vtol_is_a_multirotor_while_it_hovers():
    """A standard VTOL: four rotors lift, the fifth pushes; on its wings from 0.3 to 0.6 s motors are not told."""
    parameters = {"CA_AIRFRAME": 2, "CA_ROTOR_COUNT": 5, "CA_ROTOR4_AX": 1.0, "CA_ROTOR4_AZ": 0.0}
    for k, (x, y) in enumerate([(1, 1), (-1, -1), (1, -1), (-1, 1)]):
        parameters |= {f"CA_ROTOR{k}_PX": 0.2 * x, f"CA_ROTOR{k}_PY": 0.2 * y, f"CA_ROTOR{k}_KM": 0.05 * x * y}
    flown = outputs(*[[1500, 1500, 1500, 1500, 1800]] * 10)
    for said in (
        {"vehicle_vtol_state": [3, 1, 4, 3]},
        {"vtol_in_rw_mode": [1, 1, 0, 1], "vtol_in_trans_mode": [0, 1, 0, 0]},
    ):
        status = topic([0.0, 0.3, 0.4, 0.65], **said)
        tables, findings = build({"actuator_outputs": flown, "vtol_vehicle_status": status}, parameters)
        assert list(tables.motors) == ["m1", "m2", "m3", "m4"]
        assert tables.motors["m1"].isna().tolist() == [False] * 3 + [True] * 4 + [False] * 3
        assert "wing-borne" in {finding.id for finding in findings}
    tilting, _ = build({"actuator_outputs": flown}, parameters | {"CA_AIRFRAME": 3})
    assert tilting.motors is None
