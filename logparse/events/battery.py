"""A battery that sags or is empty in flight."""

from collections.abc import Iterator

import numpy as np

from core.findings import Severity
from logparse.events.event import FlightEvent
from logparse.events.stretches import Array, stretches, within
from logparse.flights import Flight
from logparse.tables import Tables

#: Voltage of a full cell [V], and of one that is empty under load: BATT_LOW_VOLT 10.5 V of three cells.
_FULL, _EMPTY = 4.25, 3.5
_SOURCE = "ArduPilot BATT_LOW_VOLT (default 10.5 V, 3.5 V per cell of three)"
#: Part of the voltage that may go within the reach [s] of a load.
_SAG, _REACH = 0.10, 3.0
#: ArduPilot's battery failsafe waits this long (BATT_LOW_TIMER), s.
_TIMER = 10.0


def battery_events(tables: Tables, flights: tuple[Flight, ...]) -> Iterator[FlightEvent]:
    """Yield low voltage and sudden sags in flight.

    Parameters
    ----------
    tables : Tables
    flights : tuple of Flight
    """
    if tables.battery is None:
        return
    voltage = tables.battery["voltage"].dropna()
    voltage = voltage[voltage > 1.0]  # 0 without a power module
    if len(voltage) < 5:
        return
    t, volts = voltage.index.to_numpy(np.float64), voltage.to_numpy(np.float64)
    # Filled from outside while armed craft are carried: only flights count.
    flying = within(t, [(flight.start, flight.stop) for flight in flights])
    if not flying.any():
        return
    limit, source = _limit(volts[flying], tables)
    if limit is not None:
        # A battery that is below from the take-off on has a wrong limit or a wrong calibration.
        wrong = float(np.mean(volts[flying] < limit)) > 0.95
        for first, last in stretches(t, flying & (volts < limit), join=2.0, shortest=_TIMER):
            least = float(volts[(t >= first) & (t <= last)].min())
            yield FlightEvent(
                id="battery-low",
                t=first,
                end=last,
                severity=Severity.INFO if wrong else Severity.WARNING,
                reason=f"The battery was below {limit:.1f} V for {last - first:.0f} s, down to {least:.1f} V.",
                advice="It was so from the start: check BATT_VOLT_MULT and the limit."
                if wrong
                else "Land earlier; check capacity and age of the battery.",
                evidence={"limit_v": limit, "least_v": least, "seconds": last - first},
                source=source,
            )
    yield from _sags(t, volts, flying)


def _limit(volts: Array, tables: Tables) -> tuple[float | None, str]:
    """Voltage below which the battery counts as empty; None where it cannot be known."""
    for name in ("BATT_LOW_VOLT", "FS_BATT_VOLTAGE"):
        value = tables.parameters.get(name)
        if value is not None and np.isfinite(value) and value > 1.0:
            # The default of three cells on a battery of many says nothing.
            if value > 0.6 * float(np.max(volts)):
                return float(value), name
            break
    cells = round(float(np.max(volts)) / 4.05)
    full = float(np.max(volts)) / max(cells, 1)
    if cells >= 2 and 3.9 <= full <= _FULL:
        return _EMPTY * cells, _SOURCE
    return None, ""


def _sags(t: Array, volts: Array, flying: np.ndarray) -> Iterator[FlightEvent]:
    step = float(np.median(np.diff(t)))
    reach = max(2, round(_REACH / max(step, 1e-3)))
    if len(volts) <= reach:
        return
    windows = np.lib.stride_tricks.sliding_window_view(np.concatenate((np.full(reach, volts[0]), volts)), reach + 1)
    before = windows.max(axis=1)
    sag = (before - volts) / before
    for first, last in stretches(t, flying & (sag > _SAG), join=2.0, shortest=step):
        inside = (t >= first) & (t <= last)
        worst = float((before - volts)[inside].max())
        yield FlightEvent(
            id="battery-sag",
            t=first,
            end=last,
            severity=Severity.WARNING,
            reason=f"The battery sagged by {worst:.1f} V, to {float(volts[inside].min()):.1f} V.",
            advice="Check plugs, cables and the age of the battery; a sag lowers the thrust in hand.",
            evidence={"sag_v": worst, "least_v": float(volts[inside].min())},
        )
