"""A rigid body as files hold it: numbers and text, None for what is not finite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import msgspec

from logparse import Finding
from sysid.rigid_body.conditions.wind import FlightTrim


@dataclass(frozen=True, slots=True)
class BodyParameter:
    """One parameter and what is known of it."""

    name: str
    unit: str
    #: Estimate and standard error on the flights fitted (for coloured residuals); None when not determined.
    value: float | None
    sigma: float | None
    determined: bool
    reason: str  #: Why not, empty when determined.
    used: float  #: What the model computes with: the estimate, or what stands in for it when not determined.
    #: The same in SI for the mass given (N, N s/m, ...); None without a mass, or where mass does not enter.
    si_value: float | None = None
    si_sigma: float | None = None
    si_unit: str = ""
    #: What comes to `sigma` on another flight, and these do not show: temperature of the air, other laws of
    #: drag and climb.
    transfer: float = 0.0

    @classmethod
    def of(cls, name: str, unit: str, value: float, sigma: float, reason: str, transfer: float = 0.0) -> BodyParameter:
        """Name an estimate, determined unless there is a reason why not."""
        if reason:
            return cls(name, unit, None, None, False, reason, value)
        return cls(name, unit, value, sigma, True, "", value, transfer=transfer)

    def refused(self, reason: str) -> BodyParameter:
        """Return the parameter as one that is not determined."""
        return BodyParameter.of(self.name, self.unit, self.used, 0.0, reason)


class RigidBodyRecord(
    msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="rigid_body"
):
    """See `sysid.RigidBodyModel`; covariance and findings in models.json only."""

    name: str
    parameters: Mapping[str, BodyParameter]
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
    flights: Mapping[str, FlightTrim]
    rotation_fit: Mapping[str, float | None]
    rmse: float | None
    training: tuple[str, ...]
    findings: tuple[Finding, ...] = ()
