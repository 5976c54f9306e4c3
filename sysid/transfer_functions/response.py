"""Exact responses of continuous-time denominators to sampled inputs, and what they leave unexplained carried on.

A denominator of order n enters as ``a``, shape (n,), ascending powers without the leading 1:
``A(s) = s^n + a[n-1] s^(n-1) + ... + a[0]``. Leading zeros of ``a`` are integrators. Inside, every denominator has its
own unit of frequency, the geometric mean ``w`` of its other poles, so that ``s = w p`` and the normalised states
``p^k / A(p) u`` are of like size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from sysid.records.experiment import Floats
from sysid.records.filtering import lfilter
from sysid.transfer_functions._kernels import recur, recur_few
from sysid.transfer_functions.model_record import NoiseModel

#: Time at the start of a record over which a free run may look at the outputs to find its initial state, s.
INITIAL_SECONDS = 3.0


@dataclass(frozen=True, slots=True)
class Discretised:
    """States ``p^k / A`` (k < n) and ``p^k / A^2`` of several denominators, exactly discretised."""

    unit: Floats  #: shape (groups,): w, the unit of frequency, rad/s.
    a: Floats  #: shape (groups, n): Normalised coefficients ``a[k] / w^(n-k)``.
    #: shape (groups,): Poles of each denominator; above, rows of `a` are padded with zeros and the states stay zero.
    orders: tuple[int, ...]
    integrators: int  #: How many poles of every denominator lie at zero.
    #: shape (groups, n, n): Inner products of the impulse responses of the states ``p^k / A``, in normalised time,
    #: integrators replaced by poles at a tenth of the unit: energy over a finite time.
    gramians: Floats
    generator: Floats  #: shape (groups, 2 n + 2, 2 n + 2): Of states, input and slope of the input, per step.
    transition: Floats  #: shape (groups, 2 n, 2 n)
    #: shape (groups, 2 n): Response after one step to an input of 1, and to one that grows by 1 in a step.
    step: Floats
    ramp: Floats
    dt: float
    hold: str

    @property
    def order(self) -> int:
        """Order n of the denominators, the highest where they differ."""
        return int(self.a.shape[1])

    def first(self) -> Discretised:
        """Keep the first denominator only."""
        arrays = ("unit", "a", "gramians", "generator", "transition", "step", "ramp")
        return replace(self, orders=self.orders[:1], **{name: getattr(self, name)[:1] for name in arrays})

    def initial_precision(self) -> Floats:
        """Precision of the initial responses' coefficients, power-major, when each is expected to have unit energy.

        Energy is the integral of the squared response over time in seconds; expected is a chi-square with as many
        degrees of freedom as the denominator has poles off zero, so that a long-lived response is as unlikely as a
        strong one. The initial responses are those of the denominators without their integrators; the states of the
        integrators are a polynomial in time, which is left to the caller.
        """
        groups, k = len(self.unit), self.integrators
        n = self.order - k
        precision, orders = np.zeros((n, groups, n, groups)), np.array(self.orders) - k
        blocks = self.gramians if k == 0 else gramians(self.a[:, k:], orders, 0)
        for g in range(groups):
            precision[:, g, :, g] = orders[g] * blocks[g] / self.unit[g]
            unused = np.arange(orders[g], n)
            precision[unused, g, unused, g] = 1.0
        return precision.reshape(n * groups, n * groups)

    def forced(
        self, inputs: Floats, group: Sequence[int], delays: Floats | None = None, first: Floats | None = None
    ) -> Floats:
        """Respond to inputs (N, lanes) from rest: states over A, or over A^2, driven by the `first`; (N, n, lanes)."""
        lanes, inputs = list(group), np.ascontiguousarray(inputs)
        rest, rows = np.zeros((self.order, len(lanes))), self._rows(first)
        step, ramp = self.step[lanes, rows], self.ramp[lanes, rows]
        if delays is None or not np.any(delays):
            held = self.hold == "zoh"
            now, following = step if held else step - ramp, np.zeros_like(ramp) if held else ramp
            return self._run(inputs, lanes, now, following, rest, first)
        # The newer sample is in force for the last part of the step only.
        _, part = whole_and_part(delays, self.dt)
        late = np.asarray(expm(self.generator[lanes] * (1.0 - part)[:, None, None]))
        late_step, late_ramp, part = late[:, rows, -2], late[:, rows, -1], part[:, None]
        before, after = delayed(inputs, self.dt, delays, 1), delayed(inputs, self.dt, delays, -1)
        if self.hold == "zoh":
            return self._run(before, lanes, step - late_step, late_step, rest, first)
        old, new = part * step - ramp + late_ramp, (1.0 - part) * step + ramp - 2.0 * late_ramp
        result = self._run(before, lanes, old, new, rest, first)
        undriven = None if first is None else np.zeros_like(first)
        return result + self._run(after, lanes, late_ramp, np.zeros_like(ramp), rest, undriven)

    def free(self, samples: int, first: Floats | None = None) -> Floats:
        """Respond to a unit impulse just before the first sample, as initial states can; shape (samples, n, groups).

        States over A^2, from rest, where those over A are given that drive them.
        """
        groups = len(self.unit)
        start, nothing = np.zeros((self.order, groups)), np.zeros((groups, self.order))
        if first is None:
            start[np.array(self.orders) - 1, np.arange(groups)] = 1.0
        return self._run(np.zeros((samples, groups)), list(range(groups)), nothing, nothing, start, first)

    def _rows(self, first: Floats | None) -> slice:
        """Return where states over A, or over A^2 where the former drive them, stand among all."""
        return slice(0, self.order) if first is None else slice(self.order, 2 * self.order)

    def _run(
        self,
        inputs: Floats,
        lanes: list[int],
        from_now: Floats,
        from_next: Floats,
        start: Floats,
        first: Floats | None,
    ) -> Floats:
        rows = self._rows(first)
        transition, across = self.transition[lanes, rows, rows], self.transition[lanes, rows, : rows.start]
        driving = np.empty((len(inputs), 0, len(lanes))) if first is None else first
        # With few channels the states, not the channels, are worth being vector lanes.
        if len(lanes) < 4:
            transposed = np.ascontiguousarray(transition.transpose(0, 2, 1))
            across = np.ascontiguousarray(across.transpose(0, 2, 1))
            now, following = np.ascontiguousarray(from_now), np.ascontiguousarray(from_next)
            begin = np.ascontiguousarray(start.T)
            return np.asarray(recur_few(transposed, across, now, following, begin, inputs, driving))
        return np.asarray(
            recur(
                np.ascontiguousarray(transition.transpose(1, 2, 0)),
                np.ascontiguousarray(across.transpose(1, 2, 0)),
                np.ascontiguousarray(from_now.T),
                np.ascontiguousarray(from_next.T),
                start,
                inputs,
                driving,
            )
        )


def delayed(inputs: Floats, dt: float, delays: Floats, more: int = 0) -> Floats:
    """Shift inputs by the whole samples of their delays and by `more` samples; before the record they are constant."""
    rows = np.arange(len(inputs))[:, None] - whole_and_part(delays, dt)[0] - more
    return np.ascontiguousarray(np.take_along_axis(inputs, np.clip(rows, 0, len(inputs) - 1), axis=0))


def whole_and_part(delays: Floats, dt: float) -> tuple[NDArray[np.int64], Floats]:
    """Divide delays into whole samples and the rest, 0 <= rest < 1; rounding does not make a whole one less."""
    samples = np.asarray(delays) / dt
    whole = np.floor(samples + 1e-9)
    return whole.astype(np.int64), np.maximum(samples - whole, 0.0)


def discretise(a: Floats, dt: float, hold: str, orders: Sequence[int] | None = None) -> Discretised:
    """Discretise companion forms and their sensitivities by one matrix exponential each (Van Loan 1978)."""
    groups, n = a.shape
    orders = (n,) * groups if orders is None else tuple(orders)
    integrators = next((k for k in range(n) if a[:, k].any()), n)
    pattern, all_, last, missing = _companions(n, orders)
    unit = np.ones(groups)
    for g, order in enumerate(orders):
        if order > integrators:
            unit[g] = a[g, integrators] ** (1.0 / (order - integrators))
    normalised = a / unit[:, None] ** missing
    block = pattern.copy()
    block[all_, last, :n] = block[all_, n + last, n : 2 * n] = -normalised
    block[all_, n + last, 0] = 1.0  # the second companion is driven by 1/A u, the first state
    block *= (unit * dt)[:, None, None]
    block[:, 2 * n, 2 * n + 1] = 1.0
    exponential = np.asarray(expm(block))
    return Discretised(
        unit,
        normalised,
        orders,
        integrators,
        gramians(normalised, orders, integrators),
        block,
        exponential[:, : 2 * n, : 2 * n],
        exponential[:, : 2 * n, 2 * n],
        exponential[:, : 2 * n, 2 * n + 1],
        dt,
        hold,
    )


@cache
def _companions(
    n: int, orders: tuple[int, ...]
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return what never changes of the blocks that `discretise` exponentiates, their last rows, and units they lack."""
    pattern = np.zeros((len(orders), 2 * n + 2, 2 * n + 2))
    for g, order in enumerate(orders):
        for first in (0, n):
            rows = np.arange(first, first + order - 1)
            pattern[g, rows, rows + 1] = 1.0
        pattern[g, order - 1, 2 * n] = 1.0
    of = np.array(orders)
    return pattern, np.arange(len(orders)), of - 1, np.maximum(of[:, None] - np.arange(n), 0)


