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
from dataclasses import dataclass

import numpy as np
import scipy

from logparse import FlightLog
from sysid.frequency.axes import FrequencyError, axis_of
from sysid.frequency.chirp_records import FEWEST_ROWS, below_folding, chirp_spline
from sysid.frequency.excitation import Chirp
from sysid.frequency.rate_signals import rate_signals
from sysid.frequency.records import on_uniform_clock
from sysid.loops.controller import AXES, LoopSettings
from sysid.loops.evidence import limited_chirp
from sysid.loops.filters import Complexes, Floats, first_order
from sysid.loops.settings import read_settings
from sysid.loops.signals import mixer_chirps

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

#: What the limits of slew and of throttle may take of P in a flight without chirps, and the fewest rows that tell it.
_SCALED, _ROWS = 0.1, 64

#: Gyro filters [Hz] among which the one that flew is named.
_CORNERS = np.geomspace(5.0, 250.0, 120)

#: How much the scheduler's rate (PM.LR) may differ from SCHED_LOOP_RATE, and how much faster rows may come.
_RATE_APART = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class _Signals:
    """What a chirp has of an axis, on one uniform clock."""

    chirp: Floats
    columns: dict[str, Floats]
    step: float

    def ratio(self, source: str, answer: str, hz: Floats) -> tuple[Complexes, Floats]:
        """Compute a response with the chirp as instrument, and the coherence of the answer with the chirp."""
        size = scipy.fft.next_fast_len(4 * len(self.chirp))
        grid = np.fft.rfftfreq(size, self.step)
        # An integral drifts: what it has at the ends must not leak into the band.
        ends = np.clip(np.minimum(np.arange(len(self.chirp)), np.arange(len(self.chirp))[::-1]) * self.step / 0.4, 0, 1)
        taper = 0.5 - 0.5 * np.cos(np.pi * ends)
        z, x, y = (np.fft.rfft((each - each.mean()) * taper, size) for each in (self.chirp, *self._of(source, answer)))
        response, coherence = np.empty(len(hz), np.complex128), np.empty(len(hz))
        for k, (first, last) in enumerate(np.searchsorted(grid, np.outer(hz, [1.0 - _BAND, 1.0 + _BAND]))):
            band = slice(int(first), int(last))
            into, out = np.vdot(z[band], x[band]), np.vdot(z[band], y[band])
            whole = np.vdot(z[band], z[band]).real * np.vdot(y[band], y[band]).real
            with np.errstate(divide="ignore", invalid="ignore"):
                response[k], coherence[k] = out / into, abs(out) ** 2 / whole
        return response, np.nan_to_num(coherence)

    def _of(self, *names: str) -> list[Floats]:
        return [self.columns[name] for name in names]


def contradiction(log: FlightLog) -> str | None:
    """Return which parameters of the loops a log's own signals contradict; None where they agree or show nothing."""
    return next((reason for axis in _chirped(log) if (reason := contradiction_of(log, axis))), None)


def contradiction_of(log: FlightLog, axis: str) -> str | None:
    """Return the same of the parameters of one axis, whether it has chirps or not."""
    advice = "reboot, see that the parameters are those wanted, and fly again"
    settings = read_settings(log, axis)
    other = other_rate(log, settings.controller.loop_rate)
    if other is not None:
        return f"{log.path.name}: {other}; a change takes effect at the next start: {advice}"
    blocks = _blocks(log, settings) if axis in _chirped(log) else _proportional(log, settings)
    for block in blocks:
        if block.apart > block.tolerated:
            return f"{log.path.name}: {axis}: {block.told}: the parameters in the log are not what flew; {advice}"
    return None


