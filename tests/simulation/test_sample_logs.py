"""The committed sample logs: made by the simulator, readable by others, consistent with their truth."""

import json
import math
import platform
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from pymavlink import DFReader, mavutil

from simulation import CASES, ParameterError, find, fly, write_case

FOLDER = Path(__file__).parents[2] / "sample_logs"
NAMES = list(CASES)


def read_dataflash(path):
    """All messages by type, as pymavlink reads them."""
    messages = {}
    with closing(DFReader.DFReader_binary(str(path))) as reader:
        while (message := reader.recv_msg()) is not None:
            messages.setdefault(message.get_type(), []).append(message)
    return messages


def column(messages, name, *fields):
    """Time [s] and fields of a message type."""
    rows = messages[name]
    return tuple(np.array([getattr(row, field) for row in rows], dtype=float) for field in ("TimeUS", *fields))


@pytest.fixture(scope="module")
def logs():
    return {name: read_dataflash(FOLDER / f"{name}.bin") for name in NAMES}


@pytest.fixture(scope="module")
def truths():
    return {name: json.loads((FOLDER / f"{name}.json").read_text()) for name in NAMES}


@pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64",
    reason="the logs were written on x86-64 Linux; another mathematical library rounds last bits differently",
)
@pytest.mark.parametrize("name", NAMES)
def test_regeneration_is_bit_identical(name, tmp_path):
    for path in write_case(find(name), tmp_path):
        assert path.read_bytes() == (FOLDER / path.name).read_bytes(), path.name


def test_every_file_is_small_named_and_of_a_case():
    readme = (FOLDER / "README.md").read_text()
    for path in FOLDER.iterdir():
        assert path.stat().st_size < 2_000_000
        if path.name != "README.md":
            assert path.stem in CASES
            assert f"`{path.stem}`" in readme
    assert "simulated, not flown" in readme


@pytest.mark.parametrize("name", NAMES)
def test_pymavlink_counts_the_rows_that_rate_and_duration_ask_for(name, logs, truths):
    log = logs[name]
    (t,) = column(log, "SIM2")
    duration = (t[-1] - t[0]) * 1e-6
    assert 60.0 < duration < 110.0
    rates = {"IMU": truths[name]["sensors"]["imu_rate_hz"], "GPS": 5, "GPA": 5, "SIM": 25, "SIM2": 25}
    rates |= dict.fromkeys(("ATT", "RATE", "RCOU", "CTUN", "PSCN", "PSCE", "PSCD", "BARO", "MAG", "BAT"), 10)
    for message, rate in rates.items():
        assert abs(len(log[message]) - rate * duration) <= 2, message
    assert [row.Message for row in log["MSG"]][:3] == [
        "ArduCopter V4.7.0-sim (simulated by rotorid)",
        f"simulated, not flown: {CASES[name].setup.place.name}, seed {CASES[name].setup.seed}",
        "Frame: OCTA/PLUS",
    ]


@pytest.mark.parametrize("name", NAMES)
def test_parameters_describe_the_simulated_drives(name, logs, truths):
    values = {row.Name: row.Value for row in logs[name]["PARM"]}
    vehicle = truths[name]["vehicle"]
    span = values["MOT_PWM_MAX"] - values["MOT_PWM_MIN"]
    assert (values["FRAME_CLASS"], values["FRAME_TYPE"]) == (3, 0)
    assert [values[f"SERVO{k}_FUNCTION"] for k in range(1, 9)] == list(range(33, 41))
    low = values["MOT_PWM_MIN"] + values["MOT_SPIN_MIN"] * span
    high = values["MOT_PWM_MIN"] + values["MOT_SPIN_MAX"] * span
    assert (low, high) == pytest.approx((vehicle["pwm_at_zero_thrust_us"], vehicle["pwm_at_full_thrust_us"]))
    assert values["MOT_THST_EXPO"] == pytest.approx(vehicle["expo"])
    assert values["GPS1_DELAY_MS"] == pytest.approx(1000.0 * truths[name]["sensors"]["gps_lag_s"])


@pytest.mark.parametrize("name", NAMES)
def test_gps_is_the_truth_of_a_moment_before(name, logs, truths):
    """Velocity at the stated lag leaves only the receiver's noise; position also its wandering error."""
    place, sensors = truths[name]["place"], truths[name]["sensors"]
    t, lat, lng, alt, speed, course = column(logs[name], "GPS", "Lat", "Lng", "Alt", "Spd", "GCrs")
    t_truth, p_n, p_e, p_d, v_n = column(logs[name], "SIM2", "PN", "PE", "PD", "VN")
    valid = t - 1e6 * sensors["gps_lag_s"]
    north, east, down = pymap3d.geodetic2ned(lat, lng, alt, place["lat_deg"], place["lon_deg"], place["alt_amsl_m"])
    for measured, true, sigma in ((north, p_n, 0.5), (east, p_e, 0.5), (down, p_d, 0.9)):
        # One correlation time of the wander passes in a flight: it stays within three sigma.
        assert np.sqrt(np.mean((measured - np.interp(valid, t_truth, true)) ** 2)) < 3.0 * sigma
    error = speed * np.cos(np.radians(course)) - np.interp(valid, t_truth, v_n)
    assert error.std() == pytest.approx(0.05, abs=0.01)