def gramians(a: Floats, orders: Sequence[int] | NDArray[np.int64], integrators: int) -> Floats:
    """Inner products of the impulse responses of ``p^k / A`` over a finite time; zero where orders are lower."""
    groups, n = a.shape
    if integrators == 0 and min(orders) == n > 0:
        return _gramian(a)
    result = np.zeros((groups, n, n))
    leaking = np.poly(np.full(integrators, -0.1))
    for g, order in enumerate(orders):
        if not order:
            continue
        stable = np.concatenate([[1.0], a[g, integrators:order][::-1]])
        result[g, :order, :order] = _gramian(np.convolve(stable, leaking)[None, :0:-1])[0]
    return result


def _gramian(a: Floats) -> Floats:
    """Solve ``A P + P A' + B B' = 0`` for companion forms.

    States being derivatives of one another, ``P[i, j]`` is zero for odd i + j and otherwise, but for its sign, the
    moment ``q[(i + j) / 2]`` of the first one's power spectrum: n unknowns instead of n^2.
    """
    by_coefficient, constant, moment, sign = _moment_equations(a.shape[1])
    rhs = np.zeros((len(a), a.shape[1], 1))
    rhs[:, -1] = -0.5
    equations = (a @ by_coefficient).reshape(-1, *constant.shape) + constant
    return np.asarray(np.linalg.solve(equations, rhs)[:, moment, 0] * sign)


