"""Wind and thrust scale of a flight as states of a causal filter, and how far their errors let a free run drift.

The craft's parameters can be states too, constant and with the covariance of their fit: then the filter separates a
wind from a wrong drag, and finds which errors of the craft the flight contradicts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import scipy

from sysid.records.experiment import Floats
from sysid.rigid_body._filter_kernels import carry
from sysid.rigid_body._rigid_kernels import MotionSignals, accelerations
from sysid.rigid_body.body_motion import (
    BLOCK_SECONDS,
    LAG,
    OWN,
    SHARED,
    THETA,
    BodyMotion,
    Increments,
    velocity_increments,
)
from sysid.rigid_body.filter_error import HUBER
from sysid.rigid_body.model_record import LIGHT, TURBULENCE, WIND_EXPONENT

#: Memory of gusts and of departures of the thrust scale, s. Half or twice of either changes errors of free runs on
#: thirty flights by less than 5 % in the mean of logarithms.
GUST_SECONDS, SCALE_SECONDS = 20.0, 4.0

#: Innovations beyond so many standard deviations are knocks, and weigh as little as the noise that explains them.
GATE = 4.0

#: Blocks over which the noise is averaged, since manoeuvres, squalls and chirps come and go.
MEMORY = 20.0

#: States of a flight: its parameters (`OWN`, mean wind), gusts, and departure of the thrust scale.
FIXED = len(OWN) + 2
STATES = FIXED + 3


@dataclass(frozen=True, slots=True)
class Wander:
    """Strengths of the noise that drives a flight's states."""

    #: Spectral density of white noise of acceleration, m^2/s^3.
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


def own_design(by_flight: Floats) -> Floats:
    """Arrange derivatives by the parameters of a flight for the states; shape (K, 3, STATES)."""
    gusts, departure = by_flight[:, :, len(OWN) :], by_flight[:, :, 1:2]
    return np.ascontiguousarray(np.concatenate([by_flight, gusts, departure], axis=2))


def fit_wander(blocks: Increments, mean: Floats, sigma: Floats, wind: float) -> Wander:
    """Estimate the strengths by the filter's likelihood and what is known of any flight.

    `mean` and `sigma`, (4,), are the prior of the flight's parameters, relative to those the blocks were linearised at.
    """
    design = own_design(blocks.by_flight)
    # Logarithms expected of any flight, in the order of `Wander`, and their standard deviations.
    known, factors = np.log((1e-3, 1e-3, TURBULENCE * max(wind, LIGHT), 0.003)), (3.0, 3.0, 2.0, 2.0)
    means, covariances = np.empty((len(design) + 1, STATES)), np.empty((len(design) + 1, STATES, STATES))
    first = np.concatenate([mean, np.zeros(STATES - FIXED)])

    def cost(logarithms: Floats) -> float:
        wander = Wander(*np.exp(logarithms))
        decay, driven = wander.step(blocks.seconds)
        noise, start = wander.noise(blocks.seconds), wander.start(sigma)
        likelihood = carry(decay, driven, design, blocks.missed, noise, GATE, MEMORY, first, start, means, covariances)
        return -likelihood + 0.5 * float(np.sum(((logarithms - known) / factors) ** 2))

    # A simplex may collapse on a ridge: it is restarted where it ended.
    best = known
    for stride in (1.0, 0.5):
        simplex = np.vstack([best, best + stride * np.eye(len(best))])
        best = scipy.optimize.minimize(
            cost,
            best,
            method="Nelder-Mead",
            options={"maxfev": 300, "xatol": 0.05, "fatol": 0.05, "initial_simplex": simplex},
        ).x
    return Wander(*map(float, np.exp(best)))


#: Winds in which multirotors fly: standard deviation of each component, m/s.
WIND_SIGMA = 6.0

#: Prior of the parameters of any flight: wind exponent, thrust scale, wind north and east; and their limits. The
#: scale's spread includes payloads, batteries and propellers: hovering shows it in seconds, so that the narrower spread
#: by the air's temperature must not hold it.
ANY_FLIGHT = np.array([WIND_EXPONENT[0], 1.0, 0.0, 0.0])
ANY_SIGMA = np.array([WIND_EXPONENT[1], 0.3, WIND_SIGMA, WIND_SIGMA])
LOWEST, HIGHEST = np.array([0.0, 0.3, -50.0, -50.0]), np.array([1.0, 3.0, 50.0, 50.0])

