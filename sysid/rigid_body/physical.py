"""Physical parameters by every method on the same flights, side by side, with what they agree on as the headline."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import pandas as pd

from core.cubic_spline import cubic_spline
from core.summary import Summarised, listed
from logparse import Finding, RotoridError
from sysid.records.experiment import Experiment
from sysid.records.motor_scaling import EXPO_SIGMA, curve, curve_slope, motor_commands
from sysid.records.motor_signals import unexplained
from sysid.records.thrust_curve import Law
from sysid.rigid_body.body_parameters import shared_air, thrust_over
from sysid.rigid_body.consensus import Statement, consensus, disagreement
from sysid.rigid_body.model import RigidBodyModel
from sysid.rotors.kim2017 import Kim2017Model, fit_kim2017
from sysid.rotors.refinement2020 import Refinement2020Model, fit_refinement2020
from sysid.rotors.thrust import fit_thrust
from sysid.rotors.thrust_record import ThrustModel
from sysid.rotors.thrust_regression import vehicle_of

_Fitted = TypeVar("_Fitted")

#: The consensus of the methods, the first column of a report.
HEADLINE = "headline"

_TURNING = ("roll inertia over mass and arm", "pitch inertia over mass and arm", "yaw torque over inertia")

#: Methods, in the order of the columns of a report.
METHODS = ("mean thrust", "Kim 2017", "Refinement 2020, mean", "Refinement 2020, stacked", "rigid body")

#: Parameters that each method estimates.
_ESTIMATED: Mapping[str, tuple[str, ...]] = {
    "mean thrust": ("thrust over mass",),
    "Kim 2017": ("thrust over mass", *_TURNING),
    **dict.fromkeys(METHODS[2:4], ("thrust over mass", *_TURNING, "whole drag in still air over mass")),
    "rigid body": ("thrust over mass", "thrust curve", "motor lag", "yaw torque over inertia"),
}

#: Why a method finds nothing about rotation.
SLOW = "motor signals are logged too slowly for rotation"

#: Parameters that methods share, with the units in which motion alone gives them.
UNITS = {
    "thrust over mass at hover": "m/s^2, one motor at the command flown on average, in sea-level air",
    "thrust over mass": "m/s^2, one motor at full command in sea-level air",
    "thrust curve": "1 (MOT_THST_EXPO)",
    "motor lag": "s",
    "roll inertia over mass and arm": "m",
    "pitch inertia over mass and arm": "m",
    "yaw torque over inertia": "rad/s^2, one motor at full command",
    "linear drag over mass": "1/s, mean of body x and y",
    "quadratic drag over mass": "1/m, mean of body x and y",
    "whole drag in still air over mass": "1/m, as if all of it were quadratic and there were no wind",
}

#: Those that are proportional to the density of the air.
IN_AIR = tuple(name for name in UNITS if name.startswith(("thrust over mass", "yaw", "linear", "quadratic", "whole")))


#: Their units where the mass is known, and for inertia the arm.
_SI: Mapping[str, str] = {
    "thrust over mass": "N at full command",
    "thrust over mass at hover": "N at the command flown on average",
    "linear drag over mass": "N s/m",
    "quadratic drag over mass": "N s^2/m^2",
    "whole drag in still air over mass": "N s^2/m^2",
    **dict.fromkeys(_TURNING[:2], "kg m^2"),
}

#: Unit of an inertia of which only the mass is known.
_OVER_ARM = "kg m (inertia over arm)"


def quantity(parameter: str, unit: str) -> tuple[str, str]:
    """Return the quantity of a parameter in a unit, and by what its number is divided: mass, arm or nothing."""
    parts = re.fullmatch(r"(.+) over (mass and arm|mass)(.*)", parameter)
    if parts is None:
        return parameter, ""
    name = parts[1] + parts[3]
    if unit == UNITS[parameter]:
        return name, parts[2]
    return name, "arm" if unit == _OVER_ARM else ""


@dataclass(frozen=True, slots=True, repr=False)
class PhysicalParameters(Summarised):
    """Physical parameters by every method."""

    #: Index (parameter, method); ``value`` and ``sigma`` on these flights (NaN where not determined), ``transfer``
    #: (what another day adds to sigma), ``curve`` (part of sigma by the thrust curve in the parameters, which halves of
    #: a flight share), ``unit``, ``si_value``, ``si_sigma``, ``si_unit`` (with mass, and arm where it enters), ``note``
    #: (why not, or what kind of number).
    table: pd.DataFrame
    #: The models; None where a method could not be applied.
    thrust: ThrustModel | None
    kim2017: Kim2017Model | None
    refinement2020: Refinement2020Model | None
    rigid_body: RigidBodyModel | None
    findings: tuple[Finding, ...] = ()  #: Where methods disagree.

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        known = self.table["value"].notna()
        return {
            "parameters": listed(
                list(dict.fromkeys(str(name) for name in self.table.index.get_level_values(0)[known])), 4
            ),
            "methods": listed(list(dict.fromkeys(str(name) for name in self.table.index.get_level_values(1)[known]))),
            "determined": f"{int(known.sum())} of {len(known)} numbers; see .table",
        }


def physical_parameters(
    experiments: Experiment | Sequence[Experiment],
    mass: float | None = None,
    *,
    arm: float | None = None,
    rigid_body: RigidBodyModel | None = None,
) -> PhysicalParameters:
    """Apply every method to the same flights.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        PWM inputs, position outputs, with context; 50 Hz where logs allow, or rotation is aliased.
    mass : float, optional
        kg.
    arm : float, optional
        m, for inertia in SI.
    rigid_body : RigidBodyModel, optional
        As fitted to these flights (`fit_rigid_body`), for its column.
    """
    numbers: _Numbers = {}

    def attempt(methods: Sequence[str], fit: Callable[[], _Fitted], rows: Callable[[_Fitted], _Rows]) -> _Fitted | None:
        """Enter what a method finds, or for each of its parameters why it finds nothing."""
        try:
            model = fit()
        except RotoridError as error:
            numbers.update(
                ((name, method), _Number(note=str(error))) for method in methods for name in _ESTIMATED[method]
            )
            return None
        for name, method, value, sigma, note in rows(model):
            numbers[name, method] = _number(value, sigma, note)
        return model

    thrust = attempt(METHODS[:1], lambda: fit_thrust(experiments, mass), _of_thrust)
    records = [experiments] if isinstance(experiments, Experiment) else experiments
    undelayed, lag = records, None
    if rigid_body is not None:
        # A motor lag that has to explain the delay of the gyro's filters too makes inertia up to 12 % too small on
        # craft of known truth; the rigid body separates the two.
        lag, delay = (rigid_body.parameters[name].value for name in ("torque_lag", "torque_delay"))
        undelayed = [_undelayed(record, delay or 0.0) for record in records]
    refinement = attempt(
        METHODS[2:4],
        lambda: fit_refinement2020(undelayed, mass, time_constant=lag, law=Law.COMMAND),
        _of_refinement,
    )
    time_constant = refinement.time_constant if refinement is not None else lag or 0.0
    kim = attempt(
        METHODS[1:2],
        lambda: fit_kim2017(undelayed, mass, arm=arm, time_constant=time_constant, law=Law.COMMAND),
        _of_kim,
    )
    if rigid_body is not None:
        attempt(METHODS[4:], lambda: rigid_body, _of_rigid_body)
    vehicle, _ = vehicle_of(records[0])
    commands = [np.clip(motor_commands(record.u, vehicle), 0.0, 1.0).ravel() for record in records]
    hover = float(np.mean(np.concatenate(commands)))
    _add_hover(numbers, hover, vehicle.thrust_expo, rigid_body)
    _widen_by_curve(numbers, hover, vehicle.thrust_expo, rigid_body)
    air = shared_air(records)
    disagree = _conclude(numbers, air)
    table = _table(numbers, air, mass, arm)
    return PhysicalParameters(table, thrust, kim, refinement, rigid_body, () if disagree is None else (disagree,))


def _undelayed(record: Experiment, delay: float) -> Experiment:
    """Return a record whose rates are shifted back by the delay [s] of the gyro's filters."""
    if record.context is None or delay == 0.0:
        return record
    names = [name for axis in "xyz" for name in (f"w_{axis}", f"rate_{axis}") if name in record.context]
    now = cubic_spline(record.t, record.context[names].to_numpy(np.float64), np.minimum(record.t + delay, record.t[-1]))
    return replace(record, context=record.context.assign(**dict(zip(names, now.T, strict=True))))


