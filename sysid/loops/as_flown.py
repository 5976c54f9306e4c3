"""Whether a log's own signals bear its parameters out: the terms of the PID, the gyro's filters, the loop's rate.

A parameter of a log need not be what flew: set without the reboot that it needs, changed by a script, edited in a file.
Every block of the controller is exact and most are logged on both sides: from the error (PIDR.Err) to P, I and D, from
the target before its filter to the one behind it, from the rate through the attitude to the target, and from the rate
before the gyro's filters (SIDD.Gx: the angle turned through during a loop over its time) to the rate behind them
(RATE.R). With the chirp as instrument the response of each is known to a few per cent, whatever the craft, the wind and
the noise are.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd
import scipy

from logparse import FlightLog
from sysid.frequency.axes import FrequencyError, axis_of
from sysid.frequency.excitation import FEWEST_ROWS, Chirp, mixer_chirps
from sysid.frequency.rate_signals import RateSignals, rate_signals
from sysid.frequency.records import on_uniform_clock
from sysid.loops.controller import AXES, LoopSettings
from sysid.loops.evidence import limited_chirp
from sysid.loops.filters import Complexes, Floats, first_order
from sysid.loops.loop import pid_rows
from sysid.loops.settings import read_settings

#: Rms of the logarithm of logged over computed response beyond which a block is not as its parameters say. In firmware
#: (36 chirps) P and the error are exact, I, D, the target and the angle controller within 0.025 (a gyro of 1 kHz gives
#: a loop of 400 Hz two and three samples in turn, of which rows of every fourth loop show one side; of large angles
#: the square-root law takes some), the gyro within 0.04.
_APART = {"P": 0.03, "I": 0.06, "D": 0.1, "FF": 0.03, "FLTE": 0.05, "FLTT": 0.06, "gyro": 0.07, "ANG": 0.15}

#: Frequencies looked at: from this on [Hz], up to these parts of the chirp's last and of the rate of the rows.
_FROM, _OF_CHIRP, _OF_RATE, _POINTS = 1.0, 0.92, 0.25, 24

#: The same part of the rate of the rows for the gyro, whose path is steady from sample to sample.
_OF_RATE_GYRO = 0.4

#: Highest frequency [Hz] at which the attitude is looked at: it falls with the frequency.
_ATTITUDE_TO = 8.0

#: Half-width of the band that makes one point, in parts of its frequency; coherence with the chirp, and how few points
#: tell nothing.
_BAND, _COHERENT, _FEWEST = 0.06, 0.9, 6

#: Standard deviations of what the coherence leaves open that are tolerated of I and D.
_SURE = 2.0

#: What the limits of slew and of throttle may take of P in a flight without chirps.
_SCALED = 0.1

#: Gyro filters [Hz] among which the one that flew is named.
_CORNERS = np.geomspace(5.0, 250.0, 120)

#: How much the scheduler's rate (PM.LR) may differ from SCHED_LOOP_RATE, and how much faster rows may come.
_RATE_APART = 0.1


@dataclass(frozen=True, eq=False)
class _Signals:
    """What a chirp has of an axis, on one uniform clock."""

    chirp: Floats
    columns: dict[str, Floats]
    step: float
    _transforms: dict[str, Complexes] = field(default_factory=dict)  #: Those that were asked for, by column.

    @cached_property
    def _taper(self) -> Floats:
        """Return the window under which all are transformed."""
        # An integral drifts: what it has at the ends must not leak into the band.
        size = len(self.chirp)
        ends = np.clip(np.minimum(np.arange(size), np.arange(size)[::-1]) * self.step / 0.4, 0, 1)
        return np.asarray(0.5 - 0.5 * np.cos(np.pi * ends))

    def _transform(self, name: str) -> Complexes:
        """Return the transform of a signal, the chirp's by an empty name."""
        if name not in self._transforms:
            signal = self.columns[name] if name else self.chirp
            self._transforms[name] = np.fft.rfft((signal - signal.mean()) * self._taper, self._size)
        return self._transforms[name]

    @property
    def _size(self) -> int:
        return int(scipy.fft.next_fast_len(4 * len(self.chirp)))

    def ratio(self, source: str, answer: str, hz: Floats) -> tuple[Complexes, Floats]:
        """Compute a response with the chirp as instrument, and the coherence of the answer with the chirp."""
        grid = np.fft.rfftfreq(self._size, self.step)
        z, x, y = (self._transform(name) for name in ("", source, answer))
        response, coherence = np.empty(len(hz), np.complex128), np.empty(len(hz))
        for k, (first, last) in enumerate(np.searchsorted(grid, np.outer(hz, [1.0 - _BAND, 1.0 + _BAND]))):
            band = slice(int(first), int(last))
            into, out = np.vdot(z[band], x[band]), np.vdot(z[band], y[band])
            whole = np.vdot(z[band], z[band]).real * np.vdot(y[band], y[band]).real
            with np.errstate(divide="ignore", invalid="ignore"):
                response[k], coherence[k] = out / into, abs(out) ** 2 / whole
        return response, np.nan_to_num(coherence)


