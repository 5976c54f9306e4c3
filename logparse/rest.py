"""Accelerometer reading at rest, which is gravity alone if the sensor is calibrated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from core.findings import Finding, warning
from core.units import STANDARD_GRAVITY
from logparse.tables import Tables

if TYPE_CHECKING:
    from logparse.flights import Flight

Array = npt.NDArray[np.float64]

GYRO, ACCEL = ("gyro_x", "gyro_y", "gyro_z"), ("accel_x", "accel_y", "accel_z")

#: Length of a window [s], and fewest windows at rest.
_WINDOW, _FEWEST = 1.0, 3
#: Fewest samples in a window.
_SAMPLES = 5
#: Largest standard deviation, and largest mean (bias of an uncalibrated gyro), of each rate at rest [rad/s].
_GYRO_SIGMA, _GYRO_BIAS = 0.05, 0.1
#: Largest standard deviation of each acceleration at rest [m/s^2]: idling engines shake by less than this.
_ACCEL_SIGMA = 0.5
#: Time before and after a flight that is left out [s].
_MARGIN = 1.0
#: Deviation [m/s^2] from gravity that is a fault: gravity itself varies by 0.03 over the Earth and calibrated sensors
#: by 0.1; three percent of gravity are three percent of thrust.
_TOLERATED = 0.3


@dataclass(frozen=True, slots=True)
class Rest:
    """Magnitude of the mean specific force at rest [m/s^2], median over windows, and their total duration [s]."""

    specific_force: float
    seconds: float


def at_rest(tables: Tables, flights: Sequence["Flight"]) -> Rest | None:
    """Measure the specific force while the craft stands still outside its flights."""
    t = tables.times("imu")
    if t is None or len(t) < _SAMPLES:
        return None
    window = np.floor((t - t[0]) / _WINDOW).astype(np.int64)
    first = np.flatnonzero(np.diff(window, prepend=-1))
    count = np.diff(np.append(first, len(t))).astype(np.float64)
    still = count >= _SAMPLES
    for flight in flights:
        start, stop = flight.start - _MARGIN, flight.stop + _MARGIN
        still &= (t[first] + _WINDOW < start) | (t[first] > stop)
    # Most of a log is flight, whose rows are not computed.
    rows = np.repeat(still, count.astype(int))
    count = count[still]
    if len(count) < _FEWEST:
        return None
    first = np.append(0, np.cumsum(count[:-1]).astype(int))
    still, force = np.ones(len(count), np.bool_), np.zeros(len(count))
    for name, values in zip((*GYRO, *ACCEL), tables.columns("imu", (*GYRO, *ACCEL)), strict=True):
        series = values.to_numpy(np.float64)[rows]
        mean = np.add.reduceat(series, first) / count
        sigma = np.sqrt(np.add.reduceat((series - np.repeat(mean, count.astype(int))) ** 2, first) / count)
        with np.errstate(invalid="ignore"):
            if name in GYRO:
                still &= (sigma < _GYRO_SIGMA) & (np.abs(mean) < _GYRO_BIAS)
            else:
                still &= sigma < _ACCEL_SIGMA
                force += mean**2
    if int(still.sum()) < _FEWEST:
        return None
    return Rest(float(np.median(np.sqrt(force[still]))), float(still.sum()) * _WINDOW)


def calibration(rest: Rest | None, parameters: Mapping[str, float]) -> tuple[Finding, ...]:
    """Check the accelerometer's calibration by its reading at rest."""
    if rest is None or abs(rest.specific_force - STANDARD_GRAVITY) <= _TOLERATED:
        return ()
    offsets = [parameters.get(f"INS_ACCOFFS_{axis}") for axis in "XYZ"]
    why = "it was never calibrated" if all(each == 0.0 for each in offsets) else "its calibration is not of this sensor"
    return (
        warning(
            "sensor-doubtful",
            f"At rest the accelerometer reads {rest.specific_force:.2f} m/s^2 instead of {STANDARD_GRAVITY:.2f}: "
            f"{why}. Thrust is off by up to {abs(rest.specific_force / STANDARD_GRAVITY - 1.0):.0%}.",
            "Calibrate the accelerometers of this board in all six positions, and fly again.",
            specific_force=rest.specific_force,
            seconds=rest.seconds,
        ),
    )