@dataclass(slots=True)
class _Number:
    """What a method finds of a parameter; NaN where it is not determined."""

    value: float = float("nan")
    sigma: float = float("nan")
    note: str = ""
    curved: float = 0.0  #: Standard error from the thrust curve in the parameters, relative to the value.


#: By parameter and method.
_Numbers = dict[tuple[str, str], _Number]

#: Parameter, method, and what `_number` takes.
_Rows = Iterable[tuple[str, str, float | None, float | None, str]]


def _number(value: float | None, sigma: float | None, note: str) -> _Number:
    if value is None or not np.isfinite(value):
        return _Number(note=note)
    return _Number(float(value), float("nan") if sigma is None else float(sigma), note)


def _table(numbers: _Numbers, air: float, mass: float | None, arm: float | None) -> pd.DataFrame:
    """Tabulate numbers, in SI too where mass and arm are known, with what another day's air adds to sigma."""
    order = [(name, method) for name in UNITS for method in (HEADLINE, *METHODS) if (name, method) in numbers]
    rows = []
    for name, method in order:
        number, (factor, unit) = numbers[name, method], _si(name, mass, arm)
        rows.append(
            {
                "value": number.value,
                "sigma": number.sigma,
                "transfer": air * number.value if name in IN_AIR else 0.0,
                "curve": abs(number.curved * number.value),
                "unit": UNITS[name],
                "si_value": number.value * factor,
                "si_sigma": number.sigma * factor,
                "si_unit": unit,
                "note": number.note,
            }
        )
    return pd.DataFrame(rows, index=pd.MultiIndex.from_tuples(order, names=["parameter", "method"]))


