"""Misalignment of the compass about the down axis, from the heading that GPS and IMU show.

A craft that accelerates shows its heading without a compass: GPS measures the acceleration along north and east, the
accelerometer along the body's axes. A filter that uses a misaligned compass hides the contradiction by tilting the
craft. So the first part of the flight is filtered again without the compass, and its readings are compared with the
attitude that results.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from core.attitude import euler_from_quat, matrix_from_quat
from core.findings import warning
from core.robust import robust_sigma
from estimation import _kernels
from estimation.alignment import Alignment, turned, with_priors
from estimation.filter import COARSE, FilterSegment, assemble, run
from estimation.lags import DECISIVE
from estimation.observations import Observations
from estimation.place import World
from estimation.smoother import smooth
from estimation.states import FIELD, HARD_IRON, SensorNoise
from estimation.timing import InertialSignal
from estimation.trust import inconsistent
from estimation.tuning import Tuned, relinearised, settled, window
from logparse import Finding

#: A compass is corrected if turned by more than this, rad, and by so many sigmas of the turn.
TURNED, CERTAIN = np.radians(8.0), 4.0
#: Sigmas from which on a turn is examined further, and from which on it is reported and added to the heading's sigma.
SUSPECTED, DOUBTFUL = 2.0, 3.0
#: A larger turn, rad, is not one of the mount: axes or signs of compass or IMU are exchanged. Which of the two is not
#: known, so the trajectory is withdrawn. Readings that scatter as much show no turn.
EXCHANGED = np.radians(60.0)
#: 1-sigma of the initial heading without a compass, rad.
HEADING_UNKNOWN = 1.0
#: Most iterations of relinearisation.
PASSES = 4
#: Shortest time between the readings used, and correlation time of their errors, s.
STEP, LASTING = 0.2, 1.0
FEWEST = 20  #: Readings.


@dataclass(frozen=True, slots=True)
class CompassTurn:
    """Angle by which the compass is turned about the craft's down axis, clockwise from above."""

    angle: float  #: rad
    sigma: float  #: 1-sigma of the angle, rad.
    spread: float  #: RMS of the readings' directions after turn and hard iron are removed, rad.

    @property
    def suspected(self) -> bool:
        """Whether it should be examined further."""
        return bool(abs(self.angle) > max(TURNED, SUSPECTED * self.sigma))

    @property
    def certain(self) -> bool:
        """Whether it is turned: a turn smaller than the scatter that it leaves is some other error."""
        explained = self.spread < min(abs(self.angle), EXCHANGED)
        return bool(explained and abs(self.angle) > max(TURNED, CERTAIN * self.sigma))

    @property
    def doubtful(self) -> bool:
        """Whether it may be turned, but is not `certain`."""
        measurable = not (self.certain or self.exchanged) and self.spread < EXCHANGED
        return bool(measurable and abs(self.angle) > max(TURNED, DOUBTFUL * self.sigma))

    @property
    def heading_sigma(self) -> float:
        """1-sigma that it adds to the heading, rad."""
        return float(np.hypot(self.sigma, self.angle)) if self.doubtful else self.sigma

    @property
    def exchanged(self) -> bool:
        """Whether axes must be exchanged, of the compass or of the IMU."""
        return bool(abs(self.angle) > EXCHANGED)

    def corrected(self, mag: pd.DataFrame) -> pd.DataFrame:
        """Return the readings turned back."""
        level = (mag["mag_x"] + 1j * mag["mag_y"]).to_numpy() * np.exp(-1j * self.angle)
        return mag.assign(mag_x=level.real, mag_y=level.imag)


def compass_turn(
    signal: InertialSignal,
    observations: Observations,
    aligned: Alignment,
    world: World,
    field: np.ndarray,
    tuned: Tuned,
    noise: SensorNoise,
) -> CompassTurn | None:
    """Estimate the turn of the compass against the heading by all other sensors; None without enough readings."""
    begin, stop = window(signal)
    selected = observations.between(max(begin, signal.start), min(stop, signal.stop))
    readings = np.flatnonzero((selected.kind == _kernels.MAG) & (np.diff(selected.start) == 3))
    readings = readings[np.unique(np.floor(selected.t[readings] / STEP), return_index=True)[1]]
    # Output times of the filter, of which the first is its start.
    readings = readings[np.diff(selected.t[readings], prepend=signal.start) > 0.5 * STEP]
    if readings.size < FEWEST:
        return None
    t = selected.t[readings]
    measured = selected.z[selected.start[readings][:, None] + np.arange(3)]
    rate = len(t) / max(np.ptp(t), LASTING)

    def turn_from(start: Alignment) -> tuple[CompassTurn, float, float]:
        """Return the turn found from an initial alignment, the likelihood without compass, and the initial heading."""
        problem = _without_compass(signal, observations, start, world, tuned, noise, t, stop)
        for _ in range(PASSES):
            result = run(problem)
            before, x = problem.x, relinearised(problem, result, levelled=aligned.levelled)
            if settled(before, x):
                break
            problem = replace(problem, x=x)
        smoothed = smooth(problem, result)
        attitude = matrix_from_quat(smoothed.x[1:, 6:10])
        yaw_sigma = float(np.sqrt(np.median(smoothed.covariance[1:, 2, 2, 2])))
        turn = _fitted(measured, np.einsum("nji,j->ni", attitude, field), noise, rate)
        yaw = float(euler_from_quat(smoothed.x[0, 6:10])[2])
        return replace(turn, sigma=float(np.hypot(turn.sigma, yaw_sigma))), result.log_likelihood, yaw

    turn, likelihood, yaw = turn_from(aligned)
    if not turn.suspected:
        return turn
    # With little acceleration the likelihood has several maxima: the one near the compass's heading is taken unless the
    # other is decisively likelier.
    near, likelihood_near, _ = turn_from(turned(aligned, yaw - turn.angle, HEADING_UNKNOWN))
    better = abs(near.angle) < abs(turn.angle) and likelihood - likelihood_near < DECISIVE
    return near if better else turn


