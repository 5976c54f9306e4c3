"""`prove`: what one flight foretold of another with other gains, against what that other flight measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from core.parameter import Parameter
from core.summary import Summarised, listed
from logparse import FlightLog, GivenLogs, RotoridError, logs_of
from sysid.frequency.axes import axis_of
from sysid.frequency.excitation import ordinary_runs
from sysid.loops.as_flown import contradiction
from sysid.loops.controller import AXES, LoopError
from sysid.loops.criteria import beyond_band
from sysid.loops.evidence import (
    WINDOW,
    limited_chirp,
    loop_parameters,
    oscillation,
    two_ways_apart,
    unfit_log,
)
from sysid.loops.filters import Complexes, Floats
from sysid.loops.known_margins import MARGINS
from sysid.loops.loop import RateLoop, rate_loop
from sysid.loops.safety import MARGIN_WORDS, Aim
from sysid.loops.same_craft import REBUILT, gain_apart, other_craft
from sysid.loops.settings import read_settings

#: Parameters that change by themselves.
BY_THEMSELVES = (
    *("STAT_", "SID_", "GND_", "BARO", "COMPASS_", "INS_ACC", "INS_GYR", "SIM_", "LOG_", "AHRS_"),
    "MOT_THST_HOVER",
)

#: Columns of the table, and a row of it, which begins with axis and quantity and ends with the unit.
_NUMBERS = ("predicted", "predicted_sigma", "measured", "measured_sigma")
Row = tuple[str, str, float | None, float | None, float | None, float | None, str]

#: Values before and after by parameter.
Changes = dict[str, tuple[float, float]]

#: Standard deviations, and sizes, beyond which a measured margin differs from the one foretold.
DIFFERENT, SIZES = 3.0, {"gain_db": 1.0, "phase_deg": 6.0, "peak_db": 1.5}

#: Margins below which a loop is thin, those that a tune keeps, in words.
WANTED = f"{Aim().gain_db:g} {MARGIN_WORDS['gain_db'][1]} and {Aim().phase_deg:g} {MARGIN_WORDS['phase_deg'][1]}"

#: Least standard deviation [rad/s] of the rate target in a window with a manoeuvre.
_MOVING = 0.08

AS_PREDICTED, BETTER, WORSE = "as predicted", "better", "worse: restore rollback.param"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Proof(Summarised):
    """Predicted against measured."""

    #: Names of the logs.
    before: tuple[str, ...]
    after: tuple[str, ...]
    #: Indexed by axis and quantity; columns predicted, predicted_sigma, measured, measured_sigma, unit.
    table: pd.DataFrame
    verdict: str  #: ``"as predicted"``, ``"better"`` or ``"worse: restore rollback.param"``; empty where refused.
    refused: str | None
    changed: Changes  #: mapping of str to (before, after): Gains and filters of the loops.
    beyond: Changes  #: mapping of str to (before, after): Whatever else was changed and may explain a difference.
    #: mapping of str to (predicted, measured): Loops by axis: of the earlier flight with the later one's settings, and
    #: of the later flight.
    loops: dict[str, tuple[RateLoop, RateLoop]]
    remarks: tuple[str, ...] = ()  #: What limits the comparison, a sentence each.

    @property
    def thin(self) -> dict[str, str]:
        """Margins measured after the change that are less than a tune keeps, in words, by axis."""
        measured, lacks = self.table["measured"], {}
        for axis in dict.fromkeys(str(axis) for axis, _ in self.table.index):
            known = [name for name in ("gain_db", "phase_deg") if (axis, name) in measured.index]
            lacking = Aim().lacking({name: float(measured[axis, name]) for name in known})
            if lacking:
                lacks[axis] = " and ".join(lacking)
        return lacks

    def summary(self) -> dict[str, str]:
        """Return the flights and the verdict."""
        flights = {"predicted from": listed(self.before), "measured on": listed(self.after)}
        return flights | ({"verdict": self.verdict} if self.refused is None else {"refused": self.refused})


def prove(before: GivenLogs, after: GivenLogs) -> Proof:
    """Compare what flights foretell of later ones of the same craft with what those measured.

    Parameters
    ----------
    before, after : FlightLog, path-like, or a sequence of either
        Flights with chirps, before and after gains or filters were changed.

    Raises
    ------
    LogError
        Where something given is no log.
    """
    firsts, seconds = logs_of(before), logs_of(after)
    names = tuple(log.name for log in firsts), tuple(log.name for log in seconds)
    empty = pd.DataFrame(columns=[*_NUMBERS, "unit"])

    def refuse(reason: str) -> Proof:
        return Proof(*names, empty, "", reason, {}, {}, {})

    if not firsts or not seconds:
        return refuse("a log before and a log after are needed")
    try:
        for log in (*firsts, *seconds):
            read_settings(log, "roll")
            reason = unfit_log(log)
            if reason is not None:
                return refuse(reason)
        for log in firsts:
            reason = next((r for axis in AXES if (r := oscillation(log, axis))), None)
            if reason is not None:
                return refuse(f"nothing can be foretold from a flight that oscillates: {reason}")
        shaking = next((r for log in seconds for axis in AXES if (r := oscillation(log, axis))), None)
        for log in firsts if shaking is not None else (*firsts, *seconds):
            reason = contradiction(log)
            if reason is not None:
                return refuse(reason)
    except RotoridError as error:
        return refuse(str(error))
    other = other_craft(firsts[0], seconds[0])
    if other is not None:
        return refuse(other)
    changed, beyond = _changes(firsts[0], seconds[0])
    rows: list[Row] = []
    loops: dict[str, tuple[RateLoop, RateLoop]] = {}
    reasons: list[str] = []
    remarks: list[str] = []
    unmeasured: set[str] = set()
    for axis in AXES:
        try:
            limited = next((r for log in firsts if (r := limited_chirp(log, axis))), None)
            if limited is not None:
                raise LoopError(limited)
            first, second = rate_loop(firsts, axis), rate_loop(seconds, axis)
        except RotoridError as error:
            reasons.append(str(error))
            continue
        predicted = first.with_settings(second.flown)
        apart = gain_apart(first, second)
        if shaking is None and apart > REBUILT:
            return refuse(
                f"{axis} answers {apart:.1f} times as strongly in one flight as in the other, at equal input: "
                "these are logs of two craft, or of one that was rebuilt"
            )
        loops[axis] = (predicted, second)
        limited = next((r for log in seconds if (r := limited_chirp(log, axis))), None)
        if limited is not None:
            remarks.append(limited)
            unmeasured.add(axis)
        else:
            remarks += _limits(predicted, second)
        rows += _rows(axis, predicted, second, seconds, measured=limited is None)
    if not rows:
        return refuse("; ".join(dict.fromkeys(reasons)))
    if shaking is None and unmeasured == set(loops):
        return refuse("; ".join(remarks))
    table = pd.DataFrame(rows, columns=["axis", "quantity", *_NUMBERS, "unit"]).set_index(["axis", "quantity"])
    table = table.astype(dict.fromkeys(_NUMBERS, np.float64))
    measured = {axis: pair for axis, pair in loops.items() if axis not in unmeasured}
    verdict = WORSE if shaking is not None else _verdict(table, measured)
    if shaking is not None:
        remarks.append(shaking)
    return Proof(*names, table, verdict, None, changed, beyond, loops, tuple(remarks))


def _limits(predicted: RateLoop, second: RateLoop) -> list[str]:
    """Return what limits the comparison of an axis: a level loop gain, two ways to the later loop that disagree."""
    crossover = predicted.margins.crossover_hz
    level = f"{second.axis}: {crossover.reason}" if crossover.determined and crossover.reason else None
    return [limit for limit in (level, two_ways_apart(second)) if limit is not None]


def _rows(axis: str, predicted: RateLoop, second: RateLoop, logs: Sequence[FlightLog], *, measured: bool) -> list[Row]:
    """Compare margins, attitude bandwidth and the answer to the sticks of one axis.

    What the later flight measured is its own response through its own controller. The loop straight from its chirp is
    the check of that controller (`remarks`), not the measurement: PID terms that are logged less often than the loop
    runs bend it by some percent (`RateLoop.measured_margins`).
    """
    foretold, margins = predicted.margins, second.own_margins
    rows: list[Row] = []
    for name, (unit, _) in MARGINS.items():
        a, b = getattr(foretold, name), getattr(margins, name) if measured else Parameter(None, None, unit)
        rows.append((axis, name, a.value, a.sigma, b.value, b.sigma, unit))
    if not measured:
        return rows
    bandwidth = [loop.attitude_bandwidth for loop in (predicted, second)]
    rows.append((axis, "attitude_bandwidth_hz", bandwidth[0], None, bandwidth[1], None, "Hz"))
    fits = [fit for log in logs if (fit := _flown_fit(predicted, log)) is not None]
    own = [fit for log in logs if (fit := _flown_fit(second, log)) is not None]
    if fits and own:
        rows.append((axis, "step_fit", float(np.mean(fits)), None, float(np.mean(own)), None, "%"))
    return rows


def _verdict(table: pd.DataFrame, loops: dict[str, tuple[RateLoop, RateLoop]]) -> str:
    """Judge the margins that keep a craft in the air."""
    if any(not second.margins.stable for _, second in loops.values()):
        return WORSE
    better = False
    for row in table.reset_index().to_dict("records"):
        quantity = str(row["quantity"])
        if quantity not in SIZES:
            continue
        sign = -1.0 if quantity == "peak_db" else 1.0
        gained = sign * float(row["measured"] - row["predicted"])
        spread = float(np.hypot(row["predicted_sigma"], row["measured_sigma"]))
        if not np.isfinite(gained) or abs(gained) < max(SIZES[quantity], DIFFERENT * spread):
            continue
        if gained < 0.0:
            return WORSE
        better = True
    return BETTER if better else AS_PREDICTED


def _changes(before: FlightLog, after: FlightLog) -> tuple[Changes, Changes]:
    """Return parameters that differ: those of the loops, and others."""
    first, second = before.parameters_flown, after.parameters_flown
    differ = {name: (first[name], second[name]) for name in sorted(first.keys() & second.keys())}
    differ = {name: pair for name, pair in differ.items() if pair[0] != pair[1]}
    ours = {name: differ[name] for name in loop_parameters(first) if name in differ}
    others = {n: pair for n, pair in differ.items() if n not in ours and not n.startswith(BY_THEMSELVES)}
    return dict(sorted(ours.items())), others


def _flown_fit(loop: RateLoop, log: FlightLog) -> float | None:
    """Return how well the loop foretells the rates of a flight from its rate targets, %; None without manoeuvres.

    Over windows outside chirps in which the target moves: 100 (1 - rms(measured - foretold) / rms(measured)), each
    less its mean.
    """
    table = log.tables.rates
    which = axis_of(loop.axis)
    if table is None or len(table) < 2 or not {which.output, which.reference} <= set(table.columns):
        return None
    t = table.index.to_numpy(np.float64)
    target, rate = (table[name].to_numpy(np.float64) for name in (which.reference, which.output))
    runs = ordinary_runs(log, t, np.isfinite(target) & np.isfinite(rate))
    step = float(np.median(np.diff(t)))
    transfer = loop.rate_transfer()
    size = int(WINDOW / step)
    wrong = power = 0.0
    for run in runs:
        if len(run) < 2 * size:
            continue
        foretold = _through(target[run], step, loop.hz, transfer)
        for first in range(size // 2, len(run) - size, size):
            part = slice(first, first + size)
            if np.std(target[run][part]) < _MOVING:
                continue
            measured, own = rate[run][part], foretold[part]
            wrong += float(np.sum(((measured - measured.mean()) - (own - own.mean())) ** 2))
            power += float(np.sum((measured - measured.mean()) ** 2))
    return 100.0 * (1.0 - np.sqrt(wrong / power)) if power > 0.0 else None


def _through(values: Floats, step: float, hz: Floats, transfer: Complexes) -> Floats:
    """Pass samples through a transfer function known on a band."""
    padded = np.concatenate([np.full(256, values[0]), values, np.full(256, values[-1])])
    whole = beyond_band(np.asarray(np.fft.rfftfreq(len(padded), step), np.float64), hz, transfer)
    return np.asarray(np.fft.irfft(np.fft.rfft(padded) * whole, len(padded))[256 : 256 + len(values)])
