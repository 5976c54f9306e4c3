"""Exact responses of continuous-time denominators to sampled inputs, and of whole transfer functions.

A denominator of order n enters as ``a``, shape (n,), ascending powers without the leading 1:
``A(s) = s^n + a[n-1] s^(n-1) + ... + a[0]``. Inside, every denominator has its own unit of frequency, the geometric
mean ``w = a[0]^(1/n)`` of its poles, so that ``s = w p`` and the normalised states ``p^k / A(p) u`` are of like size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from sysid._kernels import recur, recur_few
from sysid.experiment import Floats

#: With fewer channels than this the states, not the channels, are worth being vector lanes.
FEW = 4

#: Time at the start of a record over which a free run may look at the outputs to find its initial state, s.
INITIAL_SECONDS = 3.0


@dataclass(frozen=True, slots=True)
class Discretised:
    """States ``p^k / A`` (k < n) and ``p^k / A^2`` of several denominators, exactly discretised.

    Attributes
    ----------
    unit : ndarray, shape (groups,)
        w, the unit of frequency, rad/s.
    a : ndarray, shape (groups, n)
        Normalised coefficients ``a[k] / w^(n-k)``.
    gramians : ndarray, shape (groups, n, n)
        Inner products of the impulse responses of the states ``p^k / A``, in normalised time.
    transition : ndarray, shape (groups, 2 n, 2 n)
    from_now, from_next : ndarray, shape (groups, 2 n)
    """

    unit: Floats
    a: Floats
    gramians: Floats
    transition: Floats
    from_now: Floats
    from_next: Floats

    @property
    def order(self) -> int:
        """Order n of the denominators."""
        return int(self.a.shape[1])

    def first(self) -> Discretised:
        """Keep the first denominator only."""
        return Discretised(
            self.unit[:1], self.a[:1], self.gramians[:1], self.transition[:1], self.from_now[:1], self.from_next[:1]
        )

    def initial_precision(self) -> Floats:
        """Precision of the initial responses' coefficients, power-major, when each is expected to have unit energy.

        Energy is the integral of the squared response over time in seconds; expected is a chi-square with n degrees of
        freedom, so that a long-lived response is as unlikely as a strong one.
        """
        groups, n = self.a.shape
        precision = np.zeros((n, groups, n, groups))
        scaled = n * self.gramians / self.unit[:, None, None]
        for g in range(groups):
            precision[:, g, :, g] = scaled[g]
        return precision.reshape(n * groups, n * groups)

    def forced(self, inputs: Floats, group: Sequence[int], sensitivities: bool = True) -> Floats:
        """Respond to inputs from rest.

        Parameters
        ----------
        inputs : ndarray, shape (N, lanes)
        group : sequence of int, shape (lanes,)
            Which denominator each input passes.
        sensitivities : bool
            Also the states over A^2.

        Returns
        -------
        ndarray, shape (N, 2 n, lanes), or (N, n, lanes) without sensitivities
        """
        return self._run(inputs, group, np.zeros((2 * self.order, len(group))), sensitivities)

    def free(self, samples: int, sensitivities: bool = True) -> Floats:
        """Respond to a unit impulse just before the first sample: the shapes that initial states can give.

        Returns
        -------
        ndarray, shape (samples, 2 n, groups), or (samples, n, groups)
        """
        groups = len(self.unit)
        start = np.zeros((2 * self.order, groups))
        start[self.order - 1] = 1.0
        return self._run(np.zeros((samples, groups)), range(groups), start, sensitivities)

    def _run(self, inputs: Floats, group: Sequence[int], start: Floats, sensitivities: bool) -> Floats:
        lanes, q = list(group), (2 if sensitivities else 1) * self.order
        transition = self.transition[lanes, :q, :q]
        now = np.ascontiguousarray(self.from_now[lanes, :q])
        following = np.ascontiguousarray(self.from_next[lanes, :q])
        values = np.ascontiguousarray(inputs)
        if len(lanes) < FEW:
            transposed = np.ascontiguousarray(transition.transpose(0, 2, 1))
            return np.asarray(recur_few(transposed, now, following, np.ascontiguousarray(start[:q].T), values))
        return np.asarray(
            recur(
                np.ascontiguousarray(transition.transpose(1, 2, 0)),
                np.ascontiguousarray(now.T),
                np.ascontiguousarray(following.T),
                np.ascontiguousarray(start[:q]),
                values,
                self.order,
            )
        )


def discretise(a: Floats, dt: float, hold: str) -> Discretised:
    """Discretise companion forms and their sensitivities by one matrix exponential each (Van Loan 1978).

    Parameters
    ----------
    a : ndarray, shape (groups, n)
        Denominators, ascending powers.
    dt : float
        s.
    hold : {"zoh", "foh"}
    """
    groups, n = a.shape
    unit = a[:, 0] ** (1.0 / n)
    normalised = a / unit[:, None] ** np.arange(n, 0, -1)
    size = 2 * n + (1 if hold == "zoh" else 2)
    block = np.zeros((groups, size, size))
    for first in (0, n):
        rows = np.arange(first, first + n - 1)
        block[:, rows, rows + 1] = 1.0
        block[:, first + n - 1, first : first + n] = -normalised
    block[:, 2 * n - 1, 0] = 1.0  # the second companion is driven by 1/A u, the first state
    block[:, n - 1, 2 * n] = 1.0
    block *= (unit * dt)[:, None, None]
    if hold == "foh":
        block[:, 2 * n, 2 * n + 1] = 1.0
    exponential = np.asarray(expm(block))
    held = exponential[:, : 2 * n, 2 * n]
    ramp = exponential[:, : 2 * n, 2 * n + 1] if hold == "foh" else np.zeros_like(held)
    transition = exponential[:, : 2 * n, : 2 * n]
    return Discretised(unit, normalised, _gramians(normalised), transition, held - ramp, ramp)


def _gramians(a: Floats) -> Floats:
    """Solve ``A P + P A' + B B' = 0`` for companion forms.

    States being derivatives of one another, ``P[i, j]`` is zero for odd i + j and otherwise, but for its sign, the
    moment ``q[(i + j) / 2]`` of the first one's power spectrum: n unknowns instead of n^2.
    """
    n = a.shape[1]
    i, j = np.indices((n, n))
    sign = np.where((i + j) % 2 == 0, (-1.0) ** ((j - i) // 2), 0.0)
    moment = (i + j) // 2
    equations = np.zeros((len(a), n, n))
    rows = np.arange(n)
    for k in range(n):
        equations[:, rows, moment[:, k]] -= a[:, k, None] * sign[:, k]
    equations[:, rows[:-1], moment[1:, n - 1]] += sign[1:, n - 1]
    rhs = np.zeros((len(a), n, 1))
    rhs[:, n - 1] = -0.5
    return np.asarray(np.linalg.solve(equations, rhs)[:, moment, 0] * sign)


def numerator_to_seconds(normalised: Floats, unit: float, order: int) -> Floats:
    """Turn numerator coefficients of the normalised states (ascending) into those of powers of s (ascending)."""
    return normalised * unit ** (order - np.arange(len(normalised)))


def free_run(
    numerators: Sequence[Floats],
    denominators: Sequence[Floats],
    u: Floats,
    y: Floats,
    origin: float,
    dt: float,
    hold: str,
    *,
    shared: bool,
    sigma: float,
    initial_energy: float,
    initial: Floats | None = None,
) -> Floats:
    """Simulate one output from the inputs and an initial state, by default found in the first `INITIAL_SECONDS`.

    Parameters
    ----------
    numerators, denominators : sequence of ndarray
        Per input, highest power first, denominators of one order; a denominator ``[1]`` marks an input without effect.
    u : ndarray, shape (N, m)
        About the trim.
    y : ndarray, shape (N,)
        Only its first `INITIAL_SECONDS` are looked at, and only when `initial` is not given.
    origin : float
        Output about which the offset counts.
    dt : float
        s.
    hold : {"zoh", "foh"}
    shared : bool
        All inputs pass one denominator, so that there is one initial response only.
    sigma : float
        Standard deviation of what the model does not explain, in the output's unit.
    initial_energy : float
        Energy that the response to the initial state of one denominator is expected to have, in squared units times s.
    initial : ndarray, shape (1 + n groups,), optional
        The offset and the coefficients of the normalised initial responses, power-major.

    Returns
    -------
    ndarray, shape (N,)
    """
    samples = len(y)
    active = [j for j, den in enumerate(denominators) if len(den) > 1]
    if not active:
        return np.full(samples, origin + float(np.mean(y[: _early(samples, dt)] - origin)))
    n = len(denominators[active[0]]) - 1
    system = discretise(np.array([denominators[j][:0:-1] for j in active]), dt, hold)
    states = system.forced(u[:, active], range(len(active)), sensitivities=False)
    forced = np.full(samples, origin)
    for lane, j in enumerate(active):
        b = numerators[j][::-1] / system.unit[lane] ** (n - np.arange(len(numerators[j])))
        forced += states[:, : len(b), lane] @ b
    if shared:
        system = system.first()
    free = system.free(samples, sensitivities=False)
    shapes = np.hstack([np.ones((samples, 1)), free.reshape(samples, -1)])
    if initial is None:
        # Maximum a posteriori: the offset is free, the initial responses are as small as those of the training records.
        early = shapes[: _early(samples, dt)]
        normal = early.T @ early
        normal[1:, 1:] += sigma**2 / initial_energy * system.initial_precision()
        scale = 1.0 / np.sqrt(np.diag(normal))
        rhs = early.T @ (y - forced)[: len(early)]
        initial = scale * np.linalg.lstsq(normal * scale * scale[:, None], scale * rhs, rcond=1e-12)[0]
    return np.asarray(forced + shapes @ initial)


def _early(samples: int, dt: float) -> int:
    return min(round(INITIAL_SECONDS / dt) + 1, samples)
