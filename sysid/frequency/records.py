"""Inputs, outputs and instruments of an axis on one uniform clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from core.cubic_spline import cubic_spline
from logparse import FlightLog
from sysid.frequency.axes import Axis, FrequencyError
from sysid.frequency.response import Complex, Floats
from sysid.records.experiment import MIN_SAMPLES, Experiment
from sysid.records.filtering import low_pass_taps

#: Samples in single or double precision.
Logged = NDArray[np.floating[Any]]

#: Samples farther apart than this many usual steps leave a hole that is bridged, but not counted.
_HOLE = 2.5

#: Part of the rows beyond which those lost one by one leave no response: with a third lost, gains that looked good were
#: up to 29 % off.
_MOST_LOST = 0.2

#: Frequencies [Hz] that are looked at where nobody says what was swept; the coherence tells which count.
ORDINARY_BAND = (0.15, 60.0)

#: Names of inputs and outputs of an axis in experiments.
_NAMES = {
    "roll": (("roll", "out_roll", "u_roll"), ("w_x", "p", "gyro_x", "rate")),
    "pitch": (("pitch", "out_pitch", "u_pitch"), ("w_y", "q", "gyro_y", "rate")),
    "yaw": (("yaw", "out_yaw", "u_yaw"), ("w_z", "r", "gyro_z", "rate")),
    "vertical": (("thrust", "throttle", "out_thrust"), ("a_up", "acceleration")),
}


@dataclass(frozen=True, slots=True, eq=False)
class AxisRecord:
    """Signals of one stretch of a flight on a uniform clock."""

    name: str  #: Which log and which stretch.
    #: First sample and step, s.
    start: float
    dt: float
    inputs: Logged  #: shape (N, m)
    output: Logged  #: shape (N,)
    instruments: Logged  #: shape (N, m): One for each input; the inputs themselves where nothing was injected.
    usable: NDArray[np.bool_]  #: shape (N,): False in holes of the log.
    band: tuple[float, float]  #: Frequencies that were excited, Hz.
    instrument: str  #: What the instruments are; empty where they are the inputs.
    #: Whether the output is the central difference of what was measured. An integrator remembers everything before a
    #: window, which bends its response at fewer than some twenty cycles per window; its derivative remembers nothing.
    differenced: bool = False
    #: Output per input in steady flight, where both are known as they are (thrust, throttle).
    trim: float | None = None
    source: str = ""  #: What the signals are, where they are not the rate controller's.
    #: Frequencies [Hz], from and to, that a chirp swept while nothing was logged: what leaks there from others is none.
    unswept: tuple[tuple[float, float], ...] = ()
    #: Standard deviation of ln abs(G), common to all frequencies, from rows that are missing one by one.
    common: float = 0.0

    @property
    def duration(self) -> float:
        """Return the length, s."""
        return (len(self.output) - 1) * self.dt

    def alone(self) -> AxisRecord:
        """Return the record without the inputs of other axes."""
        return replace(self, inputs=self.inputs[:, :1], instruments=self.instruments[:, :1])

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

    def remainders(self) -> Callable[[Callable[[Floats], Complex]], AxisRecord]:
        """Return what takes the answer of a model to the first input out of the record, for one model after another.

        Models map frequencies above zero, Hz, to the response of what was measured, before any difference.
        """
        # What is beyond the end comes back at the beginning, after the time over which a craft remembers at most.
        # After so many seconds a craft has forgotten what it was told.
        beyond = min(len(self.output), round(200.0 / self.dt))
        size = scipy.fft.next_fast_len(len(self.output) + beyond)
        hz = np.fft.rfftfreq(size, self.dt).astype(np.float64)
        spectrum = np.fft.rfft(self.inputs[:, 0] - np.mean(self.inputs[:, 0]), size)
        if self.differenced:
            spectrum *= self.difference_response(hz)
        spectrum[0] = 0.0

        def without(model: Callable[[Floats], Complex]) -> AxisRecord:
            answer = spectrum.copy()
            answer[1:] *= model(hz[1:])
            return replace(self, output=self.output - np.fft.irfft(answer, size)[: len(self.output)])

        return without

    def difference_response(self, hz: Floats) -> Complex:
        """Return the frequency response of the central difference, shape (F,)."""
        return np.asarray(1j * np.sin(2.0 * np.pi * hz * self.dt) / self.dt)


def on_uniform_clock(t: Floats, columns: Sequence[Logged]) -> tuple[Floats, Logged, NDArray[np.bool_]]:
    """Resample rows of finite samples that are nearly even in time to an even clock.

    By cubic splines, which all pass through alike and which therefore cancel in their ratio.

    Returns `clock` (N,), from the first row with the usual step between them; `values` (N, len(columns)), in the
    precision of the columns; `usable` (N,): false in holes, which are bridged by straight lines.
    """
    known = np.logical_and.reduce([np.isfinite(column) for column in columns])
    known[1:] &= t[1:] > np.maximum.accumulate(t[:-1])  # damage repeats times
    rows = slice(None) if known.all() else known
    t = t[rows]
    if len(t) < MIN_SAMPLES:
        raise FrequencyError(f"only {len(t)} of {len(columns[0])} samples are numbers: fly and log it again")
    step, span = float(np.median(np.diff(t))), float(t[-1] - t[0])
    # Damaged times may span years.
    if span > 20.0 * step * len(t):
        raise FrequencyError(f"{len(t)} samples over {span:.0f} s are no record: it is nearly all holes")
    clock = t[0] + step * np.arange(int(span / step + 1e-6) + 1)
    hole = np.diff(t) > _HOLE * step
    usable = ~hole[np.clip(np.searchsorted(t, clock), 1, len(t) - 1) - 1]
    bridged = t if usable.all() else np.union1d(t, clock[~usable])
    values = np.empty((len(clock), len(columns)), np.result_type(*columns))
    # One after the other: all in double precision are several times a long log.
    for k, column in enumerate(columns):
        known_values = column[rows].astype(np.float64, copy=False)
        through = known_values if bridged is t else np.interp(bridged, t, known_values)
        values[:, k] = cubic_spline(bridged, through[:, None], clock)[:, 0]
        values[~usable, k] = np.interp(clock[~usable], t, known_values)
    return clock, values, usable


def lost_one_by_one(t: Floats, step: float) -> float:
    """Return how many rows are missing one by one for each that is there.

    Rows that were slower for a while are not: beside a lost one there is one at its time.

    `t` (N,): times of rows, s.
    """
    steps = np.diff(t) / step
    long = steps > 1.5
    alone = long & (steps < 10.0) & ~(np.roll(long, 1) & np.roll(long, -1))
    return float(np.sum(np.rint(steps[alone]) - 1.0)) / len(t)


def refuse_scattered(log: FlightLog, lost: float) -> None:
    """Refuse rows of which too many are missing one by one."""
    if lost > _MOST_LOST * (1.0 + lost):
        raise FrequencyError(
            f"{log.path.name}: {100.0 * lost / (1.0 + lost):.0f} % of the rows are lost one by one, and what is left "
            "misleads; use a faster card, or log fewer messages (LOG_BITMASK)"
        )


def experiment_record(experiment: Experiment, axis: Axis) -> AxisRecord:
    """Read the signals of an axis from an experiment; its only input and output, where it has one of each.

    Inputs are found by the name of the axis (``roll``, ``out_roll``; ``thrust`` or ``throttle`` for the vertical one),
    outputs by theirs (``w_x``, ``p``; ``a_up``) or among the rates of the experiment's context. An input named
    ``chirp`` or ``instrument`` is the instrument.
    """
    names_u, names_y = _NAMES[axis.name]
    instruments = [k for k, name in enumerate(experiment.input_names) if name in ("chirp", "instrument")]
    driving = [k for k in range(experiment.u.shape[1]) if k not in instruments]
    column = next((k for k in driving if experiment.input_names[k] in names_u), None)
    if column is None and len(driving) == 1:
        column = driving[0]
    output = next((k for k, name in enumerate(experiment.output_names) if name in names_y), None)
    if output is not None:
        y = experiment.y[:, output]
    elif experiment.context is not None and axis.output in experiment.context:
        y = experiment.context[axis.output].to_numpy(np.float64)
    elif experiment.y.shape[1] == 1:
        y = experiment.y[:, 0]
    else:
        y = np.full(len(experiment.t), np.nan)
    if column is None or not np.isfinite(y).all():
        raise FrequencyError(
            f"{experiment.name} has no signals of the {axis.name} axis: inputs {', '.join(experiment.input_names)}, "
            f"outputs {', '.join(experiment.output_names)}; wanted are {names_u[0]} and {names_y[0]}"
        )
    u = experiment.u[:, column]
    z = experiment.u[:, instruments[0]] if instruments else u
    return AxisRecord(
        name=experiment.name,
        start=float(experiment.t[0]),
        dt=experiment.dt,
        inputs=u[:, None],
        output=y,
        instruments=z[:, None],
        usable=np.ones(len(u), dtype=bool),
        band=ORDINARY_BAND,
        instrument=experiment.input_names[instruments[0]] if instruments else "",
    )


def below(t: Floats, values: Floats, at: Floats, step: float) -> Floats:
    """Return signals at the times of rows `step` [s] apart, with what is above half of their rate taken away.

    The filter has no phase, and a gain of one below 0.44 of the rate. Signals that are no faster pass by cubic splines.

    `t` (N,); `values` (N, k); `at` (M,). Returns (M, k): NaN in holes, and at ends that the filter does not reach.
    """
    steps = np.diff(t, prepend=t[:1])
    pieces = np.cumsum(steps > _HOLE * np.median(steps))
    result = np.full((len(at), values.shape[1]), np.nan)
    for piece in np.unique(pieces):
        rows = pieces == piece
        clock, even = t[rows], values[rows]
        if len(clock) < MIN_SAMPLES:
            continue
        own = float(np.median(np.diff(clock)))
        if own < 0.9 * step:
            reach = round(15.0 * step / own)
            grid = clock[0] + own * np.arange(int((clock[-1] - clock[0]) / own + 1e-6) + 1)
            if len(grid) < 2 * reach + MIN_SAMPLES:
                continue
            taps = low_pass_taps(2 * reach + 1, 0.5 * own / step)
            even = np.column_stack([np.convolve(column, taps, "valid") for column in cubic_spline(clock, even, grid).T])
            clock = grid[reach : len(grid) - reach]
        inside = (at >= clock[0]) & (at <= clock[-1])
        if inside.any():
            result[inside] = cubic_spline(clock, even, at[inside])
    return result