@pytest.mark.parametrize("name", NAMES)
def test_barometer_follows_the_height(name, logs):
    """Noise 0.1 m, drift below a metre, and some percent of the height where the air is not standard."""
    t, alt = column(logs[name], "BARO", "Alt")
    t_truth, p_d = column(logs[name], "SIM2", "PD")
    assert np.abs(alt + np.interp(t, t_truth, p_d)).max() < 2.0


@pytest.mark.parametrize("name", NAMES)
def test_compass_reads_the_field_in_body_axes(name, logs, truths):
    sensors = truths[name]["sensors"]
    _, x, y, z = column(logs[name], "MAG", "MagX", "MagY", "MagZ")
    strength = np.sqrt(x**2 + y**2 + z**2) * 1e-7
    iron = np.linalg.norm(sensors["hard_iron_t"])
    assert np.abs(strength - np.linalg.norm(sensors["magnetic_field_ned_t"])).max() < iron + 1.5e-6


@pytest.mark.parametrize("name", NAMES)
def test_accelerometer_at_rest_reads_gravity_and_its_bias(name, logs, truths):
    t, x, y, z = column(logs[name], "IMU", "AccX", "AccY", "AccZ")
    rest = t < 1e6 * truths[name]["time_s"]["arm"]
    bias = truths[name]["sensors"]["accel_bias_m_s2"]
    means = [values[rest].mean() for values in (x, y, z)]
    # Wind leans the craft on its springy feet by up to a milliradian, which is a hundredth of a m/s^2.
    assert means == pytest.approx([bias[0], bias[1], bias[2] - truths[name]["place"]["gravity_m_s2"]], abs=0.012)


def test_gyro_trails_the_truth_by_the_delay_of_its_low_pass():
    """A second-order Butterworth at 20 Hz delays slow motion by sqrt(2) / (2 pi 20 Hz) = 11.3 ms."""
    truth = fly(find("octa02_alain_breeze").setup).truth.loc[12.0:70.0]
    bias = find("octa02_alain_breeze").setup.sensors.inertial.gyro_bias[1]
    t = truth.index.to_numpy()
    lags = np.arange(0.0, 0.03, 0.0005)
    residual = [np.std(truth["gyro_y"] - bias - np.interp(t - lag, t, truth["w_y"])) for lag in lags]
    assert lags[np.argmin(residual)] == pytest.approx(0.01125, abs=0.0015)


@pytest.mark.parametrize("name", NAMES)
def test_logged_motors_lift_the_craft(name, logs, truths):
    """Thrust from RCOU, BAT and air density by the stated formulae against the specific force of the IMU."""
    truth = truths[name]
    vehicle = truth["vehicle"]
    t, *pwm = column(logs[name], "RCOU", *(f"C{k}" for k in range(1, 9)))
    t_bat, volt = column(logs[name], "BAT", "Volt")
    t_imu, acc_z = column(logs[name], "IMU", "AccZ")
    start, end = (1e6 * s for s in truth["time_s"]["airborne"])
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


def test_truth_says_what_it_is(truths):
    for name, truth in truths.items():
        assert truth["name"] == name
        assert truth["what"].startswith("simulated by rotorid, not flown")
        assert 0.0 < truth["time_s"]["arm"] < truth["time_s"]["airborne"][0] < truth["time_s"]["disarm"]


def test_telemetry_log_tells_the_same_flight(logs):
    link = mavutil.mavlink_connection(str(FOLDER / "octa02_alain_breeze.tlog"))
    messages = {}
    while (message := link.recv_msg()) is not None:
        messages.setdefault(message.get_type(), []).append(message)
    link.close()
    assert "BAD_DATA" not in messages
    log = logs["octa02_alain_breeze"]
    assert len(messages["ATTITUDE"]) == len(log["ATT"])
    assert len(messages["SERVO_OUTPUT_RAW"]) == len(log["RCOU"])
    assert len(messages["GPS_RAW_INT"]) == len(log["GPS"])
    for k in range(0, len(log["ATT"]), 50):
        assert math.degrees(messages["ATTITUDE"][k].roll) == pytest.approx(log["ATT"][k].Roll, abs=1e-3)
        assert messages["SERVO_OUTPUT_RAW"][k].servo5_raw == log["RCOU"][k].C5
        assert messages["ATTITUDE"][k].time_boot_ms == round(log["ATT"][k].TimeUS / 1e3)


def test_unknown_case_lists_those_that_there_are():
    with pytest.raises(ParameterError, match="no case called 'nonsense'; there are: octa01_zurich_calm"):
        find("nonsense")
