"""Accounts of logs whose faults are known: genuine firmware, and real crashes."""

from functools import cache
from pathlib import Path

import pytest

import logparse
from benchmarks import real_logs
from core.findings import Finding
from pipeline.flight.account import account_of_flight
from pipeline.results.account import Account
from pipeline.results.span import Span
from sysid.rotors.motor_faults import find_motor_faults
from tests.forms import thinned
from tests.paths import SHARED

FAULTS, PAIRS = SHARED / "faults", SHARED / "pairs"

if not FAULTS.is_dir():
    pytest.skip("shared logs are not here", allow_module_level=True)


@pytest.fixture(scope="module")
def account_of(unpacked):
    @cache
    def assess(path: Path) -> Account:
        if path.suffix == ".xz":
            path = unpacked(f"{path.parent.name}/{path.name.removesuffix('.BIN.xz')}")
        log = logparse.read_log(path)
        return account_of_flight(log, Span(log.flight.start, log.flight.stop))

    return assess


def only(account: Account, identity: str) -> Finding:
    (event,) = (event for event in account.happenings if event.id == identity)
    return event


def test_a_motor_at_80_percent_is_named_within_10_s_and_its_loss_within_5_points(account_of):
    account = account_of(FAULTS / "weak_octa.BIN.xz")
    event = only(account, "motor-fault")
    assert event.evidence["motor"] == 3
    assert event.t == pytest.approx(85.08, abs=0.5)
    # SIM_ENGINE_MUL 0.8 scales the output above 1000 us; the thrust falls by 36 %, as its curve says.
    assert event.evidence["output_loss"] == pytest.approx(0.20, abs=0.05)
    assert account.sound.stop == pytest.approx(event.t, abs=0.5)
    assert "motor 3 lost" in account.headline


@pytest.mark.parametrize(("name", "motor", "second"), [("lost_motor_octa", 5, 80.11), ("lost_motor_quad", 2, 81.06)])
def test_a_lost_motor_is_named_to_half_a_second(account_of, unpacked, name, motor, second):
    event = only(account_of(FAULTS / f"{name}.BIN.xz"), "motor-fault")
    assert event.evidence["motor"] == motor
    assert event.t == pytest.approx(second, abs=0.5)
    assert event.evidence["thrust_loss"] > 0.9
    # Of outputs logged three times a second it was a craft that leaned away from what was asked.
    log = logparse.read_log(unpacked(f"faults/{name}"))
    tables = log.tables.changed(motors=log.tables.motors.iloc[::3])
    (fault,) = find_motor_faults(tables, log.vehicle, log.flight.start, log.flight.stop)
    assert (fault.motor, fault.t) == (motor, pytest.approx(second, abs=0.5))


def test_a_motor_lost_a_second_before_the_log_ends_is_named(tmp_path, unpacked):
    """Power goes with a craft that falls: the log ends in the air, without the landing that is left out of others."""
    cut = tmp_path / "cut.BIN"
    # 81.1 s of the log; the motor stops at 80.11 s.
    cut.write_bytes(unpacked("faults/lost_motor_octa").read_bytes()[:744_800])
    log = logparse.read_log(cut)
    assert log.flight.stop == pytest.approx(81.05, abs=0.15)
    event = only(account_of_flight(log, Span(log.flight.start, log.flight.stop)), "motor-fault")
    assert (event.evidence["motor"], event.t) == (5, pytest.approx(80.11, abs=0.2))


@pytest.mark.parametrize("part", [0.6, 0.8])
def test_a_throttle_that_ran_away_blames_no_motor_wherever_the_log_was_cut(tmp_path, part):
    whole = (SHARED / "real" / "erlerobot-logs__26-11-2014_181.BIN").read_bytes()
    cut = tmp_path / "cut.BIN"
    cut.write_bytes(whole[: int(part * len(whole))])
    log = logparse.read_log(cut)
    account = account_of_flight(log, Span(log.flight.start, log.flight.stop))
    assert [event.id for event in account.story] == ["vibration", "throttle-runaway"]


@pytest.mark.parametrize(
    ("name", "first", "last"), [("spark404-dataflashlog__log.bin", 416.0, 431.0), ("7-9-2014_24.BIN", 0.0, 85.0)]
)
def test_wind_that_is_not_in_the_log_is_no_motor(name, first, last):
    (path,) = (SHARED / "real").glob(f"*{name}")
    log = logparse.read_log(path)
    seen = {
        name: rows[(rows.index < first) | (rows.index > last)]
        for name in ("motors", "imu", "attitude", "rates", "setpoints", "baro", "gps")
        if (rows := getattr(log.tables, name)) is not None
    }
    start = max(log.flight.start, last if first == 0.0 else 0.0)
    assert not find_motor_faults(log.tables.changed(**seen), log.vehicle, start, log.flight.stop)