@dataclass(frozen=True, slots=True)
class _Block:
    """One block as logged against its parameters: how far apart in the rms sense, what is tolerated, and in words."""

    kind: str  #: As `_APART` names it.
    apart: float
    tolerated: float
    sentence: str


def contradiction(log: FlightLog) -> str | None:
    """Return which parameters of the loops a log's own signals contradict; None where they agree or show nothing."""
    chirped = (axis for axis in AXES if mixer_chirps(log, axis))
    return next((reason for axis in chirped if (reason := contradiction_of(log, axis))), None)


def contradiction_of(log: FlightLog, axis: str) -> str | None:
    """Return the same of the parameters of one axis, whether it has chirps or not."""
    advice = "reboot, see that the parameters are those wanted, and fly again"
    settings = read_settings(log, axis)
    other = other_rate(log, settings.controller.loop_rate)
    if other is not None:
        return f"{log.path.name}: {other}; a change takes effect at the next start: {advice}"
    for block in log.derived(_blocks, axis):
        if block.apart > block.tolerated:
            return f"{log.path.name}: {axis}: {block.sentence}: the parameters in the log are not what flew; {advice}"
    return None


def gyro_seen(log: FlightLog, axis: str) -> bool:
    """Return whether a log bears the gyro's filters out on an axis: SIDD has the rates before them, and they agree."""
    seen = [block for block in log.derived(_blocks, axis) if block.kind == "gyro"]
    return bool(seen) and all(block.apart <= block.tolerated for block in seen)


def _blocks(log: FlightLog, axis: str) -> tuple[_Block, ...]:
    """Compare each block of the loop that each chirp on the axis shows; without a chirp what any flight does."""
    settings, chirps = read_settings(log, axis), mixer_chirps(log, axis)
    if not chirps:
        return tuple(_proportional(log, settings))
    rates, terms = _rates(log, axis), pid_rows(log, axis, ("Tar", "Act", "P", "I", "D"))
    blocks = [block for chirp in chirps for block in _gyro_blocks(rates, chirp, settings)]
    # At a limit the controller is another, which says so itself.
    if terms is not None and limited_chirp(log, axis) is None:
        blocks += [block for chirp in chirps for block in _controller_blocks(terms, rates, chirp, settings)]
    return tuple(blocks)


def _rates(log: FlightLog, axis: str) -> RateSignals | None:
    """Return what the rate controller of an axis measured and wanted; None of a log without it."""
    with suppress(FrequencyError):
        return rate_signals(log, wanted=(axis_of(axis).output, axis_of(axis).reference))
    return None


def _proportional(log: FlightLog, settings: LoopSettings) -> Iterator[_Block]:
    """Compare P, which is the error times a number whatever is flown."""
    rows, flown = pid_rows(log, settings.axis, ("Err", "P")), settings.controller.P
    if rows is None or log.flight is None or not flown > 0.0:
        return
    error, term = rows.loc[log.flight.start : log.flight.stop, ["Err", "P"]].to_numpy(np.float64).T
    whole = np.isfinite(error) & np.isfinite(term)
    large = whole & (np.abs(error) > (np.median(np.abs(error[whole])) if whole.any() else 0.0))
    if np.count_nonzero(large) >= FEWEST_ROWS:
        gain = float(np.median(term[large] / error[large])) / flown
        apart = np.log(np.complex128(gain or 1e-12))
        yield _Block("P", abs(gain - 1.0), _SCALED, _told("P", "P", settings.axis, apart))


