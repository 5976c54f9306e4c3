"""How noisy the sensors are and how far their errors wander: each setting climbs a ladder of values."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from estimation import _kernels
from estimation.alignment import Alignment, with_priors
from estimation.filter import Problem
from estimation.lags import Passes, climb, nearest

#: Gain that a noise setting must bring to be believed quieter than its class: very strong evidence on the scale of
#: Kass & Raftery (1995), ``2 ln B > 10``.
STRONG = 5.0
#: Ladders of the noise settings, with the names that they have in `SensorNoise`. Walks end where vibration that an
#: accelerometer rectifies, or a gyro takes for turning, moves a bias by 0.5 m/s^2 or 1 deg/s in 100 s: where GPS is
#: lost nothing else says how velocity drifts. A prior may only widen: that the three numbers which it is about came out
#: small proves nothing.
LADDERS: Mapping[str, tuple[float, ...]] = {
    "baro_wander": (0.1, 0.2, 0.5),
    "gyro_bias_walk": (2e-6, 6e-6, 2e-5, 6e-5, 2e-4, 6e-4, 2e-3),
    "hard_iron_walk": (2e-9, 6e-9, 2e-8, 6e-8, 2e-7, 6e-7, 2e-6, 6e-6),
    "hard_iron": (3e-6, 1e-5, 3e-5),
    "gyro_bias": (0.01, 0.03, 0.1, 0.3),
    "accel_bias": (0.1, 0.3, 1.0, 3.0),
    "accel_bias_walk": (5e-5, 1.5e-4, 5e-4, 1.5e-3, 5e-3, 1.5e-2, 5e-2),
}
PRIORS = ("hard_iron", "gyro_bias", "accel_bias")
#: Ladder of the correlation time of the GPS error, s, and of the factor on the white variance of GPS positions.
GPS_ERROR_SHARES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 0.98, 1.4, 2.0, 3.0)
GPS_ERROR_TIMES = (30.0, 100.0, 300.0, 1000.0, 3000.0)
GPS_WHITE_SCALES = (0.04, 0.1, 0.25, 1.0, 4.0, 16.0)
#: The same of heights. They are judged by readings so far apart, s, and not by all: their error is smooth, so that from
#: one reading to the next the steadiest receiver is one that drifts by 7 m in 30 s (pypi 00000081).
GPS_HEIGHT_SHARES = (*GPS_ERROR_SHARES, 5.0)
HEIGHTS, FAR_APART = (_kernels.GPS_HEIGHT, _kernels.GPS_CLIMB, _kernels.BARO), 5.0
#: White noise of a fix is no less than this, m: rows are rounded to 1e-7 degrees, and an antenna 0.1 m beside the IMU
#: is 3 cm elsewhere in a tilt of 0.3 rad. Innovations do not show it, since it is not white, nor do averages end it.
BEST_FIX = 0.03
#: Ladder of the factor on the IMU's noise as `timing.noise_density` sees it: what its own samples show is there.
IMU_SCALES = (1.0, 2.0, 4.0)


def set_noise(problem: Problem, start: Alignment, setting: str, ladder: Sequence[float], passes: Passes) -> Problem:
    """Put one noise setting on its likeliest rung; to be quieter than its class it must gain `STRONG`.

    A few minutes show little of a bias that walks for ten, and trusting it too much costs more than too little. A prior
    never becomes narrower: that it was wide is why the start, about which it is now, was found at all.
    """

    def at(value: float) -> Problem:
        changed: dict[str, Any] = {setting: value}
        noise = replace(problem.noise, **changed)
        return replace(problem, noise=noise, P=with_priors(replace(start, P=problem.P), problem.noise, noise).P)

    documented = nearest(ladder, getattr(problem.noise, setting))
    if setting in PRIORS:
        ladder = ladder[ladder.index(documented) :]
    likelihoods, likeliest = climb(at, ladder, documented, passes)
    quieter = getattr(likeliest.noise, setting) < documented
    unsure = max(likelihoods.values()) - likelihoods[documented] < STRONG
    return at(documented) if unsure and (quieter or setting in PRIORS) else likeliest


def split_gps_error(problem: Problem, passes: Passes) -> Problem:
    """Find how the GPS position error divides into white noise and slow wander, whose size is known already.

    Both fill the same innovations, so each correlation time is judged with the white noise that suits it.
    """
    kind = _kernels.GPS_POSITION
    observations = problem.observations
    variance = float(np.median(observations.variance[observations.scalar_kind == kind]))
    ladder = tuple(scale for scale in GPS_WHITE_SCALES[:-1] if scale * variance > 0.99 * BEST_FIX**2)
    ladder += GPS_WHITE_SCALES[-1:]

    def with_white(problem: Problem, factor: float) -> Problem:
        scale = problem.white_scale.copy()
        scale[kind] = factor
        return replace(problem, white_scale=scale)

    def at(time: float) -> Problem:
        wandering = replace(problem, noise=replace(problem.noise, gps_error_time=time))
        start = nearest(ladder, problem.white_scale[kind])
        return climb(lambda factor: with_white(wandering, factor), ladder, start, passes)[1]

    return climb(at, GPS_ERROR_TIMES, nearest(GPS_ERROR_TIMES, problem.noise.gps_error_time), passes)[1]


def scale_imu(problem: Problem, column: int, passes: Passes) -> tuple[float, Problem]:
    """Find the factor on the noise of gyro or accelerometer, and the problem with it."""

    def at(factor: float) -> Problem:
        factors = np.ones(2)
        factors[column] = factor
        return replace(problem, steps=problem.steps._replace(sub_noise=problem.steps.sub_noise * factors))

    likelihoods, likeliest = climb(at, IMU_SCALES, 1.0, passes)
    return max(likelihoods, key=likelihoods.__getitem__), likeliest
