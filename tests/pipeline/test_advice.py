"""Advice: nothing without a reason in these flights, and the numbers in it are right."""

import dataclasses
import json

import numpy as np

from core.serialization import plain
from logparse import Finding, Severity
from logparse.craft.frames import Vehicle
from logparse.craft.log_settings import Need, bits_of, log_setting
from pipeline.fleet.drift import follow
from pipeline.fleet.envelope import envelope
from pipeline.flight.logging_advice import BRINGS
from pipeline.flight.next_flights import MOST, for_craft
from pipeline.results.account import Account, GpsReading
from tests.pipeline.builders import covering, flown, hovering, stated
from tests.pipeline.coverages import coverage_of

COPTER = Vehicle(autopilot="ArduPilot", firmware="ArduCopter", version="4.5.7")
PX4 = Vehicle(autopilot="PX4", firmware="PX4")
NEEDS = {
    "motors": Need.MOTORS,
    "fast motors": Need.FAST_MOTORS,
    "gps": Need.GPS,
    "imu": Need.IMU,
    "fast imu": Need.FAST_IMU,
    "attitude": Need.ATTITUDE,
    "baro": Need.BARO,
    "mag": Need.COMPASS,
    "battery": Need.BATTERY,
    "fast rates": Need.FAST_RATES,
}

TOLD = (
    "thrust over mass",
    "thrust curve",
    "roll inertia over mass and arm",
    "pitch inertia over mass and arm",
    "yaw torque over inertia",
    "linear drag over mass",
)


def good(name="good", *, parameters=TOLD, findings=(), form="dataflash", mask=176127.0, known=True, gps=None, **parts):
    """Make a flight that lacks nothing but what is taken from it."""
    settings = {} if mask is None else {"LOG_BITMASK": mask}
    parts["health"] = {"settings": settings} | parts.get("health", {})
    return dataclasses.replace(
        flown(name),
        format=form,
        position_known=known,
        coverage=coverage_of(**parts),
        account=Account(flight=None, gps=gps),
        parameters=tuple(stated(parameter, 1.0, 0.01, "") for parameter in parameters),
        findings=tuple(finding if isinstance(finding, Finding) else found(finding) for finding in findings),
    )


def lacking(name, need, mask=176127.0, vehicle=COPTER, kind="dataflash"):
    """Make a finding as `logparse.health` gives it for what a log with this mask lacks."""
    parameter = "SDLOG_PROFILE" if vehicle.autopilot == "PX4" else "LOG_BITMASK"
    setting = log_setting(vehicle, kind, {} if mask is None else {parameter: mask}, [need])
    bit = bits_of(vehicle).get(need)
    if setting is None or bit is None or setting.has(bit):
        return found("not-logged", what=name)
    present = {} if setting.present is None else {"present": setting.present, "wanted": setting.wanted}
    return found("not-logged", what=name, parameter=parameter, bit=bit.number, name=bit.name, **present)


def found(name, /, severity="warning", **evidence):
    return Finding(name, Severity(severity), "", "", evidence)


WITHOUT_MASS = found("conditions-assumed", what="mass")


def only(*flights, **more):
    (advice,) = for_craft(flights, **more)
    return advice


def test_a_good_flight_needs_no_advice():
    assert for_craft([good()]) == ()
    assert for_craft([good("a"), good("b")]) == ()
    assert for_craft([]) == ()
    # What is set is not asked for again, and slow rates do not matter where rotation is determined.
    assert for_craft([good(mask=float(1 << 13), findings=[lacking("mag", Need.COMPASS, 8192.0)])]) == ()
    assert for_craft([good(mask=176126.0, findings=[lacking("fast rates", Need.FAST_RATES, 176126.0)])]) == ()


def test_all_missing_bits_make_one_value_of_the_mask():
    """176126 has bits 1 to 11, 13, 15 and 17; fast rates (0) and fast IMU (18) make 438271, as docs/logging.md says."""
    lacks = [lacking(name, NEEDS[name], 176126.0) for name in ("fast rates", "fast imu")]
    slow = good("slow", mask=176126.0, parameters=("thrust over mass",), findings=lacks)
    advice = next(item for item in for_craft([slow]) if item.id == "log-bitmask")
    assert advice.settings == {"LOG_BITMASK": 438271}
    uncovered = for_craft([dataclasses.replace(slow, coverage=None)])
    assert {"LOG_BITMASK": 438271} in [item.settings for item in uncovered], "the mask is in what the log lacks"
    assert "Set LOG_BITMASK to 438271 (it is 176126)" in advice.do
    assert "bit 0 (ATTITUDE_FAST), bit 18 (IMU_FAST)" in advice.do
    assert "motors' lag" in advice.gain


def test_the_latest_flight_s_mask_counts_for_several():
    lacks = [lacking("mag", Need.COMPASS, 6.0)]
    advice = only(good("a", mask=6.0, findings=lacks), good("b", mask=1030.0, findings=()))
    assert advice.settings == {"LOG_BITMASK": 1030 | 1 << 13}


def test_without_a_mask_the_bits_are_named_and_nothing_is_set():
    advice = only(good(mask=None, findings=[lacking("gps", Need.GPS, None)]))
    assert advice.settings == {}
    assert advice.do == "Add bit 2 (GPS) to LOG_BITMASK, keeping what is set"
    assert advice.rank < 10, "without a position nothing can be identified"