def _proportional(log: FlightLog, settings: LoopSettings) -> Iterator[_Block]:
    """Compare P, which is the error times a number whatever is flown, where a flight without chirps has it."""
    message, flown = f"PID{axis_of(settings.axis).letter}", settings.controller.P
    if message not in log.messages or log.flight is None or not flown > 0.0:
        return
    frame = log.messages[message]
    if not {"Err", "P"} <= set(frame.columns):
        return
    rows = frame[(frame.index >= log.flight.start) & (frame.index <= log.flight.stop)]
    error, term = rows["Err"].to_numpy(np.float64), rows["P"].to_numpy(np.float64)
    whole = np.isfinite(error) & np.isfinite(term)
    large = whole & (np.abs(error) > (np.median(np.abs(error[whole])) if whole.any() else 0.0))
    if np.count_nonzero(large) >= _ROWS:
        gain = float(np.median(term[large] / error[large])) / flown
        apart = abs(gain - 1.0)
        yield _Block("P as logged is", f"ATC_RAT_{AXES[settings.axis]}_P", apart, _SCALED, gain, 0.0)


def gyro_seen(log: FlightLog, axis: str) -> bool:
    """Return whether a log bears the gyro's filters out on an axis: SIDD has the rates before them, and they agree."""
    settings = read_settings(log, axis)
    seen = [block for chirp in mixer_chirps(log, axis) for block in _gyro_block(log, chirp, settings)]
    return bool(seen) and all(block.apart <= block.tolerated for block in seen)


def _chirped(log: FlightLog) -> list[str]:
    return [axis for axis in AXES if mixer_chirps(log, axis)]


@dataclass(frozen=True, slots=True)
class _Block:
    """One block as logged against its parameters: gain and phase where they differ most, in the rms sense, and how."""

    what: str
    names: str
    apart: float
    tolerated: float
    gain: float
    phase_deg: float
    instead: str = ""

    @property
    def told(self) -> str:
        """Return in words how the block differs from its parameters."""
        if not np.isfinite(self.gain):
            return f"{self.what} not the 0 that {self.names} says"
        return f"{self.what} {self.gain:.2f} times and {self.phase_deg:+.0f} deg of what {self.names} say{self.instead}"


def _blocks(log: FlightLog, settings: LoopSettings) -> Iterator[_Block]:
    """Compare each block of the loop that each chirp on the axis shows."""
    for chirp in mixer_chirps(log, settings.axis):
        yield from _gyro_block(log, chirp, settings)
        if limited_chirp(log, settings.axis) is None:  # at a limit the controller is another, which says so itself
            yield from _controller_blocks(log, chirp, settings)


def _controller_blocks(log: FlightLog, chirp: Chirp, settings: LoopSettings) -> Iterator[_Block]:
    signals = _pid_signals(log, chirp, settings)
    if signals is None:
        return
    controller, letters = settings.controller, AXES[settings.axis]
    rate, columns = controller.loop_rate, signals.columns
    hz = _frequencies(chirp, signals.step, _OF_RATE)
    back = np.exp(-2j * np.pi * hz / rate)
    error = first_order(rate, controller.FLTE).response(hz)
    if "Err" in columns:
        yield from _compared(signals, "difference", "Err", error, hz, "FLTE", f"ATC_RAT_{letters}_FLTE")
    source, through = ("Err", np.ones(len(hz))) if "Err" in columns else ("difference", error)
    derivative = rate * (1.0 - back) * first_order(rate, controller.FLTD).response(hz)
    terms = {"P": controller.P, "I": controller.I / (rate * (1.0 - back)), "D": controller.D * derivative}
    if np.any(columns["Flags"] != 0.0):
        del terms["I"]  # at a limit it only shrinks
    for term, response in terms.items():
        filters = f" and ATC_RAT_{letters}_FLTD" if term == "D" else ""
        yield from _compared(signals, source, term, response * through, hz, term, f"ATC_RAT_{letters}_{term}{filters}")
    if "FF" in columns:
        forward = np.full(len(hz), controller.FF, np.complex128)
        yield from _compared(signals, "Tar", "FF", forward, hz, "FF", f"ATC_RAT_{letters}_FF")
    if "wanted" in columns:
        # The attitude is the integral of the true rate. That of yaw is seen too weakly to be told.
        slow = hz[hz <= _ATTITUDE_TO]
        attitude = settings.angle.rate_response(slow) / settings.gyro.response(slow)
        if settings.axis != "yaw":
            yield from _compared(signals, "Act", "wanted", attitude, slow, "ANG", f"ATC_ANG_{letters}_P")
        # The angle controller runs after the rate controller, which sees its target in this loop or the next.
        filtered = first_order(rate, controller.FLTT).response(hz)
        ways = [
            list(_compared(signals, "wanted", "Tar", late * filtered, hz, "FLTT", f"ATC_RAT_{letters}_FLTT"))
            for late in (back, np.ones(len(hz)))
        ]
        yield from min(ways, key=lambda blocks: blocks[0].apart if blocks else np.inf)


