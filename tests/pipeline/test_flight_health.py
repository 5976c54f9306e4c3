"""Timelines of logs whose faults are known: genuine firmware, and one real crash."""

from functools import cache
from pathlib import Path

import pytest

import logparse
from pipeline.flight.health.assessment import assess_health, health_findings
from pipeline.results.health import FlightHealth
from pipeline.results.span import Span

SHARED = Path(__file__).resolve().parents[3] / "shared" / "logs"
FAULTS, PAIRS = SHARED / "faults", SHARED / "pairs"

if not FAULTS.is_dir():
    pytest.skip("shared logs are not here", allow_module_level=True)


@pytest.fixture(scope="module")
def health_of(unpacked):
    @cache
    def assess(path: Path) -> FlightHealth:
        if path.suffix == ".xz":
            path = unpacked(f"{path.parent.name}/{path.name.removesuffix('.BIN.xz')}")
        log = logparse.read_log(path)
        return assess_health(log, Span(log.flight.start, log.flight.stop))

    return assess


def only(health: FlightHealth, identity: str) -> logparse.FlightEvent:
    (event,) = (event for event in health.events if event.id == identity)
    return event


def test_a_motor_at_80_percent_is_named_within_10_s_and_its_loss_within_5_points(health_of):
    health = health_of(FAULTS / "weak_octa.BIN.xz")
    event = only(health, "motor-loss")
    assert event.evidence["motor"] == 3
    assert event.t == pytest.approx(85.08, abs=0.5)
    # SIM_ENGINE_MUL 0.8 scales the output above 1000 us; the thrust falls by 36 %, as its curve says.
    assert event.evidence["output_loss"] == pytest.approx(0.20, abs=0.05)
    assert health.sound.stop == pytest.approx(event.t, abs=0.5)
    (finding,) = health_findings(health)
    assert "Motor 3" in finding.reason


@pytest.mark.parametrize(("name", "motor", "second"), [("lost_motor_octa", 5, 80.11), ("lost_motor_quad", 2, 81.06)])
def test_a_lost_motor_is_named_to_half_a_second(health_of, name, motor, second):
    event = only(health_of(FAULTS / f"{name}.BIN.xz"), "motor-loss")
    assert event.evidence["motor"] == motor
    assert event.t == pytest.approx(second, abs=0.5)
    assert event.evidence["thrust_loss"] > 0.9


def test_a_motor_lost_a_second_before_the_log_ends_is_named(tmp_path, unpacked):
    """Power goes with a craft that falls: the log ends in the air, without the landing that is left out of others."""
    cut = tmp_path / "cut.BIN"
    # 81.1 s of the log; the motor stops at 80.11 s.
    cut.write_bytes(unpacked("faults/lost_motor_octa").read_bytes()[:744_800])
    log = logparse.read_log(cut)
    assert log.flight.stop == pytest.approx(81.05, abs=0.15)
    event = only(assess_health(log, Span(log.flight.start, log.flight.stop)), "motor-loss")
    assert (event.evidence["motor"], event.t) == (5, pytest.approx(80.11, abs=0.2))


def test_crash_disarming_and_jamming_are_named_to_half_a_second(health_of):
    # Seconds at which the simulator says that the craft hit the ground; the flight recorder's own text is not read.
    crash = health_of(FAULTS / "lost_motor_quad.BIN.xz")
    assert only(crash, "crash").t == pytest.approx(84.03, abs=0.5)
    assert crash.sound.stop < 81.2
    dropped = health_of(FAULTS / "dropped_octa.BIN.xz")
    assert only(dropped, "disarmed-in-air").t == pytest.approx(93.03, abs=0.5)
    assert only(dropped, "crash").t == pytest.approx(94.13, abs=0.5)
    jammed = only(health_of(FAULTS / "gps_jam_octa.BIN.xz"), "gps-lost")
    assert (jammed.t, jammed.end) == pytest.approx((79.79, 85.79), abs=0.5)
    assert "jammed" in jammed.reason


def test_the_sag_of_a_firmware_pack_is_that_of_its_model(health_of):
    """SITL's refBatRes is 0.012 ohm; its 10 Hz low-pass of the voltage is faster than the log."""
    sag = health_of(SHARED / "sitl" / "octa11_auto_8kg.BIN").sag
    assert abs(sag.value - 0.012) < 3.0 * sag.sigma
    assert sag.sigma < 0.1 * sag.value


def test_lack_of_thrust_is_named_from_the_take_off_on(health_of):
    health = health_of(FAULTS / "saturated_hexa.BIN.xz")
    event = only(health, "low-thrust-reserve")
    assert event.t == pytest.approx(45.8, abs=0.5)
    assert health.cause is None


@pytest.mark.parametrize(
    "path",
    [*sorted((SHARED / "sitl").glob("*.BIN")), *sorted(PAIRS.glob("*_sticks.BIN.xz"))],
    ids=lambda path: path.name,
)
@pytest.mark.slow
def test_healthy_flights_have_no_notable_event(health_of, path):
    assert [(event.id, event.t) for event in health_of(path).notable] == []


@pytest.mark.slow
def test_gains_that_are_too_high_are_named(health_of):
    health = health_of(PAIRS / "quad15_hot.BIN.xz")
    assert {event.id for event in health.notable} == {"oscillation"}
    assert {event.evidence["axis"] for event in health.notable} == {"roll", "pitch"}


def test_a_real_crash_is_named_and_what_led_to_it_serves_no_model(health_of):
    (path,) = (SHARED / "real").glob("BeastAyyG*mechanical_failure.bin")
    health = health_of(path)
    # By eye: control is lost at 368.9 s, the ground is hit at 373.5 s.
    assert only(health, "loss-of-control").t == pytest.approx(368.9, abs=0.5)
    assert only(health, "crash").t == pytest.approx(373.5, abs=0.5)
    assert health.sound.stop < 369.0
    # By eye: motor 2 is asked for more from 367.5 s on, yet the craft leans towards it until it bites at 368.5 s.
    dropout = [event for event in health.events if event.id == "motor-dropout"][-1]
    assert dropout.evidence["motor"] == 2
    assert dropout.t == pytest.approx(368.0, abs=0.5)


@pytest.mark.slow
def test_no_real_flight_but_the_one_that_crashed_has_a_motor_that_drops_out(health_of):
    """Nine years of others' flights, hard sticks and bench tests among them."""
    for path in sorted((SHARED / "real").glob("*.[Bb][Ii][Nn]")):
        if "mechanical_failure" in path.name or logparse.read_log(path).flight is None:
            continue
        assert not [event.t for event in health_of(path).events if event.id == "motor-dropout"], path.name
