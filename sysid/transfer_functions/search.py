"""From no knowledge of the poles to the best fit: starts, regularisation chosen by held-out data, refinement."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.records.experiment import Floats
from sysid.transfer_functions.problem import Band, FitProblem, take
from sysid.transfer_functions.separable import Descent, Point, descend, solve
from sysid.transfer_functions.starts import likeliest_initial, separate, srivc
from sysid.transfer_functions.uncertainty import RIDGES, Division, choose_ridge, divide, effective_parameters

#: Steps for comparing starts, and steps at most for the one that is followed to the end: sixty predicted 108 held-out
#: outputs of 37 flights no better than twenty (free run +0.5 ± 0.6 %), nor did the records of table A1 need more.
SCOUT_STEPS, MOST_STEPS = 10, 20

#: Steps of every start; then the better half goes on to SCOUT_STEPS.
FIRST_STEPS = 4

#: Separated channels are good where they leave at most this many times the variance that shared modes leave.
WORTHWHILE = 1.1

#: Regularisation is not looked for where the errors of the parameters cost less than this part of the squared residual:
#: it could not win more than that whole cost.
COSTLY = 0.01

#: Called with a stage in words and the part done so far, 0 to 1.
Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Plan:
    """How to search."""

    own: bool  #: A denominator for each input, not one for all.
    orders: tuple[int, ...]  #: shape (m,): Poles of each input's denominator, integrators included.
    ridge: float | None  #: Regularisation; None chooses it.
    starts: int  #: Sets of poles to start from where SRIVC alone does not tell.
    independent: int  #: How many independent signals the inputs are.


@dataclass(frozen=True, slots=True)
class Found:
    """The end of a search."""

    problem: FitProblem  #: With the regularisation chosen.
    descent: Descent
    steps: int  #: Iterations of all kinds together.


def expected_energy(duration: float, groups: int) -> float:
    """Energy expected of the initial response of each denominator, in variances of the output times s."""
    # Records begin near hover, a fifth of the output's standard deviation away, which a twentieth of them forgets. Own
    # denominators have n initial states for every input; left free, they explain a record without its inputs.
    return 0.2**2 * 0.05 * duration / groups


def search(
    common: FitProblem,
    plan: Plan,
    rng: np.random.Generator,
    deadline: float,
    report: Progress,
) -> Found:
    """Find starts and regularisation without the flight time held back, then fit to all of it."""
    own = plan.own and len(common.group) > 1
    steps, by_channel = 0, None
    few = portion(common, max(40 * _coefficients(common, plan), 2000))  # where starts and regularisation are looked for
    # What inputs that always move together did cannot be told apart by any start.
    if own and plan.independent >= len(common.group):
        report("own denominators, channel by channel", 0.0)
        # Shared modes have more coefficients.
        some = portion(common, 4 * few.samples)
        by_channel, good = _from_channels(some, plan, rng, deadline)
        if by_channel is not None and good:
            return by_channel if some is common else _on_all(by_channel, common, deadline)
        steps = by_channel.steps if by_channel is not None else 0
    division = divide(few) if plan.ridge is None else Division(few, None)
    report("start", 0.1)
    weakest = RIDGES[0] if plan.ridge is None and not own else division.seen.ridge
    best, more = _common_start(replace(division.seen, ridge=weakest), plan, rng, deadline)
    steps += more
    # Each parameter costs one residual variance where residuals are white, and more where they are coloured.
    if plan.ridge is None and not own and _coefficients(common, plan) < COSTLY * common.samples:
        report("first fit", 0.3)
        free = replace(few, ridge=weakest, initial=_initial(common, 1, best.point), delays=_delays(best.point))
        first = descend(free, best.point.theta, MOST_STEPS, deadline)
        steps += first.iterations
        # Regularisation cannot win more than the whole of what the parameters' errors cost.
        if effective_parameters(free, first.point) < COSTLY * common.samples:
            solution = Found(free, first, steps)
            return solution if few is common else _on_all(solution, common, deadline)
    seen = replace(division.seen, delays=_delays(best.point))
    if own:
        seen = _with_own(seen, plan)
        thetas = own_starts(seen, best.point.theta[0], plan.starts, rng)
        if by_channel is not None:
            thetas.append(by_channel.descent.point.theta)
        best, more = _best_of(seen, thetas, deadline, report)
        steps += more
    seen = replace(seen, initial=_initial(common, seen.groups, best.point), delays=_delays(best.point))
    theta, delays = best.point.theta, best.point.delays
    if plan.ridge is None:
        report("regularisation", 0.5)
        chosen = choose_ridge(replace(division, seen=seen), theta, delays, deadline)
        seen, theta, delays = replace(seen, ridge=chosen.ridge), chosen.theta, chosen.delays
        steps += chosen.steps
    report("refinement", 0.9)
    problem = _with_all(seen, common)
    # Of an output that its inputs do not explain there is nothing to refine: over 14 flights free runs held out were by
    # 0.3 ± 0.3 % better than with all steps.
    most = FIRST_STEPS if problem.ridge == RIDGES[-1] else MOST_STEPS
    descent = descend(problem, theta, most, deadline, delays)
    return Found(problem, descent, steps + descent.iterations)


def _with_all(problem: FitProblem, common: FitProblem) -> FitProblem:
    """Pose a problem for all records."""
    return replace(problem, inputs=common.inputs, outputs=common.outputs)


def _on_all(solution: Found, common: FitProblem, deadline: float) -> Found:
    """Go on with all records from what was found with some of them."""
    problem, point = _with_all(solution.problem, common), solution.descent.point
    descent = descend(problem, point.theta, MOST_STEPS, deadline, point.delays)
    return Found(problem, descent, solution.steps + descent.iterations)


def portion(problem: FitProblem, samples: int) -> FitProblem:
    """Keep about so many samples where there are more than twice as many: records spread over all, or their beginnings.

    Where poles lie, records tell long before they have told how strongly: a search over all of them finds no better
    start, it only takes longer.
    """
    if problem.samples <= 2 * samples:
        return problem
    lengths = problem.lengths
    count = max(round(samples * len(lengths) / sum(lengths)), 1)
    chosen = np.linspace(0, len(lengths) - 1, count + 2)[1:-1].round().astype(int)
    most = max(samples // count, samples // 2)
    return replace(
        problem,
        inputs=tuple(problem.inputs[r][:most] for r in chosen),
        outputs=tuple(problem.outputs[r][:most] for r in chosen),
    )


def _coefficients(common: FitProblem, plan: Plan) -> int:
    poles = sum(plan.orders) if plan.own else common.order
    return int(common.used.sum()) + poles


def _from_channels(
    common: FitProblem, plan: Plan, rng: np.random.Generator, deadline: float
) -> tuple[Found | None, bool]:
    """Fit own denominators from channels that were fitted each by itself; None where the data are too few for that.

    Also whether no more is left than the modes shared by all channels leave. The data are then many, and explained:
    other starts and regularisation could win nothing.
    """
    # Next to no regularisation: the noise may be as little as a millionth of the output's variance, and initial states
    # would make up for what a ridge takes away.
    problem = _with_own(replace(common, ridge=1e-10 if plan.ridge is None else plan.ridge), plan)
    now = time.monotonic()
    limit = now + 0.7 * (deadline - now)
    best: tuple[Descent, float] | None = None
    steps = 0
    for separated in () if problem.delay_parameters else separate(problem, _starting_band(problem), rng, limit):
        problem = replace(problem, initial=separated.initial)
        descent = descend(problem, separated.theta, MOST_STEPS, limit)
        steps += descent.iterations
        if best is None or descent.point.cost < best[0].point.cost:
            best = descent, separated.variance
        # At poles that are wrong initial states would be freed to make up for them, and the fit end there.
        if _left(best[0]) < WORTHWHILE * separated.variance or time.monotonic() > limit:
            break
    if best is None:
        return None, False
    descent, expected = best
    for _ in range(4):
        weakest = _initial(common, problem.groups, descent.point)
        initial = likeliest_initial(problem, descent.point, weakest)
        # The variance of the residual moves the candidates a little: that alone is no reason to go on.
        if abs(np.log(initial / problem.initial)) < 1.0 or time.monotonic() > limit:
            break
        problem = replace(problem, initial=initial)
        descent = descend(problem, descent.point.theta, MOST_STEPS, limit)
        steps += descent.iterations
    return Found(problem, descent, steps), _left(descent) < WORTHWHILE * expected


def _left(descent: Descent) -> float:
    """Variance of the residuals."""
    return float(np.mean(np.concatenate(descent.point.residuals) ** 2))


def own_starts(problem: FitProblem, common: Floats, starts: int, rng: np.random.Generator) -> list[Floats]:
    """Poles from which to start own denominators: around the common one, and scattered, shape (groups, lags)."""
    near = np.zeros((problem.groups, problem.lags))
    for g, lags in enumerate(problem.lag_orders):
        near[g, :lags] = (common if lags == len(common) else take(common, lags)) + 0.1 * rng.standard_normal(lags)
    return [near, *(scattered(problem, rng, attempt) for attempt in range(max(starts, 1) - 1))]


def scattered(problem: FitProblem, rng: np.random.Generator, attempt: int) -> Floats:
    """Sections spread over the band; the first attempt evenly, later ones at random, shape (groups, lags)."""
    band, groups = _starting_band(problem), problem.groups
    theta = np.zeros((groups, problem.lags))
    low, high = np.log(band.lowest), np.log(band.highest)
    for g, order in enumerate(problem.lag_orders):
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


def _common_start(problem: FitProblem, plan: Plan, rng: np.random.Generator, deadline: float) -> tuple[Descent, int]:
    """SRIVC from one bandwidth after the other until it settles; where it never does, scattered starts beside it."""
    if problem.lags == 0:
        return Descent(solve(problem, np.zeros((1, 0))), 0, True), 0
    band, steps = _starting_band(problem), 0
    middle, reach = np.sqrt(band.lowest * band.highest), np.sqrt(np.sqrt(band.highest / band.lowest))
    # Of own denominators this is one start of several, not the answer: scattered ones did no better in 37 searches.
    own = plan.own and len(plan.orders) > 1
    bandwidths, attempts = ((middle,), 0) if own else ((middle, middle * reach, middle / reach), plan.starts)
    thetas: list[tuple[float, Floats, Floats]] = []
    for delays in _tried_delays(problem):
        shifted = replace(problem, delays=tuple(delays))
        for bandwidth in bandwidths:
            start = srivc(shifted, float(bandwidth), deadline)
            steps += start.iterations
            thetas.append((start.cost, start.theta, delays))
            if start.settled or time.monotonic() > deadline:
                break
        else:
            thetas += [(np.inf, scattered(problem, rng, attempt), delays) for attempt in range(attempts)]
        if time.monotonic() > deadline:
            break
    thetas.sort(key=lambda one: one[0])
    settled = [one for one in thetas if np.isfinite(one[0])][:1]  # of what SRIVC found, the cheapest only
    first: list[Descent] = []
    for _, theta, delays in [*settled, *(one for one in thetas if not np.isfinite(one[0]))]:
        delays = _coordinate_delays(problem, theta, delays) if problem.delay_parameters else delays
        first.append(descend(problem, theta, FIRST_STEPS, deadline, delays, hopeless=_hopeless(first)))
        if time.monotonic() > deadline:
            break
    best, more = _better_half(problem, first, deadline)
    return best, steps + more


def _tried_delays(problem: FitProblem) -> list[Floats]:
    if not problem.delay_parameters:
        return [problem.start_delays]
    count = min(round(problem.longest_delay / problem.dt) + 1, 9)
    lanes = np.ones(len(problem.group))
    return [delay * lanes for delay in np.linspace(0.0, problem.longest_delay, max(count, 2))]


def _coordinate_delays(problem: FitProblem, theta: Floats, delays: Floats) -> Floats:
    """Choose for every input in turn the best of the delays tried."""
    delays = delays.copy()
    if len(delays) == 1:
        return delays
    tried = [float(choices[0]) for choices in _tried_delays(problem)]
    for lane in range(len(delays)):
        costs = []
        for delay in tried:
            delays[lane] = delay
            costs.append(solve(problem, theta, delays.copy()).cost)
        delays[lane] = tried[int(np.argmin(costs))]
    return delays


def _best_of(problem: FitProblem, thetas: Sequence[Floats], deadline: float, report: Progress) -> tuple[Descent, int]:
    """Follow every start for a few steps and the better half of them for more."""
    first: list[Descent] = []
    for number, theta in enumerate(thetas):
        report(f"own denominators, start {number + 1} of {len(thetas)}", 0.2 + 0.2 * number / len(thetas))
        first.append(descend(problem, theta, FIRST_STEPS, deadline, hopeless=_hopeless(first)))
        if time.monotonic() > deadline:
            break
    report(f"own denominators, the better half of {len(first)} starts", 0.4)
    return _better_half(problem, first, deadline)


def _hopeless(others: Sequence[Descent]) -> float:
    """Return the cost from which on a start will not win against others."""
    return 10.0 * min((descent.point.cost for descent in others), default=np.inf)


def _better_half(problem: FitProblem, first: Sequence[Descent], deadline: float) -> tuple[Descent, int]:
    """Follow the better half of descents for more steps where they may win; the best of them, and the steps of all."""
    ranked = sorted(first, key=lambda descent: descent.point.cost)
    best, steps = ranked[0], sum(descent.iterations for descent in first)
    for descent in ranked[: (len(ranked) + 1) // 2]:
        # Of 107 searches on 11 flights one that was farther behind won twice, by 16 and 40 % of the cost where the
        # refinement starts.
        if time.monotonic() > deadline or descent.point.cost > 4.0 * ranked[0].point.cost:
            break
        if not descent.converged:
            descent = descend(problem, descent.point, SCOUT_STEPS - FIRST_STEPS, deadline)
            steps += descent.iterations
        if descent.point.cost < best.point.cost:
            best = descent
    return best, steps


def _with_own(problem: FitProblem, plan: Plan) -> FitProblem:
    """Return every input a denominator of its own, of its own order."""
    return replace(
        problem,
        group=tuple(range(len(problem.group))),
        orders=plan.orders,
        initial=problem.initial * len(problem.group),
    )


def _initial(whole: FitProblem, groups: int, point: Point) -> float:
    variance = max(float(np.mean(np.concatenate(point.residuals) ** 2)), 1e-12)
    return variance / expected_energy(max(len(y) for y in whole.outputs) * whole.dt, groups)


def _delays(point: Point) -> tuple[float, ...]:
    return tuple(map(float, point.delays)) if point.delays.any() else ()


def _starting_band(problem: FitProblem) -> Band:
    """Where poles that matter are to be expected: a few periods in the record, a few samples in a period."""
    longest = max(len(y) for y in problem.outputs) * problem.dt
    return Band(2.0 * np.pi / longest, max(0.5 * np.pi / problem.dt, 4.0 * np.pi / longest))
