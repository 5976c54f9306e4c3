"""`response`: from flights, or tables of samples, to the frequency response of an axis."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logparse import Finding, FlightLog, Severity
from sysid.frequency.axes import Axis, FrequencyError, axis_of, log_by_log
from sysid.frequency.excitation import Chirp, Within
from sysid.frequency.fit import fit, refit
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.flight_records import chirp_record, flight_record, throttle_record
from sysid.frequency.limits import FOLDING, limits_of, reversed_answer, share_at_limits
from sysid.frequency.rate_signals import LogSignals, sources_of
from sysid.frequency.records import ORDINARY_BAND, AxisRecord, experiment_record
from sysid.frequency.response import Floats, FrequencyResponse
from sysid.frequency.spectra import (
    RecordWindows,
    SpectralRegression,
    ThinnedSignals,
    band_of_window,
    merged,
    thinned,
    window_lengths,
    windows_of,
)
from sysid.records.experiment import Experiment

#: Standard deviation of ln |G| that all frequencies of a flight have in common: outputs are rounded to 1 us, and thrust
#: is linear in the command only to a few percent between one trim and another; more where sticks move the craft through
#: many trims than in chirps (39 and 47 responses of firmware craft).
_ROUNDED, _ROUNDED_BY_STICKS = 0.015, 0.02

#: The same from the throttle of firmware that compensates neither battery nor thrust curve well: thrust per throttle
#: sinks by a tenth over a battery.
_TRIMMED = 0.05

#: Common error of slow samples of the controller, in errors of single frequencies: whether a sample meets the kick that
#: a stick gives to a fast loop changes all frequencies alike. Firmware flights sampled at 10 Hz in five phases were
#: wrong by -0.19 to 0.18 where single frequencies said 0.07 (27 estimates).
_FOLDED = 2.0

#: Standard deviation of the delay [s], and what the time between rows adds in parts of it where no chirp moves the
#: axis: where in a row the gyro's sample falls, and what folds. Chirps of firmware err by 0.1 ms, twelve ordinary
#: flights logged at 50 Hz by 0.5 ms.
_DELAY, _DELAY_OF_STEP = 0.1e-3, 0.03

#: Frequencies on either side whose coherence counts as well.
_BESIDE = 2

#: A log by its path, too, or its signals where they are read already.
Data = FlightLog | LogSignals | Experiment | str | Path


def response(
    data: Data | Sequence[Data], axis: str, within: Within | None = None, like: FrequencyFit | None = None
) -> FrequencyResponse:
    """Estimate the frequency response of an axis: controller output to body rate, or thrust to vertical acceleration.

    Chirps on the axis are used where there are any, with the chirp as instrument; other flights by what their pilot or
    autopilot wanted, with the attitude target as instrument.

    Parameters
    ----------
    data : FlightLog, path-like, Experiment, or a sequence of these
        Several are summed. An experiment needs an input and an output of the axis (see `experiment_record`), or one
        input and one output.
    axis : {"roll", "pitch", "yaw", "vertical"}
    within : tuple of float, optional
        From when to when a log counts, s on its boot clock; default its longest flight, and chirps wherever they are.
    like : FrequencyFit, optional
        A fit to other data of the craft, whose structure and band are taken for granted and whose values are a start:
        faster.

    Raises
    ------
    FrequencyError
        Where the data cannot give it; the message says what to fly or log.
    """
    which = axis_of(axis)
    findings: list[Finding] = []
    sources = _sources(data, within)
    records = records_of(sources, which, findings)
    logs = [source.log for source in sources if isinstance(source, LogSignals)]
    source = records[0].source
    filters = {log.parameters_flown.get("INS_GYRO_FILTER") for log in logs}
    gyro = filters.pop() if len(filters) == 1 and which.attitude else None
    if len(filters) > 1 and which.attitude:
        findings.append(
            Finding(
                "flights-not-alike",
                Severity.WARNING,
                "The logs were flown with different INS_GYRO_FILTER: their sum is the response of no craft.",
                "Give logs of one setting at a time.",
            )
        )
    findings += limits_of(records, logs)
    limited = max((share_at_limits(log, records) for log in logs), default=0.0)
    ordinary = any(record.band[0] == ORDINARY_BAND[0] for record in records)
    lost = float(np.mean([record.common**2 for record in records]))
    thin = _thinned(records, which)
    del records  # As they were logged, they take a fifth of the file.
    frf = _response(thin, which, gyro or None, like=like)
    turning = bool(logs and which.attitude)
    rounded = (_ROUNDED_BY_STICKS if ordinary else _ROUNDED) if any(log.tables.has("motors") for log in logs) else 0.0
    squares = [(_TRIMMED if frf.trim is not None or source else rounded) ** 2, which.between_trims**2]
    if ordinary and turning and frf.step > 1.0 / FOLDING and frf.usable.any():
        squares.append((_FOLDED * float(np.median(frf.sigma[frf.usable]))) ** 2)
    common = float(np.sqrt(np.sum(squares) + lost))
    if turning:
        findings += reversed_answer(frf)
    delay = float(np.hypot(_DELAY, _DELAY_OF_STEP * frf.step if ordinary else 0.0))
    return replace(frf, findings=tuple(findings), systematic=common, systematic_delay=delay, limited=limited)


#: Signals of a log, or a record of other origin.
Source = LogSignals | Experiment


def records_of(sources: Sequence[Source], axis: Axis, findings: list[Finding]) -> list[AxisRecord]:
    """Cut the records of an axis: its chirps where there are any, else ordinary flying.

    FrequencyError when there is none; the message says why not, log by log.
    """
    if not sources:
        raise FrequencyError("no logs given")
    chirped: list[AxisRecord] = []
    ordinary: list[AxisRecord] = []
    reasons: list[str] = []
    for source in sources:
        try:
            if isinstance(source, Experiment):
                ordinary.append(experiment_record(source, axis))
                continue
            with_chirps = _chirped(source, axis, findings, reasons)
            chirped += with_chirps
            if not with_chirps:
                ordinary.append(ordinary_record(source, axis))
        except FrequencyError as error:
            reasons.append(str(error))
    records = _of_one_source(chirped or ordinary, findings)
    # Spectra of records add up only with the same inputs: of two kinds, the simpler counts for all.
    fewest = min((record.inputs.shape[1] for record in records), default=1)
    records = [record if record.inputs.shape[1] == fewest else record.alone() for record in records]
    if not records:
        raise FrequencyError(log_by_log(reasons) or f"no excitation of the {axis.name} axis")
    return records


def _sources(data: Data | Sequence[Data], within: Within | None) -> list[Source]:
    """Return each source; a record cut from a log is that stretch of the log."""
    sources: list[Source] = []
    for given in [data] if isinstance(data, Data) else data:
        if not isinstance(given, Experiment):
            sources += sources_of(given, within)
        elif given.log is None:
            sources.append(given)
        else:
            sources.append(LogSignals(given.log, within or (float(given.t[0]), float(given.t[-1]))))
    return sources


def _of_one_source(records: list[AxisRecord], findings: list[Finding]) -> list[AxisRecord]:
    """Keep the records of the source that has most: outputs of controllers and those of motors are not the same."""
    seconds: dict[str, float] = {}
    for record in records:
        seconds[record.source] = seconds.get(record.source, 0.0) + record.duration
    if len(seconds) < 2:
        return records
    kept = max(seconds, key=lambda source: seconds[source])
    left_out = [record.name for record in records if record.source != kept]
    findings.append(
        Finding(
            "flights-not-alike",
            Severity.INFO,
            f"Left out, because other signals stand for their controllers' outputs: {', '.join(left_out)}.",
            "Log the rate loop at 25 Hz or more in every flight.",
        )
    )
    return [record for record in records if record.source == kept]


def ordinary_record(source: LogSignals, axis: Axis) -> AxisRecord:
    """Cut the record of ordinary flying, of the vertical axis from throttle and accelerometer where RATE is not logged.

    FrequencyError without the signals.
    """
    if not axis.attitude and not source.tells_height:
        return throttle_record(source)
    return flight_record(source, source.of(axis), axis)


def _chirped(source: LogSignals, axis: Axis, findings: list[Finding], reasons: list[str]) -> list[AxisRecord]:
    """Cut the records of a log's chirps on an axis, and say of those that cannot be used why."""
    log, chirps = source.log, source.chirps(axis.name)
    if not chirps:
        return []
    signals = source.of(axis)
    records = []
    for chirp in chirps:
        if not chirp.worthwhile:
            reasons.append(
                f"{log.path.name}: the chirp on the {axis.name} axis at {chirp.start:.1f} s was aborted after "
                f"{chirp.duration:.1f} s at {chirp.high:.2g} Hz, before it had swept a band; fly it again, for 20 s "
                "at least"
            )
            findings.append(_aborted(log, axis, chirp))
            continue
        if not chirp.complete:
            findings.append(_aborted(log, axis, chirp))
        try:
            records.append(chirp_record(log, signals, axis, chirp))
        except FrequencyError as error:
            reasons.append(str(error))
    return records


