"""How far a free run may drift: what is not known of wind, thrust and craft, carried along the run.

The errors of position and velocity follow the equations of motion linearised along the run; they are driven by the
errors of the flight's trim, of the craft's parameters, by gusts, by departures of the thrust scale and by white noise
(`sysid.rigid_body.conditions.carried`)::

    dp' = dv,    dv' = A(t) dv + J(t) (trim, gust, departure, craft),    gusts and departures fade and are renewed

A trim makes up for most of what is wrong with the craft's parameters: thrust for the scale, drag for the wind. Its
errors are those of a filter to which both are open (`conditions.carried`).
"""

from __future__ import annotations

import numpy as np

from sysid.records.arrays import Floats
from sysid.rigid_body.conditions.carried import STATES, Wander, own_design
from sysid.rigid_body.conditions.wind import WIND_EXPONENT
from sysid.rigid_body.motion._rigid_kernels import accelerations
from sysid.rigid_body.motion.body_motion import BLOCK_SECONDS, LAG, OWN, SHARED, Motion

#: Step of velocity by which its effect on the acceleration is found, m/s.
_STEP = 0.05

#: Places of position and velocity among the errors; then come the flight's states, the craft's parameters, and the
#: exponent of the wind above where it was looked at.
_POSITION, _VELOCITY, _FLIGHT = slice(0, 3), slice(3, 6), slice(6, 6 + STATES)

#: Places of the wind among the parameters of the kernels.
_WIND = slice(SHARED + len(OWN), SHARED + len(OWN) + 2)


def drift_sigma(
    flight: Motion, run: Floats, theta: Floats, law: int, errors: Floats, wander: Wander, highest: float = np.inf
) -> Floats:
    """Return standard deviations of position along a free run; shape (N, 3), NED, m.

    `run` are positions and velocities, (N, 6); `errors` mean squares of errors of the flight's states and of the
    craft's parameters where it begins, (STATES + SHARED, STATES + SHARED).
    """
    size = max(round(BLOCK_SECONDS / flight.dt), 1)
    edges = np.arange(0, len(run), size)
    if edges[-1] != len(run) - 1:
        edges = np.append(edges, len(run) - 1)
    by_theta, by_velocity = _derivatives(flight, run, theta, law, edges)
    above = np.log(np.maximum((flight.ground - run[edges, 2]) / highest, 1.0))
    steeper = by_theta[:, :, _WIND] @ theta[_WIND] * above[:, None]
    drive = np.concatenate([own_design(by_theta), by_theta[:, :, :SHARED], steeper[:, :, None]], axis=2)
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
        over = np.eye(count) + seconds * rate + 0.5 * seconds**2 * (rate @ rate)
        decay, driven = wander.step(seconds)
        over[:, _FLIGHT] = over[:, _FLIGHT] * np.sqrt(decay)
        over[_FLIGHT] = np.sqrt(decay)[:, None] * over[_FLIGHT]
        covariance = over @ covariance @ over.T
        noise = np.diag(wander.noise(seconds))
        covariance[_VELOCITY, _VELOCITY] += noise
        covariance[_POSITION, _VELOCITY] += 0.5 * seconds * noise
        covariance[_VELOCITY, _POSITION] += 0.5 * seconds * noise
        covariance[_POSITION, _POSITION] += seconds**2 / 3.0 * noise
        covariance[_FLIGHT, _FLIGHT] += np.diag(driven)
        sigma[k] = np.sqrt(np.maximum(np.diag(covariance)[_POSITION], 0.0))
    return np.column_stack([np.interp(np.arange(len(run)), edges, sigma[:, axis]) for axis in range(3)])


def _derivatives(flight: Motion, run: Floats, theta: Floats, law: int, edges: np.ndarray) -> tuple[Floats, Floats]:
    """Differentiate the acceleration along a run by the parameters, (K, 3, 16), and by the velocity, (K, 3, 3)."""
    # The kernel takes means between neighbours: here of a sample and itself.
    twice = np.repeat(edges, 2)
    rotation, density, late = (np.ascontiguousarray(each[twice]) for each in flight.signals(theta[LAG]))
    heights = np.ascontiguousarray(flight.ground - run[twice, 2])
    shapes, room = np.ones((len(twice), 1)), np.empty((len(twice) - 1, 3, len(theta)))

    def at(move: Floats) -> Floats:
        found = np.empty((len(twice) - 1, 3))
        velocities = run[twice, 3:] + move
        accelerations(theta, rotation, density, late, shapes, heights, velocities, law, 1, found, room)
        return found[::2]

    moved = [at(_STEP * unit) - at(-_STEP * unit) for unit in np.eye(3)]
    at(np.zeros(3))
    return room[::2], np.stack(moved, axis=2) / (2.0 * _STEP)
