"""Whether the craft held the attitude that was asked of it: deviations, loss of control, loss of yaw, oscillation."""

from collections.abc import Callable, Iterator
from functools import cache, partial

import numpy as np
import numpy.typing as npt
import pandas as pd

from core.findings import Severity
from logparse.events.event import FlightEvent
from logparse.events.stretches import Array, stretches, within
from logparse.flights import Flight
from logparse.tables import Tables

#: Angle between the thrust axes asked for and flown [rad] that counts as lost, and as deviating; and the angle [rad] or
#: the time [s] from which being that far off is more than overshoot.
LOST, DEVIATING = np.radians(30.0), np.radians(15.0)
_TUMBLING, _HELPLESS = np.radians(60.0), 1.0
_LOST_SOURCE = "ArduCopter crash_check.cpp, CRASH_CHECK_ANGLE_DEVIATION_DEG 30 for CRASH_CHECK_TRIGGER_SEC 2"
_DEVIATING_SOURCE = "ArduCopter crash_check.cpp, THRUST_LOSS_CHECK_ANGLE_DEVIATION 15 deg"

#: Time [s] that a craft may take to reach a new target (heavy craft settle within it), and steps in which it is cut.
_FOLLOWS, _STEPS = 1.0, 10

#: Time [s] for which no craft flies while leaning that far from its target.
_NO_FLIGHT = 15.0

#: Modes that tumble on purpose, or fly without an attitude target.
_AEROBATIC = {"ACRO", "FLIP", "THROW", "TURTLE", "AUTOROTATE", "MANUAL", "STABILIZED_ACRO", "RATE"}

#: Rate [rad/s] by which a craft turns faster than asked, or against it, and for how long [s], when yaw is lost: a yaw
#: stick let go leaves a craft turning for about a second.
_YAW_EXCESS, _YAW_TIME = 1.5, 1.2

#: Oscillation: windows [s], lowest frequency [Hz], amplitude of the rate [rad/s] (20 deg/s), part of the power above
#: that frequency in one line, ratio to the same line in the rate asked for, and shortest duration [s].
_WINDOW, _LOWEST, _AMPLITUDE, _PURITY, _UNASKED, _LASTING = 2.0, 2.0, np.radians(20.0), 0.6, 1.5, 1.9

#: Slowest rates [Hz] in which an oscillation is looked for.
_SLOWEST = 20.0

#: Windows that are transformed at a time.
_PIECE = 1 << 10


def attitude_events(
    tables: Tables, flights: tuple[Flight, ...], error: "pd.Series[float] | None"
) -> Iterator[FlightEvent]:
    """Yield what went wrong with the attitude in flight.

    Parameters
    ----------
    tables : Tables
    flights : tuple of Flight
    error : Series or None
        As `attitude_error` gives it.
    """
    if error is not None:
        yield from _deviations(error, tables, flights)
    yield from _yaw(tables, flights)
    yield from _oscillations(tables, flights)


def attitude_error(tables: Tables) -> "pd.Series[float] | None":
    """Compute the angle by which the thrust axis flown is off its target, rad; NaN in modes that tumble on purpose.

    A target that jumps is reached a moment later: what counts is the distance from the way that the target took within
    the last second, so that a pilot who throws the stick about is not told that control was lost. Heading does not
    count. None where the log lacks attitude or its target.
    """
    if tables.attitude is None or tables.setpoints is None:
        return None
    wanted = tables.setpoints[["roll", "pitch"]].dropna()
    flown = tables.attitude[["roll", "pitch"]].dropna()
    if len(wanted) < 2 or len(flown) < 2:
        return None
    times = wanted.index.to_numpy(np.float64)
    t = times[(times >= flown.index[0]) & (times <= flown.index[-1])]
    axis = _directions(flown, t)
    way = np.stack([_directions(wanted, t - lag) for lag in np.linspace(0.0, _FOLLOWS, _STEPS + 1)])
    error = pd.Series(_off_the_way(axis, way), index=pd.Index(t, name=wanted.index.name))
    if tables.modes is not None and len(tables.modes):
        position = np.searchsorted(tables.modes.index.to_numpy(np.float64), t, side="right") - 1
        aerobatic = tables.modes["mode"].isin(_AEROBATIC).to_numpy()
        error[(position >= 0) & aerobatic[position.clip(0)]] = np.nan
    error[within(t, _chirps(tables))] = np.nan
    return error


