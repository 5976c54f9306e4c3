"""What a log itself says about its sensors: lags and noise settings by maximum likelihood of the innovations.

Nothing here looks at truth or at the autopilot's estimate. Each setting climbs a ladder of values, one after the other,
by the log-likelihood that the filter reaches on a window of the flight. A lag other than the documented one must earn
it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from itertools import pairwise
from typing import Any

import numpy as np

from estimation import _kernels
from estimation.alignment import Alignment, with_priors
from estimation.attitude import error_rotation, turned_by
from estimation.filter import COARSE, ForwardPass, Problem, World, assemble, matched_scale, run
from estimation.observations import Observations
from estimation.shocks import believed
from estimation.smoother import smooth
from estimation.states import ACCEL_BIAS, ATTITUDE, SensorNoise
from estimation.timing import GYRO_MOVING, TURNING, InertialSignal
from estimation.trust import LATE

#: Seconds of flight that are looked at; more would cost time and tell little more.
WINDOW = 180.0
#: Gain in log-likelihood that a lag other than the documented one must bring.
DECISIVE = 10.0
#: Gain that a noise setting must bring to be believed quieter than its class: very strong evidence on the scale of
#: Kass & Raftery (1995), ``2 ln B > 10``.
STRONG = 5.0
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
#: A lag beyond this, s, spoils what is found along with it.
LAG_LARGE = 0.1
#: The same of compass and barometer, whose rows may be means of what they measured since the row before.
FINE_LAGS = (-1.5, -1.1, -0.8, -0.55, -0.36, -0.24, -0.16, -0.1, -0.05, 0.0)
FINE_LAGS += tuple(-lag for lag in reversed(FINE_LAGS[:-1]))
#: Those of a barometer whose driver filters heavily.
BARO_LAGS = (*FINE_LAGS, 2.0, 2.7, 3.6, 4.8, 6.4)
#: Sensors whose lag is looked for, and their kinds of measurement.
LAGGING: Mapping[str, tuple[int, ...]] = {
    "mag": (_kernels.MAG,),
    "gps": (_kernels.GPS_POSITION, _kernels.GPS_VELOCITY),
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
#: Steps about the yaw gyro's scale at which likelihood is laid through a parabola, and how often: gyros of this class
#: are off by up to 3 % (data sheets of MPU-6000 and ICM-20689).
SCALE_STEPS, SCALE_PASSES = np.array([-0.02, 0.0, 0.02]), 3
#: Ladders of the noise settings, with the names that they have in `SensorNoise`. Walks end where vibration that an
#: accelerometer rectifies, or a gyro takes for turning, moves a bias by 0.5 m/s^2 or 1 deg/s in 100 s: where GPS is
#: lost nothing else says how velocity drifts. A prior may only widen: that the three numbers which it is about came out
#: small proves nothing.
LADDERS: Mapping[str, tuple[float, ...]] = {
    "baro_walk": (0.04, 0.1, 0.25, 0.6, 1.5),
    "gyro_bias_walk": (2e-6, 6e-6, 2e-5, 6e-5, 2e-4, 6e-4, 2e-3),
    "hard_iron_walk": (2e-9, 6e-9, 2e-8, 6e-8, 2e-7, 6e-7, 2e-6, 6e-6),
    "hard_iron": (3e-6, 1e-5, 3e-5),
    "gyro_bias": (0.01, 0.03, 0.1, 0.3),
    "accel_bias": (0.1, 0.3, 1.0, 3.0),
    "accel_bias_walk": (5e-5, 1.5e-4, 5e-4, 1.5e-3, 5e-3, 1.5e-2, 5e-2),
}
#: Those of a late barometer: the filter that makes it late hides its wander from the innovations.
HIDDEN_WALKS = LADDERS["baro_walk"][2:]
#: Hard iron's walk about which the search begins, T/sqrt(s).
COMPASS_CLASS = 2e-8
#: Tilt and the accelerometer's bias are known to begin with if their 1-sigma is below this, rad and m/s^2.
TILT_KNOWN, BIAS_KNOWN = 0.2, 0.5
#: Biases of an IMU that was never calibrated, rad/s and m/s^2.
WIDE_GYRO_BIAS, WIDE_ACCEL_BIAS = 0.1, 3.0
#: Passes at most until the start of an IMU that was never calibrated settles, and what it then still turns by, rad.
RELINEARISED, SETTLED = 8, np.radians(0.5)
PRIORS = ("hard_iron", "gyro_bias", "accel_bias")
#: Ladder of the correlation time of the GPS error, s, and of the factor on the white variance of GPS positions.
GPS_ERROR_SHARES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 0.98, 1.4, 2.0, 3.0)
GPS_ERROR_TIMES = (30.0, 100.0, 300.0, 1000.0, 3000.0)
GPS_WHITE_SCALES = (0.04, 0.1, 0.25, 1.0, 4.0, 16.0)
#: White noise of a fix is no less than this, m: rows are rounded to 1e-7 degrees, and an antenna 0.1 m beside the IMU
#: is 3 cm elsewhere in a tilt of 0.3 rad. Innovations do not show it, since it is not white, nor do averages end it.
BEST_FIX = 0.03
#: Ladder of the factor on the IMU's noise as `timing.noise_density` sees it: what its own samples show is there.
IMU_SCALES = (1.0, 2.0, 4.0)


@dataclass(frozen=True, slots=True)
class Tuned:
    """Settings found for one log."""

    noise: SensorNoise
    white_scale: np.ndarray  #: shape (7,): Factor on the white variance of each kind of measurement.
    imu_scale: np.ndarray  #: shape (2,): Factor on the variance that gyro and accelerometer noise add.
    lags: Mapping[str, float]  #: Lag found beyond the time that the tables give, by sensor (`LAGGING`), s.
    yaw_scale: float  #: Factor on the rate about the down axis that makes it true.

    @property
    def late_barometer(self) -> bool:
        """Whether the barometer is so late that one lag may not undo it, as behind a filter."""
        return abs(self.lags.get("baro", 0.0)) > LATE

    def in_time(self, observations: Observations) -> Observations:
        """Put observations at the times that were found."""
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

    Parameters
    ----------
    signal : InertialSignal
        IMU samples of the segment.
    observations : Observations
        What the aiding sensors measured, at the times that their tables state.
    aligned : Alignment
        The start.
    world : World
        Gravity and Earth's rotation.
    noise : SensorNoise
        Settings to begin with, those that `aligned` was made with.
    """
    wide = replace(noise, gyro_bias=WIDE_GYRO_BIAS, accel_bias=WIDE_ACCEL_BIAS)
    known = _Search(signal, observations, aligned, world, noise)
    # Each finds how its compass wanders: about a wrong start it seems to, and that would spoil the other.
    far_off = _Search(signal, observations, with_priors(aligned, noise, wide), world, wide)
    looks_better = far_off.begin() - known.begin() > DECISIVE
    known.search()
    if not looks_better:
        return known.found
    far_off.search()
    return far_off.found if far_off.likelihood() - known.likelihood() > DECISIVE else known.found


