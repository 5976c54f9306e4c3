"""What a log itself says about its sensors: lags and noise settings by maximum likelihood of the innovations.

Nothing here looks at truth or at the autopilot's estimate. Each setting climbs a ladder of values, one after the other,
by the log-likelihood that the filter reaches on a window of the flight. A lag other than the documented one must earn
it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from core.attitude import error_rotation, turned_by
from estimation import _kernels
from estimation._kernels import ForwardPass
from estimation.alignment import Alignment, with_priors
from estimation.filter import COARSE, LOUDEST, FilterSegment, assemble, matched_scale, run
from estimation.lags import (
    DECISIVE,
    ENDS,
    FAR_LAGS,
    FINE_LAGS,
    LAGGING,
    RECEIVERS,
    climb,
    find_lag,
    nearest,
    refine_lag,
)
from estimation.observations import Observations
from estimation.place import World
from estimation.shocks import believed
from estimation.smoother import smooth
from estimation.states import ACCEL_BIAS, ATTITUDE, SensorNoise
from estimation.timing import GYRO_MOVING, TURNING, InertialSignal
from estimation.trust import LATE

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
#: Settings of a sensor that a log may lack. All their rungs are then alike, and rounding would choose among them: a
#: compass that is not there might wander.
OF_SENSOR: Mapping[str, str] = {"baro_wander": "baro", "hard_iron_walk": "mag", "hard_iron": "mag"}
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


def set_noise(problem: FilterSegment, start: Alignment, setting: str, ladder: Sequence[float]) -> FilterSegment:
    """Set one noise setting to its likeliest step; to be quieter than its class it must gain `STRONG`.

    A few minutes show little of a bias that walks for ten, and trusting it too much costs more than too little. A prior
    never becomes narrower: that it was wide is why the start, about which it is now, was found at all.
    """

    def at(value: float) -> FilterSegment:
        if value == getattr(problem.noise, setting):
            return problem
        changed: dict[str, Any] = {setting: value}
        noise = replace(problem.noise, **changed)
        return replace(problem, noise=noise, P=with_priors(replace(start, P=problem.P), problem.noise, noise).P)

    documented = nearest(ladder, getattr(problem.noise, setting))
    if setting in PRIORS:
        ladder = ladder[ladder.index(documented) :]
    likelihoods, likeliest = climb(at, ladder, documented)
    quieter = getattr(likeliest.noise, setting) < documented
    unsure = max(likelihoods.values()) - likelihoods[documented] < STRONG
    return at(documented) if unsure and (quieter or setting in PRIORS) else likeliest


def split_gps_error(problem: FilterSegment) -> FilterSegment:
    """Find how the GPS position error divides into white noise and slow wander, whose size is known already.

    Both fill the same innovations, so each correlation time is judged with the white noise that suits it.
    """
    kind = _kernels.GPS_POSITION
    observations = problem.observations
    variance = float(np.median(observations.variance[observations.scalar_kind == kind]))
    ladder = tuple(scale for scale in GPS_WHITE_SCALES[:-1] if scale * variance > 0.99 * BEST_FIX**2)
    ladder += GPS_WHITE_SCALES[-1:]

    def with_white(problem: FilterSegment, factor: float) -> FilterSegment:
        if factor == problem.white_scale[kind]:
            return problem
        scale = problem.white_scale.copy()
        scale[kind] = factor
        return replace(problem, white_scale=scale)

    def at(time: float) -> FilterSegment:
        noise = replace(problem.noise, gps_error_time=time)
        wandering = problem if noise == problem.noise else replace(problem, noise=noise)
        start = nearest(ladder, problem.white_scale[kind])
        return climb(lambda factor: with_white(wandering, factor), ladder, start)[1]

    return climb(at, GPS_ERROR_TIMES, nearest(GPS_ERROR_TIMES, problem.noise.gps_error_time))[1]


def scale_imu(problem: FilterSegment, column: int) -> tuple[float, FilterSegment]:
    """Find the factor on the noise of gyro or accelerometer, and the problem with it."""

    def at(factor: float) -> FilterSegment:
        if factor == 1.0:
            return problem
        factors = np.ones(2)
        factors[column] = factor
        return replace(problem, steps=problem.steps._replace(sub_noise=problem.steps.sub_noise * factors))

    likelihoods, likeliest = climb(at, IMU_SCALES, 1.0)
    return max(likelihoods, key=likelihoods.__getitem__), likeliest


#: Tilt and the accelerometer's bias are known to begin with if their 1-sigma is below this, rad and m/s^2.
TILT_KNOWN, BIAS_KNOWN = 0.2, 0.5
#: Passes at most until the start of an IMU that was never calibrated settles, and what it then still turns by, rad.
RELINEARISED, SETTLED = 8, np.radians(0.5)


def relinearised(problem: FilterSegment, result: ForwardPass, *, levelled: bool) -> np.ndarray:
    """Return the start to linearise about, shape (29,): that of the prior with its heading smoothed.

    The prior moves along. That does no harm to a heading, of which it says little. Tilt moves too where nothing but the
    force in flight told it, and it is as wide; and along with the accelerometer's bias where that is.
    """
    x = problem.x.copy()
    smoothed = smooth(problem, result).x[0]
    turn = error_rotation(x[6:10], smoothed[6:10])
    if problem.P[ACCEL_BIAS, ACCEL_BIAS] > BIAS_KNOWN**2:
        x[13:16] = smoothed[13:16]
    if not is_sought(problem.P, levelled=levelled):
        turn[:2] = 0.0
    x[6:10] = turned_by(x[6:10], turn)
    return x


def settled(before: np.ndarray, after: np.ndarray) -> bool:
    """Return whether two starts, shape (29,), linearise about the same attitude."""
    return bool(np.linalg.norm(error_rotation(before[6:10], after[6:10])) < SETTLED)


def is_sought(P: np.ndarray, *, levelled: bool) -> bool:
    """Return whether a start's tilt is so unknown that it takes several passes to find it."""
    return moves_bias(P, levelled=levelled) or bool(P[ATTITUDE, ATTITUDE] >= TILT_KNOWN**2)