def _aborted(log: FlightLog, axis: Axis, chirp: Chirp) -> Finding:
    return Finding(
        "not-determined",
        Severity.WARNING,
        f"The chirp on the {axis.name} axis at {chirp.start:.1f} s of {log.path.name} ended at {chirp.high:.2g} Hz, "
        "before its time.",
        "Fly it again for the frequencies above.",
        {"start": chirp.start, "duration": chirp.duration, "highest_hz": chirp.high},
    )


def response_of_records(
    records: Sequence[AxisRecord],
    axis: Axis,
    *,
    gyro_filter_hz: float | None = None,
    refined: bool = True,
    like: FrequencyFit | None = None,
) -> FrequencyResponse:
    """Estimate the response of the first input of uniform records."""
    return _response(_thinned(records, axis), axis, gyro_filter_hz, refined=refined, like=like)


class _Thinned(NamedTuple):
    """Records at the rates that their frequencies [Hz] ask for."""

    records: list[AxisRecord]
    hz: Floats
    longest: float  #: Of the records as they were, s.
    step: float
    duration: float


def _thinned(records: Sequence[AxisRecord], axis: Axis) -> _Thinned:
    """Choose the frequencies that records can tell, and thin these out to what that asks for."""
    records = [record for record in records if len(record.output) > 18 or not axis.attitude]
    if not records:
        raise FrequencyError(f"no record of the {axis.name} axis has more than 18 samples")
    step = max(record.dt for record in records)
    if step > 0.125:
        raise FrequencyError(
            f"the {axis.name} axis is sampled at {1.0 / step:.1f} Hz, too slow for its dynamics; log it at 25 Hz or "
            "more"
        )
    longest = max(record.duration for record in records)
    # Three cycles of the lowest frequency in the longest record.
    low = max(min(record.band[0] for record in records), 3.0 / max(longest, 1e-9))
    # Near the end of a chirp stronger neighbours on one side outweigh its last frequencies.
    high = min(0.92 * max(record.band[1] for record in records), 0.45 / step)
    if high <= 1.5 * low:
        raise FrequencyError(
            f"records of {longest:.1f} s that span {low:.2g} to {high:.2g} Hz on the {axis.name} axis are too short; "
            "a chirp should last 20 s at least, ordinary flying a minute"
        )
    hz = np.geomspace(low, high, max(round(45 * np.log10(high / low)), 8))
    # At their rates, the band is a small part of most records.
    thin = [thinned(record, high) for record in records]
    if axis.attitude:  # a rate axis integrates
        thin = [record.difference() for record in thin]
    return _Thinned(thin, hz, longest, step, float(sum(record.duration for record in records)))


