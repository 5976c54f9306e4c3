"""Inputs, outputs and instruments of a flight's axes on one uniform clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from logparse import FlightLog
from logparse.canonical.units import quantity
from sysid.frequency.axes import AXES, Axis, FrequencyError
from sysid.frequency.excitation import Chirp
from sysid.frequency.response import Complex, Floats

#: Samples farther apart than this many usual steps leave a hole that is bridged, but not counted.
_HOLE = 2.5


@dataclass(frozen=True, slots=True, eq=False)
class AxisRecord:
    """Signals of one stretch of a flight on a uniform clock.

    Attributes
    ----------
    name : str
        Which log and which stretch.
    start, dt : float
        First sample and step, s.
    inputs : ndarray, shape (N, m)
    output : ndarray, shape (N,)
    instruments : ndarray, shape (N, m)
        One for each input; the inputs themselves where nothing was injected.
    usable : ndarray of bool, shape (N,)
        False in holes of the log.
    band : tuple of float
        Frequencies that were excited, Hz.
    instrument : str
        What the instruments are; empty where they are the inputs.
    differenced : bool
        Whether the output is the central difference of what was measured. An integrator remembers everything before a
        window, which bends its response at fewer than some twenty cycles per window; its derivative remembers nothing.
    """

    name: str
    start: float
    dt: float
    inputs: Floats
    output: Floats
    instruments: Floats
    usable: NDArray[np.bool_]
    band: tuple[float, float]
    instrument: str
    differenced: bool = False

    @property
    def duration(self) -> float:
        """Return the length, s."""
        return (len(self.output) - 1) * self.dt

    def difference(self) -> AxisRecord:
        """Return the record with the central difference of its output, one sample shorter at both ends."""
        inner = slice(1, -1)
        return replace(
            self,
            start=self.start + self.dt,
            inputs=self.inputs[inner],
            output=(self.output[2:] - self.output[:-2]) / (2.0 * self.dt),
            instruments=self.instruments[inner],
            usable=self.usable[2:] & self.usable[1:-1] & self.usable[:-2],
            differenced=True,
        )

    def difference_response(self, hz: Floats) -> Complex:
        """Return the frequency response of the central difference, shape (F,)."""
        return np.asarray(1j * np.sin(2.0 * np.pi * hz * self.dt) / self.dt)


@dataclass(frozen=True, slots=True, eq=False)
class RateSignals:
    """What the rate controllers of a log said: their outputs, what they measured and what they wanted.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Times of validity (of the gyro sample), s.
    columns : dict of str to ndarray, shape (N,)
        By name, as in `Axis`.
    with_chirp : bool
        Whether the outputs contain a chirp added at the mixer; RATE's do, sums of PID terms do not.
    """

    t: Floats
    columns: dict[str, Floats]
    with_chirp: bool

    @property
    def step(self) -> float:
        """Return the usual step, s."""
        return float(np.median(np.diff(self.t)))


def rate_signals(log: FlightLog) -> RateSignals:
    """Read the rate controllers of a log: RATE, or the PID messages where it has none.

    Raises
    ------
    FrequencyError
        Without either.
    """
    table = log.tables.rates
    if table is None or len(table) < 16:
        raise FrequencyError(
            f"{log.path.name}: no RATE or PID messages; set LOG_BITMASK to include attitude (fast) or PID, "
            "and fly one minute of short stick inputs on each axis"
        )
    t = table.index.to_numpy(np.float64)
    columns = {str(name): table[name].to_numpy(np.float64) for name in table.columns}
    from_rate = "RATE" in log.messages
    if from_rate:
        frame = log.messages["RATE"]
        times = frame.index.to_numpy(np.float64)
        order = np.argsort(times, kind="stable")
        for name, source in (("a_up", "A"), ("a_up_ref", "ADes")):
            if source in frame:
                columns[name] = np.interp(t, times[order], quantity(frame, source, "cm/s/s")[order])
    return RateSignals(t, columns, from_rate)


def chirp_signal(log: FlightLog, t: Floats, chirp: Chirp) -> Floats:
    """Interpolate a chirp as it was added at the times `t`; zero outside it."""
    table = log.tables.systemid
    assert table is not None
    times = table.index.to_numpy(np.float64)
    inside = (times >= chirp.start) & (times <= chirp.stop)
    return np.asarray(np.interp(t, times[inside], table["target"].to_numpy(np.float64)[inside], 0.0, 0.0))


def on_uniform_clock(t: Floats, columns: Sequence[Floats]) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Bring samples that are nearly even in time onto an even clock by cubic splines.

    All columns pass through the same interpolation, which therefore cancels in their ratio.

    Returns
    -------
    clock : ndarray, shape (N,)
    values : ndarray, shape (N, len(columns))
    usable : ndarray of bool, shape (N,)
        False in holes, which are bridged by straight lines.
    """
    values = np.column_stack(columns)
    known = np.isfinite(values).all(axis=1)
    t, values = t[known], values[known]
    if len(t) < 8:
        raise FrequencyError(f"{len(t)} samples are no record")
    step = float(np.median(np.diff(t)))
    clock = t[0] + step * np.arange(int((t[-1] - t[0]) / step + 1e-6) + 1)
    holes = np.diff(t) > _HOLE * step
    right = np.clip(np.searchsorted(t, clock), 1, len(t) - 1)
    usable = ~holes[right - 1]
    if holes.any():
        between = [np.interp(clock, t, column) for column in values.T]
        bridged_t = np.union1d(t, clock[~usable])
        bridged = np.column_stack([np.interp(bridged_t, t, column) for column in values.T])
        smooth = make_interp_spline(bridged_t, bridged, k=3)(clock)
        result = np.where(usable[:, None], smooth, np.column_stack(between))
    else:
        result = make_interp_spline(t, values, k=3)(clock)
    return clock, np.asarray(result, dtype=np.float64), usable


def chirp_record(log: FlightLog, signals: RateSignals, axis: Axis, chirp: Chirp) -> AxisRecord:
    """Cut the record of one chirp: the axis' controller output, its answer, and the chirp as instrument.

    Raises
    ------
    FrequencyError
        When the log lacks the signals of the axis within the chirp.
    """
    rows = (signals.t >= chirp.start) & (signals.t <= chirp.stop)
    t = signals.t[rows]
    if len(t) < 16:
        raise FrequencyError(f"{log.path.name}: no RATE or PID rows within the chirp at {chirp.start:.1f} s")
    missing = [n for n in (axis.input, axis.output) if n not in signals.columns]
    if missing:
        raise FrequencyError(f"{log.path.name}: the log has no {' and no '.join(missing)} for the {axis.name} axis")
    added = chirp_signal(log, t, chirp)
    command = signals.columns[axis.input][rows]
    if chirp.at_mixer and not signals.with_chirp and chirp.axis == axis.name:
        command = command + added
    clock, values, usable = on_uniform_clock(t, [command, signals.columns[axis.output][rows], added])
    return AxisRecord(
        name=f"{log.path.name} [{chirp.start:.1f}-{chirp.stop:.1f} s]",
        start=float(clock[0]),
        dt=float(clock[1] - clock[0]),
        inputs=values[:, :1],
        output=values[:, 1],
        instruments=values[:, 2:],
        usable=usable,
        band=(chirp.low, chirp.high),
        instrument=f"chirp of SID_AXIS {chirp.sid_axis}",
    )


__all__ = ["AXES", "AxisRecord", "RateSignals", "chirp_record", "chirp_signal", "on_uniform_clock", "rate_signals"]
