"""Whether motor outputs are those that the mixer asked for: their order, and how evenly they share the work.

The rate controller's outputs through the frame's factors say what each motor should do; the logged motor outputs,
through the autopilot's thrust curve, what each was told. Outputs are written ten times a second while the controller
runs at 400 Hz, so that means of what was written alias: the controller's outputs are taken at the instants of the
motors' instead (cubic spline; in firmware nothing lies between the two). Where both are slow, means over half seconds
tell more, and what the mixer explains better is used. Where the controller's outputs are not logged, what they do is:
the angular acceleration a moment later; the gain of each axis is estimated, which takes no knowledge of the order.

Which output follows which motor of the mixer is an assignment problem (Kuhn 1955); another order than the logged one is
believed when it is far more likely than what any of the n! orders could be by chance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import lgamma

import numpy as np
import pandas as pd
import scipy

from logparse import Finding, MissingDataError, Severity, Tables, Vehicle
from sysid.records.arrays import Floats
from sysid.records.mixer import INDEPENDENT, expectation, factors_of
from sysid.records.mixer_curve import MARGIN, sampled_at
from sysid.records.motor_scaling import curve, motor_commands

#: Time over which neighbours count as one, and over which means are taken where the controller is logged slowly, s.
BLOCK_SECONDS = 0.5

#: Parts of a flight that are looked at apart, and the shortest, s.
_PARTS, _PART_SECONDS = 4, 15.0

#: Fewest half seconds that tell an order.
_FEWEST = 20

#: Log-likelihood beyond the logarithm of the number of orders by which another order must be better.
SURE = 15.0

#: Rounding of outputs to whole microseconds, as a part of the mean thrust, in half-second means.
_ROUNDING = 3e-4

#: Part of the motors' movement that another order must explain.
EXPLAINED = 0.1

#: Departure of a motor's output from what the mixer asks of it that is a finding, its size in standard errors, and over
#: the next motor's: firmware gives what it is asked for within 0.3 %, unless its mixer is another than was thought.
UNEVEN, UNEVEN_SIGMAS, UNEVEN_ALONE = 0.03, 5.0, 2.0

#: Time between outputs and the angular acceleration that answers, s: electronics, rotors and the gyro's filter.
_ANSWERS = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12)

#: Time over which an angular acceleration is a difference of rates, and the slowest gyro that tells it, s.
_TURNING, _SLOWEST_GYRO = 0.08, 0.05

_AXES = ("roll", "pitch", "yaw")

#: Largest output of a rate controller in any firmware's scale; beyond are flipped bits.
_MOST_ASKED = 1e5


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorOrder:
    """How motor outputs follow the mixer over a flight."""

    source: str  #: What the motors were held against: ``outputs`` of the rate controller, or ``motion``.
    follows: Mapping[str, str]  #: Motor of the mixer that each output follows best, itself where the log is in order.
    #: Output of each motor over what the mixer asks of it, both over the mean of all motors; empty without the rate
    #: controller's thrust.
    share: Mapping[str, float]
    share_sigma: Mapping[str, float]
    ratio: float  #: Variance of the residuals in the logged order over that in the best one.
    explained: float  #: Part of the outputs' movement that the best order explains.
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True)
class _View:
    """Departures of the motors from their mean: those logged, and those that the mixer asks for."""

    t: Floats  #: shape (n,)
    got: Floats  #: shape (n, motors): over the mean of all motors
    wanted: Floats  #: the same
    whole: bool  #: Whether what is wanted holds with its level and scale, not only its changes.
    blocks: float  #: Number of independent half seconds.

    @property
    def moved(self) -> Floats:
        return np.asarray(self.got - self.got.mean(axis=0))

    @property
    def due(self) -> Floats:
        return np.asarray(self.wanted - self.wanted.mean(axis=0))


@dataclass(frozen=True, slots=True)
class _Fit:
    """The order that explains a view best."""

    view: _View
    best: np.ndarray  #: Motor of the mixer that each output follows.
    own: Floats  #: What is left of each output's movement in the logged order ...
    found: Floats  #: ... and in the best one.
    explained: float


def motor_order(tables: Tables, vehicle: Vehicle, start: float, stop: float) -> MotorOrder:
    """Compare a flight's motor outputs with what the mixer asked for.

    Parameters
    ----------
    tables : Tables
        With the motors' outputs, and the rate controller's outputs or angular rates.
    vehicle : Vehicle
        Whose frame is known.
    start, stop : float
        Airborne interval, s.

    Raises
    ------
    MissingDataError
        When the frame, a motor's output or everything that tells what was asked is missing, or the flight is too short.
    """
    motors = _outputs(tables, vehicle)
    return _order(motors.loc[start:stop], _asked(tables, start, stop), vehicle)


def _outputs(tables: Tables, vehicle: Vehicle) -> pd.DataFrame:
    """Return the outputs of all motors.

    Raises
    ------
    MissingDataError
        When the frame or a motor's output is missing.
    """
    names = [f"m{motor.number}" for motor in vehicle.motors]
    if not names or tables.motors is None or not set(names) <= set(tables.motors):
        raise MissingDataError("the order of motors needs the frame and the outputs of all its motors")
    return tables.motors[names].dropna()


def _order(motors: pd.DataFrame, asked: _Asked, vehicle: Vehicle) -> MotorOrder:
    """Compare outputs with what was asked for.

    Raises
    ------
    MissingDataError
        When the flight is too short, or damaged.
    """
    names = tuple(map(str, motors))
    factors = factors_of(vehicle)
    by_axis = asked.source == "motion"
    views = [view for one in asked.signals for view in _views(motors, one, vehicle, factors, by_axis=by_axis)]
    fits = [fit for view in views if (fit := _fit(view)) is not None]
    if not fits:
        raise MissingDataError("what was asked of the motors holds numbers that no controller gives: damage")
    fit = max(fits, key=lambda one: one.explained)
    best, wrong = fit.best, fit.best != np.arange(len(names))
    ratio = float(fit.own.sum() / max(float(fit.found.sum()), 1e-300))
    share, sigma = _shares(fit.view) if fit.view.whole else (None, None)
    findings: list[Finding] = []
    if (
        wrong.any()
        and _likelier(fit.view, factors, best) > lgamma(len(names) + 1) + SURE
        and fit.explained > EXPLAINED
        and np.all(fit.own[wrong] > fit.found[wrong])
    ):
        findings.append(_order_finding(names, best, ratio))
    else:
        best = np.arange(len(names))
        if share is not None and sigma is not None:
            findings += _uneven_findings(names, share, sigma)
    return MotorOrder(
        source=asked.source,
        follows={name: names[k] for name, k in zip(names, best, strict=True)},
        share={} if share is None else dict(zip(names, map(float, share), strict=True)),
        share_sigma={} if sigma is None else dict(zip(names, map(float, sigma), strict=True)),
        ratio=ratio,
        explained=fit.explained,
        findings=tuple(findings),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderChange:
    """Motor outputs that follow the mixer in another order from some moment of a flight on."""

    t: float  #: s.
    follows: Mapping[str, str]  #: What outputs follow of the mixer from then on, those alone that changed.


def find_order_change(tables: Tables, vehicle: Vehicle, start: float, stop: float) -> OrderChange | None:
    """Find outputs that changed places within a flight, as its whole does not show.

    None where the order stays, or where nothing tells it.

    Parameters
    ----------
    tables : Tables
        With the motors' outputs, and the rate controller's outputs or angular rates.
    vehicle : Vehicle
        Whose frame is known.
    start, stop : float
        Airborne interval, s.
    """
    count = min(_PARTS, int((stop - start) // _PART_SECONDS))
    edges = np.linspace(start, stop, count + 1)
    before: Mapping[str, str] = {}
    try:
        motors, asked = _outputs(tables, vehicle), _asked(tables, start, stop)
    except MissingDataError:
        return None
    for k in range(count):
        try:
            found = _order(motors.loc[edges[k] : edges[k + 1]], asked.between(edges[k], edges[k + 1]), vehicle)
        except MissingDataError:
            continue
        if before and found.follows != before:
            changed = {name: other for name, other in found.follows.items() if before[name] != other}
            both = motors.loc[edges[k - 1] : edges[k + 1]], asked.between(edges[k - 1], edges[k + 1])
            t = _when(*both, vehicle, before, found.follows)
            return OrderChange(t=t, follows=changed)
        before = found.follows
    return None


def _when(
    motors: pd.DataFrame, asked: _Asked, vehicle: Vehicle, before: Mapping[str, str], after: Mapping[str, str]
) -> float:
    """Return the moment between two orders at which they leave least of the outputs' movement unexplained, s."""
    names = [str(name) for name in motors]
    middle = asked.signals[len(asked.signals) // 2]
    view = _views(motors, middle, vehicle, factors_of(vehicle), by_axis=asked.source == "motion")[0]
    left = [
        np.sum((view.got - view.wanted[:, [names.index(order[name]) for name in names]]) ** 2, axis=1)
        for order in (before, after)
    ]
    gain = np.cumsum(left[0] - left[1])
    # The sum falls while the first order holds and rises from then on.
    return float(view.t[int(np.argmin(gain))])


@dataclass(frozen=True, slots=True, eq=False)
class _Asked:
    """What was asked of the mixer, or what came of it after several delays."""

    #: Columns are ``roll pitch yaw``, and ``thrust`` where it is known.
    signals: tuple[pd.DataFrame, ...]
    source: str  #: ``"outputs"`` of the rate controller, or ``"motion"``.

    def between(self, start: float, stop: float) -> _Asked:
        """Return what there is of it from start to stop [s], with a second more on either side."""
        return replace(self, signals=tuple(one.loc[start - 1.0 : stop + 1.0] for one in self.signals))


def _asked(tables: Tables, start: float, stop: float) -> _Asked:
    """Read what was asked from start to stop [s].

    Raises
    ------
    MissingDataError
        When nothing tells it.
    """
    if tables.has("rates"):
        columns = tuple(tables.columns("rates", [f"out_{axis}" for axis in _AXES]))
        if all(column.notna().sum() > 1 for column in columns):
            (thrust,) = tables.columns("rates", ["out_thrust"])
            known = dict(zip(_AXES, columns, strict=True))
            known |= {"thrust": thrust} if thrust.notna().sum() > 1 else {}
            rows = pd.DataFrame(known).loc[start - 1.0 : stop + 1.0]
            return _Asked((rows[(np.abs(rows.to_numpy()) <= _MOST_ASKED).all(axis=1)],), "outputs")
    if tables.imu is None:
        raise MissingDataError("the order of motors needs the rate controller's outputs (RATE)")
    return _Asked(tuple(_accelerations(tables, start, stop)), "motion")


def _accelerations(tables: Tables, start: float, stop: float) -> list[pd.DataFrame]:
    """Return angular accelerations, rad/s^2, as they answer to motor outputs after each of `_ANSWERS`."""
    assert tables.imu is not None
    gyro = tables.imu.loc[start - 1.0 : stop + 1.0, ["gyro_x", "gyro_y", "gyro_z"]].dropna()
    t = gyro.index.to_numpy(np.float64)
    if len(t) < 4 or float(np.median(np.diff(t))) > _SLOWEST_GYRO:
        raise MissingDataError(
            "the order of motors needs the rate controller's outputs (RATE), or angular rates at 20 Hz"
        )
    at = np.arange(t[0], t[-1], 0.5 * _TURNING)
    found = []
    for answer in _ANSWERS:
        later, sooner = (
            np.column_stack([np.interp(at + answer + sign * 0.5 * _TURNING, t, column) for column in gyro.to_numpy().T])
            for sign in (1.0, -1.0)
        )
        found.append(pd.DataFrame((later - sooner) / _TURNING, columns=list(_AXES), index=at))
    return found


def _views(
    motors: pd.DataFrame, asked: pd.DataFrame, vehicle: Vehicle, factors: Floats, *, by_axis: bool
) -> tuple[_View, ...]:
    """Return what motors got and should have got at the instants of the outputs, and both over half seconds."""
    t = motors.index.to_numpy(np.float64)
    command = motor_commands(motors.to_numpy(np.float64), vehicle)
    given = curve(np.clip(command, 0.0, 1.0), vehicle.thrust_expo)
    outputs = np.column_stack([sampled_at(t, asked[name]) for name in asked])
    whole = "thrust" in asked
    inside = np.isfinite(outputs).all(axis=1) & np.all((command > MARGIN) & (command < 1.0 - MARGIN), axis=1)
    if whole:
        outputs = outputs[:, [3, 0, 1, 2]]
        inside &= outputs[:, 0] > MARGIN
    step = float(np.median(np.diff(t))) if len(t) > 1 else BLOCK_SECONDS
    blocks = inside.sum() * min(step, BLOCK_SECONDS) / BLOCK_SECONDS
    if blocks < _FEWEST:
        raise MissingDataError(f"only {BLOCK_SECONDS * blocks:.0f} s in which no motor is at an end of its range")
    # Half seconds of the flight; those that are not wholly inside are left out.
    half = pd.Series(np.floor(t / BLOCK_SECONDS))
    good = half.groupby(half).transform("size").to_numpy() > 0.8 * BLOCK_SECONDS / step
    good &= pd.Series(inside).groupby(half).transform("all").to_numpy()
    views = []
    for rows in (inside, good) if good.sum() * step >= _FEWEST * BLOCK_SECONDS else (inside,):
        at, told, due = t[rows, None], given[rows], outputs[rows]
        if rows is good:
            blocks_of = half[rows].to_numpy()
            at, told, due = (pd.DataFrame(part).groupby(blocks_of).mean().to_numpy() for part in (at, told, due))
        mean = told.mean(axis=1, keepdims=True)
        got = told / mean
        if whole:
            # What the firmware does about voltage and density is alike for all motors.
            wanted = expectation(due, factors)
            wanted = wanted / wanted.mean(axis=1, keepdims=True)
        else:
            wanted = _scaled(got, due if by_axis else due / mean, factors)
        views.append(_View(t=at[:, 0], got=got, wanted=wanted, whole=whole, blocks=blocks))
    return tuple(views)


def _scaled(got: Floats, driving: Floats, factors: Floats) -> Floats:
    """Return what the mixer asks for where the gain of each axis is unknown, (n, motors).

    Which motor is which does not matter to the size of an axis's pattern over all motors, so that its gain is that size
    in the outputs over that in the mixer.
    """
    moving = driving - driving.mean(axis=0)
    pattern = np.linalg.lstsq(moving, got - got.mean(axis=0), rcond=None)[0]
    size = np.linalg.norm(factors - factors.mean(axis=0), axis=0)
    gain = np.linalg.norm(pattern, axis=1) / np.maximum(size, INDEPENDENT) * (size > INDEPENDENT)
    return np.asarray(1.0 + (driving * gain) @ factors.T)


def _fit(view: _View) -> _Fit | None:
    """Return the best order; None where numbers are so large that their squares are none."""
    with np.errstate(over="ignore", invalid="ignore"):
        moved = view.moved
        costs = np.sum((moved[:, :, None] - view.due[:, None, :]) ** 2, axis=0)
    if not np.isfinite(costs).all():
        return None
    best = _cheapest(costs)
    found = costs[np.arange(len(costs)), best]
    explained = float(1.0 - found.sum() / max(float(np.sum(moved**2)), 1e-300))
    return _Fit(view, best, np.diag(costs), found, explained)


def _cheapest(costs: Floats) -> np.ndarray:
    """Assign to every row another column, at the least sum of costs."""
    own = np.arange(len(costs))
    # Where every row likes its own column best there is nothing to solve, nor an optimiser to import.
    if np.array_equal(costs.argmin(axis=1), own):
        return own
    return np.asarray(scipy.optimize.linear_sum_assignment(costs)[1])


def _shares(view: _View) -> tuple[Floats, Floats]:
    """Return what each motor is told over what the mixer asks of it, and its standard error."""
    level = view.got - view.wanted
    size = max(round(2.0 * len(level) / view.blocks), 1)
    parts = level[: len(level) // size * size].reshape(-1, size, level.shape[1]).mean(axis=1)
    return 1.0 + level.mean(axis=0), parts.std(axis=0, ddof=1) / np.sqrt(len(parts))


def _likelier(view: _View, factors: Floats, best: np.ndarray) -> float:
    """Return by how much in log-likelihood one order is better than that logged.

    What is left over is judged along roll, pitch and yaw and across them apart, for the firmware may limit yaw and
    rounds everything: noise along one must not hide what another says. Of half seconds neighbours count as one.
    """
    logged = np.arange(len(best))
    parts = [_parts(view.moved - view.due[:, order], factors[order]) for order in (logged, best)]
    gained = sum(size * np.log(one / other) for (size, one), (_, other) in zip(*parts, strict=True))
    return 0.25 * view.blocks * float(gained)


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
    next_ = float(np.max(np.abs(np.delete(off, k))))
    if abs(off[k]) < max(UNEVEN, UNEVEN_SIGMAS * sigma[k], UNEVEN_ALONE * next_):
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
