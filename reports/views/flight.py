"""What pages show of a flight beside its models: what happened, what was flown, and the fine print of log and craft."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import fields

from core.findings import Happening
from core.quantity import alike, duration, number, per_degree, size
from core.table import Cell, Row, Table
from logparse import Vehicle
from pipeline.config import AnalysisConfig
from pipeline.results.account import Account
from pipeline.results.coverage import Coverage, Envelope, RangeFlown
from pipeline.results.flight import LogFacts
from pipeline.results.report import FlightReport, OriginReport, TrajectoryReport
from reports.views import log_words


def happened(account: Account | None) -> Table | None:
    """Tabulate what happened, with advice."""
    return None if account is None or not account.notable else _table(account, account.notable)


def reported(account: Account | None) -> Table | None:
    """Tabulate what the autopilot only reported."""
    quiet = [] if account is None else [happening for happening in account.happenings if not happening.notable]
    # Most rows of what was only reported.
    return None if account is None or not quiet else _table(account, quiet[:40])


def _table(account: Account, happenings: Iterable[Happening]) -> Table:
    heads = ["log (s)", "for", "what", "evidence and what to do"]
    rows = [_row(account, happening) for happening in happenings]
    return Table("in flight", heads, rows, texts=(2, 3), style="events")


def _row(account: Account, happening: Happening) -> Row:
    t, end, flight, severity = happening.t, happening.end, account.flight, happening.severity
    return Row(
        "" if flight is None or t < flight.start else duration(t - flight.start),
        [
            f"{t:.1f}",
            f"{number(end - t, 2)} s" if end - t > 0.05 else "",
            Cell(happening.id.replace("-", " "), severity, badge=severity.word),
            Cell(happening.reason, under=happening.advice if happening.notable else ""),
        ],
    )


def coverage_table(coverage: Envelope | None) -> Table | None:
    """Tabulate the range of each quantity in flights fitted to and in those that judge."""
    if coverage is None or not coverage.quantities:
        return None
    rows = []
    for quantity in coverage.quantities.values():
        degrees, unit = per_degree(quantity.unit)
        fitted = None if quantity.fitted is None else [edge * degrees for edge in quantity.fitted]
        ranges = [fitted, *(_reach(quantity, seconds, degrees) for seconds in (quantity.training, quantity.held_out))]
        edges = iter(alike([edge for known in ranges if known is not None for edge in known]))
        cells = ["–" if known is None else f"{next(edges)} to {next(edges)}" for known in ranges]
        rows.append(Row(f"{quantity.title[:1].upper()}{quantity.title[1:]}, {unit}", cells))
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
    excursions = sorted(coverage.outside, key=lambda excursion: -excursion.part)
    # Flights outside of what was fitted that are named one by one.
    for excursion in excursions[:12]:
        quantity = coverage.quantities[excursion.quantity]
        degrees, unit = per_degree(quantity.unit)
        low, high, reach = alike([edge * degrees for edge in (*excursion.fitted, excursion.reach)])
        sentences.append(
            f"{excursion.flight}: {100.0 * excursion.part:.0f} % of its time at {quantity.title} outside of the "
            f"{low} to {high} {unit} fitted, as far as {reach} {unit}"
        )
    more = len(excursions) - len(sentences)
    return [*sentences, f"and {more} more"] if more > 0 else sentences


def flight_coverage(coverage: Coverage | None) -> Table | None:
    """Tabulate what one flight covered: usual range, median and extremes of each quantity."""
    if coverage is None or not coverage.quantities:
        return None
    rows = []
    for quantity in coverage.quantities.values():
        degrees, unit = per_degree(quantity.unit)
        cells = alike(
            [edge * degrees for edge in (quantity.min, quantity.p05, quantity.median, quantity.p95, quantity.max)]
        )
        rows.append(Row(f"{quantity.title[:1].upper()}{quantity.title[1:]}, {unit}", cells))
    return Table("Quantity", ["least", "5 %", "median", "95 %", "most"], rows)


def excitation(coverage: Coverage | None) -> list[str]:
    """Report how much a flight moved in each axis, and the wind."""
    if coverage is None:
        return []
    measured = coverage.excitation
    words: dict[str, list[str]] = {}
    for axis, excited in measured.axes.items():
        words.setdefault(excited.word, []).append(axis)
    moved = "; ".join(f"{', '.join(axes)}: {word}" for word, axes in words.items())
    sentences = [f"Excitation: {moved}. The nose pointed in {measured.headings} of 8 sectors of heading."]
    wind = coverage.wind
    if wind is not None:
        came = math.degrees(wind.direction)
        sentences.append(f"Mean wind {number(wind.speed, 2)} m/s from {came:.0f}°, as the rigid body has it.")
    return sentences


#: A name, and what stands beside it.
Fact = tuple[str, str]


def log_details(numbers: FlightReport) -> list[tuple[str, list[Fact]]]:
    """Return what is folded away at the end of the page of a flight: title and rows."""
    return [("The log", _log_details(numbers.log)), ("The craft", vehicle_details(numbers.vehicle))]


def estimate_details(numbers: FlightReport) -> list[tuple[str, list[Fact]]]:
    """Return how the results came about: title and rows."""
    sections = []
    if numbers.trajectory is not None:
        sections.append(("How the trajectory was estimated", _trajectory_details(numbers.trajectory)))
    sections.append(("Settings", settings(numbers.config)))
    sections.append(("Time spent", [(stage, f"{number(value, 2)} s") for stage, value in numbers.timings_s.items()]))
    return sections


def settings(config: AnalysisConfig) -> list[Fact]:
    """List the settings of an analysis."""
    values = ((field.name, getattr(config, field.name)) for field in fields(config))
    return [(name.replace("_", " "), "not given" if value is None else str(value)) for name, value in values]


def _log_details(log: LogFacts) -> list[Fact]:
    flights = ", ".join(f"{number(f.start, 4)} to {number(f.stop, 4)} s" for f in log.flights)
    return [
        ("file", log.file),
        ("format", log_words.FORMATS.get(log.format, log.format)),
        ("size", size(log.bytes)),
        ("SHA-256", log.sha256),
        ("length", duration(log.duration_s)),
        ("start", f"{log.start_utc}" if log.start_utc else "not determined: no GPS time in the log"),
        ("power-ups in the file", str(log.boots)),
        ("flights", flights or "none"),
    ]


def vehicle_details(vehicle: Vehicle) -> list[Fact]:
    """Describe a craft by what its logs say of it."""
    rows = [
        (name.replace("_", " "), number(value, 4) if isinstance(value, float) else str(value))
        for name, value in ((field.name, getattr(vehicle, field.name)) for field in fields(vehicle))
        if name != "motors" and value is not None
    ]
    turns = {1: "clockwise", -1: "counter-clockwise"}
    motors = ", ".join(
        f"{motor.number} at {number(math.degrees(motor.angle), 3)}° {turns.get(motor.spin, '')}".strip()
        for motor in vehicle.motors
    )
    return [*rows, ("motors", motors or "not described by the log")]


def _trajectory_details(trajectory: TrajectoryReport) -> list[Fact]:
    origin = trajectory.origin
    rows = [
        ("method", trajectory.method),
        ("origin", _place(origin)),
    ]
    units = {"p": "m", "v": "m/s", "phi": "°"}
    for name, value in trajectory.sigma_median.items():
        kind = name.rsplit("_", 1)[0]
        if kind in units and value is not None:
            shown = math.degrees(value) if kind == "phi" else value
            rows.append((f"median 1-sigma of {name}", f"{number(shown, 2)} {units[kind]}"))
    rows += [(name.replace("_", " "), _shown(value)) for name, value in trajectory.diagnostics.items()]
    return rows


def _place(origin: OriginReport) -> str:
    if origin.latitude_deg is None or origin.longitude_deg is None:
        return "not determined: no GPS"
    height = "" if origin.altitude_m is None else f", {origin.altitude_m:.1f} m above sea level"
    return f"{origin.latitude_deg:.6f}°, {origin.longitude_deg:.6f}°{height}"


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name}: {_shown(item)}" for name, item in value.items())
    if isinstance(value, list):
        return ", ".join(_shown(item) for item in value)
    if isinstance(value, float):
        return number(value, 4)
    return "not determined" if value is None else str(value)
