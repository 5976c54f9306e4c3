"""Wind and thrust scale of a flight as states that a filter carries forward, from samples of the past alone.

The craft's parameters can be states too, which do not change, within what their fit left open: it tells how far a wind
made up for wrong drag, and which errors of the craft the flight contradicts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.records.experiment import Floats
from sysid.rigid_body.conditions._carry_kernels import carry
from sysid.rigid_body.conditions.wander import FIXED, GATE, MEMORY, STATES, Wander, fit_wander, own_design
from sysid.rigid_body.conditions.wind import WIND_EXPONENT
from sysid.rigid_body.methods.filter_error import HUBER
from sysid.rigid_body.motion.body_motion import OWN, SHARED, THETA, Increments, Motion, velocity_increments

#: Winds in which multirotors fly: standard deviation of each component, m/s.
WIND_SIGMA = 6.0

#: Standard deviation of the thrust scale of any flight, payloads, batteries and propellers included. Gravity tells the
#: scale of a flight in seconds, so that what air temperature explains must not hold it.
SCALE_SIGMA = 0.3

#: Parameters of any flight before it begins: exponent, thrust scale, wind north and east; and their limits.
ANY_FLIGHT = np.array([WIND_EXPONENT[0], 1.0, 0.0, 0.0])
ANY_SIGMA = np.array([WIND_EXPONENT[1], SCALE_SIGMA, WIND_SIGMA, WIND_SIGMA])
LOWEST, HIGHEST = np.array([0.0, 0.3, -50.0, -50.0]), np.array([1.0, 3.0, 50.0, 50.0])

#: Time at the beginning of a flight from which the strengths of gusts and noise are found, s.
SETTLING_SECONDS = 30.0

#: Parameters of the craft that are below zero in none.
_POSITIVE = np.array([name.startswith(("drag", "climb")) for name in THETA])

#: Steps of robust least squares to where the filter is linearised, and linearisations of the filter.
_START_STEPS, _LINEARISATIONS = 5, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Carried:
    """What the samples up to each block's end say of a flight."""

    edges: np.ndarray  #: shape (K + 1,): Samples at which blocks end; the first is 0.
    own: Floats  #: shape (K + 1, 4): Wind exponent, thrust scale, mean wind north and east [m/s].
    gust: Floats  #: shape (K + 1, 2): Of the wind towards north and east, m/s.
    departure: Floats  #: shape (K + 1,): Of the thrust scale.
    craft: Floats  #: shape (K + 1, SHARED): What to add to the craft's parameters.
    covariances: Floats  #: shape (K + 1, 7 + SHARED, 7 + SHARED): Of the four in turn.
    wander: Wander


def carry_states(
    flight: Motion,
    shared: Floats,
    law: int,
    known: tuple[Floats, Floats] | None = None,
    doubt: Floats | None = None,
) -> Carried:
    """Follow wind and thrust scale through a flight.

    The strengths of gusts and noise, and where the equations are linearised, come from the first `SETTLING_SECONDS`.

    `known` are wind exponent, thrust scale and wind of the flight beforehand, and their standard deviations, (4,) each;
    what is known of any flight if None. `doubt` is the covariance of the craft's parameters `shared`, held if None.
    """
    mean, sigma = (ANY_FLIGHT, ANY_SIGMA) if known is None else known
    doubt = np.zeros((SHARED, SHARED)) if doubt is None else doubt
    size = min(max(round(SETTLING_SECONDS / flight.dt), 2), len(flight.t))
    early = flight.cut(0, size)
    own = _start(early, shared, law, mean, sigma)
    for _ in range(_LINEARISATIONS):
        blocks = velocity_increments(early, np.concatenate([shared, own]), law)
        wander = fit_wander(blocks, mean - own, sigma, float(np.hypot(*own[len(OWN) :])))
        states, _ = _filtered(blocks, mean - own, sigma, wander, doubt)
        own = np.clip(own + states[-1, :FIXED], LOWEST, HIGHEST)
    blocks = velocity_increments(flight, np.concatenate([shared, own]), law)
    states, covariances = _filtered(blocks, mean - own, sigma, wander, doubt)
    return Carried(
        edges=blocks.edges,
        own=np.clip(own + states[:, :FIXED], LOWEST, HIGHEST),
        gust=states[:, FIXED : FIXED + 2],
        departure=states[:, FIXED + 2],
        craft=np.maximum(states[:, STATES:], np.where(_POSITIVE, -shared, -np.inf)),
        covariances=covariances,
        wander=wander,
    )


def _filtered(blocks: Increments, mean: Floats, sigma: Floats, wander: Wander, doubt: Floats) -> tuple[Floats, Floats]:
    design = np.concatenate([own_design(blocks.jacobian), blocks.jacobian[:, :, :SHARED]], axis=2)
    steps, count = len(design), STATES + SHARED
    means, covariances, start = (
        np.empty((steps + 1, count)),
        np.empty((steps + 1, count, count)),
        np.zeros((count, count)),
    )
    start[:STATES, :STATES], start[STATES:, STATES:] = wander.start(sigma), doubt
    decay, driven = wander.step(blocks.seconds)
    decay, driven = np.concatenate([decay, np.ones(SHARED)]), np.concatenate([driven, np.zeros(SHARED)])
    first, noise = np.concatenate([mean, np.zeros(count - FIXED)]), wander.noise(blocks.seconds)
    carry(decay, driven, design, blocks.missed, noise, GATE, MEMORY, first, start, means, covariances)
    return means, covariances


def _start(flight: Motion, shared: Floats, law: int, mean: Floats, sigma: Floats) -> Floats:
    """Return exponent, thrust scale and wind by robust least squares, the exponent as known beforehand."""
    own, weight, free = np.clip(mean, LOWEST, HIGHEST), sigma[1:] ** -2.0, slice(1, None)
    for _ in range(_START_STEPS):
        blocks = velocity_increments(flight, np.concatenate([shared, own]), law)
        noise = np.maximum(np.sqrt(np.median(blocks.missed**2, axis=0) / 0.4549), 1e-3)
        scaled = blocks.missed / noise
        root = np.sqrt(np.minimum(1.0, HUBER / np.maximum(np.abs(scaled), 1e-300)))
        by_own = blocks.jacobian[:, :, SHARED + 1 : SHARED + FIXED]
        rows = (by_own / noise[:, None] * root[:, :, None]).reshape(-1, FIXED - 1)
        normal = rows.T @ rows + np.diag(weight)
        uphill = rows.T @ (scaled * root).ravel() - weight * (own - mean)[free]
        own = own.copy()
        own[free] = np.clip(own[free] + np.linalg.solve(normal, uphill), LOWEST[free], HIGHEST[free])
    return own