def _directions(attitude: pd.DataFrame, t: Array) -> Array:
    """Thrust axis at times, a unit vector as in `_axis`, shape (n, 3)."""
    at = attitude.index.to_numpy(np.float64)
    axis = np.column_stack([np.interp(t, at, column) for column in _axis(attitude).T])
    return np.asarray(axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-9))


def _off_the_way(axis: Array, way: Array) -> Array:
    """Angle between directions (n, 3) and the nearest point of a way through others (points, n, 3), rad, shape (n,)."""
    begin, leg = way[:-1], np.diff(way, axis=0)
    part = np.sum((axis - begin) * leg, axis=2) / np.maximum(np.sum(leg**2, axis=2), 1e-12)
    nearest = begin + np.clip(part, 0.0, 1.0)[:, :, None] * leg
    cosine = np.sum(axis * nearest, axis=2) / np.maximum(np.linalg.norm(nearest, axis=2), 1e-9)
    return np.asarray(np.arccos(np.clip(cosine.max(axis=0), -1.0, 1.0)))


def _axis(attitude: pd.DataFrame) -> Array:
    """Direction of the thrust axis in a frame that turns with the heading, shape (n, 3)."""
    roll, pitch = attitude["roll"].to_numpy(np.float64), attitude["pitch"].to_numpy(np.float64)
    return np.column_stack([np.sin(pitch) * np.cos(roll), -np.sin(roll), np.cos(pitch) * np.cos(roll)])


def _deviations(error: "pd.Series[float]", tables: Tables, flights: tuple[Flight, ...]) -> Iterator[FlightEvent]:
    t, values = error.index.to_numpy(np.float64), error.to_numpy(np.float64)
    flying = within(t, [(flight.start + 0.5, flight.stop) for flight in flights])
    attitude = tables.attitude
    for first, last in stretches(t, flying & (values > DEVIATING), join=1.5):
        piece = values[(t >= first) & (t <= last)]
        if len(piece) < 2:
            continue  # one sample alone may be a step of the target
        worst = float(np.nanmax(piece))
        if last - first > _NO_FLIGHT and float(np.nanmedian(piece)) > DEVIATING:
            yield _disagreement(first, last, worst)
            continue
        when = float(t[(t >= first) & (t <= last)][int(np.nanargmax(piece))])
        over = t[(t >= first) & (t <= last) & (values > LOST)]
        lost = worst > _TUMBLING or (len(over) > 1 and float(over[-1] - over[0]) >= _HELPLESS)
        nearest = (
            attitude.iloc[[int(np.argmin(np.abs(attitude.index.to_numpy() - when)))]] if attitude is not None else None
        )
        lean = (
            ""
            if nearest is None
            else (
                f" (roll {np.degrees(nearest['roll'].iloc[0]):.0f}°, pitch {np.degrees(nearest['pitch'].iloc[0]):.0f}°)"
            )
        )
        yield FlightEvent(
            id="loss-of-control" if lost else "attitude-deviation",
            t=first,
            end=last,
            severity=Severity.ERROR if lost else Severity.WARNING,
            reason=f"The craft leaned up to {np.degrees(worst):.0f}° away from what was asked{lean}.",
            advice="Look for a motor, ESC, propeller or solder joint that failed, and for motors at their limit then.",
            evidence={"worst_rad": worst, "t_worst": when},
            source=_LOST_SOURCE if lost else _DEVIATING_SOURCE,
        )


def _disagreement(first: float, last: float, worst: float) -> FlightEvent:
    return FlightEvent(
        id="attitude-not-held",
        t=first,
        end=last,
        severity=Severity.WARNING,
        reason=f"Attitude and its target disagree by up to {np.degrees(worst):.0f}° for {last - first:.0f} s, which no "
        "flying craft does.",
        advice="One of both is wrong, or the log is of a test bench: do not trust attitude here.",
        evidence={"worst_rad": worst, "seconds": last - first},
    )


