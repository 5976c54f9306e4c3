"""Thrust against command as files hold it: numbers and text, None for what is not finite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from logparse import Finding


@dataclass(frozen=True, slots=True)
class ThrustCoefficient:
    """Thrust of one motor in sea-level air: at full command, or per square of the rotor's speed."""

    #: k/m and its standard error, m/s^2 (at full command) or N s^2/kg (`Law.SPEED`); None when not determined. The
    #: error includes that of the air's density (`AIR_SIGMA`), which flights at the same place and the motors of a
    #: flight have in common.
    per_mass: float | None
    sigma: float | None
    #: k in N or N s^2; None without a mass or when not determined.
    newton: float | None
    newton_sigma: float | None
    determined: bool
    reason: str = ""  #: Why not, empty when determined.


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
    common: ThrustCoefficient
    effort: Mapping[str, float | None]
    per_motor: Mapping[str, ThrustCoefficient]
    training: tuple[str, ...]
    findings: tuple[Finding, ...]