#: Time at the beginning of a flight from which the strengths of gusts and noise are found, s.
SETTLING_SECONDS = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Carried:
    """The states of a flight at each block's end, from the samples up to it."""

    edges: np.ndarray  #: shape (K + 1,): Samples at which blocks end; the first is 0.
    own: Floats  #: shape (K + 1, 4): Wind exponent, thrust scale, mean wind north and east [m/s].
    gust: Floats  #: shape (K + 1, 2): Of the wind towards north and east, m/s.
    departure: Floats  #: shape (K + 1,): Of the thrust scale.
    craft: Floats  #: shape (K + 1, c): Corrections of the craft's parameters.
    covariances: Floats  #: shape (K + 1, 7 + c, 7 + c): Of these four, in this order.
    about: Floats  #: shape (4,): Where the equations were linearised.
    wander: Wander


def carry_states(
    flight: BodyMotion,
    shared: Floats,
    law: int,
    known: tuple[Floats, Floats] | None = None,
    craft_covariance: Floats | None = None,
    like: Carried | None = None,
) -> Carried:
    """Filter wind and thrust scale through a flight.

    `known` is the prior of the flight's wind exponent, thrust scale and wind, as mean and standard deviations, (4,)
    each; that of any flight if None. `craft_covariance` is of the craft's parameters `shared`, which are held if None.
    `like` are states of the same flight, whose linearisation and noise are taken over.
    """
    early = flight.cut(0, min(max(round(SETTLING_SECONDS / flight.dt), 2), len(flight.t)))

    def blocks_of(own: Floats, *, beginning: bool) -> Increments:
        return velocity_increments(early if beginning else flight, np.concatenate([shared, own]), law)

    craft_covariance = np.zeros((SHARED, SHARED)) if craft_covariance is None else craft_covariance
    states = follow(blocks_of, (ANY_FLIGHT, ANY_SIGMA) if known is None else known, craft_covariance, like)
    positive = [name.startswith(("drag", "climb")) for name in THETA]
    return replace(states, craft=np.maximum(states.craft, np.where(positive, -shared, -np.inf)))


class BlocksOf(Protocol):
    """Changes of velocity of a flight, or of its first `SETTLING_SECONDS`, about its parameters (4,)."""

    def __call__(self, own: Floats, *, beginning: bool) -> Increments:
        """Compute them."""


def follow(
    blocks_of: BlocksOf, known: tuple[Floats, Floats], craft_covariance: Floats, like: Carried | None = None
) -> Carried:
    """Filter wind and thrust scale through the changes of velocity of a flight; arguments as of `carry_states`.

    The beginning of the flight gives the strengths of gusts and noise, and where the equations are linearised.
    """
    mean, sigma = known
    own, wander = _settled(blocks_of, mean, sigma, craft_covariance) if like is None else (like.about, like.wander)
    blocks = blocks_of(own, beginning=False)
    states, covariances = _filtered(blocks, mean - own, sigma, wander, craft_covariance)
    return Carried(
        edges=blocks.edges,
        own=np.clip(own + states[:, :FIXED], LOWEST, HIGHEST),
        gust=states[:, FIXED : FIXED + 2],
        departure=states[:, FIXED + 2],
        craft=states[:, STATES:],
        covariances=covariances,
        about=own,
        wander=wander,
    )


def smoothed_wind(states: Carried, seconds: float) -> tuple[Floats, Floats]:
    """Return the smoothed wind at each block's end, (K + 1, 2), and its covariances (Rauch et al. 1965).

    The craft's parameters must have been held.
    """
    decay, driven = states.wander.step(seconds)
    x, p = np.hstack([states.own - states.about, states.gust, states.departure[:, None]]), states.covariances.copy()
    for k in range(len(x) - 2, -1, -1):
        ahead = decay[:, None] * p[k] * decay + np.diag(driven)
        gain = np.linalg.solve(ahead, decay[:, None] * p[k]).T
        x[k] += gain @ (x[k + 1] - decay * x[k])
        p[k] += gain @ (p[k + 1] - ahead) @ gain.T
    to_wind = np.zeros((2, STATES))
    to_wind[:, len(OWN) : FIXED] = to_wind[:, FIXED : FIXED + 2] = np.eye(2)
    return x @ to_wind.T + states.about[len(OWN) :], to_wind @ p @ to_wind.T