def test_telemetry_and_px4_have_advice_of_their_own():
    assert (
        only(good(form="tlog", findings=(found("not-logged", what="mag"), found("not-logged", what="fast imu")))).id
        == "use-on-board-log"
    )
    lacks = [lacking("fast motors", Need.FAST_MOTORS, 1.0, PX4, "ulog")]
    advice = only(good(form="ulog", mask=None, findings=lacks))
    assert (advice.id, advice.settings) == ("sdlog-profile", {"SDLOG_PROFILE": 17})
    assert "LOG_BITMASK" not in advice.do


def test_the_speed_of_legs_follows_from_the_gusts():
    """Gusts of a fifth of 10 m/s of wind pass for 15 % of drag at 2 / sqrt(0.15) = 5.2 m/s; calm air takes less."""
    parameters = tuple(parameter for parameter in TOLD if "drag" not in parameter)
    wind = {"speed": 10.0, "sigma": 0.3}
    advice = only(good(parameters=parameters, wind=wind, excitation={"speed_std": [1.2, 0.4]}))
    assert advice.id == "fly-legs-for-drag"
    assert "at 6 m/s or more" in advice.do
    assert "varied by 0.4 m/s only, in a wind of about 10 m/s" in advice.why
    assert "at 3 m/s" in only(good(parameters=parameters, wind={"speed": 0.2}, excitation={"speed_std": [1.2, 0.4]})).do
    assert (
        "at 12 m/s" in only(good(parameters=parameters, wind={"speed": 99.0}, excitation={"speed_std": [1.2, 0.4]})).do
    )
    assert for_craft([good(parameters=parameters, wind=wind, excitation={"speed_std": [6.0, 7.0]})]) == ()


def test_axes_that_are_not_determined_are_named_for_sticks():
    parameters = tuple(parameter for parameter in TOLD if "roll" not in parameter)
    advice = only(good(parameters=parameters))
    assert advice.id == "fly-sticks"
    assert "short stick inputs on roll," in advice.do
    assert (
        for_craft([good(parameters=parameters), good("lively", parameters=(*parameters, "roll effectiveness"))]) == ()
    )


def test_flights_to_repeat_are_named():
    lost = good("lost", health={"position_sigma": {"median": 9.0, "max": 60.0}}, known=False)
    still = good("still", excitation={"acceleration_rms": 0.06})
    advice = {item.id: item for item in for_craft([lost, still, good("a"), good("b")])}
    assert set(advice) == {"repeat-with-gps", "repeat-with-movement"}
    assert "Repeat lost" in advice["repeat-with-gps"].do
    assert "60 m" in advice["repeat-with-gps"].why
    assert advice["repeat-with-movement"].flights == ("still",)


def test_a_receiver_that_sees_no_satellite_is_not_sent_under_open_sky():
    """gps_interference flew indoors, by motion capture."""
    blind = GpsReading(satellites_least=0, satellites_median=0, fix_share=0.0)
    cloudy = dataclasses.replace(blind, satellites_median=3)
    unknown = {"position_sigma": {"median": 900.0, "max": 2000.0}}
    for more in ({}, {"excitation": {"acceleration_rms": 0.06}}):  # what it moved is not known either
        assert for_craft([good("indoors", health=unknown, gps=blind, known=False, **more)]) == ()
    assert for_craft([good("cloudy", health=unknown, gps=cloudy, known=False)]) != ()


def test_judging_flights_that_leave_the_range_are_advised_to_train():
    flights = [covering("a", ground_speed=np.full(900, 3.0)), covering("b", ground_speed=np.full(900, 12.5))]
    flights = [
        dataclasses.replace(
            good(f.name), coverage=dataclasses.replace(f.coverage, excitation=good().coverage.excitation)
        )
        for f in flights
    ]
    found_range = envelope(flights, ["a"], ["b"])
    advice = {item.id: item for item in for_craft(flights, found_range)}
    assert advice["train-where-you-fly"].flights == ("b",)
    assert "ground speed up to 12.5 m/s (fitted to 4 m/s)" in advice["train-where-you-fly"].why
    # One flight trains: sqrt(2) of the best model's error on unseen ones; with four it is sqrt(1.25).
    assert "adds 12 % instead of 41 %" in advice["fly-more"].gain


def test_a_faster_card_does_not_mend_a_damaged_file():
    assert only(good("slow", findings=("log-gaps", WITHOUT_MASS)), good("well")).id == "faster-card"
    assert for_craft([good("damaged", findings=("log-gaps", "file-damaged"))]) == ()


def test_a_weakening_motor_comes_first():
    flights = hovering(np.random.default_rng(3), "octa", 10, weak=5, loss=0.02)
    flights = [dataclasses.replace(good(f.name, findings=(WITHOUT_MASS,)), trims=f.trims) for f in flights]
    advice = for_craft(flights, None, follow(flights))
    assert advice[0].id == "look-at-motor-weakening"
    assert advice[0].do.startswith("Check motor 5")
    assert advice[-1].id == "weigh-the-craft"


def test_the_list_is_short_sorted_and_json():
    everything = good(
        "bad",
        parameters=(),
        mask=0.0,
        known=False,
        findings=(
            *(lacking(name, NEEDS[name], 0.0) for name in BRINGS),
            *("log-gaps", WITHOUT_MASS, "uneven-motor"),
        ),
        health={"position_sigma": {"median": 9.0, "max": 30.0}},
    )
    slow = good(
        "slow",
        parameters=(),
        findings=(WITHOUT_MASS,),
        excitation={"headings": 1, "speed_std": [0.1, 0.1]},
    )
    advice = for_craft([everything, slow])
    assert len(advice) == 7 <= MOST
    assert [item.rank for item in advice] == sorted(item.rank for item in advice)
    for load in json.loads(json.dumps(plain(advice), allow_nan=False)):
        assert load["do"]
        assert load["why"]
        assert load["gain"]
