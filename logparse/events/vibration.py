"""Vibration beyond ArduPilot's limits, and accelerometers that hit their range."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from logparse.events.event import FlightEvent
from logparse.events.stretches import stretches, within
from logparse.findings import Severity
from logparse.flights import Flight

#: Vibration [m/s^2] that may spoil the estimate, and that nearly always does.
ACCEPTABLE, HARMFUL = 30.0, 60.0
_CLIP_SOURCE = "ArduPilot wiki, Measuring Vibration: clipping should stay at zero"
_SOURCE = "ArduPilot wiki, Measuring Vibration: below 30 m/s^2 normally acceptable, above 60 nearly always problems"
#: Pauses [s] within one stretch, and shortest stretch [s].
_PAUSE, _SHORTEST = 5.0, 0.5


def vibration_events(messages: Mapping[str, pd.DataFrame], flights: tuple[Flight, ...]) -> Iterator[FlightEvent]:
    """Yield stretches of strong vibration and of clipping, from VIBE or VIBRATION.

    Parameters
    ----------
    messages : mapping of str to DataFrame
        As logged.
    flights : tuple of Flight
    """
    found = _levels(messages)
    if found is None:
        return
    frame, axes = found
    # The end of a flight is the landing, which shakes every craft.
    spans = [(flight.start, flight.stop) for flight in flights]
    for number, part in _by_sensor(frame):
        t = part.index.to_numpy(np.float64)
        if len(t) < 3:
            continue
        flying = within(t, spans)
        yield from _strong(part, axes, number, flying)
        yield from _clipping(part, number, flying)


def _levels(messages: Mapping[str, pd.DataFrame]) -> tuple[pd.DataFrame, list[str]] | None:
    for name, axes in (
        ("VIBE", ["VibeX", "VibeY", "VibeZ"]),
        ("VIBRATION", ["vibration_x", "vibration_y", "vibration_z"]),
    ):
        if name in messages and set(axes) <= set(messages[name].columns):
            return messages[name], axes
    return None


def _by_sensor(frame: pd.DataFrame) -> Iterator[tuple[int, pd.DataFrame]]:
    """Rows of each accelerometer, numbered from 1."""
    if "IMU" not in frame:
        yield 1, frame
        return
    for number, part in frame.groupby("IMU"):
        yield int(float(str(number))) + 1, part


def _strong(part: pd.DataFrame, axes: list[str], number: int, flying: np.ndarray) -> Iterator[FlightEvent]:
    t = part.index.to_numpy(np.float64)
    values = part[axes].to_numpy(np.float64)
    worst = np.nanmax(np.where(np.isfinite(values), values, 0.0), axis=1)
    for first, last in stretches(t, flying & (worst > ACCEPTABLE), join=_PAUSE, shortest=_SHORTEST):
        inside = (t >= first) & (t <= last)
        level = float(worst[inside].max())
        axis = "xyz"[int(np.argmax(np.nanmax(values[inside], axis=0)))]
        yield FlightEvent(
            id="vibration-high",
            t=first,
            end=last,
            severity=Severity.ERROR if level > HARMFUL else Severity.WARNING,
            reason=f"Vibration up to {level:.0f} m/s² along {axis} (accelerometer {number}).",
            advice="Balance the propellers, tighten motors and arms, soften the mount of the autopilot.",
            evidence={"level_m_s2": level, "axis": axis, "accelerometer": number},
            source=_SOURCE,
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
