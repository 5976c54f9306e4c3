"""A validation and a scan of orders as files hold them: numbers and text, None for what is not finite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from core.lazy import lazy
from core.summary import Summarised, listed
from logparse import Finding
from sysid.rigid_body.model_record import RigidBodyRecord
from sysid.statistics.residual_test import ResidualTest
from sysid.transfer_functions.model_record import ClosedLoopRecord, TransferFunctionsRecord

if TYPE_CHECKING:
    import pandas as pd
else:
    pd = lazy("pandas")  # pages read a scan without it

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
    """What a `sysid.Validation` says beside the errors of a model, which have tables of their own."""

    residuals: Mapping[str, ResidualTest]
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


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class OrderScan(Summarised):
    """What each order achieves, and the one recommended; files hold None for what is not finite."""

    #: A row for each order and output. ``rmse`` is that of the part fitted, ``rmse_held_out`` the free run's on the
    #: part held back, averaged over its records, ``rmse_mean`` what always predicting the mean achieves there.
    rows: tuple[OrderRow, ...]
    recommended: tuple[int, int] | None  #: Poles and zeros; None when no order beats always predicting the mean.
    reason: str  #: Why, in a sentence.
    held_out: tuple[str, ...]  #: What was held back.
    findings: tuple[Finding, ...] = field(default=())

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {
            "recommended": "none" if self.recommended is None else "{} poles, {} zeros".format(*self.recommended),
            "why": self.reason,
            "held out": listed(self.held_out),
        }

    @property
    def table(self) -> pd.DataFrame:
        """The rows as a table."""
        return pd.DataFrame(self.rows)
