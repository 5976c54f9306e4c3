"""What a log itself says about its sensors: lags and noise settings by maximum likelihood of the innovations.

Nothing here looks at truth or at the autopilot's estimate. Each setting climbs a ladder of values, one after the other,
by the log-likelihood that the filter reaches on a window of the flight. A lag other than the documented one must earn
it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimation import _kernels
from estimation.filter import ForwardPass, Problem, World, assemble, matched_scale, run
from estimation.observations import Observations
from estimation.smoother import smooth
from estimation.states import SensorNoise
from estimation.timing import GYRO_MOVING, InertialSignal

#: Seconds of flight that are looked at; more would cost time and tell little more.
WINDOW = 240.0
#: Gain in log-likelihood that a lag other than the documented one must bring.
DECISIVE = 10.0
#: Steps of the GPS lag about the documented one, s.
GPS_LAGS = (-0.12, -0.08, -0.04, 0.0, 0.04, 0.08, 0.12)
#: Ladders of the noise settings, with the names that they have in `SensorNoise`.
LADDERS: Mapping[str, tuple[float, ...]] = {
    "gyro_bias_walk": (2e-6, 6e-6, 2e-5, 6e-5, 2e-4),
    "hard_iron_walk": (2e-9, 6e-9, 2e-8, 6e-8),
}
#: Ladder of the correlation time of the GPS error, s, and of the factor on the white variance of GPS positions.
GPS_ERROR_TIMES = (30.0, 100.0, 300.0, 1000.0, 3000.0)
GPS_WHITE_SCALES = (0.01, 0.0625, 0.25, 1.0, 4.0, 16.0)


@dataclass(frozen=True, slots=True)
class Tuned:
    """Settings found for one segment.

    Attributes
    ----------
    noise : SensorNoise
    observations : Observations
        At their most likely times.
    white_scale : ndarray, shape (5,)
        Factor on the white variance of each kind of measurement.
    x : ndarray, shape (26,)
        Start of the segment with the attitude to linearise about.
    lags : mapping of str to float
        Lag found beyond the time that the tables give, by sensor, s.
    """

    noise: SensorNoise
    observations: Observations
    white_scale: np.ndarray
    x: np.ndarray
    lags: Mapping[str, float]


def tune(
    signal: InertialSignal, observations: Observations, x: np.ndarray, P: np.ndarray, world: World, noise: SensorNoise
) -> Tuned:
    """Find the settings of one segment from its start to at most `WINDOW` into the flight."""
    moving = np.abs(signal.rate(signal.times)).max(axis=1) > GYRO_MOVING
    stop = WINDOW + float(signal.times[np.argmax(moving)] if moving.any() else signal.start)
    start = np.array([signal.start])

    def lay_out(observations: Observations) -> Problem:
        return assemble(signal, observations, start, x, P, world, noise, white_scale=scale, stop=stop)

    scale = np.ones(_kernels.KINDS)
    problem = lay_out(observations)
    result = run(problem)
    x, scale = _aligned(problem, result), matched_scale(problem, result)

    lags = {}
    for name, kinds, steps in (
        ("mag", (_kernels.MAG,), _mag_lags(observations)),
        ("gps", (_kernels.GPS_POSITION, _kernels.GPS_VELOCITY), GPS_LAGS),
    ):
        if np.isin(observations.kind, kinds).any():

            def at(lag: float, kinds: tuple[int, ...] = kinds, seen: Observations = observations) -> float:
                return _likelihood(lay_out(seen.earlier(kinds, lag)))

            lags[name] = _peak(_climb(at, steps, 0.0))
            observations = observations.earlier(kinds, lags[name])

    problem = lay_out(observations)
    for setting, ladder in LADDERS.items():
        problem = _set_noise(problem, setting, ladder)
    if np.any(observations.kind == _kernels.GPS_POSITION):
        problem = _split_gps_error(problem)
    result = run(problem)
    matched = matched_scale(problem, result)
    matched[_kernels.GPS_POSITION] = problem.white_scale[_kernels.GPS_POSITION]
    return Tuned(problem.noise, observations, matched, _aligned(problem, result), lags)


def _aligned(problem: Problem, result: ForwardPass) -> np.ndarray:
    """Take the start's attitude from the smoother, to linearise about; all else stays as the prior has it."""
    x = problem.x.copy()
    x[6:10] = smooth(problem, result).x[0, 6:10]
    return x


