"""Parameters from instants of flight after Refinement 2020 (Silesian University of Technology, Series Transport).

At each instant the equations of motion are linear in the parameters. Translation, with the accelerometer's specific
force f and T = k s for each rotor (`sysid.records.thrust_curve`), FRD::

    f_x = -(C/m) |v_x| v_x      f_y = -(C/m) |v_y| v_y      f_z = -(k/m) sum_i s_i - (C/m) |v_z| v_z

gives (k/m, C/m); then rotation, divided by the arm l, with x_i, y_i the motors' unit arms and c_i = -1 for clockwise::

    (Jx/l) (p' - q r) + (Jz/l) q r = -k sum_i y_i s_i             (Jx = Jy, as the paper takes them)
    (Jx/l) (q' + p r) - (Jz/l) p r =  k sum_i x_i s_i
    (Jz/l)  r'                     =  (b/l) sum_i c_i s_i

gives (Jx/l, Jz/l, b/l), all over m. The paper solves these small systems instant by instant, drops degenerate ones and
takes the mean. That mean is what `Refinement2020Model.instants` holds. It is biased where the regressors are noisy:
differentiated rates multiply the unknown inertia, and noise there makes it come out too small; the median is quoted
beside it. `stacked` holds what should be used: all instants at once, angular acceleration as the dependent variable,
Huber weights against outliers, standard errors for coloured residuals. The paper takes motors to be identical and the
centre of gravity to be in their middle; where they are not, thrust and the other moments turn the craft too, so that
the stacked regression has them beside each axis's own moment.

The translational equations are homogeneous in (m, C, k): motion gives k/m and C/m only, and inertia and torque over m
likewise. Jz and b enter the third equation as their ratio; Jz by itself shows only in products of rates. Air at rest is
assumed, as in the paper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from core.parameter import Parameter
from core.quantity import uncertain
from core.summary import Summarised, listed
from logparse import Finding
from sysid.records.experiment import Experiment, require_alike
from sysid.records.motor_signals import motor_geometry, motor_signals, unexplained
from sysid.records.thrust_curve import Law, lagged, law_of
from sysid.rotors.refinement_instants import (
    PARAMETERS,
    InstantMean,
    InstantMotion,
    best_lag,
    fit_stacked,
    solve_instants,
)
from sysid.rotors.thrust_regression import (
    blocks_of,
    conditions_of,
    require_all_motors,
    require_specific_force,
    unexplained_part,
)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Refinement2020Model(Summarised):
    """Both ways side by side; every number per unit of mass, and J and b over the arm besides."""

    name: str
    law: Law
    #: By the names of `PARAMETERS`: ``k`` k/m, ``C`` C/m [1/m], ``Jx`` and ``Jz`` J/(m l) [m], ``b`` b/(m l), ``b/Jz``.
    instants: Mapping[str, InstantMean]
    stacked: Mapping[str, Parameter]  #: The same, with ``Jy`` by itself.
    mass: float | None  #: As given, kg.
    reference_voltage: float | None
    time_constant: float  #: Lag of the motors in use, s.
    training: tuple[str, ...]
    findings: tuple[Finding, ...]  #: What of craft, air and battery is assumed; what is not determined has its reason.

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {
            "name": self.name,
            **{name: uncertain(estimate.value, estimate.sigma) for name, estimate in self.stacked.items()},
            "training": listed(self.training),
        }


def fit_refinement2020(
    experiments: Experiment | Sequence[Experiment],
    mass: float | None = None,
    *,
    time_constant: float | None = 0.0,
    law: Law | None = None,
) -> Refinement2020Model:
    """Refine the parameters from instants of flight, both as the paper does and stacked.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        PWM inputs, with context; 50 Hz or more for rotation (slower records alias it).
    mass : float, optional
        kg; not used for the estimates, which are per unit of mass.
    time_constant : float or None
        Lag of the motors behind the signal, s; 0 as in the paper, whose signals are rotor speeds. None finds the one
        with which roll and pitch moments explain the angular acceleration best (gyro filters included).
    law : Law, optional
        By default rotor speeds where every record has them.

    Raises
    ------
    MissingDataError
        Without accelerometer, rates, velocity or the frame's geometry.
    ExperimentError
        When the records differ in kind.
    """
    records = require_alike(experiments)
    require_specific_force(records, mass)
    vehicle, voltage, findings = conditions_of(records)
    require_all_motors(records[0], vehicle)
    geometry = motor_geometry(records[0])
    if law is None:
        law = law_of(records, vehicle)
    signals = [motor_signals(record, law, vehicle, voltage, vehicle.thrust_expo) for record in records]
    rotation = all(flight.fast for flight in signals)

    def motion_at(lag: float) -> list[InstantMotion]:
        return [
            InstantMotion.of(record, geometry, lagged(flight.signals, lag, record.dt), flight.rates)
            for record, flight in zip(records, signals, strict=True)
        ]

    if time_constant is None:
        time_constant = best_lag(motion_at(0.0)) if rotation else 0.0
    motion = motion_at(time_constant)
    blocks = [blocks_of(record, vehicle, voltage, law) for record in records]
    stacked, explained = fit_stacked(motion, unexplained_part(records, blocks), law is Law.SPEED)
    instants = solve_instants(motion)
    if not rotation:
        why, rotational = "motor signals are logged too slowly for rotation", list(PARAMETERS)[2:]
        stacked |= {name: Parameter(None, None, "", why) for name in rotational}
        instants |= {name: InstantMean(None, None, None, 0, 0, why) for name in rotational}
    else:
        instants = _believed(instants, explained)
    return Refinement2020Model(
        name=f"Refinement 2020, thrust by {law}",
        law=law,
        instants=instants,
        stacked=stacked,
        mass=mass,
        reference_voltage=voltage,
        time_constant=time_constant,
        training=tuple(record.name for record in records),
        findings=tuple(findings),
    )


def _believed(instants: Mapping[str, InstantMean], explained: Sequence[float]) -> dict[str, InstantMean]:
    """Undo what instants say of rotation where the motors do not explain it: a lag or wind is no inertia."""
    roll, pitch, yaw = explained
    turning = unexplained(min(roll, pitch), f"angular acceleration in {'roll' if roll < pitch else 'pitch'}")
    yawing = unexplained(yaw, "angular acceleration in yaw")
    doubts = {"Jx": turning, "Jz": turning, "b": turning, "b/Jz": yawing}
    return {
        name: instant if instant.mean is None else instant.doubted(doubts.get(name, ""))
        for name, instant in instants.items()
    }
