"""Models made of transfer functions as files hold them: numbers and text, None for what is not finite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import msgspec

from logparse import Finding

#: Root of a polynomial, real and imaginary part, rad/s.
Complex = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class FunctionRecord:
    """A transfer function, highest power of s first; standard deviations are None where infinite."""

    num: tuple[float, ...]
    den: tuple[float, ...]
    num_std: tuple[float | None, ...] | None
    den_std: tuple[float | None, ...] | None
    #: Whether the standard deviation is below half the value.
    num_determined: tuple[bool, ...] | None
    den_determined: tuple[bool, ...] | None
    #: `poles`, `zeros`: rad/s, slowest first.
    poles: tuple[Complex, ...]
    #: `poles_std`, `zeros_std`: Largest standard deviation in any direction, rad/s.
    poles_std: tuple[float | None, ...] | None = None
    zeros: tuple[Complex, ...]
    zeros_std: tuple[float | None, ...] | None = None
    gain: float | None  #: Value at s = 0; None where infinite.
    #: s.
    delay: float
    delay_std: float | None = 0.0
    #: Of ``(num, den without its leading 1)``; in models.json only.
    covariance: tuple[tuple[float | None, ...], ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DisturbanceRecord:
    """How what the model does not explain carries on, see `sysid.transfer_functions.disturbance.Disturbance`."""

    alpha: float
    beta: float
    memory_seconds: float | None = None
    fade_seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FitReport:
    """How the fit of one output went."""

    rmse: float  #: Of the training residual, in the output's unit.
    fit_percent: float  #: ``100 (1 - |residual| / |y - mean y|)`` on the training records.
    #: Of the search; the same seed on the same data gives the same model.
    iterations: int
    starts: int
    seed: int
    converged: bool  #: False when the time limit or the iteration limit ended the search.
    seconds: float
    #: Condition number of the scaled Gauss-Newton Hessian without regularisation (square root: of the regressors).
    condition: float
    ridge: float  #: Regularisation of the numerators relative to the mean energy of their regressors.
    parameters: int  #: Numerator and denominator coefficients.
    undetermined: int  #: Of these, how many have a standard deviation above half their value.


class FunctionsRecord(msgspec.Struct, frozen=True, kw_only=True):
    """What models made of transfer functions have in common."""

    name: str
    structure: str = ""
    poles: int
    zeros: int
    hold: str
    rate_hz: float
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: Mapping[str, str]
    training: tuple[str, ...]
    transfer_functions: Mapping[str, Mapping[str, FunctionRecord]]  #: By output and input.
    #: By output.
    disturbance: Mapping[str, DisturbanceRecord]
    fits: Mapping[str, FitReport]
    findings: tuple[Finding, ...] = ()  #: In models.json only.


class TransferFunctionsRecord(
    FunctionsRecord, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="transfer-functions"
):
    """See `sysid.TransferFunctionModel`."""

    initial_seconds: float
    initial_energy: Mapping[str, float]
    input_trim: Mapping[str, float] = {}


class ClosedLoopRecord(
    FunctionsRecord, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="closed-loop"
):
    """See `sysid.ClosedLoopModel`."""

    offset_trust: Mapping[str, float]
    following_rms: Mapping[str, float]
