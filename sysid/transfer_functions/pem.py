"""Transfer functions from sampled data by the prediction-error method (Elhesasy 2024, section 5).

The model is of output-error form: predictions come from the inputs and the initial state only, as in the paper. The
quadratic loss is minimised by Gauss-Newton steps ``R^-1 g`` with Levenberg-Marquardt damping
(`sysid.transfer_functions.separable`) from starts found without any guess (`sysid.transfer_functions.search`).
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import ThreadpoolController

from sysid.records.excitation import Excitation, examine
from sysid.records.experiment import Experiment, Floats, ModelOrderError, require_alike
from sysid.transfer_functions._kernels import compile_kernels
from sysid.transfer_functions.fit_findings import few_samples, remarks
from sysid.transfer_functions.model_record import FitReport, NoiseModel
from sysid.transfer_functions.problem import FitProblem, denominators, resolvable_band
from sysid.transfer_functions.response import INITIAL_SECONDS, fit_disturbance
from sysid.transfer_functions.search import Found, Plan, Progress, expected_energy, search
from sysid.transfer_functions.separable import reduced_information
from sysid.transfer_functions.transfer_function import (
    TransferFunction,
    TransferFunctionModel,
    run_freely,
)
from sysid.transfer_functions.uncertainty import parameter_covariance

__all__ = ["Progress", "fit_transfer_functions"]

Integers = NDArray[np.int64]


def fit_transfer_functions(
    experiments: Experiment | Sequence[Experiment],
    poles: ArrayLike = 5,
    zeros: ArrayLike = 3,
    structure: str = "per_input",
    *,
    integrators: ArrayLike = 0,
    delays: ArrayLike | None = 0.0,
    longest_delay: float = 1.0,
    hold: str = "zoh",
    ridge: float | None = None,
    starts: int = 2,
    seed: int = 0,
    time_limit: float = 60.0,
    progress: Progress | None = None,
) -> TransferFunctionModel:
    """Fit one transfer function from every input to every output, jointly over records.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        Each keeps its own offset and initial state.
    poles, zeros : int, or array_like of shape (m,) or (p, m)
        Of each transfer function, of every input, or of every output and input; 0 <= zeros < poles. Poles are stable
        by construction. Where poles is 0 the input has no effect on the output.
    structure : {"per_input", "common"}
        A denominator for each input, as in the paper, or one for all inputs of an output.
    integrators : int, or array_like of shape (p,)
        How many of the poles of every transfer function, or of those to each output, lie at zero exactly, such as 2
        from thrust to height. Each record then has a polynomial of time of its own beside its initial state, of this
        degree.
    delays : float, array_like of shape (m,) or (p, m), or None
        Of the inputs, s; parts of a sample are exact. None estimates one for each input and output.
    longest_delay : float
        Up to which delays are estimated, s.
    hold : {"zoh", "foh"}
        How the inputs ran between samples.
    ridge : float, optional
        Regularisation of the numerators relative to the information in the data; by default the one of
        `sysid.transfer_functions.uncertainty.RIDGES` that predicts held-out flight time best, or next to none
        where the data determine the parameters so well that it could win nothing.
    starts : int
        Sets of poles to start from where one cannot be found directly (`sysid.transfer_functions.starts`).
    seed : int
        Of the starts; the same seed gives the same model unless the time limit strikes.
    time_limit : float
        s, for the whole fit; the best model so far is returned, with a finding.
    progress : callable, optional
        ``progress(stage, fraction)``.

    Raises
    ------
    ExperimentError
        When the records differ in kind, no input moves, or there are fewer samples than parameters.
    ModelOrderError
        When no model can have these poles, zeros, integrators, delays or structure. (Also a ValueError.)
    """
    records = require_alike(experiments)
    shape = (len(records[0].output_names), len(records[0].input_names))
    at_zero = np.broadcast_to(np.asarray(integrators, dtype=np.int64), shape[:1])
    orders, counts = _channels(poles, zeros, at_zero, structure, shape)
    shortest = min(record.duration for record in records)
    known_delays = np.zeros(shape) if delays is None else _spread(delays, shape, "delays").astype(np.float64)
    if not np.all((known_delays >= 0.0) & (known_delays < shortest)):
        raise ModelOrderError("delays must be at least 0 and shorter than the records")
    if hold not in ("zoh", "foh"):
        raise ModelOrderError(f"hold must be 'zoh' or 'foh', not {hold!r}")
    if delays is None and not 0.0 < longest_delay < 0.5 * shortest:
        raise ModelOrderError("longest_delay must be above 0 and less than half of the shortest record")
    excitation = examine(records)
    report = progress or (lambda stage, fraction: None)
    compile_kernels()
    begun = time.monotonic()
    fits: dict[str, _OutputFit] = {}
    outputs = records[0].output_names
    findings = list(excitation.findings)
    tasks = []
    for column in range(len(outputs)):
        active = tuple(j for j in excitation.active if orders[column, j] > 0)
        task = _Task(
            column=column,
            active=active,
            orders=tuple(int(orders[column, j]) for j in active),
            counts=tuple(int(counts[column, j]) for j in active),
            delays=known_delays[column, list(active)],
            integrators=int(at_zero[column]),
            longest_delay=longest_delay if delays is None else 0.0,
            structure=structure,
            hold=hold,
            ridge=ridge,
            starts=starts,
            seed=seed,
        )
        findings += [
            finding
            for finding in few_samples(records, _parameters(task), max(task.orders, default=0))
            if finding not in findings
        ]
        tasks.append(task)
    # The matrices are small: with several threads BLAS waits ten times as long as it works.
    with _blas().limit(limits=1, user_api="blas"):
        for column, (output, task) in enumerate(zip(outputs, tasks, strict=True)):
            report(f"fitting {output}", column / len(outputs))

            def stage(words: str, fraction: float, output: str = output, column: int = column) -> None:
                report(f"fitting {output}: {words}", (column + fraction) / len(outputs))

            limit = begun + time_limit * (column + 1) / len(outputs)
            fits[output] = _fit_output(records, excitation, task, limit, stage)
    report("fitted", 1.0)
    reports = {output: fit.report for output, fit in fits.items()}
    functions = {output: fit.functions for output, fit in fits.items()}
    findings += remarks(records, reports, functions)
    return TransferFunctionModel(
        name=_name(outputs, orders, counts, structure, at_zero),
        transfer_functions=functions,
        input_names=records[0].input_names,
        output_names=outputs,
        units=records[0].units,
        structure=structure,
        poles=int(orders.max()),
        zeros=int(counts.max()) - 1,
        hold=hold,
        rate=records[0].rate,
        disturbance={output: fit.disturbance for output, fit in fits.items()},
        initial_energy={output: fit.initial_energy for output, fit in fits.items()},
        initial_states={
            record.name: {output: fit.initial_states[r] for output, fit in fits.items()}
            for r, record in enumerate(records)
        },
        reports=reports,
        training=tuple(record.name for record in records),
        input_trim={
            name: float(np.average([record.input_trim[j] for record in records], weights=[len(r.t) for r in records]))
            for j, name in enumerate(records[0].input_names)
        },
        findings=tuple(findings),
    )


@cache
def _blas() -> ThreadpoolController:
    """Find the libraries with threads once: searching all that is loaded takes longer than a small fit."""
    return ThreadpoolController()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Task:
    """What to fit to one output."""

    column: int  #: Of the output.
    active: tuple[int, ...]  #: Columns of the inputs that act on it.
    orders: tuple[int, ...]  #: Poles from each of them, and coefficients of the numerator.
    counts: tuple[int, ...]
    delays: Floats
    integrators: int
    longest_delay: float  #: Up to which delays are estimated, s; 0 where they are known.
    structure: str
    hold: str
    ridge: float | None
    starts: int
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _OutputFit:
    """The model of one output."""

    functions: Mapping[str, TransferFunction]
    disturbance: NoiseModel
    initial_energy: float
    initial_states: tuple[Floats, ...]
    report: FitReport


def _spread(values: ArrayLike, shape: tuple[int, int], name: str) -> NDArray[np.float64]:
    """Return what was given of each output and input, of shape (p, m)."""
    array = np.asarray(values)
    if array.ndim > 2 or (array.ndim > 0 and array.shape not in (shape, shape[1:])):
        raise ModelOrderError(
            f"{name} must be one number, one for each of the {shape[1]} inputs, or an array of "
            f"{shape[0]} outputs x {shape[1]} inputs, not of shape {array.shape}"
        )
    return np.broadcast_to(array, shape)


def _channels(
    poles: ArrayLike, zeros: ArrayLike, integrators: Integers, structure: str, shape: tuple[int, int]
) -> tuple[Integers, Integers]:
    """Return the poles and numerator coefficients of every output and input, checked."""
    orders = _spread(poles, shape, "poles").astype(np.int64)
    given = _spread(zeros, shape, "zeros").astype(np.int64)
    if np.ndim(poles) == 0 and np.any(orders < 1):
        raise ModelOrderError(f"poles must be at least 1, not {np.asarray(poles)}")
    if np.ndim(zeros) == 0 and np.ndim(poles) > 0:
        given = np.minimum(given, np.maximum(orders - 1, 0))
    wrong = (given < 0) | (orders < 0) | ((given >= orders) & (orders > 0))
    if wrong.any():
        i, j = np.argwhere(wrong)[0]
        raise ModelOrderError(
            f"zeros must be at least 0 and fewer than poles, not {given[i, j]} for {orders[i, j]} poles"
        )
    if np.any((orders > 0) & (orders < integrators[:, None])) or np.any(integrators < 0):
        raise ModelOrderError(f"integrators must be at least 0 and no more than poles, not {integrators.tolist()}")
    if structure not in ("per_input", "common"):
        raise ModelOrderError(f"structure must be 'per_input' or 'common', not {structure!r}")
    if structure == "common" and any(len(set(row[row > 0])) > 1 for row in orders):
        raise ModelOrderError("a common denominator has one number of poles for all inputs of an output")
    return orders, np.where(orders > 0, given + 1, 0)


def _name(outputs: Sequence[str], orders: Integers, counts: Integers, structure: str, integrators: Integers) -> str:
    """Name a model by its outputs and orders."""
    used = orders > 0
    poles = " or ".join(map(str, sorted(set(orders[used].tolist()))))
    zeros = " or ".join(map(str, sorted(set((counts[used] - 1).tolist()))))
    denominator = "own denominators" if structure == "per_input" else "a common denominator"
    at_zero = " or ".join(map(str, sorted(set(integrators.tolist()))))
    fixed = f" ({at_zero} at zero)" if integrators.any() else ""
    return f"inputs -> {', '.join(outputs)}, {poles} poles{fixed} {zeros} zeros, {denominator}"


def _fit_output(
    records: Sequence[Experiment],
    excitation: Excitation,
    task: _Task,
    deadline: float,
    stage: Progress,
) -> _OutputFit:
    begun = time.monotonic()
    column, active = task.column, list(task.active)
    y = [record.y[:, column] - record.output_trim[column] for record in records]
    spread = float(np.sqrt(np.mean(np.concatenate([values - values.mean() for values in y]) ** 2)))
    scale = spread if spread > 1e-12 else 1.0
    longest = max(record.duration for record in records)
    if not active:
        return _without_inputs(records, y, scale, longest, task)
    problem = FitProblem(
        inputs=tuple(
            np.ascontiguousarray((record.u - record.input_trim)[:, active] / excitation.scale[active])
            for record in records
        ),
        outputs=tuple(values / scale for values in y),
        group=(0,) * len(active),
        orders=(max(task.orders),),
        counts=task.counts,
        dt=records[0].dt,
        hold=task.hold,
        band=resolvable_band(longest, records[0].dt),
        ridge=1e-3 if task.ridge is None else task.ridge,
        initial=0.1**2 / expected_energy(longest, 1),  # a residual of a tenth, until the first fit
        integrators=task.integrators,
        delays=tuple(map(float, task.delays)) if task.delays.any() else (),
        longest_delay=task.longest_delay,
    )
    rng = np.random.default_rng([task.seed, column])
    plan = Plan(task.structure == "per_input", task.orders, task.ridge, task.starts, excitation.independent)
    solution = search(problem, plan, rng, deadline, stage)
    report = _report(solution, y, scale, task, time.monotonic() - begun)
    functions, undetermined = _transfer_functions(solution, excitation, active, scale, records[0].input_names)
    report = replace(report, undetermined=undetermined)
    # The energy of initial responses that the fit assumed; a free run assumes the same.
    initial_energy = max(report.rmse, 1e-9) ** 2 / solution.problem.initial
    shared = task.structure == "common"
    residuals = [
        (record.y[:, column] - run_freely(functions, record, column, task.hold, shared, report.rmse, initial_energy))[
            round(INITIAL_SECONDS / record.dt) :
        ]
        for record in records
    ]
    return _OutputFit(
        functions=functions,
        disturbance=fit_disturbance(residuals, records[0].dt),
        initial_energy=initial_energy,
        initial_states=tuple(scale * part.local for part in solution.descent.point.parts),
        report=report,
    )


def _without_inputs(
    records: Sequence[Experiment], y: Sequence[Floats], scale: float, longest: float, task: _Task
) -> _OutputFit:
    """Return the model of an output on which nothing acts: each record's mean."""
    residuals = [values - values.mean() for values in y]
    return _OutputFit(
        functions={name: TransferFunction(np.zeros(1), np.ones(1)) for name in records[0].input_names},
        disturbance=fit_disturbance(residuals, records[0].dt),
        initial_energy=expected_energy(longest, 1) * scale**2,
        initial_states=tuple(np.array([values.mean()]) for values in y),
        report=FitReport(
            rmse=float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))),
            fit_percent=0.0,
            starts=task.starts,
            seed=task.seed,
        ),
    )