def _without_compass(
    signal: InertialSignal,
    observations: Observations,
    aligned: Alignment,
    world: World,
    tuned: Tuned,
    noise: SensorNoise,
    t: np.ndarray,
    stop: float,
) -> FilterSegment:
    """Set up the filter of the first part of the flight without compass, with outputs at the start and at times t."""
    start = with_priors(aligned, noise, tuned.noise)
    start = turned(start, float(euler_from_quat(start.x[6:10])[2]), HEADING_UNKNOWN)
    P = start.P.copy()
    for block in (HARD_IRON, FIELD):
        P[block : block + 3] = P[:, block : block + 3] = 0.0
    outputs = np.concatenate([[signal.start], t])
    return assemble(
        signal,
        observations.without(_kernels.MAG),
        outputs,
        start.x,
        P,
        world,
        tuned.noise,
        white_scale=tuned.white_scale,
        imu_scale=tuned.imu_scale,
        stop=stop,
        finest=COARSE,
    )


def _fitted(measured: np.ndarray, expected: np.ndarray, noise: SensorNoise, rate: float) -> CompassTurn:
    """Fit a turn about the body's down axis and a hard iron to readings, shape (n, 3), at `rate` readings per second.

    If the craft never yaws, only the prior of the hard iron (`SensorNoise.hard_iron`) separates the two.
    """
    m, z = (v[:, 0] + 1j * v[:, 1] for v in (expected, measured))
    angle, iron = float(np.angle(np.sum(z * m.conj()))), 0.0 + 0.0j
    for _ in range(PASSES):
        turned_field = m * np.exp(1j * angle)
        residual = z - turned_field - iron
        scale = max(noise.mag, robust_sigma(np.concatenate([residual.real, residual.imag])))
        weight = (
            np.minimum(1.0, 2.0 * scale / np.maximum(np.abs(residual), scale)) / scale**2 / max(rate * LASTING, 1.0)
        )
        slope = 1j * turned_field
        H = np.array(
            [
                [np.sum(weight * np.abs(slope) ** 2), np.sum(weight * slope.real), np.sum(weight * slope.imag)],
                [np.sum(weight * slope.real), np.sum(weight) + noise.hard_iron**-2, 0.0],
                [np.sum(weight * slope.imag), 0.0, np.sum(weight) + noise.hard_iron**-2],
            ]
        )
        prior = iron * noise.hard_iron**-2
        g = np.array(
            [
                np.sum(weight * (slope.conj() * residual).real),
                np.sum(weight * residual.real) - prior.real,
                np.sum(weight * residual.imag) - prior.imag,
            ]
        )
        step = np.linalg.solve(H, g)
        angle, iron = angle + float(step[0]), iron + complex(step[1], step[2])
    residual = np.angle((z - iron) * m.conj() * np.exp(-1j * angle))
    return CompassTurn(
        float(np.angle(np.exp(1j * angle))),
        float(np.sqrt(np.linalg.inv(H)[0, 0])),
        float(np.sqrt(np.mean(residual**2))),
    )


def compass_finding(turn: CompassTurn) -> Finding:
    """Report a turned compass: corrected, doubtful, or withdrawing the trajectory."""
    degrees, sigma = float(np.degrees(turn.angle)), float(np.degrees(turn.sigma))
    evidence = {"turn_deg": degrees, "sigma_deg": sigma}
    heading = (
        f"a heading {abs(degrees):.0f} ± {sigma:.0f} degrees {'left' if degrees > 0.0 else 'right'} of the one that "
        "GPS and IMU show when the craft accelerates"
    )
    if turn.exchanged:
        return inconsistent(f"the compass shows {heading}, as if its axes or the IMU's were exchanged", evidence)
    if turn.doubtful:
        return warning(
            "sensor-doubtful",
            f"The compass shows {heading}: too little to turn it or the IMU by, and headings are no better known than "
            "that.",
            "Look at how compass and autopilot are mounted (COMPASS_ORIENT, AHRS_ORIENTATION), and at currents and "
            "iron near the compass; a flight that accelerates along both axes for a minute tells more.",
            **evidence,
        )
    return warning(
        "sensor-doubtful",
        f"The compass shows {heading}. Compass or IMU is turned on the craft; which of the two cannot be told. The "
        "compass is turned back by so much: if it is the IMU, headings are still off by that.",
        "Look at how compass and autopilot are mounted (COMPASS_ORIENT, AHRS_ORIENTATION), and at currents and iron "
        "near the compass; calibrate it again.",
        **evidence,
    )