def _response(
    data: _Thinned,
    axis: Axis,
    gyro_filter_hz: float | None,
    *,
    refined: bool = True,
    like: FrequencyFit | None = None,
) -> FrequencyResponse:
    """Estimate the response of records that are thinned out."""
    thin, hz, longest, step, duration = data
    windows = _windows(thin, hz, longest)
    frf = _composite(thin, windows, axis, hz, gyro_filter_hz, None)
    if refined:
        with suppress(FrequencyError):  # what no structure can be fitted to stays as it is
            frf = _without_bends(thin, windows, axis, frf, fit(frf) if like is None else refit(like, frf))
    return replace(frf, step=step, duration=duration)


def _without_bends(
    records: Sequence[AxisRecord],
    windows: Sequence[_Windows],
    axis: Axis,
    first: FrequencyResponse,
    model: FrequencyFit,
) -> FrequencyResponse:
    """Estimate a response again from what a first `model` leaves of the records.

    What windows bend is the steep and the resonant; of the remainder to a model that has it, little is left to bend.
    A resonance that windows have flattened is found sharper each time.
    """
    remainders = [record.remainders() for record in records]
    for _ in range(8):
        left = [without(model.response) for without in remainders]
        frf = _composite(left, windows, axis, first.hz, first.gyro_filter_hz, model)
        moved = np.abs(np.log(frf.response / first.response)) / frf.sigma
        first = frf
        if np.max(moved, where=frf.counts, initial=0.0) < 0.3:
            break
        try:
            model = refit(model, frf)
        except FrequencyError:
            break
    return first


