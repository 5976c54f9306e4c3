"""Vibration beyond ArduPilot's limits or suddenly larger, and accelerometers that hit their range."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy

from core.findings import Severity
from logparse.events.event import FlightEvent
from logparse.events.stretches import Array, stretches, within
from logparse.flights import Flight

_CLIP_SOURCE = "ArduPilot wiki, Measuring Vibration: clipping should stay at zero"
#: Pauses [s] within one stretch, and shortest stretch [s].
_PAUSE, _SHORTEST = 5.0, 0.5
#: A rise: from so many seconds of flight on, vibration that for so long stays this many times above nearly all of what
#: was before, and above this part of the limit; less is harmless however much it changed. Landing and lift-off shake.
_USUAL, _STAYS, _TIMES, _PART, _GROUND = 10.0, 5.0, 3.0, 1.0 / 3.0, 3.0
#: Filters of ArduPilot's own measure, Hz (AP_InertialSensor: 5 Hz floor, 2 Hz smoothing), and the slowest samples of an
#: accelerometer that it is computed from.
_FLOOR, _SMOOTH, _FAST = 5.0, 2.0, 90.0


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


def vibration_levels(
    messages: Mapping[str, pd.DataFrame], imu: pd.DataFrame | None = None
) -> tuple[VibrationLevels, ...]:
    """Return what the log holds of vibration: VIBE, VIBRATION, of PX4 vehicle_imu_status, or what a fast IMU shows.

    Parameters
    ----------
    messages : mapping of str to DataFrame
        As logged.
    imu : DataFrame, optional
        The canonical table, for logs without any of the messages.
    """
    for name, axes in (
        ("VIBE", ("VibeX", "VibeY", "VibeZ")),
        ("VIBRATION", ("vibration_x", "vibration_y", "vibration_z")),
    ):
        if name in messages and set(axes) <= set(messages[name].columns):
            return (VibrationLevels(messages[name], axes, 1, *_ARDUPILOT),)
    metric = "accel_vibration_metric"
    names = ["vehicle_imu_status", *(f"vehicle_imu_status_{k}" for k in range(1, 4))]
    found = tuple(
        VibrationLevels(messages[name], (metric,), number, *_PX4)
        for number, name in enumerate(names, start=1)
        if name in messages and metric in messages[name]
    )
    return found or _measured(imu)


def _measured(imu: pd.DataFrame | None) -> tuple[VibrationLevels, ...]:
    """Measure vibration as ArduPilot does: what is faster than 5 Hz, squared, smoothed at 2 Hz, its root."""
    rows = pd.DataFrame() if imu is None else imu[["accel_x", "accel_y", "accel_z"]].dropna()
    if len(rows) < 100:
        return ()
    t = rows.index.to_numpy(np.float64)
    step = float(np.median(np.diff(t)))
    if not 0.0 < step <= 1.0 / _FAST:
        return ()
    force = rows.to_numpy(np.float64)
    vibration = np.sqrt(_smoothed((force - _smoothed(force, _FLOOR * step)) ** 2, _SMOOTH * step))
    # Ten rows a second, as autopilots write VIBE; filters settle within the first second.
    every = max(round(0.1 / step), 1)
    frame = pd.DataFrame(vibration[round(1.0 / step) :: every], columns=["x", "y", "z"])
    limit = f"{_ARDUPILOT[2]}; computed from the logged accelerations, of which filters have taken a part"
    frame.index = pd.Index(t[round(1.0 / step) :: every])
    return (VibrationLevels(frame, ("x", "y", "z"), 1, *_ARDUPILOT[:2], limit),)


def _smoothed(values: Array, cutoff: float) -> Array:
    """Filter columns by one pole; `cutoff` is in samples."""
    part = 1.0 / (1.0 + 1.0 / (2.0 * np.pi * cutoff))
    start = (1.0 - part) * values[:1]
    return np.asarray(scipy.signal.lfilter([part], [1.0, part - 1.0], values, axis=0, zi=start)[0])


def vibration_events(
    messages: Mapping[str, pd.DataFrame], flights: tuple[Flight, ...], imu: pd.DataFrame | None = None
) -> Iterator[FlightEvent]:
    """Yield stretches of strong vibration, sudden rises and clipping.

    Parameters
    ----------
    messages : mapping of str to DataFrame
        As logged.
    flights : tuple of Flight
    imu : DataFrame, optional
        As `vibration_levels` takes it.
    """
    # The end of a flight is the landing, which shakes every craft.
    spans = [(flight.start, flight.stop) for flight in flights]
    for levels in vibration_levels(messages, imu):
        for number, part in _by_sensor(levels):
            t = part.index.to_numpy(np.float64)
            if len(t) < 3:
                continue
            flying = within(t, spans)
            strong = list(_strong(part, levels, number, flying))
            yield from strong
            for flight in flights:
                rise = _rise(part, levels, number, flight)
                if rise is not None and not any(event.t - _PAUSE <= rise.t <= event.end for event in strong):
                    yield rise
            yield from _clipping(part, number, flying)


def _by_sensor(levels: VibrationLevels) -> Iterator[tuple[int, pd.DataFrame]]:
    """Rows of each accelerometer in order of time, which damage may put into another; numbered from 1."""
    frame = levels.frame if levels.frame.index.is_monotonic_increasing else levels.frame.sort_index(kind="stable")
    if "IMU" not in frame:
        yield levels.number, frame
        return
    for number, part in frame.groupby("IMU"):
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


def _rise(part: pd.DataFrame, levels: VibrationLevels, number: int, flight: Flight) -> FlightEvent | None:
    """Return when vibration became several times what it was, and stayed; None where it did not."""
    inside = part.loc[flight.start + _GROUND : flight.stop - _GROUND, list(levels.axes)]
    t, values = inside.index.to_numpy(np.float64), inside.to_numpy(np.float64)
    worst = np.max(np.where(np.isfinite(values), values, 0.0), axis=1, initial=0.0)
    if len(t) < 20 or t[-1] - t[0] < _USUAL + _STAYS:
        return None
    # Every half second in which there is a row: a clock may claim days between two.
    for begin in t[0] + 0.5 * np.unique(np.floor(2.0 * (t[within(t, [(t[0] + _USUAL, t[-1] - _STAYS)])] - t[0]))):
        first, last = np.searchsorted(t, (begin, begin + _STAYS))
        later = worst[first:last]
        # Before percentiles are taken, at every half second of a long log.
        if later.max(initial=0.0) <= _PART * levels.acceptable:
            continue
        risen = float(np.percentile(later, 20.0))
        if risen <= _PART * levels.acceptable:
            continue
        usual = float(np.percentile(worst[:first], 95.0))
        if risen > _TIMES * usual:
            quiet = np.flatnonzero((worst <= 1.5 * usual) & (t < begin + 0.5))
            since = float(t[min(int(quiet[-1]) + 1, len(t) - 1)]) if len(quiet) else float(begin)
            level = float(np.median(worst[first:]))
            return FlightEvent(
                id="vibration-rise",
                t=since,
                end=float(t[-1]),
                severity=Severity.WARNING,
                reason=f"Vibration rose from {usual:.1f} to {level:.0f} m/s² (accelerometer {number}) and stayed.",
                advice="Look for a chipped or loose propeller, a bearing, and screws that came loose at this time.",
                evidence={"before_m_s2": usual, "level_m_s2": level, "accelerometer": number},
                source=levels.source,
            )
    return None


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
