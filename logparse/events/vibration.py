"""Vibration beyond ArduPilot's limits, and accelerometers that hit their range."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from logparse.events.event import FlightEvent
from logparse.events.stretches import stretches, within
from logparse.findings import Severity
from logparse.flights import Flight

_CLIP_SOURCE = "ArduPilot wiki, Measuring Vibration: clipping should stay at zero"
#: Pauses [s] within one stretch, and shortest stretch [s].
_PAUSE, _SHORTEST = 5.0, 0.5


@dataclass(frozen=True, slots=True)
class VibrationLevels:
    """What an autopilot itself measures of vibration, and from where on it is too much."""

    frame: pd.DataFrame  #: As logged, of all sensors.
    axes: tuple[str, ...]  #: Columns by axis of the body; a single one is of no axis.
    number: int  #: Sensor, 1 for the first, where the frame does not tell.
    #: Vibration [m/s^2] that may spoil the estimate, and that nearly always does.
    acceptable: float
    harmful: float
    source: str


_ARDUPILOT = (
    30.0,
    60.0,
    "ArduPilot wiki, Measuring Vibration: below 30 m/s^2 normally acceptable, above 60 nearly always problems",
)
_PX4 = (4.905, 9.81, "PX4 Flight Review, accel_vibration_metric: good below 4.905 m/s^2, bad above 9.81")


def vibration_levels(messages: Mapping[str, pd.DataFrame]) -> tuple[VibrationLevels, ...]:
    """Return what the log holds of vibration: VIBE, VIBRATION, or of PX4 vehicle_imu_status.

    Parameters
    ----------
    messages : mapping of str to DataFrame
        As logged.
    """
    for name, axes in (
        ("VIBE", ("VibeX", "VibeY", "VibeZ")),
        ("VIBRATION", ("vibration_x", "vibration_y", "vibration_z")),
    ):
        if name in messages and set(axes) <= set(messages[name].columns):
            return (VibrationLevels(messages[name], axes, 1, *_ARDUPILOT),)
    metric = "accel_vibration_metric"
    names = ["vehicle_imu_status", *(f"vehicle_imu_status_{k}" for k in range(1, 4))]
    return tuple(
        VibrationLevels(messages[name], (metric,), number, *_PX4)
        for number, name in enumerate(names, start=1)
        if name in messages and metric in messages[name]
    )


def vibration_events(messages: Mapping[str, pd.DataFrame], flights: tuple[Flight, ...]) -> Iterator[FlightEvent]:
    """Yield stretches of strong vibration and of clipping.

    Parameters
    ----------
    messages : mapping of str to DataFrame
        As logged.
    flights : tuple of Flight
    """
    # The end of a flight is the landing, which shakes every craft.
    spans = [(flight.start, flight.stop) for flight in flights]
    for levels in vibration_levels(messages):
        for number, part in _by_sensor(levels):
            t = part.index.to_numpy(np.float64)
            if len(t) < 3:
                continue
            flying = within(t, spans)
            yield from _strong(part, levels, number, flying)
            yield from _clipping(part, number, flying)


def _by_sensor(levels: VibrationLevels) -> Iterator[tuple[int, pd.DataFrame]]:
    """Rows of each accelerometer, numbered from 1."""
    if "IMU" not in levels.frame:
        yield levels.number, levels.frame
        return
    for number, part in levels.frame.groupby("IMU"):
        yield int(float(str(number))) + 1, part


def _strong(part: pd.DataFrame, levels: VibrationLevels, number: int, flying: np.ndarray) -> Iterator[FlightEvent]:
    t = part.index.to_numpy(np.float64)
    values = part[list(levels.axes)].to_numpy(np.float64)
    worst = np.nanmax(np.where(np.isfinite(values), values, 0.0), axis=1)
    for first, last in stretches(t, flying & (worst > levels.acceptable), join=_PAUSE, shortest=_SHORTEST):
        inside = (t >= first) & (t <= last)
        level = float(worst[inside].max())
        axis = "xyz"[int(np.argmax(np.nanmax(values[inside], axis=0)))] if len(levels.axes) > 1 else ""
        along = f" along {axis}" if axis else ""
        yield FlightEvent(
            id="vibration-high",
            t=first,
            end=last,
            severity=Severity.ERROR if level > levels.harmful else Severity.WARNING,
            reason=f"Vibration up to {level:.{0 if level >= 10.0 else 1}f} m/s²{along} (accelerometer {number}).",
            advice="Balance the propellers, tighten motors and arms, soften the mount of the autopilot.",
            evidence={"level_m_s2": level, "axis": axis, "accelerometer": number},
            source=levels.source,
        )


def _clipping(part: pd.DataFrame, number: int, flying: np.ndarray) -> Iterator[FlightEvent]:
    t = part.index.to_numpy(np.float64)
    for column in part.columns:
        if not str(column).lower().startswith("clip"):
            continue
        suffix = str(column).lower().removeprefix("clipping_").removeprefix("clip")
        sensor = int(suffix) + 1 if suffix.isdigit() else number
        counts = part[column].to_numpy(np.float64)
        rises = np.concatenate(([0.0], np.maximum(np.diff(counts), 0.0)))
        for first, last in stretches(t, flying & (rises > 0.0), join=_PAUSE):
            hits = int(rises[(t >= first) & (t <= last)].sum())
            yield FlightEvent(
                id="clipping",
                t=first,
                end=last,
                severity=Severity.WARNING,
                reason=f"Accelerometer {sensor} hit its range {hits} time{'s' if hits > 1 else ''}.",
                advice="Soften the mount of the autopilot; look for a blow at this time.",
                evidence={"hits": hits, "accelerometer": sensor},
                source=_CLIP_SOURCE,
            )
