"""The committed sample logs: made by the simulator, readable by others, consistent with their truth."""

import json
import math
import platform
import sys

import numpy as np
import pymap3d
import pytest
from pymavlink import mavutil

from logparse import read_log
from simulation import FLIGHTS, fly, write_sample_logs
from simulation.sample_logs import DAMAGED, DAMAGED_FLIGHT
from sysid.frequency import fit, response
from tests.paths import SAMPLES

NAMES = list(FLIGHTS)


def column(messages, name, *fields):
    """Time [us] and fields of a message type."""
    return tuple(messages[name][field].to_numpy(float) for field in ("TimeUS", *fields))


@pytest.fixture(scope="module")
def logs():
    return {name: read_log(SAMPLES / f"{name}.bin").messages for name in NAMES}


@pytest.fixture(scope="module")
def truths():
    return {name: json.loads((SAMPLES / f"{name}.json").read_text()) for name in NAMES}


@pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64",
    reason="the logs were written on x86-64 Linux; another mathematical library rounds last bits differently",
)
def test_regeneration_is_bit_identical(tmp_path):
    """All of them, in about seven seconds of processor time."""
    written = write_sample_logs(tmp_path)
    assert {path.name for path in written} == {path.name for path in SAMPLES.iterdir()} - {"README.md"}
    for path in written:
        assert path.read_bytes() == (SAMPLES / path.name).read_bytes(), path.name


@pytest.mark.parametrize("name", NAMES)
def test_gps_is_the_truth_of_a_moment_before(name, logs, truths):
    """Velocity at the stated lag leaves only the receiver's noise; position also its wandering error."""
    place, sensors = truths[name]["place"], truths[name]["sensors"]
    rows = column(logs[name], "GPS", "Lat", "Lng", "Alt", "Spd", "GCrs", "Status")
    t, lat, lng, alt, speed, course, _ = (values[rows[-1] == 3] for values in rows)
    t_truth, p_n, p_e, p_d, v_n = column(logs[name], "SIM2", "PN", "PE", "PD", "VN")
    valid = t - 1e6 * sensors["gps_lag_s"]
    north, east, down = pymap3d.geodetic2ned(lat, lng, alt, place["lat_deg"], place["lon_deg"], place["alt_amsl_m"])
    for measured, true, sigma in ((north, p_n, 0.5), (east, p_e, 0.5), (down, p_d, 0.9)):
        # One correlation time of the wander passes in a flight: it stays within three sigma.
        assert np.sqrt(np.mean((measured - np.interp(valid, t_truth, true)) ** 2)) < 3.0 * sigma
    error = speed * np.cos(np.radians(course)) - np.interp(valid, t_truth, v_n)
    assert error.std() == pytest.approx(0.05, abs=0.01)


def test_gyro_trails_the_truth_by_the_delay_of_its_low_pass():
    """A second-order Butterworth at 20 Hz delays slow motion by sqrt(2) / (2 pi 20 Hz) = 11.3 ms."""
    truth = fly(FLIGHTS["octa02_alain_breeze"].setup).truth.loc[12.0:70.0]
    bias = FLIGHTS["octa02_alain_breeze"].setup.sensors.inertial.gyro_bias[1]
    t = truth.index.to_numpy()
    lags = np.arange(0.0, 0.03, 0.0005)
    residual = [np.std(truth["gyro_y"] - bias - np.interp(t - lag, t, truth["w_y"])) for lag in lags]
    assert lags[np.argmin(residual)] == pytest.approx(0.01125, abs=0.0015)


@pytest.mark.parametrize("name", NAMES)
def test_logged_motors_lift_the_craft(name, logs, truths):
    """Thrust from RCOU, BAT and air density by the stated formulae against the specific force of the IMU."""
    truth = truths[name]
    vehicle = truth["vehicle"]
    t, *pwm = column(logs[name], "RCOU", *(f"C{k}" for k in range(1, len(vehicle["motors"]) + 1)))
    t_bat, volt = column(logs[name], "BAT", "Volt")
    t_imu, acc_z = column(logs[name], "IMU", "AccZ")
    start, end = (1e6 * s for s in truth["time_s"]["airborne"])
    end = min([end, *(1e6 * loss["t_s"] for loss in truth.get("motor_losses", []))])
    span = vehicle["pwm_at_full_thrust_us"] - vehicle["pwm_at_zero_thrust_us"]
    a = np.clip((np.array(pwm) - vehicle["pwm_at_zero_thrust_us"]) / span, 0.0, 1.0)
    curve = ((1.0 - vehicle["expo"]) * a + vehicle["expo"] * a**2).sum(axis=0)
    ratio = np.interp(t, t_bat, volt) / vehicle["voltage_reference_v"]
    density = truth["place"]["air_density_airborne_mean_kg_m3"] / vehicle["reference_density_kg_m3"]
    thrust = vehicle["thrust_max_per_motor_n"] * density * ratio**2 * curve
    airborne = (t > start + 5e6) & (t < end - 1e6)
    force = -vehicle["mass_kg"] * np.mean(acc_z[(t_imu > start + 5e6) & (t_imu < end - 1e6)])
    # Voltage noise, bias of the accelerometer (0.03 m/s^2), vertical drag and gusts: one per cent.
    assert thrust[airborne].mean() == pytest.approx(force, rel=0.01)


