"""Ratios of polynomials with a delay: what a fitted structure amounts to, and fits without any structure."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import NDArray

from sysid.frequency.axes import FrequencyError
from sysid.frequency.cost import cost
from sysid.frequency.response import Complex, Floats, FrequencyResponse
from sysid.frequency.structures import low_pass

#: Errors of the response below which no model is right.
_FLOOR = 0.01

#: Delays [s] from which the search starts, and times that the denominator is fed back as a weight.
_DELAYS = (0.0, 0.005, 0.015, 0.04)
_FEEDBACK = 6


@dataclass(frozen=True, slots=True, eq=False)
class StateSpace:
    """``dx/dt = A x + B u(t - delay)``, ``y = C x + D u(t - delay)``; controller canonical form."""

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    delay: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RationalModel:
    """``G(s) = exp(-delay s) num(s) / den(s)``, without the filter of the measurement."""

    #: Highest power first; `den` is monic.
    num: Floats
    den: Floats
    delay: float  #: s.
    covariance: Floats = field(repr=False)  #: Of ``(num, den without its leading 1, delay)``.
    cost: float  #: J of the response that it was fitted to.
    criterion: float = float("nan")  #: Bayesian information criterion; the least is best.
    gyro_filter_hz: float | None = None  #: Filter of the measurement that was taken out.

    @property
    def poles(self) -> Complex:
        """Return the poles, rad/s, slowest first."""
        return _roots(self.den)

    @property
    def zeros(self) -> Complex:
        """Return the zeros, rad/s, slowest first."""
        return _roots(self.num)

    @property
    def pole_covariance(self) -> tuple[Floats, ...]:
        """Return the covariance of real and imaginary part of each pole, (rad/s)^2, shape (2, 2)."""
        first, derivative = len(self.num), np.polyder(self.den)
        free = len(self.den) - 1
        inner = self.covariance[first : first + free, first : first + free]
        found = []
        for pole in self.poles:
            slope = -(pole ** np.arange(free - 1, -1, -1)) / np.polyval(derivative, pole)
            parts = np.vstack([slope.real, slope.imag])
            found.append(np.asarray(parts @ inner @ parts.T, dtype=np.float64))
        return tuple(found)

    @property
    def state_space(self) -> StateSpace:
        """Return the matrices of a state-space form."""
        a, b, c, d = scipy.signal.tf2ss(self.num, self.den)
        return StateSpace(np.asarray(a), np.asarray(b), np.asarray(c), np.asarray(d), self.delay)

    def response(self, hz: Floats) -> Complex:
        """Evaluate at frequencies [Hz] with the filter of the measurement, shape (n,)."""
        hz = np.asarray(hz, dtype=np.float64)
        s = 2j * np.pi * hz
        ratio = np.polyval(self.num, s) / np.polyval(self.den, s) * np.exp(-self.delay * s)
        return np.asarray(ratio * low_pass(hz, self.gyro_filter_hz))


def _roots(polynomial: Floats) -> Complex:
    roots = np.roots(polynomial).astype(np.complex128)
    return np.asarray(sorted(roots, key=lambda root: (abs(root), root.imag)), dtype=np.complex128)


def fit_rational(frf: FrequencyResponse, poles: int, zeros: int, *, delay: bool = True) -> RationalModel:
    """Fit a ratio of polynomials without structure.

    Linear least squares with the denominator fed back (Sanathanan and Koerner 1963) from several delays, then a search
    over all coefficients for the error of the logarithm.

    Raises
    ------
    FrequencyError
        When too few frequencies are coherent for so many coefficients.
    """
    if not 0 <= zeros <= poles or poles < 1:
        raise FrequencyError(f"{poles} poles and {zeros} zeros make no response that can be realised")
    good = frf.usable & np.isfinite(frf.sigma)
    count = poles + zeros + 1 + int(delay)
    worth = 2.0 * float(np.sum(frf.weight_of_points[good]))
    if worth < count or np.count_nonzero(good) < count:
        raise FrequencyError(f"{frf.axis}: too few coherent frequencies for {poles} poles and {zeros} zeros")
    hz = frf.hz[good]
    measured = frf.response[good] / low_pass(hz, frf.gyro_filter_hz)
    weight = np.asarray(np.sqrt(frf.weight_of_points[good]) / np.hypot(frf.sigma[good], _FLOOR))
    unit = 2.0 * np.pi * float(np.sqrt(hz[0] * hz[-1]))
    s: Complex = np.asarray(2j * np.pi * hz / unit, dtype=np.complex128)

    def remainder(x: Floats) -> Floats:
        num, den = x[: zeros + 1], np.concatenate([[1.0], x[zeros + 1 : zeros + 1 + poles]])
        late = x[-1] / 100.0 if delay else 0.0
        with np.errstate(all="ignore"):
            error = np.log(measured * np.polyval(den, s) / np.polyval(num, s) * np.exp(late * s * unit)) * weight
        error = np.where(np.isfinite(error), error, 1e3)
        return np.concatenate([error.real, error.imag])

    best = None
    for late in _DELAYS if delay else (0.0,):
        num, den = _linear(np.asarray(measured * np.exp(late * s * unit), dtype=np.complex128), s, weight, poles, zeros)
        x = np.concatenate([num, den[1:], [100.0 * late] if delay else []])
        result = scipy.optimize.least_squares(remainder, x, method="trf", x_scale="jac", max_nfev=120)
        if best is None or result.cost < best.cost:
            best = result
    assert best is not None
    x, slope = np.asarray(best.x, dtype=np.float64), np.asarray(best.jac, dtype=np.float64)
    excess = max(1.0, 2.0 * float(best.cost) / max(worth - count, 1.0))
    scale = np.concatenate([unit ** np.arange(poles - zeros, poles + 1.0), unit ** np.arange(1.0, poles + 1.0)])
    scale = np.concatenate([scale, [0.01]]) if delay else scale
    covariance = np.linalg.pinv(slope.T @ slope, hermitian=True) * np.outer(scale, scale) * excess
    if not delay:
        covariance = np.pad(covariance, (0, 1))
    values = x * scale
    model = RationalModel(
        num=values[: zeros + 1],
        den=np.concatenate([[1.0], values[zeros + 1 : zeros + 1 + poles]]),
        delay=float(values[-1]) if delay else 0.0,
        covariance=np.asarray(covariance),
        cost=0.0,
        criterion=2.0 * float(best.cost) + count * float(np.log(max(worth, 2.0))),
        gyro_filter_hz=frf.gyro_filter_hz,
    )
    return _with_cost(model, frf, good)


def scan_orders(frf: FrequencyResponse, most_poles: int = 4) -> tuple[RationalModel, ...]:
    """Fit all orders up to a number of poles, fewer zeros than poles, best first by the information criterion.

    Models with poles in the right half plane that are faster than the slowest frequency are left out.

    Raises
    ------
    FrequencyError
        When not even one pole can be fitted.
    """
    found = []
    for poles in range(1, most_poles + 1):
        for zeros in range(poles):
            try:
                model = fit_rational(frf, poles, zeros)
            except FrequencyError:
                continue
            if not np.any(model.poles.real > 2.0 * np.pi * frf.hz[0]) and -0.005 < model.delay < 0.3:
                found.append(model)
    if not found:
        raise FrequencyError(f"{frf.axis}: too few coherent frequencies for a transfer function")
    return tuple(sorted(found, key=lambda model: model.criterion))


def _linear(measured: Complex, s: Complex, weight: Floats, poles: int, zeros: int) -> tuple[Floats, Floats]:
    """Return numerator and denominator of the linear least squares of ``N - G D``."""
    ahead = s[:, None] ** np.arange(zeros, -1, -1)
    behind = -measured[:, None] * s[:, None] ** np.arange(poles - 1, -1, -1)
    regressors = np.hstack([ahead, behind])
    wanted = measured * s**poles
    den = np.array([1.0])
    num = np.array([1.0])
    with np.errstate(all="ignore"):
        each = weight / np.abs(wanted)
        for _ in range(_FEEDBACK):
            matrix = np.nan_to_num(regressors * each[:, None])
            right = np.nan_to_num(wanted * each)
            x = np.linalg.lstsq(
                np.vstack([matrix.real, matrix.imag]), np.concatenate([right.real, right.imag]), rcond=None
            )[0]
            num, den = x[: zeros + 1], np.concatenate([[1.0], x[zeros + 1 :]])
            each = weight / np.maximum(np.abs(np.polyval(den, s) * measured), 1e-12)
    return np.asarray(num), np.asarray(den)


def _with_cost(model: RationalModel, frf: FrequencyResponse, good: NDArray[np.bool_]) -> RationalModel:
    j = cost(frf.response[good], model.response(frf.hz[good]), frf.coherence[good])
    return RationalModel(
        num=model.num,
        den=model.den,
        delay=model.delay,
        covariance=model.covariance,
        cost=j,
        criterion=model.criterion,
        gyro_filter_hz=model.gyro_filter_hz,
    )
