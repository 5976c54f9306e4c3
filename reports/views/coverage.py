"""What pages say of what was flown: the range of each quantity fitted and judged, and where judging went beyond."""

from __future__ import annotations

import math
from collections.abc import Sequence

from core.quantity import alike, number, per_degree
from core.table import Row, Table
from pipeline.results.coverage import Coverage, Envelope, RangeFlown


def coverage_table(coverage: Envelope | None) -> Table | None:
    """Tabulate the range of each quantity in flights fitted to and in those that judge."""
    if coverage is None or not coverage.quantities:
        return None
    rows = []
    for each in coverage.quantities.values():
        degrees, unit = per_degree(each.unit)
        fitted = None if each.fitted is None else [edge * degrees for edge in each.fitted]
        ranges = [fitted, *(_reach(each, seconds, degrees) for seconds in (each.training, each.held_out))]
        edges = iter(alike([edge for known in ranges if known is not None for edge in known]))
        cells = ["–" if known is None else f"{next(edges)} to {next(edges)}" for known in ranges]
        rows.append(Row(f"{each.title[:1].upper()}{each.title[1:]}, {unit}", cells))
    return Table(
        label="Quantity",
        heads=["fitted, usual", "fitted, all", "judged, all"],
        rows=rows,
        caption="What was flown: the range that the models may be trusted in, and all values met with.",
    )


def _reach(quantity: RangeFlown, counted: Sequence[float], factor: float) -> list[float] | None:
    """Return the edges of the bins that hold any time."""
    filled = [place for place, seconds in enumerate(counted) if seconds]
    if not filled:
        return None
    step = quantity.step * factor
    return [(quantity.first + filled[0]) * step, (quantity.first + filled[-1] + 1) * step]


def outside(coverage: Envelope | None) -> list[str]:
    """Name the flights that judge models on flying that they were not fitted to, the farthest first."""
    if coverage is None:
        return []
    sentences = []
    found = sorted(coverage.outside, key=lambda each: -each.part)
    # Flights outside of what was fitted that are named one by one.
    for each in found[:12]:
        quantity = coverage.quantities[each.quantity]
        degrees, unit = per_degree(quantity.unit)
        low, high, reach = alike([edge * degrees for edge in (*each.fitted, each.reach)])
        sentences.append(
            f"{each.flight}: {100.0 * each.part:.0f} % of its time at {quantity.title} outside of the "
            f"{low} to {high} {unit} fitted, as far as {reach} {unit}"
        )
    more = len(found) - len(sentences)
    return [*sentences, f"and {more} more"] if more > 0 else sentences


def flight_coverage(coverage: Coverage | None) -> Table | None:
    """Tabulate what one flight covered: usual range, median and extremes of each quantity."""
    if coverage is None or not coverage.quantities:
        return None
    rows = []
    for each in coverage.quantities.values():
        degrees, unit = per_degree(each.unit)
        cells = alike([edge * degrees for edge in (each.min, each.p05, each.median, each.p95, each.max)])
        rows.append(Row(f"{each.title[:1].upper()}{each.title[1:]}, {unit}", cells))
    return Table("Quantity", ["least", "5 %", "median", "95 %", "most"], rows)


def excitation(coverage: Coverage | None) -> list[str]:
    """Report how much a flight moved in each axis, and the wind."""
    if coverage is None:
        return []
    found = coverage.excitation
    words: dict[str, list[str]] = {}
    for axis, each in found.axes.items():
        words.setdefault(each.word, []).append(axis)
    moved = "; ".join(f"{', '.join(axes)}: {word}" for word, axes in words.items())
    sentences = [f"Excitation: {moved}. The nose pointed in {found.headings} of 8 sectors of heading."]
    wind = coverage.wind
    if wind is not None:
        came = math.degrees(wind.direction)
        sentences.append(f"Mean wind {number(wind.speed, 2)} m/s from {came:.0f}°, as the rigid body has it.")
    return sentences
