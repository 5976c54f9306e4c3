"""A validation and a scan of orders as files hold them: numbers and text, None for what is not finite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sysid.rigid_body.model_record import RigidBodyRecord
from sysid.statistics.residual_test import ResidualTest
from sysid.transfer_functions.model_record import ClosedLoopRecord, TransferFunctionsRecord

#: A model with its coefficients.
ModelRecord = TransferFunctionsRecord | ClosedLoopRecord | RigidBodyRecord


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
    residuals: Mapping[str, ResidualTest]
    average: Mapping[str, float | None]
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
class ModelOrder:
    """Numbers of poles and zeros."""

    poles: int
    zeros: int


@dataclass(frozen=True, slots=True, kw_only=True)
class OrdersReport:
    """A scan of orders, the one recommended, and why."""

    table: tuple[OrderRow, ...]
    recommended: ModelOrder | None
    reason: str
    held_out: tuple[str, ...]
