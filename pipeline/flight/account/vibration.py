"""Vibration over a flight, as the autopilot measures it or as a fast IMU shows it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.results.span import Span

Floats = NDArray[np.float64]

#: Limits [m/s^2]: normally acceptable below the first, nearly always harmful above the other.
_ARDUPILOT = (30.0, 60.0, "ArduPilot wiki, Measuring Vibration")
_PX4 = (4.905, 9.81, "PX4 Flight Review, accel_vibration_metric")
#: Filters of ArduPilot's own measure, Hz (AP_InertialSensor: 5 Hz floor, 2 Hz smoothing), the slowest samples from
#: which it can be computed, and the slowest that show a rise of what the autopilot's filter leaves (26-11-2014_181).
_FLOOR, _SMOOTH, _FAST, _SLOWEST = 5.0, 2.0, 90.0, 20.0


#: Time [s] after a flight's end in which a craft hits the ground (30 clips in log_0036, 6 before).
_TOUCHING = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Vibration:
    """Vibration of the first accelerometer over time."""

    t: Floats  #: shape (n,), s
    axes: Floats  #: shape (n, 3) by body axis, or (n, 1) where the log has one number for all, m/s^2
    clips: Floats | None  #: shape (n, k), counters of samples at the sensor's range; None where not logged.
    advised: float
    harmful: float
    source: str
    relative: bool = False  #: Whether too little of it was logged to compare with limits.

    @property
    def level(self) -> Floats:
        """The worst axis at each time, m/s^2, shape (n,)."""
        return np.asarray(np.max(np.nan_to_num(self.axes), axis=1))

    def clipped(self, flight: Span) -> int | None:
        """Return how often an accelerometer hit its range in a flight and its touch-down; None where not logged."""
        first, last = np.searchsorted(self.t, (flight.start, flight.stop + _TOUCHING))
        counts = None if self.clips is None else self.clips[first : last + 1]
        if counts is None or not len(counts) or not np.isfinite(counts[[0, -1]]).any():
            return None
        return int(np.nanmax(counts[-1] - counts[0]))


def read_vibration(
    messages: Mapping[str, pd.DataFrame], specific_force: Callable[[], pd.DataFrame | None]
) -> Vibration | None:
    """Read VIBE, VIBRATION or, of PX4, vehicle_imu_status; else compute it from the specific force along three axes."""
    for name, axes in (
        ("VIBE", ["VibeX", "VibeY", "VibeZ"]),
        ("VIBRATION", ["vibration_x", "vibration_y", "vibration_z"]),
        ("vehicle_imu_status", ["accel_vibration_metric"]),
    ):
        if name in messages and set(axes) <= set(messages[name].columns):
            return _logged(messages[name], axes, _PX4 if len(axes) == 1 else _ARDUPILOT)
    force = specific_force()
    return None if force is None or len(force) < 100 else _measured(force)


def _logged(frame: pd.DataFrame, axes: list[str], limits: tuple[float, float, str]) -> Vibration | None:
    frame = frame.sort_index(kind="stable")  # damage moves time stamps
    if "IMU" in frame:
        frame = frame[frame["IMU"] == frame["IMU"].min()]
    clips = [column for column in frame.columns if str(column).lower().startswith("clip")]
    if not len(frame):
        return None
    return Vibration(
        t=frame.index.to_numpy(np.float64),
        axes=frame[axes].to_numpy(np.float64),
        clips=frame[clips].to_numpy(np.float64) if clips else None,
        advised=limits[0],
        harmful=limits[1],
        source=limits[2],
    )


def _measured(rows: pd.DataFrame) -> Vibration | None:
    """Measure vibration as ArduPilot does: what is faster than 5 Hz, squared, smoothed at 2 Hz, its root."""
    t = rows.index.to_numpy(np.float64)
    step = float(np.median(np.diff(t)))
    if not 0.0 < step <= 1.0 / _SLOWEST:
        return None
    force = rows.to_numpy(np.float64)
    level = np.sqrt(_smoothed((force - _smoothed(force, _FLOOR * step)) ** 2, _SMOOTH * step))
    # Ten rows a second, as autopilots write VIBE; filters settle within the first second.
    kept = slice(round(1.0 / step), None, max(round(0.1 / step), 1))
    source = f"{_ARDUPILOT[2]}; computed from the logged accelerations, of which filters have taken a part"
    return Vibration(
        t=t[kept],
        axes=level[kept],
        clips=None,
        advised=_ARDUPILOT[0],
        harmful=_ARDUPILOT[1],
        source=source,
        relative=step > 1.0 / _FAST,
    )


def _smoothed(values: Floats, cutoff: float) -> Floats:
    """Filter columns by one pole; `cutoff` is in samples."""
    part = 1.0 / (1.0 + 1.0 / (2.0 * np.pi * cutoff))
    return pd.DataFrame(values).ewm(alpha=part, adjust=False).mean().to_numpy(np.float64)