def _settled(blocks_of: BlocksOf, mean: Floats, sigma: Floats, craft_covariance: Floats) -> tuple[Floats, Wander]:
    """Find the parameters at which a flight is linearised, (4,), and its noise, from its beginning."""
    own = _start(blocks_of, mean, sigma)
    for _ in range(2):
        blocks = blocks_of(own, beginning=True)
        wander = fit_wander(blocks, mean - own, sigma, float(np.hypot(*own[len(OWN) :])))
        states, _ = _filtered(blocks, mean - own, sigma, wander, craft_covariance)
        own = np.clip(own + states[-1, :FIXED], LOWEST, HIGHEST)
    return own, wander


def _filtered(
    blocks: Increments, mean: Floats, sigma: Floats, wander: Wander, craft_covariance: Floats
) -> tuple[Floats, Floats]:
    design = np.concatenate([own_design(blocks.by_flight), blocks.by_craft], axis=2)
    steps, count = len(design), STATES + len(craft_covariance)
    means, covariances = np.empty((steps + 1, count)), np.empty((steps + 1, count, count))
    start = np.zeros((count, count))
    start[:STATES, :STATES], start[STATES:, STATES:] = wander.start(sigma), craft_covariance
    decay, driven = wander.step(blocks.seconds)
    decay, driven = (
        np.concatenate([decay, np.ones(len(craft_covariance))]),
        np.concatenate([driven, np.zeros(len(craft_covariance))]),
    )
    first, noise = np.concatenate([mean, np.zeros(count - FIXED)]), wander.noise(blocks.seconds)
    carry(decay, driven, design, blocks.missed, noise, GATE, MEMORY, first, start, means, covariances)
    return means, covariances


def _start(blocks_of: BlocksOf, mean: Floats, sigma: Floats) -> Floats:
    """Return exponent, thrust scale and wind by robust least squares, with the exponent held at its prior."""
    own, weight, free = np.clip(mean, LOWEST, HIGHEST), sigma[1:] ** -2.0, slice(1, None)
    for _ in range(5):
        blocks = blocks_of(own, beginning=True)
        # 0.4549 is the median of chi-square with one degree of freedom.
        noise = np.maximum(np.sqrt(np.median(blocks.missed**2, axis=0) / 0.4549), 1e-3)
        scaled = blocks.missed / noise
        root = np.sqrt(np.minimum(1.0, HUBER / np.maximum(np.abs(scaled), 1e-300)))
        rows = (blocks.by_flight[:, :, 1:] / noise[:, None] * root[:, :, None]).reshape(-1, FIXED - 1)
        normal = rows.T @ rows + np.diag(weight)
        gradient = rows.T @ (scaled * root).ravel() - weight * (own - mean)[free]
        own = own.copy()
        own[free] = np.clip(own[free] + np.linalg.solve(normal, gradient), LOWEST[free], HIGHEST[free])
    return own


#: Step of velocity for the derivatives of the acceleration, m/s.
_STEP = 0.05

#: Places of position and velocity among the errors; then come the flight's states, the craft's parameters, and the
#: exponent of the wind above the heights at which it was known.
_POSITION, _VELOCITY, _FLIGHT = slice(0, 3), slice(3, 6), slice(6, 6 + STATES)

#: Places of the wind among the parameters of the kernels.
_WIND = slice(SHARED + len(OWN), SHARED + len(OWN) + 2)


