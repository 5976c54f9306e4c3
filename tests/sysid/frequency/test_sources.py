"""Responses from what a log has in place of RATE: motors, gyros, throttle, whole microseconds, two axes."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

import logparse
from logparse import FlightLog, Vehicle
from logparse.craft.frames import motor_table
from logparse.dataflash.writer import write_dataflash
from logparse.tables import COLUMNS
from simulation.axis_loop import AxisPlant, AxisRun, LoopGains, Shaking, run_axis
from sysid import frequency
from sysid.frequency.axes import FrequencyError
from sysid.frequency.rate_signals import OUTPUTS, RateSignals, as_motors_got, on_one_clock
from sysid.frequency.records import below
from sysid.frequency.survey import survey
from sysid.records.mixer import expectation, patterns, thrust_commands
from sysid.records.motor_scaling import commands_for, motor_pwm
from tests.sysid.axis_flights import logged

PLANT = AxisPlant(gain=150.0, damping=2.0, lag=0.03, delay=0.004, filter_hz=40.0)
STICKS = Shaking(duration=90.0, stick=0.25, gust=0.2, noise=0.003)
CHIRP = Shaking(duration=60.0, chirp=(0.4, 25.0, 0.12), chirp_seconds=59.0, gust=0.2, noise=0.003)


def flown(folder: Path, excitation: Shaking, motors: dict[str, float], **parameters: float) -> logparse.FlightLog:
    run = run_axis(PLANT, LoopGains.crossing_at(PLANT, 2.5), excitation, 3)
    return logged(folder, run, rate=400.0, filter_hz=40.0, parameters=parameters, motors=motors)


def error(frf: frequency.FrequencyResponse, plant: AxisPlant, low: float, high: float) -> np.ndarray:
    good = frf.usable & (frf.hz > low) & (frf.hz < high)
    assert np.mean(good[(frf.hz > low) & (frf.hz < high)]) > 0.9
    return np.asarray(np.log(frf.response / plant.response(frf.hz))[good])


@pytest.mark.parametrize("excitation", [STICKS, CHIRP], ids=["sticks", "chirp"])
def test_motor_outputs_and_gyros_stand_for_the_rate_controller(tmp_path: Path, excitation: Shaking) -> None:
    # Gyros four times as fast as motor outputs: unfiltered, they would fold.
    log = flown(tmp_path, excitation, {"rcou": 50.0, "imu": 200.0})
    frf = frequency.response(log, "roll")
    assert frf.source == "motor outputs to gyros"
    wrong = error(frf, PLANT, 0.7, 8.0)
    assert np.percentile(np.abs(wrong.real), 95) * 8.686 < 1.0
    assert np.degrees(np.percentile(np.abs(wrong.imag), 95)) < 5.0
    gain = frequency.fit(frf).parameters["gain"]
    assert gain.value == pytest.approx(150.0, rel=0.1)


def test_nothing_folds_and_what_is_below_passes() -> None:
    t, at = np.arange(4000) * 0.0025, np.arange(20, 80) * 0.1
    signals = np.column_stack([np.sin(2.0 * np.pi * 3.0 * t), np.sin(2.0 * np.pi * 8.7 * t)])
    chirps = below(t, signals, at, 0.1)
    known = np.isfinite(chirps).all(axis=1)
    assert known.sum() > 40
    assert chirps[known, 0] == pytest.approx(np.sin(2.0 * np.pi * 3.0 * at[known]), abs=0.01)
    assert np.max(np.abs(chirps[known, 1])) < 0.01


def test_motors_with_one_whole_reading_are_no_pair() -> None:
    """A garbled telemetry log left one row of all motors: its step was infinite, and the stage ended in a traceback."""
    one = pd.DataFrame({"out_roll": [0.1]}, index=[1.0])
    gyros = pd.DataFrame({"w_x": np.zeros(200)}, index=0.01 * np.arange(200))
    with pytest.raises(FrequencyError):
        on_one_clock(one, gyros)


VEHICLE = Vehicle(motors=motor_table("octa", "plus"), battery_voltage_max=12.6)
NAMES = [f"m{motor.number}" for motor in VEHICLE.motors]


def flown_rounded(seed: int = 1) -> tuple[RateSignals, FlightLog, pd.DataFrame]:
    """Return a hover with slow commands of a few us in thinning air on a sinking battery, and what motors got of it."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 60.0, 0.01)
    slow = [0.004 * np.sin(2.0 * np.pi * hz * t + rng.uniform(0.0, 6.0)) for hz in (0.5, 0.7, 0.3)]
    outputs = np.column_stack([0.3 + 0.01 * np.sin(0.2 * t), *slow])
    factors = np.array([[motor.roll, motor.pitch, motor.yaw] for motor in VEHICLE.motors])
    voltage, air = np.linspace(12.4, 11.6, len(t)), np.linspace(1.05, 1.06, len(t))
    command = commands_for(air[:, None] * expectation(outputs, factors), VEHICLE.thrust_expo)
    pwm = np.floor(motor_pwm(command * (12.6 / voltage)[:, None], VEHICLE))
    motors = pd.DataFrame(pwm, index=t, columns=NAMES)
    got = patterns(thrust_commands(motors + 0.5, VEHICLE, voltage).div(air, axis=0), VEHICLE)
    columns = dict(zip(OUTPUTS.values(), outputs.T, strict=True))
    battery = pd.DataFrame({"voltage": voltage[::10]}, index=t[::10])
    tables = SimpleNamespace(motors=motors.iloc[::10], battery=battery)
    log = cast(FlightLog, SimpleNamespace(tables=tables, vehicle=VEHICLE))
    return RateSignals(t, columns, with_chirp=True), log, got