@dataclass(frozen=True, slots=True)
class _Passes:
    """Likelihoods of the filter, each worked out once: ladders share their rungs."""

    _known: dict[tuple[SensorNoise, bytes], float] = field(default_factory=dict)

    def likelihood(self, problem: Problem) -> float:
        """Return the log-likelihood of a problem of this segment."""
        o, content = problem.observations, blake2b(digest_size=16)
        for part in (problem.t, problem.sub_noise, problem.x, problem.P, problem.white_scale, o.t, o.kind, o.z):
            content.update(part.tobytes())
        key = problem.noise, content.digest()
        if key not in self._known:
            self._known[key] = run(problem, keep=False).log_likelihood
        return self._known[key]


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
        self.passes = _Passes()

    @property
    def found(self) -> Tuned:
        """The settings."""
        return Tuned(self.noise, self.white_scale, self.imu_scale, self.lags, self.yaw_scale)

    def lay_out(self, observations: Observations) -> Problem:
        """Lay out the window with the settings found so far."""
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
            likelihoods, likeliest = _climb(
                lambda walk: replace(started, noise=replace(started.noise, hard_iron_walk=walk)),
                ladder,
                COMPASS_CLASS,
                self.passes,
            )
            if max(likelihoods.values()) - likelihoods[COMPASS_CLASS] > DECISIVE:
                started = self._started(replace(likeliest, x=self.x))
        self._take(started)
        return self.passes.likelihood(started)

    def search(self) -> None:
        """Find lags and noise, from what `begin` found."""
        for last in (False, True):
            found = {}
            for sensor in self.lags:
                # Some hundredths of a second of a barometer say more of its noise than of its clock.
                least = LAG_LARGE if sensor == "baro" else 0.0
                found[sensor] = _find_lag(
                    self._judging(sensor),
                    sensor,
                    self.span,
                    self.lay_out,
                    self.passes,
                    least,
                    () if last else FAR_LAGS[sensor],
                )
                self.observations = self.observations.earlier(LAGGING[sensor], found[sensor])
                self.lags[sensor] += found[sensor]
            # What was found with a clock that was off is found again with it set right.
            if max(map(abs, found.values()), default=0.0) < LAG_LARGE:
                break
            if self.found.late_barometer and not last:
                self._forget_receivers()
            self.begin()
        self._find_yaw_scale()
        problem = self.lay_out(self.observations)
        # Before the GPS: a gyro that is noisier than it looks would make the likeliest receiver a perfect one.
        for column in range(2):
            self.imu_scale[column], problem = _scale_imu(problem, column, self.passes)
        start = replace(self.aligned, x=self.x)
        for setting, ladder in LADDERS.items():
            if setting == "baro_walk" and self.found.late_barometer:
                ladder = HIDDEN_WALKS
            problem = _set_noise(problem, start, setting, ladder, self.passes)
        if np.any(problem.observations.kind == _kernels.GPS_POSITION):
            problem = _set_noise(problem, start, "gps_error_share", GPS_ERROR_SHARES, self.passes)
            problem = _split_gps_error(problem, self.passes)
        matched = matched_scale(problem, run(problem, keep=False))
        matched[_kernels.GPS_POSITION] = problem.white_scale[_kernels.GPS_POSITION]
        self._take(replace(problem, white_scale=matched))
        # A start whose tilt is still sought makes up for a lag, or the lag for it.
        if not moves_bias(self.aligned.P, levelled=self.aligned.levelled):
            for sensor in self.lags.keys() & RECEIVERS:
                self.lags[sensor] += _refine_lag(self._judging(sensor), LAGGING[sensor], self.span, self.lay_out)
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
        """Put receivers back to the times that their tables state: what was found may have been the barometer's lag."""
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
        return run(self.lay_out(self.observations), keep=False).log_likelihood

    def _rescale(self, yaw_scale: float) -> None:
        """Set another scale; what was found with the one before is of another problem."""
        self.yaw_scale, self.signal = yaw_scale, self.as_measured.rescaled(yaw_scale)
        self.passes = _Passes()

    def likelihood(self) -> float:
        """Return the log-likelihood of what was found, over readings that no lag moves out of the window."""
        kinds, reach = range(_kernels.KINDS), max(map(abs, FINE_LAGS)) + ENDS
        seen = self.observations.within(kinds, self.span[0] + reach, self.span[1] - reach)
        return run(self.lay_out(seen), keep=False).log_likelihood

    def _started(self, problem: Problem) -> Problem:
        """Linearise about the attitude that a problem itself finds from its start, and match white noise to it."""
        levelled = self.aligned.levelled
        for k in range(RELINEARISED if is_sought(self.aligned.P, levelled=levelled) else 1):
            result = run(problem)
            x, scale = problem.x, matched_scale(problem, result)
            problem = replace(problem, x=relinearised(problem, result, levelled=levelled), white_scale=scale)
            if k and settled(x, problem.x):
                break
        return problem

    def _take(self, problem: Problem) -> None:
        self.x, self.P, self.noise, self.white_scale = problem.x, problem.P, problem.noise, problem.white_scale


