"""Whether motor outputs are those that the mixer asked for: their order, and how evenly they share the work.

The rate controller's outputs through the frame's factors say what each motor should do; the logged motor outputs,
through the autopilot's thrust curve, what each was told. Over half seconds the departures of both from the mean of all
motors are compared. Which output follows which motor of the mixer is an assignment problem (Kuhn 1955); another order
than the logged one is believed when it is far more likely than what any of the n! orders could be by chance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import lgamma

import numpy as np
from scipy.optimize import linear_sum_assignment

from logparse import Finding, MissingDataError, Severity, Vehicle
from sysid.records.arrays import Floats
from sysid.records.experiment import Experiment
from sysid.records.mixer import INDEPENDENT, expectation
from sysid.records.motor_scaling import curve, motor_commands
from sysid.records.thrust_curve import column

#: Averaging time, s: longer than the motor outputs' sampling, so that attitude control does not alias.
BLOCK_SECONDS = 0.5

#: Fewest blocks that tell an order.
_FEWEST = 40

#: Commands nearer to the ends of a motor's range than this are left out: there the mixer gives what it can.
_MARGIN = 0.02

#: Log-likelihood beyond the logarithm of the number of orders by which another order must be better. Half-second means
#: of a flight are not independent: neighbours count as one.
SURE = 15.0

#: Rounding of outputs to whole microseconds, as a part of the mean thrust, in half-second means.
_ROUNDING = 3e-4

#: Part of the motors' movement that another order must explain.
EXPLAINED = 0.5

#: Departure of a motor's output from what the mixer asks of it that is a finding, and its size in standard errors. The
#: firmware gives what it is asked for within 0.3 %.
UNEVEN, UNEVEN_SIGMAS = 0.03, 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorOrder:
    """How motor outputs follow the mixer over a flight."""

    follows: Mapping[str, str]  #: Motor of the mixer that each output follows best, itself where the log is in order.
    #: Output of each motor over what the mixer asks of it, both over the mean of all motors.
    share: Mapping[str, float]
    share_sigma: Mapping[str, float]
    ratio: float  #: Variance of the residuals in the logged order over that in the best one.
    explained: float  #: Part of the outputs' movement that the best order explains.
    findings: tuple[Finding, ...]


def motor_order(record: Experiment) -> MotorOrder:
    """Compare a flight's motor outputs with what the mixer asked for.

    Parameters
    ----------
    record : Experiment
        Inputs PWM of all motors of the frame, us; with the rate controller's outputs in its context.

    Raises
    ------
    MissingDataError
        When the frame, a motor's output or the rate controller's outputs are missing, or the flight is too short.
    """
    names, factors, outputs, given = _blocks(record)
    asked = expectation(outputs, factors)
    # What the firmware does about voltage and density is alike for all motors.
    got, wanted = (part / part.mean(axis=1, keepdims=True) for part in (given, asked))
    moved, due = got - got.mean(axis=0), wanted - wanted.mean(axis=0)
    costs = np.sum((moved[:, :, None] - due[:, None, :]) ** 2, axis=0)
    best = linear_sum_assignment(costs)[1]
    own, found = np.diag(costs), costs[np.arange(len(names)), best]
    ratio = float(own.sum() / max(found.sum(), 1e-300))
    explained = float(1.0 - found.sum() / max(float(np.sum(moved**2)), 1e-300))
    level = got - wanted
    pairs = level[: len(level) // 2 * 2].reshape(-1, 2, len(names)).mean(axis=1)
    share = 1.0 + level.mean(axis=0)
    sigma = pairs.std(axis=0, ddof=1) / np.sqrt(len(pairs))
    findings: list[Finding] = []
    likelier = _likelier(moved, due, factors, best)
    wrong = best != np.arange(len(names))
    if (
        wrong.any()
        and likelier > lgamma(len(names) + 1) + SURE
        and explained > EXPLAINED
        and np.all(own[wrong] > found[wrong])
    ):
        findings.append(_order_finding(names, best, ratio))
    else:
        best = np.arange(len(names))
        findings += _uneven_findings(names, share, sigma)
    return MotorOrder(
        follows={name: names[k] for name, k in zip(names, best, strict=True)},
        share=dict(zip(names, map(float, share), strict=True)),
        share_sigma=dict(zip(names, map(float, sigma), strict=True)),
        ratio=ratio,
        explained=explained,
        findings=tuple(findings),
    )


def _blocks(record: Experiment) -> tuple[tuple[str, ...], Floats, Floats, Floats]:
    """Return motors, factors (n, 3), and as means of blocks outputs (K, 4) and what motors are told (K, n)."""
    vehicle = record.vehicle or Vehicle()
    known = {f"m{motor.number}": motor for motor in vehicle.motors}
    if not known or set(known) != set(record.input_names):
        raise MissingDataError(f"{record.name}: the order of motors needs the frame and the outputs of all its motors")
    outputs = np.column_stack([column(record, f"out_{name}") for name in ("thrust", "roll", "pitch", "yaw")])
    if not np.isfinite(outputs).all():
        raise MissingDataError(f"{record.name}: the order of motors needs the rate controller's outputs (RATE)")
    command = motor_commands(record.u, vehicle)
    inside = np.all((command > _MARGIN) & (command < 1.0 - _MARGIN), axis=1) & (outputs[:, 0] > _MARGIN)
    size = max(round(BLOCK_SECONDS / record.dt), 1)
    count = len(record.t) // size
    whole = inside[: count * size].reshape(count, size).all(axis=1)
    if whole.sum() < _FEWEST:
        raise MissingDataError(
            f"{record.name}: only {0.5 * whole.sum():.0f} s in which no motor is at an end of its range"
        )
    thrust = curve(np.clip(command, 0.0, 1.0), vehicle.thrust_expo)
    outputs, given = (part[: count * size].reshape(count, size, -1).mean(axis=1)[whole] for part in (outputs, thrust))
    motors = [known[name] for name in record.input_names]
    return record.input_names, np.array([[m.roll, m.pitch, m.yaw] for m in motors]), outputs, given


def _likelier(moved: Floats, due: Floats, factors: Floats, best: np.ndarray) -> float:
    """Return by how much in log-likelihood one order is better than that logged.

    What is left over is judged along roll, pitch and yaw and across them apart, for the firmware may limit yaw and
    rounds everything: noise along one must not hide what another says.
    """
    logged = np.arange(len(best))
    parts = [_parts(moved - due[:, order], factors[order]) for order in (logged, best)]
    gained = sum(size * np.log(one / other) for (size, one), (_, other) in zip(*parts, strict=True))
    return 0.25 * len(moved) * float(gained)


def _parts(left: Floats, factors: Floats) -> list[tuple[int, float]]:
    """Return size and mean square of what is left along each axis of the mixer, and across all."""
    used = factors[:, np.abs(factors).max(axis=0) > INDEPENDENT]
    axes = np.linalg.qr(used - used.mean(axis=0))[0]
    along = left @ axes
    parts = [(1, float(np.mean(column**2))) for column in along.T]
    across = left - along @ axes.T
    size = left.shape[1] - 1 - axes.shape[1]
    if size > 0:
        parts.append((size, float(np.sum(across**2)) / (size * len(left))))
    return [(size, max(value, _ROUNDING**2)) for size, value in parts]


def _order_finding(names: tuple[str, ...], best: np.ndarray, ratio: float) -> Finding:
    wrong = [(name, names[k]) for name, k in zip(names, best, strict=True) if name != names[k]]
    pairs = ", ".join(f"{name} follows what the mixer asks of {other}" for name, other in wrong)
    return Finding(
        "motor-order",
        Severity.ERROR,
        f"motor outputs are not in the mixer's order: {pairs} (in this order the mixer explains them {ratio:.3g} times "
        "better); parameters of single motors, moments and transfer functions from motor outputs mean nothing",
        "check SERVOn_FUNCTION, FRAME_CLASS and FRAME_TYPE, and that the parameters are those of this flight",
        {"motors": ", ".join(name for name, _ in wrong), "follow": ", ".join(other for _, other in wrong)},
    )


def _uneven_findings(names: tuple[str, ...], share: Floats, sigma: Floats) -> list[Finding]:
    """Name the motor whose output departs most: its departure shifts the mean that others are held to."""
    off = share - np.median(share)
    k = int(np.argmax(np.abs(off)))
    if abs(off[k]) < UNEVEN or abs(off[k]) < UNEVEN_SIGMAS * sigma[k]:
        return []
    word = "more" if off[k] > 0.0 else "less"
    return [
        Finding(
            "uneven-motor",
            Severity.WARNING,
            f"the output of motor {names[k]} is {100.0 * abs(off[k]):.1f} +- {100.0 * sigma[k]:.1g} % {word} than what "
            "the mixer asks of it, while the others get what they are asked for",
            "check this output's SERVOn_MIN, SERVOn_MAX and SERVOn_TRIM, its ESC's calibration and its wiring",
            {"motor": names[k], "share": float(1.0 + off[k]), "sigma": float(sigma[k])},
        )
    ]