def _controller_blocks(
    terms: pd.DataFrame, rates: RateSignals | None, chirp: Chirp, settings: LoopSettings
) -> Iterator[_Block]:
    signals = _pid_signals(terms, rates, chirp, settings.axis)
    if signals is None:
        return
    controller, columns, axis = settings.controller, signals.columns, settings.axis
    rate = controller.loop_rate
    hz = _frequencies(chirp, signals.step, _OF_RATE)
    back, ones = np.exp(-2j * np.pi * hz / rate), np.ones(len(hz), np.complex128)
    change = rate * (1.0 - back)
    error = first_order(rate, controller.FLTE).response(hz)
    source, through = ("Err", ones) if "Err" in columns else ("difference", error)
    expected = {
        "FLTE": ("difference", "Err", error),
        "P": (source, "P", controller.P * through),
        "I": (source, "I", controller.I / change * through),
        "D": (source, "D", controller.D * change * first_order(rate, controller.FLTD).response(hz) * through),
        "FF": ("Tar", "FF", controller.FF * ones),
    }
    if np.any(columns["Flags"] != 0.0):
        del expected["I"]  # at a limit it only shrinks
    for kind, (given, answer, response) in expected.items():
        if answer in columns:
            yield from _compared(signals, given, answer, response, hz, kind, axis)
    if "wanted" in columns:
        # The attitude is the integral of the true rate. That of yaw is seen too weakly to be told.
        slow = hz[hz <= _ATTITUDE_TO]
        attitude = settings.angle.rate_response(slow) / settings.gyro.response(slow)
        if axis != "yaw":
            yield from _compared(signals, "Act", "wanted", attitude, slow, "ANG", axis)
        # The angle controller runs after the rate controller, which sees its target in this loop or the next.
        filtered = first_order(rate, controller.FLTT).response(hz)
        ways = [list(_compared(signals, "wanted", "Tar", late * filtered, hz, "FLTT", axis)) for late in (back, ones)]
        yield from min(ways, key=lambda blocks: blocks[0].apart if blocks else np.inf)


def _gyro_blocks(rates: RateSignals | None, chirp: Chirp, settings: LoopSettings) -> Iterator[_Block]:
    """Compare the gyro's filters in a chirp, and name the low-pass that it answers as with where they differ."""
    signals = _gyro_signals(rates, chirp, settings.axis)
    if signals is None:
        return
    hz = _frequencies(chirp, signals.step, _OF_RATE_GYRO)
    # The angle turned through during a loop is that of its middle.
    half = np.exp(1j * np.pi * hz / settings.controller.loop_rate)

    def behind(low_pass: float) -> list[_Block]:
        expected = np.asarray(settings.changed(gyro_filter=low_pass).gyro.response(hz) * half)
        return list(_compared(signals, "before", "behind", expected, hz, "gyro", settings.axis))

    for block in behind(settings.gyro.low_pass):
        sentence = block.sentence
        if block.apart > block.tolerated:
            apart, corner = min((behind(corner)[0].apart, corner) for corner in _CORNERS)
            if apart < min(_APART["gyro"], 0.5 * block.apart):
                sentence += f" (it answers as with INS_GYRO_FILTER {corner:.0f})"
        yield replace(block, sentence=sentence)


def _compared(
    signals: _Signals, source: str, answer: str, expected: Complexes, hz: Floats, kind: str, axis: str
) -> Iterator[_Block]:
    """Compare one block, where the chirp shows it."""
    if not np.abs(expected).all():  # a term that the parameters switch off
        size, other = float(np.std(signals.columns[answer])), float(np.std(signals.columns[source]))
        if size > 1e-6 * max(other, 1e-6):
            yield _Block(kind, np.inf, _APART[kind], _told(answer, kind, axis, None))
        return
    response, coherence = signals.ratio(source, answer, hz)
    good = (coherence > _COHERENT) & np.isfinite(response) & (np.abs(response) > 0.0)
    if np.count_nonzero(good) < _FEWEST:
        return
    tolerated = _APART[kind]
    # What else moves both sides moves them alike, but I remembers what was before, and of D noise folds.
    if kind in "ID":
        periods = 2.0 * _BAND * hz[good] * signals.step * len(signals.chirp)
        tolerated += _SURE * float(np.sqrt(np.mean((1.0 / coherence[good] - 1.0) / (2.0 * np.maximum(periods, 1.0)))))
    apart = np.log(response[good] / expected[good])
    rms = float(np.sqrt(np.mean(np.abs(apart) ** 2)))
    yield _Block(kind, rms, tolerated, _told(answer, kind, axis, apart[np.argmax(np.abs(apart))]))


