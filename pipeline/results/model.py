"""What a report says of a model: its errors, its coefficients, and what it is good for, by purpose."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from logparse import Finding
from pipeline.results.coverage import Linearity
from sysid.rotors.thrust_record import ThrustModel
from sysid.validation.report import ModelRecord, OrderScan, ValidationReport
from sysid.validation.uses import Uses, Verdict, overall

#: Numbers by output; None for what could not be determined.
ByOutput = Mapping[str, float | None]


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


def average(rows: Sequence[Mapping[str, float | None]]) -> dict[str, float]:
    """Average errors over flights, output by output.

    NaN for an output of which a flight has no number.
    """
    outputs = list(rows[0]) if rows else []
    return {
        output: sum(math.nan if (value := row[output]) is None else value for row in rows) / len(rows)
        for output in outputs
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class HorizonRow:
    """Error of predictions so many seconds ahead on held-out records, and of guesses without a model, m."""

    output: str
    horizon_s: float
    rmse_m: float | None
    constant_position_m: float | None
    constant_velocity_m: float | None


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
class ModelReport:
    """One of several models of the same motion, and what it is worth."""

    #: Which kind of model, as `pipeline.flight.kinds.KINDS` has it.
    key: str
    title: str
    verdict: Verdict
    uses: Uses  #: What it is good for, by purpose, judged on records that it was not fitted to.
    rmse: tuple[RmseRow, ...]  #: Held-out records first.
    rmse_average_m: ByOutput  #: Over held-out records; empty where there are none.
    kind: str  #: Of its coefficients; empty without a model.
    missing: str  #: Why there is no model, or no validation of it.
    note: str  #: What the model describes, and what it cannot tell.
    horizons: tuple[HorizonRow, ...]
    validation: ValidationReport | None
    orders: OrderScan | None
    coherence: CoherenceReport | None  #: None for models that are not linear.
    model: ModelRecord | None
    findings: tuple[Finding, ...]

    @property
    def held_out(self) -> tuple[RmseRow, ...]:
        """Errors on flight time that it was not fitted to."""
        return tuple(row for row in self.rmse if row.part == "held-out")

    @property
    def short(self) -> str:
        """Its title without where it leads to."""
        return self.title.partition(" →")[0]

    def in_short(self) -> ModelReport:
        """Return what tables over all flights show."""
        return replace(
            self, horizons=(), validation=None, orders=None, coherence=None, model=None, findings=(), note=""
        )


def verdict_of(models: Iterable[ModelReport]) -> Verdict:
    """Sum the verdicts up over all models that there are."""
    return overall({model.title: model.uses for model in models if model.model is not None})


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRow:
    """A physical parameter by one method, in the units of the method and, where mass allows it, in SI."""

    parameter: str
    method: str
    value: float | None
    sigma: float | None  #: On these flights.
    unit: str
    si_value: float | None
    si_sigma: float | None
    si_unit: str
    note: str
    transfer: float | None = None  #: What another day adds to `sigma`: the temperature of its air.

    @property
    def best(self) -> tuple[float, float, str] | None:
        """Value, standard error and unit, in SI where mass allows it; None where they are not determined."""
        both = ((self.si_value, self.si_sigma, self.si_unit), (self.value, self.sigma, self.unit))
        return next(((value, sigma, unit) for value, sigma, unit in both if value is not None and sigma), None)


def headlines(rows: Iterable[ParameterRow] | None) -> dict[str, tuple[float, float, str]]:
    """Return each parameter that all methods together determine, with its error and unit, in SI where mass allows."""
    return {row.parameter: best for row in rows or () if row.method == "headline" and (best := row.best)}


def bare_unit(unit: str) -> str:
    """Leave the conditions out of a unit, which stand in the table of parameters."""
    return re.split(r",| at | \(", unit, maxsplit=1)[0].replace("^2", "²").replace(" ", "·")


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnedModels:
    """The fitted models of a craft or flight with every coefficient and its covariance, or why there are none."""

    name: str
    models: Mapping[str, ModelRecord]
    thrust: ThrustModel | None
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