def relinearised(problem: Problem, result: ForwardPass, *, levelled: bool) -> np.ndarray:
    """Return the start to linearise about, shape (27,): that of the prior with its heading smoothed.

    The prior moves along. That does no harm to a heading, of which it says little. Tilt moves too where nothing but the
    force in flight told it, and it is as wide; and along with the accelerometer's bias where that is.

    Parameters
    ----------
    problem : Problem
        The segment, with its prior.
    result : ForwardPass
        The filter's pass over it.
    levelled : bool
        Whether tilt was read off the accelerometer (`Alignment.levelled`).
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
    """Return whether two starts, shape (27,), linearise about the same attitude."""
    return bool(np.linalg.norm(error_rotation(before[6:10], after[6:10])) < SETTLED)


def is_sought(P: np.ndarray, *, levelled: bool) -> bool:
    """Return whether a start's tilt is so unknown that it takes several passes to find it."""
    return moves_bias(P, levelled=levelled) or bool(P[ATTITUDE, ATTITUDE] >= TILT_KNOWN**2)


def moves_bias(P: np.ndarray, *, levelled: bool) -> bool:
    """Return whether a start's tilt is as unknown as the accelerometer's bias that made it, so that both move."""
    return levelled and bool(P[ACCEL_BIAS, ACCEL_BIAS] > BIAS_KNOWN**2)


