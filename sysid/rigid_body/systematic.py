"""Errors that all of a flight shares, so that no scatter within it shows them.

An attitude that is off by a constant leans the thrust with it, and blows a wind that was not there: with drag of
0.25 1/s a milliradian is 0.04 m/s. Equations leave out what rotors really do (inflow, sampling of their commands
between log lines, unlike motors); what that comes to on craft of known truth is added to what the fit says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sysid.records.experiment import Floats
from sysid.rigid_body._rigid_kernels import GRAVITY
from sysid.rigid_body.body_motion import SHARED, THETA, Motion
from sysid.rigid_body.filter_error import FilterErrorFit
from sysid.rigid_body.output_error import flight_slice

#: Part of the whole drag at the usual speed along an axis by which the laws of drag misrepresent it: half of the
#: variance is linear, half quadratic.
DRAG_PART = 0.02

#: Slowest usual speed for this, m/s.
_SLOWEST = 0.3

#: What the equations of thrust misrepresent: commands between the lines of a log (10 Hz), slew and lag of motors that
#: are not of first order, inflow that differs between motors.
FORM: Mapping[str, float] = {"thrust_expo": 0.015, "climb_loss": 0.003, "motor_lag": 0.012}

#: Error of a wind's exponent by the height of the ground under its profile.
EXPONENT_ERROR = 0.09


#: Motors of one kind differ by this part (standard deviation), which cannot be told from a centre of gravity to one
#: side.
UNLIKE_MOTORS = 0.04


def with_shared_errors(motions: Sequence[Motion], fit: FilterErrorFit, held: NDArray[np.bool_]) -> FilterErrorFit:
    """Return the fit with what flights do not show of its errors added to its covariance.

    Parameters
    ----------
    motions : sequence of Motion
    fit : FilterErrorFit
    held : ndarray, shape (SHARED,)
        Parameters that were given and not estimated.
    """
    covariance = fit.covariance.copy()
    places = np.flatnonzero(~held)
    covariance[places, places] += _form_and_attitude(motions, fit.values)[places] ** 2
    exponents = [flight_slice(k, 1).start for k in range(len(motions))]
    covariance[exponents, exponents] += EXPONENT_ERROR**2
    return replace(fit, covariance=covariance)


def unlike_motors(count: int) -> float:
    """Compute the standard deviation, in arms, of a centre of gravity that unlike motors feign."""
    return UNLIKE_MOTORS / float(np.sqrt(2.0 * max(count, 1)))


def _form_and_attitude(motions: Sequence[Motion], values: Floats) -> Floats:
    """Compute standard deviations of errors that the laws and the attitude make in the shared parameters, (SHARED,)."""
    sigma = np.zeros(SHARED)
    for name, part in FORM.items():
        sigma[THETA.index(name)] = part
    # Estimators start anew in each flight: their errors average.
    tilt = np.sqrt(np.mean([np.mean(motion.attitude_sigma[:2] ** 2) for motion in motions]) / len(motions))
    sigma[[THETA.index("tilt_x"), THETA.index("tilt_y")]] = tilt
    for place, axis in enumerate("xyz"):
        speed = max(usual_speed(motions, place), _SLOWEST)
        linear, square = (THETA.index(f"drag_{law}_{axis}") for law in ("linear", "quadratic"))
        drag = DRAG_PART * (values[linear] * speed + values[square] * speed**2)
        sigma[linear], sigma[square] = np.sqrt(0.5) * drag / speed, np.sqrt(0.5) * drag / speed**2
    return sigma


def usual_speed(motions: Sequence[Motion], axis: int) -> float:
    """Root mean square of the speed along a body axis over the ground, m/s."""
    along = [
        np.einsum("ni,ni->n", motion.rotation.reshape(-1, 3, 3)[:, :, axis], motion.velocity) for motion in motions
    ]
    return float(np.sqrt(np.mean(np.concatenate(along) ** 2)))


def wind_error(motion: Motion, wind: Floats, drag: float) -> float:
    """Compute the standard deviation of each component of a wind that the attitude's error makes, m/s.

    Parameters
    ----------
    motion : Motion
    wind : ndarray, shape (2,)
        m/s; a yaw that is off turns it.
    drag : float
        Deceleration per speed about the flight's mean, 1/s.
    """
    lean = GRAVITY * float(np.sqrt(np.mean(motion.attitude_sigma[:2] ** 2))) / max(drag, 1e-6)
    turned = float(np.hypot(*wind)) * float(motion.attitude_sigma[2])
    return float(np.hypot(lean, turned))
