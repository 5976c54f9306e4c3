"""A fit in the time domain: its verification on held-out flights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_toeplitz

from sysid.frequency.axes import AXES, FrequencyError
from sysid.frequency.estimate import ordinary_record, response
from sysid.frequency.excitation import Within, outside_chirps
from sysid.frequency.fit import refit
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.flight_records import SHORTEST_FLIGHT
from sysid.frequency.limits import FOLDING
from sysid.frequency.rate_signals import GivenSignals, LogSignals, records_of_each, sources_of
from sysid.frequency.records import AxisRecord
from sysid.frequency.response import Floats
from sysid.records.filtering import above
from sysid.statistics.covariance import independent_samples
from sysid.statistics.residual_test import ResidualTest
from sysid.statistics.residuals import examine_residuals

#: Order of the autoregression that whitens the remainder.
_AUTOREGRESSION = 12

#: Theil's coefficient up to which a model predicts well (Tischler and Remple 2012, section 14.2).
GOOD_THEIL = 0.3

#: Standard deviations up to which errors and what was asked may correlate by chance, as the largest of many lags.
UNRELATED = 4.0


def _whitening(remainders: Sequence[Floats]) -> Floats:
    """Return the coefficients of the autoregression that predicts the remainders (Yule and Walker)."""
    lags = np.zeros(_AUTOREGRESSION + 1)
    for one in remainders:
        lags += [float(np.dot(one[: len(one) - lag], one[lag:])) for lag in range(_AUTOREGRESSION + 1)]
    lags[0] *= 1.0 + 1e-9
    ahead = solve_toeplitz(lags[:-1], lags[1:])
    return np.concatenate([[1.0], -np.asarray(ahead, dtype=np.float64)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verification:
    """How well a model predicts the rate (or acceleration) of flying it has not seen, from the commands alone."""

    axis: str
    records: tuple[str, ...]
    seconds: float  #: Length of the records together.
    rms: float  #: Of the error, in the unit of the output.
    fit_percent: float  #: 100 (1 - rms error / rms output).
    theil: float  #: Theil's inequality coefficient: 0 perfect, up to 0.3 good.
    #: Largest correlation of the error with the instrument, which gusts do not move, over lags up to half a second, in
    #: its own standard deviation for unrelated signals of these spectra; beyond `UNRELATED` the model misses something.
    correlation: float
    #: Of the errors one sample ahead in the second half, whitened as the first half says; None where that is too short.
    residuals: ResidualTest | None

    @property
    def verdict(self) -> str:
        """Return in words what the model may be used for."""
        if self.theil <= GOOD_THEIL / 3.0:
            return "predicts rates and margins; fit for tuning"
        return (
            "predicts the course of the rates; fit for margins" if self.theil <= GOOD_THEIL else "not to be relied on"
        )


def verify(model: FrequencyFit, data: GivenSignals, within: Within | None = None) -> Verification:
    """Judge a fit of one axis on other flying: all its time in the air, without chirps, above 0.15 Hz.

    Parameters
    ----------
    found : FrequencyFit
        Of one axis.
    data : FlightLog, path-like, or a sequence of either
    within : tuple of float, optional
        From when to when a log counts, s on its boot clock.

    Raises
    ------
    FrequencyError
        Where the flights have no signals of the axis or too little is left of them, or the fit is of several axes.
    """
    if len(model.axes) != 1:
        raise FrequencyError("a verification takes a fit of one axis")
    axis = AXES[model.axes[0]]

    def cut(source: LogSignals) -> AxisRecord:
        record = ordinary_record(source, axis)
        # Most often the fit was made from chirps.
        t: Floats = record.start + record.dt * np.arange(len(record.output), dtype=np.float64)
        ordinary = outside_chirps(source.log, t)
        return replace(record, usable=record.usable & ordinary)

    return verify_records(model, records_of_each(sources_of(data, within), cut))


def hold_out(model: FrequencyFit, logs: Sequence[LogSignals]) -> Verification:
    """Judge a fit of one axis on flying that it was not made from, or one of the same kind where it was made from all.

    A fit to chirps is judged on the rest of its logs. Of ordinary flying the last log, or the last part of the only
    one, is judged by a fit to the others.
    """
    axis = AXES[model.axes[0]]
    if axis.attitude and model.responses[0].step > 1.0 / FOLDING:
        raise FrequencyError(
            f"rows at {1.0 / model.responses[0].step:.0f} Hz show the command in aliases, from which nothing can be "
            "predicted; log it at 25 Hz or more"
        )
    if any(signals.chirps(axis.name) for signals in logs):
        return verify(model, logs)
    if len(logs) > 1:
        return verify(refit(model, response(logs[:-1], axis.name, like=model)), logs[-1])
    record = ordinary_record(logs[0], axis)
    cut = record.start + 0.6 * record.duration
    first = refit(model, response(logs[0].part(record.start, cut), axis.name, like=model))
    return verify(first, logs[0].part(cut, record.start + record.duration))


def verify_records(model: FrequencyFit, records: Sequence[AxisRecord]) -> Verification:
    """Judge a fit of one axis on records that it was not made from."""
    axis = AXES[model.axes[0]]
    errors, outputs, models, scores, ahead = [], [], [], [], []
    seconds = float(sum(np.count_nonzero(record.usable) * record.dt for record in records))
    if seconds < SHORTEST_FLIGHT:
        raise FrequencyError(f"{seconds:.0f} s of held-out flying are too few to judge the {axis.name} axis")
    for record in records:
        left = record.remainders()(model.response)
        signals = np.column_stack([left.output, record.output, record.inputs[:, 0], record.instruments[:, 0]])
        # Each in one piece: they are multiplied sample by sample again and again.
        error, output, command, outside = np.ascontiguousarray(above(signals, 0.15 * record.dt)[record.usable].T)
        errors.append(error)
        outputs.append(output)
        models.append(output - error)
        if np.std(outside) > 0.0:
            scores.append(largest_correlation(error, outside, record))
        ahead.append((error, np.column_stack([command, outside])))
    rms = [float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) for parts in (errors, outputs, models)]
    return Verification(
        axis=axis.name,
        records=tuple(record.name for record in records),
        seconds=seconds,
        rms=rms[0],
        fit_percent=100.0 * (1.0 - rms[0] / max(rms[1], 1e-300)),
        theil=rms[0] / max(rms[1] + rms[2], 1e-300),
        correlation=max(scores, default=0.0),
        residuals=_one_ahead(axis.output, ahead),
    )


def _one_ahead(output: str, parts: Sequence[tuple[Floats, Floats]]) -> ResidualTest | None:
    """Test the errors one sample ahead: whitened by an autoregression of the first halves, in the second halves."""
    halves = [len(error) // 2 for error, _ in parts]
    if sum(halves) < 200:
        return None
    whitening = _whitening([error[:half] for (error, _), half in zip(parts, halves, strict=True)])
    later = [(error[half:], inputs[half:]) for (error, inputs), half in zip(parts, halves, strict=True)]
    order = len(whitening) - 1
    later = [part for part in later if len(part[0]) > 4 * order]
    whitened = [np.convolve(error, whitening, "valid") for error, _ in later]
    return examine_residuals(output, whitened, [inputs[order:] for _, inputs in later], ("command", "instrument"))


def largest_correlation(error: Floats, command: Floats, record: AxisRecord) -> float:
    """Return the largest correlation of an error with the command within half a second, in its standard deviations.

    `error, command` (N,): the model's error and what moves the axis, both above the same frequency.
    """
    reach = min(max(int(0.5 / record.dt), 1), len(error))
    # Two coloured signals are unrelated to within one over the root of the samples that their product is worth.
    worth = independent_samples([error * command / np.sqrt(np.mean((error * command) ** 2))])
    scale = float(np.sqrt(np.mean(error**2) * np.mean(command**2)))
    values = [abs(float(error[lag:] @ command[: len(command) - lag])) / (len(error) - lag) for lag in range(reach)]
    return max(values) / max(scale, 1e-300) * float(np.sqrt(worth))
