"""Linear systems at instants of flight, and all of them stacked: the estimation of `sysid.rotors.refinement2020`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from core.parameter import Parameter
from core.robust import robust_sigma
from logparse import MissingDataError
from sysid.records.experiment import Experiment, ExperimentError, Floats
from sysid.records.motor_signals import MotorGeometry, unexplained
from sysid.records.thrust_curve import body_velocity, column, lagged
from sysid.rotors.thrust_regression import covariance_of, judged, scaled

#: Condition number of an instant's system, columns scaled to their usual size over the flight, above which it is
#: degenerate.
DEGENERATE = 10.0

#: Fewest instants that make a mean; the paper asks for three with different control inputs. Instants within
#: `CORRELATED` of each other are one: four samples of one turn are one turn.
FEWEST = 3

#: Huber's constant: 95 % efficiency for normal residuals.
HUBER = 1.345

#: How far residuals are taken to be correlated, s. Differences of noisy rates have hardly any power where the craft
#: moves, which a short (tapered) autocovariance does not resolve.
CORRELATED = 2.0

#: Names and units, in order; without a unit those of the signal enter.
PARAMETERS = {"k": "", "C": "1/m", "Jx": "m", "Jy": "m", "Jz": "m", "b": "", "b/Jz": ""}

#: Part by which inertia errs because the paper takes the air to be at rest: on simulated craft in 7 to 10 m/s 3.7 %
#: (root mean square; up to 8 %), in less wind 2.5 %.
STILL_AIR = 0.03


@dataclass(frozen=True, slots=True)
class InstantMean:
    """A parameter as the paper finds it."""

    #: Over the instants kept; None when too few are left.
    mean: float | None
    spread: float | None
    median: float | None
    #: Instants.
    used: int
    dropped: int
    reason: str = ""
    #: Stretches of `CORRELATED` seconds in which the instants kept lie: so many of them are independent.
    events: int = 0

    def doubted(self, reason: str) -> InstantMean:
        """Return the same without its numbers, where there is a reason not to believe them."""
        return replace(self, mean=None, spread=None, median=None, reason=reason) if reason else self


@dataclass(frozen=True, slots=True)
class InstantMotion:
    """What the equations read, averaged over the span of each finite difference: all (M,), or (M, 3).

    `force` specific force, `speed` body velocity, `rates`, `acceleration` angular, `lift` sum of s; `roll`, `pitch`,
    `yaw` sums of s times unit levers (for a positive moment).
    """

    force: Floats
    speed: Floats
    rates: Floats
    acceleration: Floats
    lift: Floats
    roll: Floats
    pitch: Floats
    yaw: Floats
    dt: float

    @classmethod
    def of(cls, record: Experiment, geometry: MotorGeometry, signals: Floats, rates: Floats) -> InstantMotion:
        """Read what the equations need from a record, its motors' signals and rates.

        Shapes: `signals` (N, n); `rates` (N, 3).
        """
        force = np.column_stack([column(record, f"f_{axis}") for axis in "xyz"])
        speed = body_velocity(record)
        for label, values in {"angular rates": rates, "velocity or attitude": speed}.items():
            if not np.isfinite(values).all():
                raise MissingDataError(
                    f"{record.name}: {label} not known, which Refinement 2020 needs; log IMU and GPS"
                )
        if len(record.t) < 2 * FEWEST + 2:
            raise ExperimentError(f"{record.name}: {len(record.t)} samples are too few")
        return cls(
            force=_span(force),
            speed=_span(speed),
            rates=_span(rates),
            acceleration=(rates[2:] - rates[:-2]) / (2.0 * record.dt),
            lift=_span(signals.sum(axis=1)),
            roll=_span(-(signals @ geometry.right)),
            pitch=_span(signals @ geometry.forward),
            yaw=_span(-(signals @ geometry.spin)),
            dt=record.dt,
        )


def _span(values: Floats) -> Floats:
    """Mean over the two steps of a central difference (Simpson), so that both sides of an equation see the same."""
    return np.asarray((values[:-2] + 4.0 * values[1:-1] + values[2:]) / 6.0)


def _products(motion: InstantMotion) -> tuple[Floats, Floats, Floats]:
    p, q, r = motion.rates.T
    return q * r, p * r, p * q


def solve_instants(motion: Sequence[InstantMotion]) -> dict[str, InstantMean]:
    """Solve the paper's systems (22) and (24) at every instant."""
    force = np.concatenate([m.force for m in motion])
    speed = np.concatenate([m.speed for m in motion])
    lift = np.concatenate([m.lift for m in motion])
    t = _clock(motion)
    drag = -np.abs(speed) * speed
    thrust = np.column_stack([np.zeros_like(lift), np.zeros_like(lift), -lift])
    first, kept = _solve_each(np.stack([thrust, drag], axis=2), force)
    result = {
        name: mean_of_instants(
            t, first[:, k], kept, "the craft hardly moves through the air" if name == "C" else "it hardly lifts"
        )
        for k, name in enumerate(("k", "C"))
    }
    # Thrust is known at every instant with the speed at rest too: only drag needs motion.
    lifting = lift > 0.1 * np.median(lift)
    alone = np.where(lifting, -force[:, 2] / np.where(lifting, lift, 1.0), np.nan)
    if result["k"].mean is None:
        result["k"] = mean_of_instants(t, alone, lifting, "it hardly lifts")
    k = result["k"].mean
    if k is None:
        return result | {
            name: mean_of_instants(t, alone, np.zeros(len(alone), bool), "thrust is not") for name in ("Jx", "Jz", "b")
        }
    accel = np.concatenate([m.acceleration for m in motion])
    qr, pr, _ = (np.concatenate(parts) for parts in zip(*[_products(m) for m in motion], strict=True))
    roll, pitch, yaw = (np.concatenate([getattr(m, name) for m in motion]) for name in ("roll", "pitch", "yaw"))
    zero = np.zeros_like(qr)
    jx = np.column_stack([accel[:, 0] - qr, accel[:, 1] + pr, zero])
    jz = np.column_stack([qr, -pr, accel[:, 2]])
    b = np.column_stack([zero, zero, -yaw])
    aim = np.column_stack([k * roll, k * pitch, zero])
    second, kept = _solve_each(np.stack([jx, jz, b], axis=2), aim)
    why = "the craft hardly turns about two axes at once"
    result |= {name: mean_of_instants(t, second[:, j], kept, why) for j, name in enumerate(("Jx", "Jz", "b"))}
    moving = np.abs(yaw) > np.median(np.abs(yaw))
    ratio = np.where(moving, accel[:, 2] / np.where(moving, yaw, 1.0), np.nan)
    result["b/Jz"] = mean_of_instants(t, ratio, moving, "the craft hardly yaws")
    return result


