"""Records of chirps: what went into an axis and came out of it while one was flown, with the chirp as instrument."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy

from logparse import FlightLog
from sysid.frequency.axes import Axis, FrequencyError
from sysid.frequency.excitation import Chirp
from sysid.frequency.rate_signals import RateSignals
from sysid.frequency.records import AxisRecord, Logged, lost_one_by_one, on_uniform_clock, refuse_scattered
from sysid.frequency.response import Floats

#: Order of the spline through the rows of a chirp, and the fewest that it takes.
_ORDER = 13
FEWEST_ROWS = 4 * _ORDER

#: Ratio of frequencies that a chirp passes within a hole from which on they are missing.
_SKIPPED = 1.15


def chirp_record(
    log: FlightLog, signals: RateSignals, axis: Axis, chirp: Chirp, beside: Sequence[Axis] = ()
) -> AxisRecord:
    """Cut the record of one chirp: the axis' controller output, its answer, and the chirp as instrument.

    With the outputs of the axes `beside`, what each command does is told apart; into those that the chirp is not of
    nothing was injected. FrequencyError when the log lacks the signals within the chirp.
    """
    chirp = below_folding(log, chirp, signals.t)
    rows = signals.within(chirp.start, chirp.stop)
    t = signals.t[rows]
    if len(t) < 16:
        raise FrequencyError(f"{log.path.name}: no RATE or PID rows within the chirp at {chirp.start:.1f} s")
    axes = (*beside, axis)
    missing = [n for n in (*(each.input for each in axes), axis.output) if n not in signals.columns]
    if missing:
        raise FrequencyError(f"{log.path.name}: the log has no {' and no '.join(missing)} for the {axis.name} axis")
    commands = []
    for each in axes:
        late = chirp.at_mixer and not signals.with_chirp and chirp.axis == each.name
        commands.append(signals.columns[each.input][rows] + (chirp_signal(log, t, chirp) if late else 0.0))
    added = [float(not beside or chirp.axis == each.name) for each in axes]
    answer = signals.columns[axis.output][rows]
    record = record_of_chirp(log, chirp, t, commands, answer, lambda at: np.outer(chirp_signal(log, at, chirp), added))
    return replace(record, source=signals.source)


def record_of_chirp(
    log: FlightLog,
    chirp: Chirp,
    t: Floats,
    commands: Sequence[Logged],
    answer: Logged,
    added: Callable[[Floats], Floats],
) -> AxisRecord:
    """Arrange what went in and came out within a chirp, at times t [s], with what the chirp added, (N, inputs).

    The instrument is not taken from the same rows: where some are lost, what that adds to command and answer, at all
    frequencies, must not be in it.
    """
    clock, values, usable = on_uniform_clock(t, [*commands, answer])
    refuse_scattered(log, lost_one_by_one(t, float(clock[1] - clock[0])))
    table = log.tables.systemid
    assert table is not None
    hz = np.interp(clock, table.index.to_numpy(np.float64), table["frequency"].to_numpy(np.float64) / (2.0 * np.pi))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~usable, [False]]).astype(int)))
    holes = [(float(hz[a]), float(hz[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return AxisRecord(
        name=f"{log.path.name} [{chirp.start:.1f}-{chirp.stop:.1f} s]",
        start=float(clock[0]),
        dt=float(clock[1] - clock[0]),
        inputs=values[:, :-1],
        output=values[:, -1],
        instruments=added(clock),
        usable=usable,
        band=(chirp.low, chirp.high),
        instrument=f"chirp of SID_AXIS {chirp.sid_axis}",
        unswept=tuple((low, high) for low, high in holes if high > _SKIPPED * low > 0.0),
    )


def chirp_signal(log: FlightLog, t: Floats, chirp: Chirp) -> Floats:
    """Interpolate a chirp as it was added at the times `t` [s]; zero outside it; in the unit of `Tables.systemid`."""
    table = log.tables.systemid
    assert table is not None
    times = table.index.to_numpy(np.float64)
    inside = (times >= chirp.start) & (times <= chirp.stop)
    return np.asarray(np.interp(t, times[inside], table["target"].to_numpy(np.float64)[inside], 0.0, 0.0))


def chirp_spline(log: FlightLog, chirp: Chirp, column: str = "target") -> tuple[Floats, Callable[[Floats], Floats]]:
    """Return times of a chirp's rows and a spline through all of them, of what was added or of another column.

    A spline through rows that end where the chirp is fast swings beyond all bounds there. Order 13: at 0.4 of the
    logging rate a cubic is wrong by 20 %, this one by 0.3 %.
    """
    table = log.tables.systemid
    assert table is not None
    times, values = table.index.to_numpy(np.float64), table[column].to_numpy(np.float64)
    inside = (times >= chirp.start) & (times <= chirp.stop) & np.isfinite(values)
    if np.count_nonzero(inside) < FEWEST_ROWS:
        raise FrequencyError(f"{log.path.name}: too few rows of the chirp at {chirp.start:.1f} s")
    return times[inside], scipy.interpolate.make_interp_spline(times[inside], values[inside], k=_ORDER)


def below_folding(log: FlightLog, chirp: Chirp, t: Floats) -> Chirp:
    """Cut a chirp to the time in which it sweeps what rows at `t` [s] can show; above, it folds onto the rest.

    Rows may come slower outside chirps, as those of RATE do.
    """
    inside = t[(t >= chirp.start) & (t <= chirp.stop)]
    step = float(np.median(np.diff(inside))) if len(inside) > 1 else np.inf
    table = log.tables.systemid
    assert table is not None
    times = table.index.to_numpy(np.float64)
    hz = table["frequency"].to_numpy(np.float64) / (2.0 * np.pi)
    shown = times[(times >= chirp.start) & (times <= chirp.stop) & (hz <= 0.5 / step)]
    if chirp.high <= 0.5 / step or len(shown) < 8:
        return chirp
    return replace(chirp, start=float(shown[0]), stop=float(shown[-1]), high=0.5 / step)