def _compared(
    observations: Observations, kinds: tuple[int, ...], span: tuple[float, float], farthest: float
) -> Observations:
    """Return the readings that stay in the `span` that is looked at under any lag of some kinds up to the farthest.

    Likelihoods compare only if they are of the same readings: a fix that a lag moves out of the span is worth some 18,
    and left the lag 10 to 50 ms off, in which a craft that climbs is as far beside the truth.
    """
    reach = min(farthest + ENDS, ENDS_SHARE * (span[1] - span[0]))
    return observations.within(kinds, span[0] + reach, span[1] - reach)


def _find_lag(
    observations: Observations,
    sensor: str,
    span: tuple[float, float],
    lay_out: Callable[[Observations], Problem],
    passes: _Passes,
    least: float,
    far: Sequence[float],
) -> float:
    """Find the lag of one sensor; 0 where it is smaller than `least`, s. Climbs begin at none and at those `far` off.

    Tables know the lag to some hundredths of a second, so a small one is an estimate like any other; one far off must
    be decisively likelier.
    """
    kinds = LAGGING[sensor]

    def at(lag: float, readings: Observations) -> Problem:
        return lay_out(readings.earlier(kinds, lag))

    for steps in LAGS[sensor]:
        compared = _compared(observations, kinds, span, steps[-1])
        near = _highest(at, compared, kinds, steps, far, passes)
        if near not in (steps[0], steps[-1]):
            break
    else:
        # No peak within reach, so that what is wrong is something else.
        return 0.0
    if abs(near) + CLOSER < least:
        return 0.0

    def posterior(lag: float) -> float:
        return passes.likelihood(at(lag, compared)) - min(0.5 * (lag / LAG_KNOWN) ** 2, DECISIVE)

    posteriors = {lag: posterior(lag) for lag in {0.0, near}}
    for _ in range(CLOSER_STEPS):
        for lag in (near - CLOSER, near + CLOSER):
            if lag not in posteriors:
                posteriors[lag] = posterior(lag)
        best = max((near - CLOSER, near, near + CLOSER), key=posteriors.__getitem__)
        if best == near:
            break
        near = best
    lag = _vertex((near - CLOSER, near, near + CLOSER), posteriors)
    return _earned(lag, posterior(lag) - posteriors[0.0]) if abs(lag) >= least else 0.0


def _highest(
    lagging: Callable[[float, Observations], Problem],
    compared: Observations,
    kinds: tuple[int, ...],
    steps: Sequence[float],
    far: Sequence[float],
    passes: _Passes,
) -> float:
    """Return the likeliest lag uphill of none, or of one `far` off that is likelier than that peak by all readings.

    One fix that is wrong is worth hundreds where a lag makes up for it: so a far peak must be decisively likelier by
    either half of the readings alone.
    """

    def variant(lag: float) -> Problem:
        return lagging(lag, compared)

    likelihoods, _ = _climb(variant, steps, 0.0, passes)
    near = max(likelihoods, key=likelihoods.__getitem__)
    for start in far:
        if passes.likelihood(variant(start)) > likelihoods[near]:
            likelihoods |= _climb(variant, steps, start, passes)[0]
    best = max(likelihoods, key=likelihoods.__getitem__)
    t = compared.t[np.isin(compared.kind, kinds)]
    if best == near or not t.size:
        return near
    for half in pairwise(np.quantile(t, [0.0, 0.5, 1.0]).tolist()):
        readings = compared.within(kinds, *half)
        gain = passes.likelihood(lagging(best, readings)) - passes.likelihood(lagging(near, readings))
        if gain < DECISIVE:
            return near
    return best


