"""How far a free run may drift: what is not known of wind, thrust and craft, carried along the run.

The errors of position and velocity follow the equations of motion linearised along the run; they are driven by the
errors of the flight's trim, of the craft's parameters, by gusts, by departures of the thrust scale and by white noise
(`sysid.rigid_body.conditions.wander`)::

    dp' = dv,    dv' = A(t) dv + J(t) (trim, gust, departure, craft),    gusts and departures fade and are renewed

A trim makes up for most of what is wrong with the craft's parameters: thrust for the scale, drag for the wind. Its
errors are those of the filter less what it takes over from the craft's, by the least squares that a trim is.
"""

from __future__ import annotations

import numpy as np

from sysid.records.arrays import Floats
from sysid.rigid_body.conditions.wander import FIXED, GUST_SECONDS, SCALE_SECONDS, STATES, Wander, own_design
from sysid.rigid_body.motion._rigid_kernels import accelerations
from sysid.rigid_body.motion.body_motion import LAG, SHARED, Motion
from sysid.rigid_body.motion.increments import BLOCK_SECONDS, Increments

#: Step of velocity by which its effect on the acceleration is found, m/s.
_STEP = 0.05

#: Places of position and velocity among the errors; then come the flight's states and the craft's parameters.
_POSITION, _VELOCITY, _FLIGHT, _CRAFT = slice(0, 3), slice(3, 6), slice(6, 6 + STATES), slice(6 + STATES, None)


def trim_errors(blocks: Increments, known: Floats, wander: Wander, doubt: Floats) -> Floats:
    """Join the errors of a flight's trim with those of the craft's parameters that it made up for.

    Parameters
    ----------
    blocks : Increments
        What the trim was found from.
    known : ndarray, shape (STATES, STATES)
        Covariance of the flight's states were the craft known.
    wander : Wander
    doubt : ndarray, shape (SHARED, SHARED)
        Covariance of the craft's parameters.

    Returns
    -------
    ndarray, shape (STATES + SHARED, STATES + SHARED)
    """
    design = own_design(blocks.jacobian)
    # Means over many blocks know what wanders as white noise of the same density at low frequencies.
    effect = np.sqrt(np.mean(design[:, :, FIXED:] ** 2, axis=0)) / blocks.seconds
    density = effect**2 @ np.array([2.0 * GUST_SECONDS * wander.gust**2] * 2 + [2.0 * SCALE_SECONDS * wander.scale**2])
    noise = np.sqrt(wander.noise(blocks.seconds) + blocks.seconds * density)[:, None]
    own = (design[:, :, :FIXED] / noise).reshape(-1, FIXED)
    craft = (blocks.jacobian[:, :, :SHARED] / noise).reshape(-1, SHARED)
    # What the data do not tell of a trim, they do not make it take over either.
    least = np.diag(np.maximum(np.diag(known)[:FIXED], 1e-12) ** -1.0) * 1e-3
    taken = -np.linalg.solve(own.T @ own + least, own.T @ craft)
    joint = np.zeros((STATES + SHARED, STATES + SHARED))
    joint[:STATES, :STATES] = known
    joint[:FIXED, :FIXED] += taken @ doubt @ taken.T
    joint[:FIXED, STATES:] = taken @ doubt
    joint[STATES:, :FIXED] = joint[:FIXED, STATES:].T
    joint[STATES:, STATES:] = doubt
    return joint


def drift_sigma(flight: Motion, run: Floats, theta: Floats, law: int, errors: Floats, wander: Wander) -> Floats:
    """Return standard deviations of position along a free run; shape (N, 3), NED, m.

    Parameters
    ----------
    flight : Motion
        From the first sample of the run.
    run : ndarray, shape (N, 6)
        Positions and velocities of the run.
    theta : ndarray, shape (16,)
        Parameters with the mean wind.
    law : int
        Of drag.
    errors : ndarray, shape (STATES + SHARED, STATES + SHARED)
        As of `trim_errors`.
    wander : Wander
    """
    size = max(round(BLOCK_SECONDS / flight.dt), 1)
    edges = np.arange(0, len(run), size)
    if edges[-1] != len(run) - 1:
        edges = np.append(edges, len(run) - 1)
    by_theta, by_velocity = _derivatives(flight, run, theta, law, edges)
    drive = np.concatenate([own_design(by_theta), by_theta[:, :, :SHARED]], axis=2)
    count = 6 + len(errors)
    covariance = np.zeros((count, count))
    covariance[6:, 6:] = errors
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
    signals = np.ascontiguousarray(flight.signals(theta[LAG])[edges])
    heights = np.ascontiguousarray(flight.ground - run[edges, 2])
    shapes, room = np.ones((len(edges), 1)), np.empty((len(edges), 3, len(theta)))

    def at(velocity: Floats) -> Floats:
        found = np.empty((len(edges), 3))
        accelerations(theta, signals, shapes, heights, np.ascontiguousarray(velocity), law, found, room)
        return found

    moved = [at(run[edges, 3:] + _STEP * unit) - at(run[edges, 3:] - _STEP * unit) for unit in np.eye(3)]
    at(run[edges, 3:])
    return room, np.stack(moved, axis=2) / (2.0 * _STEP)
