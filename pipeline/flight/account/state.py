"""The state of the craft in numbers that never move: height, speed, battery, vibration, GPS, hover throttle, motors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from core.units import EARTH_RADIUS
from logparse.heights import ground_level, smoothed
from logparse.tables import between
from pipeline.flight.account.power import real_voltage
from pipeline.flight.account.readings import ACCELERATION, AT_LIMIT, SATELLITES, Readings
from pipeline.flight.account.vibration import Floats
from pipeline.results.account import BatteryReading, GpsReading, HoverReading, MotorsReading, Reading, VibrationReading
from pipeline.results.span import Span, within
from sysid.rotors.battery import sag_resistance

#: Steady hover: climb [m/s] and lean [rad] below these; the first and last of it [s] that are compared, and the least.
_STEADY, _UPRIGHT, _ENDS, _FEWEST = 0.5, np.radians(11.0), 20.0, 10.0
#: ArduCopter's glitch radius [m] (GPSGLITCH_RADIUS), and time [s] beyond which one fix does not foretell the next.
GLITCH_RADIUS, SILENT = 5.0, 2.0
#: Dilution of a position beyond which it is not believed.
_DILUTION = 4.0
#: Time [s] before lift-off, and from a second after touch-down, in which the voltage at rest is read.
_AT_REST = 4.0
#: Highest voltage of a full lithium cell as logged: a battery has the fewest cells that bear what it shows at rest.
_FULL = 4.4
#: What sources of height are called.
SOURCES = {"baro": "barometer", "autopilot": "autopilot", "gps": "GPS"}


def height(readings: Readings) -> Reading | None:
    """Return the largest height above the ground that the flight left, with what every source says of it."""
    flight = readings.flight
    gains: dict[str, tuple[float, float]] = {}
    for source, known in readings.heights:
        inside = smoothed(known.loc[flight.start : flight.stop])
        ground = ground_level(known, flight)
        if len(inside) > 2 and ground is not None:
            top = int(np.argmax(inside.to_numpy()))
            gains[SOURCES[source]] = float(inside.iloc[top]) - ground, float(inside.index[top])
    if not gains:
        return None
    source = next(iter(gains))
    value, t = gains.pop(source)
    return Reading(value=value, unit="m", t=t, source=source, others={name: gain for name, (gain, _) in gains.items()})


def ground_speed(readings: Readings, doubtful: Sequence[Span]) -> Reading | None:
    """Return the largest horizontal speed by GPS, jumps and doubtful stretches left out."""
    rows = _fixes(readings, doubtful)
    rows = rows[~(rows["satellites"] < SATELLITES) & rows["v_n"].notna() & rows["v_e"].notna()]
    t = rows.index.to_numpy(np.float64)
    change = np.hypot(np.diff(rows["v_n"]), np.diff(rows["v_e"])) / np.maximum(np.diff(t), 1e-3) <= ACCELERATION
    rows = rows[np.concatenate(([True], change)) & np.concatenate((change, [True]))] if len(rows) else rows
    return _largest(pd.Series(np.hypot(rows["v_n"], rows["v_e"]), index=rows.index), "m/s")


def distance(readings: Readings, doubtful: Sequence[Span]) -> Reading | None:
    """Return the largest horizontal distance from the take-off by GPS, doubtful stretches left out and jumps undone."""
    rows = _fixes(readings, doubtful)
    step, foretold, _ = steps(rows)
    # Longer than its greatest speed allows: what was left out between two fixes may have been a jump for good.
    speed, t = np.hypot(rows["v_n"], rows["v_e"]), rows.index.to_numpy(np.float64)
    jumped = np.linalg.norm(step, axis=1) > speed.max() * np.diff(t, prepend=t[:1]) + GLITCH_RADIUS
    step[jumped] = np.nan_to_num(foretold[jumped])
    far = _largest(pd.Series(np.linalg.norm(np.cumsum(step, axis=0), axis=1), index=rows.index), "m")
    return far if far is not None and far.value > 0.0 else None  # a position that never moves has stopped


def steps(gps: pd.DataFrame) -> tuple[Floats, Floats, Floats]:
    """Return the steps from fix to fix [m], what speed foretold of them, and by how much they left it.

    North and east, shape (n, 2), and metres, shape (n,): 0 where none is known.
    """
    lat, lon, t = gps["lat"].to_numpy(np.float64), gps["lon"].to_numpy(np.float64), gps.index.to_numpy(np.float64)
    step = EARTH_RADIUS * np.column_stack([np.diff(lat, prepend=lat[:1]), np.diff(lon, prepend=lon[:1]) * np.cos(lat)])
    dt, speed = np.diff(t, prepend=t[:1]), gps[["v_n", "v_e"]].ffill(limit=1).shift().to_numpy(np.float64)
    foretold = speed * dt[:, None]
    missed = np.linalg.norm(step - foretold, axis=1) - 0.5 * ACCELERATION * dt**2
    missed[~np.isfinite(missed) | (dt > SILENT)] = 0.0
    return step, foretold, np.maximum(missed, 0.0)


def _fixes(readings: Readings, doubtful: Sequence[Span]) -> pd.DataFrame:
    """Return the rows of GPS in flight that tell a position; none without a receiver."""
    gps = readings.tables.gps
    if gps is None:
        return pd.DataFrame(columns=["lat", "lon", "v_n", "v_e", "satellites"], dtype=float)
    rows = gps.loc[readings.flight.start : readings.flight.stop]
    good = (rows["fix"] >= 3.0) & rows["lat"].notna() & ~(rows["hdop"] >= _DILUTION)
    return rows[good & ~within(rows.index.to_numpy(np.float64), doubtful)]


def _largest(values: pd.Series, unit: str) -> Reading | None:
    """Return the largest value, of medians of three."""
    smooth = values.rolling(3, center=True).median().dropna()
    if not len(smooth):
        return None
    top = int(np.argmax(smooth.to_numpy()))
    return Reading(value=float(smooth.iloc[top]), unit=unit, t=float(smooth.index[top]), source="GPS")


def climb_and_sink(readings: Readings, until: float) -> tuple[Reading | None, Reading | None]:
    """Return the fastest climb and sink of the credible height before a fall or the touch-down at `until`."""
    if readings.sink is None:
        return None, None
    down = readings.sink.loc[readings.flight.start : until].dropna()
    if len(down) < 3:
        return None, None
    up, low = int(np.argmin(down.to_numpy())), int(np.argmax(down.to_numpy()))
    times = down.index.to_numpy(np.float64)
    return (
        Reading(value=-float(down.iloc[up]), unit="m/s", t=float(times[up]), source="height over a second"),
        Reading(value=float(down.iloc[low]), unit="m/s", t=float(times[low]), source="height over a second"),
    )


def battery(readings: Readings) -> BatteryReading | None:
    """Return voltages before, after and in flight; None where no battery is measured."""
    voltage = real_voltage(readings)
    if voltage is None:
        return None
    flight = readings.flight
    before, inside = voltage.loc[flight.start - _AT_REST : flight.start], voltage.loc[flight.start : flight.stop]
    after = voltage.loc[flight.stop + 1.0 : flight.stop + 1.0 + _AT_REST]
    start = float((before if len(before) else inside.iloc[:3]).median())
    table = readings.tables.battery
    flown = None if table is None else table.loc[flight.start : flight.stop]
    columns = [] if flown is None else [flown.index, flown["voltage"], flown["current"]]
    end = float(after.median()) if len(after) else float(inside.iloc[-1])
    at_rest = [float(part.median()) for part in (before, after) if len(part)]
    return BatteryReading(
        start=start,
        end=end,
        lowest=float(inside.min()),
        cells=math.ceil(max(at_rest) / _FULL) if at_rest else None,
        sag=sag_resistance(*(column.to_numpy(np.float64) for column in columns)) if columns else None,
    )


def worst_vibration(readings: Readings) -> VibrationReading | None:
    """Return the worst vibration of the flight, when, and how often accelerometers clipped."""
    measured = readings.vibration
    if measured is None or measured.relative:
        return None
    inside = (measured.t >= readings.flight.start) & (measured.t <= readings.flight.stop)
    if not inside.any():
        return None
    axes, t = np.nan_to_num(measured.axes[inside]), measured.t[inside]
    row, axis = (int(index) for index in np.unravel_index(int(np.argmax(axes)), axes.shape))
    return VibrationReading(
        worst=float(axes[row, axis]),
        p95=float(np.percentile(measured.level[inside], 95.0)),
        t=float(t[row]),
        axis="XYZ"[axis] if axes.shape[1] == 3 else "",
        clips=measured.clipped(readings.flight),
        advised=measured.advised,
        harmful=measured.harmful,
        source=measured.source,
    )


def gps(readings: Readings) -> GpsReading | None:
    """Return satellites and share of fixes in flight; None without a receiver."""
    table = readings.tables.gps
    rows = None if table is None else table.loc[readings.flight.start : readings.flight.stop]
    if rows is None or not len(rows):
        return None
    satellites, hdop = rows["satellites"].dropna(), rows["hdop"].dropna()
    return GpsReading(
        satellites_least=int(satellites.min()) if len(satellites) else None,
        satellites_median=int(satellites.median()) if len(satellites) else None,
        fix_share=float(((rows["fix"] >= 3.0) & rows["lat"].notna()).mean()),
        hdop=float(hdop.median()) if len(hdop) else None,
    )


def hover(readings: Readings) -> HoverReading | None:
    """Return the throttle of the first and the last steady hover; None where less than ten seconds are steady."""
    throttle, sink, lean = readings.throttle, readings.sink, readings.lean
    if throttle is None or sink is None:
        return None
    inside = between(throttle, readings.flight.start + 1.0, readings.flight.stop - 1.0)
    t = inside.index.to_numpy(np.float64)
    if len(t) < 10:
        return None
    steady = np.abs(np.interp(t, sink.index.to_numpy(np.float64), sink.to_numpy(np.float64))) < _STEADY
    if lean is not None:
        steady &= np.interp(t, lean.index.to_numpy(np.float64), lean.to_numpy(np.float64)) < _UPRIGHT
    step = float(np.median(np.diff(t)))
    count = round(_ENDS / max(step, 1e-3))
    values = inside.to_numpy(np.float64)[steady]
    if len(values) * step < _FEWEST:
        return None
    return HoverReading(start=float(np.median(values[:count])), end=float(np.median(values[-count:])))


def motors(readings: Readings) -> MotorsReading | None:
    """Return how hard each motor worked; None without motor outputs."""
    outputs = readings.outputs
    if outputs is None or not outputs.shape[1]:
        return None
    mean = {str(name).removeprefix("m"): float(outputs[name].mean()) for name in outputs if outputs[name].notna().any()}
    if not mean:
        return None
    return MotorsReading(
        mean=mean,
        hardest=max(mean, key=lambda name: mean[name]),
        at_limit=float((outputs >= 1.0 - AT_LIMIT).any(axis=1).mean()),
    )
