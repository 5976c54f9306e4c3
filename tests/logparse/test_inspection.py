"""What `rotorid inspect` says: what is missing, and what to set in the autopilot's own words."""

from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.findings import apart, warning
from logparse.craft.frames import Vehicle
from logparse.craft.log_settings import Need, bit_to_set, bits_of, how_to_log, log_setting
from logparse.craft.vehicle import describe
from logparse.flights import find_flights
from logparse.inspection import inspect
from logparse.source import Boot
from tests.logparse.builders import Decoded, tables_of
from tests.timed import timed

T = np.arange(0.0, 60.0, 0.1)


def flight_messages():
    height = np.interp(T, [0, 5, 10, 50, 55], [0, 0, 10, 10, 0])
    pwm = np.interp(T, [0, 3, 4, 55, 56], [1000, 1000, 1500, 1500, 1000])
    return Decoded(
        RCOU=timed(T, **{f"C{k}": pwm for k in range(1, 5)}),
        IMU=timed(T, **{f"Gyr{a}": 0.01 for a in "XYZ"}, AccX=0.0, AccY=0.0, AccZ=-9.8),
        GPS=timed(T[::2], Status=3, NSats=12, HDop=0.8, Lat=47, Lng=8, Alt=488 + height[::2], Spd=0, GCrs=0, VZ=0.01),
        BARO=timed(T, Alt=height, Press=95e3, Temp=20.0),
    )


def log_of(messages, parameters=None, kind="dataflash"):
    parameters = {"FRAME_CLASS": 1, "FRAME_TYPE": 1} | (parameters or {})
    vehicle = describe(messages, format=kind, parameters=parameters)
    tables, findings = tables_of(messages, kind, parameters)
    flights = find_flights(tables)
    boot = Boot(0, 1, float(T[0]), float(T[-1]))
    return SimpleNamespace(
        name="some.bin",
        of_one_flight=False,
        path=Path("folder/some.bin"),
        format=kind,
        boots=(boot,),
        boot=boot,
        messages=messages,
        parameters=parameters,
        vehicle=vehicle,
        tables=tables,
        flights=flights,
        flight=max(flights, key=lambda f: f.duration, default=None),
        findings=findings,
        start_utc=datetime(2024, 5, 1, 12, tzinfo=UTC),
        duration=60.0,
    )


def by_id(inspection):
    return {str(finding.evidence.get("what", finding.id)): finding for finding in apart(inspection.findings)}


def test_extent_rate_and_gaps_of_tables_and_messages():
    messages = flight_messages()
    messages["BARO"] = messages["BARO"].drop(messages["BARO"].loc[20.0:25.0].index)
    inspection = inspect(log_of(messages))
    tables = {table.name: table for table in inspection.tables}
    assert (tables["motors"].rows, tables["motors"].rate) == (600, pytest.approx(10.0))
    assert (tables["baro"].gaps, tables["baro"].longest_gap) == (1, pytest.approx(5.1, abs=0.11))
    assert [message.name for message in inspection.messages][-1] == "GPS"
    assert inspection.messages[0].rate == pytest.approx(10.0)
    assert (inspection.file, inspection.boots, inspection.start_utc) == ("some.bin", 1, "2024-05-01T12:00:00.000+00:00")


def test_what_is_missing_is_named_with_the_bit_that_logs_it():
    messages = flight_messages()
    del messages["RCOU"]
    inspection = inspect(log_of(messages, {"LOG_BITMASK": 43006 & ~1024 & ~512}))
    severities = [finding.severity.value for finding in inspection.findings]
    assert severities == sorted(severities, key=["error", "warning", "info"].index)
    findings = by_id(inspection)
    assert "motors" in findings
    assert findings["motors"].severity == "error"
    assert {"mag", "attitude", "battery", "fast rates"} <= set(findings)
    # Every finding gives the one value that brings all that is lacking: bits 0, 9, 10 and 18.
    wanted = 43006 | 1 | 1 << 18
    advice = [findings[name].advice for name in ("motors", "battery", "fast rates", "fast imu")]
    assert all(f"LOG_BITMASK = {wanted} adds it" in sentence for sentence in advice[1:])
    # The whole setting is explained once.
    assert f"Set LOG_BITMASK to {wanted} (it is {43006 & ~1536})" in advice[0]
    assert "RCOUT logs RCOU" in findings["motors"].advice


@pytest.mark.parametrize(("minor", "name"), [(6, "SRn_RC_CHAN"), (7, "MAVn_RC_CHAN")])
def test_telemetry_is_told_its_stream_rates(minor, name):
    beat = timed([0.0], type=[2], autopilot=[3], base_mode=[0], custom_mode=[0], system=[1], component=[1])
    version = timed([0.0], flight_sw_version=[4 << 24 | minor << 16], system=[1], component=[1])
    findings = by_id(inspect(log_of(Decoded(HEARTBEAT=beat, AUTOPILOT_VERSION=version), kind="tlog")))
    assert name in findings["motors"].advice


def test_px4_by_radio_is_not_told_the_parameters_of_ardupilot():
    beat = timed([0.0], type=[2], autopilot=[12], base_mode=[0], custom_mode=[0], system=[1], component=[1])
    findings = by_id(inspect(log_of(Decoded(HEARTBEAT=beat), kind="tlog")))
    assert "MAV_n_RATE" in findings["motors"].advice
    assert not any("SRn_" in finding.advice or "LOG_BITMASK" in finding.advice for finding in findings.values())


