"""What a log itself says about its sensors: lags and noise settings by maximum likelihood of the innovations.

Nothing here looks at truth or at the autopilot's estimate. Each setting climbs a ladder of values, one after the other,
by the log-likelihood that the filter reaches on a window of the flight. A lag other than the documented one must earn
it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from estimation import _kernels
from estimation.alignment import with_priors
from estimation.filter import COARSE, ForwardPass, Problem, World, assemble, matched_scale, run
from estimation.observations import Observations
from estimation.smoother import smooth
from estimation.states import SensorNoise
from estimation.timing import GYRO_MOVING, InertialSignal

#: Seconds of flight that are looked at; more would cost time and tell little more.
WINDOW = 180.0
#: Gain in log-likelihood that a lag other than the documented one must bring.
DECISIVE = 10.0
#: Gain that a noise setting must bring to be believed quieter than its class: very strong evidence on the scale of
#: Kass & Raftery (1995), ``2 ln B > 10``.
STRONG = 5.0
#: Steps of the GPS lag about the documented one, s.
GPS_LAGS = (-0.12, -0.08, -0.04, 0.0, 0.04, 0.08, 0.12)
#: Sensors whose lag is looked for, and their kinds of measurement.
LAGGING: Mapping[str, tuple[int, ...]] = {
    "mag": (_kernels.MAG,),
    "gps": (_kernels.GPS_POSITION, _kernels.GPS_VELOCITY),
    "gps2": (_kernels.GPS2_POSITION, _kernels.GPS2_VELOCITY),
}
#: Ladders of the noise settings, with the names that they have in `SensorNoise`. A prior may only widen: that the three
#: numbers which it is about came out small proves nothing.
LADDERS: Mapping[str, tuple[float, ...]] = {
    "gyro_bias_walk": (2e-6, 6e-6, 2e-5, 6e-5, 2e-4),
    "hard_iron_walk": (2e-9, 6e-9, 2e-8, 6e-8),
    "hard_iron": (3e-6, 1e-5, 3e-5),
    "accel_bias": (0.1, 0.3, 1.0),
    "accel_bias_walk": (5e-5, 1.5e-4, 5e-4, 1.5e-3, 5e-3),
}
PRIORS = ("hard_iron", "accel_bias")
#: Ladder of the correlation time of the GPS error, s, and of the factor on the white variance of GPS positions.
GPS_ERROR_TIMES = (30.0, 100.0, 300.0, 1000.0, 3000.0)
GPS_WHITE_SCALES = (0.01, 0.0625, 0.25, 1.0, 4.0, 16.0)
#: Ladder of the factor on the IMU's noise as `timing.noise_density` sees it.
IMU_SCALES = (0.25, 0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True, slots=True)
class Tuned:
    """Settings found for one log.

    Attributes
    ----------
    noise : SensorNoise
    white_scale : ndarray, shape (7,)
        Factor on the white variance of each kind of measurement.
    imu_scale : ndarray, shape (2,)
        Factor on the variance that gyro and accelerometer noise add.
    lags : mapping of str to float
        Lag found beyond the time that the tables give, by sensor (`LAGGING`), s.
    """

    noise: SensorNoise
    white_scale: np.ndarray
    imu_scale: np.ndarray
    lags: Mapping[str, float]

    def in_time(self, observations: Observations) -> Observations:
        """Put observations at the times that were found."""
        for sensor, lag in self.lags.items():
            observations = observations.earlier(LAGGING[sensor], lag)
        return observations


def tune(
    signal: InertialSignal, observations: Observations, x: np.ndarray, P: np.ndarray, world: World, noise: SensorNoise
) -> Tuned:
    """Find the settings from one segment of the log, from its start to at most `WINDOW` into the flight.

    Parameters are those of `filter.assemble`.
    """
    moving = signal.beyond(GYRO_MOVING)
    stop = WINDOW + float(signal.t[np.argmax(moving)] - signal.gyro_delay if moving.any() else signal.start)

    def lay_out(observations: Observations) -> Problem:
        return assemble(
            signal,
            observations,
            np.array([signal.start]),
            x,
            P,
            world,
            noise,
            white_scale=scale,
            stop=stop,
            finest=COARSE,
        )

    scale = np.ones(_kernels.KINDS)
    problem = lay_out(observations)
    result = run(problem)
    x, scale = relinearised(problem, result), matched_scale(problem, result)
    problem = lay_out(observations)

    lags = {}
    for sensor, kinds in LAGGING.items():
        if np.isin(problem.observations.kind, kinds).any():
            lags[sensor], problem = _find_lag(problem.observations, kinds, lay_out)
    for setting, ladder in LADDERS.items():
        problem = _set_noise(problem, setting, ladder)
    if np.any(problem.observations.kind == _kernels.GPS_POSITION):
        problem = _split_gps_error(problem)
    imu_scale = np.ones(2)
    for column in range(2):
        imu_scale[column], problem = _scale_imu(problem, column)
    matched = matched_scale(problem, run(problem, keep=False))
    matched[_kernels.GPS_POSITION] = problem.white_scale[_kernels.GPS_POSITION]
    return Tuned(problem.noise, matched, imu_scale, lags)


def relinearised(problem: Problem, result: ForwardPass) -> np.ndarray:
    """Give the start with its smoothed attitude to linearise about; all else stays as the prior has it, shape (27,)."""
    x = problem.x.copy()
    x[6:10] = smooth(problem, result).x[0, 6:10]
    return x


def _find_lag(
    observations: Observations, kinds: tuple[int, ...], lay_out: Callable[[Observations], Problem]
) -> tuple[float, Problem]:
    """Find the lag of one sensor and the problem with it taken out."""
    steps: tuple[float, ...] = GPS_LAGS
    if kinds == LAGGING["mag"]:
        # A magnetometer's row may be the mean of what it measured since the row before.
        rows = observations.t[observations.kind == _kernels.MAG]
        steps = (0.0, 0.5 * float(np.median(np.diff(rows)))) if len(rows) > 1 else (0.0,)
    likelihoods, _ = _climb(lambda lag: lay_out(observations.earlier(kinds, lag)), steps, 0.0)
    lag = _peak(likelihoods)
    return lag, lay_out(observations.earlier(kinds, lag))


def _set_noise(problem: Problem, setting: str, ladder: Sequence[float]) -> Problem:
    """Put one noise setting on its likeliest rung; to be quieter than its class it must gain `STRONG`.

    A few minutes show little of a bias that walks for ten, and trusting it too much costs more than too little.
    """

    def at(value: float) -> Problem:
        changed: dict[str, Any] = {setting: value}
        noise = replace(problem.noise, **changed)
        return replace(problem, noise=noise, P=with_priors(problem.P, noise))

    documented = _nearest(ladder, getattr(problem.noise, setting))
    likelihoods, likeliest = _climb(at, ladder, documented)
    quieter = getattr(likeliest.noise, setting) < documented
    if (quieter or setting in PRIORS) and max(likelihoods.values()) - likelihoods[documented] < STRONG:
        return at(documented)
    return likeliest


def _split_gps_error(problem: Problem) -> Problem:
    """Find how the GPS position error divides into white noise and slow wander, whose size is as reported.

    Both fill the same innovations, so each correlation time is judged with the white noise that suits it.
    """
    kind = _kernels.GPS_POSITION

    def with_white(problem: Problem, factor: float) -> Problem:
        scale = problem.white_scale.copy()
        scale[kind] = factor
        return replace(problem, white_scale=scale)

    def at(time: float) -> Problem:
        wandering = replace(problem, noise=replace(problem.noise, gps_error_time=time))
        start = _nearest(GPS_WHITE_SCALES, problem.white_scale[kind])
        return _climb(lambda factor: with_white(wandering, factor), GPS_WHITE_SCALES, start)[1]

    return _climb(at, GPS_ERROR_TIMES, _nearest(GPS_ERROR_TIMES, problem.noise.gps_error_time))[1]


def _scale_imu(problem: Problem, column: int) -> tuple[float, Problem]:
    """Find the factor on the noise of gyro (column 0) or accelerometer (1), and the problem with it."""

    def at(factor: float) -> Problem:
        factors = np.ones(2)
        factors[column] = factor
        return replace(problem, sub_noise=problem.sub_noise * factors)

    likelihoods, likeliest = _climb(at, IMU_SCALES, 1.0)
    best = max(likelihoods, key=likelihoods.__getitem__)
    if best < 1.0 and likelihoods[best] - likelihoods[1.0] < STRONG:
        return 1.0, at(1.0)
    return best, likeliest


def _nearest(ladder: Sequence[float], value: float) -> float:
    """Give the rung nearest to a positive value, by ratio."""
    return min(ladder, key=lambda rung: abs(np.log(rung / value)))


def _climb(
    variant: Callable[[float], Problem], ladder: Sequence[float], start: float
) -> tuple[dict[float, float], Problem]:
    """Go up and down a ladder of values from `start` as long as it gets likelier.

    Gives the log-likelihood of every value looked at, and the likeliest variant of the problem.
    """
    likelihoods: dict[float, float] = {}
    best: Problem | None = None
    for step in (1, -1):
        k = ladder.index(start)
        while 0 <= k < len(ladder):
            value = ladder[k]
            if value not in likelihoods:
                problem = variant(value)
                likelihoods[value] = run(problem, keep=False).log_likelihood
                if best is None or likelihoods[value] >= max(likelihoods.values()):
                    best = problem
                elif value != start:
                    break
            k += step
    assert best is not None  # start is a rung
    return likelihoods, best


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