def test_ten_rows_a_second_of_motors_tell_what_was_cut_off_every_output() -> None:
    signals, log, got = flown_rounded()
    records = as_motors_got(log, signals)
    for name, column in OUTPUTS.items():
        cut = np.std(got[name] - signals.columns[column])
        # What is cut off all motors alike is partly taken for the air, which shifts where the others are cut.
        assert np.std(got[name] - records.columns[column]) < 0.6 * cut, name


@pytest.mark.parametrize("spoiled", ["other motors", "a late log", "finer outputs"])
def test_motors_that_are_not_understood_change_nothing(spoiled: str) -> None:
    signals, log, _ = flown_rounded()
    motors = log.tables.motors
    if spoiled == "other motors":
        motors = motors + np.rint(3.0 * np.sin(motors.index.to_numpy()))[:, None] * np.sign(np.arange(8) - 3.5)
    elif spoiled == "a late log":
        motors = motors.set_index(motors.index + 0.7)
    else:
        motors = motors + 0.3
    late = cast(FlightLog, SimpleNamespace(tables=SimpleNamespace(motors=motors, battery=None), vehicle=VEHICLE))
    assert as_motors_got(late, signals) is signals


GAIN, LAG = 22.0, 0.06


def _rows(name: str, units: str, t: np.ndarray, columns: dict[str, object]) -> tuple:
    times = np.rint(t * 1e6).astype(np.uint64)
    form, plain = "Q" + "f" * len(columns), "F" + "-" * len(columns)
    return name, form, units.ljust(len(form), "-"), plain, pd.DataFrame({"TimeUS": times, **columns})


