"""By how much the readings of a sensor are late: the likeliest lag, near the documented one or far from it."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from estimation import _kernels
from estimation.filter import FilterSegment
from estimation.observations import Observations
from estimation.shocks import believed

#: Gain in log-likelihood that a lag other than the documented one must bring.
DECISIVE = 10.0


def nearest(ladder: Sequence[float], value: float) -> float:
    """Return the rung nearest to a positive value, by ratio."""
    return min(ladder, key=lambda rung: abs(np.log(rung / value)))


def climb(
    variant: Callable[[float], FilterSegment], ladder: Sequence[float], start: float
) -> tuple[dict[float, float], FilterSegment]:
    """Go up and down a ladder from `start` as long as it gets likelier; likelihoods by value, and the likeliest."""
    likelihoods: dict[float, float] = {}
    best: FilterSegment | None = None
    for step in (1, -1):
        k = ladder.index(start)
        while 0 <= k < len(ladder):
            value = ladder[k]
            if value not in likelihoods:
                problem = variant(value)
                likelihoods[value] = problem.log_likelihood
                if best is None or likelihoods[value] >= max(likelihoods.values()):
                    best = problem
                elif value != start:
                    break
            k += step
    assert best is not None  # start is a rung
    return likelihoods, best


#: Lags that are tried about the documented one, s: first roughly and far, then closely about the best of these.
GPS_LAGS = (-2.0, -1.5, -1.1, -0.8, -0.55, -0.36, -0.24, -0.16, -0.08, 0.0)
GPS_LAGS += tuple(-lag for lag in reversed(GPS_LAGS[:-1]))
CLOSER, CLOSER_STEPS = 0.04, 4
#: Steps about the lag of a receiver at which its likelihood is laid through a parabola, s, and the gain by which that
#: must be likelier elsewhere for half of the way there to be believed: two standard deviations.
PARABOLA, SIGNIFICANT = np.array([-0.04, -0.02, 0.0, 0.02, 0.04]), 2.0
#: Lags smaller than this are none, s.
RESOLVED = 1e-3
#: Readings so near to the ends of what is looked at do not decide on it, s; nor is it less than this share of all that
#: is looked at that does.
ENDS, ENDS_SHARE = 0.1, 0.125
#: 1-sigma of the lags that tables give, s.
LAG_KNOWN = 0.05
#: The same of compass and barometer, whose rows may be means of what they measured since the row before.
FINE_LAGS = (-1.5, -1.1, -0.8, -0.55, -0.36, -0.24, -0.16, -0.1, -0.05, 0.0)
FINE_LAGS += tuple(-lag for lag in reversed(FINE_LAGS[:-1]))
#: Those of a barometer whose driver filters heavily.
BARO_LAGS = (*FINE_LAGS, 2.0, 2.7, 3.6, 4.8, 6.4)
#: Sensors whose lag is looked for, and their kinds of measurement.
LAGGING: Mapping[str, tuple[int, ...]] = {
    "mag": (_kernels.MAG,),
    "gps": (_kernels.GPS_POSITION, _kernels.GPS_HEIGHT, _kernels.GPS_VELOCITY, _kernels.GPS_CLIMB),
    "gps2": (_kernels.GPS2_POSITION, _kernels.GPS2_VELOCITY),
    "baro": (_kernels.BARO,),
}
#: What is tried for each sensor: further lags only where none of the nearer ones is a peak, since they cost readings at
#: the ends.
LAGS: Mapping[str, tuple[tuple[float, ...], ...]] = {
    "mag": (FINE_LAGS,),
    "gps": (GPS_LAGS,),
    "gps2": (GPS_LAGS,),
    "baro": (FINE_LAGS, BARO_LAGS),
}
#: Further lags from which the climb begins as well: what flies to and fro is likely again half a turn off. Filters
#: delay, so that none makes a barometer early; a receiver is where its tables take off too much.
FAR_LAGS: Mapping[str, tuple[float, ...]] = {
    "mag": (-1.1, -0.36, 0.36, 1.1),
    "gps": (-1.1, -0.36, 0.36, 1.1),
    "gps2": (-1.1, -0.36, 0.36, 1.1),
    "baro": (0.36, 1.1),
}
#: Sensors whose clock a barometer does not know.
RECEIVERS = frozenset({"gps", "gps2"})


def _compared(
    observations: Observations, kinds: tuple[int, ...], span: tuple[float, float], farthest: float
) -> Observations:
    """Return the readings that stay in the `span` that is looked at under any lag of some kinds up to the farthest.

    Likelihoods compare only if they are of the same readings: a fix that a lag moves out of the span is worth some 18,
    and left the lag 10 to 50 ms off, in which a craft that climbs is as far beside the truth.
    """
    reach = min(farthest + ENDS, ENDS_SHARE * (span[1] - span[0]))
    return observations.within(kinds, span[0] + reach, span[1] - reach)


def find_lag(
    observations: Observations,
    sensor: str,
    span: tuple[float, float],
    lay_out: Callable[[Observations], FilterSegment],
    least: float,
    far: Sequence[float],
) -> float:
    """Find the lag of one sensor; 0 where it is smaller than `least`, s. Climbs begin at none and at those `far` off.

    Tables know the lag to some hundredths of a second, so a small one is an estimate like any other; one far off must
    be decisively likelier.
    """
    kinds = LAGGING[sensor]

    def at(lag: float, readings: Observations) -> FilterSegment:
        return lay_out(readings.earlier(kinds, lag))

    for steps in LAGS[sensor]:
        compared = _compared(observations, kinds, span, steps[-1])
        near, likelihoods = _highest(at, compared, kinds, steps, far)
        if near not in (steps[0], steps[-1]):
            break
    else:
        # No peak within reach, so that what is wrong is something else.
        return 0.0
    if abs(near) + CLOSER < least:
        return 0.0

    def posterior(lag: float) -> float:
        if lag not in likelihoods:
            likelihoods[lag] = at(lag, compared).log_likelihood
        return likelihoods[lag] - min(0.5 * (lag / LAG_KNOWN) ** 2, DECISIVE)

    for _ in range(CLOSER_STEPS):
        best = max((near - CLOSER, near, near + CLOSER), key=posterior)
        if best == near:
            break
        near = best
    lag = _vertex((near - CLOSER, near, near + CLOSER), posterior)
    return _earned(lag, posterior(lag) - posterior(0.0)) if abs(lag) >= least else 0.0


def _highest(
    lagging: Callable[[float, Observations], FilterSegment],
    compared: Observations,
    kinds: tuple[int, ...],
    steps: Sequence[float],
    far: Sequence[float],
) -> tuple[float, dict[float, float]]:
    """Return the likeliest lag uphill of none, or of one `far` off that is likelier than that peak by all readings.

    One fix that is wrong is worth hundreds where a lag makes up for it: so a far peak must be decisively likelier by
    either half of the readings alone. Beside it stand the likelihoods of all lags that were tried.
    """

    def variant(lag: float) -> FilterSegment:
        return lagging(lag, compared)

    likelihoods, _ = climb(variant, steps, 0.0)
    near = max(likelihoods, key=likelihoods.__getitem__)
    for start in far:
        if variant(start).log_likelihood > likelihoods[near]:
            likelihoods |= climb(variant, steps, start)[0]
    best = max(likelihoods, key=likelihoods.__getitem__)
    t = compared.t[np.isin(compared.kind, kinds)]
    if best == near or not t.size:
        return near, likelihoods
    for half in pairwise(np.quantile(t, [0.0, 0.5, 1.0]).tolist()):
        readings = compared.within(kinds, *half)
        if lagging(best, readings).log_likelihood - lagging(near, readings).log_likelihood < DECISIVE:
            return near, likelihoods
    return best, likelihoods


def refine_lag(
    observations: Observations,
    kinds: tuple[int, ...],
    span: tuple[float, float],
    lay_out: Callable[[Observations], FilterSegment],
) -> float:
    """Return by how much the lag of a receiver differs from what was found before the log's noise was known, s."""
    compared = _compared(observations, kinds, span, PARABOLA[-1])
    values = [lay_out(compared.earlier(kinds, step)).log_likelihood for step in PARABOLA.tolist()]
    bend, slope, _ = np.polyfit(PARABOLA, values, 2)
    if bend >= 0.0:
        return 0.0
    step = float(np.clip(-0.5 * slope / bend, PARABOLA[0], PARABOLA[-1]))
    return _earned(step, float(-0.25 * slope**2 / bend))


def _earned(lag: float, gain: float) -> float:
    """Return how much of a lag [s] is believed by its gain in log-likelihood; 0 below what rows resolve."""
    part = lag * believed(gain / SIGNIFICANT)
    return part if abs(part) >= RESOLVED else 0.0


def _vertex(at: tuple[float, float, float], value: Callable[[float], float]) -> float:
    """Return where a parabola through three values is highest; the middle one unless that is the highest of them."""
    left, middle, right = map(value, at)
    bend = left - 2.0 * middle + right
    if middle < max(left, right) or bend >= 0.0:
        return at[1]
    return at[1] + 0.5 * (at[1] - at[0]) * (left - right) / bend
