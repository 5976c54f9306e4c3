"""Thrust against command: numbers and text, which pages read without numpy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from core.quantity import uncertain
from core.summary import Summarised, listed
from logparse import Finding

_FULL = "at full command"


@dataclass(frozen=True, slots=True)
class ThrustCoefficient:
    """Thrust of one motor in sea-level air: at full command, or per square of the rotor's speed."""

    #: k/m and its standard error, m/s^2 (at full command) or N s^2/kg (`Law.SPEED`); None when not determined. The
    #: error is that on these flights, without that of the air's density (`ThrustModel.air_sigma`).
    per_mass: float | None
    sigma: float | None
    #: k in N or N s^2; None without a mass or when not determined.
    newton: float | None
    newton_sigma: float | None
    determined: bool
    reason: str = ""  #: Why not, empty when determined.


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ThrustModel(Summarised):
    """Thrust against command, as `fit_thrust` finds it and files hold it: there None for what is not finite."""

    kind: str = "thrust"
    name: str
    mass: float | None  #: As given, kg.
    thrust_expo: float  #: Curvature e of the thrust curve: the autopilot's, unless flights clearly show another.
    reference_density: float  #: kg/m^3.
    reference_voltage: float | None  #: V at which coefficients hold; None when voltage was not logged.
    #: Loss of thrust per mass with climbing speed along body z, 1/s; None when the flight hardly climbs.
    damping: float | None
    #: Mean command and PWM that carry the weight in the air of the records.
    hover_command: float | None
    hover_pwm: float | None
    rmse: float | None  #: Of one-second means of the specific force, m/s^2.
    seconds: float  #: Flight time used.
    #: Relative standard uncertainty of the air's density, common to all coefficients: on another day it adds to sigma.
    air_sigma: float
    units: Mapping[str, str] = field(default_factory=lambda: {"per_mass": f"m/s^2 {_FULL}", "newton": f"N {_FULL}"})
    #: One coefficient for all motors: vertical force shows only their sum. With roll and pitch rates beside it,
    #: `sysid.fit_kim2017` tells motors apart.
    common: ThrustCoefficient
    training: tuple[str, ...]
    findings: tuple[Finding, ...]

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        thrust = uncertain(self.common.per_mass, self.common.sigma, self.units["per_mass"])
        return {
            "name": self.name,
            "thrust over mass of one motor": thrust,
            "hover command": f"{self.hover_command:.3f} ({self.hover_pwm:.0f} us)",
            "training": listed(self.training),
            "findings": listed(dict.fromkeys(finding.id for finding in self.findings)) or "none",
        }