def _report(solution: Found, y: Sequence[Floats], scale: float, task: _Task, seconds: float) -> FitReport:
    """Report how the fit of one output went."""
    problem, point = solution.problem, solution.descent.point
    information = reduced_information(problem, point)
    squares = scale**2 * sum(float(residual @ residual) for residual in point.residuals)
    variation = float(np.linalg.norm(np.concatenate([values - values.mean() for values in y])))
    estimated = np.flatnonzero(np.diag(information) > 0.0)
    information = information[np.ix_(estimated, estimated)]
    unit = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    eigenvalues = np.linalg.eigvalsh(information * unit * unit[:, None]) if len(unit) else np.ones(1)
    smallest = max(float(eigenvalues[0]), 1e-16 * float(eigenvalues[-1]))
    return FitReport(
        rmse=float(np.sqrt(squares / problem.samples)),
        fit_percent=100.0 * (1.0 - float(np.sqrt(squares)) / variation) if variation > 0.0 else 0.0,
        iterations=solution.steps,
        starts=task.starts,
        seed=task.seed,
        converged=solution.descent.converged,
        seconds=seconds,
        condition=float(eigenvalues[-1]) / smallest,
        ridge=problem.ridge,
        parameters=_parameters(task),
    )


def _parameters(task: _Task) -> int:
    """Count the coefficients that are estimated, delays included."""
    free = [order - task.integrators for order in task.orders]
    poles = sum(free) if task.structure == "per_input" else max(free, default=0)
    return sum(task.counts) + poles + (len(task.active) if task.longest_delay > 0.0 else 0)


