"""The notch from raw batches: lines of motors, and noise at the mixer that filters in the time domain confirm."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from logparse import Tables, read_log
from simulation.axis_loop import AxisPlant, LoopGains
from sysid.autopilot.motor_lines import LineError, gyro_batches
from sysid.autopilot.notches import gyro_rms, mixer_rms, motor_noise, notch_study, notch_values
from sysid.autopilot.values import AutopilotValues
from sysid.loops.filters import cascade, harmonic_notches
from sysid.loops.loop import rate_loop
from tests.sysid.axis_flights import flown_loop
from tests.sysid.flights import PartsOfLog

RATE, SIZE = 1000.0, 1024
FILTERS = {f"ATC_RAT_{axis}_{name}": 20.0 for axis in ("RLL", "PIT", "YAW") for name in ("FLTT", "FLTD")}
PARAMETERS = FILTERS | {"INS_GYRO_FILTER": 40.0, "SCHED_LOOP_RATE": 400.0} | {
    f"ATC_RAT_{axis}_{name}": value
    for axis in ("RLL", "PIT", "YAW")
    for name, value in {"P": 0.1, "I": 0.1, "D": 0.003, "FLTE": 0.0, "IMAX": 0.5}.items()
} | {f"ATC_ANG_{axis}_P": 4.5 for axis in ("RLL", "PIT", "YAW")}  # fmt: skip


#: Outputs of a controller that hears far more than the filters of the parameters let through.
LOUD = pd.DataFrame(
    np.random.default_rng(1).normal(0.0, 0.3, (7000, 3)), np.arange(7000) / 100.0, ["out_roll", "out_pitch", "out_yaw"]
)


def flight(hover_hz=83.0, exponent=0.5, sag=0.0, option=0, instances=(0,), rates=None, loud=1.0, esc=0.0, **parameters):
    """Make thirty batches at steady throttles of a craft whose fundamental is weaker than its second harmonic."""
    generator, tables = np.random.default_rng(7), []
    t = np.arange(SIZE) / RATE
    throttles = np.tile([0.4, 0.4, 0.4, 0.5, 0.3, 0.4], 5)
    starts = 10.0 + 2.0 * np.arange(len(throttles))
    for number, (start, throttle) in enumerate(zip(starts, throttles, strict=True)):
        hz = hover_hz * (throttle / 0.4) ** exponent * (1.0 - sag * number / len(throttles))
        noise = 0.003 * generator.standard_normal((SIZE, 3))
        for k, amplitude in ((1, 0.03), (2, 0.08)):
            noise += loud * amplitude * np.sin(2.0 * np.pi * (k * hz * t + generator.uniform()))[:, None]
        tables.append(pd.DataFrame(noise, columns=["gyro_x", "gyro_y", "gyro_z"], index=start + t).assign(batch=number))
    setpoints = pd.DataFrame(
        {"throttle": np.repeat(throttles, 4)}, index=np.add.outer(starts, [-0.4, 0.3, 0.9, 1.4]).ravel()
    )
    line = 2.0 * np.pi * hover_hz * (np.repeat(throttles, 4) / 0.4) ** exponent
    speeds = pd.DataFrame({"w1": esc * line, "w2": esc * line}, index=setpoints.index)
    heads = pd.DataFrame([(1, instance, 1e6) for instance in instances], columns=["type", "instance", "mul"])
    vehicle = SimpleNamespace(firmware="ArduCopter", version="4.5.7")
    return PartsOfLog(
        name="made.bin",
        path=SimpleNamespace(name="made.bin"),
        flight=SimpleNamespace(start=5.0, stop=75.0),
        vehicle=vehicle,
        messages={"ISBH": heads},
        parameters_flown=PARAMETERS | {"INS_LOG_BAT_OPT": float(option)} | parameters,
        tables=Tables(
            setpoints=setpoints,
            rates=rates,
            esc=speeds if esc else None,
            further={"gyro_batch": (pd.concat(tables),) * len(instances)},
        ),
    )


def proposed(log):
    return AutopilotValues((log.name,), tuple(notch_values(log, notch_study(log), {}, log.parameters_flown))).proposed


def test_lines_and_what_they_follow():
    notch = proposed(flight())
    assert notch["INS_HNTCH_FREQ"] == pytest.approx(83.0, rel=0.005)
    assert (notch["INS_HNTCH_MODE"], notch["INS_HNTCH_REF"], notch["INS_HNTCH_HMNCS"]) == (1.0, 0.4, 3.0)
    # Where ESCs report the line's speed the notch follows them; where they report another, as with wrong poles, not.
    by_esc = proposed(flight(esc=1.0))
    assert (by_esc["INS_HNTCH_MODE"], by_esc["INS_HNTCH_REF"], by_esc["INS_HNTCH_FM_RAT"]) == (3.0, 1.0, 1.0)
    # FREQ is then no frequency of hover but the lowest that is followed (ArduPilot's parameter reference).
    assert by_esc["INS_HNTCH_FREQ"] == pytest.approx(notch["INS_HNTCH_FM_RAT"] * notch["INS_HNTCH_FREQ"], rel=0.01)
    assert by_esc["INS_HNTCH_BW"] < by_esc["INS_HNTCH_FREQ"]
    assert proposed(flight(esc=0.5))["INS_HNTCH_MODE"] == 1.0
    lines = notch_study(flight(exponent=0.8)).lines
    assert lines.exponent == pytest.approx(0.8, abs=0.05)


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        ({"exponent": 0.0}, "a mode of the frame"),
        ({"sag": 0.12}, "battery that sags"),
        ({"instances": (1,)}, "of IMU 2, and the loops fly on IMU 1"),
        ({"option": 2}, "behind the filters"),
        ({"loud": 0.001}, "no notch is needed"),
        ({"option": 4, "instances": (0, 1, 3, 4)}, "did not fly"),  # what is behind the filters is what is before them
        ({"rates": LOUD}, "did not fly"),
    ],
)  # fmt: skip
def test_what_the_batches_cannot_tell_is_named(made, reason):
    with pytest.raises(LineError, match=reason):
        notch_study(flight(**made))


@pytest.mark.parametrize(
    ("notch", "right"),
    [
        ({"MODE": 1.0, "REF": 0.4, "FREQ": 83.2}, True),
        ({"MODE": 1.0, "REF": 0.3, "FREQ": 83.2}, False),
        ({"MODE": 3.0, "REF": 1.0, "FREQ": 60.0}, True),  # follows the rotors wherever they turn
        ({"MODE": 3.0, "REF": 1.0, "FREQ": 100.0}, False),
    ],
)
def test_a_notch_that_flies_right_stays(notch, right):
    flown = {"ENABLE": 1.0, "BW": 41.0, "ATT": 40.0, "HMNCS": 7.0} | notch
    assert (not proposed(flight(**{f"INS_HNTCH_{name}": value for name, value in flown.items()}))) == right


def test_a_notch_that_hides_a_mode_of_the_frame_stays():
    """The frame bends at 30 Hz, where the notch stands that flew: at the motors' line it leaves the mode to ring."""
    craft = AxisPlant(gain=300.0, damping=1.0, lag=0.02, delay=0.002, filter_hz=40.0)
    loop = flown_loop(craft, LoopGains(P=0.05, I=0.05, D=0.001), 1)
    hidden = tuple(harmonic_notches(RATE, 30.0, nominal=30.0, bandwidth=15.0, attenuation_db=40.0, harmonics=1))
    s, omega = 2j * np.pi * loop.hz, 2.0 * np.pi * 30.0
    bends = 1.0 + s**2 / (s**2 + 0.06 * omega * s + omega**2)
    behind = cascade(hidden, loop.hz)
    flown = replace(loop.flown, gyro=replace(loop.flown.gyro, notches=hidden, rate=RATE))
    for frame, stays in ((1.0, False), (bends, True)):
        draws = loop.plant.draws * frame * behind
        plant = replace(loop.plant, response=loop.plant.response * frame * behind, draws=draws, own_draws=draws)
        loops = {"roll": replace(loop, plant=plant, flown=flown, settings=flown)}
        notch = {"ENABLE": 1.0, "FREQ": 30.0, "HMNCS": 1.0, "BW": 15.0, "ATT": 40.0}
        log = flight(**{f"INS_HNTCH_{name}": x for name, x in notch.items()})
        values = notch_values(log, notch_study(log, loops), loops, log.parameters_flown)
        frequency = next(value.proposed for value in values if value.name == "INS_HNTCH_FREQ")
        assert (frequency.value is None) == stays
        assert ("hides" in frequency.reason) == stays