def _gyro_block(log: FlightLog, chirp: Chirp, settings: LoopSettings) -> Iterator[_Block]:
    signals = _gyro_signals(log, chirp, settings)
    if signals is None:
        return
    hz = _frequencies(chirp, signals.step, _OF_RATE_GYRO)
    # The angle turned through during a loop is that of its middle.
    half = np.exp(1j * np.pi * hz / settings.controller.loop_rate)

    def through(low_pass: float) -> Complexes:
        return np.asarray(settings.changed(gyro_filter=low_pass).gyro.response(hz) * half)

    expected = through(settings.gyro.low_pass)
    for block in _compared(signals, "before", "behind", expected, hz, "gyro", "INS_GYRO_FILTER and INS_HNTCH_*"):
        instead = ""
        if block.apart > block.tolerated:
            others = [
                (next(_compared(signals, "before", "behind", through(f), hz, "gyro", "")).apart, f) for f in _CORNERS
            ]
            apart, corner = min(others)
            if apart < min(_APART["gyro"], 0.5 * block.apart):
                instead = f" (it answers as with INS_GYRO_FILTER {corner:.0f})"
        yield _Block(
            "the rate behind the gyro's filters is",
            block.names,
            block.apart,
            block.tolerated,
            block.gain,
            block.phase_deg,
            instead,
        )


def _compared(
    signals: _Signals, source: str, answer: str, expected: Complexes, hz: Floats, kind: str, names: str
) -> Iterator[_Block]:
    """Compare one block, where the chirp shows it."""
    what = f"{answer} as logged is"
    if not np.abs(expected).all():  # a term that the parameters switch off
        size, other = float(np.std(signals.columns[answer])), float(np.std(signals.columns[source]))
        if size > 1e-6 * max(other, 1e-6):
            yield _Block(what, names, np.inf, _APART[kind], np.inf, 0.0)
        return
    response, coherence = signals.ratio(source, answer, hz)
    good = (coherence > _COHERENT) & np.isfinite(response) & (np.abs(response) > 0.0)
    if np.count_nonzero(good) < _FEWEST:
        return
    tolerated = _APART[kind]
    if (
        kind in "ID"
    ):  # what else moves both sides moves them alike, but I remembers what was before, and of D noise folds
        periods = 2.0 * _BAND * hz[good] * signals.step * len(signals.chirp)
        tolerated += _SURE * float(np.sqrt(np.mean((1.0 / coherence[good] - 1.0) / (2.0 * np.maximum(periods, 1.0)))))
    apart = np.log(response[good] / expected[good])
    worst = apart[np.argmax(np.abs(apart))]
    rms = float(np.sqrt(np.mean(np.abs(apart) ** 2)))
    yield _Block(what, names, rms, tolerated, float(np.exp(worst.real)), float(np.degrees(worst.imag)))


def _frequencies(chirp: Chirp, step: float, of_rate: float) -> Floats:
    low, high = max(_FROM, chirp.low), min(_OF_CHIRP * chirp.high, of_rate / step)
    return np.geomspace(low, max(high, 1.01 * low), _POINTS)