def _refine_lag(
    observations: Observations,
    kinds: tuple[int, ...],
    span: tuple[float, float],
    lay_out: Callable[[Observations], Problem],
) -> float:
    """Return by how much the lag of a receiver differs from what was found before the log's noise was known, s."""
    compared = _compared(observations, kinds, span, PARABOLA[-1])
    values = [run(lay_out(compared.earlier(kinds, step)), keep=False).log_likelihood for step in PARABOLA.tolist()]
    bend, slope, _ = np.polyfit(PARABOLA, values, 2)
    if bend >= 0.0:
        return 0.0
    step = float(np.clip(-0.5 * slope / bend, PARABOLA[0], PARABOLA[-1]))
    return _earned(step, float(-0.25 * slope**2 / bend))


def _earned(lag: float, gain: float) -> float:
    """Return how much of a lag [s] is believed by its gain in log-likelihood; 0 below what rows resolve."""
    part = lag * believed(gain / SIGNIFICANT)
    return part if abs(part) >= RESOLVED else 0.0


def _set_noise(problem: Problem, start: Alignment, setting: str, ladder: Sequence[float], passes: _Passes) -> Problem:
    """Put one noise setting on its likeliest rung; to be quieter than its class it must gain `STRONG`.

    A few minutes show little of a bias that walks for ten, and trusting it too much costs more than too little. A prior
    never becomes narrower: that it was wide is why the start, about which it is now, was found at all.
    """

    def at(value: float) -> Problem:
        changed: dict[str, Any] = {setting: value}
        noise = replace(problem.noise, **changed)
        return replace(problem, noise=noise, P=with_priors(replace(start, P=problem.P), problem.noise, noise).P)

    documented = _nearest(ladder, getattr(problem.noise, setting))
    if setting in PRIORS:
        ladder = ladder[ladder.index(documented) :]
    likelihoods, likeliest = _climb(at, ladder, documented, passes)
    quieter = getattr(likeliest.noise, setting) < documented
    unsure = max(likelihoods.values()) - likelihoods[documented] < STRONG
    return at(documented) if unsure and (quieter or setting in PRIORS) else likeliest


def _split_gps_error(problem: Problem, passes: _Passes) -> Problem:
    """Find how the GPS position error divides into white noise and slow wander, whose size is as reported.

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
        start = _nearest(ladder, problem.white_scale[kind])
        return _climb(lambda factor: with_white(wandering, factor), ladder, start, passes)[1]

    return _climb(at, GPS_ERROR_TIMES, _nearest(GPS_ERROR_TIMES, problem.noise.gps_error_time), passes)[1]


def _scale_imu(problem: Problem, column: int, passes: _Passes) -> tuple[float, Problem]:
    """Find the factor on the noise of gyro (column 0) or accelerometer (1), and the problem with it."""

    def at(factor: float) -> Problem:
        factors = np.ones(2)
        factors[column] = factor
        return replace(problem, sub_noise=problem.sub_noise * factors)

    likelihoods, likeliest = _climb(at, IMU_SCALES, 1.0, passes)
    return max(likelihoods, key=likelihoods.__getitem__), likeliest


def _nearest(ladder: Sequence[float], value: float) -> float:
    """Return the rung nearest to a positive value, by ratio."""
    return min(ladder, key=lambda rung: abs(np.log(rung / value)))


def _climb(
    variant: Callable[[float], Problem], ladder: Sequence[float], start: float, passes: _Passes
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
                likelihoods[value] = passes.likelihood(problem)
                if best is None or likelihoods[value] >= max(likelihoods.values()):
                    best = problem
                elif value != start:
                    break
            k += step
    assert best is not None  # start is a rung
    return likelihoods, best


def _vertex(at: tuple[float, float, float], values: Mapping[float, float]) -> float:
    """Return where a parabola through three values is highest; the middle one unless that is the highest of them."""
    left, middle, right = (values.get(x, -np.inf) for x in at)
    bend = left - 2.0 * middle + right
    if middle < max(left, right) or not np.isfinite(bend) or bend >= 0.0:
        return at[1]
    return at[1] + 0.5 * (at[1] - at[0]) * (left - right) / bend