def _si(parameter: str, mass: float | None, arm: float | None) -> tuple[float, str]:
    """Return the factor to SI, and the unit there."""
    if mass is None or parameter not in _SI:
        return float("nan"), ""
    if not parameter.endswith("over mass and arm"):
        return mass, _SI[parameter]
    return (mass, _OVER_ARM) if arm is None else (mass * arm, _SI[parameter])


def _of_thrust(model: ThrustModel) -> _Rows:
    yield "thrust over mass", "mean thrust", model.common.per_mass, model.common.sigma, model.common.reason


def _of_kim(model: Kim2017Model) -> _Rows:
    yield "thrust over mass", "Kim 2017", model.common.per_mass, model.common.sigma, model.common.reason
    for axis, rate, lever, sigma in zip(("roll", "pitch"), ("w_x", "w_y"), model.lever, model.lever_sigma, strict=True):
        why = unexplained(model.explained[rate], "rate about this axis") if model.rotation else SLOW
        if not why and not (lever > 0.0 and sigma < 0.15 * lever):
            why = "the craft hardly turns about this axis"
        value, spread = (None, None) if why else (1.0 / lever, sigma / lever**2)
        yield f"{axis} inertia over mass and arm", "Kim 2017", value, spread, why
    torque, why = model.torque_per_inertia, "the craft hardly yaws by its motors" if model.rotation else SLOW
    yield "yaw torque over inertia", "Kim 2017", torque, model.torque_sigma, why if torque is None else ""


def _of_refinement(model: Refinement2020Model) -> _Rows:
    names = dict(zip(_ESTIMATED[METHODS[2]], ("k", "Jx", "Jy", "b/Jz", "C"), strict=True))
    for parameter, name in names.items():
        # The paper takes roll and pitch inertia to be one.
        mean = model.instants.get("Jx" if name == "Jy" else name)
        if mean is not None:
            note = mean.reason or f"spread {mean.spread:.2g} of {mean.used} instants; median {mean.median:.4g}"
            if name[0] in "Jb" and mean.mean is not None:
                note += "; noise of the rates makes inertia too small, by half on craft of known truth, "
                note += "which no scatter shows"
            if name in ("Jx", "Jy") and mean.mean is not None:
                note += "; one value for roll and pitch, as the paper takes them"
            yield parameter, METHODS[2], mean.mean, None, note
        stacked = model.stacked[name]
        within = "wind and linear drag are in it, by as much as nobody knows"
        sigma, note = (None, within) if name == "C" else (stacked.sigma, "")
        yield parameter, METHODS[3], stacked.value, sigma, stacked.reason or note


