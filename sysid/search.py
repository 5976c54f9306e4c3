"""From no knowledge of the poles to the best fit: starts, regularisation chosen by held-out data, refinement."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.experiment import Floats
from sysid.regularisation import RIDGES, Division, choose_ridge, divide
from sysid.sections import Band, take
from sysid.separable import Descent, Point, Problem, descend, solve
from sysid.srivc import srivc
from sysid.starts import likeliest_initial, separate
from sysid.uncertainty import effective_parameters

#: Prior size of the response to the initial state, in standard deviations of the output: records begin near hover. Own
#: denominators have n initial states for every input; left free, they explain a record without its inputs.
INITIAL_SIZE = 0.2

#: Part of a record for which the response to the initial state is expected to last.
INITIAL_PART = 0.05

#: Residual assumed before the first fit, in standard deviations of the output.
FIRST_RESIDUAL = 0.1

#: Steps for comparing starts, and steps at most for the one that is followed to the end.
SCOUT_STEPS, MOST_STEPS = 10, 60

#: Steps of every start of own denominators; then the better half goes on to SCOUT_STEPS.
FIRST_STEPS = 4

#: Rounds of steps from separated channels, each followed by the choice of the initial responses' weight.
SETTLING = 5

#: Regularisation of own denominators that many data determine. Relative to the information in the data, the noise may
#: be as little as a millionth of the output's variance, and initial states would make up for what a ridge takes away.
NEXT_TO_NONE = 1e-10

#: Part of the time that may be spent on separated channels.
CHANNELS_PART = 0.7

#: Separated channels are good where they leave at most this many times the variance that shared modes leave.
WORTHWHILE = 1.1

#: Regularisation is not looked for where the errors of the parameters cost less than this part of the squared residual:
#: it could not win more than that whole cost.
COSTLY = 0.01

#: Delays that are tried at first when they are to be estimated, spread evenly from none to the longest.
MOST_TRIED_DELAYS = 9

#: Called with a stage in words and the part done so far, 0 to 1.
Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Plan:
    """How to search.

    Attributes
    ----------
    own : bool
        A denominator for each input, not one for all.
    orders : tuple of int, shape (m,)
        Poles of each input's denominator, integrators included.
    ridge : float or None
        Regularisation; None chooses it.
    starts : int
        Sets of poles to start from where SRIVC alone does not tell.
    seed : int
    """

    own: bool
    orders: tuple[int, ...]
    ridge: float | None
    starts: int
    seed: int


@dataclass(frozen=True, slots=True)
class Found:
    """The end of a search.

    Attributes
    ----------
    problem : Problem
        With the regularisation chosen.
    descent : Descent
    steps : int
        Iterations of all kinds together.
    """

    problem: Problem
    descent: Descent
    steps: int


def expected_energy(duration: float, groups: int) -> float:
    """Energy expected of the initial response of each denominator, in variances of the output times s."""
    return INITIAL_SIZE**2 * INITIAL_PART * duration / groups


def search(common: Problem, plan: Plan, rng: np.random.Generator, deadline: float, report: Progress) -> Found:
    """Find starts and regularisation without the flight time held back, then fit to all of it.

    Parameters
    ----------
    common : Problem
        With one denominator for all inputs.
    plan : Plan
    rng : Generator
        Of the scattered starts.
    deadline : float
        On `time.monotonic`.
    report : callable
    """
    own = plan.own and len(common.group) > 1
    steps, by_channel = 0, None
    if own:
        report("own denominators, channel by channel", 0.0)
        by_channel, good = _from_channels(common, plan, rng, deadline)
        if by_channel is not None and good:
            return by_channel
        steps = by_channel.steps if by_channel is not None else 0
    if plan.ridge is not None:
        division = Division(common, ())
    else:
        if not own:
            report("first fit", 0.0)
            first = _fit_all(replace(common, ridge=RIDGES[0]), plan, rng, deadline)
            # Regularisation cannot win more than the whole of what the parameters' errors cost.
            if effective_parameters(first.problem, first.descent.point) < COSTLY * common.samples:
                return first
            steps = first.steps
        division = divide(common)
    report("start", 0.1)
    best, more = _common_start(division.seen, plan, rng, deadline)
    steps += more
    seen = replace(division.seen, delays=_delays(best.point))
    if own:
        seen = _with_own(seen, plan)
        thetas = own_starts(seen, best.point.theta[0], plan.starts, rng)
        if by_channel is not None:
            thetas.append(by_channel.descent.point.theta)
        best, more = _best_of(seen, thetas, deadline, report)
        steps += more
    seen = replace(seen, initial=_initial(common, seen.groups, best.point), delays=_delays(best.point))
    problem = replace(seen, inputs=common.inputs, outputs=common.outputs)
    theta, delays = best.point.theta, best.point.delays
    if plan.ridge is None:
        report("regularisation", 0.5)
        ridge, theta, delays = choose_ridge(replace(division, seen=seen), theta, delays, deadline)
        problem = replace(problem, ridge=ridge)
    report("refinement", 0.9)
    descent = descend(problem, theta, MOST_STEPS, deadline, delays)
    return Found(problem, descent, steps + descent.iterations)


def _from_channels(common: Problem, plan: Plan, rng: np.random.Generator, deadline: float) -> tuple[Found | None, bool]:
    """Fit own denominators from channels that were fitted each by itself; None where the data are too few for that.

    Also whether no more is left than the modes shared by all channels leave. The data are then many, and explained:
    other starts and regularisation could win nothing.
    """
    problem = _with_own(replace(common, ridge=NEXT_TO_NONE if plan.ridge is None else plan.ridge), plan)
    now = time.monotonic()
    limit = now + CHANNELS_PART * (deadline - now)
    separated = None if problem.delay_parameters else separate(problem, _starting_band(problem), rng, limit)
    if separated is None:
        return None, False
    problem, theta, steps = replace(problem, initial=separated.initial), separated.theta, 0
    for _ in range(SETTLING):
        descent = descend(problem, theta, MOST_STEPS, limit)
        theta, steps = descent.point.theta, steps + descent.iterations
        weakest = _initial(common, problem.groups, descent.point)
        initial = likeliest_initial(problem, descent.point, weakest)
        # The variance of the residual moves the candidates a little: that alone is no reason to go on.
        if abs(np.log(initial / problem.initial)) < 1.0 or time.monotonic() > limit:
            break
        problem = replace(problem, initial=initial)
    variance = float(np.mean(np.concatenate(descent.point.residuals) ** 2))
    return Found(problem, descent, steps), variance < WORTHWHILE * separated.variance


def own_starts(problem: Problem, common: Floats, starts: int, rng: np.random.Generator) -> list[Floats]:
    """Poles from which to start own denominators: around the common one, and scattered.

    Parameters
    ----------
    problem : Problem
        With own denominators.
    common : ndarray, shape (lags,)
        The best common denominator.
    starts : int
    rng : Generator

    Returns
    -------
    list of ndarray, shape (groups, lags)
    """
    near = np.zeros((problem.groups, problem.lags))
    for g, order in enumerate(problem.all_orders):
        lags = order - problem.integrators
        near[g, :lags] = (common if lags == len(common) else take(common, lags)) + 0.1 * rng.standard_normal(lags)
    return [near, *(scattered(problem, rng, attempt) for attempt in range(max(starts, 1) - 1))]


def scattered(problem: Problem, rng: np.random.Generator, attempt: int) -> Floats:
    """Sections spread over the band; the first attempt evenly, later ones at random."""
    band, groups = _starting_band(problem), problem.groups
    theta = np.zeros((groups, problem.lags))
    low, high = np.log(band.lowest), np.log(band.highest)
    for g, whole in enumerate(problem.all_orders):
        order = whole - problem.integrators
        sections = (order + 1) // 2
        if attempt == 0:
            w = low + (high - low) * (np.arange(sections) + 0.5 + 0.5 * (g / groups - 0.5)) / max(sections, 1)
            zeta = np.full(sections, np.log(0.5))
        else:
            w, zeta = rng.uniform(low, high, sections), rng.uniform(np.log(0.05), np.log(1.5), sections)
        interleaved = np.column_stack([w, zeta]).ravel()
        # An odd order ends in a first-order section: the slowest frequency is its pole.
        theta[g, :order] = np.concatenate([interleaved[2:], w[:1]]) if order % 2 else interleaved
    return theta


def _fit_all(problem: Problem, plan: Plan, rng: np.random.Generator, deadline: float) -> Found:
    """Fit one denominator to all records; the prior of the initial states is weighed by the residual reached."""
    start, steps = _common_start(problem, plan, rng, deadline)
    problem = replace(problem, initial=_initial(problem, 1, start.point), delays=_delays(start.point))
    descent = descend(problem, start.point.theta, MOST_STEPS, deadline)
    return Found(problem, descent, steps + descent.iterations)


def _common_start(problem: Problem, plan: Plan, rng: np.random.Generator, deadline: float) -> tuple[Descent, int]:
    """SRIVC from one bandwidth after the other until it settles; where it never does, scattered starts beside it."""
    if problem.lags == 0:
        return Descent(solve(problem, np.zeros((1, 0))), 0, True), 0
    band, steps = _starting_band(problem), 0
    middle, reach = np.sqrt(band.lowest * band.highest), np.sqrt(np.sqrt(band.highest / band.lowest))
    thetas: list[tuple[float, Floats, Floats]] = []
    for delays in _tried_delays(problem):
        shifted = replace(problem, delays=tuple(delays))
        for bandwidth in (middle, middle * reach, middle / reach):
            start = srivc(shifted, float(bandwidth), deadline)
            steps += start.iterations
            thetas.append((start.cost, start.theta, delays))
            if start.settled or time.monotonic() > deadline:
                break
        else:
            thetas += [(np.inf, scattered(problem, rng, attempt), delays) for attempt in range(plan.starts)]
        if time.monotonic() > deadline:
            break
    thetas.sort(key=lambda one: one[0])
    best: Descent | None = None
    for cost, theta, delays in thetas:
        if best is not None and np.isfinite(cost):
            continue  # of what SRIVC found, the cheapest only
        delays = _coordinate_delays(problem, theta, delays) if problem.delay_parameters else delays
        descent = descend(problem, theta, SCOUT_STEPS, deadline, delays)
        steps += descent.iterations
        if best is None or descent.point.cost < best.point.cost:
            best = descent
        if time.monotonic() > deadline:
            break
    assert best is not None
    return best, steps


def _tried_delays(problem: Problem) -> list[Floats]:
    if not problem.delay_parameters:
        return [problem.start_delays]
    count = min(round(problem.longest_delay / problem.dt) + 1, MOST_TRIED_DELAYS)
    lanes = np.ones(len(problem.group))
    return [delay * lanes for delay in np.linspace(0.0, problem.longest_delay, max(count, 2))]


def _coordinate_delays(problem: Problem, theta: Floats, delays: Floats) -> Floats:
    """Let every input in turn have the delay among the tried ones that suits it best."""
    delays = delays.copy()
    if len(delays) == 1:
        return delays
    tried = [float(each[0]) for each in _tried_delays(problem)]
    for lane in range(len(delays)):
        costs = []
        for delay in tried:
            delays[lane] = delay
            costs.append(solve(problem, theta, delays.copy()).cost)
        delays[lane] = tried[int(np.argmin(costs))]
    return delays


def _best_of(problem: Problem, thetas: Sequence[Floats], deadline: float, report: Progress) -> tuple[Descent, int]:
    """Follow every start for a few steps and the better half of them for more."""
    steps = 0
    first: list[Descent] = []
    for number, theta in enumerate(thetas):
        report(f"own denominators, start {number + 1} of {len(thetas)}", 0.2 + 0.2 * number / len(thetas))
        first.append(descend(problem, theta, FIRST_STEPS, deadline))
        if time.monotonic() > deadline:
            break
    first.sort(key=lambda descent: descent.point.cost)
    better = first[: (len(first) + 1) // 2]
    best = better[0]
    for number, descent in enumerate(better):
        report(f"own denominators, the better {len(better)} starts", 0.4 + 0.1 * number / len(better))
        if time.monotonic() > deadline:
            break
        if not descent.converged:
            descent = descend(problem, descent.point.theta, SCOUT_STEPS - FIRST_STEPS, deadline)
            steps += descent.iterations
        if descent.point.cost < best.point.cost:
            best = descent
    return best, steps + sum(descent.iterations for descent in first)


def _with_own(problem: Problem, plan: Plan) -> Problem:
    """Give every input a denominator of its own, of its own order."""
    alike = set(plan.orders) == {problem.order}
    return replace(
        problem,
        group=tuple(range(len(problem.group))),
        orders=() if alike else plan.orders,
        initial=problem.initial * len(problem.group),
    )


def _initial(whole: Problem, groups: int, point: Point) -> float:
    variance = max(float(np.mean(np.concatenate(point.residuals) ** 2)), 1e-12)
    return variance / expected_energy(max(len(y) for y in whole.outputs) * whole.dt, groups)


def _delays(point: Point) -> tuple[float, ...]:
    return tuple(map(float, point.delays)) if point.delays.any() else ()


def _starting_band(problem: Problem) -> Band:
    """Where poles that matter are to be expected: a few periods in the record, a few samples in a period."""
    longest = max(len(y) for y in problem.outputs) * problem.dt
    return Band(2.0 * np.pi / longest, max(0.5 * np.pi / problem.dt, 4.0 * np.pi / longest))