@cache
def _moment_equations(n: int) -> tuple[Floats, Floats, NDArray[np.int64], Floats]:
    """Parts of the equations of moments that coefficients multiply and that they do not; index and sign of moments."""
    i, j = np.indices((n, n))
    sign = np.where((i + j) % 2 == 0, (-1.0) ** ((j - i) // 2), 0.0)
    moment = (i + j) // 2
    rows = np.arange(n)
    by_coefficient, constant = np.zeros((n, n, n)), np.zeros((n, n))
    for k in range(n):
        by_coefficient[k, rows, moment[:, k]] -= sign[:, k]
    constant[rows[:-1], moment[1:, n - 1]] += sign[1:, n - 1]
    return by_coefficient.reshape(n, n * n), constant, moment, sign


def trends(samples: int, integrators: int) -> Floats:
    """Polynomials of time that a record may carry of its own; shape (samples, 1 + integrators).

    An offset, the states of the integrators, and what an input offset makes of them: a trim is never exact, and
    integrated k times it grows with the k-th power of time. Scaled to reach 1 at the end.
    """
    time = np.arange(samples) / max(samples - 1, 1)
    return np.asarray(time[:, None] ** np.arange(1 + integrators))


def carried_on(disturbance: NoiseModel, residual: Floats, dt: float, steps: int) -> Floats:
    """Predict the residual at every sample from the samples up to `steps` before it, shape (N,)."""
    alpha, beta, fade = disturbance.alpha, disturbance.beta, disturbance.fade_seconds
    # Level and slope are filtered by one denominator, and so is their sum.
    slopes = fade * (1.0 - np.exp(-steps * dt / fade)) * beta / dt
    start = residual[0]
    denominator = [1.0, alpha + beta - 2.0, 1.0 - alpha]
    ahead = lfilter([alpha + slopes, beta - alpha - slopes], denominator, residual - start)
    result = np.zeros_like(residual)
    kept = 1.0 if disturbance.memory_seconds is None else float(np.exp(-steps * dt / disturbance.memory_seconds))
    result[steps:] = kept * (start + ahead)[:-steps]
    return result


def steady_gains(index: float) -> NoiseModel:
    """Return the steady Kalman gains of a constant-velocity track for a tracking index (Kalata 1984).

    That is the disturbance's drive over one step against the noise of one measurement.
    """
    r = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
    alpha = 1.0 - r**2
    beta = 2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha)
    return NoiseModel(float(alpha), float(beta))


def fit_disturbance(residuals: Sequence[Floats], dt: float) -> NoiseModel:
    """Choose the gains and the memory that predict the training residuals best a second ahead."""
    steps = max(round(1.0 / dt), 1)
    long = [residual for residual in residuals if len(residual) > steps]
    drifting = [steady_gains(10.0**half) for half in np.arange(-3.0, 1.1, 0.5)]
    # A level without a slope suits what wanders without direction.
    wandering = [NoiseModel(candidate.alpha, 0.0) for candidate in drifting] + [NoiseModel(1.0, 0.0)]
    best, least = drifting[0], np.inf
    for candidate in (*drifting, *wandering):
        predicted = [carried_on(candidate, residual, dt, steps)[steps:] for residual in long]
        size = sum(float(p @ p) for p in predicted)
        along = sum(float(p @ r[steps:]) for p, r in zip(predicted, long, strict=True))
        # What is left of the level after the horizon, by least squares, gives the memory.
        kept = min(max(along / size, 1e-9), 1.0) if size > 0.0 else 1.0
        kept = 1.0 if kept > 0.98 else kept
        error = sum(float(r[steps:] @ r[steps:]) for r in long) - 2.0 * kept * along + kept**2 * size
        if error < (1.0 - 1e-3) * least:
            least = error
            best = replace(candidate, memory_seconds=None if kept == 1.0 else float(-steps * dt / np.log(kept)))
    return best
