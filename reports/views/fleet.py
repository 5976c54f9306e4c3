"""What the page on all flights shows beside its crafts: flights, health of logs, what was left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import quote

from core.quantity import counted, duration, number
from core.table import Row, Table
from pipeline.results.report import FleetReport, FlightReport
from reports.views import summary
from reports.views.summary import BriefAnswer


def links(flights: Sequence[FlightReport]) -> dict[str, str]:
    """Return the page of every flight, by its name."""
    return {flight.name: f"{quote(flight.folder)}/report.html" for flight in flights}


def title(numbers: FleetReport) -> str:
    """Name the report: by its craft where all flights are of one, else by its logs."""
    if not numbers.flights:
        return "No flight"
    flights, crafts = counted(len(numbers.flights), "flight"), numbers.groups
    names = {flight.log.file for flight in numbers.flights}
    if len(names) == 1 and _logs(numbers) == 1:
        return f"{names.pop()}: {flights}"
    if len(crafts) == 1 and len(crafts[0].training) + len(crafts[0].held_out) == len(numbers.flights):
        return f"{crafts[0].name}: {flights}"
    return f"{flights}, {len(crafts)} craft identified" if crafts else flights


def facts(numbers: FleetReport) -> str:
    """One line under the title: how many logs, from when to when."""
    flights = numbers.flights
    starts = sorted(flight.log.start_utc for flight in flights if flight.log.start_utc)
    parts = [f"{counted(_logs(numbers), 'log')} analysed"]
    for found, words in (
        (numbers.failures, "gave nothing"),
        (numbers.duplicates, "copies"),
        (numbers.passed_over, "passed over"),
    ):
        if found:
            parts.append(f"{len(found)} {words}")
    if starts:
        days = sorted({start[:10] for start in (starts[0], starts[-1])})
        parts.append(" to ".join(days))
    return " · ".join(parts)


def _logs(numbers: FleetReport) -> int:
    """Count the files that flights are of."""
    return len({flight.log.sha256 for flight in numbers.flights})


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRow:
    """A flight with what was flown, what happened, and what it tells of the craft."""

    name: str
    link: str
    craft: str
    start: str
    airborne: str
    height: str
    speed: str
    said: BriefAnswer
    thrust: str  #: Per motor, over the mass in m/s², in N where that was given.


def flight_rows(numbers: FleetReport, pages: Mapping[str, str]) -> list[FlightRow]:
    """List every flight with what was flown, what happened, and what it tells of the craft."""
    parts = {
        name: word
        for craft in numbers.groups
        for names, word in ((craft.training, "fitted jointly"), (craft.held_out, "judges the joint fit"))
        for name in names
    }
    return [_flight_row(flight, pages[flight.name], parts.get(flight.name, "")) for flight in numbers.flights]


def _flight_row(flight: FlightReport, page: str, part: str) -> FlightRow:
    flown, thrust = flight.flight, summary.thrust_of(flight.answer)
    return FlightRow(
        name=flight.name,
        link=page,
        craft=", ".join(each for each in (summary.frame(flight.vehicle), part) if each),
        start=(flight.log.start_utc or "–")[:10],
        airborne="–" if flown is None else duration(flown.duration_s),
        height="–" if flown is None else _digits(flown.height_m),
        speed="–" if flown is None else _digits(flown.speed_max_m_s),
        said=summary.brief(flight),
        thrust="–" if thrust is None else f"{number(thrust[0], 2)} {thrust[2]}",
    )


def _digits(value: float | None) -> str:
    return "–" if value is None else number(value, 2)


def health_table(numbers: FleetReport) -> Table | None:
    """Tabulate how well each flight was logged: rates, satellites, vibration, battery, known position."""
    known = [(flight.name, flight.coverage.health) for flight in numbers.flights if flight.coverage is not None]
    if not known:
        return None
    return Table(
        label="Flight",
        heads=[
            *("IMU (Hz)", "motors (Hz)", "attitude (Hz)", "GPS (Hz)"),
            *("satellites", "vibration (m/s²)", "clips", "battery (V)", "position (m)"),
        ],
        rows=[
            Row(
                name,
                [
                    *(
                        _digits(health.rates[table].rate if table in health.rates else None)
                        for table in ("imu", "motors", "attitude", "gps")
                    ),
                    _whole(None if health.gps is None else health.gps.satellites_median),
                    _digits(None if health.vibration is None else health.vibration.p95),
                    _whole(None if health.vibration is None else health.vibration.clips),
                    "–" if health.battery is None else f"{health.battery.start:.1f}, {health.battery.lowest:.1f}",
                    _digits(health.position_sigma.median),
                ],
            )
            for name, health in known
        ],
        caption="How well each flight was logged: samples per second, satellites, vibration exceeded for 5 % of the "
        "time, clipped accelerations, voltage at take-off and least, and the median 1-sigma of the horizontal "
        "position.",
    )


def _whole(value: float | None) -> str:
    return "–" if value is None else f"{value:.0f}"
