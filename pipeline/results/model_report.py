"""What a report says of a model: its errors, what it may be trusted with, and its coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec

from logparse import Finding
from pipeline.results.coverage import Linearity
from pipeline.results.verdict import Uses, Verdict

#: Numbers by output; None for what could not be determined.
ByOutput = Mapping[str, float | None]

#: Root of a polynomial, real and imaginary part, rad/s.
Complex = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class RmseRow:
    """Errors of a free run on one record."""

    flight: str
    scope: str  #: ``"own"`` of a model of the flight itself, ``"joint"`` of one of several flights.
    model: str  #: Key of the kind of model.
    craft: str | None  #: Of a joint model.
    part: str  #: ``"training"`` or ``"held-out"``.
    #: Where the record lies on the log's boot clock.
    start_s: float | None
    duration_s: float | None
    #: Error of the free run by output, and ``100 (1 - |y - y_hat| / |y - mean y|)``.
    rmse_m: ByOutput
    fit_percent: ByOutput
    #: Errors of always predicting the record's own mean, and of standing still.
    rmse_mean_m: ByOutput
    rmse_constant_position_m: ByOutput
    scored_from_s: float | None  #: What lies before it gave the initial state.


@dataclass(frozen=True, slots=True, kw_only=True)
class HorizonRow:
    """Error of predictions so many seconds ahead on held-out records, and of guesses without a model, m."""

    output: str
    horizon_s: float
    rmse_m: float | None
    constant_position_m: float | None
    constant_velocity_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualReport:
    """Tests of the errors one sample ahead, see `sysid.statistics.residuals.ResidualTest`."""

    residual: str
    samples: int
    lags: int
    autocorrelation: tuple[float | None, ...]
    band: float | None
    whiteness: float | None
    whiteness_limit: float | None
    white: bool
    crosscorrelation: Mapping[str, tuple[float | None, ...]]
    crosscorrelation_band: float
    independence: Mapping[str, float | None]
    independence_limit: float | None
    dependent: tuple[str, ...]
    sentence: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftBand:
    """Half the width of the band that should hold the part `holds` of a free run's errors, and what it does hold."""

    flight: str
    output: str
    holds: float
    inside: float | None
    sample: tuple[int, ...]
    half_width: tuple[float | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationReport:
    """A model on records that it has seen and not seen, see `sysid.Validation`."""

    model: str
    table: tuple[Mapping[str, str | float | bool | None], ...]
    horizons: tuple[Mapping[str, str | float | bool | None], ...]
    residuals: Mapping[str, ResidualReport]
    average: ByOutput
    verdicts: tuple[str, ...]
    trusted: Mapping[str, bool]
    unseen: bool
    own_trim: bool
    drift: tuple[DriftBand, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderRow:
    """What a number of poles and zeros achieves in one output, see `sysid.OrderScan`."""

    poles: int
    zeros: int
    output: str
    parameters: int
    rmse: float | None
    aic: float | None
    bic: float | None
    rmse_held_out: float | None
    rmse_mean: float | None
    condition: float | None
    undetermined: int
    converged: bool
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """Numbers of poles and zeros."""

    poles: int
    zeros: int


@dataclass(frozen=True, slots=True, kw_only=True)
class OrdersReport:
    """A scan of orders, the one recommended, and why."""

    table: tuple[OrderRow, ...]
    recommended: Order | None
    reason: str
    held_out: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CoherenceReport:
    """How much of each output is a linear answer to the inputs, over a band of frequencies."""

    missing: str = ""  #: Why it is not known; then all else is empty.
    band_rad_s: tuple[float, float] | None = None
    inputs: tuple[str, ...] = ()
    averages: float | None = None  #: Independent spectra that were averaged.
    chance: float | None = None  #: Coherence that unrelated signals hardly exceed.
    outputs: Mapping[str, Linearity] = field(default_factory=dict)


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
class FitRecord:
    """How the fit of one output went, see `sysid.FitReport`."""

    rmse: float | None
    fit_percent: float | None
    iterations: int
    starts: int
    seed: int
    converged: bool
    seconds: float
    condition: float | None
    ridge: float | None
    parameters: int
    undetermined: int


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
    fits: Mapping[str, FitRecord]
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
    following_rms: ByOutput


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyParameterRecord:
    """See `sysid.BodyParameter`."""

    name: str
    unit: str
    value: float | None
    sigma: float | None
    determined: bool
    reason: str
    used: float
    si_value: float | None = None
    si_sigma: float | None = None
    si_unit: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrimRecord:
    """Wind and thrust scale of a flight, see `sysid.FlightTrim`."""

    wind_n: float
    wind_e: float
    wind_sigma: float | None
    thrust_scale: float
    thrust_scale_sigma: float | None
    source: str
    wind_exponent: float
    wind_exponent_sigma: float | None
    looked_until: float | None
    variation: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorEffectRecord:
    """A motor's share of thrust and torque, see `sysid.rigid_body.motor_effects.MotorEffect`."""

    thrust: float | None
    thrust_sigma: float | None
    torque: float | None
    torque_sigma: float | None
    reason: str = ""


class RigidBodyRecord(
    msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="rigid_body"
):
    """See `sysid.RigidBodyModel`; covariance and findings in models.json only."""

    name: str
    parameters: Mapping[str, BodyParameterRecord]
    estimated: tuple[str, ...]
    covariance: tuple[tuple[float | None, ...], ...] | None = None
    correlation: tuple[tuple[float | None, ...], ...]
    condition: float | None
    rotor_drag: bool
    axis_drag: bool
    mass: float | None
    reference_density: float
    reference_voltage: float | None
    wind_height: float
    flights: Mapping[str, TrimRecord]
    rotation_fit: Mapping[str, float | None]
    rmse: float | None
    motors: Mapping[str, MotorEffectRecord]
    training: tuple[str, ...]
    findings: tuple[Finding, ...] = ()


#: A model with its coefficients.
ModelRecord = TransferFunctionsRecord | ClosedLoopRecord | RigidBodyRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelInShort:
    """One of several models of the same motion, as tables over all flights need it."""

    #: Which kind of model, as `pipeline.flight.kinds.KINDS` has it.
    key: str
    title: str
    verdict: Verdict
    uses: Uses  #: What it is good for, by purpose, judged on records that it was not fitted to.
    rmse: tuple[RmseRow, ...]  #: Held-out records first.
    rmse_average_m: ByOutput  #: Over held-out records; empty where there are none.
    kind: str  #: Of its coefficients; empty without a model.
    missing: str  #: Why there is no model, or no validation of it.

    @property
    def held_out(self) -> tuple[RmseRow, ...]:
        """Errors on flight time that it was not fitted to."""
        return tuple(row for row in self.rmse if row.part == "held-out")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelReport(ModelInShort):
    """One of several models of the same motion, and what it is worth."""

    note: str  #: What the model describes, and what it cannot tell.
    horizons: tuple[HorizonRow, ...]
    validation: ValidationReport | None
    orders: OrdersReport | None
    coherence: CoherenceReport | None  #: None for models that are not linear.
    model: ModelRecord | None
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrustCoefficientReport:
    """See `sysid.ThrustCoefficient`."""

    per_mass: float | None
    sigma: float | None
    newton: float | None
    newton_sigma: float | None
    determined: bool
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrustReport:
    """See `sysid.ThrustModel`."""

    kind: str
    name: str
    mass: float | None
    thrust_expo: float
    reference_density: float
    reference_voltage: float | None
    damping: float | None
    hover_command: float | None
    hover_pwm: float | None
    rmse: float | None
    condition: float | None
    seconds: float
    air_sigma: float
    units: Mapping[str, str]
    common: ThrustCoefficientReport
    effort: Mapping[str, float | None]
    per_motor: Mapping[str, ThrustCoefficientReport]
    training: tuple[str, ...]
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRow:
    """A physical parameter by one method, in the units of the method and, where mass allows it, in SI."""

    parameter: str
    method: str
    value: float | None
    sigma: float | None
    unit: str
    si_value: float | None
    si_sigma: float | None
    si_unit: str
    note: str


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnedModels:
    """The fitted models of a craft or flight with every coefficient and its covariance, or why there are none."""

    name: str
    models: Mapping[str, ModelRecord]
    thrust: ThrustReport | None
    missing: Mapping[str, str]
    parameters: tuple[ParameterRow, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelsFile:
    """What models.json holds: models of crafts from several flights, and of single flights.

    Transfer functions have coefficients in descending powers of s (rad/s) from input (its unit) to output (m); numbers
    are SI and angles radians.
    """

    rotorid: str
    flights: tuple[OwnedModels, ...]
    joint: tuple[OwnedModels, ...] = ()
