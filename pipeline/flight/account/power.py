"""Whether the thrust and the battery sufficed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from core.catalogue import finding
from core.findings import Finding
from pipeline.flight.account.readings import HOLDING, Readings, at, stretches

#: Throttle, time [s] and lean asked for [rad] of a loss of lift: ArduCopter's THRUST_LOSS_CHECK.
FULL, _LASTING, _LEVEL = 0.9, 1.0, np.radians(15.0)
#: Sink [m/s] that is more than the noise of a barometer's slope over a second.
_SINKING = 1.0
#: Part of the barometer's climb below which the autopilot took its own height for one that does not climb.
_BEHIND = 0.5
#: Voltage below which lithium cells are damaged [V], and time below it [s] that is more than a punch (BATT_LOW_TIMER).
_EMPTY, _TIMER = 3.0, 10.0
#: Share of its voltage that a battery sags at least when motors run; less is the supply of a board, or a constant.
_SAGS = 0.01


def power_happenings(readings: Readings) -> Iterator[Finding]:
    """Yield lost lift, throttle that ran away, and a spent battery."""
    throttle, sink = readings.throttle, readings.sink
    if throttle is not None and sink is not None:
        yield from _full_throttle(readings, throttle, sink)
    voltage = real_voltage(readings)
    if voltage is not None:
        yield from _battery(readings, voltage)


def _full_throttle(readings: Readings, throttle: pd.Series[float], sink: pd.Series[float]) -> Iterator[Finding]:
    t = throttle.index.to_numpy(np.float64)
    down = at(t, sink)
    join = max(0.4, 1.5 * float(np.median(np.diff(t)))) if len(t) > 1 else 0.4
    asked = readings.lean_asked
    level = np.zeros(len(t)) if asked is None else at(t, asked)
    full = readings.flying(t) & (throttle.to_numpy(np.float64) >= FULL)
    for first, last in stretches(t, full & (down > _SINKING) & ~(level > _LEVEL), join=join, shortest=_LASTING):
        worst = float(np.max(down[(t >= first) & (t <= last)]))
        yield finding(
            "lift-lost",
            f"The craft sank at up to {worst:.1f} m/s under full throttle.",
            t=first,
            end=last,
            sink_m_s=worst,
        )
    # The autopilot's own doing: throttle at its limit while the craft climbs already, in a mode that holds height.
    wrong = full & readings.in_modes(t, HOLDING) & (down < -_SINKING)
    for first, last in stretches(t, wrong, join=join, shortest=_LASTING):
        if _climb_asked(readings, first, last) or (disagreement := _estimate_off(readings, first, last)) is None:
            continue
        climb = -float(down[(t >= first) & (t <= last)].min())
        yield finding(
            "throttle-runaway",
            f"The autopilot held full throttle while the craft climbed at {climb:.0f} m/s, for its own height fell "
            f"{disagreement:.0f} m behind the barometer's.",
            t=first,
            end=last,
            height_error_m=disagreement,
        )


def _climb_asked(readings: Readings, first: float, last: float) -> bool:
    """Return whether the height controller was asked to climb in a stretch."""
    setpoints = readings.tables.setpoints
    asked = None if setpoints is None or "v_d" not in setpoints else setpoints["v_d"].loc[first:last].dropna()
    return asked is not None and len(asked) > 0 and float(asked.median()) < -0.5 * _SINKING


def _estimate_off(readings: Readings, first: float, last: float) -> float | None:
    """By how much [m] the autopilot's height fell behind the barometer's; None where it climbed as well."""
    tables = readings.tables
    if tables.ekf is None or tables.baro is None:
        return None
    height, barometer = -tables.ekf["p_d"].dropna(), tables.baro["alt"].dropna()
    if not len(height) or not len(barometer):
        return None
    begin = max(readings.flight.start, first - 2.0)
    gains = [float(at(last, each) - at(begin, each)) for each in (height, barometer)]
    return gains[1] - gains[0] if gains[0] < _BEHIND * gains[1] else None


def real_voltage(readings: Readings) -> pd.Series[float] | None:
    """Return the voltage of a battery that the motors load; None of a constant, of 0 V and of the supply of a board."""
    battery = readings.tables.battery
    if battery is None:
        return None
    voltage = battery["voltage"].loc[readings.belongs.start : readings.belongs.stop].dropna()
    voltage = voltage[voltage > 1.0]
    inside = voltage.loc[readings.flight.start : readings.flight.stop]
    if len(inside) < 3:
        return None
    before = voltage.loc[: readings.flight.start]
    rest = float(before.iloc[-min(len(before), 20) :].median()) if len(before) else float(inside.max())
    return voltage if rest - float(inside.min()) > _SAGS * rest else None


def cells(voltage: float) -> int | None:
    """Return how many lithium cells a battery before its flight has; None where the voltage is that of no number."""
    count = round(voltage / 4.05)
    return count if count >= 2 and 3.6 <= voltage / count <= 4.4 else None


def _battery(readings: Readings, voltage: pd.Series[float]) -> Iterator[Finding]:
    """Find a battery that was spent; what its owner set as a limit the autopilot reports itself."""
    inside = voltage.loc[readings.flight.start : readings.flight.stop]
    count = cells(float(inside.max()))
    if count is None:
        return
    t, volts = inside.index.to_numpy(np.float64), inside.to_numpy(np.float64)
    for first, last in stretches(t, volts < _EMPTY * count, join=2.0, shortest=_TIMER):
        least = float(volts[(t >= first) & (t <= last)].min())
        yield finding(
            "battery-low",
            f"The battery was below {_EMPTY * count:.1f} V ({_EMPTY} V a cell) for {last - first:.0f} s, "
            f"down to {least:.1f} V.",
            t=first,
            end=last,
            least_v=least,
        )