def drift_sigma(
    flight: BodyMotion, run: Floats, theta: Floats, law: int, errors: Floats, wander: Wander, highest: float = np.inf
) -> Floats:
    """Return standard deviations of position along a free run; shape (N, 3), NED, m.

    Errors of position and velocity follow the equations of motion linearised along the run, driven by errors of the
    flight's trim and of the craft's parameters, by gusts, by departures of the thrust scale and by white noise::

        dp' = dv,    dv' = A(t) dv + J(t) (trim, gust, departure, craft)

    Gusts and departures are first-order Gauss-Markov processes. A trim compensates most errors of the craft's
    parameters, its scale those of thrust and its wind those of drag: its errors are those of a filter that estimates
    both.

    `run` are positions and velocities, (N, 6); `errors` is the covariance of the flight's states and the craft's
    parameters at its beginning, (STATES + SHARED, STATES + SHARED); `highest` the height [m] up to which the wind was
    known.
    """
    size = max(round(BLOCK_SECONDS / flight.dt), 1)
    edges = np.arange(0, len(run), size)
    if edges[-1] != len(run) - 1:
        edges = np.append(edges, len(run) - 1)
    by_theta, by_velocity = along_run(flight, run, theta, law, edges)
    above = np.log(np.maximum((flight.ground - run[edges, 2]) / highest, 1.0))
    steeper = by_theta[:, :, _WIND] @ theta[_WIND] * above[:, None]
    own = own_design(by_theta[:, :, SHARED : SHARED + FIXED])
    drive = np.concatenate([own, by_theta[:, :, :SHARED], steeper[:, :, None]], axis=2)
    count = 7 + len(errors)
    covariance = np.zeros((count, count))
    covariance[6:-1, 6:-1] = errors
    covariance[-1, -1] = WIND_EXPONENT[1] ** 2
    sigma = np.zeros((len(edges), 3))
    for k in range(1, len(edges)):
        seconds = float(flight.t[edges[k]] - flight.t[edges[k - 1]])
        rate = np.zeros((count, count))
        rate[_POSITION, _VELOCITY] = np.eye(3)
        rate[_VELOCITY, _VELOCITY] = 0.5 * (by_velocity[k - 1] + by_velocity[k])
        rate[_VELOCITY, 6:] = 0.5 * (drive[k - 1] + drive[k])
        transition = np.eye(count) + seconds * rate + 0.5 * seconds**2 * (rate @ rate)
        decay, driven = wander.step(seconds)
        transition[:, _FLIGHT] = transition[:, _FLIGHT] * np.sqrt(decay)
        transition[_FLIGHT] = np.sqrt(decay)[:, None] * transition[_FLIGHT]
        covariance = transition @ covariance @ transition.T
        noise = np.diag(wander.noise(seconds))
        covariance[_VELOCITY, _VELOCITY] += noise
        covariance[_POSITION, _VELOCITY] += 0.5 * seconds * noise
        covariance[_VELOCITY, _POSITION] += 0.5 * seconds * noise
        covariance[_POSITION, _POSITION] += seconds**2 / 3.0 * noise
        covariance[_FLIGHT, _FLIGHT] += np.diag(driven)
        sigma[k] = np.sqrt(np.maximum(np.diag(covariance)[_POSITION], 0.0))
    return np.column_stack([np.interp(np.arange(len(run)), edges, sigma[:, axis]) for axis in range(3)])


def along_run(flight: BodyMotion, run: Floats, theta: Floats, law: int, edges: np.ndarray) -> tuple[Floats, Floats]:
    """Differentiate the acceleration along a run by the parameters, (K, 3, 16), and by the velocity, (K, 3, 3)."""
    # The kernel averages two neighbours: here a sample and itself.
    twice = np.repeat(edges, 2)
    signals = MotionSignals(*(signal[twice] for signal in flight.signals(theta[LAG])))
    signals.heights[:] = flight.ground - run[twice, 2]
    shapes, room = np.ones((len(twice), 1)), np.empty((len(twice) - 1, 3, len(theta)))

    def at(change: Floats) -> Floats:
        accelerated = np.empty((len(twice) - 1, 3))
        signals.states[:, 3:6] = run[twice, 3:] + change
        accelerations(theta, signals, shapes, law, 1, accelerated, room)
        return accelerated[::2]

    moved = [at(_STEP * unit) - at(-_STEP * unit) for unit in np.eye(3)]
    at(np.zeros(3))
    return room[::2], np.stack(moved, axis=2) / (2.0 * _STEP)
