"""Thrust per motor command from the accelerometer and the motor outputs of a flight.

A multirotor's accelerometer measures, along body z, thrust over mass: ``-f_z = sum_k T_k / m``. The autopilot maps
the thrust that it wants to PWM by a curve of its own (ArduPilot `AP_MotorsMulticopter`: MOT_PWM_MIN/MAX,
MOT_SPIN_MIN/MAX, MOT_THST_EXPO), and its inverse says which thrust a PWM stands for::

    c   = (pwm - pwm(spin_min)) / (pwm(spin_max) - pwm(spin_min))        command, 0 .. 1
    g   = V^2 [(1 - e) c + e c^2]                                        thrust command; V: voltage over reference
    T_k = k_k (rho / 1.225) g_k

so that k is the thrust of one motor at full command in sea-level air. Motion alone gives k / m.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from core.units import STANDARD_GRAVITY
from logparse import Finding
from sysid.records.experiment import Experiment, ExperimentError, require_alike
from sysid.records.motor_scaling import command_for, motor_pwm
from sysid.records.thrust_curve import REFERENCE_DENSITY
from sysid.rotors.thrust_record import ThrustModel
from sysid.rotors.thrust_regression import (
    BLOCK_SECONDS,
    air_sigma_of,
    blocks_of,
    changed_in_flight,
    coefficient,
    coefficients,
    conditions_of,
    mass_unknown,
    outputs_of,
    regress,
    require_specific_force,
    summed,
    unexplained_part,
    unlogged_motors,
)


def fit_thrust(experiments: Experiment | Sequence[Experiment], mass: float | None = None) -> ThrustModel:
    """Estimate thrust per command, alike for all motors, from accelerometer and PWM.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        With context (`f_z` at least); inputs are PWM in us.
    mass : float, optional
        kg; without it thrust is known per unit of mass only.

    Raises
    ------
    MissingDataError
        Without an accelerometer.
    ExperimentError
        When no motor moves or the records differ in kind.
    """
    records = require_alike(experiments)
    require_specific_force(records, mass)
    vehicle, reference, findings = conditions_of(records)
    findings += outputs_of(records, vehicle)
    blocks = [blocks_of(record, vehicle, reference) for record in records]
    usable = sum(len(block.force) for block in blocks)
    motors = records[0].input_names
    if usable < 2 * len(motors) + 4:
        raise ExperimentError(f"{usable} s of flight with all motors inside their range are too few to estimate thrust")
    unlogged = unlogged_motors(records[0], vehicle)
    sums, forces = summed(blocks), [block.force for block in blocks]
    together = regress(sums, forces)
    part = unexplained_part(records, blocks)
    if reference is not None:
        for rows, block in zip(sums, blocks, strict=True):
            findings += changed_in_flight(block, rows @ together.values)
    if mass is None:
        findings.append(mass_unknown())
    expo, density = vehicle.thrust_expo, float(np.mean([block.density for block in blocks]))
    hover = command_for(STANDARD_GRAVITY / (len(motors) * max(float(together.values[0]), 1e-9) * density), expo)
    return ThrustModel(
        name="thrust per motor command, autopilot's thrust curve",
        common=coefficient(float(together.values[0]), float(together.sigma[0]), mass, part, unlogged),
        mass=mass,
        thrust_expo=expo,
        reference_density=REFERENCE_DENSITY,
        reference_voltage=reference,
        damping=float(together.values[1]) if len(together.values) > 1 else None,
        hover_command=hover,
        hover_pwm=motor_pwm(hover, vehicle),
        rmse=together.rmse,
        seconds=usable * BLOCK_SECONDS,
        training=tuple(record.name for record in records),
        findings=tuple(findings),
        air_sigma=air_sigma_of(records),
    )


def thrust_changes(record: Experiment) -> list[Finding]:
    """Ask of a flight, without fitting more than that takes, whether its thrust per mass changed (a load dropped)."""
    vehicle, reference, _ = conditions_of([record])
    if reference is None:
        return []
    block = blocks_of(record, vehicle, reference)
    (rows,) = summed([block])
    return changed_in_flight(block, rows @ coefficients([rows], [block.force])) if len(rows) else []
