"""Thrust and torque coefficients from flight by output error, after Kim 2017 (AIAA 2017-1560), section III.E.

Altitude, roll rate and pitch rate are propagated from eq. 3, 7 and 8 and matched to the flight::

    d2h/dt2 = -g + cos(phi) cos(theta) sum_i T_i / m
    dp/dt   = (Iyy - Izz) / Ixx q r - l / Ixx sum_i y_i T_i          (x_i, y_i): motor i in arms ahead, to the right
    dq/dt   = (Izz - Ixx) / Iyy p r + l / Iyy sum_i x_i T_i          T_i = k_i s_i (`sysid.records.thrust_curve`)

and the mean torque coefficient comes from least squares on eq. 9, ``dr/dt = (Ixx - Iyy)/Izz p q + b/Izz sum_i c_i s_i``
(c_i = -1 for a clockwise rotor). With attitude and the rates of the products as measured, the outputs are linear in the
coefficients and the initial states, so that output error needs no search. Three things differ from the paper: altitude
is propagated in the earth's frame, which needs no small horizontal speeds; the states start anew every few seconds
(multiple shooting), because open-loop rates drift with any offset; and the air slows climb and sink by a free part of
their speed, for which thrust would make up. Motors whose torque coefficients differ turn the
craft when they roll, pitch or lift it, which the mean coefficient alone would be bent to explain (the paper found four
times the bench's torque): total thrust and the roll and pitch moments stand beside it in the regression. Without
inertia and arm, ``l m / Ixx`` and ``l m / Iyy`` are fitted too, and a free multiple of each product of rates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from core.quantity import uncertain
from core.summary import Summarised, listed
from core.units import STANDARD_GRAVITY
from logparse import Finding
from sysid.records.experiment import Experiment, ExperimentError, Floats, require_alike
from sysid.records.motor_signals import MotorGeometry, motor_geometry, unexplained
from sysid.records.thrust_curve import Law, law_of
from sysid.rotors.kim2017_windows import (
    FlightData,
    TorqueEstimate,
    cut_windows,
    gyroscopic,
    integrate,
    integrate_twice,
    mean_torque,
    motor_patterns,
    output_error,
)
from sysid.rotors.thrust_record import ThrustCoefficient
from sysid.rotors.thrust_regression import (
    blocks_of,
    coefficient,
    conditions_of,
    require_all_motors,
    unexplained_part,
)

#: Ratio of extreme singular values of the scaled sensitivities above which motors are not told apart: there errors of a
#: few parts in ten thousand in model or signals become tens of percent, which no standard error shows. Simulated craft
#: of four motors have 300 to 1000, of eight motors driven by four commands 4e4 and more.
SEPARABLE = 3e3

#: Part by which one lag and straight lines between samples misrepresent what commands do to roll and pitch.
LEVER_LAW = 0.015

#: Part by which torque goes otherwise with a command than thrust does.
TORQUE_LAW = 0.03


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Kim2017Model(Summarised):
    """Thrust coefficient of each motor and the mean torque coefficient."""

    name: str
    law: Law  #: Whether coefficients are per square of rotor speed or at full command.
    common: ThrustCoefficient  #: The same thrust coefficient for all motors, fitted by itself.
    per_motor: Mapping[str, ThrustCoefficient]
    lever: tuple[float, float]  #: l m / Ixx and l m / Iyy, 1/m: as given, or fitted.
    lever_sigma: tuple[float, float]  #: 0 where given.
    #: b / Izz, mean of the motors, in rad/s^2 at full command or per squared rotor speed; None when not determined.
    torque_per_inertia: float | None
    torque_sigma: float | None
    #: Yaw acceleration for each motor's signal, in the same unit: what the simulation of the yaw rate takes.
    yaw: tuple[float, ...]
    mass: float | None  #: kg.
    inertia: tuple[float, float, float] | None  #: kg m^2, as given.
    reference_voltage: float | None  #: V.
    thrust_expo: float
    time_constant: float  #: Lag taken for the motors, s; the paper takes none.
    rotation: bool  #: Whether motor signals were fast enough for the rates; levers and torque mean nothing otherwise.
    rmse: Mapping[str, float]  #: Of altitude [m] and rates [rad/s] in the windows.
    #: Part of the power of the rates in the windows that the model explains (R^2), by ``w_x``, ``w_y``, ``w_z``.
    explained: Mapping[str, float]
    geometry: MotorGeometry
    training: tuple[str, ...]
    findings: tuple[Finding, ...]  #: What of craft, air and battery is assumed; what is not determined has its reason.
    #: Thrust coefficients of a thrust stand to compare with, by motor, and ``"torque"``.
    bench: Mapping[str, float] = field(default_factory=dict)

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {
            "name": self.name,
            "thrust over mass of one motor": uncertain(self.common.per_mass, self.common.sigma),
            "training": listed(self.training),
            "findings": listed(dict.fromkeys(finding.id for finding in self.findings)) or "none",
        }

    @property
    def torque(self) -> tuple[float, float] | None:
        """Mean torque coefficient b and its standard error; None without Izz or when not determined."""
        if self.inertia is None or self.torque_per_inertia is None or self.torque_sigma is None:
            return None
        return self.torque_per_inertia * self.inertia[2], self.torque_sigma * self.inertia[2]

    def thrust_table(self) -> pd.DataFrame:
        """Return thrust coefficients in the form of Table 6: index ``motor``; stand, flight, standard error, ratio."""
        rows = {
            motor: {"test_stand": self.bench.get(motor, np.nan), **_columns(value)}
            for motor, value in self.per_motor.items()
        }
        table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("motor")
        table["ratio"] = table["flight_test"] / table["test_stand"]
        return table

    def torque_table(self) -> pd.DataFrame:
        """Return the mean torque coefficient in the form of Table 7."""
        value = self.torque
        row = {
            "test_stand": self.bench.get("torque", np.nan),
            "flight_test": value[0] if value else np.nan,
            "sigma": value[1] if value else np.nan,
        }
        table = pd.DataFrame([row], index=pd.Index(["mean of all motors"], name="motor"))
        table["ratio"] = table["flight_test"] / table["test_stand"]
        return table

    def simulate(self, experiment: Experiment) -> pd.DataFrame:
        """Propagate altitude and rates over a whole record from its first sample (the paper's figure 15).

        By time ``z`` [m], ``w_x``, ``w_y`` and, with a torque coefficient, ``w_z`` [rad/s].
        """
        data = FlightData.of(experiment, self.law, self.reference_voltage, self.thrust_expo, self.time_constant)
        thrust = data.signals * self._specific()
        z = data.altitude[0] - experiment.context["v_d"].iloc[0] * data.t if experiment.context is not None else data.t
        z = (
            z
            - 0.5 * STANDARD_GRAVITY * data.t**2
            + integrate_twice(data.lift * thrust.sum(axis=1, keepdims=True), data.dt)[:, 0]
        )
        gyro = gyroscopic(data, self.inertia)
        result = {
            "z": z,
            "w_x": data.rates[0, 0] + gyro[0] - self.lever[0] * integrate(thrust @ self.geometry.right, data.dt),
            "w_y": data.rates[0, 1] + gyro[1] + self.lever[1] * integrate(thrust @ self.geometry.forward, data.dt),
        }
        if self.torque_per_inertia is not None:
            result["w_z"] = data.rates[0, 2] + gyro[2] + integrate(data.signals @ np.array(self.yaw), data.dt)
        return pd.DataFrame(result, index=pd.Index(experiment.t, name="t"))

    def verify(self, experiment: Experiment) -> pd.DataFrame:
        """Compare `simulate` and the mean with a part of the flight that was not fitted: RMS errors by output."""
        simulated = self.simulate(experiment)
        data = FlightData.of(experiment, self.law, self.reference_voltage, self.thrust_expo, self.time_constant)
        measured = {"z": data.altitude, **{f"w_{axis}": data.rates[:, k] for k, axis in enumerate("xyz")}}
        rows = {
            name: {
                "rmse": float(np.sqrt(np.mean((simulated[name].to_numpy() - measured[name]) ** 2))),
                "rmse_of_mean": float(np.std(measured[name])),
            }
            for name in simulated.columns
        }
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("output")

    def _specific(self) -> Floats:
        """Return k_i / m for the simulation: each motor's own where determined, the common one elsewhere."""
        usual = self.common.per_mass
        values = [value.per_mass if value.per_mass is not None else usual for value in self.per_motor.values()]
        if any(value is None for value in values):
            raise ExperimentError("no thrust coefficient is determined, so that nothing can be simulated")
        return np.array(values, dtype=np.float64)


def fit_kim2017(
    experiments: Experiment | Sequence[Experiment],
    mass: float | None = None,
    *,
    inertia: tuple[float, float, float] | None = None,
    arm: float | None = None,
    bench: Mapping[str, float] | None = None,
    time_constant: float = 0.0,
    law: Law | None = None,
) -> Kim2017Model:
    """Estimate thrust coefficients by output error and the mean torque coefficient by least squares.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        With outputs that include ``z``, PWM inputs and context.
    mass : float, optional
        kg.
    inertia : tuple of 3 float, optional
        Ixx, Iyy, Izz, kg m^2, such as of a bifilar pendulum.
    arm : float, optional
        Distance of the motors from the centre of gravity, m.
    bench : mapping, optional
        Thrust-stand coefficients by motor name and ``"torque"``, in the unit of the law.
    time_constant : float
        Lag of the motors, s; 0 as in the paper.
    law : Law, optional
        By default rotor speeds where every record has them.

    Raises
    ------
    MissingDataError
        Without altitude, angular rates or the frame's geometry.
    ExperimentError
        When the records differ in kind or a given number is not positive.
    """
    records = require_alike(experiments)
    for label, value in {"mass": mass, "arm": arm, "inertia": None if inertia is None else min(inertia)}.items():
        if value is not None and not value > 0.0:
            raise ExperimentError(f"{label} must be positive, not {value}")
    vehicle, voltage, findings = conditions_of(records)
    require_all_motors(records[0], vehicle)
    geometry = motor_geometry(records[0])
    if law is None:
        law = law_of(records, vehicle)
    known = (
        None if mass is None or inertia is None or arm is None else (arm * mass / inertia[0], arm * mass / inertia[1])
    )
    data = [FlightData.of(record, law, voltage, vehicle.thrust_expo, time_constant) for record in records]
    rotation = all(flight.fast for flight in data)
    windows = [window for flight in data for window in cut_windows(flight, geometry, inertia)]
    motors = records[0].input_names
    together = output_error(windows, np.ones((1, len(motors))), known)
    apart = output_error(windows, np.eye(len(motors)), known, together)
    part = unexplained_part(records, [blocks_of(record, vehicle, voltage, law) for record in records])
    specific = float(together.coefficients[0])
    # What altitude says of thrust errs beside what commands leave unexplained.
    common = coefficient(specific, float(np.hypot(together.sigma[0], part * specific)), mass, part)
    reason = (
        f"the {len(motors)} motors are driven by too few independent signals (singular values differ by "
        f"{apart.condition:.0e})"
        if apart.condition > SEPARABLE
        else ""
    )
    if not rotation and not reason:
        reason = "motor signals are logged too slowly for roll and pitch, which tell motors apart"
    if not reason:
        worst = min(apart.explained.values())
        reason = unexplained(worst, "roll and pitch rates, which tell motors apart")
    per_motor = {
        motor: coefficient(float(apart.coefficients[k]), float(apart.sigma[k]), mass, part, reason)
        for k, motor in enumerate(motors)
    }
    best = together if reason else apart
    torque = mean_torque(windows) if rotation else None
    explained = {**best.explained, **({} if torque is None else {"w_z": torque.explained})}
    # Commands differ from what motors do by lag and filters, which bias levers by up to what they leave unexplained.
    indirect = 0.0 if law is Law.SPEED or known is not None else 1.0
    lever_sigma = [
        float(
            np.linalg.norm(
                [sigma, *(indirect * part * lever for part in (1.0 - best.explained[f"w_{axis}"], LEVER_LAW))]
            )
        )
        for sigma, lever, axis in zip(best.lever_sigma, best.lever, "xy", strict=True)
    ]
    return Kim2017Model(
        name=f"Kim 2017, output error, thrust by {law}",
        law=law,
        common=common,
        per_motor=per_motor,
        lever=(float(best.lever[0]), float(best.lever[1])),
        lever_sigma=(lever_sigma[0], lever_sigma[1]),
        torque_per_inertia=None if torque is None else torque.value,
        torque_sigma=None if torque is None else _torque_sigma(torque, law),
        yaw=() if torque is None else tuple(float(factor) for factor in torque.patterns @ motor_patterns(geometry)),
        mass=mass,
        inertia=inertia,
        reference_voltage=voltage,
        thrust_expo=vehicle.thrust_expo,
        time_constant=time_constant,
        rotation=rotation,
        rmse={**best.rmse, **({} if torque is None else {"w_z": torque.rmse})},
        explained=explained,
        geometry=geometry,
        training=tuple(record.name for record in records),
        findings=tuple(findings),
        bench=dict(bench or {}),
    )


def _torque_sigma(torque: TorqueEstimate, law: Law) -> float:
    """Add to the standard error, for commands, what they leave unexplained and `TORQUE_LAW`.

    What is left over (damping, lag, gusts that the controller answers) goes with the commands by an unknown part of its
    amplitude, -1 to 1: of a uniform one the standard deviation is the root of a third.
    """
    indirect = 0.0 if law is Law.SPEED else float(np.hypot(np.sqrt((1.0 - torque.explained) / 3.0), TORQUE_LAW))
    return float(np.hypot(torque.sigma, indirect * torque.value))


def _columns(value: ThrustCoefficient) -> dict[str, float]:
    return {
        "flight_test": np.nan if value.newton is None else value.newton,
        "sigma": np.nan if value.newton_sigma is None else value.newton_sigma,
    }