def _likelihood(problem: Problem) -> float:
    return run(problem, keep=False).log_likelihood


def _set_noise(problem: Problem, setting: str, ladder: Sequence[float]) -> Problem:
    """Put one noise setting on its likeliest rung."""

    def at(value: float) -> float:
        return _likelihood(replace(problem, noise=replace(problem.noise, **{setting: value})))

    best = _best(_climb(at, ladder, _nearest(ladder, getattr(problem.noise, setting))))
    return replace(problem, noise=replace(problem.noise, **{setting: best}))


def _split_gps_error(problem: Problem) -> Problem:
    """Find how the GPS position error divides into white noise and slow wander, whose size is as reported.

    Both fill the same innovations, so each correlation time is judged with the white noise that suits it.
    """
    whites: dict[float, float] = {}

    def with_white(time: float, factor: float) -> Problem:
        scale = problem.white_scale.copy()
        scale[_kernels.GPS_POSITION] = factor
        return replace(problem, noise=replace(problem.noise, gps_error_time=time), white_scale=scale)

    def at(time: float) -> float:
        start = next(reversed(whites.values()), problem.white_scale[_kernels.GPS_POSITION])
        found = _climb(
            lambda factor: _likelihood(with_white(time, factor)), GPS_WHITE_SCALES, _nearest(GPS_WHITE_SCALES, start)
        )
        whites[time] = _best(found)
        return found[whites[time]]

    time = _best(_climb(at, GPS_ERROR_TIMES, _nearest(GPS_ERROR_TIMES, problem.noise.gps_error_time)))
    return with_white(time, whites[time])


def _best(likelihoods: Mapping[float, float]) -> float:
    """Give the likeliest value."""
    return max(likelihoods, key=likelihoods.__getitem__)


def _nearest(ladder: Sequence[float], value: float) -> float:
    """Give the rung nearest to a positive value, by ratio."""
    return min(ladder, key=lambda rung: abs(np.log(rung / value)))


def _climb(likelihood: Callable[[float], float], ladder: Sequence[float], start: float) -> dict[float, float]:
    """Go up and down a ladder of values from `start` as long as it gets likelier; gives every value looked at."""
    found = {start: likelihood(start)}
    for step in (1, -1):
        k = ladder.index(start)
        while 0 <= k + step < len(ladder):
            k += step
            found[ladder[k]] = likelihood(ladder[k])
            if found[ladder[k]] < found[ladder[k - step]]:
                break
    return found


def _mag_lags(observations: Observations) -> tuple[float, ...]:
    """Lags that a magnetometer may have: none, or half its interval where a row is the mean since the row before."""
    t = observations.t[observations.kind == _kernels.MAG]
    return (0.0, 0.5 * float(np.median(np.diff(t)))) if len(t) > 1 else (0.0,)


def _peak(likelihoods: Mapping[float, float]) -> float:
    """Find the likeliest lag, between equal steps by a parabola; 0 unless it is decisively likelier than that."""
    lags = sorted(likelihoods)
    values = [likelihoods[lag] for lag in lags]
    best = int(np.argmax(values))
    if values[best] - likelihoods[0.0] < DECISIVE:
        return 0.0
    if best in (0, len(lags) - 1):
        return lags[best]
    left, middle, right = values[best - 1 : best + 2]
    return lags[best] + 0.5 * (lags[1] - lags[0]) * (left - right) / (left - 2.0 * middle + right)
