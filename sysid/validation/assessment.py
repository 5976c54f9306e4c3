"""Models against flights: free run and horizons, beside what anyone could predict without a model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import pandas as pd
from scipy.special import ndtri as normal_ppf

from core.summary import Summarised
from logparse import Finding
from sysid.records.experiment import MIN_SAMPLES, Experiment, ExperimentError, Floats, horizon_steps, require_alike
from sysid.rigid_body.model import RigidBodyModel
from sysid.statistics.residual_test import ResidualTest
from sysid.statistics.residuals import examine_residuals
from sysid.transfer_functions.arx import ArxModel
from sysid.transfer_functions.closed_loop import ClosedLoopModel
from sysid.transfer_functions.response import INITIAL_SECONDS
from sysid.transfer_functions.transfer_function import TransferFunctionModel
from sysid.validation.purposes import uses_of
from sysid.validation.report import DriftBand, ModelRecord, ValidationReport
from sysid.validation.uses import Uses

#: How far ahead predictions are compared with the baselines, s.
HORIZONS = (0.1, 0.5, 1.0, 2.0, 5.0, 10.0)

#: Part of a free run's errors that its drift band should hold.
BAND = 0.9


class Predictor(Protocol):
    """What a model must offer to be validated; a user's own class will do."""

    @property
    def training(self) -> tuple[str, ...]:
        """Names of the records it was fitted to."""

    def simulate(self, experiment: Experiment) -> Floats:
        """Run freely from the initial state; shape (N, p)."""

    def predict(self, experiment: Experiment, horizon: float = 1.0) -> Floats:
        """Predict every sample from measurements up to `horizon` seconds before it; shape (N, p)."""


