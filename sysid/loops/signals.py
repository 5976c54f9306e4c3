"""What the autopilot logged of one axis' loop during chirps: mixer input, rate, and what came back through the loop."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from logparse import FlightLog
from sysid.frequency.axes import FrequencyError, axis_of
from sysid.frequency.chirp_records import below_folding, chirp_record, chirp_spline, record_of_chirp
from sysid.frequency.estimate import response_of_records
from sysid.frequency.excitation import Chirp, Within, find_chirps
from sysid.frequency.rate_signals import RateSignals, rate_signals
from sysid.frequency.records import AxisRecord
from sysid.frequency.response import FrequencyResponse
from sysid.loops.controller import LoopError
from sysid.loops.filters import Floats

#: Times [s] by which the logged chirp may trail its entry into the mixer; one step of loops of 50 to 400 Hz at most.
_LAGS = np.arange(-8, 9) * 1.25e-3

#: Times closer than this [s] are one.
_SAME = 2e-4


@dataclass(frozen=True, slots=True, eq=False)
class LoopRecord:
    """One chirp at the mixer, on a uniform clock."""

    plant: AxisRecord  #: Mixer input, with the chirp, to measured rate.
    #: Mixer input to what the controller fed back; None where the log cannot part it from the chirp.
    feedback: AxisRecord | None
    chirp: Chirp | None = None  #: Where it is in its log; None for signals that are of no log.


def mixer_chirps(log: FlightLog, axis: str, within: Within | None = None) -> list[Chirp]:
    """Return the chirps at the mixer on one axis that show dynamics, in order."""
    return [c for c in find_chirps(log, within) if c.axis == axis and c.at_mixer and c.worthwhile]


def loop_records(log: FlightLog, axis: str, within: Within | None = None) -> tuple[LoopRecord, ...]:
    """Cut a log's chirps at the mixer on one axis, or those within a stretch of time [s] of it, in order."""
    which = axis_of(axis)
    signals = rate_signals(log)
    chirps = mixer_chirps(log, axis, within)
    if not chirps:
        number = {"roll": 10, "pitch": 11, "yaw": 12}.get(axis, 0)
        raise LoopError(
            f"{log.path.name} has no chirp at the mixer on the {axis} axis; fly mode SYSTEMID with SID_AXIS {number} "
            "(`rotorid design` writes the parameters), with RATE and PID messages at 100 Hz or more"
        )
    return tuple(
        LoopRecord(chirp_record(log, signals, which, chirp), _feedback(log, signals, axis, chirp), chirp)
        for chirp in chirps
    )


def plant_response(records: tuple[LoopRecord, ...], axis: str, gyro_filter_hz: float | None) -> FrequencyResponse:
    """Estimate mixer to rate, with the chirp as instrument."""
    return response_of_records([r.plant for r in records], axis_of(axis), gyro_filter_hz=gyro_filter_hz)


def loop_response(records: tuple[LoopRecord, ...], axis: str) -> FrequencyResponse | None:
    """Estimate the broken-loop response at the mixer straight from the chirps: minus feedback per mixer input."""
    usable = [replace(r.feedback, output=-r.feedback.output) for r in records if r.feedback is not None]
    return response_of_records(usable, axis_of(axis)) if usable else None


def _feedback(log: FlightLog, signals: RateSignals, axis: str, chirp: Chirp) -> AxisRecord | None:
    """Part the mixer input into the chirp and what the controller added.

    The sum of the PID terms is what came back; where it is logged as often as the mixer input it is taken, else it
    tells when the chirp entered, which is then subtracted.
    """
    which = axis_of(axis)
    try:
        times, added = chirp_spline(log, chirp)
    except FrequencyError:
        return None
    first, last = times[0], times[-1]
    chirp = below_folding(log, chirp, signals.t)
    rows = signals.within(chirp.start, chirp.stop)
    t, total = signals.t[rows], signals.columns[which.input][rows]
    pid = _pid_sum(log, f"PID{which.letter}")
    if pid is None or len(t) < 16:
        return None
    nearest = np.clip(np.searchsorted(pid[0], t - _SAME), 0, len(pid[0]) - 1)
    same = np.abs(pid[0][nearest] - t) < _SAME
    if not signals.with_chirp or same.sum() < 16:
        return None
    chirped = total[same] - pid[1][nearest[same]]
    inner = np.flatnonzero((t[same] > first + 0.02) & (t[same] < last - 0.02))
    inner = inner[:: max(len(inner) // 2000, 1)]  # as many tell it
    misfits = [float(np.sum((chirped[inner] - added(t[same][inner] + lag)) ** 2)) for lag in _LAGS]
    lag = float(_LAGS[int(np.argmin(misfits))])
    if min(misfits) > 0.05 * float(np.sum(chirped[inner] ** 2)):
        return None
    if same.mean() > 0.9:
        back = np.full(len(t), np.nan)
        back[same] = pid[1][nearest[same]]
    else:
        back = total - np.where((t + lag >= first) & (t + lag <= last), added(t + lag), 0.0)
    return record_of_chirp(log, chirp, t, [total], back, lambda at: added(np.clip(at, first, last))[:, None])


def _pid_sum(log: FlightLog, message: str) -> tuple[Floats, Floats] | None:
    """Return times and the sum of the controller's terms; None where they are not logged."""
    if message not in log.messages:
        return None
    frame = log.messages[message]
    terms = [name for name in ("P", "I", "D", "FF", "DFF") if name in frame]
    if not {"P", "I", "D"} <= set(terms) or len(frame) < 16:
        return None
    total = frame[terms].to_numpy(np.float64).sum(axis=1)
    times = frame.index.to_numpy(np.float64)
    order = np.argsort(times, kind="stable")
    finite = np.isfinite(total[order])
    return times[order][finite], total[order][finite]