def test_a_bench_log_says_why_it_is_no_flight():
    messages = flight_messages()
    for name in messages["RCOU"]:
        messages["RCOU"][name] = 1000
    finding = by_id(inspect(log_of(messages)))["no-flight"]
    assert "never run above idle (1000 us)" in finding.reason
    slow = {name: rows.set_index(rows.index * 100_000.0) for name, rows in flight_messages().items()}
    assert "the clock of this log is wrong" in by_id(inspect(log_of(Decoded(slow))))["no-flight"].reason


def test_a_hole_in_flight_is_named_with_its_length():
    messages = flight_messages()
    messages["IMU"] = messages["IMU"].drop(messages["IMU"].loc[20.0:23.0].index)
    (gap,) = [finding for finding in inspect(log_of(messages)).findings if finding.id == "log-gaps"]
    assert gap.reason.startswith("The table imu has 1 gap in flight")
    assert gap.evidence["longest"] == pytest.approx(3.1, abs=0.11)
    assert "faster card" in gap.advice
    # What bytes of a damaged file lack, the card had.
    damaged = log_of(messages)
    damaged.findings = (warning("file-damaged", "40 bytes are damaged"),)
    (gap,) = [finding for finding in inspect(damaged).findings if finding.id == "log-gaps"]
    assert gap.advice.startswith("Copy the log again")


COPTER = Vehicle(autopilot="ArduPilot", firmware="ArduCopter", version="4.5.7", frame_class="quad")
PX4 = Vehicle(autopilot="PX4", firmware="PX4", version="1.16.0")
VEHICLES = [
    COPTER,
    PX4,
    *(Vehicle(autopilot="ArduPilot", firmware=firmware) for firmware in ("ArduPlane", "ArduRover")),
]


@given(
    # 16 bits with their sign in firmware before 3.3, 32 bits since; the parameter travels as a 32-bit float, which is
    # exact to 2**24.
    present=st.integers(-(2**15), 2**24),
    needs=st.sets(st.sampled_from(Need), min_size=1),
    vehicle=st.sampled_from(VEHICLES),
)
def test_what_was_logged_is_never_switched_off(present, needs, vehicle):
    parameter = "SDLOG_PROFILE" if vehicle.autopilot == "PX4" else "LOG_BITMASK"
    setting = log_setting(vehicle, "dataflash", {parameter: float(present)}, needs)
    if setting is None:
        assert not needs & bits_of(vehicle).keys()
        return
    assert setting.present == present
    bits = {bit.number for need, bit in bits_of(vehicle).items() if need in needs}
    for number in range(32):
        assert setting.wanted >> number & 1 == (present >> number & 1 or number in bits)
    for need in needs & bits_of(vehicle).keys():
        text = how_to_log(need, setting, vehicle, "dataflash")
        assert f"Set {parameter} to {setting.wanted} (it is {present})" in text or "is set already" in text


@pytest.mark.parametrize("value", [None, float("nan"), float("inf"), 1.4e-45, 176126.5])
def test_a_mask_that_is_none_gives_bits_and_no_value(value):
    setting = log_setting(COPTER, "dataflash", {} if value is None else {"LOG_BITMASK": value}, [Need.GPS])
    assert setting.wanted is None
    assert how_to_log(Need.GPS, setting, COPTER, "dataflash").startswith(
        "Add bit 2 (GPS) to LOG_BITMASK, keeping what is set"
    )


def test_bits_that_differ_or_that_old_firmware_lacks_are_not_named():
    unknown = Vehicle(autopilot="ArduPilot")
    assert log_setting(unknown, "dataflash", {"LOG_BITMASK": 2.0}, [Need.GPS]).wanted == 6
    assert log_setting(unknown, "dataflash", {"LOG_BITMASK": 65535.0}, [Need.MOTORS]) is None
    assert "bit" not in how_to_log(Need.MOTORS, None, unknown, "dataflash")
    old = Vehicle(autopilot="ArduPilot", firmware="ArduCopter", version="3.2.1")
    assert log_setting(old, "dataflash", {"LOG_BITMASK": 43006.0}, [Need.FAST_IMU]) is None
    assert "newer firmware" in how_to_log(Need.FAST_IMU, None, old, "dataflash")


@pytest.mark.parametrize(
    ("vehicle", "form", "parameters", "said"),
    [
        (Vehicle(autopilot="PX4"), "ulog", {}, "bit 4 (high rate) to SDLOG_PROFILE"),
        (COPTER, "dataflash", {"LOG_BITMASK": 176126.0}, "add bit 0 (ATTITUDE_FAST) to LOG_BITMASK"),
        (COPTER, "dataflash", {"LOG_BITMASK": 65535.0}, "is set already"),
        (COPTER, "tlog", {"LOG_BITMASK": 176126.0}, "on board"),
        (Vehicle(autopilot="ArduPilot", firmware="Blimp"), "dataflash", {}, "log rate controller"),
    ],
)
def test_a_response_s_advice_speaks_the_autopilot_s_language_and_never_names_a_value(vehicle, form, parameters, said):
    """Responses told every log to set LOG_BITMASK: PX4's, telemetry, and one of 65535, in which all is set."""
    log = SimpleNamespace(vehicle=vehicle, format=form, parameters=parameters)
    clause = bit_to_set(Need.FAST_RATES, log)
    assert said in clause
    assert "65535" not in clause
    assert "LOG_BITMASK" not in clause or vehicle == COPTER
