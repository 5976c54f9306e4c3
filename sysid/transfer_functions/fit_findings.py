"""What is to be said of a fit of transfer functions: few samples, not settled, coefficients left open, idle inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import chdtrc as chi2_sf

from logparse import Finding, Severity
from sysid.records.experiment import Experiment, ExperimentError
from sysid.transfer_functions.model_record import FitReport
from sysid.transfer_functions.transfer_function import TransferFunction


def few_samples(records: Sequence[Experiment], parameters: int, order: int) -> list[Finding]:
    """Return a finding where samples are few for the coefficients of an output.

    ExperimentError when they cannot determine them, with the initial states of this order.
    """
    samples = sum(len(record.t) for record in records)
    needed = parameters + len(records) * (1 + order)
    if samples < needed:
        raise ExperimentError(
            f"{samples} samples for {parameters} coefficients per output and {len(records)} initial state(s): "
            "too few; give longer or more records, or fewer poles and zeros"
        )
    if samples < 20 * parameters:
        return [
            Finding(
                "not-determined",
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


def remarks(
    records: Sequence[Experiment],
    reports: Mapping[str, FitReport],
    functions: Mapping[str, Mapping[str, TransferFunction]],
) -> list[Finding]:
    """Return findings about the fit of each output."""
    findings = []
    longest = max(record.duration for record in records)
    for output, report in reports.items():
        if not report.converged:
            findings.append(
                Finding(
                    "fit-not-converged",
                    Severity.WARNING,
                    f"the fit of {output} stopped after {report.iterations} steps before it settled; "
                    "the model is the best found",
                    "use fewer poles and zeros (--poles, --zeros), or a shorter flight",
                    {"output": output, "steps": report.iterations},
                )
            )
        if report.undetermined:
            findings.append(
                Finding(
                    "not-determined",
                    Severity.WARNING,
                    f"{report.undetermined} of the {report.parameters} coefficients of {output} are not determined by "
                    f"the data (standard deviation above half the value; condition number {report.condition:.1e})",
                    f"do not read physics into them; {_more_data(records)}, or use fewer poles and zeros "
                    "(--poles, --zeros)",
                    {"output": output, "undetermined": report.undetermined, "parameters": report.parameters},
                )
            )
        slowest = _slowest(functions[output])
        if slowest * longest < 1.0:
            findings.append(
                Finding(
                    "not-determined",
                    Severity.INFO,
                    f"the slowest pole of {output} decays in {1.0 / slowest:.0f} s, longer than the longest record "
                    f"({longest:.0f} s): it acts as an integrator, and its long-run gain is an extrapolation",
                    "",
                    {"output": output, "time_constant": 1.0 / slowest, "longest_record": longest},
                )
            )
        if idle := _idle_inputs(output, report, functions[output]):
            findings.append(idle)
        if report.fit_percent == 0.0 and all(np.ptp(r.y[:, r.output_names.index(output)]) == 0.0 for r in records):
            findings.append(
                Finding("output-unexplained", Severity.WARNING, f"output {output} is constant: there is nothing to fit")
            )
    return findings


def _idle_inputs(output: str, report: FitReport, functions: Mapping[str, TransferFunction]) -> Finding | None:
    """Report when no input acts on the output by more than chance: what is explained is drift and initial state.

    Wald's test of each input's numerator against zero, with the covariance that is valid for coloured residuals.
    """
    chances = []
    for function in functions.values():
        n = len(function.num)
        if function.covariance is None or not function.num.any():
            continue
        covariance = function.covariance[:n, :n]
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        if not np.isfinite(covariance).all():
            chances.append(1.0)
        elif not sigma.all():
            return None
        else:
            apart = function.num / sigma
            wald = apart @ np.linalg.pinv(covariance / np.outer(sigma, sigma), rcond=1e-10, hermitian=True) @ apart
            chances.append(float(chi2_sf(n, wald)))
    if not chances or min(chances) * len(chances) < 0.001:
        return None
    return Finding(
        "output-unexplained",
        Severity.WARNING,
        f"no input is seen to act on {output}: the effect of each is no larger than chance gives. The fit of "
        f"{report.fit_percent:.0f} % on the training records comes from drift, the initial state and noise",
        "do not use this model; check that inputs and outputs belong to the same flight and time, and that the craft "
        "was moved by these inputs",
        {"output": output, "chance": min(chances), "fit_percent": report.fit_percent},
    )


def _slowest(functions: Mapping[str, TransferFunction]) -> float:
    """Decay rate of the slowest pole, rad/s."""
    stable = [f.poles[f.poles != 0.0] for f in functions.values() if len(f.den) > 1]
    return min((float(np.min(-poles.real)) for poles in stable if len(poles)), default=np.inf)
