"""From records to a model with six degrees of freedom: multiple shooting to several horizons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from core.units import STANDARD_GRAVITY
from logparse import Finding, Severity
from sysid.records.experiment import Experiment, ExperimentError, Floats, require_alike
from sysid.rigid_body.model_record import BodyParameter
from sysid.rigid_body.six_dof._kernels import PER_INPUT, SHARED, THETA, ahead
from sysid.rigid_body.six_dof.body_record import (
    BodyQuantity,
    BodyRecord,
    InputKinds,
    InputShape,
    body_record,
    drives,
    input_kinds,
)
from sysid.rigid_body.six_dof.model import UNITS, SixDofModel, substeps
from sysid.rigid_body.six_dof.shooting import ShootingFit, minimise, spreads, state_errors

#: Horizons at which runs are compared with the record, s.
HORIZONS = (0.05, 0.15, 0.3, 0.5)


class Family(NamedTuple):
    """What parameters of one kind share."""

    #: Known before a flight: mean, spread and limits; the spreads only hold what the records do not excite.
    mean: float
    sigma: float
    low: float
    high: float
    step: float = 1e-3  #: Of differences.
    limit: float = 0.0  #: Standard error of what is called determined where zero is a proper value.
    #: Part of a value by which the equations misrepresent it (inputs between samples, noise of the states from which
    #: runs start), which the scatter of blocks does not show: mean errors of Monte Carlo flights of the papers'
    #: craft, and of the independent simulator in tests/sysid/six_dof.
    part: float = 0.0
    unit: str = "1"  #: Of what is not in `UNITS`.


FAMILIES: Mapping[str, Family] = {
    "thrust": Family(STANDARD_GRAVITY, np.inf, 0.1, 100.0, part=0.001),
    "thrust_offset": Family(0.0, 2.0, -10.0, 10.0, limit=0.3),
    "tilt": Family(0.0, 0.05, -0.3, 0.3, limit=0.01),
    "drag_rotor": Family(0.2, 0.5, -0.5, 5.0, limit=0.1),
    "drag_quadratic": Family(0.0, 0.1, -0.2, 1.0, limit=0.03),
    "gain": Family(0.0, np.inf, -1e5, 1e5, step=1e-2, part=0.001),
    "damping": Family(0.0, 10.0, -1.0, 100.0, limit=1.0),
    "inertia_x": Family(-0.5, 0.5, -2.0, 2.0, limit=0.15),
    "inertia_y": Family(0.5, 0.5, -2.0, 2.0, limit=0.15),
    "inertia_z": Family(0.0, 0.3, -2.0, 2.0, limit=0.15),
    "gyroscopic": Family(0.0, 2.0, -20.0, 20.0, limit=0.2),
    "rotor_inertia": Family(0.0, 2.0, -20.0, 20.0, limit=0.2, part=0.01),
    "offset": Family(0.0, 20.0, -300.0, 300.0, step=1e-2, limit=1.0),
    "by_speed": Family(0.0, 5.0, -50.0, 50.0, limit=1.0),
    "delay": Family(0.0, 0.02, -0.05, 0.1, limit=0.005, unit="s"),
    "lag": Family(0.02, 0.03, 0.0, 0.3, limit=0.01, unit="s"),
    "share": Family(1.0, 0.1, 0.5, 1.5, limit=0.02),
    "expo": Family(0.65, 0.2, 0.0, 1.0, step=0.02, limit=0.1, part=0.0004),
    # A tenth of thrust is lost in some ten minutes; quick draws lose it in one.
    "drift": Family(0.0, 1e-3, -0.01, 0.01, step=2e-4, limit=1e-4),
    # Full and nearly empty batteries of a cell are 4.2 and 3.5 V, of which thrust follows the square.
    "charge": Family(1.0, 0.1, 0.5, 1.5),
    "wind": Family(0.0, 8.0, -30.0, 30.0),
    "force": Family(0.0, 10.0, -100.0, 100.0, limit=0.1, unit="m/s^2 for the usual change of the input"),
    "torque": Family(0.0, 50.0, -1e3, 1e3, step=1e-2, limit=1.0, unit="rad/s^2 for the usual change of the input"),
}
#: Rate at which faster records are fitted, Hz: no motion is faster, and delays and lags are in seconds.
FASTEST = 250.0

_FURTHER = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True)
class _Unknown:
    """One number that is estimated: its name, and how it enters."""

    name: str
    at: int | None = None  #: Place in theta, or 0 north and 1 east of a wind; None for one of `InputShape`.
    record: str = ""  #: Whose wind or charge it is.
    family: str = ""

    @property
    def shared(self) -> Family:
        """What it shares with its family."""
        kinds = (self.family, self.name, self.name.rsplit("_", 1)[0], self.name.split("_", 1)[-1])
        return next(FAMILIES[kind] for kind in kinds if kind in FAMILIES)


def fit_six_dof(
    experiments: Experiment | Sequence[Experiment],
    *,
    mass: float | None = None,
    indoors: bool = False,
    winds: Mapping[str, tuple[float, float]] | None = None,
    horizons: Sequence[float] = HORIZONS,
    most_runs: int = 5000,
    attitude: str = "state",
) -> SixDofModel:
    """Identify a rigid body whose attitude and rates are states, from records of motion and inputs.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        Inputs: motors ``m1 ...`` in rad/s, us or as commands 0..1, or ``thrust roll pitch yaw`` of a mixer; and any
        further inputs. Outputs x, y, z; context with velocity, attitude and rates.
    mass : float, optional
        kg; with it thrust is also given in newtons.
    indoors : bool
        No wind.
    winds : mapping of str to (float, float), optional
        Wind that is known, north and east, m/s, by record; that of other records is estimated.
    horizons : sequence of float
        s.
    most_runs : int
        Runs over all records; fewer are faster and less exact.
    attitude : {"state", "measured"}
        With ``"measured"`` attitude and rates are inputs, and only translation is identified: for inputs that are too
        slow or too noisy for rotation.

    Notes
    -----
    Records of more than `FASTEST` are fitted at that rate; the model is one of seconds, and predicts at any.

    Raises
    ------
    ExperimentError
        When the records are unlike, or too short for the horizons.
    MissingDataError
        When motion or the places of motors are missing.
    """
    if attitude not in ("state", "measured"):
        raise ValueError(f"attitude must be state or measured, not {attitude!r}")
    given = attitude == "measured"
    records = [record.at_most(FASTEST) for record in require_alike(experiments)]
    kinds = input_kinds(records[0])
    bodies = [body_record(record, kinds) for record in records]
    dt = bodies[0].dt
    marks = np.unique([max(round(horizon / dt), 1) for horizon in horizons]).astype(np.int64)
    total = sum(max(len(body.t) - int(marks[-1]), 0) for body in bodies)
    if total < 4 * marks[-1]:
        raise ExperimentError(
            f"{total} samples are too few to fit runs of {horizons[-1]:g} s; give longer records or shorter horizons"
        )
    known = {name: np.asarray(wind, dtype=np.float64) for name, wind in (winds or {}).items()}
    unknowns = _unknowns(kinds, bodies, indoors, known, given)
    shape = _shape(kinds, bodies, records)

    def unpack(values: Floats) -> tuple[Floats, InputShape, dict[str, Floats]]:
        return _unpack(values, unknowns, kinds, shape, known)

    cache: dict[tuple[float, ...], list[Floats]] = {}

    def errors_from(starts: Sequence[np.ndarray], values: Floats) -> list[Floats]:
        theta, moved, wind = unpack(values)
        key = (*moved.values.values(), *moved.charges.values())
        if key not in cache:
            if len(cache) > 2:
                cache.pop(next(iter(cache)))
            cache[key] = [drives(body, kinds, moved) for body in bodies]
        out = []
        for body, first, drive in zip(bodies, starts, cache[key], strict=True):
            air = np.zeros((len(body.t), 3))
            air[:, :2] = wind.get(body.name, np.zeros(2))
            still = np.zeros((len(first), 6))
            predicted = ahead(theta, drive, air, still, body.states, first, marks, dt, substeps(dt), given)
            out.append(state_errors(predicted, body.states[first[:, None] + marks]))
        return out

    table = np.array([unknown.shared[:5] for unknown in unknowns])
    mean, sigma, low, high, steps = table.T
    start = mean.copy()
    # Few runs lead to near the answer at little cost; all of them from there.
    for runs, iterations in ((max(most_runs // 6, 300), 12), (most_runs, 6)):
        every = max(total // runs, 1)
        starts = [np.arange(0, max(len(body.t) - int(marks[-1]), 0), every) for body in bodies]
        block = max(round(4.0 / dt / every), 1)  # errors of four seconds count as independent of others
        errors_of = partial(errors_from, starts)
        solution = minimise(start, errors_of, mean, sigma, (low, high), steps, block, iterations)
        start = solution.values
    solution = _centred(solution, unknowns)
    theta, moved, wind = unpack(solution.values)
    parameters = refuse_impossible(_parameters(unknowns, solution, theta, moved, kinds, sigma, mass, dt))
    scales = spreads(errors_of(solution.values))
    spread = dict(
        zip((unknown.name for unknown in unknowns), np.sqrt(np.diag(solution.covariance)).tolist(), strict=True)
    )
    findings = wrong_turns(parameters, spread)
    return SixDofModel(
        name="rigid body, six degrees of freedom",
        parameters=parameters,
        theta=theta,
        shape=moved,
        kinds=kinds,
        estimated=tuple(unknown.name for unknown in unknowns),
        covariance=solution.covariance,
        winds=wind,
        scales={float(mark * dt): scale for mark, scale in zip(marks, scales, strict=True)},
        training=tuple(record.name for record in records),
        findings=findings,
        mass=mass,
        attitude_given=given,
        wind_sigma=_wind_sigma(unknowns, solution),
    )


def _unknowns(
    kinds: InputKinds, bodies: Sequence[BodyRecord], indoors: bool, winds: Mapping[str, Floats], given: bool
) -> list[_Unknown]:
    """List what is estimated for these inputs."""
    speeds = kinds.quantity is BodyQuantity.SPEED
    left_out = {"gyroscopic_x", "gyroscopic_y"} if kinds.mixer else set()
    if speeds or kinds.mixer:
        left_out.add("thrust_offset")
    if given:
        left_out |= set(THETA[THETA.index("roll_gain") :])
    out = [_Unknown(name, at) for at, name in enumerate(THETA) if name not in left_out]
    for k, further in enumerate(kinds.further_names):
        out += [
            _Unknown(f"{further}_{part}", SHARED + PER_INPUT * k + j, family="force" if j < 3 else "torque")
            for j, part in enumerate(_FURTHER[:3] if given else _FURTHER)
        ]
    if given:
        # Translation sees the sum of the rotors only.
        out += [_Unknown(family) for family in (("delay",) if speeds else ("delay", "lag"))]
    else:
        moving = ["delay"] + ["lag"] * (not speeds) + ["share"] * (len(kinds.motors) > 1)
        out += [_Unknown(f"{family}_{name}", family=family) for family in moving for name in kinds.thrusting_names]
    if kinds.further:
        out.append(_Unknown("lag_further", family="lag"))
    if kinds.quantity is BodyQuantity.PWM and kinds.motors:
        out.append(_Unknown("expo"))
    if not speeds:
        out.append(_Unknown("thrust_drift", family="drift"))
        if len(bodies) > 1:
            out += [_Unknown(f"charge_{body.name}", record=body.name, family="charge") for body in bodies]
    for body in bodies:
        if not indoors and body.name not in winds:
            out += [_Unknown(f"wind_{part}", j, body.name, "wind") for j, part in enumerate(("n", "e"))]
    return out


def _shape(kinds: InputKinds, bodies: Sequence[BodyRecord], records: Sequence[Experiment]) -> InputShape:
    """Scale the inputs so that their usual strength is one."""
    used, further = list(kinds.thrusting), list(kinds.further)
    inputs = np.concatenate([body.inputs for body in bodies])
    speeds = kinds.quantity is BodyQuantity.SPEED
    vehicle = records[0].vehicle if kinds.quantity is BodyQuantity.PWM else None
    expo = 1.0 if speeds else 0.0 if vehicle is None else vehicle.thrust_expo
    if speeds:
        scale = len(used) * float(np.mean(inputs[:, used] ** 2))
        reference = float(np.mean(inputs[:, used]))
    elif kinds.motors:
        moved = inputs[:, used]
        scale = len(used) * float(np.mean((1.0 - expo) * moved + expo * moved**2))
        reference = 1.0
    else:
        thrust = next(at for name, at in kinds.mixer if name == "thrust")
        scale, reference = float(np.mean(inputs[:, thrust])), 1.0
    extra = inputs[:, further]
    return InputShape(
        values={"expo": expo},
        scale=max(scale, 1e-12),
        reference_speed=max(reference, 1e-12),
        centre=extra.mean(axis=0),
        width=np.maximum(extra.std(axis=0), 1e-9),
    )


def _unpack(
    values: Floats, unknowns: Sequence[_Unknown], kinds: InputKinds, shape: InputShape, winds: Mapping[str, Floats]
) -> tuple[Floats, InputShape, dict[str, Floats]]:
    theta, moved = np.zeros(SHARED + PER_INPUT * len(kinds.further)), dict(shape.values)
    wind, charges = {name: np.array(value) for name, value in winds.items()}, dict[str, float]()
    for value, unknown in zip(values.tolist(), unknowns, strict=True):
        if unknown.family == "charge":
            charges[unknown.record] = value
        elif unknown.family == "wind":
            wind.setdefault(unknown.record, np.zeros(2))[unknown.at] = value
        elif unknown.at is None:
            moved[unknown.name] = value
        else:
            theta[unknown.at] = value
    charges = {name: value - float(np.mean(list(charges.values()))) + 1.0 for name, value in charges.items()}
    return theta, replace(shape, values=moved, charges=charges), wind


def _parameters(
    unknowns: Sequence[_Unknown],
    solution: ShootingFit,
    theta: Floats,
    shape: InputShape,
    kinds: InputKinds,
    sigma: Floats,
    mass: float | None,
    dt: float,
) -> dict[str, BodyParameter]:
    """Name every parameter, with its standard error, and whether it is determined."""
    out: dict[str, BodyParameter] = {}
    spread = np.sqrt(np.maximum(np.diag(solution.covariance), 0.0))
    for k, unknown in enumerate(unknowns):
        if unknown.record:
            continue
        family, name, value = unknown.shared, unknown.name, float(solution.values[k])
        # The equations err by a fortieth of a sample in delays and lags.
        floor = 0.025 * dt if family.unit == "s" else family.part * abs(value)
        error = float(np.hypot(spread[k], floor))
        limit, reason = max(0.2 * abs(value), family.limit), ""
        if np.isfinite(sigma[k]) and error > 0.0 and solution.information[k, k] * sigma[k] ** 2 < 4.0:
            reason = "the records hardly move it"
        elif not error < limit:
            asked = (
                f"above {limit:.2g}" if 0.0 < limit == family.limit else f"above a fifth of the {abs(value):.2g} found"
            )
            if abs(value) < 0.01 * error and family.limit == 0.0:
                asked = "and what was found is nothing beside it"
            reason = f"its standard error is {error:.2g}, {asked}"
        if unknown.at is None and name.startswith("delay"):
            name, value, lead = timing_of(name, value, error, kinds, dt)
            reason = lead or reason
        found_one = BodyParameter.of(name, UNITS.get(unknown.name, family.unit), value, error, reason)
        out[name] = _in_si(found_one, shape, kinds, mass)
    for at, name in enumerate(THETA):
        if name not in out:
            why = "not part of the model for these inputs"
            out[name] = BodyParameter.of(name, UNITS[name], float(theta[at]), np.nan, why)
    return out


def _centred(solution: ShootingFit, unknowns: Sequence[_Unknown]) -> ShootingFit:
    """Make the shares of the motors, and the charges of the records, 1 in the mean: only what they differ by enters."""
    for family in ("share", "charge"):
        alike = np.array([unknown.family == family for unknown in unknowns])
        if alike.any():
            values = solution.values.copy()
            values[alike] += 1.0 - values[alike].mean()
            centre = np.eye(len(unknowns)) - np.outer(alike, alike) / alike.sum()
            solution = replace(solution, values=values, covariance=centre @ solution.covariance @ centre.T)
    return solution


def timing_of(name: str, value: float, error: float, kinds: InputKinds, dt: float) -> tuple[str, float, str]:
    """Name and value of a delay as a reader expects them, and why it is none.

    What the inputs do is held over the sample interval that begins there, so that the fit's own delay is half a sample
    less. Rotor speeds are measured, and may be late themselves: what is stated is how late their telemetry is.
    """
    value += 0.5 * dt
    if kinds.quantity is BodyQuantity.SPEED:
        name, value = name.replace("delay", "telemetry_lag", 1), -value
        what = f"the motion follows the rotor speeds {-value:.3g} s later, which no lag of their telemetry explains"
    else:
        what = f"the motion is {-value:.3g} s ahead of the inputs: their time stamps are late, which is not a delay"
    return name, max(value, 0.0), what if value < -2.0 * error else ""


def _in_si(parameter: BodyParameter, shape: InputShape, kinds: InputKinds, mass: float | None) -> BodyParameter:
    """Add thrust and gains per unit of the inputs, in SI."""
    speed = kinds.quantity is BodyQuantity.SPEED
    if parameter.value is None or parameter.name not in {"thrust", "roll_gain", "pitch_gain", "yaw_gain"}:
        return parameter
    assert parameter.sigma is not None
    factor, unit = 1.0 / shape.scale, "rad/s^2 per (rad/s)^2" if speed else "rad/s^2 at full command"
    if parameter.name == "thrust":
        unit = "m/s^2 per (rad/s)^2" if speed else "m/s^2 at full command"
        if mass is not None:
            factor, unit = factor * mass, "N s^2" if speed else "N at full command"
    return replace(parameter, si_value=factor * parameter.value, si_sigma=factor * parameter.sigma, si_unit=unit)


def _wind_sigma(unknowns: Sequence[_Unknown], solution: ShootingFit) -> dict[str, Floats]:
    spread = np.sqrt(np.maximum(np.diag(solution.covariance), 0.0))
    out: dict[str, Floats] = {}
    for k, unknown in enumerate(unknowns):
        if unknown.family == "wind":
            out.setdefault(unknown.record, np.zeros(2))[unknown.at] = spread[k]
    return out


#: Standard errors below zero beyond which chance does not explain a sign.
_BEYOND = 2.0


def refuse_impossible(parameters: Mapping[str, BodyParameter]) -> dict[str, BodyParameter]:
    """Return the parameters, those of the air that are below zero not determined, with the reason."""
    out = dict(parameters)
    # Both laws of drag stand for one effect: where one is impossible, what the other came out as leans on it.
    effects = [(f"drag_rotor_{axis}", f"drag_quadratic_{axis}") for axis in "xyz"]
    for names in (*effects, *((f"{axis}_damping",) for axis in ("roll", "pitch", "yaw"))):
        there = {name: out[name] for name in names if name in out}
        wrong = [
            name for name, parameter in there.items() if (parameter.value or 0.0) < -_BEYOND * (parameter.sigma or 0.0)
        ]
        for name in there:
            if not wrong:
                continue
            if name in wrong:
                came = f"{out[name].value:.2g} ± {out[name].sigma:.2g}"
                reason = f"it came out below zero ({came}), which no air does: wind or an unknown force passes for it"
            else:
                reason = f"{wrong[0]} came out below zero, and the two are not told apart"
            out[name] = out[name].refused(reason)
    return out


def wrong_turns(parameters: Mapping[str, BodyParameter], spread: Mapping[str, float]) -> tuple[Finding, ...]:
    """Point out gains of the wrong sign: motors permuted, a wrong frame, or a record that its controller made."""
    gains = {axis: parameters[f"{axis}_gain"] for axis in ("roll", "pitch", "yaw")}
    wrong = [axis for axis, gain in gains.items() if gain.used < -_BEYOND * spread.get(gain.name, 0.0)]
    if not wrong:
        return ()
    sure = any(gains[axis].value is not None for axis in wrong)
    return (
        Finding(
            "motor-order",
            Severity.ERROR if sure else Severity.WARNING,
            f"motors {'turn' if sure else 'seem to turn'} the craft the wrong way in {', '.join(wrong)}: "
            + ", ".join(f"{gains[axis].used:.3g} rad/s^2" for axis in wrong)
            + " where it must be positive"
            + ("" if sure else "; the record turns too little to be sure"),
            "check the order of the motor columns, the frame and the signs of the rates",
            {axis: float(gains[axis].used) for axis in wrong},
        ),
    )
