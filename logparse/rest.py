"""What the accelerometer reads at rest, which is gravity and nothing else where it is calibrated."""

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

#: Length of the stretches that are looked at [s], and how many of them at rest it takes.
_STRETCH, _FEWEST = 1.0, 3
#: Samples that a stretch must have.
_SAMPLES = 5
#: Standard deviation [rad/s], and mean with the bias of an uncalibrated gyro [rad/s], of each rate at rest.
_TURNING, _GYRO_BIAS = 0.05, 0.1
#: Standard deviation of each acceleration at rest [m/s^2]: engines that idle shake by less than this.
_SHAKING = 0.5
#: Time around a flight that does not count [s].
_MARGIN = 1.0
#: Deviation [m/s^2] from gravity that is a fault: gravity itself varies by 0.03 over the Earth and calibrated sensors
#: by 0.1; three percent of gravity are three percent of thrust.
_TOLERATED = 0.3


@dataclass(frozen=True, slots=True)
class Rest:
    """Size of the mean specific force at rest [m/s^2], median over stretches, and how long that was seen [s]."""

    specific_force: float
    seconds: float


def at_rest(tables: Tables, flights: Sequence["Flight"]) -> Rest | None:
    """Measure the specific force while the craft stands still outside its flights."""
    t = tables.times("imu")
    if t is None or len(t) < _SAMPLES:
        return None
    number = np.floor((t - t[0]) / _STRETCH).astype(np.int64)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    count = np.diff(np.append(first, len(t))).astype(np.float64)
    still = count >= _SAMPLES
    for flight in flights:
        start, stop = flight.start - _MARGIN, flight.stop + _MARGIN
        still &= (t[first] + _STRETCH < start) | (t[first] > stop)
    # What is flown is not looked at, and that is most of a log.
    rows = np.repeat(still, count.astype(int))
    count = count[still]
    if len(count) < _FEWEST:
        return None
    first = np.append(0, np.cumsum(count[:-1]).astype(int))
    still, force = np.ones(len(count), np.bool_), np.zeros(len(count))
    for name, values in zip((*GYRO, *ACCEL), tables.columns("imu", (*GYRO, *ACCEL)), strict=True):
        series = values.to_numpy(np.float64)[rows]
        mean = np.add.reduceat(series, first) / count
        spread = np.sqrt(
            np.maximum(np.add.reduceat((series - np.repeat(mean, count.astype(int))) ** 2, first) / count, 0)
        )
        with np.errstate(invalid="ignore"):
            if name in GYRO:
                still &= (spread < _TURNING) & (np.abs(mean) < _GYRO_BIAS)
            else:
                still &= spread < _SHAKING
        force += mean**2
        if name == GYRO[-1]:
            force[:] = 0.0
    if int(still.sum()) < _FEWEST:
        return None
    return Rest(float(np.median(np.sqrt(force[still]))), float(still.sum()) * _STRETCH)


def calibration(rest: Rest | None, parameters: Mapping[str, float]) -> tuple[Finding, ...]:
    """Judge the accelerometer's calibration by what it reads at rest."""
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
