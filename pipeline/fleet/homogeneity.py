"""Whether flights of one craft are alike enough to be fitted together, from what each says by itself.

Thrust over mass (at one voltage), inertias over mass and arm, and yaw torque over inertia of every flight, with their
standard errors and what air temperature, batteries and methods make them scatter by, must pass a chi-square test, and
none may be too far from the mean of the others. Where they do not, the largest set of flights that passes is kept, and
every other flight that is by itself too far from that set's mean is named: another payload, another battery, changed
propellers or motors, or another craft with the same parameters in its autopilot. Flights of one day and place share the
air, so that less shows among them. A motor that gives another thrust than in the other flights shows in what the
controller steadily asks for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtri as chi2_isf
from scipy.special import ndtri as normal_ppf

from core.units import EARTH_RADIUS
from logparse import Finding, Severity
from pipeline.flight.craft import took_off
from pipeline.flight.summary import BATTERY
from sysid.rotors.motor_faults.trims import changed_motor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pipeline.results.fleet import FlightEntry

    Floats = NDArray[np.float64]


#: What flights of one craft may differ by, as a standard deviation of the logarithm: 10 K of the air and a warm or cold
#: battery in thrust, the same and fuel or a camera's place in inertia, the same and yaw's poor excitation.
SCATTER: Mapping[str, float] = {
    "thrust over mass": 0.04,
    "roll inertia over mass and arm": 0.06,
    "pitch inertia over mass and arm": 0.06,
    "yaw torque over inertia": 0.08,
}

#: Fewest flights of one day, or with known trims, among which one can be odd.
_FEWEST = 3

#: Chance of a false alarm for one craft and quantity.
LEVEL = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Unlike:
    """A flight that is not like the others."""

    flight: str
    quantity: str
    ratio: float  #: Its value over the mean of those that are alike.
    sigmas: float  #: Departure in standard deviations.

    @property
    def reason(self) -> str:
        """Why it is not pooled, in words."""
        return (
            f"its {self.quantity} is {self.ratio:.2f} times that of the others, {self.sigmas:.1f} standard deviations "
            "off: another payload, battery, propellers or motors, or another craft"
        )


def unlike_flights(flights: Sequence[FlightEntry]) -> dict[str, Unlike]:
    """Find the flights that must not be pooled with the others, by name."""
    unlike: dict[str, Unlike] = {}
    for quantity, scatter in SCATTER.items():
        unlike |= _apart([flight for flight in flights if flight.name not in unlike], quantity, scatter)
    for of_a_day in _days([flight for flight in flights if flight.name not in unlike]):
        # The same of thrust on one day at one place, where 4 K of the air are left.
        unlike |= _apart(of_a_day, "thrust over mass", 0.015)
    return unlike | _of_other_motors([flight for flight in flights if flight.name not in unlike])


def _apart(flights: Sequence[FlightEntry], quantity: str, scatter: float) -> dict[str, Unlike]:
    """Find the flights whose value of a quantity is not like that of the largest set."""
    unlike: dict[str, Unlike] = {}
    names, values, sigmas = _values(flights, quantity)
    if len(names) < 2:
        return unlike
    spread = np.hypot(sigmas, scatter)
    limit = float(-normal_ppf(0.5 * LEVEL / len(names)))
    kept = _without_odd(_largest(values, spread), values, spread, limit)
    weights = spread[kept] ** -2.0
    mean = float(weights @ values[kept] / weights.sum())
    for k, name in enumerate(names):
        off = float(values[k] - mean) / float(np.hypot(spread[k], weights.sum() ** -0.5))
        if not kept[k] and abs(off) > limit:
            ratio = float(np.exp(values[k] - mean))
            unlike[name] = Unlike(flight=name, quantity=quantity, ratio=ratio, sigmas=abs(off))
    return unlike


def _without_odd(kept: NDArray[np.bool_], values: Floats, spread: Floats, limit: float) -> NDArray[np.bool_]:
    """Leave out, one by one, what is too far from the mean of the others: a sum over hundreds does not show it."""
    while kept.sum() >= _FEWEST:
        weights = np.where(kept, spread**-2.0, 0.0)
        others = weights.sum() - weights
        means = (weights @ values - weights * values) / others
        off = np.where(kept, np.abs(values - means) / np.hypot(spread, others**-0.5), 0.0)
        if off.max() <= limit:
            break
        kept[np.argmax(off)] = False
    return kept


def _days(flights: Sequence[FlightEntry]) -> list[list[FlightEntry]]:
    """Group the flights of one day and place, where they are enough to tell an odd one."""
    places = places_of(flights)
    groups: dict[tuple[str, int], list[FlightEntry]] = {}
    for flight in flights:
        groups.setdefault((day_of(flight), places[flight.name]), []).append(flight)
    return [group for (day, place), group in groups.items() if day and place >= 0 and len(group) >= _FEWEST]


def _of_other_motors(flights: Sequence[FlightEntry]) -> dict[str, Unlike]:
    """Find the flights in which one motor gives less, or more, than in most, by what controllers steadily ask for."""
    steady = {flight.name: flight.trims for flight in flights if flight.trims is not None}
    unlike: dict[str, Unlike] = {}
    if len(steady) < _FEWEST or len({trims.motors for trims in steady.values()}) > 1:
        return unlike
    values = np.array([trims.trims for trims in steady.values()])
    middle = list(steady.values())[int(np.argmin(np.sum((values - np.median(values, axis=0)) ** 2, axis=1)))]
    most = [name for name, trims in steady.items() if changed_motor(trims, [middle]) is None]
    # Each is held against the mean of the others, which a hundred of them tell as well as thousands.
    # Most flights of whose trims the mean is taken.
    mean_of = most[:: -(-len(most) // 100) or 1]
    for name, trims in steady.items():
        others = [steady[other] for other in mean_of if other != name]
        change = changed_motor(trims, others) if len(most) > len(steady) / 2 else None
        if change is not None:
            motor, loss, sigma = change
            # Motors that face each other and turn the other way trim alike.
            what = f"thrust of motor {motor} (or that of the one across, the other way round)"
            unlike[name] = Unlike(flight=name, quantity=what, ratio=1.0 - loss, sigmas=abs(loss) / sigma)
    return unlike


def alike_flights(flights: Sequence[FlightEntry]) -> list[tuple[FlightEntry, ...]]:
    """Divide the flights of one craft into those that may be pooled, the largest set first.

    Each set is found among what the ones before left over, as another payload is flown more than once.
    """
    sets, left = [], tuple(flights)
    while left:
        apart = unlike_flights(left)
        sets.append(tuple(flight for flight in left if flight.name not in apart))
        left = tuple(flight for flight in left if flight.name in apart)
    return sets


def unlike_findings(flights: Sequence[FlightEntry]) -> tuple[Finding, ...]:
    """Name the flights of a craft that are not like the others."""
    return tuple(
        Finding(
            "flights-not-alike",
            Severity.WARNING,
            f"{unlike.flight} is not fitted together with the other flights: {unlike.reason}",
            "weigh the craft and compare its battery, propellers and motors; name flights of one build with --training "
            "and --validation to fit them anyway",
            {"flight": unlike.flight, "quantity": unlike.quantity, "ratio": unlike.ratio, "sigmas": unlike.sigmas},
        )
        for unlike in unlike_flights(flights).values()
    )


def _values(flights: Sequence[FlightEntry], quantity: str) -> tuple[list[str], Floats, Floats]:
    """Return names, logarithms and relative errors of a quantity by the method that most flights have."""
    rows = [(flight, row) for flight in flights for row in flight.parameters if row.parameter == quantity]
    # Relative standard error beyond which a value says nothing.
    sure = [(flight, row) for flight, row in rows if row.value > 0.0 and row.sigma < 0.15 * row.value]
    counts: dict[str, int] = {}
    for _, row in sure:
        counts[row.method] = counts.get(row.method, 0) + 1
    method = max(counts, key=lambda name: counts[name], default="")
    chosen = [(flight, row) for flight, row in sure if row.method == method]
    volts = [_voltage(flight) for flight, _ in chosen]
    # Motors at full command give thrust with the square of the voltage, which is each flight's own.
    known = quantity == "thrust over mass" and all(volt is not None for volt in volts)
    values = [
        np.log(row.value) - (2.0 * np.log(volt) if known and volt else 0.0)
        for (_, row), volt in zip(chosen, volts, strict=True)
    ]
    errors = [row.sigma / row.value for _, row in chosen]
    return [flight.name for flight, _ in chosen], np.array(values), np.array(errors)


def _voltage(flight: FlightEntry) -> float | None:
    return next((row.value for row in flight.parameters if row.method == BATTERY), None)


def _largest(values: Floats, spread: Floats) -> NDArray[np.bool_]:
    """Return the largest set of neighbouring values that passes the chi-square test; the tightest of several."""
    order = np.argsort(values)
    # About their median, so that sums of squares lose no digits.
    weights, centred = spread[order] ** -2.0, values[order] - np.median(values)
    sums = [np.concatenate([[0.0], np.cumsum(weights * centred**power)]) for power in range(3)]
    kept = np.zeros(len(values), dtype=bool)
    for size in range(len(values), 1, -1):
        total, first, second = (values[size:] - values[:-size] for values in sums)
        q = second - first**2 / total
        tightest = int(np.argmin(q))
        if q[tightest] < float(chi2_isf(size - 1, LEVEL)):
            kept[order[tightest : tightest + size]] = True
            return kept
    kept[order[:1]] = True
    return kept


#: Flights that begin within this distance of each other are at one place, m.
ONE_PLACE = 2000.0


def day_of(flight: FlightEntry) -> str:
    """Day on which a flight took off, by the sun where it did; empty where the log does not tell."""
    start = took_off(flight)
    if start is None:
        return ""
    place = _place(flight)
    # An hour for 15 degrees of longitude; the political zone is not known, and need not be.
    local = start + timedelta(hours=0.0 if place is None else math.degrees(place[1]) / 15.0)
    return local.date().isoformat()


def places_of(flights: Sequence[FlightEntry]) -> dict[str, int]:
    """Assign numbers to the places of take-off, by flight's name; -1 where the log does not tell."""
    centres: list[tuple[float, float]] = []
    numbers: dict[str, int] = {}
    for flight in sorted(flights, key=lambda flight: (_place(flight) or (math.inf, math.inf), flight.name)):
        place = _place(flight)
        if place is None:
            numbers[flight.name] = -1
            continue
        near = [k for k, centre in enumerate(centres) if _distance(place, centre) < ONE_PLACE]
        if not near:
            centres.append(place)
        numbers[flight.name] = near[0] if near else len(centres) - 1
    return numbers


def _place(flight: FlightEntry) -> tuple[float, float] | None:
    """Latitude and longitude of the take-off, rad."""
    if flight.origin is None:
        return None
    lat, lon, _ = flight.origin
    north, east = flight.track[0][1:3] if flight.track else (0.0, 0.0)
    return lat + north / EARTH_RADIUS, lon + east / (EARTH_RADIUS * max(math.cos(lat), 1e-6))


def _distance(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Distance of two places on a sphere, m."""
    half = math.sin((a[0] - b[0]) / 2.0) ** 2 + math.cos(a[0]) * math.cos(b[0]) * math.sin((a[1] - b[1]) / 2.0) ** 2
    return 2.0 * EARTH_RADIUS * math.asin(min(1.0, math.sqrt(half)))