def _flown(folder: Path, *, stick: float, seed: int = 1, seconds: float = 90.0) -> logparse.FlightLog:
    """Fly a throttle that is moved every second or so, in gusts, with motors that lag and shake the accelerometer."""
    rng = np.random.default_rng(seed)
    dt = 1e-3
    n = int(seconds / dt)
    t = 5.0 + dt * np.arange(n)
    held = np.repeat(rng.normal(0.0, stick, int(seconds) * 2), n // (int(seconds) * 2))
    smooth = np.exp(-dt / 0.15)
    pilot = 0.5 + lfilter([(1.0 - smooth) ** 2], [1.0, -2.0 * smooth, smooth**2], held)
    pole, gust = np.exp(-dt / LAG), np.exp(-dt / 0.2)
    thrust = lfilter([1.0 - pole], [1.0, -pole], pilot - 0.5)
    wind = lfilter([np.sqrt(1.0 - gust**2)], [1.0, -gust], rng.normal(0.0, 0.2, n))
    felt = -9.81 - GAIN * thrust + wind + 2.0 * np.sin(2.0 * np.pi * 93.0 * t)
    slow, fast = slice(None, None, 100), slice(7, None, 20)
    zero = np.zeros(len(t[fast]))
    gyro = {"GyrX": zero, "GyrY": zero, "GyrZ": zero}
    path = folder / "throttle.BIN"
    write_dataflash(
        path,
        [
            ("MSG", "QZ", "s-", "F-", pd.DataFrame({"TimeUS": [1], "Message": ["ArduCopter V3.3"]})),
            _rows("IMU", "sEEEooo", t[fast], {**gyro, "AccX": zero, "AccY": zero, "AccZ": felt[fast]}),
            _rows("CTUN", "s", t[slow], {"ThrIn": 1e3 * pilot[slow], "ThrOut": 1e3 * pilot[slow]}),
        ],
    )
    return logparse.read_log(path)


def test_throttle_and_accelerometer_tell_the_thrust_per_throttle_within_their_errors(tmp_path: Path) -> None:
    scores = []
    for seed in range(6):
        frf = frequency.response(_flown(tmp_path, stick=0.05, seed=seed), "vertical")
        assert frf.instrument == "pilot's throttle"
        parameters = frequency.fit(frf).parameters
        scores.append((parameters["gain"].value - GAIN) / parameters["gain"].sigma)
        assert parameters["effective_delay"].value == pytest.approx(LAG, abs=0.04)
    assert np.sqrt(np.mean(np.square(scores))) < 1.5


def test_a_throttle_that_hardly_moves_and_that_of_the_height_controller_are_no_instrument(tmp_path: Path) -> None:
    """CTUN.ThI of firmware since 3.4 answers the wind."""
    with pytest.raises(frequency.FrequencyError, match="hardly moved"):
        frequency.response(_flown(tmp_path, stick=1e-4), "vertical")
    log = _flown(tmp_path, stick=0.1)
    log.messages.replace("CTUN", log.messages["CTUN"].rename(columns={"ThrIn": "ThI"}))
    with pytest.raises(frequency.FrequencyError, match="hardly moved, nor did the target of the height"):
        frequency.response(log, "vertical")


def test_the_thrust_of_another_autopilot_is_a_throttle_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """PX4 says its thrust command among the rates, and the climb asked for; it has no message of a throttle."""
    log = _flown(tmp_path, stick=0.1)
    rows = log.messages["CTUN"]["ThrOut"] / 1e3
    columns = {"rates": ("out_thrust", rows), "setpoints": ("v_d_ref", 2.0 * (0.5 - rows))}
    remarks = {
        name: pd.DataFrame({column: values}).reindex(columns=list(COLUMNS[name]))
        for name, (column, values) in columns.items()
    }
    monkeypatch.setattr(FlightLog, "tables", log.tables.changed(**remarks))
    log.messages.replace("CTUN", rows.iloc[:0].to_frame())
    frf = frequency.response(log, "vertical")
    assert frf.instrument == "height target"
    assert frequency.fit(frf).parameters["gain"].value == pytest.approx(GAIN, rel=0.05)


ROLL = AxisPlant(gain=300.0, damping=2.0, lag=0.03)
PITCH = replace(ROLL, gain=180.0)
SIGNALS = ("output", "feedback", "measured", "target", "attitude", "stick")


def turned(folder: Path, degrees: float, seeds: tuple[int, int], *, chirps: bool) -> logparse.FlightLog:
    """Fly both axes with the same controller, and log them in a frame that is turned about z.

    A loop whose controller is the same about all horizontal axes is the same loop in every frame: the truth is the
    plants' matrix in the turned one, with (K_roll - K_pitch) sin cos beside its diagonal.
    """
    controller = LoopGains.crossing_at(PITCH, 3.0)
    if chirps:
        shaken = Shaking(duration=70.0, chirp=(0.4, 20.0, 0.06), chirp_seconds=30.0, gust=0.3, noise=0.003)
    else:
        shaken = Shaking(duration=90.0, stick=0.2, gust=0.3, noise=0.003)
    flown = [
        run_axis(plant, controller, replace(shaken, sid_axis=10 + k, chirp_start=35.0 * k), seed)
        for k, (plant, seed) in enumerate(zip((ROLL, PITCH), seeds, strict=True))
    ]
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y = ({name: getattr(run, name) for name in SIGNALS} for run in flown)
    runs: dict[str, AxisRun] = {
        "roll": replace(flown[0], **{name: c * x[name] - s * y[name] for name in SIGNALS}),
        "pitch": replace(flown[1], **{name: s * x[name] + c * y[name] for name in SIGNALS}),
    }
    return logged(folder, runs)


def test_sticks_on_both_axes_show_what_roll_does_to_pitch(tmp_path: Path) -> None:
    surveyed = survey(turned(tmp_path, 15.0, (1, 2), chirps=False), ("roll", "pitch"))
    c, s = np.cos(np.radians(15.0)), np.sin(np.radians(15.0))
    across = (ROLL.gain - PITCH.gain) * s * c
    truth = {
        "roll": across / (ROLL.gain * c**2 + PITCH.gain * s**2),
        "pitch": across / (ROLL.gain * s**2 + PITCH.gain * c**2),
    }
    assert {coupling.axis for coupling in surveyed.couplings} == {"roll", "pitch"}
    for coupling in surveyed.couplings:
        assert coupling.significant
        assert coupling.ratio.value == pytest.approx(truth[coupling.axis], abs=max(3.0 * coupling.ratio.sigma, 0.01))
        assert coupling.ratio.sigma < 0.02


@pytest.mark.parametrize("chirps", [False, True], ids=["sticks", "chirps"])
def test_axes_that_do_not_couple_are_said_not_to(tmp_path: Path, chirps: bool) -> None:
    surveyed = survey(turned(tmp_path, 0.0, (3, 4), chirps=chirps), ("roll", "pitch"))
    assert len(surveyed.couplings) == 2
    for coupling in surveyed.couplings:
        assert not coupling.significant
        assert coupling.ratio.sigma < 0.03