def test_crash_disarming_and_jamming_are_named_to_half_a_second(account_of):
    # Seconds at which the simulator says that the craft hit the ground; the flight recorder's own text is not read.
    crash = account_of(FAULTS / "lost_motor_quad.BIN.xz")
    assert only(crash, "crash").t == pytest.approx(84.03, abs=0.5)
    assert crash.sound.stop < 81.2
    dropped = account_of(FAULTS / "dropped_octa.BIN.xz")
    assert only(dropped, "disarmed-in-air").t == pytest.approx(93.03, abs=0.5)
    assert only(dropped, "crash").t == pytest.approx(94.13, abs=0.5)
    jammed = only(account_of(FAULTS / "gps_jam_octa.BIN.xz"), "gps-lost")
    assert (jammed.t, jammed.end) == pytest.approx((79.79, 85.79), abs=0.5)
    assert "jammed" in jammed.reason


def test_the_sag_of_a_firmware_pack_is_that_of_its_model(account_of):
    """SITL's refBatRes is 0.012 ohm; its 10 Hz low-pass of the voltage is faster than the log."""
    sag = account_of(SHARED / "sitl" / "octa11_auto_8kg.BIN").battery.sag
    assert abs(sag.value - 0.012) < 3.0 * sag.sigma
    assert sag.sigma < 0.1 * sag.value


def test_lack_of_thrust_is_no_event(account_of):
    account = account_of(FAULTS / "saturated_hexa.BIN.xz")
    assert account.hover.start > 0.5
    assert account.cause is None


@pytest.mark.parametrize(
    "path",
    thinned([*sorted((SHARED / "sitl").glob("*.BIN")), *sorted(PAIRS.glob("*_sticks.BIN.xz"))], 3),
    ids=lambda path: path.name,
)
@pytest.mark.slow
def test_healthy_flights_have_no_notable_event(account_of, path):
    assert [(event.id, event.t) for event in account_of(path).notable] == []


@pytest.mark.slow
def test_gains_that_are_too_high_are_named(account_of):
    account = account_of(PAIRS / "quad15_hot.BIN.xz")
    assert {event.id for event in account.notable} == {"oscillation"}
    assert {event.evidence["axis"] for event in account.notable} == {"roll", "pitch"}


@pytest.mark.whole
def test_real_flights_are_told_as_careful_readings_of_them_tell():
    """Lift-off to vibration of 48 flights of others; every disagreement left is looked at in READINGS.md's words."""
    agree, total, lines = real_logs.compare_all(SHARED / "real" / "readings.tsv", SHARED / "real")
    missed = {name: total[name] - agree[name] for name in real_logs.NAMES}
    # Yaw went seconds after its motors stopped.
    allowed = dict.fromkeys(real_logs.NAMES, 0) | {"gravest": 2, "battery": 7}
    assert total["gravest"] == 48
    assert all(missed[name] <= allowed[name] for name in missed), lines


@pytest.mark.parametrize(
    ("name", "flight", "story", "t"),
    [
        ("mechanical_failure", 1, ("motor-fault", "crash"), 368.6),
        ("11-2-2015_112", 2, ("motor-fault", "crash"), 610.0),
        ("7-9-2014_24", 1, ("lift-lost", "crash"), 136.0),
        ("5-12-2014_218", 1, ("control-lost",), 353.0),
        ("26-11-2014_181", 1, ("vibration", "throttle-runaway"), 91.5),
        ("31-3-2015_83", 1, ("throttle-runaway",), 25.0),
        ("00000081", 1, ("yaw-lost", "crash"), 67.0),
    ],
)
def test_what_led_to_it_comes_first(name, flight, story, t):
    """By eye; models are made of the time before it only."""
    (path,) = (SHARED / "real").glob(f"*{name}*")
    log = logparse.read_log(path)
    span = Span(log.flights[flight - 1].start, log.flights[flight - 1].stop)
    account = account_of_flight(log, span)
    assert tuple(event.id for event in account.story) == story
    assert account.story[0].t == pytest.approx(t, abs=4.0)
    assert story[-1] != "crash" or account.sound.stop < account.story[0].t
