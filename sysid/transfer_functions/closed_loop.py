"""From where the craft was told to be to where it was: models of the closed position loop.

A controller with integral action keeps its craft at a target that rests or moves steadily, so that in the long run the
response to the reference r is r, and everything worth fitting is the error on the way. The model is therefore ::

    y = r + H(s) r,    H(s) = s^2 B(s) / A(s)

with stable A. The closed loop's transfer function is ``G = 1 + H = (A + s^2 B) / A``: its gain is exactly one, and
regularisation shrinks it towards perfect following instead of towards nothing. H is fitted by the prediction-error
method (`sysid.transfer_functions.pem`) to the error ``y - r`` with the reference's acceleration as input.

The default order is that of the cause: drag d v, of which the feed-forward does not know, against position gain p and
velocity gains k and i (ArduPilot's AC_PosControl, attitude taken as immediate) gives
``H = -(d/m) s^2 / (s^3 + k s^2 + (k p + i) s + i p)``: three poles, and two zeros at s = 0.

The loop works in the earth frame with one set of gains, so north and east share one transfer function, which both
determine. A free run starts in step with its target, with no initial state to be found. Reference and position may lie
a constant apart where the autopilot's and our idea of the origin differ; of that a free run takes the part
``tau^2 / (tau^2 + sigma^2)`` of the mean error of its first three seconds, tau being the mean and sigma the wandering
of the errors that the model left of the training records: nothing where the error wanders and is not constant.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from logparse import Finding, Severity
from sysid.records.experiment import (
    Experiment,
    ExperimentError,
    Floats,
    ModelOrderError,
    require_alike,
    require_signals,
)
from sysid.transfer_functions.model_record import ClosedLoopRecord, FitReport
from sysid.transfer_functions.pem import fit_transfer_functions
from sysid.transfer_functions.response import INITIAL_SECONDS, discretise, fit_disturbance
from sysid.transfer_functions.search import Progress
from sysid.transfer_functions.transfer_function import FunctionsModel, TransferFunction, held_alike


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ClosedLoopModel(FunctionsModel):
    """Response of position (or velocity) to its reference, axis by axis.

    Inputs are references, outputs what follows them, by the same names; G is on the diagonal of `transfer_functions`,
    with covariance, and zero elsewhere; poles and zeros are those of H, two of whose zeros are at s = 0.
    """

    structure: str = "closed_loop"  #: ``"closed_loop"``.
    hold: str = "foh"  #: ``"foh"``: references run straight between samples.
    #: Per output the part of the first three seconds' mean error that is taken for constant.
    offset_trust: Mapping[str, float]
    #: Per output the root mean square of ``y - r`` on the training records: what the model is to improve on.
    following: Mapping[str, float]

    def simulate(self, experiment: Experiment) -> Floats:
        """Run freely from the references and the mean error of the first three seconds; shape (N, p)."""
        require_signals(experiment, self.input_names, self.output_names)
        result = np.empty_like(experiment.y)
        early = slice(0, _scored(experiment) + 1)
        for column, name in enumerate(self.output_names):
            answer = _respond(self.transfer_functions[name][name], experiment.u[:, column], experiment.dt)
            apart = float(np.mean((experiment.y[:, column] - answer)[early]))
            result[:, column] = answer + self.offset_trust[name] * apart
        return result

    def record(self) -> ClosedLoopRecord:
        """Return what files hold of the model."""
        functions = {name: {name: self.transfer_functions[name][name].record()} for name in self.output_names}
        held = held_alike(self, ClosedLoopRecord.__struct_fields__)
        return ClosedLoopRecord(**held | {"transfer_functions": functions})

    @classmethod
    def from_record(cls, record: ClosedLoopRecord) -> ClosedLoopModel:
        """Make the model again from its record, all but the findings."""
        own = {n: TransferFunction.from_record(record.transfer_functions[n][n]) for n in record.output_names}
        held = held_alike(record, [field.name for field in fields(cls)])
        return cls(**held | {"transfer_functions": _diagonal(own), "findings": ()})


def fit_closed_loop(
    experiments: Experiment | Sequence[Experiment],
    poles: int = 3,
    zeros: int = 2,
    *,
    time_limit: float = 60.0,
    progress: Progress | None = None,
) -> ClosedLoopModel:
    """Fit the closed loop from reference to motion, jointly over records.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        Of ``inputs="reference"``, or ``"velocity_reference"`` with velocities as outputs: inputs and outputs have the
        same names.
    poles, zeros : int
        Of H; 2 <= zeros < poles. Two of the zeros are at s = 0.
    time_limit, progress
        As for `fit_transfer_functions`.

    Raises
    ------
    ExperimentError
        When the inputs are not the references of the outputs, the records differ in kind, no reference moves, or there
        are fewer samples than parameters.
    """
    if not 2 <= zeros < poles:
        raise ModelOrderError(f"zeros must be at least 2 and fewer than poles, not {zeros} for {poles} poles")
    records = require_alike(experiments)
    first = records[0]
    if first.input_names != first.output_names:
        raise ExperimentError(
            f"{first.name}: a closed loop leads from references to what follows them, by the same names; not from "
            f"{', '.join(first.input_names)} to {', '.join(first.output_names)} (use inputs='reference')"
        )
    groups: dict[str, list[int]] = {}
    shared = {"x": "horizontal", "y": "horizontal", "z": "vertical"}  # by the last letter of the outputs
    for column, name in enumerate(first.output_names):
        groups.setdefault(shared.get(name.rpartition("_")[2], name), []).append(column)
    report = progress or (lambda stage, fraction: None)
    begun = time.monotonic()
    functions: dict[str, TransferFunction] = {}
    reports: dict[str, FitReport] = {}
    findings: list[Finding] = []
    for done, (group, columns) in enumerate(groups.items()):
        report(f"fitting the {group} loop", done / len(groups))
        left = time_limit - (time.monotonic() - begun)
        fitted = fit_transfer_functions(
            [_error_record(record, column, group) for record in records for column in columns],
            poles,
            zeros - 2,
            "common",
            hold="foh",
            time_limit=max(left / (len(groups) - done), 1.0),
        )
        findings += [finding for finding in fitted.findings if finding not in findings]
        closed = complementary(fitted.transfer_functions["error"][group])
        for column in columns:
            functions[first.output_names[column]] = closed
            reports[first.output_names[column]] = fitted.reports["error"]
    report("fitted", 1.0)
    return _model(records, functions, reports, findings, poles, zeros)


def _model(
    records: Sequence[Experiment],
    functions: Mapping[str, TransferFunction],
    reports: Mapping[str, FitReport],
    findings: Sequence[Finding],
    poles: int,
    zeros: int,
) -> ClosedLoopModel:
    names = records[0].output_names
    errors = {
        name: [record.y[:, column] - _respond(functions[name], record.u[:, column], record.dt) for record in records]
        for column, name in enumerate(names)
    }
    first = [_scored(record) for record in records]
    residuals = {name: [part[k:] for part, k in zip(parts, first, strict=True)] for name, parts in errors.items()}
    following, remaining, trust = {}, {}, {}
    for column, name in enumerate(names):
        following[name] = _rms([(record.y - record.u)[k:, column] for record, k in zip(records, first, strict=True)])
        # Outputs that share a loop share what is known of its errors.
        alike = [part for other in names if functions[other] is functions[name] for part in residuals[other]]
        apart = float(np.mean([np.mean(part) ** 2 for part in alike]))
        trust[name] = apart / max(apart + float(np.mean([np.var(part) for part in alike])), 1e-300)
        remaining[name] = _rms(
            [part[k:] - trust[name] * np.mean(part[: k + 1]) for part, k in zip(errors[name], first, strict=True)]
        )
    unit = records[0].units.get(names[0], "")
    summary = Finding(
        "closed-loop-following",
        Severity.INFO,
        "without any model, the craft is where it was told to be within "
        + ", ".join(f"{following[name]:.2g} {unit} in {name}" for name in names)
        + " (root mean square on the training records); the model leaves "
        + ", ".join(f"{remaining[name]:.2g} {unit}" for name in names),
        "",
        {f"following_{name}": following[name] for name in names} | {f"left_{name}": remaining[name] for name in names},
    )
    return ClosedLoopModel(
        name=f"reference -> {', '.join(names)}, closed loop, {poles} poles {zeros} zeros",
        transfer_functions=_diagonal(functions),
        input_names=names,
        output_names=names,
        units=records[0].units,
        poles=poles,
        zeros=zeros,
        rate=records[0].rate,
        disturbance={name: fit_disturbance(residuals[name], records[0].dt) for name in names},
        reports=reports,
        offset_trust=trust,
        following=following,
        training=tuple(record.name for record in records),
        findings=(*findings, summary),
    )


def _diagonal(functions: Mapping[str, TransferFunction]) -> dict[str, dict[str, TransferFunction]]:
    """Return a function from every input to every output: those to others than its own are nothing."""
    nothing = TransferFunction(np.zeros(1), np.ones(1))
    return {
        output: {name: function if name == output else nothing for name in functions}
        for output, function in functions.items()
    }


def _error_record(record: Experiment, column: int, group: str) -> Experiment:
    """Make a record of one axis: acceleration of the reference as input, error as output, both about zero."""
    reference = record.u[:, column]
    return Experiment.from_arrays(
        record.t,
        np.gradient(np.gradient(reference, record.dt), record.dt),
        record.y[:, column] - reference,
        name=f"{record.name}, {record.output_names[column]}",
        input_names=(group,),
        output_names=("error",),
        units={"error": record.units.get(record.output_names[column], "")},
        input_trim=np.zeros(1),
        output_trim=np.zeros(1),
    )


def complementary(error: TransferFunction) -> TransferFunction:
    """Turn B / A, from the reference's acceleration to the error, into ``G = 1 + s^2 B / A`` with its covariance."""
    n, nb = len(error.den) - 1, len(error.num)
    rows = slice(n - 1 - nb, n - 1)  # of s^2 B among the powers n .. 0
    num = error.den.copy()
    num[rows] += error.num
    covariance = None
    if error.covariance is not None:
        # Rows (num of G, den); columns (B, A), highest power first. The leading coefficient of G is 1.
        jacobian = np.zeros((2 * n + 1, nb + n))
        jacobian[rows, :nb] = np.eye(nb)
        jacobian[1 : n + 1, nb:] += np.eye(n)
        jacobian[n + 1 :, nb:] = np.eye(n)
        covariance = jacobian @ error.covariance @ jacobian.T
    return TransferFunction(num=num, den=error.den.copy(), covariance=covariance)


def _respond(function: TransferFunction, reference: Floats, dt: float) -> Floats:
    """Answer of a closed loop that has rested at its first reference, or moved with it at its first speed."""
    # In the long run G - 1 does not answer to a steady motion, so a start in step with the target is one at rest with
    # the first speed taken off.
    steady = reference[0] + (reference[1] - reference[0]) / dt * np.arange(len(reference)) * dt
    system = discretise(function.den[:0:-1][None], dt, "foh")
    states = system.forced((reference - steady)[:, None], [0])[:, :, 0]
    n = len(function.den) - 1
    error = (function.num - function.den)[:0:-1] / system.unit[0] ** (n - np.arange(n))
    return np.asarray(reference + states @ error)


def _scored(record: Experiment) -> int:
    return min(round(INITIAL_SECONDS / record.dt), len(record.t) - 2)


def _rms(parts: Sequence[Floats]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