def _yaw(tables: Tables, flights: tuple[Flight, ...]) -> Iterator[FlightEvent]:
    """Find times in which the craft turned faster than asked, or against it, for longer than a stick needs."""
    if not tables.has("rates"):
        return
    columns = list(tables.columns("rates", ("w_z", "w_z_ref")))
    flown, asked = (column.to_numpy(np.float64) for column in columns)
    known = np.isfinite(flown) & np.isfinite(asked)
    if np.count_nonzero(known) < 3:
        return
    t, flown, asked = columns[0].index.to_numpy(np.float64)[known], flown[known], asked[known]
    excess = np.where(flown * asked >= 0.0, np.abs(flown) - np.abs(asked), np.abs(flown - asked))
    flying = within(t, [(flight.start + 0.5, flight.stop) for flight in flights])
    for first, last in stretches(t, flying & (excess > _YAW_EXCESS), join=0.3, shortest=_YAW_TIME):
        inside = (t >= first) & (t <= last)
        worst = float(np.max(excess[inside]))
        yield FlightEvent(
            id="loss-of-yaw-authority",
            t=first,
            end=last,
            severity=Severity.ERROR,
            reason=f"The craft turned up to {np.degrees(worst):.0f}°/s faster than asked for {last - first:.1f} s.",
            advice="Look for a failed motor, tilted motor mounts and motors at their limit.",
            evidence={"excess_rad_s": worst, "turned_rad": float(np.trapezoid(flown[inside], t[inside]))},
        )


def _oscillations(tables: Tables, flights: tuple[Flight, ...]) -> Iterator[FlightEvent]:
    """Find stretches in which a rate swings at one frequency without being asked to."""
    table = _swinging(tables)
    if table is None:
        return
    chirps = _chirps(tables)
    for axis, name in (("x", "roll"), ("y", "pitch"), ("z", "yaw")):
        # One axis at a time: all columns of a fast loop together are nearly as large as the log.
        flown = _known_column(tables, table, f"w_{axis}")
        if flown is None:
            continue
        asked = cache(partial(_asked, tables, table, f"w_{axis}_ref", name))
        rows = []
        for flight in flights:
            rows += _lines(flown, asked, flight.start + 1.0, flight.stop - 0.5)
        lines = np.array(rows).reshape(-1, 4)
        if not len(lines):
            continue
        t, hz, amplitude, purity = lines.T
        chirped = within(t, chirps)
        on = _stands_out(amplitude, purity) & ~chirped
        for first, last in stretches(t, on, join=1.1 * _WINDOW, shortest=_LASTING):
            inside = on & (t >= first) & (t <= last)
            strength, frequency = float(np.median(amplitude[inside])), float(np.median(hz[inside]))
            yield FlightEvent(
                id="oscillation",
                t=first - 0.5 * _WINDOW,
                end=last + 0.5 * _WINDOW,
                severity=Severity.WARNING,
                reason=f"The craft oscillated in {name} at {frequency:.1f} Hz with {np.degrees(strength):.0f}°/s.",
                advice=f"Lower the gains of {name} (ATC_RAT_*), or look for loose arms and props; do not raise gains.",
                evidence={"axis": name, "frequency_hz": frequency, "amplitude_rad_s": strength},
            )


def _chirps(tables: Tables) -> list[tuple[float, float]]:
    """Stretches in which SYSTEMID mode moved the craft, with a second around them."""
    chirp = tables.systemid
    if chirp is None:
        return []
    moving = np.asarray(np.isfinite(chirp["target"].to_numpy(np.float64)))
    found = stretches(chirp.index.to_numpy(np.float64), moving, join=2.0)
    return [(first - 1.0, last + 1.0) for first, last in found]


#: Columns of the tables that have angular rates, by their names in the table of rates; the fastest table first.
_RATES = {
    "rates": {name: name for name in ("w_x", "w_y", "w_z", "w_x_ref", "w_y_ref", "w_z_ref")},
    "imu": {"w_x": "gyro_x", "w_y": "gyro_y", "w_z": "gyro_z"},
}


def _swinging(tables: Tables) -> str | None:
    """Return the fastest table that has angular rates."""
    for table, names in _RATES.items():
        times = tables.times(table)
        if times is None or len(times) < 10 or 1.0 / float(np.median(np.diff(times))) < _SLOWEST:
            continue
        if any(_known_column(tables, table, name) is not None for name in names):
            return table
    return None