def moves_bias(P: np.ndarray, *, levelled: bool) -> bool:
    """Return whether a start's tilt is as unknown as the accelerometer's bias that made it, so that both move."""
    return levelled and bool(P[ACCEL_BIAS, ACCEL_BIAS] > BIAS_KNOWN**2)


#: Seconds of flight that are looked at; more would cost time and tell little more.
WINDOW = 180.0
#: A lag beyond this, s, spoils what is found along with it.
LAG_LARGE = 0.1
#: Steps about the yaw gyro's scale at which likelihood is laid through a parabola, and how often: gyros of this class
#: are off by up to 3 % (data sheets of MPU-6000 and ICM-20689).
SCALE_STEPS, SCALE_PASSES = np.array([-0.02, 0.0, 0.02]), 3
#: Hard iron's walk about which the search begins, T/sqrt(s).
COMPASS_CLASS = 2e-8
#: Biases of an IMU that was never calibrated, rad/s and m/s^2.
WIDE_GYRO_BIAS, WIDE_ACCEL_BIAS = 0.1, 3.0


@dataclass(frozen=True, slots=True)
class Tuned:
    """Settings found for one log."""

    noise: SensorNoise
    white_scale: np.ndarray  #: shape (9,): Factor on the white variance of each kind of measurement.
    imu_scale: np.ndarray  #: shape (2,): Factor on the variance that gyro and accelerometer noise add.
    lags: Mapping[str, float]  #: Lag found beyond the time that the tables give, by sensor (`LAGGING`), s.
    yaw_scale: float  #: Factor on the rate about the down axis that makes it true.

    @property
    def late_barometer(self) -> bool:
        """Whether the barometer is so late that one lag may not undo it, as behind a filter."""
        return abs(self.lags.get("baro", 0.0)) > LATE

    def in_time(self, observations: Observations) -> Observations:
        """Shift observations by the lags found."""
        for sensor, lag in self.lags.items():
            observations = observations.earlier(LAGGING[sensor], lag)
        return observations


def window(signal: InertialSignal) -> tuple[float, float]:
    """Return the span of the flight that is looked at, s; it begins where the craft first turns."""
    moving = signal.beyond(GYRO_MOVING)
    begin = float(signal.t[np.argmax(moving)] - signal.gyro_delay if moving.any() else signal.start)
    return begin, begin + WINDOW


def tune(
    signal: InertialSignal, observations: Observations, aligned: Alignment, world: World, noise: SensorNoise
) -> Tuned:
    """Find the settings from one segment of the log, from its start to at most `WINDOW` into the flight.

    Biases far beyond their class throw off the attitude that is found along with them, after which no single setting
    looks better: they need a start of their own. With settings of the class that start also makes up for whatever else
    is worse than its class, as a compass beside motors, and one fix more or less decided on it. So where it looks
    better, settings are found about both, and it must still be decisively likelier.
    """
    wide = replace(noise, gyro_bias=WIDE_GYRO_BIAS, accel_bias=WIDE_ACCEL_BIAS)
    known = _Search(signal, observations, aligned, world, noise)
    # Each finds how its compass wanders: about a wrong start it seems to, and that would spoil the other.
    far_off = _Search(signal, observations, with_priors(aligned, noise, wide), world, wide)
    looks_better = far_off.begin() - known.begin() > DECISIVE
    known.search()
    # A sensor as loud as none of its class: what contradicts it may be the IMU.
    if not looks_better and known.white_scale.max() < LOUDEST**2:
        return known.found
    far_off.search()
    return far_off.found if far_off.likelihood() - known.likelihood() > DECISIVE else known.found


