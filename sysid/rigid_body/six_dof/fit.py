"""From records to a model with six degrees of freedom: multiple shooting to several horizons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from core.units import STANDARD_GRAVITY
from sysid.records.experiment import Experiment, ExperimentError, Floats, require_alike
from sysid.rigid_body.model_record import BodyParameter
from sysid.rigid_body.six_dof._kernels import PER_INPUT, SHARED, THETA, ahead
from sysid.rigid_body.six_dof.body_record import (
    BodyRecord,
    InputKinds,
    InputShape,
    Quantity,
    body_record,
    drives,
    input_kinds,
)
from sysid.rigid_body.six_dof.model import UNITS, SixDofModel, substeps
from sysid.rigid_body.six_dof.shooting import ShootingFit, minimise, spreads, state_errors
from sysid.rigid_body.six_dof.signs import refuse_impossible, wrong_turns

#: Horizons at which runs are compared with the record, s.
HORIZONS = (0.05, 0.15, 0.3, 0.5)

#: Runs that are fitted, over all records: more cost time and add little, as neighbours overlap.
MOST_RUNS = 5000

#: Length of the blocks whose errors count as independent, s.
BLOCK_SECONDS = 4.0

#: Mean, spread and limits of what is known before a flight; the spreads only hold what the records do not excite.
PRIORS: Mapping[str, tuple[float, float, float, float]] = {
    "thrust": (STANDARD_GRAVITY, np.inf, 0.1, 100.0),
    "thrust_offset": (0.0, 2.0, -10.0, 10.0),
    "tilt_x": (0.0, 0.05, -0.3, 0.3),
    "tilt_y": (0.0, 0.05, -0.3, 0.3),
    "drag_rotor": (0.2, 0.5, -0.5, 5.0),
    "drag_quadratic": (0.0, 0.1, -0.2, 1.0),
    "gain": (0.0, np.inf, -1e5, 1e5),
    "damping": (0.0, 10.0, -1.0, 100.0),
    "inertia_x": (-0.5, 0.5, -2.0, 2.0),
    "inertia_y": (0.5, 0.5, -2.0, 2.0),
    "inertia_z": (0.0, 0.3, -2.0, 2.0),
    "gyroscopic": (0.0, 2.0, -20.0, 20.0),
    "rotor_inertia": (0.0, 2.0, -20.0, 20.0),
    "offset": (0.0, 20.0, -300.0, 300.0),
    "by_speed": (0.0, 5.0, -50.0, 50.0),
    "delay": (0.0, 0.02, -0.05, 0.1),
    "lag": (0.02, 0.03, 0.0, 0.3),
    "share": (1.0, 0.1, 0.5, 1.5),
    "expo": (0.65, 0.2, 0.0, 1.0),
    # A tenth of thrust is lost in some ten minutes; quick draws lose it in one.
    "drift": (0.0, 1e-3, -0.01, 0.01),
    # Full and nearly empty batteries of a cell are 4.2 and 3.5 V, of which thrust follows the square.
    "charge": (1.0, 0.1, 0.5, 1.5),
    "wind": (0.0, 8.0, -30.0, 30.0),
    "force": (0.0, 10.0, -100.0, 100.0),
    "torque": (0.0, 50.0, -1000.0, 1000.0),
}

#: Largest standard error of what is called determined: part of the estimate, or absolute where zero is proper.
RELATIVE = 0.2
ABSOLUTE: Mapping[str, float] = {
    "tilt": 0.01,
    "drag_rotor": 0.1,
    "drag_quadratic": 0.03,
    "damping": 1.0,
    "inertia": 0.15,
    "gyroscopic": 0.2,
    "rotor_inertia": 0.2,
    "offset": 1.0,
    "by_speed": 1.0,
    "delay": 0.005,
    "lag": 0.01,
    "share": 0.02,
    "expo": 0.1,
    "drift": 1e-4,
    "thrust_offset": 0.3,
    "force": 0.1,
    "torque": 1.0,
}

#: Parts of a value, and amounts, by which the equations misrepresent it (inputs between samples, noise of the states
#: from which runs start), which the scatter of blocks does not show: mean errors of Monte Carlo flights of the papers'
#: craft and of the independent simulator in tests/sysid/six_dof (docs/validation.md). What is not here had none beyond
#: its scatter.
FLOORS: Mapping[str, tuple[float, float]] = {
    "thrust": (0.001, 0.0),
    "gain": (0.001, 0.0),
    "yaw_gain": (0.003, 0.0),
    "damping": (0.0, 0.022),
    "inertia": (0.01, 0.0),
    "gyroscopic": (0.01, 0.0),
    "rotor_inertia": (0.01, 0.0),
    "by_speed": (0.0, 2e-4),
    "tilt": (0.0, 1e-4),
    "expo": (0.004, 0.0),
    "drift": (0.0, 2e-6),
}
#: The same for delays and lags, samples.
FLOOR_SAMPLES = 0.025

#: Rate at which faster records are fitted, Hz: no motion is faster, and delays and lags are in seconds.
FASTEST = 250.0

#: Place of a delay or lag that all rotors share.
ALL = -1

#: Where parameters of rotation begin in theta.
ROTATION = THETA.index("roll_gain")

_FURTHER = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True)
class _Unknown:
    """One number that is estimated: its name, and how it enters."""

    name: str
    family: str
    kind: str
    at: int
    record: str = ""


def fit_six_dof(
    experiments: Experiment | Sequence[Experiment],
    *,
    mass: float | None = None,
    indoors: bool = False,
    winds: Mapping[str, tuple[float, float]] | None = None,
    horizons: Sequence[float] = HORIZONS,
    most_runs: int = MOST_RUNS,
    attitude: str = "state",
    name: str = "rigid body, six degrees of freedom",
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
    name : str

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
    known = {each: np.asarray(wind, dtype=np.float64) for each, wind in (winds or {}).items()}
    unknowns = _unknowns(kinds, bodies, indoors, known, given)
    shape = _shape(kinds, bodies, records)

    def unpack(values: Floats) -> tuple[Floats, InputShape, dict[str, Floats]]:
        return _unpack(values, unknowns, kinds, shape, known)

    cache: dict[bytes, list[Floats]] = {}

    def errors_from(starts: Sequence[np.ndarray], values: Floats) -> list[Floats]:
        theta, moved, wind = unpack(values)
        single = [moved.further_lag, moved.expo, moved.drift, *moved.charges.values()]
        key = np.concatenate([moved.delays, moved.lags, moved.shares, single]).tobytes()
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

    start, mean, sigma, low, high, steps = _priors(unknowns)
    # Few runs lead to near the answer at little cost; all of them from there.
    for runs, iterations in ((max(most_runs // 6, 300), 12), (most_runs, 6)):
        every = max(total // runs, 1)
        starts = [np.arange(0, max(len(body.t) - int(marks[-1]), 0), every) for body in bodies]
        block = max(round(BLOCK_SECONDS / dt / every), 1)
        errors_of = partial(errors_from, starts)
        found = minimise(start, errors_of, mean, sigma, (low, high), steps, block, iterations)
        start = found.values
    found = _centred(found, unknowns)
    theta, moved, wind = unpack(found.values)
    parameters = refuse_impossible(_parameters(unknowns, found, theta, moved, kinds, mean, sigma, mass, dt))
    scales = spreads(errors_of(found.values))
    spread = dict(zip((each.name for each in unknowns), np.sqrt(np.diag(found.covariance)).tolist(), strict=True))
    findings = wrong_turns(parameters, spread)
    return SixDofModel(
        name=name,
        parameters=parameters,
        theta=theta,
        shape=moved,
        kinds=kinds,
        estimated=tuple(unknown.name for unknown in unknowns),
        covariance=found.covariance,
        winds=wind,
        scales={float(mark * dt): scale for mark, scale in zip(marks, scales, strict=True)},
        training=tuple(record.name for record in records),
        findings=findings,
        mass=mass,
        attitude_given=given,
        wind_sigma=_wind_sigma(unknowns, found),
    )


def _unknowns(
    kinds: InputKinds, bodies: Sequence[BodyRecord], indoors: bool, winds: Mapping[str, Floats], given: bool
) -> list[_Unknown]:
    """List what is estimated for these inputs."""
    speeds = kinds.quantity is Quantity.SPEED
    left_out = {"gyroscopic_x", "gyroscopic_y"} if kinds.mixer else set()
    if speeds or kinds.mixer:
        left_out.add("thrust_offset")
    if given:
        left_out |= set(THETA[ROTATION:])
    families = ("drag_rotor", "drag_quadratic", "gyroscopic")
    out = []
    for at, name in enumerate(THETA):
        if name in left_out:
            continue
        family = next((each for each in families if name.startswith(each)), name)
        for suffix in ("gain", "damping", "offset", "by_speed"):
            if name.endswith(suffix) and name not in PRIORS:
                family = suffix
        out.append(_Unknown(name, family, "theta", at))
    for k, further in enumerate(kinds.further_names):
        out += [
            _Unknown(f"{further}_{part}", "force" if j < 3 else "torque", "theta", SHARED + PER_INPUT * k + j)
            for j, part in enumerate(_FURTHER[:3] if given else _FURTHER)
        ]
    names = [kinds.names[at] for at in kinds.thrusting]
    if given:
        # Translation sees the sum of the rotors only.
        out += [_Unknown(each, each, each, ALL) for each in (("delay",) if speeds else ("delay", "lag"))]
    else:
        out += [_Unknown(f"delay_{name}", "delay", "delay", k) for k, name in enumerate(names)]
        if not speeds:
            out += [_Unknown(f"lag_{name}", "lag", "lag", k) for k, name in enumerate(names)]
        if len(kinds.motors) > 1:
            out += [_Unknown(f"share_{name}", "share", "share", k) for k, name in enumerate(names)]
    if kinds.further:
        out.append(_Unknown("lag_further", "lag", "further_lag", 0))
    if kinds.quantity is Quantity.PWM and kinds.motors:
        out.append(_Unknown("expo", "expo", "expo", 0))
    if not speeds:
        out.append(_Unknown("thrust_drift", "drift", "drift", 0))
        if len(bodies) > 1:
            out += [_Unknown(f"charge_{body.name}", "charge", "charge", 0, body.name) for body in bodies]
    if not indoors:
        for body in bodies:
            if body.name not in winds:
                out += [_Unknown(f"wind_{part}", "wind", "wind", j, body.name) for j, part in enumerate(("n", "e"))]
    return out


def _shape(kinds: InputKinds, bodies: Sequence[BodyRecord], records: Sequence[Experiment]) -> InputShape:
    """Scale the inputs so that their usual strength is one."""
    used, further = list(kinds.thrusting), list(kinds.further)
    inputs = np.concatenate([body.inputs for body in bodies])
    speeds = kinds.quantity is Quantity.SPEED
    expo = 1.0 if speeds else _expo(kinds, records)
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
        delays=np.zeros(len(used)),
        lags=np.zeros(len(used)),
        shares=np.ones(len(used)),
        further_lag=0.0,
        expo=expo,
        drift=0.0,
        scale=max(scale, 1e-12),
        reference_speed=max(reference, 1e-12),
        centre=extra.mean(axis=0),
        width=np.maximum(extra.std(axis=0), 1e-9),
    )


def _expo(kinds: InputKinds, records: Sequence[Experiment]) -> float:
    vehicle = records[0].vehicle
    if kinds.quantity is not Quantity.PWM or vehicle is None:
        return 0.0
    return vehicle.thrust_expo


def _unpack(
    values: Floats, unknowns: Sequence[_Unknown], kinds: InputKinds, shape: InputShape, winds: Mapping[str, Floats]
) -> tuple[Floats, InputShape, dict[str, Floats]]:
    theta = np.zeros(SHARED + PER_INPUT * len(kinds.further))
    delays, lags, shares = shape.delays.copy(), shape.lags.copy(), shape.shares.copy()
    further_lag, expo, drift, charges = shape.further_lag, shape.expo, shape.drift, dict[str, float]()
    wind = {name: np.array(value) for name, value in winds.items()}
    for value, unknown in zip(values, unknowns, strict=True):
        match unknown.kind:
            case "theta":
                theta[unknown.at] = value
            case "delay":
                delays[slice(None) if unknown.at == ALL else unknown.at] = value
            case "lag":
                lags[slice(None) if unknown.at == ALL else unknown.at] = value
            case "share":
                shares[unknown.at] = value
            case "further_lag":
                further_lag = float(value)
            case "expo":
                expo = float(value)
            case "drift":
                drift = float(value)
            case "charge":
                charges[unknown.record] = float(value)
            case _:
                wind.setdefault(unknown.record, np.zeros(2))[unknown.at] = value
    shape = replace(
        shape,
        delays=delays,
        lags=lags,
        shares=shares - shares.mean() + 1.0,
        further_lag=further_lag,
        expo=expo,
        drift=drift,
        charges={name: value - float(np.mean(list(charges.values()))) + 1.0 for name, value in charges.items()},
    )
    return theta, shape, wind


def _priors(unknowns: Sequence[_Unknown]) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
    """Start, prior mean and spread, limits, and steps for differences."""
    table = np.array([PRIORS[unknown.family] for unknown in unknowns])
    mean, sigma, low, high = table.T
    steps = {
        "delay": 1e-3,
        "lag": 1e-3,
        "expo": 0.02,
        "drift": 2e-4,
        "charge": 1e-3,
        "share": 1e-3,
        "gain": 1e-2,
        "offset": 1e-2,
        "torque": 1e-2,
    }
    return mean.copy(), mean, sigma, low, high, np.array([steps.get(unknown.family, 1e-3) for unknown in unknowns])


def _parameters(
    unknowns: Sequence[_Unknown],
    found: ShootingFit,
    theta: Floats,
    shape: InputShape,
    kinds: InputKinds,
    mean: Floats,
    sigma: Floats,
    mass: float | None,
    dt: float,
) -> dict[str, BodyParameter]:
    """Name every parameter, with its standard error, and whether it is determined."""
    out: dict[str, BodyParameter] = {}
    spread = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    for k, unknown in enumerate(unknowns):
        if unknown.record:
            continue
        value = float(found.values[k])
        error = float(np.hypot(spread[k], _floor(unknown, value, dt)))
        unit = UNITS.get(unknown.name) or _unit(unknown)
        limit = max(RELATIVE * abs(value), _absolute(unknown.family))
        held = np.isfinite(sigma[k]) and error > 0.0 and found.information[k, k] * sigma[k] ** 2 < 4.0
        determined = np.isfinite(error) and error < limit and not held
        reason = ""
        if not determined:
            absolute = 0.0 < limit == _absolute(unknown.family)
            asked = f"{limit:.2g}" if absolute else f"a fifth of the {abs(value):.2g} found"
            reason = "the records hardly move it" if held else f"its standard error is {error:.2g}, above {asked}"
        name = unknown.name
        if unknown.family == "delay":
            name, value, lead = timing_of(name, value, error, kinds, dt)
            if lead:
                determined, reason = False, lead
        out[name] = BodyParameter(
            name=name,
            unit=unit,
            value=value if determined else None,
            sigma=error if determined else None,
            determined=bool(determined),
            reason=reason,
            used=value,
        )
        if determined:
            out[name] = _in_si(out[name], shape, kinds, mass)
    for at, name in enumerate(THETA):
        if name not in out:
            out[name] = BodyParameter(
                name=name,
                unit=UNITS[name],
                value=None,
                sigma=None,
                determined=False,
                reason="not part of the model for these inputs",
                used=float(theta[at]),
            )
    return out


def _centred(found: ShootingFit, unknowns: Sequence[_Unknown]) -> ShootingFit:
    """Make the shares of the motors, and the charges of the records, 1 in the mean: only what they differ by enters."""
    for kind in ("share", "charge"):
        alike = np.array([unknown.kind == kind for unknown in unknowns])
        if alike.any():
            values = found.values.copy()
            values[alike] += 1.0 - values[alike].mean()
            centre = np.eye(len(unknowns)) - np.outer(alike, alike) / alike.sum()
            found = replace(found, values=values, covariance=centre @ found.covariance @ centre.T)
    return found


def _floor(unknown: _Unknown, value: float, dt: float) -> float:
    """Error that the equations make whatever the record; see `FLOORS`."""
    if unknown.family in {"delay", "lag"}:
        return FLOOR_SAMPLES * dt
    names = (unknown.name, unknown.family, unknown.family.rsplit("_", 1)[0])
    part, amount = next((FLOORS[name] for name in names if name in FLOORS), (0.0, 0.0))
    return part * abs(value) + amount


def timing_of(name: str, value: float, error: float, kinds: InputKinds, dt: float) -> tuple[str, float, str]:
    """Name and value of a delay as a reader expects them, and why it is none.

    What the inputs do is held over the sample interval that begins there, so that the fit's own delay is half a sample
    less. Rotor speeds are measured, and may be late themselves: what is stated is how late their telemetry is.
    """
    value += 0.5 * dt
    if kinds.quantity is Quantity.SPEED:
        name, value = name.replace("delay", "telemetry_lag", 1), -value
        what = f"the motion follows the rotor speeds {-value:.3g} s later, which no lag of their telemetry explains"
    else:
        what = f"the motion is {-value:.3g} s ahead of the inputs: their time stamps are late, which is not a delay"
    return name, max(value, 0.0), what if value < -2.0 * error else ""


def _in_si(parameter: BodyParameter, shape: InputShape, kinds: InputKinds, mass: float | None) -> BodyParameter:
    """Add thrust and gains per unit of the inputs, in SI."""
    speed = kinds.quantity is Quantity.SPEED
    if parameter.name not in {"thrust", "roll_gain", "pitch_gain", "yaw_gain"}:
        return parameter
    factor, unit = 1.0 / shape.scale, "rad/s^2 per (rad/s)^2" if speed else "rad/s^2 at full command"
    if parameter.name == "thrust":
        unit = "m/s^2 per (rad/s)^2" if speed else "m/s^2 at full command"
        if mass is not None:
            factor, unit = factor * mass, "N s^2" if speed else "N at full command"
    return replace(
        parameter,
        si_value=None if parameter.value is None else factor * parameter.value,
        si_sigma=None if parameter.sigma is None else factor * parameter.sigma,
        si_unit=unit,
    )


def _unit(unknown: _Unknown) -> str:
    if unknown.family in {"delay", "lag"}:
        return "s"
    if unknown.family == "force":
        return "m/s^2 for the usual change of the input"
    return "rad/s^2 for the usual change of the input" if unknown.family == "torque" else "1"


def _absolute(family: str) -> float:
    return ABSOLUTE.get(family) or ABSOLUTE.get(family.rsplit("_", 1)[0], 0.0)


def _wind_sigma(unknowns: Sequence[_Unknown], found: ShootingFit) -> dict[str, Floats]:
    spread = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    out: dict[str, Floats] = {}
    for k, unknown in enumerate(unknowns):
        if unknown.kind == "wind":
            out.setdefault(unknown.record, np.zeros(2))[unknown.at] = spread[k]
    return out