def _known_column(tables: Tables, table: str, name: str) -> "pd.Series[float] | None":
    """Return what is known of a rate; None of less than a few values."""
    if name not in _RATES[table]:
        return None
    column = next(tables.columns(table, (_RATES[table][name],)), None)
    known = None if column is None else column.dropna()
    return known if known is not None and len(known) > 10 else None


def _asked(tables: Tables, table: str, column: str, name: str) -> "pd.Series[float] | None":
    """Return the rate that was asked for, of logs without it that of the target of an angle."""
    logged = _known_column(tables, table, column)
    return _turned(tables, name) if logged is None else logged


def _turned(tables: Tables, name: str) -> "pd.Series[float] | None":
    """Rate at which the target of an angle turned, for logs without targets of rates: sticks thrown about are asked."""
    if tables.setpoints is None or name not in tables.setpoints or name == "yaw":
        return None
    target = tables.setpoints[name].dropna()
    if len(target) < 10:
        return None
    return pd.Series(np.gradient(target.to_numpy(np.float64), target.index.to_numpy(np.float64)), index=target.index)


def _lines(
    flown: "pd.Series[float]", asked: Callable[[], "pd.Series[float] | None"], start: float, stop: float
) -> list[tuple[float, float, float, float]]:
    """Strongest line of each window: (middle [s], frequency [Hz], amplitude [rad/s], part of the power in it).

    The amplitude is zero where the line was asked for; what was is looked at where a line stands out.
    """
    inside = flown.loc[start:stop]
    t = inside.index.to_numpy(np.float64)
    if len(t) < 10:
        return []
    dt = float(np.median(np.diff(t)))
    size = round(_WINDOW / dt)
    if size < 8 or stop - start < _WINDOW:
        return []
    grid = np.arange(t[0], t[-1], dt)
    count = 1 + (len(grid) - size) // (size // 2) if len(grid) >= size else 0
    if count < 1:
        return []
    spectra = _spectra(np.interp(grid, t, inside.to_numpy(np.float64)), size, count)
    hz = np.fft.rfftfreq(size, dt)
    band = (hz >= _LOWEST) & (hz <= 0.8 * hz[-1])
    if np.count_nonzero(band) < 4:
        return []
    power = np.where(band, spectra, 0.0)
    peak = np.argmax(power, axis=1)
    near = np.abs(hz[None, :] - hz[peak][:, None]) <= np.maximum(1.6 / _WINDOW, 0.15 * hz[peak])[:, None]
    line = np.sum(np.where(near, power, 0.0), axis=1)
    total = np.maximum(np.sum(power, axis=1), 1e-30)
    amplitude, purity = np.sqrt(2.0 * line), line / total
    if _stands_out(amplitude, purity).any() and (target := asked()) is not None:
        wanted = _spectra(np.interp(grid, target.index, target.to_numpy(np.float64)), size, count)
        amplitude[line < _UNASKED**2 * np.sum(np.where(near & band, wanted, 0.0), axis=1)] = 0.0
    middle = grid[np.arange(count) * (size // 2)] + 0.5 * _WINDOW
    return list(zip(middle.tolist(), hz[peak].tolist(), amplitude.tolist(), purity.tolist(), strict=True))


def _stands_out(amplitude: Array, purity: Array) -> npt.NDArray[np.bool_]:
    """Return where a line is an oscillation by its size and its part of the power."""
    return np.asarray((amplitude > _AMPLITUDE) & (purity > _PURITY))


def _spectra(values: Array, size: int, count: int) -> Array:
    """Power of each line in each window such that the sum is the variance, shape (count, lines)."""
    windows = np.lib.stride_tricks.sliding_window_view(values, size)[:: size // 2][:count]
    hann = np.hanning(size + 1)[:-1]
    linear = np.linspace(-1.0, 1.0, size)
    result = np.empty((count, size // 2 + 1))
    for first in range(0, count, _PIECE):  # as a whole they are several times the signal
        piece = windows[first : first + _PIECE]
        flat = piece - piece.mean(axis=1, keepdims=True)
        flat = flat - (flat @ linear / (linear @ linear))[:, None] * linear
        power = np.abs(np.fft.rfft(flat * hann, axis=1)) ** 2
        result[first : first + _PIECE] = 2.0 * power / (size * np.sum(hann**2))
    return result