class _Search:
    """The search for settings about one start."""

    def __init__(
        self, signal: InertialSignal, observations: Observations, aligned: Alignment, world: World, noise: SensorNoise
    ) -> None:
        self.observations, self.aligned, self.world = observations, aligned, world
        self.given = self.noise = noise
        self.x, self.P, self.white_scale = aligned.x, aligned.P, np.ones(_kernels.KINDS)
        self.imu_scale = np.ones(2)
        self.span = signal.start, min(window(signal)[1], signal.stop)
        self.moves = bool(signal.beyond(TURNING).any())
        self.signal = self.as_measured = signal.before(self.span[1])
        self.yaw_scale = 1.0
        self.lags = {s: 0.0 for s, kinds in LAGGING.items() if np.isin(observations.kind, kinds).any()}

    @property
    def found(self) -> Tuned:
        """The settings."""
        return Tuned(self.noise, self.white_scale, self.imu_scale, self.lags, self.yaw_scale)

    def lay_out(self, observations: Observations) -> FilterSegment:
        """Set up the filter of the window with the settings found so far."""
        return assemble(
            self.signal,
            observations,
            np.array([self.signal.start]),
            self.x,
            self.P,
            self.world,
            self.noise,
            white_scale=self.white_scale,
            imu_scale=self.imu_scale,
            stop=self.span[1],
            finest=COARSE,
            moves=self.moves,
        )

    def begin(self) -> float:
        """Find the attitude to linearise about and what white noise suits it; return the log-likelihood.

        Currents beside a compass pull at attitude, after which lags and noise of all other sensors come out wrong: so
        how far its hard iron walks is found at once.
        """
        self.x, self.P, self.noise = self.aligned.x, self.aligned.P, self.given
        self.white_scale = np.ones(_kernels.KINDS)
        started = self._started(self.lay_out(self.observations))
        if "mag" in self.lags:
            ladder = LADDERS["hard_iron_walk"][LADDERS["hard_iron_walk"].index(COMPASS_CLASS) :]
            likelihoods, likeliest = climb(
                lambda walk: replace(started, noise=replace(started.noise, hard_iron_walk=walk)),
                ladder,
                COMPASS_CLASS,
            )
            if max(likelihoods.values()) - likelihoods[COMPASS_CLASS] > DECISIVE:
                started = self._started(replace(likeliest, x=self.x))
        self._take(started)
        return started.log_likelihood

    def search(self) -> None:
        """Find lags and noise, from what `begin` found."""
        for last in (False, True):
            corrections = {}
            for sensor in self.lags:
                # Some hundredths of a second of a barometer say more of its noise than of its clock.
                least = LAG_LARGE if sensor == "baro" else 0.0
                far = () if last else FAR_LAGS[sensor]
                judged_by = self._judging(sensor)
                corrections[sensor] = find_lag(judged_by, sensor, self.span, self.lay_out, least, far)
                self.observations = self.observations.earlier(LAGGING[sensor], corrections[sensor])
                self.lags[sensor] += corrections[sensor]
            # What was found with a clock that was off is found again with it set right.
            if max(map(abs, corrections.values()), default=0.0) < LAG_LARGE:
                break
            if self.found.late_barometer and not last:
                self._forget_receivers()
            self.begin()
        self._find_yaw_scale()
        problem = self.lay_out(self.observations)
        # Before the GPS: a gyro that is noisier than it looks would make the likeliest receiver a perfect one.
        for column in range(2):
            self.imu_scale[column], problem = scale_imu(problem, column)
        start = replace(self.aligned, x=self.x)
        # Levelled about the attitude that was found.
        problem = replace(problem, P=with_priors(replace(start, P=problem.P), self.noise, self.noise).P)
        for setting, ladder in LADDERS.items():
            if OF_SENSOR.get(setting, "") not in {"", *self.lags}:
                continue
            if setting == "baro_wander" and self.found.late_barometer:
                # The filter that makes a barometer late hides its wander from the innovations.
                ladder = ladder[-1:]
            problem = set_noise(problem, start, setting, ladder)
        if np.any(problem.observations.kind == _kernels.GPS_POSITION):
            problem = set_noise(problem, start, "gps_error_share", GPS_ERROR_SHARES)
            problem = split_gps_error(problem)
            self._take(problem)
            sparse = self.lay_out(self.observations.thinned(HEIGHTS, FAR_APART))
            sparse = set_noise(sparse, start, "gps_height_share", GPS_HEIGHT_SHARES)
            problem = replace(problem, noise=sparse.noise, P=sparse.P)
        matched = matched_scale(problem, run(problem, keep=False))
        matched[_kernels.GPS_POSITION] = problem.white_scale[_kernels.GPS_POSITION]
        self._take(replace(problem, white_scale=matched))
        # A start whose tilt is still sought makes up for a lag, or the lag for it.
        if not moves_bias(self.aligned.P, levelled=self.aligned.levelled):
            for sensor in self.lags.keys() & RECEIVERS:
                self.lags[sensor] += refine_lag(self._judging(sensor), LAGGING[sensor], self.span, self.lay_out)
        if self.yaw_scale != 1.0:
            self._doubt_yaw_scale()

    def _judging(self, sensor: str) -> Observations:
        """Return the observations that the lag of a sensor is judged by.

        The IMU tells a receiver's clock. A barometer that is late lags as a filter does, which no one lag undoes: it
        would bend the receiver's clock by hundredths of a second, and each of them is 8 cm at 8 m/s.
        """
        alone = self.found.late_barometer and sensor in RECEIVERS
        return self.observations.without(_kernels.BARO) if alone else self.observations

    def _forget_receivers(self) -> None:
        """Reset the receivers' lags: what was found may have been the barometer's lag."""
        for sensor in self.lags.keys() & RECEIVERS:
            self.observations = self.observations.earlier(LAGGING[sensor], -self.lags[sensor])
            self.lags[sensor] = 0.0

    def _find_yaw_scale(self) -> None:
        """Find the scale of the gyro about the down axis, where it is decisively likelier than 1.

        Other axes turn to and fro, so that little comes of theirs but what is wrong elsewhere.
        """
        for _ in range(SCALE_PASSES):
            scale, gain = self._likelier_scale()
            if gain < DECISIVE:
                return
            self._rescale(scale)
            self.begin()

    def _doubt_yaw_scale(self) -> None:
        """Find the scale again with the log's noise, and believe as much of it as the log shows.

        One that is believed or not would turn the craft by all of it when one fix decides.
        """
        scale, _ = self._likelier_scale()
        self._rescale(scale)
        gain = self._log_likelihood()
        self._rescale(1.0)
        gain -= self._log_likelihood()
        self._rescale(1.0 + (scale - 1.0) * believed(gain / DECISIVE))

    def _likelier_scale(self) -> tuple[float, float]:
        """Return the likeliest scale near that of now, by a parabola, and by how much it is likelier."""
        middle = self.yaw_scale
        values = []
        for step in SCALE_STEPS.tolist():
            self._rescale(middle * (1.0 + step))
            values.append(self._log_likelihood())
        self._rescale(middle)
        bend, slope, _ = np.polyfit(SCALE_STEPS, values, 2)
        if bend >= 0.0:
            return middle, 0.0
        step = float(np.clip(-0.5 * slope / bend, SCALE_STEPS[0], SCALE_STEPS[-1]))
        return middle * (1.0 + step), step * (slope + bend * step)

    def _log_likelihood(self) -> float:
        return self.lay_out(self.observations).log_likelihood

    def _rescale(self, yaw_scale: float) -> None:
        """Set another scale, which makes another signal of what was measured."""
        self.yaw_scale, self.signal = yaw_scale, self.as_measured.rescaled(yaw_scale)

    def likelihood(self) -> float:
        """Return the log-likelihood of what was found, over readings that no lag moves out of the window."""
        kinds, reach = range(_kernels.KINDS), max(map(abs, FINE_LAGS)) + ENDS
        seen = self.observations.within(kinds, self.span[0] + reach, self.span[1] - reach)
        return self.lay_out(seen).log_likelihood

    def _started(self, problem: FilterSegment) -> FilterSegment:
        """Linearise about the attitude that a problem itself finds from its start, and match white noise to it."""
        levelled = self.aligned.levelled
        for k in range(RELINEARISED if is_sought(self.aligned.P, levelled=levelled) else 1):
            result = run(problem)
            x, scale = problem.x, matched_scale(problem, result)
            problem = replace(problem, x=relinearised(problem, result, levelled=levelled), white_scale=scale)
            if k and settled(x, problem.x):
                break
        return problem

    def _take(self, problem: FilterSegment) -> None:
        self.x, self.P, self.noise, self.white_scale = problem.x, problem.P, problem.noise, problem.white_scale
