"""Entry point: tables in, trajectory out."""

from dataclasses import replace
from datetime import datetime
from importlib import import_module

from estimation.faults.frozen import without_frozen_fixes
from estimation.observations import usable_fixes
from estimation.segmentation import FEWEST_SAMPLES, SLOWEST_IMU
from estimation.states import SensorNoise
from estimation.strapdown import estimate_strapdown
from estimation.timing import ACCEL, GYRO, sample_rate, usable
from estimation.trajectory import Trajectory
from logparse import MissingDataError, Tables


def estimate(
    tables: Tables,
    *,
    rate: float = 50.0,
    start: float | None = None,
    stop: float | None = None,
    date: datetime | None = None,
    noise: SensorNoise | None = None,
    smooth: bool = True,
) -> Trajectory:
    """Estimate the trajectory of a log.

    Parameters
    ----------
    tables : Tables
    rate : float
        Rows of the trajectory per second.
    start, stop : float, optional
        Span of time to give, s on the boot clock; the whole log is used for it all the same.
    date : datetime, optional
        When the log was flown, for the magnetic declination; without it the autopilot's declination is taken.
    noise : SensorNoise, optional
        What to believe of the sensors.
    smooth : bool
        False gives the plain forward filter, to compare with filters that run in flight: each row knows only the
        measurements before it (noise settings and lags are still those of the whole log).

    Returns
    -------
    Trajectory
        By default each row uses the log's past and future. Where the IMU has a hole, there are no rows.

    Raises
    ------
    MissingDataError
        When neither an IMU of 15 Hz nor attitude with positions is there.
    """
    noise = noise or SensorNoise()
    tables, odd = without_frozen_fixes(tables)
    trajectory: Trajectory
    if _has_fast_imu(tables):
        trajectory = estimate_strapdown(
            tables, rate=rate, start=start, stop=stop, date=date, noise=noise, smoothed=smooth
        )
    elif _is_low_rate(tables):
        # Only when it is needed: filterpy imports scipy.stats, which takes longer than to fuse a flight's fast IMU.
        lowrate = import_module("estimation.lowrate")
        trajectory = lowrate.estimate_low_rate(tables, rate=rate, start=start, stop=stop, noise=noise, smoothed=smooth)
    else:
        raise MissingDataError(
            "the log has neither IMU samples at 15 Hz or more nor GPS positions with attitude, so there is nothing to "
            "make a trajectory from: log IMU and GPS (rotorid inspect names the setting)"
        )
    return replace(trajectory, findings=(*odd, *trajectory.findings)) if odd else trajectory


def _has_fast_imu(tables: Tables) -> bool:
    imu = usable(tables.imu, GYRO + ACCEL)
    return imu is not None and len(imu) >= FEWEST_SAMPLES and sample_rate(imu) >= SLOWEST_IMU


def _is_low_rate(tables: Tables) -> bool:
    """Return whether there is enough for the low-rate filter: attitude, and positions by GPS or by the autopilot."""
    attitude = usable(tables.attitude, ["roll", "pitch", "yaw"])
    position = usable_fixes(tables.gps) is not None or usable(tables.ekf, ["p_n", "p_e", "p_d"]) is not None
    return attitude is not None and len(attitude) >= 4 and position
