"""A rigid body and what differs between its flights, as files hold them: numbers and text, None if not finite.

How the wind grows with height is the weather of a day and belongs to the flight, not to the craft: by day over grass
the exponent is near 0.1, in the evening 0.4.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec

from core.lazy import lazy
from logparse import Finding

if TYPE_CHECKING:
    import numpy as np

    from sysid.records import Floats
else:
    np = lazy("numpy")  # pages read winds without it

#: Height to which winds refer, m.
WIND_HEIGHT = 10.0

#: Exponent of the power law: mean and spread over open and built-up country, by day and night (Counihan 1975;
#: 0.1 over water, 1/7 the classical value, 0.4 over towns and in stable air).
WIND_EXPONENT = (0.2, 0.15)

#: Turbulence intensity over open country: how far slow variations go, as a part of the mean.
TURBULENCE = 0.2

#: Mean wind below which variations are taken as in such a wind, m/s.
LIGHT = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightTrim:
    """What differs between flights of one craft: the wind, and how much its thrust departs from the model's."""

    #: Mean velocity of the air 10 m above the place of take-off, towards north and east, m/s.
    wind_n: float
    wind_e: float
    wind_sigma: float  #: Standard error of each, m/s.
    #: Thrust of this flight over the model's: temperature of the air, battery, mass taken on.
    thrust_scale: float
    thrust_scale_sigma: float
    #: Standard errors of exponent, thrust scale and wind for runs with this craft's parameters and this attitude: a
    #: thrust that leans feigns a wind, by which such runs do not drift.
    in_runs: tuple[float, float, float]
    source: str  #: From what: ``"fit"``, ``"whole flight"``, ``"first 30 s"``.
    #: Of the power law of the wind with height; what is known of any day where the flight does not tell.
    wind_exponent: float = WIND_EXPONENT[0]
    wind_exponent_sigma: float = WIND_EXPONENT[1]
    #: Time until which the flight's own motion was looked at, s; from there on a free run is free. None where all of it
    #: was, or none.
    looked_until: float | None = None
    #: tuple of (t, n, e): Departures from the mean wind [m/s] at times t [s], straight lines between them; empty for
    #: constant wind.
    variation: tuple[tuple[float, float, float], ...] = ()

    @property
    def own(self) -> Floats:
        """Parameters of the flight for the kernels, where the winds north and east are shapes of their own."""
        return np.array([self.wind_exponent, self.thrust_scale, 1.0, 0.0, 0.0, 1.0])

    def wind(self, t: Floats) -> Floats:
        """Wind at 10 m at times t [s], north and east; shape (N, 2)."""
        knots, *departures = np.array(self.variation).reshape(-1, 3).T
        return varying_wind(t, np.array([self.wind_n, self.wind_e]), knots, np.array(departures).T)


def varying_wind(t: Floats, mean: Floats, knots: Floats, departures: Floats) -> Floats:
    """Wind at times t [s] from its mean (2,) and its departures (k, 2) at the k knots; north and east, (N, 2)."""
    wind = np.tile(mean, (len(t), 1))
    if len(knots):
        for column, departure in zip(wind.T, departures.T, strict=True):
            column += np.interp(t, knots, departure)
    return wind


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
            return cls(name, unit, None, None, False, reason, value, transfer=transfer)
        return cls(name, unit, value, sigma, True, "", value, transfer=transfer)

    def refused(self, reason: str) -> BodyParameter:
        """Return the parameter as one that is not determined."""
        return BodyParameter.of(self.name, self.unit, self.used, 0.0, reason, self.transfer)


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
    contradicted: float = 0.0
