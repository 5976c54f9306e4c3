"""Motor outputs against what the mixer asks for: swapped, rotated, reversed, one of them weak, and in order."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from logparse import MissingDataError, Motor, Vehicle
from sysid import Experiment
from sysid.records.mixer import expectation
from sysid.records.motor_scaling import command_for, motor_pwm
from sysid.rotors.motor_order import motor_order

#: Frames as (angles in degrees, spins).
QUAD_X = ((45.0, 1), (-135.0, 1), (-45.0, -1), (135.0, -1))
OCTA_PLUS = tuple(
    (angle, 1 if k in (0, 1, 6, 7) else -1) for k, angle in enumerate((0, 180, 45, 135, -45, -135, -90, 90))
)


def flown(frame, seed, seconds=90.0, rate=10.0, yaw_gain=1.0):
    """Return a flight of a mixer with slow random commands, motor outputs in whole microseconds, noise on both."""
    rng = np.random.default_rng(seed)
    motors = tuple(
        Motor(
            number=k,
            channel=k,
            angle=float(np.radians(angle)),
            spin=-spin,
            layer=None,
            roll=-0.5 * float(np.sin(np.radians(angle))),
            pitch=0.5 * float(np.cos(np.radians(angle))),
            yaw=0.5 * float(spin),
        )
        for k, (angle, spin) in enumerate(frame, start=1)
    )
    vehicle = Vehicle(motors=motors, pwm_min=1000.0, pwm_max=2000.0, spin_min=0.15, spin_max=0.95, thrust_expo=0.65)
    t = np.arange(round(seconds * rate)) / rate
    kernel = np.exp(-np.arange(0.0, 3.0, 1.0 / rate))
    noise = rng.standard_normal((len(t) + len(kernel), 4))
    slow = np.column_stack([np.convolve(column, kernel, "same")[: len(t)] for column in noise.T]) / np.sqrt(rate)
    outputs = np.array([0.3, 0.0, 0.01, -0.01]) + slow * np.array([0.01, 0.01, 0.01, 0.01])
    done = outputs * np.array([1.0, 1.0, 1.0, yaw_gain])
    factors = np.array([[motor.roll, motor.pitch, motor.yaw] for motor in motors])
    thrust = 1.05 * expectation(done, factors)
    pwm = np.array([[motor_pwm(command_for(float(one), 0.65), vehicle) for one in row] for row in thrust]).round()
    names = {"out_thrust": 0, "out_roll": 1, "out_pitch": 2, "out_yaw": 3}
    logged = outputs + 0.002 * rng.standard_normal(outputs.shape)

    context = pd.DataFrame({name: logged[:, k] for name, k in names.items()}, index=pd.Index(t, name="t"))
    return Experiment.from_arrays(
        t,
        pwm,
        np.zeros((len(t), 3)),
        name="mixed",
        input_names=[f"m{k + 1}" for k in range(len(motors))],
        output_names=("x", "y", "z"),
        context=context,
        vehicle=vehicle,
    )


@pytest.mark.parametrize("frame", [QUAD_X, OCTA_PLUS])
def test_another_order_is_found_and_named(frame):
    """Two swapped, all rotated by one, reversed: every output is put on the motor of the mixer that it follows."""
    for seed in range(4):
        seen = flown(frame, seed, yaw_gain=0.8 if seed % 2 else 1.0)
        count = len(frame)
        swapped = list(range(count))
        i, j = np.random.default_rng(seed).choice(count, 2, replace=False)
        swapped[i], swapped[j] = swapped[j], swapped[i]
        for order in (swapped, [*range(1, count), 0], list(range(count))[::-1]):
            found = motor_order(replace(seen, u=np.ascontiguousarray(seen.u[:, order])))
            assert [finding.id for finding in found.findings] == ["motor-order"]
            assert [found.follows[f"m{k + 1}"] for k in range(count)] == [f"m{k + 1}" for k in order]


@pytest.mark.parametrize("frame", [QUAD_X, OCTA_PLUS])
def test_one_uneven_output_is_found_and_its_size(frame):
    """An output that gives 10 % less above idle than it should; the curve makes it about 14 % of thrust."""
    seen = flown(frame, 7)
    vehicle, pwm = seen.vehicle, seen.u.copy()
    idle = motor_pwm(0.0, vehicle)
    pwm[:, 2] = idle + 0.9 * (pwm[:, 2] - idle)
    found = motor_order(replace(seen, u=pwm))
    assert [(finding.id, finding.evidence["motor"]) for finding in found.findings] == [("uneven-motor", "m3")]
    assert found.findings[0].evidence["share"] == pytest.approx(0.86, abs=0.03)


def test_forty_flights_in_order_raise_nothing():
    for seed in range(20):
        for frame in (QUAD_X, OCTA_PLUS):
            assert not motor_order(flown(frame, 100 + seed, yaw_gain=0.5 + 0.025 * seed)).findings


def test_what_is_needed_is_said():
    seen = flown(QUAD_X, 1)
    with pytest.raises(MissingDataError, match="RATE"):
        motor_order(replace(seen, context=None))
    with pytest.raises(MissingDataError, match="frame"):
        motor_order(replace(seen, vehicle=None))
    with pytest.raises(MissingDataError, match="only"):
        motor_order(seen.window(0.0, 10.0))