def _transfer_functions(
    solution: Found, excitation: Excitation, active: Sequence[int], scale: float, names: Sequence[str]
) -> tuple[dict[str, TransferFunction], int]:
    """Return transfer functions in physical units, with covariance, and how many numbers are not determined."""
    problem, point = solution.problem, solution.descent.point
    nb, m, k, groups = problem.numerators, len(problem.group), problem.integrators, problem.groups
    covariance = parameter_covariance(problem, point)
    a, slope = denominators(point.theta, problem.lag_orders)
    functions = {name: TransferFunction(np.zeros(1), np.ones(1)) for name in names}
    undetermined = 0
    for lane, (j, g) in enumerate(zip(active, problem.group, strict=True)):
        n, lags, count = problem.orders[g], problem.lag_orders[g], problem.counts[lane]
        to_seconds = scale / excitation.scale[j] * point.system.unit[g] ** (n - np.arange(count))
        # Rows (num, den) highest power first; columns numerators (power-major), poles (parameter-major), delays.
        jacobian = np.zeros((count + n, len(covariance)))
        jacobian[count - 1 - np.arange(count), np.arange(count) * m + lane] = to_seconds
        jacobian[count : count + lags, nb * m + np.arange(lags) * groups + g] = slope[g, :lags, :lags][::-1]
        at = len(covariance) - m + lane
        function = TransferFunction(
            num=(point.numerators[:count, lane] * to_seconds)[::-1].copy(),
            den=np.concatenate([[1.0], a[g, :lags][::-1], np.zeros(k)]),
            covariance=jacobian @ covariance @ jacobian.T,
            delay=float(point.delays[lane]),
            delay_std=float(problem.dt * np.sqrt(covariance[at, at])) if problem.delay_parameters else 0.0,
        )
        functions[names[j]] = function
        determined = function.determined
        assert determined is not None
        undetermined += int(np.sum(~determined[:count]))
        if problem.group.index(g) == lane:  # a common denominator counts once
            undetermined += int(np.sum(~determined[count : count + lags]))
    return functions, undetermined
