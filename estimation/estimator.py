"""Entry point: tables in, trajectory out, without fixes of a receiver that repeats itself."""

from dataclasses import replace
from datetime import datetime
from importlib import import_module

import numpy as np
import pandas as pd

from core.findings import warning
from core.runs import runs
from estimation.alignment import RUNNING_PWM
from estimation.observations import usable_fixes
from estimation.place import LocalFrame
from estimation.segmentation import FEWEST_SAMPLES, SLOWEST_IMU
from estimation.states import SensorNoise
from estimation.strapdown import estimate_strapdown
from estimation.timing import ACCEL, GYRO, GYRO_MOVING, sample_rate, usable
from estimation.trajectory import Trajectory
from logparse import Finding, Geodetic, MissingDataError, Tables

#: A fix that stays the same to the last digit for longer than this while the craft turns is old, s. Hover is never so
#: still: places are written to a centimetre.
LONGEST_REPETITION = 2.0
#: Rates beyond this are a craft that flies if its motors run, rad/s: a calm hover turns no faster.
CALM = 0.05
#: Attitude that changes by more than this is a craft that turns, rad; where no rates are logged.
TURNED = 0.05
#: Positions this far from where the velocity leads, m, and a second of it, m/s, are not those of a receiver at rest.
ELSEWHERE, WANDER = 5.0, 0.2
#: How many times as far heights wander as places.
VERTICALLY = 2.0
_VELOCITY = ["v_n", "v_e", "v_d"]
_FIX = ["lat", "lon", "alt", *_VELOCITY]


def without_frozen_fixes(tables: Tables) -> tuple[Tables, list[Finding]]:
    """Leave out repetitions of a fix, or of its velocity alone, while the craft turns, and report them."""
    gps, findings = tables.gps, []
    if gps is None:
        return tables, []
    spans = [span for span in _repeated(gps, _FIX) if _turns(tables, *span)]
    if spans:
        old = _during(gps, spans)
        gps = gps[~old]
        findings.append(
            _frozen("fix", "turns", spans, "the repetitions are", "cable and its driver", fixes=int(old.sum()))
        )
    spans = [
        (first, last)
        for first, last in _repeated(gps, _VELOCITY)
        if gps.loc[first:last, _VELOCITY].notna().any(axis=None)
        and (_turns(tables, first, last) or _goes_elsewhere(gps.loc[first:last]))
    ]
    if spans:
        gps = gps.copy()
        for first, last in spans:
            gps.loc[first:last, _VELOCITY] = np.nan
        findings.append(
            _frozen("velocity", "turns or goes elsewhere", spans, "these velocities are", "messages and its driver")
        )
    return (tables.changed(gps=gps), findings) if findings else (tables, findings)


def _during(gps: pd.DataFrame, spans: list[tuple[float, float]]) -> np.ndarray:
    """Return which rows follow the first of a span."""
    t = gps.index.to_numpy(np.float64)
    return np.asarray(np.logical_or.reduce([(t > first) & (t <= last) for first, last in spans]))


def _frozen(what: str, while_: str, spans: list[tuple[float, float]], left_out: str, look: str, **more: int) -> Finding:
    seconds = sum(last - first for first, last in spans)
    return warning(
        "sensor-doubtful",
        f"The GPS repeats one {what} to the last digit while the craft {while_}, {seconds:.0f} s in all from "
        f"t = {spans[0][0]:.1f} s: {left_out} not used.",
        f"Look at the receiver's {look}.",
        sensor="gps",
        start=spans[0][0],
        stop=spans[-1][1],
        seconds=seconds,
        **more,
    )


def _repeated(gps: pd.DataFrame, columns: list[str]) -> list[tuple[float, float]]:
    """Return the times of the first and the last row of every repetition that lasts too long."""
    values = gps[columns].to_numpy(np.float64)
    same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    spans = gps.index.to_numpy(np.float64)[runs(same.all(axis=1))]
    return [(first, last) for first, last in spans.tolist() if last - first > LONGEST_REPETITION]


def _goes_elsewhere(gps: pd.DataFrame) -> bool:
    """Return whether positions leave where their one velocity leads, faster than those of a craft at rest wander."""
    gps = gps[gps[["lat", "lon", "alt"]].notna().all(axis=1)]
    if len(gps) < 2:
        return False
    t = gps.index.to_numpy(np.float64) - gps.index[0]
    lat, lon, alt = gps[["lat", "lon", "alt"]].to_numpy(np.float64).T
    went = LocalFrame.at(Geodetic(lat[0], lon[0], 0.0)).to_ned(lat, lon, alt)
    led = t[:, None] * gps[_VELOCITY].iloc[0].to_numpy(np.float64)
    # Of receivers that give no vertical velocity only the horizontal ones are compared.
    apart = np.nan_to_num(np.ptp(went - led, axis=0)) / [1.0, 1.0, VERTICALLY]
    return bool(apart.max() > ELSEWHERE + WANDER * t[-1])


def _turns(tables: Tables, first: float, last: float) -> bool:
    """Return whether the craft turns between two times."""
    if tables.imu is not None and len(rates := tables.imu.loc[first:last, GYRO].dropna().to_numpy(np.float64)):
        fastest = np.max(np.abs(rates - np.median(rates, axis=0)))
        return bool(fastest > (CALM if _motors_run(tables, first, last) else GYRO_MOVING))
    if tables.attitude is not None:
        angles = tables.attitude.loc[first:last, ["roll", "pitch"]].dropna().to_numpy(np.float64)
        return bool(len(angles)) and bool(np.max(np.ptp(angles, axis=0)) > TURNED)
    return False


def _motors_run(tables: Tables, first: float, last: float) -> bool:
    if tables.motors is None:
        return False
    outputs = tables.motors.loc[first:last].to_numpy(np.float64)
    outputs = outputs[np.isfinite(outputs)]
    return bool(outputs.size) and bool(np.median(outputs) > RUNNING_PWM)


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
