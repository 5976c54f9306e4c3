"""Where own denominators start: a joint fit of shared modes is parted into channels, and each is reduced by itself.

The error surface of many transfer functions with denominators of their own is full of local minima, so that poles
scattered at random rarely lead anywhere. Three steps that each are easy go around them.

1. *Shared modes.* Every input acts on every one of many second-order sections, half as many as the model has poles,
   with numerators of their own. That sum can represent the true one, and as the sections are only a basis, which any
   other that spans the same responses replaces, Gauss-Newton steps from an even grid of frequencies reach the noise.
2. *Channels.* The part of the output that this model ascribes to one input is nearly free of noise. A transfer function
   of the order wanted, from that input to that part, is a small problem of its own, and good starts for it are known:
   the sections that carry most of the part.
3. *All together*, from the poles so found: left to the caller.

Initial states decide whether the second step works. Left free, those of many slow sections stand for part of what the
inputs did, and the channels come out wrong though their sum is right. Records are therefore taken to begin at rest as
long as that explains them.

A common denominator needs no such way: `srivc`, the simplified refined instrumental variable method for continuous time
(Young and Jakeman 1980; Garnier, Mensler and Richard 2003), finds it. The equation ``A(s) y = B(s) u + A(s) e`` is
linear in the coefficients of A and B once inputs and output have been passed through ``1 / A``. Least squares on it is
biased by the noise in the derivatives of y; instruments made of the noise-free output of the last model are not, and
with white output noise the fixed point of the iteration is the output-error estimate itself. The first filter is
``(s + b)^-n``.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lstsq

from sysid.records.experiment import Floats
from sysid.statistics.covariance import independent_samples
from sysid.transfer_functions.problem import Band, FitProblem, clip, denominators, from_poles
from sysid.transfer_functions.response import Discretised, discretise
from sysid.transfer_functions.separable import Descent, Point, descend, instruments, solve

#: Part of the output's variance below which a fit from rest explains the records.
EXPLAINED = 0.01

#: Steps of the shared modes with half of the records and then with all, and of a channel with one record and with all.
MODES_STEPS, CHANNEL_STEPS = (14, 8), (15, 10)

#: Shared modes are settled when a step lowers the cost by less than this part: they are a basis, not the answer.
MODES_SETTLED = 2e-3


@dataclass(frozen=True, slots=True)
class Separated:
    """Poles of each channel, found by itself."""

    theta: Floats  #: shape (m, n): See `sysid.transfer_functions.problem`.
    initial: float  #: Weight of the initial responses under which they were found.
    variance: float  #: Of the residual of the shared modes: what a good fit can be expected to leave.


def separate(problem: FitProblem, band: Band, rng: np.random.Generator, deadline: float) -> Iterator[Separated]:
    """Yield starts for own denominators, from one draw of the channels' sections after the other.

    Of the same shared modes. Nothing where there are too few samples for so many coefficients, integrators, or an
    output that even all these modes do not explain: by size, or because what they leave is far from white.
    """
    # A coarser grid of frequencies may leave a mode without a section near it.
    sections = max((sum(problem.orders) + 1) // 2, 8)
    if problem.integrators or not _enough(problem, sections):
        return
    for damping in (0.2, 0.1):  # the second where a grid of the first is stuck
        modes, rough = _shared_modes(problem, sections, band, damping, deadline)
        residuals = rough.point.residuals
        left = rough.point.cost / sum(map(len, residuals))
        if left > 10.0 * EXPLAINED:
            return  # nothing explains them
        # What modes leave is noise, or something else moves the craft (wind) and hides in what is ascribed to inputs.
        if independent_samples(residuals) >= 4 * sections * len(problem.group):
            break
        # So little of the output is left in a local minimum too, which another grid may pass by.
        if left > EXPLAINED:
            return
    else:
        return
    fit = descend(modes, rough.point.theta, MODES_STEPS[1], deadline, settled=MODES_SETTLED)
    parts = [_parts(part.states, fit.point, sections) for part in fit.point.parts]
    channels = [
        _channel(problem, [part[:, :, j].sum(axis=1) for part in parts], j, modes.initial)
        for j in range(len(problem.group))
    ]
    carried = [np.sqrt(sum(np.var(part[:, :, j], axis=0) for part in parts)) for j in range(len(channels))]
    variance = float(np.mean(np.concatenate(fit.point.residuals) ** 2))
    for _ in range(6):  # of 30 fits of table A1 one needed four
        theta = np.zeros((len(channels), problem.order))
        for j, channel in enumerate(channels):
            theta[j, : channel.order] = _fit_channel(channel, fit.point.theta, carried[j], band, rng, deadline)
        # The weight goes with the energy of one denominator's response: fewer of them are larger.
        yield Separated(theta, modes.initial * len(channels) / sections, variance)


def likeliest_initial(problem: FitProblem, point: Point, weakest: float) -> float:
    """Choose the weight of the initial responses under which the data are likeliest, at given poles.

    The likelihood with numerators at their best and initial states integrated out (empirical Bayes): records that begin
    at rest say so, and initial states are then not left to explain what noise or wrong poles did.
    """
    first = 1 + problem.integrators
    tried: list[tuple[float, float]] = []
    for step in range(7):
        initial = weakest * 10.0**step
        trial = solve(replace(problem, initial=initial), point.theta, point.delays)
        free = np.linalg.slogdet(trial.basis.prior[first:, first:])[1]
        surprise = problem.samples * np.log(max(trial.cost, 1e-300))
        for part in trial.parts:
            surprise += 2.0 * float(np.sum(np.log(np.diag(part.factor)))) - free
        tried.append((float(surprise), initial))
    least = min(surprise for surprise, _ in tried)
    # Where likelihoods hardly differ rest, which is simpler, is taken.
    return max(initial for surprise, initial in tried if surprise <= least + 2.0)


def _enough(problem: FitProblem, sections: int) -> bool:
    return problem.samples >= 20 * sections * len(problem.group)


def _shared_modes(
    problem: FitProblem, sections: int, band: Band, damping: float, deadline: float
) -> tuple[FitProblem, Descent]:
    """Respond to every input with every section, from rest where that explains half of the records."""
    m = len(problem.group)
    modes = replace(
        problem,
        inputs=tuple(np.tile(u, (1, sections)) for u in problem.inputs),
        group=tuple(np.repeat(np.arange(sections), m).tolist()),
        orders=(2,) * sections,
        counts=(2,) * (sections * m),
        delays=problem.delays * sections,
        longest_delay=0.0,
        ridge=1e-5,
    )
    grid = np.column_stack(
        [np.log(np.geomspace(band.lowest, band.highest, sections)), np.full(sections, np.log(damping))]
    )
    half = replace(modes, inputs=modes.inputs[::2], outputs=modes.outputs[::2])
    few = half if _enough(half, sections) else modes
    rough = replace(few, initial=100.0 * problem.initial)
    best = descend(rough, grid, MODES_STEPS[0], deadline, settled=MODES_SETTLED)
    initial = rough.initial
    if best.point.cost > EXPLAINED * few.samples and time.monotonic() < deadline:
        rough = replace(few, initial=1e-4 * problem.initial)
        moving = descend(rough, grid, MODES_STEPS[0], deadline, settled=MODES_SETTLED)
        if moving.point.cost < 0.5 * best.point.cost:
            best, initial = moving, rough.initial
    return replace(modes, initial=initial), best


def _parts(states: Floats, point: Point, sections: int) -> Floats:
    """Part of the output that passes each section from each input; shape (N, sections, m)."""
    parts = np.einsum("tkl,kl->tl", states[:, : len(point.numerators)], point.numerators)
    return np.asarray(parts.reshape(len(states), sections, -1))


def _channel(problem: FitProblem, outputs: list[Floats], j: int, initial: float) -> FitProblem:
    """Pose the problem of one input and its part of the output, scaled to unit variance."""
    size = max(float(np.sqrt(np.mean(np.concatenate([y - y.mean() for y in outputs]) ** 2))), 1e-12)
    return replace(
        problem,
        inputs=tuple(np.ascontiguousarray(u[:, [j]]) for u in problem.inputs),
        outputs=tuple(y / size for y in outputs),
        group=(0,),
        orders=problem.orders[j : j + 1],
        counts=problem.counts[j : j + 1],
        delays=problem.delays[j : j + 1],
        longest_delay=0.0,
        ridge=1e-8,
        initial=initial,
    )


def _fit_channel(
    channel: FitProblem, modes: Floats, carried: Floats, band: Band, rng: np.random.Generator, deadline: float
) -> Floats:
    """Fit one channel from several draws of sections, likelier the more they carry; shape (n,)."""
    longest = int(np.argmax([len(y) for y in channel.outputs]))
    scout = replace(channel, inputs=(channel.inputs[longest],), outputs=(channel.outputs[longest],))
    weights = carried + 1e-6 * max(float(carried.max()), 1e-12)
    best: Point | None = None
    for _ in range(8):
        drawn = modes[rng.choice(len(modes), channel.order // 2, replace=False, p=weights / weights.sum())]
        drawn[:, 1] = np.clip(drawn[:, 1], *np.log((0.01, 2.0)))
        # An odd order ends in a real pole, of which the sections tell nothing.
        single = rng.uniform(np.log(band.lowest), np.log(band.highest), channel.order % 2)
        point = descend(scout, np.concatenate([drawn.ravel(), single])[None], CHANNEL_STEPS[0], deadline).point
        if best is None or point.cost < best.cost:
            best = point
    assert best is not None
    return np.asarray(descend(channel, best.theta, CHANNEL_STEPS[1], deadline).point.theta[0])


#: Iterations at most, and the change of the logarithmic parameters at which Gauss-Newton steps do better.
MOST_ITERATIONS, NEAR = 30, 0.03


@dataclass(frozen=True, slots=True)
class Start:
    """Poles found by SRIVC."""

    theta: Floats  #: shape (1, lags): Parameters of the one denominator; see `sysid.transfer_functions.problem`.
    cost: float  #: Of the problem there.
    iterations: int
    #: False when the iteration wandered or drifted to the bounds: the start is then no better than another.
    settled: bool


def srivc(problem: FitProblem, bandwidth: float, deadline: float = np.inf) -> Start:
    """Find the common denominator of all inputs."""
    lags = problem.lags
    theta = np.zeros((1, lags))
    theta[0, : lags - lags % 2 : 2] = np.log(bandwidth)
    theta[0, lags - lags % 2 :] = np.log(bandwidth)
    theta = clip(theta, problem.band)
    best: tuple[float, Floats] = (np.inf, theta)
    change, vain = np.inf, 0
    for iteration in range(MOST_ITERATIONS):
        point = solve(problem, theta)
        vain += 1
        if point.cost < best[0]:
            best, vain = (point.cost, theta), 0
        if change < NEAR or vain == 4 or time.monotonic() > deadline:
            return Start(best[1], best[0], iteration, change < NEAR)
        refined = refine(problem, point, noisy=iteration == 0)
        if refined is None:
            return Start(best[1], best[0], iteration, False)
        following = clip(refined[None], problem.band)
        change = float(np.max(np.abs(following - theta)))
        theta = following
    return Start(best[1], best[0], MOST_ITERATIONS, False)


def refine(problem: FitProblem, point: Point, *, noisy: bool) -> Floats | None:
    """Iterate once: the coefficients of A by instrumental variables, shape (lags,)."""
    lags, shared = problem.lags, point.numerators.size
    system = _without_integrators(problem, point)
    size = shared + 2 * lags + 1
    total = np.zeros((size, size))
    made = (None,) * len(point.parts) if noisy else instruments(problem, point)
    for part, instrument in zip(point.parts, made, strict=True):
        z, gram, locals_ = part.regressors, part.gram, len(part.local)
        derivatives = _derivatives(system, z[:, -1])
        clean = derivatives[:, :-1] if instrument is None else instrument
        more = np.hstack([clean, derivatives])
        across = z[:, :-1].T @ more
        product = np.block([[gram[:-1, :-1], across], [across.T, more.T @ more]])
        product[:locals_, :locals_] += point.basis.prior
        coupling = np.linalg.solve(product[:locals_, :locals_], product[:locals_, locals_:])
        total += product[locals_:, locals_:] - product[locals_:, :locals_] @ coupling
    numerators = total[:shared, :shared] + point.penalty
    if not (np.isfinite(total).all() and np.isfinite(numerators).all() and (np.diag(numerators) > 0.0).all()):
        return None
    scale = 1.0 / np.sqrt(np.diag(numerators))
    inverse = lstsq(numerators * scale * scale[:, None], total[:shared, shared:] * scale[:, None])[0]
    rest = total[shared:, shared:] - (total[shared:, :shared] * scale) @ inverse
    matrix, rhs = rest[:lags, lags:-1], rest[:lags, -1]
    rows = 1.0 / np.maximum(np.abs(matrix).max(axis=1), 1e-300)
    normalised = -lstsq(matrix * rows[:, None], rhs * rows)[0]
    unit = float(system.unit[0])
    return from_poles(unit * np.roots(np.concatenate([[1.0], normalised[::-1]])).astype(np.complex128))


def _without_integrators(problem: FitProblem, point: Point) -> Discretised:
    """Discretise the denominator for signals that are straight between samples."""
    if problem.integrators == 0:
        return replace(point.system, hold="foh")
    return discretise(denominators(point.theta)[0], problem.dt, "foh")


def _derivatives(system: Discretised, y: Floats) -> Floats:
    """Pass the output through 1 / A: derivatives 0 to n in normalised time; shape (N, n + 1)."""
    states = system.forced(y[:, None], [0])[:, :, 0]
    return np.column_stack([states, y - states @ system.a[0]])