def test_firmware_flights_before_and_after_a_notch(unpacked):
    """The fundamental within 2 %; noise in hover within 3 dB as flown, and of the next flight with its notch."""
    craft, hz, with_notch = "quad15", 94.1, 0.00053
    before, after = (read_log(unpacked(f"autopilot/vibration_{craft}_{name}")) for name in ("off", "notch"))
    study, flown = notch_study(before), notch_study(after)
    assert study.lines.hz == pytest.approx(hz, rel=0.005)
    assert study.lines.harmonics == (1, 2)
    foretold = motor_noise(before, study.lines, after.parameters_flown)
    for log, seen in ((before, study), (after, flown)):
        measured = mixer_rms(log, seen.lines.batches)
        for axis in ("roll", "pitch"):
            assert 20.0 * abs(np.log10(seen.now.mixer[axis] / measured[axis])) < 1.0
    assert 20.0 * abs(np.log10(foretold.mixer["roll"] / with_notch)) < 3.0
    # The craft sways a little more behind a notch, whose lag is in its loops: chirps of another flight tell.
    loops = {"roll": rate_loop(read_log(unpacked(f"pairs/{craft}_id")), "roll")}
    closer = motor_noise(before, study.lines, after.parameters_flown, loops)
    assert 20.0 * abs(np.log10(closer.mixer["roll"] / with_notch)) < 2.0
    behind = [batch for batch in gyro_batches(after)[1] if batch.steady]
    assert 20.0 * abs(np.log10(foretold.gyro / gyro_rms(behind))) < 3.0
    assert proposed(before)["INS_HNTCH_FREQ"] == pytest.approx(hz, rel=0.005)
    assert not proposed(after)