def _pid_signals(log: FlightLog, chirp: Chirp, settings: LoopSettings) -> _Signals | None:
    """Return target, error and terms within a chirp; None where PID messages do not show them."""
    which = axis_of(settings.axis)
    message = f"PID{which.letter}"
    if message not in log.messages:
        return None
    frame = log.messages[message]
    names = [name for name in ("Tar", "Act", "Err", "P", "I", "D", "FF") if name in frame]
    if not {"Tar", "Act", "P", "I", "D"} <= set(names):
        return None
    frame = frame.sort_index(kind="stable")
    t = frame.index.to_numpy(np.float64)
    if len(t) < 16:
        return None
    shown = below_folding(log, chirp, t)
    rows = (t >= shown.start) & (t <= shown.stop)
    columns = {name: frame[name].to_numpy(np.float64)[rows] for name in names}
    limits = np.asarray(frame["Flags"].to_numpy(np.int64)[rows] & 1, np.float64) if "Flags" in frame else np.zeros(1)
    rates = rate_signals(log)
    if which.reference in rates.columns and "RATE" in log.messages:
        columns["wanted"] = np.interp(t[rows], rates.t, rates.columns[which.reference])
        if rates.step > 1.5 * float(np.median(np.diff(t))):
            del columns["wanted"]
    signals = _aligned(log, chirp, t[rows], columns)
    if signals is not None:
        signals.columns["Flags"] = limits
        signals.columns["difference"] = signals.columns["Tar"] - signals.columns["Act"]
    return signals


def _gyro_signals(log: FlightLog, chirp: Chirp, settings: LoopSettings) -> _Signals | None:
    """Return the rate before and behind the gyro's filters within a chirp; None where SIDD does not have it."""
    which, table = axis_of(settings.axis), log.tables.systemid
    if table is None or "RATE" not in log.messages or which.output not in table:
        return None
    rates = rate_signals(log)
    try:
        times, before = chirp_spline(log, chirp, which.output)
    except FrequencyError:
        return None
    if not np.any(before(times)) or which.output not in rates.columns:
        return None
    shown = below_folding(log, below_folding(log, chirp, rates.t), times)
    rows = rates.within(max(shown.start, times[0]), min(shown.stop, times[-1]))
    t = rates.t[rows]
    behind = np.asarray(rates.columns[which.output][rows], np.float64)
    columns = {"before": np.asarray(before(t), np.float64), "behind": behind}
    return _aligned(log, chirp, t, columns)


def _aligned(log: FlightLog, chirp: Chirp, t: Floats, columns: dict[str, Floats]) -> _Signals | None:
    """Bring signals within a chirp, or what of it their rows show, and the chirp itself to one uniform clock."""
    try:
        times, spline = chirp_spline(log, chirp)
    except FrequencyError:
        return None
    if len(t) < FEWEST_ROWS:
        return None
    added = spline(np.clip(t, times[0], times[-1]))
    if not all(np.isfinite(each).sum() > FEWEST_ROWS for each in columns.values()):
        return None
    clock, values, _ = on_uniform_clock(t, [np.asarray(added, np.float64), *columns.values()])
    found = dict(zip(columns, values[:, 1:].T, strict=True))
    return _Signals(values[:, 0], found, float(clock[1] - clock[0]))


def other_rate(log: FlightLog, claimed: float) -> str | None:
    """Return that the loop ran at another rate than SCHED_LOOP_RATE."""
    if "PM" in log.messages and "LR" in log.messages["PM"]:
        told = log.messages["PM"]["LR"].to_numpy(np.float64)
        told = told[np.isfinite(told) & (told > 0.0)]
        if len(told) and abs(float(np.median(told)) / claimed - 1.0) > _RATE_APART:
            return f"SCHED_LOOP_RATE is {claimed:g} Hz, but the scheduler ran at {np.median(told):.0f} Hz (PM.LR)"
    times = log.tables.times("rates")
    if times is not None and "RATE" in log.messages and len(times) > 16:
        rows = 1.0 / float(np.median(np.diff(times)))
        if rows > (1.0 + _RATE_APART) * claimed:
            return f"RATE came at {rows:.0f} Hz, faster than the loop of SCHED_LOOP_RATE {claimed:g}"
    return None