def test_telemetry_log_tells_the_same_flight(logs):
    link = mavutil.mavlink_connection(str(SAMPLES / "octa02_alain_breeze.tlog"))
    messages = {}
    while (message := link.recv_msg()) is not None:
        messages.setdefault(message.get_type(), []).append(message)
    link.close()
    assert "BAD_DATA" not in messages
    log = logs["octa02_alain_breeze"]
    assert len(messages["ATTITUDE"]) == len(log["ATT"])
    assert len(messages["SERVO_OUTPUT_RAW"]) == len(log["RCOU"])
    assert len(messages["GPS_RAW_INT"]) == len(log["GPS"])
    attitude, outputs = log["ATT"], log["RCOU"]
    for k in range(0, len(attitude), 50):
        assert math.degrees(messages["ATTITUDE"][k].roll) == pytest.approx(attitude["Roll"].iloc[k], abs=1e-3)
        assert messages["SERVO_OUTPUT_RAW"][k].servo5_raw == outputs["C5"].iloc[k]
        assert messages["ATTITUDE"][k].time_boot_ms == round(attitude["TimeUS"].iloc[k] / 1e3)


def test_a_motor_that_stops_brings_the_craft_down(logs, truths):
    """Free fall begins with the loss, the shock comes at the stated impact, and the crash check disarms."""
    truth, log = truths["quad03_motor_stops"], logs["quad03_motor_stops"]
    (loss,) = truth["motor_losses"]
    assert loss == {"motor": 2, "t_s": 82.2, "thrust_left": 0.0}
    t, down, sink = column(log, "SIM2", "PD", "VD")
    impact = truth["time_s"]["airborne"][1]
    assert loss["t_s"] + 1.0 < impact < loss["t_s"] + 2.5
    assert np.interp(1e6 * (impact - 0.05), t, sink) > 8.0
    assert -15.0 < np.interp(1e6 * loss["t_s"], t, down) < -13.0
    t, x, y, z = column(log, "IMU", "AccX", "AccY", "AccZ")
    shock = 1e-6 * t[np.argmax(np.hypot(np.hypot(x, y), z))]
    assert shock == pytest.approx(impact, abs=0.1)
    (error,) = log["ERR"].itertuples()
    assert (error.Subsys, error.ECode) == (12, 1)
    assert error.Index == pytest.approx(truth["time_s"]["disarm"], abs=0.01)
    t, motor, rpm = column(log, "ESC", "Instance", "RPM")
    assert rpm[(motor == 1) & (t > 1e6 * (loss["t_s"] + 0.5))].max() < 1.0


def test_chirps_move_the_craft_as_its_inertia_says(truths):
    """Roll acceleration per normalised torque, as identified, against rotors, arms and inertia."""
    truth = truths["quad02_delft_systemid"]
    gain = fit(response(read_log(SAMPLES / "quad02_delft_systemid.bin"), "roll")).parameters["gain"]
    vehicle = truth["vehicle"]
    arms = np.array([motor["position_frd_m"] for motor in vehicle["motors"]])
    # Thrust per unit of the mixer about hover: it is linear in the command, up to the battery's sag.
    sag = (vehicle["battery"]["voltage_airborne_mean_v"] / vehicle["voltage_reference_v"]) ** 2
    density = truth["place"]["air_density_airborne_mean_kg_m3"] / vehicle["reference_density_kg_m3"]
    per_unit = vehicle["thrust_max_per_motor_n"] * sag * density * 0.5 * np.abs(arms[:, 1]).sum()
    assert gain.value == pytest.approx(per_unit / vehicle["inertia_kg_m2"][0][0], rel=0.06)


def test_the_damaged_log_gives_what_is_left_of_it(truths):
    truth = json.loads((SAMPLES / f"{DAMAGED}.json").read_text())
    assert truth["damage"]["flight"] == DAMAGED_FLIGHT
    data = (SAMPLES / f"{DAMAGED}.bin").read_bytes()
    whole = (SAMPLES / f"{DAMAGED_FLIGHT}.bin").read_bytes()
    assert (len(data), len(whole)) == (truth["damage"]["bytes_left"], truth["damage"]["bytes_of_the_whole_log"])
    log, intact = read_log(SAMPLES / f"{DAMAGED}.bin"), read_log(SAMPLES / f"{DAMAGED_FLIGHT}.bin")
    assert {finding.severity for finding in log.findings} >= {"warning"}
    motors, expected = log.tables.motors, intact.tables.motors
    assert motors is not None
    assert expected is not None
    # 6 of 610 kB are spoilt: nine tenths of the rows before the end are there, and as they were written.
    before = expected.loc[: motors.index[-1]]
    assert len(motors) > 0.9 * len(before)
    common = motors.index.intersection(before.index)
    assert len(common) == len(motors)
    assert np.array_equal(motors.loc[common].to_numpy(), before.loc[common].to_numpy())
