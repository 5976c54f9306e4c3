"""Outputs of the controllers as motors got them, PWM cut off to whole microseconds."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest

from logparse import FlightLog, Vehicle
from logparse.craft.frames import motor_table
from sysid.frequency.rate_signals import OUTPUTS, RateSignals, as_motors_got
from sysid.records.mixer import expectation, patterns, thrust_commands
from sysid.records.motor_scaling import commands_for, motor_pwm

VEHICLE = Vehicle(motors=motor_table("octa", "plus"), battery_voltage_max=12.6)
NAMES = [f"m{motor.number}" for motor in VEHICLE.motors]


def flown(seed: int = 1) -> tuple[RateSignals, FlightLog, pd.DataFrame]:
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
    signals, log, got = flown()
    found = as_motors_got(log, signals)
    for name, column in OUTPUTS.items():
        cut = np.std(got[name] - signals.columns[column])
        # What is cut off all motors alike is partly taken for the air, which shifts where the others are cut.
        assert np.std(got[name] - found.columns[column]) < 0.6 * cut, name


@pytest.mark.parametrize("spoiled", ["other motors", "a late log", "finer outputs"])
def test_motors_that_are_not_understood_change_nothing(spoiled: str) -> None:
    signals, log, _ = flown()
    motors = log.tables.motors
    if spoiled == "other motors":
        motors = motors + np.rint(3.0 * np.sin(motors.index.to_numpy()))[:, None] * np.sign(np.arange(8) - 3.5)
    elif spoiled == "a late log":
        motors = motors.set_index(motors.index + 0.7)
    else:
        motors = motors + 0.3
    late = cast(FlightLog, SimpleNamespace(tables=SimpleNamespace(motors=motors, battery=None), vehicle=VEHICLE))
    assert as_motors_got(late, signals) is signals