def _of_rigid_body(model: RigidBodyModel) -> _Rows:
    names = ("thrust", "thrust_expo", "motor_lag", "yaw_gain")
    for parameter, name in zip(_ESTIMATED["rigid body"], names, strict=True):
        estimate = model.parameters[name]
        yield parameter, "rigid body", estimate.value, estimate.sigma, estimate.reason
    thrust = model.parameters["thrust"]
    for axis in ("roll", "pitch"):
        gain, over, sigma = model.parameters[f"{axis}_gain"], None, None
        if thrust.value is not None and gain.value is not None:
            over = thrust.value / gain.value
            sigma = over * thrust_over(gain.name, model.parameters, model.covariance, model.estimated)
        yield f"{axis} inertia over mass and arm", "rigid body", over, sigma, gain.reason or thrust.reason
    for law in ("linear", "quadratic"):
        pair = [model.parameters[f"drag_{law}_{axis}"] for axis in ("x", "y")]
        mean, sigma = None, None
        if all(estimate.determined for estimate in pair):
            weights = np.zeros(len(model.estimated))
            weights[[model.estimated.index(estimate.name) for estimate in pair]] = 0.5
            mean = 0.5 * sum(estimate.used for estimate in pair)
            sigma = float(np.sqrt(weights @ model.covariance @ weights))
        yield f"{law} drag over mass", "rigid body", mean, sigma, pair[0].reason or pair[1].reason


def _add_hover(numbers: _Numbers, command: float, expo: float, body: RigidBodyModel | None) -> None:
    """Enter thrust at the command flown on average beside that at full command, to which each method extrapolates."""
    part = float(curve(np.array(command), expo))
    for method in METHODS:
        full = numbers.get(("thrust over mass", method))
        if full is None:
            continue
        value, sigma = full.value * part, full.sigma * part
        if method == "rigid body" and body is not None and np.isfinite(full.value):
            value, sigma = _thrust_at(body, command)
        numbers["thrust over mass at hover", method] = _number(value, sigma, full.note)


def _widen_by_curve(numbers: _Numbers, command: float, expo: float, body: RigidBodyModel | None) -> None:
    """Add the uncertainty of the thrust curve to the numbers of methods without a curve of their own.

    They take the autopilot's as it is in its parameters, from hover to full command, and for its slope, by which motors
    turn the craft.
    """
    full_over_hover = (1.0 - command) / max(1.0 - expo + expo * command, 1e-3)
    slope_over_full = (1.0 - 2.0 * command) / max(float(curve_slope(np.array(command), expo)), 1e-3)
    parts = {
        "thrust over mass": full_over_hover,
        "roll inertia over mass and arm": full_over_hover - slope_over_full,
        "pitch inertia over mass and arm": full_over_hover - slope_over_full,
        "yaw torque over inertia": slope_over_full,
    }
    expo_sigma = _expo_sigma(expo, body)
    for (parameter, method), number in numbers.items():
        if parameter in parts and method != "rigid body" and np.isfinite([number.value, number.sigma]).all():
            number.curved = expo_sigma * parts[parameter]
            number.sigma = float(np.hypot(number.sigma, number.curved * number.value))


def _expo_sigma(expo: float, body: RigidBodyModel | None) -> float:
    """Return the standard error of the curve in the parameters: less where the flight shows the curve better."""
    if body is None:
        return EXPO_SIGMA
    place = body.estimated.index("thrust_expo")
    shown = min(float(np.sqrt(body.covariance[place, place])), EXPO_SIGMA)
    return float(np.hypot(shown, body.value("thrust_expo") - expo))


def _thrust_at(body: RigidBodyModel, command: float) -> tuple[float, float]:
    """Compute thrust per mass at a command, and its standard error: less than that of thrust and curve apart."""
    thrust, expo = body.value("thrust"), body.value("thrust_expo")
    part = float(curve(np.array(command), expo))
    slopes = {"thrust": part, "thrust_expo": thrust * (command**2 - command)}
    weights = np.zeros(len(body.estimated))
    for name, slope in slopes.items():
        weights[body.estimated.index(name)] = slope
    return thrust * part, float(np.sqrt(max(float(weights @ body.covariance @ weights), 0.0)))


def _conclude(numbers: _Numbers, air: float) -> Finding | None:
    """Enter the consensus on every parameter; return the finding where methods disagree."""
    stated: dict[str, list[Statement]] = {}
    for (parameter, method), number in numbers.items():
        if np.isfinite([number.value, number.sigma]).all() and number.sigma > 0.0:
            statement = Statement(method, number.value, number.sigma, number.curved * number.value)
            stated.setdefault(parameter, []).append(statement)
    for parameter, statements in stated.items():
        best = consensus(statements)
        if best is None:
            continue
        note = f"by {best.method}"
        if parameter in IN_AIR:
            note += f"; ± {100.0 * air:.2g} % more on another day, by the temperature of the air, which no log tells"
        if best.against:
            note += f"; {', '.join(best.against)} disagree{'s' if len(best.against) == 1 else ''}"
        curved = numbers[parameter, best.method].curved
        numbers[parameter, HEADLINE] = _Number(best.value, best.sigma, note, curved)
    return disagreement(stated)
