"""A structure in the time domain: a cross-check of its parameters, and its verification on held-out flights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.linalg import solve_toeplitz

from logparse import FlightLog
from sysid.frequency.axes import AXES, FrequencyError
from sysid.frequency.estimate import records_of
from sysid.frequency.fit import FrequencyFit
from sysid.frequency.records import AxisRecord, flight_record
from sysid.frequency.response import Floats
from sysid.frequency.sources import signals_of
from sysid.statistics.covariance import independent_samples
from sysid.statistics.parameter import Parameter

#: Order of the autoregression that whitens the remainder, and how often it is estimated anew.
_AUTOREGRESSION, _ROUNDS = 12, 3

#: Slower movements [Hz] are of wind and trim, not of what is verified.
_SLOWEST = 0.15

#: Theil's coefficient up to which a model predicts well (Tischler and Remple 2012, section 14.2).
GOOD_THEIL = 0.3


def fit_in_time(found: FrequencyFit, data: FlightLog | Sequence[FlightLog]) -> Mapping[str, Parameter]:
    """Fit the structure of one frequency response to the samples it came from, by the prediction-error method.

    The output-error of the structure is whitened by an autoregression, which makes the estimate consistent also where
    the loop is closed, as far as the noise is one (Ljung 1999, section 13.4).

    Parameters
    ----------
    found : FrequencyFit
        Of one axis; its values are where the search starts.
    data : FlightLog or sequence of FlightLog

    Returns
    -------
    mapping of str to Parameter
        Parameters by name, with Cramer-Rao's errors.

    Raises
    ------
    FrequencyError
        Where the data have no record of the axis, or the fit is of several axes.
    """
    if len(found.axes) != 1:
        raise FrequencyError("the time-domain check takes a fit of one axis")
    axis, structure = AXES[found.axes[0]], found.structure[0]
    records = [record.difference() if axis.attitude else record for record in records_of(data, axis)]
    specs = structure.specs
    positive = np.array([spec.positive for spec in specs])
    scale = np.array([spec.scale for spec in specs])
    start = found.values
    sign = np.where(positive, np.sign(start), 1.0)

    def values_of(x: Floats) -> Floats:
        return np.asarray(np.where(positive, sign * np.exp(x), x * scale))

    def remainders(x: Floats) -> list[Floats]:
        model = found.at(values_of(x))
        left = [record.without(model.response) for record in records]
        return [np.asarray((one.output - np.mean(one.output))[one.usable]) for one in left]

    x = np.asarray(np.where(positive, np.log(np.abs(start)), start / scale))
    slope, error = np.zeros((1, len(x))), np.zeros(1)
    for _ in range(_ROUNDS):
        whitening = _whitening(remainders(x))

        def whitened(x: Floats, filter_: Floats = whitening) -> Floats:
            parts = [np.convolve(one, filter_, "valid") for one in remainders(x)]
            return np.concatenate(parts)

        result = scipy.optimize.least_squares(whitened, x, method="lm", max_nfev=20 * len(x))
        x = np.asarray(result.x, dtype=np.float64)
        slope, error = np.asarray(result.jac, dtype=np.float64), np.asarray(result.fun, dtype=np.float64)
    values = values_of(x)
    turn = np.where(positive, np.abs(values), scale)
    covariance = np.linalg.pinv(slope.T @ slope, hermitian=True) * float(np.mean(error**2))
    sigma = turn * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return {
        spec.name: Parameter(float(value), float(deviation), spec.unit)
        for spec, value, deviation in zip(specs, values, sigma, strict=True)
    }


def _whitening(remainders: Sequence[Floats]) -> Floats:
    """Return the coefficients of the autoregression that predicts the remainders (Yule and Walker)."""
    lags = np.zeros(_AUTOREGRESSION + 1)
    for one in remainders:
        lags += [float(np.dot(one[: len(one) - lag], one[lag:])) for lag in range(_AUTOREGRESSION + 1)]
    lags[0] *= 1.0 + 1e-9
    ahead = solve_toeplitz(lags[:-1], lags[1:])
    return np.concatenate([[1.0], -np.asarray(ahead, dtype=np.float64)])


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """How well a model predicts the rate (or acceleration) of a flight it has not seen, from the commands alone."""

    axis: str
    records: tuple[str, ...]
    rms: float  #: Of the error, in the unit of the output.
    fit_percent: float  #: 100 (1 - rms error / rms output).
    theil: float  #: Theil's inequality coefficient: 0 perfect, up to 0.3 good.
    #: Largest correlation of error and command over lags up to half a second, in its own standard deviation for
    #: unrelated signals of these spectra; beyond 3 the model misses something that the command causes.
    correlation: float

    @property
    def verdict(self) -> str:
        """Return in words what the model may be used for."""
        if self.theil <= GOOD_THEIL / 3.0:
            return "predicts rates and margins; fit for tuning"
        return (
            "predicts the course of the rates; fit for margins" if self.theil <= GOOD_THEIL else "not to be relied on"
        )


def verify(found: FrequencyFit, data: FlightLog | Sequence[FlightLog]) -> Verification:
    """Judge a fit of one axis on other flights: all their time in the air above 0.15 Hz.

    Raises
    ------
    FrequencyError
        Where the flights have no signals of the axis, or the fit is of several axes.
    """
    if len(found.axes) != 1:
        raise FrequencyError("a verification takes a fit of one axis")
    axis = AXES[found.axes[0]]
    logs = [data] if isinstance(data, FlightLog) else list(data)
    records = [flight_record(log, signals_of(log, axis), axis) for log in logs]
    errors, outputs, models, scores = [], [], [], []
    for record in records:
        left = record.without(found.response)
        band = scipy.signal.butter(2, _SLOWEST, "high", fs=1.0 / record.dt, output="sos")
        error = scipy.signal.sosfiltfilt(band, left.output)[record.usable]
        output = scipy.signal.sosfiltfilt(band, record.output)[record.usable]
        errors.append(error)
        outputs.append(output)
        models.append(output - error)
        scores.append(
            _largest_correlation(error, scipy.signal.sosfiltfilt(band, record.inputs[:, 0])[record.usable], record)
        )
    rms = [float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) for parts in (errors, outputs, models)]
    return Verification(
        axis=axis.name,
        records=tuple(record.name for record in records),
        rms=rms[0],
        fit_percent=100.0 * (1.0 - rms[0] / rms[1]),
        theil=rms[0] / (rms[1] + rms[2]),
        correlation=max(scores),
    )


def _largest_correlation(error: Floats, command: Floats, record: AxisRecord) -> float:
    reach = max(int(0.5 / record.dt), 1)
    # Two coloured signals are unrelated to within one over the root of the samples that their product is worth.
    worth = independent_samples([error * command / np.sqrt(np.mean((error * command) ** 2))])
    scale = float(np.sqrt(np.mean(error**2) * np.mean(command**2)))
    values = [abs(float(np.mean(error[lag:] * command[: len(command) - lag]))) for lag in range(reach)]
    return max(values) / max(scale, 1e-300) * float(np.sqrt(worth))