class Model(Predictor, Protocol):
    """What every model of this package offers beyond that, for reports."""

    @property
    def name(self) -> str:
        """What it is, for tables."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings of the fit."""

    def record(self) -> ModelRecord:
        """Return what files hold of the model."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Validation(Summarised):
    """What a model is worth on given records."""

    model: str  #: Its name.
    #: One row per flight and output of the free run: ``flight output unit trained duration scored_from rmse fit_percent
    #: rmse_mean rmse_constant_position rmse_constant_velocity rmse_reference``. ``trained`` says whether the model has
    #: seen the record; ``fit_percent`` is ``100 (1 - |y - y_hat| / |y - mean y|)``. What the model has looked at is not
    #: scored: the first three seconds, from which the initial state is found, or more where the model has a method
    #: ``initial_seconds(experiment)`` that says so; ``scored_from`` has it. A record that is not longer is left out.
    #: ``rmse_mean`` is the record's own mean, known only afterwards; the other two baselines carry on position, or
    #: position and velocity, from where the score begins. Where inputs are the references of the outputs,
    #: ``rmse_reference`` is what taking each output for its reference errs; NaN otherwise.
    table: pd.DataFrame
    #: One row per flight, output and horizon [s]: ``flight output trained horizon rmse rmse_constant_position
    #: rmse_constant_velocity``.
    horizons: pd.DataFrame
    #: Per output the tests of the errors one sample ahead, over the records that the model has not seen; over all where
    #: it has seen all. Absent where there is too little to test.
    residuals: Mapping[str, ResidualTest]
    #: Per output the mean of ``rmse`` over the flights that the model has not seen; over all where it has seen all.
    average: Mapping[str, float]
    uses: Uses  #: What it is good for, by purpose.
    unseen: bool  #: False when every record was used for the fit, so that nothing is validated.
    predictions: Mapping[str, Floats]  #: Free run of every record by name, shape (N, p), for plots.
    #: The model works about each record's own mean inputs, known only afterwards: about the trim of the records fitted
    #: it errs by far more where hovering takes another thrust.
    own_trim: bool = False
    findings: tuple[Finding, ...] = ()  #: What the model had to say about single records.
    #: Of models that know how far their free runs may drift: half the width of the band that holds `BAND` of a run's
    #: errors, by record, shape (N, p); NaN where the run is not free.
    drift: Mapping[str, Floats] = field(default_factory=dict)
    #: Part of the free run's errors that is within it, by record, shape (p,).
    inside: Mapping[str, Floats] = field(default_factory=dict)

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {
            "model": self.model,
            "held-out flights": str(self.table.loc[~self.table["trained"], "flight"].nunique()),
            "free-run RMSE": ", ".join(f"{output} {value:.3g}" for output, value in self.average.items()),
            **dict(use.sentence.split(": ", 1) for use in self.uses.every),
        }

    def report(self) -> ValidationReport:
        """Return what files hold beside the errors."""
        return ValidationReport(residuals=self.residuals, own_trim=self.own_trim, drift=tuple(self._drift()))

    def _drift(self) -> Iterator[DriftBand]:
        """Yield the bands, thinned to 41 times."""
        for flight, widths in self.drift.items():
            outputs = self.table.loc[self.table["flight"] == flight, "output"]
            at = np.unique(np.linspace(0, len(widths) - 1, 41).round().astype(int))
            for column, output in enumerate(outputs):
                yield DriftBand(
                    flight=flight,
                    output=str(output),
                    holds=BAND,
                    inside=float(self.inside[flight][column]),
                    sample=tuple(at.tolist()),
                    half_width=tuple(widths[at, column].tolist()),
                )


def validate(
    model: Predictor,
    experiments: Experiment | Sequence[Experiment],
    horizons: Sequence[float] = HORIZONS,
    *,
    outside: Set[str] = frozenset(),
) -> Validation:
    """Judge a model on records, those it has not seen above all.

    Parameters
    ----------
    model : Predictor
        It is called by its attribute ``name``, or else by its class.
    experiments : Experiment or sequence of Experiment
        Of the model's kind; which of them it was fitted to is known from their names.
    horizons : sequence of float
        s.
    outside : set of str, optional
        Names of records that leave what the model was fitted to, where it extrapolates; they are judged apart.
    """
    records = require_alike(experiments)
    if isinstance(model, RigidBodyModel):
        # Of a flight whose first part was fitted wind and thrust scale are known.
        for record in records:
            if record.before is not None and record.before.name in model.training and record.name not in model.training:
                model = model.continued(record.before, record)
    rows: list[dict[str, object]] = []
    ahead: list[dict[str, object]] = []
    predictions: dict[str, Floats] = {}
    errors: dict[str, Floats] = {}
    start = {record.name: _scored_from(model, record) for record in records}
    findings: list[Finding] = []
    drift: dict[str, Floats] = {}
    inside: dict[str, Floats] = {}
    for record in records:
        # The wind of a flight is found once, not for every horizon.
        trimmed = model.with_early_trim(record) if isinstance(model, RigidBodyModel) else model
        if isinstance(trimmed, RigidBodyModel) and record.name not in model.training:
            findings += trimmed.unusual_flights({record.name: trimmed.flights[record.name]})
        simulated = trimmed.simulate(record)
        predictions[record.name] = simulated
        first = start[record.name]
        if isinstance(trimmed, RigidBodyModel) and record.name not in model.training:
            drift[record.name] = float(normal_ppf(0.5 + 0.5 * BAND)) * trimmed.drift(record)
        if first > len(record.t) - MIN_SAMPLES:
            continue
        if record.name in drift:
            held = np.abs(record.y - simulated) <= drift[record.name]
            inside[record.name] = held[max(first, 1) :].mean(axis=0)
        trained = record.name in model.training
        rows += _free_run_rows(record, simulated, trained, first)
        for horizon in horizons:
            steps = horizon_steps(horizon, record.dt)
            if steps * record.dt < 0.5 * record.duration:
                predicted, every = _ahead(trimmed, record, horizon, steps, simulated)
                ahead += _horizon_rows(record, predicted, steps, trained, first + steps, every)
                if steps == 1:
                    errors[record.name] = record.y - predicted
        if horizons and record.name not in errors:
            errors[record.name] = record.y - _ahead(trimmed, record, record.dt, 1, simulated)[0]
    if not rows:
        longest, looked = max(record.duration for record in records), max(start.values()) * records[0].dt
        raise ExperimentError(
            f"no record is long enough to judge the model: it looks at the first {looked:.0f} s of a record, "
            f"and the longest has {longest:.0f} s"
        )
    columns = ["flight", "output", "trained", "horizon", "rmse", "rmse_constant_position", "rmse_constant_velocity"]
    table, curve = pd.DataFrame(rows), pd.DataFrame(ahead, columns=columns)
    held_out = bool((~table["trained"]).any())
    examined = [r for r in records if r.name in errors and not (held_out and r.name in model.training)]
    scored = table[~table["trained"]] if held_out else table
    average = {str(output): float(group["rmse"].mean()) for output, group in scored.groupby("output", sort=False)}
    return Validation(
        model=str(getattr(model, "name", type(model).__name__)),
        table=table,
        horizons=curve,
        residuals=_examine(examined, errors, start),
        average=average,
        uses=uses_of(model, table, curve, outside),
        unseen=held_out,
        predictions=predictions,
        own_trim=isinstance(model, TransferFunctionModel | ArxModel),
        findings=tuple(findings),
        drift=drift,
        inside=inside,
    )


def _ahead(model: Predictor, record: Experiment, horizon: float, steps: int, simulated: Floats) -> tuple[Floats, int]:
    """Predict so far ahead; a model that integrates anew from every restart does so as often as is worth it."""
    # Ten predictions a second: more are no further news of so slow a motion. On a long flight hundreds of restarts tell
    # the error of a long horizon as well as thousands.
    every = max(round(0.1 / record.dt), len(record.t) * steps // 100_000, 1)
    if isinstance(model, RigidBodyModel):
        every = every if steps > 1 else 1
        return model.predict(record, horizon, every, simulated), every
    if isinstance(model, TransferFunctionModel | ClosedLoopModel):
        return model.predict(record, horizon, simulated), 1
    return model.predict(record, horizon), 1


def _scored_from(model: Predictor, record: Experiment) -> int:
    """Return the first sample that is scored: those from which a model takes its initial state are not."""
    looks_at = getattr(model, "initial_seconds", None)
    seconds = INITIAL_SECONDS if looks_at is None else max(INITIAL_SECONDS, float(looks_at(record)))
    return round(seconds / record.dt)


def _examine(
    records: Sequence[Experiment], errors: Mapping[str, Floats], start: Mapping[str, int]
) -> dict[str, ResidualTest]:
    """Test errors one sample ahead, from the moment at which the initial state is known."""
    tests = {}
    first = [start[record.name] for record in records]
    for column, output in enumerate(records[0].output_names if records else ()):
        test = examine_residuals(
            output,
            [errors[record.name][start:, column] for record, start in zip(records, first, strict=True)],
            [record.u[start:] for record, start in zip(records, first, strict=True)],
            records[0].input_names,
        )
        if test is not None:
            tests[output] = test
    return tests


def _rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(error**2)))


def _slopes(y: Floats, dt: float) -> Floats:
    """Velocity at every sample from the past second only, by a least-squares line; shape (N,)."""
    reach = max(round(1.0 / dt), 1)
    lag = np.arange(reach + 1)
    weights = (lag.mean() - lag) / (np.sum((lag - lag.mean()) ** 2) * dt)
    padded = np.concatenate([np.full(reach, y[0]), y])
    return np.asarray(np.convolve(padded, weights, mode="valid"))


def _free_run_rows(record: Experiment, simulated: Floats, trained: bool, first: int) -> list[dict[str, object]]:
    since = record.t[first:] - record.t[first]
    rows: list[dict[str, object]] = []
    for column, output in enumerate(record.output_names):
        y = record.y[:, column]
        late = y[first:]
        velocity = _slopes(y, record.dt)[first]
        rmse, mean = _rms(late - simulated[first:, column]), _rms(late - late.mean())
        rows.append(
            {
                "flight": record.name,
                "output": output,
                "unit": record.units.get(output, ""),
                "trained": trained,
                "duration": record.duration,
                "scored_from": first * record.dt,
                "rmse": rmse,
                "fit_percent": 100.0 * (1.0 - rmse / mean) if mean > 0.0 else float("nan"),
                "rmse_mean": mean,
                "rmse_constant_position": _rms(late - late[0]),
                "rmse_constant_velocity": _rms(late - late[0] - velocity * since),
                "rmse_reference": _rms(late - record.u[first:, column])
                if record.input_names == record.output_names
                else float("nan"),
            }
        )
    return rows


def _horizon_rows(
    record: Experiment, predicted: Floats, steps: int, trained: bool, first: int, every: int
) -> list[dict[str, object]]:
    if first + every > len(record.t):
        return []
    rows: list[dict[str, object]] = []
    # Samples that a restart leads to: restarts are at multiples of `every`.
    at = np.arange(first + (steps - first) % every, len(record.t), every)
    for column, output in enumerate(record.output_names):
        y = record.y[:, column]
        held = y[at - steps]
        moved = held + steps * record.dt * _slopes(y, record.dt)[at - steps]
        late = y[at]
        rows.append(
            {
                "flight": record.name,
                "output": output,
                "trained": trained,
                "horizon": round(steps * record.dt, 9),
                "rmse": _rms(late - predicted[at, column]),
                "rmse_constant_position": _rms(late - held),
                "rmse_constant_velocity": _rms(late - moved),
            }
        )
    return rows
