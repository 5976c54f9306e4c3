"""Whether the thrust and the battery sufficed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from core.catalogue import finding
from core.findings import Happening
from pipeline.flight.account.readings import HOLDING, Readings, at, stretches

#: Full throttle, and part of the reserve above the usual one at which a craft should climb (7-9-2014_24 sank for three
#: seconds before its throttle was full); lean [rad] that costs no lift.
FULL, _RESERVE, _UPRIGHT = 0.9, 0.25, np.radians(25.0)
#: Sink and climb [m/s] that are more than the noise of a barometer's slope over a second, for how long [s] a throttle
#: that runs away (1.3 in 31-3-2015_83, 0.4 in calm 6-3-2014_7) and a lift that is lost last, and the interruption [s]
#: that ends neither.
SINKING, _LASTING, _LOST, _PAUSE = 1.0, 0.75, 1.5, 0.7
#: Part of the sink that is left in the second half of such a time where throttle catches a descent: 0.5 in peterbarker
#: 1.BIN at 771 s.
_CAUGHT = 0.75
#: Share of its voltage that a battery sags at least when motors run; less is the supply of a board, or a constant.
_SAGS = 0.01


def power_happenings(readings: Readings) -> Iterator[Happening]:
    """Yield lost lift, and throttle that ran away."""
    throttle, sink = readings.throttle, readings.sink
    if throttle is not None and sink is not None:
        yield from _full_throttle(readings, throttle, sink)


def _full_throttle(readings: Readings, throttle: pd.Series[float], sink: pd.Series[float]) -> Iterator[Happening]:
    t, given = throttle.index.to_numpy(np.float64), throttle.to_numpy(np.float64)
    down, flying = at(t, sink), readings.flying(t)
    usual = float(np.median(given[flying])) if flying.any() else 1.0
    lean = readings.lean
    # A craft that leans sinks, and the autopilot's own height may be what sinks.
    tells = np.zeros(len(t), dtype=bool) if lean is None or readings.own_height else at(t, lean) < _UPRIGHT
    much = flying & tells & (given >= min(FULL, usual + _RESERVE * (1.0 - usual)))
    for first, last, rows in stretches(t, much & (down > SINKING), join=_PAUSE, shortest=_LOST):
        early, late = (float(np.median(half)) for half in np.array_split(down[rows], 2))
        worst, most = float(np.max(down[rows])), float(np.median(given[rows]))
        if late > _CAUGHT * early:
            yield finding(
                "lift-lost",
                f"The craft sank at up to {worst:.1f} m/s under {100.0 * most:.0f} % throttle, where "
                f"{100.0 * usual:.0f} % usually carried it.",
                t=first,
                end=last,
                sink_m_s=worst,
            )
    # The autopilot's own doing: throttle at its limit while the craft climbs already, in a mode that holds height.
    holding = readings.in_modes(t, HOLDING) & ~readings.mode_forgotten(t)
    wrong = flying & (given >= FULL) & holding & (down < -SINKING)
    for first, last, rows in stretches(t, wrong, join=_PAUSE, shortest=_LASTING):
        asked_to, behind = _climb_asked(readings, first, last), _estimate_off(readings, first, last)
        if asked_to or (asked_to is None and behind is None):
            continue
        why = " unasked" if behind is None else f", for its own height fell {behind:.0f} m behind the barometer's"
        yield finding(
            "throttle-runaway",
            f"The autopilot held full throttle and climbed at {-float(down[rows].min()):.0f} m/s{why}.",
            t=first,
            end=last,
            height_error_m=behind,
        )


def _climb_asked(readings: Readings, first: float, last: float) -> bool | None:
    """Return whether rate or height of the target rose in a stretch; None where neither was logged."""
    targets = (column.loc[first:last].dropna() for column in readings.tables.columns("setpoints", ("v_d", "p_d")))
    known = {str(target.name): target for target in targets if len(target)}
    rates = [known["v_d"].median()] if "v_d" in known else []
    if "p_d" in known:
        rates.append((known["p_d"].iloc[-1] - known["p_d"].iloc[0]) / (last - first))
    return min(rates) < -SINKING if rates else None


def _estimate_off(readings: Readings, first: float, last: float) -> float | None:
    """By how much [m] the autopilot's height fell behind the barometer's; None where it climbed as well."""
    tables = readings.tables
    if tables.ekf is None or tables.baro is None:
        return None
    height, barometer = -tables.ekf["p_d"].dropna(), tables.baro["alt"].dropna()
    if not len(height) or not len(barometer):
        return None
    begin = max(readings.flight.start, first - 2.0)
    gains = [float(at(last, column) - at(begin, column)) for column in (height, barometer)]
    return gains[1] - gains[0] if gains[0] < 0.0 else None


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
