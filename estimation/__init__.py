"""Estimation: canonical tables to a trajectory with honest uncertainty.

Frames: positions and velocities in a local NED frame (`LocalFrame`), body axes FRD; ``quat_nb`` turns body vectors to
NED. The nominal state of the filter is one array ``x`` (29 numbers: position, velocity, quaternion, then the sensor
errors of `SENSOR_ERROR_COLUMNS`), its error the 28 numbers of `states`.
"""

from estimation.consistency import TrajectoryErrors, compare, errors, nees
from estimation.estimator import estimate
from estimation.states import SENSOR_ERROR_COLUMNS, SensorNoise
from estimation.trajectory import SIGMA_COLUMNS, STATE_COLUMNS, Trajectory

__all__ = [
    "SENSOR_ERROR_COLUMNS",
    "SIGMA_COLUMNS",
    "STATE_COLUMNS",
    "SensorNoise",
    "Trajectory",
    "TrajectoryErrors",
    "compare",
    "errors",
    "estimate",
    "nees",
]
