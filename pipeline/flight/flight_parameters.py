"""What one flight by itself says about its craft: every physical parameter with its error.

These rows are light; they are kept of every flight so that parameters can be followed over flights
(`pipeline.fleet.drift`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from pipeline.flight.kinds import THRUST_KEY
from pipeline.flight.rotation import curve_of
from pipeline.results.entry import FlightParameter, ResponseCurve
from pipeline.results.failure import Failure, present
from pipeline.results.rotation import FittedResponse
from sysid.records.thrust_curve import reference_voltage
from sysid.rigid_body.physical import HEADLINE, METHODS

if TYPE_CHECKING:
    from pipeline.results.flight import FlightResult

#: The row with a flight's battery voltage carries this method.
BATTERY = "battery monitor"

#: A method whose column "sigma" is the spread over instants, not the standard error of the value.
_SPREAD = METHODS[2]

#: Refinement 2020 takes the air to be at rest: its drag is mostly the wind of the day.
WIND_AS_DRAG = ("whole drag in still air over mass", METHODS[3])


def flight_parameters(result: FlightResult) -> list[FlightParameter]:
    """List what a flight says about its craft.

    Returns
    -------
    list of FlightParameter
        Standard errors are those on this flight: scatter between flights holds what another day adds. That of mean
        thrust is without that of the thrust curve in the parameters, which is the same in all flights.
    """
    rows: list[FlightParameter] = []
    found = result.parameters
    if not isinstance(found, Failure):
        for key, row in zip(found.table.index, found.table.to_dict("records"), strict=True):
            parameter, method = (str(part) for part in key)
            value, sigma = float(row["value"]), float(row["sigma"])
            # The headline is one of the methods' own.
            if method in (_SPREAD, HEADLINE) or (parameter, method) == WIND_AS_DRAG:
                continue
            if not (np.isfinite([value, sigma]).all() and sigma > 0.0):
                continue
            thrust = None if found.thrust is None else found.thrust.common
            if method == METHODS[0] and thrust is not None and thrust.per_mass and thrust.sigma is not None:
                # All flights of a craft have the error of the curve in its parameters in common.
                sigma = thrust.sigma * value / thrust.per_mass
            rows.append(
                FlightParameter(parameter=parameter, method=method, value=value, sigma=sigma, unit=str(row["unit"]))
            )
    rows += _turning(result)
    record = result.experiments.get(THRUST_KEY)
    if record is not None and (volts := reference_voltage([record])) is not None:
        rows.append(FlightParameter(parameter="voltage", method=BATTERY, value=volts, sigma=0.01 * volts, unit="V"))
    return rows


def _turning(result: FlightResult) -> Iterator[FlightParameter]:
    """Yield how strongly and how late each axis answers; not what changes with the gains."""
    for axis, rate in _determined(result):
        source = rate.source or "rate controller"
        known = rate.parameters
        late = known["effective_delay"]
        for name, each in (("effectiveness", known["gain"]), ("delay", late)):
            if each is not None and each.value is not None and each.sigma is not None and each.sigma > 0.0:
                yield FlightParameter(
                    parameter=f"{axis} {name}",
                    method=f"frequency response, {source}",
                    value=each.value,
                    sigma=each.sigma,
                    unit=each.unit,
                )


def response_curves(result: FlightResult) -> Iterator[ResponseCurve]:
    """Yield the coherent part of the response of every axis whose gain is determined."""
    for _, rate in _determined(result):
        yield curve_of(rate, result.name)


def _determined(result: FlightResult) -> Iterator[tuple[str, FittedResponse]]:
    """Yield every axis whose gain is determined, with its response."""
    rotation = present(result.rotation)
    for axis in () if rotation is None else rotation.every:
        if axis.rate is not None and axis.rate_determined:
            yield axis.axis, axis.rate
