"""How the wind and the thrust of a flight wander about their means.

The wind is a mean and a gust with exponential memory (Gauss-Markov; the first-order form of Dryden's spectrum along the
wind), the thrust scale a constant and a short-lived departure: what the thrust curve, the motors' lag and the logged
commands miss. Together with white noise in the changes of velocity they are the process noise of a linear filter, whose
likelihood tells their strengths (filter error: Maine and Iliff 1986; Jategaonkar 2015, ch. 5), within a factor that is
known beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from sysid.records.experiment import Floats
from sysid.rigid_body.conditions._carry_kernels import carry
from sysid.rigid_body.conditions.wind import LIGHT, TURBULENCE
from sysid.rigid_body.motion.body_motion import OWN, SHARED, Increments

#: Memory of gusts and of departures of the thrust scale, s. Half or twice of either changes errors of free runs on
#: thirty flights by less than 5 % in the mean of logarithms.
GUST_SECONDS, SCALE_SECONDS = 20.0, 4.0

#: Innovations beyond so many standard deviations are knocks and count with the noise that explains them.
GATE = 4.0

#: Blocks over which the noise is found anew: manoeuvres, gusts of rain and chirps pass, and are not known beforehand.
MEMORY = 20.0

#: States of a flight: its parameters (`OWN`, mean wind), gusts, and departure of the thrust scale.
FIXED = len(OWN) + 2
STATES = FIXED + 3

#: White noise of accelerations, m^2/s^3, horizontally and vertically; gusts over `TURBULENCE` times the wind;
#: departures of the thrust scale: what is expected of any flight, and the factor that it may differ by (one standard
#: deviation of the logarithm).
_EXPECTED = (1e-3, 1e-3, 1.0, 0.003)
_FACTORS = (3.0, 3.0, 2.0, 2.0)

#: Evaluations of the likelihood in one search, and how near the best it has to end.
_MOST_EVALUATIONS, _NEAR = 300, 0.05

#: First steps of the search for the strengths' logarithms, and of the search from where it ended.
_STRIDES = (1.0, 0.5)


@dataclass(frozen=True, slots=True)
class Wander:
    """Strengths of what wanders."""

    #: Spectral density of white noise in acceleration, m^2/s^3.
    horizontal_noise: float
    vertical_noise: float
    gust: float  #: Standard deviation of gusts towards north and east, m/s.
    scale: float  #: Standard deviation of the thrust scale's departures.

    def step(self, seconds: float) -> tuple[Floats, Floats]:
        """Return the decay of each state over a step, and the variance that the step adds."""
        memory = np.array([GUST_SECONDS, GUST_SECONDS, SCALE_SECONDS])
        decay = np.concatenate([np.ones(FIXED), np.exp(-seconds / memory)])
        spread = np.concatenate([np.zeros(FIXED), [self.gust, self.gust, self.scale]])
        return decay, spread**2 * (1.0 - decay**2)

    def noise(self, seconds: float) -> Floats:
        """Return variances of the changes of velocity over a step, NED, m^2/s^2."""
        return seconds * np.array([self.horizontal_noise, self.horizontal_noise, self.vertical_noise])

    def start(self, sigma: Floats) -> Floats:
        """Return the covariance before the first step for standard deviations of a flight's parameters."""
        return np.diag(np.concatenate([sigma, [self.gust, self.gust, self.scale]]) ** 2)


def own_design(jacobian: Floats) -> Floats:
    """Arrange derivatives by the parameters of the kernels for the states; shape (K, 3, STATES)."""
    own = jacobian[:, :, SHARED : SHARED + FIXED]
    return np.ascontiguousarray(np.concatenate([own, own[:, :, len(OWN) :], own[:, :, 1:2]], axis=2))


def fit_wander(blocks: Increments, mean: Floats, sigma: Floats, wind: float) -> Wander:
    """Find the strengths by the filter's likelihood and what is known of any flight.

    `mean` and `sigma`, (4,), are known beforehand of the flight's parameters, the former counted from the blocks'.
    """
    design, known = own_design(blocks.jacobian), np.log(_EXPECTED)
    known[2] += np.log(TURBULENCE * max(wind, LIGHT))
    means, covariances = np.empty((len(design) + 1, STATES)), np.empty((len(design) + 1, STATES, STATES))
    first = np.concatenate([mean, np.zeros(STATES - FIXED)])

    def cost(logarithms: Floats) -> float:
        wander = Wander(*np.exp(logarithms))
        decay, driven = wander.step(blocks.seconds)
        noise, start = wander.noise(blocks.seconds), wander.start(sigma)
        likelihood = carry(decay, driven, design, blocks.missed, noise, GATE, MEMORY, first, start, means, covariances)
        return -likelihood + 0.5 * float(np.sum(((logarithms - known) / _FACTORS) ** 2))

    # A simplex may close on a ridge: it is opened again where it ended.
    found = known
    for stride in _STRIDES:
        simplex = np.vstack([found, found + stride * np.eye(len(found))])
        found = scipy.optimize.minimize(
            cost,
            found,
            method="Nelder-Mead",
            options={"maxfev": _MOST_EVALUATIONS, "xatol": _NEAR, "fatol": _NEAR, "initial_simplex": simplex},
        ).x
    return Wander(*map(float, np.exp(found)))
