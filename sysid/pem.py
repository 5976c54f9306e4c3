"""Transfer functions from sampled data by the prediction-error method (Elhesasy 2024, section 5).

The model is of output-error form: predictions come from the inputs and the initial state only, as in the paper. The
quadratic loss is minimised by Gauss-Newton steps ``R^-1 g`` with Levenberg-Marquardt damping; see `sysid.separable`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from logparse import Finding, Severity
from sysid.covariance import autocovariance, coloured_information
from sysid.disturbance import Disturbance, fit_disturbance
from sysid.excitation import Excitation, examine
from sysid.experiment import Experiment, ExperimentError, Floats, require_alike
from sysid.regularisation import Division, choose_ridge, divide
from sysid.response import INITIAL_SECONDS, free_run
from sysid.sections import Band, denominators, resolvable_band
from sysid.separable import Descent, Point, Problem, descend, reduced_information, sensitivities
from sysid.transfer_function import FitReport, TransferFunction, TransferFunctionModel

#: Called with a stage in words and the part done so far, 0 to 1.
Progress = Callable[[str, float], None]

#: Prior size of the response to the initial state, in standard deviations of the output: records begin near hover. Own
#: denominators have n initial states for every input; left free, they explain a record without its inputs.
INITIAL_SIZE = 0.2

#: Part of a record for which the response to the initial state is expected to last.
INITIAL_PART = 0.05

#: Residual assumed before the first fit, in standard deviations of the output.
FIRST_RESIDUAL = 0.1

#: Steps for comparing starts, and steps at most for the one that is followed to the end.
SCOUT_STEPS, MOST_STEPS = 10, 60

#: Lags of the residual's autocovariance, s.
COLOUR_SECONDS = 20.0


def fit_transfer_functions(
    experiments: Sequence[Experiment],
    poles: int = 5,
    zeros: int = 3,
    structure: str = "per_input",
    *,
    hold: str = "zoh",
    ridge: float | None = None,
    starts: int = 4,
    seed: int = 0,
    time_limit: float = 60.0,
    progress: Progress | None = None,
) -> TransferFunctionModel:
    """Fit one transfer function from every input to every output, jointly over records.

    Parameters
    ----------
    experiments : sequence of Experiment
        Each keeps its own offset and initial state.
    poles, zeros : int
        Of each transfer function; 0 <= zeros < poles. Poles are stable by construction.
    structure : {"per_input", "common"}
        A denominator for each input, as in the paper, or one for all inputs of an output.
    hold : {"zoh", "foh"}
        How the inputs ran between samples.
    ridge : float, optional
        Regularisation of the numerators relative to the information in the data; by default the one of
        `sysid.regularisation.RIDGES` that predicts held-out flight time best.
    starts : int
        Sets of poles to start from.
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
    """
    if not 0 <= zeros < poles:
        raise ValueError(f"zeros must be at least 0 and fewer than poles, not {zeros} for {poles} poles")
    if structure not in ("per_input", "common"):
        raise ValueError(f"structure must be 'per_input' or 'common', not {structure!r}")
    if hold not in ("zoh", "foh"):
        raise ValueError(f"hold must be 'zoh' or 'foh', not {hold!r}")
    records = require_alike(experiments)
    excitation = examine(records)
    findings = [*excitation.findings, *_enough(records, excitation, poles, zeros, structure)]
    report = progress or (lambda stage, fraction: None)
    begun = time.monotonic()
    fits: dict[str, _OutputFit] = {}
    outputs = records[0].output_names
    # The matrices are small: BLAS threads only wait for one another, ten times as long as the work takes.
    with threadpool_limits(limits=1, user_api="blas"):
        for column, output in enumerate(outputs):
            report(f"fitting {output}", column / len(outputs))
            fits[output] = _fit_output(
                records,
                column,
                excitation,
                _Settings(poles, zeros, structure, hold, ridge, starts, seed),
                begun + time_limit * (column + 1) / len(outputs),
            )
    report("fitted", 1.0)
    findings += _judge(records, {output: fit.report for output, fit in fits.items()}, fits)
    denominator = "own denominators" if structure == "per_input" else "a common denominator"
    return TransferFunctionModel(
        name=f"inputs -> {', '.join(outputs)}, {poles} poles {zeros} zeros, {denominator}",
        transfer_functions={output: fit.functions for output, fit in fits.items()},
        input_names=records[0].input_names,
        output_names=outputs,
        units=records[0].units,
        structure=structure,
        poles=poles,
        zeros=zeros,
        hold=hold,
        rate=records[0].rate,
        disturbance={output: fit.disturbance for output, fit in fits.items()},
        initial_energy={output: fit.initial_energy for output, fit in fits.items()},
        initial_states={
            record.name: {output: fit.initial_states[r] for output, fit in fits.items()}
            for r, record in enumerate(records)
        },
        reports={output: fit.report for output, fit in fits.items()},
        training=tuple(record.name for record in records),
        findings=tuple(findings),
    )


def expected_energy(duration: float, groups: int) -> float:
    """Energy expected of the initial response of each denominator, in variances of the output times s."""
    return INITIAL_SIZE**2 * INITIAL_PART * duration / groups


@dataclass(frozen=True, slots=True)
class _Settings:
    poles: int
    zeros: int
    structure: str
    hold: str
    ridge: float | None
    starts: int
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _OutputFit:
    functions: Mapping[str, TransferFunction]
    disturbance: Disturbance
    initial_energy: float
    initial_states: tuple[Floats, ...]
    report: FitReport
    slowest: float


def _fit_output(
    records: Sequence[Experiment], column: int, excitation: Excitation, settings: _Settings, deadline: float
) -> _OutputFit:
    begun = time.monotonic()
    active = list(excitation.active)
    y = [record.y[:, column] - record.output_trim[column] for record in records]
    spread = np.sqrt(np.mean(np.concatenate([values - values.mean() for values in y]) ** 2))
    scale = float(spread) if spread > 1e-12 else 1.0
    longest = max(record.duration for record in records)
    common = Problem(
        inputs=tuple((r.u - r.input_trim)[:, active] / excitation.scale[active] for r in records),
        outputs=tuple(values / scale for values in y),
        group=(0,) * len(active),
        order=settings.poles,
        numerators=settings.zeros + 1,
        dt=records[0].dt,
        hold=settings.hold,
        band=resolvable_band(longest, records[0].dt),
        ridge=1e-3 if settings.ridge is None else settings.ridge,
        initial=FIRST_RESIDUAL**2 / expected_energy(longest, 1),
    )
    rng = np.random.default_rng([settings.seed, column])
    problem, descent, steps = _search(common, settings, rng, deadline)
    report = _report(problem, descent, y, scale, settings, steps, time.monotonic() - begun)
    functions, undetermined = _transfer_functions(problem, descent.point, excitation, scale, records[0].input_names)
    report = replace(report, undetermined=undetermined)
    initial_energy = expected_energy(longest, problem.groups) * scale**2
    residuals = []
    for record, values in zip(records, y, strict=True):
        simulated = free_run(
            [functions[name].num for name in record.input_names],
            [functions[name].den for name in record.input_names],
            record.u - record.input_trim,
            values,
            0.0,
            record.dt,
            settings.hold,
            shared=settings.structure == "common",
            sigma=max(report.rmse, 1e-9),
            initial_energy=initial_energy,
        )
        residuals.append((values - simulated)[round(INITIAL_SECONDS / record.dt) :])
    return _OutputFit(
        functions=functions,
        disturbance=fit_disturbance(residuals, records[0].dt),
        initial_energy=initial_energy,
        initial_states=tuple(scale * local for local in descent.point.local),
        report=report,
        slowest=_slowest(functions),
    )


def _search(
    common: Problem, settings: _Settings, rng: np.random.Generator, deadline: float
) -> tuple[Problem, Descent, int]:
    """Find starts and regularisation without the flight time held back, then fit to all of it."""
    chosen = settings.ridge is not None
    division = Division(common, ()) if chosen else divide(common)
    seen = division.seen
    band = _starting_band(seen)
    scattered = [_staggered(1, seen.order, band, rng, k) for k in range(settings.starts)]
    best, steps = _best_start(seen, scattered, deadline)
    group = common.group
    if settings.structure == "per_input" and len(group) > 1:
        # Own denominators start from the common one, and from scattered ones.
        group = tuple(range(len(group)))
        tried = [np.repeat(best.point.theta, len(group), axis=0) + 0.1 * rng.standard_normal((len(group), seen.order))]
        tried += [_staggered(len(group), seen.order, band, rng, k) for k in range(settings.starts - 1)]
        first = seen.initial * len(group)
        best, more = _best_start(replace(seen, group=group, initial=first), tried, deadline)
        steps += more
    # The prior of the initial states is weighed by the residual reached.
    variance = max(float(np.mean(np.concatenate(best.point.residuals) ** 2)), 1e-12)
    longest = max(len(y) for y in common.outputs) * common.dt
    initial = variance / expected_energy(longest, len(set(group)))
    problem, theta = replace(common, group=group, initial=initial), best.point.theta
    if not chosen:
        ridge, theta = choose_ridge(
            replace(division, seen=replace(seen, group=group, initial=initial)), theta, deadline
        )
        problem = replace(problem, ridge=ridge)
    descent = descend(problem, theta, MOST_STEPS, deadline)
    return problem, descent, steps + descent.iterations


def _best_start(problem: Problem, thetas: Sequence[Floats], deadline: float) -> tuple[Descent, int]:
    steps, best = 0, None
    for theta in thetas:
        descent = descend(problem, theta, SCOUT_STEPS, deadline)
        steps += descent.iterations
        if best is None or descent.point.cost < best.point.cost:
            best = descent
        if time.monotonic() > deadline:
            break
    assert best is not None
    return best, steps


def _starting_band(problem: Problem) -> Band:
    """Where poles that matter are to be expected: a few periods in the record, a few samples in a period."""
    longest = max(len(y) for y in problem.outputs) * problem.dt
    return Band(2.0 * np.pi / longest, max(0.5 * np.pi / problem.dt, 4.0 * np.pi / longest))


def _staggered(groups: int, order: int, band: Band, rng: np.random.Generator, attempt: int) -> Floats:
    """Sections spread over the band; the first attempt evenly, later ones at random."""
    theta = np.empty((groups, order))
    low, high = np.log(band.lowest), np.log(band.highest)
    sections = (order + 1) // 2
    for g in range(groups):
        if attempt == 0:
            w = low + (high - low) * (np.arange(sections) + 0.5 + 0.5 * (g / groups - 0.5)) / sections
            zeta = np.full(sections, np.log(0.5))
        else:
            w, zeta = rng.uniform(low, high, sections), rng.uniform(np.log(0.05), np.log(1.5), sections)
        interleaved = np.column_stack([w, zeta]).ravel()
        # An odd order ends in a first-order section: the slowest frequency is its pole.
        theta[g] = np.concatenate([interleaved[2:], w[:1]]) if order % 2 else interleaved
    return theta


def _report(
    problem: Problem,
    descent: Descent,
    y: Sequence[Floats],
    scale: float,
    settings: _Settings,
    steps: int,
    seconds: float,
) -> FitReport:
    residual = np.concatenate(descent.point.residuals) * scale
    spread = np.concatenate([values - values.mean() for values in y])
    variation = float(np.linalg.norm(spread))
    information, _ = reduced_information(problem, descent.point, sensitivities(problem, descent.point))
    size = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    eigenvalues = np.linalg.eigvalsh(information * size * size[:, None])
    smallest = max(float(eigenvalues[0]), 1e-16 * float(eigenvalues[-1]))
    return FitReport(
        rmse=float(np.sqrt(np.mean(residual**2))),
        fit_percent=100.0 * (1.0 - float(np.linalg.norm(residual)) / variation) if variation > 0.0 else 0.0,
        iterations=steps,
        starts=settings.starts,
        seed=settings.seed,
        converged=descent.converged,
        seconds=seconds,
        condition=float(eigenvalues[-1]) / smallest,
        ridge=problem.ridge,
        parameters=len(problem.group) * problem.numerators + problem.groups * problem.order,
        undetermined=0,
    )


def _transfer_functions(
    problem: Problem, point: Point, excitation: Excitation, scale: float, names: Sequence[str]
) -> tuple[dict[str, TransferFunction], int]:
    """Turn the normalised solution into transfer functions in seconds and physical units, with covariance."""
    n, nb, m = problem.order, problem.numerators, len(problem.group)
    covariance = parameter_covariance(problem, point)
    a, slope = denominators(point.theta)
    functions = {name: TransferFunction(np.zeros(1), np.ones(1)) for name in names}
    undetermined = 0
    for lane, (j, g) in enumerate(zip(excitation.active, problem.group, strict=True)):
        to_seconds = scale / excitation.scale[j] * point.system.unit[g] ** (n - np.arange(nb))
        # Rows (num, den) highest power first; columns numerators (power-major) then poles.
        jacobian = np.zeros((nb + n, nb * m + problem.groups * n))
        jacobian[nb - 1 - np.arange(nb), np.arange(nb) * m + lane] = to_seconds
        jacobian[nb:, nb * m + g * n : nb * m + (g + 1) * n] = slope[g, ::-1]
        function = TransferFunction(
            num=(point.numerators[:, lane] * to_seconds)[::-1].copy(),
            den=np.concatenate([[1.0], a[g, ::-1]]),
            covariance=jacobian @ covariance @ jacobian.T,
        )
        functions[names[j]] = function
        determined = function.determined
        assert determined is not None
        undetermined += int(np.sum(~determined[:nb]))
        if problem.group.index(g) == lane:  # a common denominator counts once
            undetermined += int(np.sum(~determined[nb:]))
    return functions, undetermined


def parameter_covariance(problem: Problem, point: Point) -> Floats:
    """Covariance of normalised numerators and poles' parameters, for coloured residuals, at the solution.

    The sandwich ``H^-1 M H^-1`` with the information H in the data and M the covariance of the regressors' products
    with a residual of the colour found (Ljung 1999, section 9.5). Regularisation is no information: what it alone
    decides has a large covariance.

    Returns
    -------
    ndarray, shape (q, q)
        q = numerators * m + groups * n.
    """
    jacobians = sensitivities(problem, point)
    information, _ = reduced_information(problem, point, jacobians)
    shared = point.numerators.size
    reduced = []
    for z, jacobian in zip(point.regressors, jacobians, strict=True):
        locals_ = z.shape[1] - 1 - shared
        local, rest = z[:, :locals_], np.hstack([z[:, locals_:-1], jacobian])
        normal = local.T @ local
        normal[1:, 1:] += problem.initial * point.system.initial_precision()
        reduced.append(rest - local @ np.linalg.lstsq(normal, local.T @ rest, rcond=1e-13)[0])
    lags = max(round(COLOUR_SECONDS / problem.dt), 2)
    lags = min(lags, max(min(len(y) for y in problem.outputs) // 4, 2))
    freedom = max(problem.samples - information.shape[0], 1)
    colour = autocovariance(point.residuals, lags) * problem.samples / freedom
    size = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    # A trace of white prior keeps directions without information finite, and their covariance huge.
    trace = 1e-11 * np.eye(len(size))
    bread = information * size * size[:, None] + trace
    filling = coloured_information(reduced, colour) * size * size[:, None] + colour[0] * trace
    inverse = np.linalg.inv(bread)
    return np.asarray((inverse @ filling @ inverse) * size * size[:, None])


def _slowest(functions: Mapping[str, TransferFunction]) -> float:
    """Decay rate of the slowest pole, rad/s."""
    return min((float(np.min(-f.poles.real)) for f in functions.values() if len(f.den) > 1), default=np.inf)


def _enough(
    records: Sequence[Experiment], excitation: Excitation, poles: int, zeros: int, structure: str
) -> list[Finding]:
    m, samples = len(excitation.active), sum(len(record.t) for record in records)
    parameters = m * (zeros + 1) + poles * (m if structure == "per_input" else 1)
    needed = parameters + len(records) * (1 + poles)
    if samples < needed:
        raise ExperimentError(
            f"{samples} samples for {parameters} coefficients per output and {len(records)} initial state(s): "
            "too few; give longer or more records, or fewer poles and zeros"
        )
    if samples < 20 * parameters:
        return [
            Finding(
                "few-samples",
                Severity.WARNING,
                f"{samples} samples must determine {parameters} coefficients per output; "
                "expect the fit to describe these records and no others",
                f"{_more_data(records)}, or use fewer poles and zeros (--poles, --zeros)",
                {"samples": samples, "parameters": parameters},
            )
        ]
    return []


def _more_data(records: Sequence[Experiment]) -> str:
    """Advise how to have more data: one flight can be joined by others, several can only be longer or livelier."""
    return (
        "fly longer, with more excitation" if len(records) > 1 else "analyse several flights of the craft in one folder"
    )


def _judge(
    records: Sequence[Experiment], reports: Mapping[str, FitReport], fits: Mapping[str, _OutputFit]
) -> list[Finding]:
    findings = []
    longest = max(record.duration for record in records)
    for output, report in reports.items():
        if not report.converged:
            findings.append(
                Finding(
                    "fit-not-converged",
                    Severity.WARNING,
                    f"the fit of {output} stopped after {report.iterations} steps and {report.seconds:.1f} s "
                    "before it settled; the model is the best found",
                    "use fewer poles and zeros (--poles, --zeros), or a shorter flight",
                    {"output": output, "seconds": report.seconds},
                )
            )
        if report.undetermined:
            findings.append(
                Finding(
                    "undetermined-coefficients",
                    Severity.WARNING,
                    f"{report.undetermined} of the {report.parameters} coefficients of {output} are not determined by "
                    f"the data (standard deviation above half the value; condition number {report.condition:.1e})",
                    f"do not read physics into them; {_more_data(records)}, or use fewer poles and zeros "
                    "(--poles, --zeros)",
                    {"output": output, "undetermined": report.undetermined, "parameters": report.parameters},
                )
            )
        slowest = fits[output].slowest
        if slowest * longest < 1.0:
            findings.append(
                Finding(
                    "slow-poles",
                    Severity.INFO,
                    f"the slowest pole of {output} decays in {1.0 / slowest:.0f} s, longer than the longest record "
                    f"({longest:.0f} s): it acts as an integrator, and its long-run gain is an extrapolation",
                    "",
                    {"output": output, "time_constant": 1.0 / slowest, "longest_record": longest},
                )
            )
        if report.fit_percent == 0.0 and all(np.ptp(r.y[:, r.output_names.index(output)]) == 0.0 for r in records):
            findings.append(
                Finding("constant-output", Severity.WARNING, f"output {output} is constant: there is nothing to fit")
            )
    return findings