def _solve_each(matrices: Floats, aims: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Least squares at each instant: (M, 3, q) and (M, 3) to (M, q), and which instants are not degenerate."""
    usual = np.sqrt(np.mean(matrices**2, axis=(0, 1)))
    if not (usual > 0.0).all():
        return np.full((len(aims), matrices.shape[2]), np.nan), np.zeros(len(aims), dtype=bool)
    scaled = matrices / usual
    singular = np.linalg.svd(scaled, compute_uv=False)
    kept = (singular[:, 0] < DEGENERATE * singular[:, -1]) & (singular[:, -1] > 1.0 / DEGENERATE)
    solved = np.full((len(aims), matrices.shape[2]), np.nan)
    inverse = np.linalg.pinv(scaled[kept])
    solved[kept] = np.einsum("mij,mj->mi", inverse, aims[kept]) / usual
    return solved, kept


def _clock(motion: Sequence[InstantMotion]) -> Floats:
    """Return a time for each instant, s, with records far apart."""
    pause, start, parts = 2.0 * CORRELATED, 0.0, []
    for flight in motion:
        parts.append(start + flight.dt * np.arange(len(flight.lift)))
        start = float(parts[-1][-1]) + pause
    return np.concatenate(parts)


def _events(t: Floats) -> NDArray[np.intp]:
    """Return the number of the stretch of `CORRELATED` seconds, each begun by an instant, that each time lies in."""
    number = np.zeros(len(t), dtype=np.intp)
    at = 0
    while at < len(t):
        stop = int(np.searchsorted(t, t[at] + CORRELATED))
        number[stop:] += 1
        at = stop
    return number


def mean_of_instants(t: Floats, values: Floats, kept: NDArray[np.bool_], reason: str) -> InstantMean:
    """Return the mean of the instants that are kept, with its spread between manoeuvres, or the reason for none.

    Shapes: `t` (M,); `values` (M,); `kept` (M,).
    """
    used = values[kept]
    number = _events(t[kept])
    events = int(number[-1]) + 1 if len(number) else 0
    if events < FEWEST:
        why = (
            f"only {len(used)} instants in {events} stretch{'es' if events > 1 else ''} of {CORRELATED:g} s are not "
            "degenerate"
            if len(used)
            else "every instant is degenerate"
        )
        return InstantMean(None, None, None, len(used), len(values) - len(used), f"{why}: {reason}", events=events)
    return InstantMean(
        float(used.mean()),
        float(used.std(ddof=1)),
        float(np.median(used)),
        len(used),
        len(values) - len(used),
        events=events,
    )


def fit_stacked(
    motion: Sequence[InstantMotion], part: float, measured: bool
) -> tuple[dict[str, Parameter], tuple[float, ...]]:
    """Estimate all parameters from all instants at once, and which part of angular accelerations motors explain.

    Thrust errs by a `part` (`unexplained_part`) besides; motors' signals are `measured` speeds, or commands.
    """
    lags = max(round(CORRELATED / motion[0].dt), 2)
    translation = [
        np.vstack(
            [
                np.column_stack([-m.lift, -np.abs(m.speed[:, 2]) * m.speed[:, 2]]),
                np.column_stack([np.zeros_like(m.lift), -np.abs(m.speed[:, 0]) * m.speed[:, 0]]),
                np.column_stack([np.zeros_like(m.lift), -np.abs(m.speed[:, 1]) * m.speed[:, 1]]),
            ]
        )
        for m in motion
    ]
    forces = [np.concatenate([m.force[:, 2], m.force[:, 0], m.force[:, 1]]) for m in motion]
    values, covariance, _ = _robust(translation, forces, lags)
    k = float(values[0])
    k_sigma = max(float(np.sqrt(covariance[0, 0])), part * k)
    drag, drag_sigma = float(values[1]), float(np.sqrt(covariance[1, 1]))
    result = {
        "k": judged(k, k_sigma, PARAMETERS["k"], "thrust hardly varies"),
        "C": judged(drag, drag_sigma, PARAMETERS["C"], "the craft is too slow for drag"),
    }
    gains = []
    patterns = ("roll", "pitch", "yaw", "lift")
    for axis, moment in enumerate(patterns[:3]):
        others = [name for name in patterns if name != moment]
        rows = [
            np.column_stack([getattr(m, moment), _products(m)[axis], *(getattr(m, other) for other in others)])
            for m in motion
        ]
        gains.append(_robust(rows, [m.acceleration[:, axis] for m in motion], lags))
    systematic = [0.0 if measured else 1.0 - part for *_, part in gains]
    inertia: list[tuple[float, float]] = []
    whys = [
        unexplained(part, f"angular acceleration in {axis}") for axis, (*_, part) in zip(patterns, gains, strict=False)
    ]
    for name, (gain, spread, _), why in zip(("Jx", "Jy"), gains, whys, strict=False):
        relative = float(np.sqrt(spread[0, 0]) / abs(gain[0])) if gain[0] != 0.0 else np.inf
        relative = float(np.hypot(relative, systematic[len(inertia)]))
        value = k / float(gain[0]) if gain[0] != 0.0 else np.nan
        inertia.append((value, relative))
        # Density enters k and the gain alike, so that inertia over mass does not feel it; wind enters k alone.
        sigma = abs(value) * float(np.linalg.norm([relative, k_sigma / k, STILL_AIR])) if k > 0.0 else np.inf
        result[name] = judged(
            value, sigma, PARAMETERS[name], f"the craft hardly {'rolls' if name == 'Jx' else 'pitches'}", why
        )
    torque = float(gains[2][0][0])
    torque_spread = float(np.hypot(np.sqrt(gains[2][1][0, 0]), systematic[2] * torque))
    result["b/Jz"] = judged(torque, torque_spread, PARAMETERS["b/Jz"], "the craft hardly yaws", whys[2])
    result["Jz"] = _yaw_inertia(gains, inertia)
    if result["Jx"].value is None or result["Jy"].value is None:
        result["Jz"] = Parameter(None, None, "", "roll and pitch inertia are not determined")
    jz = result["Jz"]
    if jz.value is not None and jz.sigma is not None and result["b/Jz"].value is not None:
        relative = float(np.hypot(jz.sigma / jz.value, torque_spread / torque))
        result["b"] = judged(jz.value * torque, jz.value * torque * relative, PARAMETERS["b"], "yaw inertia is not")
    else:
        result["b"] = Parameter(
            None, None, "", "yaw torque shows only over yaw inertia (b/Jz), and yaw inertia is not determined"
        )
    return {name: result[name] for name in PARAMETERS}, tuple(part for *_, part in gains)


def best_lag(motion: Sequence[InstantMotion]) -> float:
    """Find the lag with which roll and pitch moments explain most of the angular acceleration."""
    # Moments are sums of the signals: a lag of these is a lag of them.
    moments = [np.column_stack([m.roll, m.pitch]) for m in motion]
    aims = [np.concatenate([m.acceleration[:, axis] for m in motion]) for axis in range(2)]

    def left(lag: float) -> float:
        late = np.concatenate([lagged(moment, lag, m.dt) for moment, m in zip(moments, motion, strict=True)])
        total = 0.0
        for rows, aim in zip(late.T, aims, strict=True):
            power = float(rows @ rows)
            total += float(aim @ aim) - (float(rows @ aim) ** 2 / power if power > 0.0 else 0.0)
        return total

    return float(scipy.optimize.minimize_scalar(left, bounds=(0.0, 0.2), method="bounded", options={"xatol": 1e-4}).x)


def _yaw_inertia(gains: Sequence[tuple[Floats, Floats, float]], inertia: Sequence[tuple[float, float]]) -> Parameter:
    """Find Jz from the products of rates: (Jy - Jz)/Jx of the roll and (Jz - Jx)/Jy of the pitch equation."""
    (jx, x_relative), (jy, y_relative) = inertia
    from_roll, from_pitch = float(gains[0][0][1]), float(gains[1][0][1])
    guesses = np.array([jy - jx * from_roll, jx + jy * from_pitch])
    spreads = np.array(
        [
            np.hypot(jx * np.sqrt(gains[0][1][1, 1]), np.hypot(jy * y_relative, from_roll * jx * x_relative)),
            np.hypot(jy * np.sqrt(gains[1][1][1, 1]), np.hypot(jx * x_relative, from_pitch * jy * y_relative)),
        ]
    )
    if not (np.isfinite(guesses).all() and np.isfinite(spreads).all() and (spreads > 0.0).all()):
        return Parameter(None, None, "", "roll and pitch inertia are not determined")
    weights = 1.0 / spreads**2
    value, sigma = float(guesses @ weights / weights.sum()), float(1.0 / np.sqrt(weights.sum()))
    return judged(
        value,
        sigma,
        PARAMETERS["Jz"],
        "it shows by itself only in products of rates, and the craft hardly turns about two axes at once; "
        "a bifilar pendulum measures it",
    )


def _robust(rows: Sequence[Floats], aims: Sequence[Floats], lags: int) -> tuple[Floats, Floats, float]:
    """Least squares with Huber weights by reweighting; covariance for coloured residuals; part of power explained."""
    x, y = np.vstack(rows), np.concatenate(aims)
    _, size = scaled(x)
    weight = np.ones(len(y))
    values = np.zeros(x.shape[1])
    for _ in range(20):
        weighted = x * weight[:, None]
        normal = weighted.T @ x / np.outer(size, size)
        new = np.linalg.lstsq(normal, weighted.T @ y / size, rcond=1e-13)[0] / size
        residual = y - x @ new
        scale = robust_sigma(residual)
        done = bool(np.allclose(new, values, rtol=1e-7, atol=0.0))
        values = new
        if done or scale == 0.0:
            break
        weight = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-300))
    root = np.sqrt(weight)
    cuts = np.cumsum([len(aim) for aim in aims])[:-1]
    covariance = covariance_of(
        np.split(x * root[:, None], cuts), np.split((y - x @ values) * root, cuts), most_lags=lags
    )
    power = float(y @ y)
    explained = 1.0 - float(np.sum((y - x @ values) ** 2)) / power if power > 0.0 else 0.0
    return values, np.maximum(covariance, 0.0) * np.eye(len(values)), explained
