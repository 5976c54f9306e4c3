"""The true loop of a simulated axis: its craft's formula times ArduCopter's controller."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simulation.axis_loop.axis import GYRO_HZ, LOOP_HZ, AxisPlant, Floats, LoopGains
from sysid.loops.controller import AngleController, RateController
from sysid.loops.settings import GyroPath, LoopSettings

#: Fields of `LoopGains` that are parameters of the rate controller.
TERMS = ("P", "I", "D", "FF", "FLTT", "FLTE", "FLTD", "IMAX")


def settings_of(plant: AxisPlant, gains: LoopGains, axis: str = "roll") -> LoopSettings:
    """Return the loop's settings as a log of the flight has them.

    Parameters
    ----------
    plant : AxisPlant
        The axis, with its gyro filter.
    gains : LoopGains
        Of the controllers.
    axis : str
        roll, pitch or yaw.
    """
    return LoopSettings(
        axis=axis,
        controller=RateController(**{name: getattr(gains, name) for name in TERMS}),
        angle=AngleController(P=gains.angle_P, late=1.0 / LOOP_HZ),
        gyro=GyroPath(plant.filter_hz, GYRO_HZ),
    )


def gains_of(settings: LoopSettings) -> LoopGains:
    """Return the gains with which a craft flies settings, as tuned."""
    return LoopGains(**{name: getattr(settings.controller, name) for name in TERMS}, angle_P=settings.angle.P)


def true_loop(plant: AxisPlant, gains: LoopGains, hz: Floats) -> NDArray[np.complex128]:
    """Return the response of the loop broken at the mixer, shape (n,).

    Parameters
    ----------
    plant : AxisPlant
        The axis.
    gains : LoopGains
        Of the controllers.
    hz : ndarray, shape (n,)
        Frequencies, Hz.
    """
    return plant.response(hz) * settings_of(plant, gains).feedback(hz)