def _of_neighbours(coherence: Floats) -> Floats:
    """Return the median coherence of each frequency and two to either side, which see nearly the same windows.

    By chance a single one passes a limit that the others do not, and it is the one whose response errs most: without
    this the yaw of a PX4 flight with a jammed receiver had a gain of 31 ± 9 rad/s^2, of three chance frequencies.
    """
    around = np.lib.stride_tricks.sliding_window_view(np.pad(coherence, _BESIDE, "edge"), 2 * _BESIDE + 1)
    return np.asarray(np.median(around, axis=1))


def _less_its_error(coherence: Floats, averages: Floats) -> Floats:
    """Return coherences less their standard error (Bendat and Piersol 2010, table 9.6).

    Those that pass a limit by chance are those whose responses err most.
    """
    known = np.where(np.isfinite(averages) & (averages > 0.0), averages, np.inf)
    error = np.sqrt(2.0 * coherence / known) * (1.0 - coherence)
    return np.asarray(np.maximum(coherence - error, 0.0))


def _covered(record: AxisRecord, hz: Floats) -> NDArray[np.bool_]:
    """Return at which frequencies what excited a record was logged."""
    skipped = [(hz > low) & (hz < high) for low, high in record.unswept]
    return ~np.any(skipped, axis=0) if skipped else np.ones(len(hz), dtype=bool)


@dataclass(frozen=True, slots=True, eq=False)
class _Windows:
    """Windows of one length over all records, and the frequencies, of all, that they serve."""

    mask: NDArray[np.bool_]
    of_records: tuple[RecordWindows | None, ...]
    regression: SpectralRegression


def _windows(records: Sequence[AxisRecord], hz: Floats, longest: float) -> list[_Windows]:
    lengths = window_lengths(longest, float(hz[0]), float(hz[-1]))
    masks = [(float(length), band_of_window(float(length), lengths, hz)) for length in lengths]
    masks = [(length, mask) for length, mask in masks if mask.any()]
    served, lengths_used = [hz[mask] for _, mask in masks], [length for length, _ in masks]
    cuts = zip(*(windows_of(record, served, lengths_used) for record in records), strict=True)
    windows = []
    for (length, mask), cut in zip(masks, cuts, strict=True):
        regression = SpectralRegression.of([of_record.driving for of_record in cut if of_record is not None], length)
        if regression is not None:
            windows.append(_Windows(mask, cut, regression))
    return windows


def _composite(
    records: Sequence[AxisRecord],
    windows: Sequence[_Windows],
    axis: Axis,
    hz: Floats,
    gyro_filter_hz: float | None,
    model: FrequencyFit | None,
) -> FrequencyResponse:
    """Merge windows of several lengths, of the records as they are or of what a first `model` has left of them."""
    known = None if model is None else model.response(hz)
    outputs = [ThinnedSignals(record.output[:, None]) for record in records]
    parts = []
    for window in windows:
        cuts = zip(window.of_records, outputs, strict=True)
        sums = [cut.sums(output) for cut, output in cuts if cut is not None]
        parts.append((window.mask, window.regression.estimate(sums, None if known is None else known[window.mask])))
    if not parts:
        longest = max(record.duration for record in records)
        lost = 1.0 - float(np.mean(np.concatenate([record.usable for record in records])))
        why = "are too short" if lost < 0.1 else f"miss {100.0 * lost:.0f} % of their rows, which is too much"
        raise FrequencyError(f"records of {longest:.1f} s {why} for windows on the {axis.name} axis")
    whole = merged(parts)
    gamma = np.clip(whole.coherence, 1e-6, 1.0 - 1e-12)
    with np.errstate(divide="ignore", invalid="ignore"):
        averages = (1.0 - gamma) / (2.0 * gamma * whole.sigma**2)
    instruments = sorted({record.instrument for record in records} - {""})
    coherence = np.minimum(whole.coherence, _of_neighbours(whole.coherence))
    covered = np.any([_covered(record, hz) for record in records], axis=0)
    return FrequencyResponse(
        axis=axis.name,
        input=axis.input,
        output=axis.output,
        unit=axis.unit,
        hz=hz,
        response=whole.response,
        coherence=np.where(covered, _less_its_error(coherence, averages), 0.0),
        sigma=whole.sigma,
        averages=np.asarray(averages, dtype=np.float64),
        resolution=whole.resolution,
        multiple_coherence=whole.multiple,
        method="instrument" if instruments else "direct",
        instrument=", ".join(instruments),
        direct=whole.direct,
        step=max(record.dt for record in records),
        gyro_filter_hz=gyro_filter_hz,
        records=tuple(record.name for record in records),
        duration=float(sum(record.duration for record in records)),
        source=records[0].source,
        trim=float(np.mean(trims)) if (trims := [r.trim for r in records if r.trim is not None]) else None,
    )
