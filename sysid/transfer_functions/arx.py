"""Discrete-time ARX models, the linear predictor of Elhesasy 2024 (section 5): ``A(q) y = B(q) u + c + e``.

Each output is predicted from its own last values and those of the inputs; the coefficients follow from linear least
squares, with an offset for every record. That minimises the error of the prediction one step ahead, which is why a free
run of an ARX model is usually worse than that of an output-error model: any noise on the output biases A towards poles
that are too fast (Ljung 1999, section 7.3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.linalg import lstsq

from core.summary import Summarised, listed
from logparse import Finding, Severity
from sysid.records.excitation import examine
from sysid.records.experiment import (
    Experiment,
    ExperimentError,
    Floats,
    ModelOrderError,
    horizon_steps,
    require_alike,
    require_signals,
)
from sysid.records.filtering import lfilter
from sysid.transfer_functions.response import INITIAL_SECONDS

#: Largest modulus of a pole of a free run: slower ones are moved here, unstable ones mirrored to the inside.
LARGEST_MODULUS = 0.9999


@dataclass(frozen=True, slots=True)
class Difference:
    """Difference equation of one output: ``y[t] = -sum a[k] y[t-k] + sum_j sum_k b[j, k] u_j[t-delay-k] + c``."""

    a: Floats  #: shape (na,): Coefficients of y[t-1] ... y[t-na], on the left-hand side.
    b: Floats  #: shape (m, nb): Coefficients of u[t-delay] ... u[t-delay-nb+1].
    #: shape (na + m nb, na + m nb): Of (a, b row by row) for white e; infinite where the data do not determine a
    #: coefficient.
    covariance: Floats
    sigma: float  #: Standard deviation of e.


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ArxModel(Summarised):
    """ARX models of all outputs; see `fit_arx`."""

    name: str
    differences: Mapping[str, Difference]  #: By output.
    #: ``[record][output]``: what the equation's constant c was in each training record.
    offsets: Mapping[str, Mapping[str, float]]
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    units: Mapping[str, str]
    delay: int  #: Samples from input to output.
    rate: float  #: Samples per second; records of another rate are refused.
    training: tuple[str, ...]
    findings: tuple[Finding, ...] = ()

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {
            "name": self.name,
            "inputs": listed(self.input_names, 8),
            "outputs": listed(self.output_names),
            "rate": f"{self.rate:.4g} Hz, delay {self.delay} samples",
            "training": listed(self.training),
            "findings": listed(dict.fromkeys(finding.id for finding in self.findings)) or "none",
        }

    def simulate(self, experiment: Experiment) -> Floats:
        """Run freely: the first `INITIAL_SECONDS` are as measured, then only the inputs are looked at.

        The constant of a training record is the one found by the fit; in another record the trims are relied upon.

        Returns
        -------
        ndarray, shape (N, p)
        """
        self._require(experiment)
        result = experiment.y.copy()
        for column, output in enumerate(self.output_names):
            difference = self.differences[output]
            y = experiment.y[:, column] - experiment.output_trim[column]
            first = min(max(round(INITIAL_SECONDS / experiment.dt), len(difference.a)), len(y))
            drive = self._drive(experiment, output)[first:]
            denominator = np.concatenate([[1.0], difference.a])
            state = scipy.signal.lfiltic([1.0], denominator, y[:first][::-1])
            run = lfilter([1.0], denominator, drive, state)
            result[first:, column] = run + experiment.output_trim[column]
        return result

    def predict(self, experiment: Experiment, horizon: float = 1.0) -> Floats:
        """Predict every sample from the outputs up to `horizon` seconds before it, inputs taken as known.

        The minimum-variance predictor of the model: its equation run from measured values, future e being zero. The
        first samples, which have too little measured before them, are as measured.

        Returns
        -------
        ndarray, shape (N, p)
        """
        self._require(experiment)
        steps = horizon_steps(horizon, experiment.dt)
        result = experiment.y.copy()
        for column, output in enumerate(self.output_names):
            a, drive = self.differences[output].a, self._drive(experiment, output)
            y = experiment.y[:, column] - experiment.output_trim[column]
            begin, order = max(len(a), 1), len(a)
            origins = np.arange(begin, len(y) - steps + 1)
            if not len(origins):
                continue
            # past[:, k] is y[t - 1 - k], first measured, then predicted, for all origins at once.
            past = y[origins[:, None] - 1 - np.arange(order)]
            ahead = np.zeros(len(origins))
            for step in range(steps):
                ahead = drive[origins + step] - past @ a
                past = np.column_stack([ahead, past[:, :-1]]) if order else past
            result[origins + steps - 1, column] = ahead + experiment.output_trim[column]
        return result

    def _drive(self, experiment: Experiment, output: str) -> Floats:
        """Sum what inputs and constant add at every sample; inputs before the record are at trim."""
        u = experiment.u - experiment.input_trim
        drive = np.full(len(u), self.offsets.get(experiment.name, {}).get(output, 0.0))
        for j, b in enumerate(self.differences[output].b):
            drive += lfilter(np.concatenate([np.zeros(self.delay), b]), [1.0], u[:, j])
        return drive

    def _require(self, experiment: Experiment) -> None:
        require_signals(experiment, self.input_names, self.output_names)
        if abs(experiment.rate - self.rate) > 1e-3 * self.rate:
            raise ExperimentError(
                f"{experiment.name} is sampled at {experiment.rate:.4g} Hz, but a discrete-time model holds for the "
                f"{self.rate:.4g} Hz of its training only; resample"
            )


def fit_arx(experiments: Experiment | Sequence[Experiment], na: int = 5, nb: int = 5, delay: int = 1) -> ArxModel:
    """Fit ARX models of all outputs, jointly over records.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        Each keeps its own constant.
    na, nb : int
        Past outputs, and values of each input.
    delay : int
        Samples from input to output; with held inputs at least 1.

    Raises
    ------
    ExperimentError
        When the records differ in kind, no input moves, or there are fewer samples than coefficients.
    """
    if na < 0 or nb < 1 or delay < 0:
        raise ModelOrderError(f"na must be at least 0, nb at least 1, delay at least 0, not {na}, {nb}, {delay}")
    records = require_alike(experiments)
    excitation = examine(records)
    active = list(excitation.active)
    first = max(na, nb + delay - 1)
    equations = sum(max(len(record.t) - first, 0) for record in records)
    unknowns = na + nb * len(active) + len(records)
    if equations <= unknowns:
        raise ExperimentError(
            f"{equations} equations for {unknowns} coefficients of an ARX model; give longer or more records, or "
            "smaller na and nb"
        )
    findings = list(excitation.findings)
    differences: dict[str, Difference] = {}
    offsets: dict[str, dict[str, float]] = {record.name: {} for record in records}
    for column, output in enumerate(records[0].output_names):
        difference, constants, mirrored = _fit_output(records, column, active, na, nb, delay)
        differences[output] = difference
        for record, constant in zip(records, constants, strict=True):
            offsets[record.name][output] = constant
        if mirrored:
            findings.append(
                Finding(
                    "fit-not-converged",
                    Severity.WARNING,
                    f"least squares gave {output} {mirrored} pole(s) on or outside the unit circle, so that a free run "
                    "would grow without bound; they were mirrored to the inside",
                    "rely on the continuous-time model, whose poles are stable by construction",
                    {"output": output, "poles": mirrored},
                )
            )
    return ArxModel(
        name=f"ARX, na {na}, nb {nb}, delay {delay}",
        differences=differences,
        offsets=offsets,
        input_names=records[0].input_names,
        output_names=records[0].output_names,
        units=records[0].units,
        delay=delay,
        rate=records[0].rate,
        training=tuple(record.name for record in records),
        findings=tuple(findings),
    )


def _fit_output(
    records: Sequence[Experiment], column: int, active: Sequence[int], na: int, nb: int, delay: int
) -> tuple[Difference, list[float], int]:
    first = max(na, nb + delay - 1)
    regressors, targets, means = [], [], []
    for record in records:
        rows = np.arange(first, len(record.t))
        y = record.y[:, column] - record.output_trim[column]
        u = record.u - record.input_trim
        block = np.column_stack(
            [*(-y[rows - 1 - k] for k in range(na)), *(u[rows - delay - k, j] for j in active for k in range(nb))]
        )
        # A record's constant is eliminated by taking its means off.
        mean = block.mean(axis=0), float(y[rows].mean())
        regressors.append(block - mean[0])
        targets.append(y[rows] - mean[1])
        means.append(mean)
    phi, target = np.vstack(regressors), np.concatenate(targets)
    size = np.maximum(np.sqrt(np.mean(phi**2, axis=0)), 1e-300)
    theta, _, rank, singular = lstsq(phi / size, target, cond=1e-10)
    theta = theta / size
    residual = target - phi @ theta
    variance = float(residual @ residual) / max(len(target) - len(theta) - len(records), 1)
    covariance = np.full((len(theta), len(theta)), np.inf)
    if rank == len(theta) and singular is not None:
        covariance = variance * np.linalg.inv((phi / size).T @ (phi / size)) / size / size[:, None]
    a, mirrored = _stable(theta[:na])
    if mirrored:
        # With the poles moved, the inputs' coefficients that go best with them.
        theta[na:] = lstsq(phi[:, na:], target - phi[:, :na] @ a)[0]
    b = np.zeros((records[0].u.shape[1], nb))
    b[list(active)] = theta[na:].reshape(len(active), nb)
    whole = np.concatenate([a, theta[na:]])
    constants = [level - float(mean @ whole) for mean, level in means]
    wide = np.zeros((na + b.size, na + b.size))
    places = np.concatenate([np.arange(na), *(na + j * nb + np.arange(nb) for j in active)]).astype(np.int64)
    wide[np.ix_(places, places)] = covariance
    return Difference(a, b, wide, float(np.sqrt(variance))), constants, mirrored


def _stable(a: Floats) -> tuple[Floats, int]:
    """Mirror poles outside the unit circle to its inside; the coefficients and how many there were."""
    roots = np.roots(np.concatenate([[1.0], a]))
    size = np.abs(roots)
    outside = size > LARGEST_MODULUS
    if not outside.any():
        return a, 0
    inside = np.where(outside, roots / np.maximum(size, 1e-300) * np.minimum(1.0 / size, LARGEST_MODULUS), roots)
    return np.real(np.poly(inside))[1:], int(outside.sum())
