"""What the inputs can tell at all: constant, saturated, identical and collinear inputs, too little data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from logparse import Finding, Severity
from sysid.experiment import Experiment, ExperimentError, Floats

#: Above this correlation two inputs are one for every practical purpose.
IDENTICAL = 0.9999

#: Condition number of the correlation matrix above which separate effects of the inputs are hardly determined.
COLLINEAR = 1e3

#: Part of the time that a motor may spend at its limit before it counts as saturated.
SATURATED = 0.05


@dataclass(frozen=True, slots=True)
class Excitation:
    """Verdict on the inputs of some records.

    Attributes
    ----------
    active : tuple of int
        Columns that vary in at least one record.
    scale : ndarray, shape (m,)
        Standard deviation about the records' trims, all records together.
    condition : float
        Condition number of the correlation matrix of the active inputs; infinite when two are identical.
    findings : tuple of Finding
    """

    active: tuple[int, ...]
    scale: Floats
    condition: float
    findings: tuple[Finding, ...]


def examine(experiments: Sequence[Experiment]) -> Excitation:
    """Examine the inputs of records of one kind.

    Raises
    ------
    ExperimentError
        When every input is constant.
    """
    names = experiments[0].input_names
    u = np.vstack([record.u - record.input_trim for record in experiments])
    raw = np.vstack([record.u for record in experiments])
    scale = np.sqrt(np.mean(u**2, axis=0))
    varying = scale > 1e-9 * np.maximum(np.max(np.abs(raw), axis=0), 1e-30)
    active = tuple(int(j) for j in np.flatnonzero(varying))
    if not active:
        raise ExperimentError(
            f"every input is constant ({', '.join(names)}): there is nothing to identify; "
            "was the craft flying, and were motor outputs logged?"
        )
    findings = [*_constant(names, raw, varying), *_saturated(experiments)]
    condition, more = _collinear([names[j] for j in active], u[:, active], len(experiments))
    return Excitation(active, scale, condition, (*findings, *more))


def _constant(names: Sequence[str], raw: Floats, varying: NDArray[np.bool_]) -> list[Finding]:
    return [
        Finding(
            "constant-input",
            Severity.WARNING,
            f"input {names[j]} stays at {raw[0, j]:.6g} throughout; its effect cannot be determined and is left out",
            "check that this motor output is connected, enabled and logged",
            {"input": names[j], "value": float(raw[0, j])},
        )
        for j in map(int, np.flatnonzero(~varying))
    ]


def _saturated(experiments: Sequence[Experiment]) -> list[Finding]:
    findings = []
    vehicle = experiments[0].vehicle
    if vehicle is None:
        return []
    for j, name in enumerate(experiments[0].input_names):
        values = np.concatenate([record.u[:, j] for record in experiments])
        top = float(np.mean(values >= vehicle.pwm_max - 1.0))
        bottom = float(np.mean(values <= vehicle.pwm_min + 1.0))
        if max(top, bottom) > SATURATED and np.ptp(values) > 0.0:
            limit, part = ("upper", top) if top >= bottom else ("lower", bottom)
            findings.append(
                Finding(
                    "saturated-input",
                    Severity.WARNING,
                    f"input {name} is at its {limit} limit for {100.0 * part:.0f} % of the time; "
                    "there the craft does not do what a linear model says",
                    "",
                    {"input": name, "limit": limit, "part": part},
                )
            )
    return findings


def _collinear(names: Sequence[str], u: Floats, records: int) -> tuple[float, list[Finding]]:
    if len(names) < 2:
        return 1.0, []
    correlation = np.atleast_2d(np.corrcoef(u.T))
    eigenvalues = np.linalg.eigvalsh(correlation)
    condition = float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > 1e-13 * eigenvalues[-1] else float("inf")
    twins = [
        (names[i], names[j])
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) > IDENTICAL
    ]
    findings = [
        Finding(
            "identical-inputs",
            Severity.WARNING,
            f"inputs {first} and {second} move as one; only the sum of their effects is determined, "
            "and regularisation divides it between them",
            "",
            {"first": first, "second": second},
        )
        for first, second in twins
    ]
    if condition > COLLINEAR and not twins:
        findings.append(
            Finding(
                "collinear-inputs",
                Severity.WARNING,
                f"the {len(names)} inputs move together (condition number of their correlations {condition:.2g}): "
                "the controller gives the motors fewer independent signals than there are motors, "
                "so effects of single motors are poorly determined",
                "fly with stick or SYSTEMID excitation on all axes"
                + ("" if records > 1 else ", or analyse several flights of the craft in one folder"),
                {"condition": condition},
            )
        )
    return condition, findings
