"""Output error over windows of a flight: the estimation behind `sysid.rotors.kim2017`.

Altitude, roll rate, pitch rate and yaw rate of a window are linear in thrust coefficients, levers times thrust, torque
and the window's initial states; initial states are projected out, and the rest is weighted least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.units import STANDARD_GRAVITY
from logparse import MissingDataError
from sysid.records.experiment import Experiment, ExperimentError, Floats
from sysid.records.motor_signals import EXPLAINED, MotorGeometry, motor_signals
from sysid.records.thrust_curve import Law, column, lagged
from sysid.rotors.thrust_regression import DETERMINED, scaled, vehicle_of
from sysid.statistics.covariance import autocovariance, coloured_information

#: Length of the windows, s: several periods of the attitude loops, short against the drift of open-loop rates.
WINDOW = 5.0

#: How far residuals are taken to be correlated, s.
CORRELATED = 0.5


@dataclass(frozen=True, slots=True)
class FlightData:
    """Signals of a record: `t` from 0 (N,), altitude (N,), rates (N, 3), vertical part of thrust (N, 1), s (N, n)."""

    t: Floats
    dt: float
    altitude: Floats
    rates: Floats
    lift: Floats
    signals: Floats
    fast: bool

    @classmethod
    def of(cls, record: Experiment, law: Law, voltage: float | None, expo: float, time_constant: float) -> FlightData:
        """Read what the equations need from a record."""
        if "z" not in record.output_names:
            raise MissingDataError(f"{record.name}: Kim 2017 matches altitude; make the record with outputs='position'")
        vehicle, _ = vehicle_of(record)
        motors = motor_signals(record, law, vehicle, voltage, expo)
        rates = motors.rates
        attitude = np.column_stack([column(record, name) for name in ("roll", "pitch")])
        if not (np.isfinite(rates).all() and np.isfinite(attitude).all()):
            raise MissingDataError(f"{record.name}: Kim 2017 matches angular rates, which are not known; log the IMU")
        return cls(
            t=record.t - record.t[0],
            dt=record.dt,
            altitude=record.y[:, record.output_names.index("z")],
            rates=rates,
            lift=np.cos(attitude).prod(axis=1, keepdims=True),
            signals=lagged(motors.signals, time_constant, record.dt),
            fast=motors.fast,
        )


@dataclass(frozen=True, slots=True)
class Window:
    """Outputs and sensitivities of a window, initial states projected out.

    `outputs` are altitude, p, q, r; `gains` (M, n) what each motor's k/m adds to altitude, and to p and q with a lever
    of 1; `climb` (M,) what air that slows climb and sink adds to altitude; `patterns` and `yaw` (M, 4) what unit
    torque, thrust, roll and pitch patterns (`motor_patterns`) add to p and q, and to r.
    """

    outputs: tuple[Floats, Floats, Floats, Floats]
    gains: tuple[Floats, Floats, Floats]
    climb: Floats
    patterns: tuple[Floats, Floats]
    yaw: Floats


@dataclass(frozen=True, slots=True)
class Estimate:
    """Thrust coefficients and levers with standard errors; how far motors are told apart; residuals."""

    coefficients: Floats
    sigma: Floats
    lever: Floats
    lever_sigma: Floats
    condition: float
    rmse: dict[str, float]
    explained: dict[str, float]


def integrate(values: Floats, dt: float) -> Floats:
    """Integrate from the first sample by cubics through four neighbours, at the ends by straight lines."""
    steps = 0.5 * (values[1:] + values[:-1])
    steps[1:-1] = (13.0 * (values[1:-2] + values[2:-1]) - values[:-3] - values[3:]) / 24.0
    result = np.zeros_like(values)
    np.cumsum(dt * steps, axis=0, out=result[1:])
    return result


def integrate_twice(values: Floats, dt: float) -> Floats:
    """Integrate twice from the first sample."""
    return integrate(integrate(values, dt), dt)


def gyroscopic(data: FlightData, inertia: tuple[float, float, float] | None) -> tuple[Floats, Floats, Floats]:
    """Integrate the products of rates in eq. 7, 8, 9; zero without inertia."""
    if inertia is None:
        zero = np.zeros(len(data.t))
        return zero, zero, zero
    p, q, r = data.rates.T
    x, y, z = inertia
    return (
        integrate((y - z) / x * q * r, data.dt),
        integrate((z - x) / y * p * r, data.dt),
        integrate((x - y) / z * p * q, data.dt),
    )


def cut_windows(data: FlightData, geometry: MotorGeometry, inertia: tuple[float, float, float] | None) -> list[Window]:
    """Cut a flight into windows with outputs and sensitivities; without inertia products of rates are projected out."""
    size = min(max(round(WINDOW / data.dt), 8), len(data.t))
    result = []
    for first in range(0, len(data.t) - size + 1, size):
        rows = slice(first, first + size)
        part = replace(
            data,
            t=data.t[rows] - data.t[first],
            altitude=data.altitude[rows],
            rates=data.rates[rows],
            lift=data.lift[rows],
            signals=data.signals[rows],
        )
        level = np.linalg.qr(np.ones((size, 1)))[0]
        line = np.linalg.qr(np.column_stack([np.ones(size), part.t]))[0]
        gyro = gyroscopic(part, inertia)
        turning = integrate(part.signals, data.dt)
        spinning = [level] * 3
        if inertia is None:
            p, q, r = part.rates.T
            products = [integrate(product, data.dt) for product in (q * r, p * r, p * q)]
            spinning = [np.linalg.qr(np.column_stack([np.ones(size), product]))[0] for product in products]
        result.append(
            Window(
                outputs=(
                    _without(line, part.altitude + 0.5 * STANDARD_GRAVITY * part.t**2),
                    _without(spinning[0], part.rates[:, 0] - gyro[0]),
                    _without(spinning[1], part.rates[:, 1] - gyro[1]),
                    _without(spinning[2], part.rates[:, 2] - gyro[2]),
                ),
                gains=(
                    _without(line, integrate_twice(part.lift * part.signals, data.dt)),
                    _without(spinning[0], -geometry.right * turning),
                    _without(spinning[1], geometry.forward * turning),
                ),
                climb=_without(line, integrate(part.altitude - part.altitude[0], data.dt)),
                patterns=(
                    _without(spinning[0], turning @ motor_patterns(geometry).T),
                    _without(spinning[1], turning @ motor_patterns(geometry).T),
                ),
                yaw=_without(spinning[2], turning @ motor_patterns(geometry).T),
            )
        )
    return result


def _without(basis: Floats, values: Floats) -> Floats:
    """Remove what unknown initial states explain."""
    return np.asarray(values - basis @ (basis.T @ values))


def output_error(
    windows: Sequence[Window], share: Floats, known: tuple[float, float] | None, start: Estimate | None = None
) -> Estimate:
    """Fit thrust coefficients and, unless known, both levers.

    Shapes: `share` (q, n).
    """
    q = len(share)
    free = known is None
    all_gains = [np.vstack([w.gains[o] for w in windows]) @ share.T for o in range(3)]
    all_outputs = [np.concatenate([w.outputs[o] for w in windows]) for o in range(3)]
    climb = scaled(np.concatenate([w.climb for w in windows])[:, None])[0]
    all_gains[0], all_outputs[0] = _without(climb, all_gains[0]), _without(climb, all_outputs[0])
    # Sensitivities are combinations of these columns: their triangular factors have all products of all rows.
    triangles = [
        np.asarray(np.linalg.qr(np.column_stack([gain, output]), mode="r"))
        for gain, output in zip(all_gains, all_outputs, strict=True)
    ]
    gains, outputs = [triangle[:, :-1] for triangle in triangles], [triangle[:, -1] for triangle in triangles]
    if start is None:
        lifted = gains[0] @ np.ones(q)
        if not np.any(lifted):
            raise ExperimentError("the motors' signals are zero throughout, so that nothing can be matched to them")
        values = np.full(q, float(lifted @ outputs[0] / (lifted @ lifted)))
    else:
        values = np.full(q, float(start.coefficients[0]))
    lever = np.array(known if known is not None else _levers(windows, float(values[0])))
    samples = np.sqrt(len(all_outputs[0]))
    for _ in range(12):
        rows, left = _sensitivities(gains, outputs, values, lever, free)
        weights = np.array([samples / max(float(np.linalg.norm(missed)), 1e-9) for missed in left])
        columns, size = scaled(np.vstack([weight * slopes for weight, slopes in zip(weights, rows, strict=True)]))
        aim = np.concatenate([weight * missed for weight, missed in zip(weights, left, strict=True)])
        step = np.linalg.lstsq(columns, aim, rcond=1e-8)[0] / size
        values, lever = values + step[:q], lever + (step[q:] if free else 0.0)
    rows, _ = _sensitivities(gains, outputs, values, lever, free)
    whole = np.vstack([weight * slopes for weight, slopes in zip(weights, rows, strict=True)])
    rows, residual = _sensitivities(all_gains, all_outputs, values, lever, free)
    covariance, condition = _covariance(whole, rows, residual, weights, [len(w.yaw) for w in windows])
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Estimate(
        values,
        sigma[:q],
        lever,
        sigma[q:] if known is None else np.zeros(2),
        condition,
        {name: float(np.sqrt(np.mean(r**2))) for name, r in zip(("z", "w_x", "w_y"), residual, strict=True)},
        {f"w_{axis}": _explained(residual[o], all_outputs[o]) for o, axis in ((1, "x"), (2, "y"))},
    )


def _explained(residual: Floats, output: Floats) -> float:
    power = float(output @ output)
    return 1.0 - float(residual @ residual) / power if power > 0.0 else 0.0


def _levers(windows: Sequence[Window], specific: float) -> list[float]:
    """Start levers: least squares of each rate on every pattern of the motors, which unlike motors do not bend."""
    result = []
    for o, (own, sign) in enumerate(((2, -1.0), (3, 1.0))):
        patterns, size = scaled(np.vstack([w.patterns[o] for w in windows]))
        output = np.concatenate([w.outputs[1 + o] for w in windows])
        result.append(sign * float(np.linalg.lstsq(patterns, output, rcond=1e-8)[0][own] / size[own] / specific))
    return result


def _sensitivities(
    gains: Sequence[Floats], outputs: Sequence[Floats], values: Floats, lever: Floats, free: bool
) -> tuple[list[Floats], list[Floats]]:
    """Sensitivities and residuals of each output, by coefficients and, if `free`, both levers."""
    rows, left = [], []
    for o, (gain, output) in enumerate(zip(gains, outputs, strict=True)):
        scale, effect = (1.0, *lever)[o], gain @ values
        levers = np.zeros((len(output), 2 if free else 0))
        if free and o > 0:
            levers[:, o - 1] = effect
        rows.append(np.hstack([scale * gain, levers]))
        left.append(output - scale * effect)
    return rows, left


def _covariance(
    whole: Floats, rows: Sequence[Floats], left: Sequence[Floats], weights: Floats, lengths: Sequence[int]
) -> tuple[Floats, float]:
    """Covariance for residuals that are coloured within windows, and the spread of the scaled singular values.

    `rows` and `left` are sensitivities and residuals of each output; `whole` has the products of all, weighted.
    """
    columns, size = scaled(whole)
    singular = np.linalg.svd(columns, compute_uv=False)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0.0 else float("inf")
    inverse = np.linalg.pinv(columns.T @ columns, rcond=1e-14)
    cuts = np.cumsum(lengths)[:-1]
    middle = np.zeros_like(inverse)
    for w, slopes, missed in zip(weights, rows, left, strict=True):
        pieces = np.split(missed, cuts)
        lags = max(min(len(pieces[0]) // 4, round(len(pieces[0]) * CORRELATED / WINDOW)), 1)
        colour = autocovariance(pieces, lags)
        middle += w**4 * coloured_information(np.split(slopes / size, cuts), colour)
    return np.asarray(inverse @ middle @ inverse / np.outer(size, size)), condition


def motor_patterns(geometry: MotorGeometry) -> Floats:
    """Return the combinations of motors that yaw may follow: torque by spin, thrust, roll, pitch; shape (4, n)."""
    return np.vstack([-geometry.spin, np.ones(len(geometry.spin)), geometry.right, geometry.forward])


@dataclass(frozen=True, slots=True)
class TorqueEstimate:
    """Mean torque over yaw inertia, its standard error, all patterns (`motor_patterns`), residual and R^2."""

    value: float
    sigma: float
    patterns: Floats
    rmse: float
    explained: float


def mean_torque(windows: Sequence[Window]) -> TorqueEstimate | None:
    """Least squares on eq. 9, integrated once; None when the torque is not determined."""
    columns, size = scaled(np.vstack([w.yaw for w in windows]))
    output = np.concatenate([w.outputs[3] for w in windows])
    if not columns[:, 0].any():
        return None
    values = np.linalg.lstsq(columns, output, rcond=1e-8)[0]
    residual = output - columns @ values
    covariance, _ = _covariance(columns, [columns], [residual], np.ones(1), [len(w.yaw) for w in windows])
    value, sigma = float(values[0] / size[0]), float(np.sqrt(max(covariance[0, 0], 0.0)) / size[0])
    explained = _explained(residual, output)
    if not value > 0.0 or sigma > DETERMINED * value or explained < EXPLAINED:
        return None
    return TorqueEstimate(value, sigma, values / size, float(np.sqrt(np.mean(residual**2))), explained)
