"""Envelope of the training and held-out flights of a craft, and where held-out flights leave it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

from core.quantity import readable
from logparse import Finding, Severity
from pipeline.flight.training import position_good
from pipeline.results.coverage import (
    Cell,
    Coverage,
    Distribution,
    Envelope,
    EnvelopeMap,
    Excursion,
    FlightWind,
    RangeFlown,
)
from pipeline.results.fleet import FlightEntry

#: Part of the training time that the fitted range leaves out at either end: blips are not what a model was fitted to.
MARGIN = 0.005

#: A flight with what it covered.
Flown = tuple[FlightEntry, Coverage]


def envelope(entries: Sequence[FlightEntry], training: Iterable[str], held_out: Iterable[str]) -> Envelope | None:
    """Combine the coverage of a craft's flights; None if no flight has one."""
    by_name = {entry.name: (entry, entry.coverage) for entry in entries if entry.coverage is not None}
    parts = {
        "training": [by_name[name] for name in training if name in by_name],
        "held-out": [by_name[name] for name in held_out if name in by_name],
    }
    if not any(parts.values()):
        return None
    fitted, flown_held_out = parts["training"], parts["held-out"]
    names = list(dict.fromkeys(name for _, flown in (*fitted, *flown_held_out) for name in flown.quantities))
    quantities = {name: _range(name, fitted, flown_held_out) for name in names}
    outside = tuple(
        sorted(
            (
                excursion
                for entry, flown in flown_held_out
                # Speeds and heights beyond the range are more likely errors of a poor position, or of an unknown one.
                if position_good(entry)
                for name in names
                if (excursion := _excursion(entry.name, name, flown.quantities.get(name), quantities[name]))
            ),
            key=lambda excursion: (excursion.flight, -excursion.part),
        )
    )
    return Envelope(
        training=tuple(entry.name for entry, _ in fitted),
        held_out=tuple(entry.name for entry, _ in flown_held_out),
        quantities=quantities,
        map=EnvelopeMap(training=_summed(fitted), held_out=_summed(flown_held_out)),
        winds=tuple(
            FlightWind(
                flight=entry.name,
                part=part,
                speed=flown.wind.speed,
                direction=flown.wind.direction,
                sigma=flown.wind.sigma,
            )
            for part, flights in parts.items()
            for entry, flown in flights
            if flown.wind is not None
        ),
        outside=outside,
        findings=tuple(_findings(outside, quantities)),
    )


def _range(name: str, fitted: Sequence[Flown], held_out: Sequence[Flown]) -> RangeFlown:
    counts = _counts(name, (*fitted, *held_out))
    first, last = min(c.first for c in counts), max(c.first + len(c.seconds) for c in counts)

    def total(flights: Sequence[Flown]) -> list[float]:
        seconds = [0.0] * (last - first)
        for count in _counts(name, flights):
            for k, part in enumerate(count.seconds, start=count.first - first):
                seconds[k] += part
        return seconds

    training = total(fitted)
    step, whole = counts[0].step, sum(training)
    bounds = None
    if whole > 0.0:
        below, ends = 0.0, [first, last]
        for k, part in enumerate(training, start=first):
            if below <= MARGIN * whole:
                ends[0] = k
            if below < (1.0 - MARGIN) * whole:
                ends[1] = k + 1
            below += part
        bounds = ends[0] * step, ends[1] * step
    return RangeFlown(
        title=counts[0].title,
        unit=counts[0].unit,
        step=step,
        first=first,
        training=tuple(training),
        held_out=tuple(total(held_out)),
        fitted=bounds,
    )


def _counts(name: str, flights: Iterable[Flown]) -> list[Distribution]:
    return [flown.quantities[name] for _, flown in flights if name in flown.quantities]


def _excursion(flight: str, name: str, count: Distribution | None, flown: RangeFlown) -> Excursion | None:
    """Return how much of a flight lies more than a bin outside the fitted range; None where it is hardly any."""
    if count is None or flown.fitted is None:
        return None
    low, high = (round(bound / flown.step) for bound in flown.fitted)
    below = above = 0.0
    for k, seconds in enumerate(count.seconds, start=count.first):
        below += seconds if k < low - 1 else 0.0
        above += seconds if k > high else 0.0
    part = (below + above) / max(sum(count.seconds), 1e-9)
    # Part of a flight's time outside the fitted range, and one bin beyond, that is worth a finding.
    if part <= 0.05:
        return None
    # A blip beyond the rest of the flight is not what it did: the 95 % quantile, where that is outside already.
    if above >= below:
        reach = count.p95 if count.p95 > flown.fitted[1] else count.max
    else:
        reach = count.p05 if count.p05 < flown.fitted[0] else count.min
    return Excursion(flight=flight, quantity=name, part=part, reach=reach, fitted=flown.fitted)


def _summed(flights: Sequence[Flown]) -> tuple[Cell, ...]:
    cells: dict[tuple[int, int], float] = defaultdict(float)
    for _, flown in flights:
        for i, j, seconds in flown.map:
            cells[i, j] += seconds
    return tuple((i, j, seconds) for (i, j), seconds in sorted(cells.items()))


def _findings(outside: Sequence[Excursion], quantities: Mapping[str, RangeFlown]) -> Iterable[Finding]:
    flights: dict[str, list[Excursion]] = defaultdict(list)
    for excursion in outside:
        flights[excursion.flight].append(excursion)
    for flight, excursions in flights.items():
        ranges = []
        # Quantities that one finding lists.
        for excursion in excursions[:3]:
            flown = quantities[excursion.quantity]
            above = excursion.reach > excursion.fitted[1]
            ranges.append(
                f"{flown.title} {'up to' if above else 'down to'} {readable(flown.unit, excursion.reach)} "
                f"(fitted {'to' if above else 'from'} {readable(flown.unit, excursion.fitted[1 if above else 0])}) "
                f"for {100.0 * excursion.part:.0f} % of its time"
            )
        yield Finding(
            "outside-fitted-range",
            Severity.WARNING,
            f"{flight} leaves what the models were fitted to: {', '.join(ranges)}; its errors there are those of "
            "extrapolation",
            f"let {flight} train, or fly another flight over that range",
            {"flight": flight} | {f"part_{excursion.quantity}": excursion.part for excursion in excursions},
        )
