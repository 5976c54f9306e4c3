"""What the inputs can tell at all: constant, saturated, identical and collinear inputs, coherence with the outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtri as f_ppf

from logparse import Finding, Severity
from sysid.records.experiment import Experiment, ExperimentError, Floats
from sysid.records.filtering import detrended, hann
from sysid.records.motor_scaling import motor_pwm

#: Eigenvalues of the correlation matrix above this part of the largest count as independent signals.
INDEPENDENT = 1e-2

#: Probability with which unrelated signals stay below the coherence called significant.
CONFIDENCE = 0.99


@dataclass(frozen=True, slots=True)
class Excitation:
    """Verdict on the inputs of some records."""

    active: tuple[int, ...]  #: Columns that vary in at least one record.
    scale: Floats  #: shape (m,): Standard deviation about the records' trims, all records together.
    #: Condition number of the correlation matrix of the active inputs; infinite when two are identical.
    condition: float
    #: How many independent signals the active inputs are: eigenvalues of their correlation matrix above `INDEPENDENT`
    #: of the largest. A controller gives an octocopter's eight motors four at best, fewer where it hardly rolls.
    independent: int
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Coherence:
    """How much of each output is a linear answer to the inputs, by frequency."""

    frequency: Floats  #: shape (K,): rad/s.
    #: shape (K, p): Part of the output's power that all inputs together account for, 0 to 1 (Bendat and Piersol 2010,
    #: section 7.3).
    multiple: Floats
    #: Multiple coherence that unrelated signals stay below with probability `CONFIDENCE` at a frequency.
    threshold: float
    averages: float  #: Independent spectra that were averaged.
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    findings: tuple[Finding, ...]


def examine(experiments: Sequence[Experiment]) -> Excitation:
    """Examine the inputs of records of one kind."""
    names = experiments[0].input_names
    u = np.vstack([record.u - record.input_trim for record in experiments])
    raw = np.vstack([record.u for record in experiments])
    scale = np.sqrt(np.mean(u**2, axis=0))
    varying = scale > 1e-9 * np.maximum(np.max(np.abs(raw), axis=0), 1e-30)
    active = tuple(int(j) for j in np.flatnonzero(varying))
    if not active:
        raise ExperimentError(
            f"every input is constant ({', '.join(names)}): there is nothing to identify; "
            "fly with inputs that move, and check that they were logged"
        )
    findings = [*_constant(names, raw, varying), *_saturated(experiments)]
    condition, independent, more = _collinear([names[j] for j in active], u[:, active], len(experiments))
    return Excitation(active, scale, condition, independent, (*findings, *more))


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
    """Find motors at the idle or the full spin to which the mixer limits them (MOT_SPIN_MIN, MOT_SPIN_MAX)."""
    findings = []
    vehicle = experiments[0].vehicle
    if vehicle is None:
        return []
    idle, full = motor_pwm(0.0, vehicle), motor_pwm(1.0, vehicle)
    for j, name in enumerate(experiments[0].input_names):
        if experiments[0].units.get(name) != "us":
            continue
        values = np.concatenate([record.u[:, j] for record in experiments])
        top, bottom = float(np.mean(values >= full - 1.0)), float(np.mean(values <= idle + 1.0))
        if max(top, bottom) > 0.05 and np.ptp(values) > 0.0:
            limit, part = ("upper", top) if top >= bottom else ("lower", bottom)
            findings.append(
                Finding(
                    "motors-at-limits",
                    Severity.WARNING,
                    f"input {name} is at its {limit} limit for {100.0 * part:.0f} % of the time; "
                    "there the craft does not do what a linear model says",
                    "",
                    {"input": name, "limit": limit, "part": part},
                )
            )
    return findings


def _collinear(names: Sequence[str], u: Floats, records: int) -> tuple[float, int, list[Finding]]:
    if len(names) < 2:
        return 1.0, 1, []
    # About the trim and not about the mean: an input that rests beside its trim acts like any other.
    unit = u / np.linalg.norm(u, axis=0)
    correlation = unit.T @ unit
    eigenvalues = np.linalg.eigvalsh(correlation)
    condition = float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > 1e-13 * eigenvalues[-1] else float("inf")
    independent = int(np.sum(eigenvalues > INDEPENDENT * eigenvalues[-1]))
    twins = [
        (names[i], names[j])
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) > 0.9999
    ]
    findings = [
        Finding(
            "inputs-alike",
            Severity.WARNING,
            f"inputs {first} and {second} move as one; only the sum of their effects is determined, "
            "and regularisation divides it between them",
            "",
            {"first": first, "second": second},
        )
        for first, second in twins
    ]
    if condition > 1e3 and not twins:
        findings.append(
            Finding(
                "inputs-alike",
                Severity.WARNING,
                f"the {len(names)} inputs move together like {independent} independent signal"
                f"{'s' if independent > 1 else ''} (condition number of their correlations {condition:.2g}): "
                "the controller gives the motors fewer independent signals than there are motors, "
                "so effects of single motors are poorly determined",
                "fly with stick or SYSTEMID excitation on all axes"
                + ("" if records > 1 else ", or analyse several flights of the craft in one folder"),
                {"condition": condition, "independent": independent},
            )
        )
    return condition, independent, findings


def coherence(experiments: Sequence[Experiment]) -> Coherence:
    """Estimate the coherence of inputs and outputs over records of one kind (Welch's averages over all of them).

    Outputs are differentiated twice, which leaves their coherence as it is and keeps the power of slow motion, orders
    above the rest, from leaking over the spectrum.
    """
    excitation = examine(experiments)
    first = experiments[0]
    active = list(excitation.active)
    names = tuple(first.input_names[j] for j in active)
    total = sum(len(record.t) - 2 for record in experiments)
    length = min(round(20.0 / first.dt), 2 * total // (4 * len(active)))
    length = min(length, max(len(record.t) - 2 for record in experiments))
    spectra = [_segments(record, active, length) for record in experiments] if length >= 32 else []
    count = sum(len(part) for part in spectra)
    # Neighbours overlap by half of a Hann window and share a sixth of their variation (Welch 1967).
    averages = count / (1.0 + 2.0 / 36.0)
    if averages <= 1.5 * len(active):
        raise ExperimentError(
            f"{total * first.dt:.0f} s of {len(active)} inputs are too short to tell their coherence with the outputs"
        )
    x = np.concatenate(spectra)
    m = len(active)
    cross = np.einsum("ski,skj->kij", np.conj(x), x) / count
    s_uu, s_uy = cross[:, :m, :m], cross[:, :m, m:]
    power_u = np.real(np.einsum("kii->ki", s_uu))
    power_y = np.maximum(np.real(np.einsum("kii->ki", cross[:, m:, m:])), 1e-300)
    # Inputs on one scale; what identical ones share is counted once.
    size = 1.0 / np.sqrt(np.maximum(power_u, 1e-300))
    scaled_uy = s_uy * size[:, :, None]
    inverse = np.linalg.pinv(s_uu * size[:, :, None] * size[:, None, :], rcond=1e-9, hermitian=True)
    explained = np.real(np.einsum("kip,kij,kjp->kp", np.conj(scaled_uy), inverse, scaled_uy))
    multiple = np.clip(explained / power_y, 0.0, 1.0)
    quantile = float(f_ppf(2 * m, 2 * (averages - m), CONFIDENCE))
    threshold = m * quantile / (m * quantile + averages - m)
    frequency: Floats = np.arange(1.0, length // 2 + 1) * (2.0 * np.pi / (length * first.dt))
    return Coherence(
        frequency=frequency,
        multiple=multiple,
        threshold=threshold,
        averages=averages,
        input_names=names,
        output_names=first.output_names,
        findings=tuple(
            finding
            for column, output in enumerate(first.output_names)
            if (finding := _related(output, frequency, multiple[:, column], threshold)) is not None
        ),
    )


def _segments(record: Experiment, active: Sequence[int], length: int) -> NDArray[np.complex128]:
    """Spectra of overlapping segments, shape (segments, K, m + p), without the mean's."""
    u = (record.u - record.input_trim)[1:-1, list(active)]
    acceleration = np.diff(record.y, n=2, axis=0)
    signals = np.hstack([u, acceleration])
    starts = range(0, len(signals) - length + 1, max(length // 2, 1))
    if not len(starts):
        return np.empty((0, length // 2, signals.shape[1]), dtype=np.complex128)
    cut = np.stack([detrended(signals[at : at + length]) for at in starts])
    return np.asarray(np.fft.rfft(cut * hann(length)[:, None], axis=1)[:, 1:], dtype=np.complex128)


def _related(output: str, frequency: Floats, multiple: Floats, threshold: float) -> Finding | None:
    """Report at which frequencies an output answers to the inputs; nothing when it does over most of the spectrum."""
    significant = multiple > threshold
    # One in a hundred frequencies of unrelated signals is significant by chance.
    if np.mean(significant) <= 3.0 * (1.0 - CONFIDENCE):
        return Finding(
            "output-unexplained",
            Severity.WARNING,
            f"at no frequency does {output} answer to the inputs more than unrelated signals would "
            f"(multiple coherence at most {float(multiple.max()):.2f}, {threshold:.2f} is chance); "
            "a model of it describes noise",
            "use inputs that move the craft (sticks, SYSTEMID), or inputs logged faster, such as RATE outputs",
            {"output": output, "largest": float(multiple.max()), "threshold": threshold},
        )
    if np.mean(significant) > 0.5:
        return None
    band = frequency[significant]
    return Finding(
        "output-unexplained",
        Severity.INFO,
        f"{output} answers to the inputs at {100.0 * float(np.mean(significant)):.0f} % of the frequencies only, "
        f"between {band[0]:.2g} and {band[-1]:.2g} rad/s; elsewhere the data say nothing of its transfer functions",
        "",
        {"output": output, "lowest": float(band[0]), "highest": float(band[-1]), "part": float(np.mean(significant))},
    )
