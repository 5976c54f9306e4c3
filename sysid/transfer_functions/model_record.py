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


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """How what the model does not explain carries on: a level and a slope driven by white noise.

    They are tracked by a steady Kalman filter (alpha-beta filter, Kalata 1984). With the model's response taken off,
    this is the innovation form of an output-error model whose process noise enters at the output: an integrated random
    walk, a random walk, white noise, or, with a finite memory, a first-order process that returns to the model.
    """

    #: Gains on level and on slope times step.
    alpha: float
    beta: float
    memory_seconds: float | None = None  #: Time constant with which it returns to the model; None: it wanders off.
    fade_seconds: float = 10.0  #: Time over which an extrapolated slope fades: long beside horizons, short in a flight.


@dataclass(frozen=True, slots=True, kw_only=True)
class FitReport:
    """How the fit of one output went."""

    rmse: float  #: Of the training residual, in the output's unit.
    fit_percent: float  #: ``100 (1 - |residual| / |y - mean y|)`` on the training records.
    #: Of the search; the same seed on the same data gives the same model.
    iterations: int = 0
    starts: int
    seed: int
    converged: bool = True  #: False when the time limit or the iteration limit ended the search.
    seconds: float = 0.0
    #: Condition number of the scaled Gauss-Newton Hessian without regularisation (square root: of the regressors).
    condition: float = 1.0
    ridge: float = 0.0  #: Regularisation of the numerators relative to the mean energy of their regressors.
    parameters: int = 0  #: Numerator and denominator coefficients.
    undetermined: int = 0  #: Of these, how many have a standard deviation above half their value.


#: How files call the fields of models.
_NAMES = {"rate": "rate_hz", "input_names": "inputs", "output_names": "outputs", "reports": "fits"}


class FunctionsRecord(msgspec.Struct, frozen=True, kw_only=True, rename=_NAMES):
    """What models made of transfer functions have in common; fields as those of the models."""

    name: str
    structure: str = ""
    poles: int
    zeros: int
    hold: str
    rate: float
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    units: Mapping[str, str]
    training: tuple[str, ...]
    transfer_functions: Mapping[str, Mapping[str, FunctionRecord]]  #: By output and input.
    #: By output.
    disturbance: Mapping[str, NoiseModel]
    reports: Mapping[str, FitReport]
    findings: tuple[Finding, ...] = ()  #: In models.json only.


class TransferFunctionsRecord(
    FunctionsRecord,
    frozen=True,
    kw_only=True,
    omit_defaults=True,
    rename=_NAMES,
    tag_field="kind",
    tag="transfer-functions",
):
    """See `sysid.TransferFunctionModel`."""

    initial_seconds: float
    initial_energy: Mapping[str, float]
    input_trim: Mapping[str, float] = {}


class ClosedLoopRecord(
    FunctionsRecord,
    frozen=True,
    kw_only=True,
    omit_defaults=True,
    rename=_NAMES | {"following": "following_rms"},
    tag_field="kind",
    tag="closed-loop",
):
    """See `sysid.ClosedLoopModel`."""

    offset_trust: Mapping[str, float]
    following: Mapping[str, float]