def _told(answer: str, kind: str, axis: str, apart: np.complex128 | None) -> str:
    """Return in words how a block differs from its parameters; None where these switch it off."""
    letters = AXES[axis]
    names = {
        "D": f"ATC_RAT_{letters}_D and ATC_RAT_{letters}_FLTD",
        "ANG": f"ATC_ANG_{letters}_P",
        "gyro": "INS_GYRO_FILTER and INS_HNTCH_*",
    }.get(kind, f"ATC_RAT_{letters}_{kind}")
    what = "the rate behind the gyro's filters" if kind == "gyro" else f"{answer} as logged"
    if apart is None:
        return f"{what} is not the 0 that {names} says"
    return f"{what} is {np.exp(apart.real):.2f} times and {np.degrees(apart.imag):+.0f} deg of what {names} say"


def _frequencies(chirp: Chirp, step: float, of_rate: float) -> Floats:
    low, high = max(_FROM, chirp.low), min(_OF_CHIRP * chirp.high, of_rate / step)
    return np.geomspace(low, max(high, 1.01 * low), _POINTS)


def _pid_signals(terms: pd.DataFrame, rates: RateSignals | None, chirp: Chirp, axis: str) -> _Signals | None:
    """Return target, error and terms within a chirp, of PID messages; None where too few rows show them."""
    shown = chirp.below_folding(terms.index.to_numpy(np.float64))
    frame = terms.loc[shown.start : shown.stop]
    t = frame.index.to_numpy(np.float64)
    names = [name for name in ("Tar", "Act", "Err", "P", "I", "D", "FF") if name in frame]
    columns = {name: frame[name].to_numpy(np.float64) for name in names}
    wanted = None if rates is None or not rates.with_chirp else rates.columns.get(axis_of(axis).reference)
    if rates is not None and wanted is not None and rates.step <= 1.5 * float(np.median(np.diff(t))):
        columns["wanted"] = np.interp(t, rates.t, wanted)
    signals = _aligned(chirp, t, columns)
    if signals is not None:
        limited = frame["Flags"].to_numpy(np.int64) & 1 if "Flags" in frame else np.zeros(1)
        signals.columns["Flags"] = np.asarray(limited, np.float64)
        signals.columns["difference"] = signals.columns["Tar"] - signals.columns["Act"]
    return signals


def _gyro_signals(rates: RateSignals | None, chirp: Chirp, axis: str) -> _Signals | None:
    """Return the rate before and behind the gyro's filters within a chirp; None where RATE or SIDD do not have it."""
    output = axis_of(axis).output
    if rates is None or not rates.with_chirp or output not in chirp.rows:
        return None
    before = chirp.spline(output)
    if before is None or not chirp.rows[output].any() or output not in rates.columns:
        return None
    shown = chirp.below_folding(rates.t)
    shown = shown.below_folding(shown.t)
    rows = rates.within(shown.start, shown.stop)
    t = rates.t[rows]
    return _aligned(chirp, t, {"before": before(t), "behind": np.asarray(rates.columns[output][rows], np.float64)})


def _aligned(chirp: Chirp, t: Floats, columns: dict[str, Floats]) -> _Signals | None:
    """Resample signals within the logged part of a chirp, and the chirp itself, to one uniform clock."""
    added = chirp.spline()
    if added is None or not all(np.isfinite(column).sum() > FEWEST_ROWS for column in columns.values()):
        return None
    clock, logged, _ = on_uniform_clock(t, [added(t), *columns.values()])
    values = logged.astype(np.float64, copy=False)
    signals = dict(zip(columns, values[:, 1:].T, strict=True))
    return _Signals(values[:, 0], signals, float(clock[1] - clock[0]))


def other_rate(log: FlightLog, claimed: float) -> str | None:
    """Report that the loop ran at another rate than SCHED_LOOP_RATE."""
    if "PM" in log.messages and "LR" in log.messages["PM"]:
        rates = log.messages["PM"]["LR"].to_numpy(np.float64)
        rates = rates[np.isfinite(rates) & (rates > 0.0)]
        if len(rates) and abs(float(np.median(rates)) / claimed - 1.0) > _RATE_APART:
            return f"SCHED_LOOP_RATE is {claimed:g} Hz, but the scheduler ran at {np.median(rates):.0f} Hz (PM.LR)"
    times = log.tables.times("rates")
    if times is not None and "RATE" in log.messages and len(times) > 16:
        rows = 1.0 / float(np.median(np.diff(times)))
        if rows > (1.0 + _RATE_APART) * claimed:
            return f"RATE came at {rows:.0f} Hz, faster than the loop of SCHED_LOOP_RATE {claimed:g}"
    return None
