"""The fine print of a report: log, craft, estimator, settings and time spent, as labelled values."""

import math
from dataclasses import fields

from core.quantity import duration, number, size
from logparse import Vehicle
from pipeline.config import AnalysisConfig
from pipeline.results.report import FlightReport, LogReport, OriginReport, TrajectoryReport
from reports.views import log_words

Row = tuple[str, str]


def log_details(numbers: FlightReport) -> list[tuple[str, list[Row]]]:
    """Return what is folded away at the end of the page of a flight: title and rows."""
    return [("The log", _log_details(numbers.log)), ("The craft", _vehicle_details(numbers.vehicle))]


def estimate_details(numbers: FlightReport) -> list[tuple[str, list[Row]]]:
    """Return how the results came about: title and rows."""
    sections = []
    if numbers.trajectory is not None:
        sections.append(("How the trajectory was estimated", _trajectory_details(numbers.trajectory)))
    sections.append(("Settings", settings(numbers.config)))
    sections.append(("Time spent", [(stage, f"{number(value, 2)} s") for stage, value in numbers.timings_s.items()]))
    return sections


def settings(config: AnalysisConfig) -> list[Row]:
    """List the settings of an analysis."""
    values = ((field.name, getattr(config, field.name)) for field in fields(config))
    return [(name.replace("_", " "), "not given" if value is None else str(value)) for name, value in values]


def _log_details(log: LogReport) -> list[Row]:
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


def _vehicle_details(vehicle: Vehicle) -> list[Row]:
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


def _trajectory_details(trajectory: TrajectoryReport) -> list[Row]:
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
