"""What is shown of all flights beside their crafts: the table of flights, health of logs, what was left out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from urllib.parse import quote

from core.quantity import counted, duration, number
from core.table import Cell, Row, Table
from pipeline.results.answer import Tone
from pipeline.results.report import FleetReport, FlightReport
from reports.views import log_words, summary


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


def flight_cells(flight: FlightReport) -> dict[str, str | Cell]:
    """Return by column what was flown, what happened, and what it tells of the craft, in as few words as cells hold."""
    flown, answer = flight.flight, flight.answer
    happened, loops, ahead = (
        None if answer is None else answer.line(purpose) for purpose in ("Happened", "Loops", "Predict ahead")
    )
    unknown = Cell("–", Tone.UNKNOWN)
    # The least phase margin with its word where it was measured, else how well the attitude followed.
    margin = "" if loops is None else f"{loops.word} " * (loops.tone is not Tone.UNKNOWN) + loops.number
    return {
        "Day": (flight.log.start_utc or "–")[:10],
        "Airborne": "–" if flown is None else duration(flown.duration_s),
        "Height (m)": "–" if flown is None else _digits(flown.height_m),
        "Speed (m/s)": "–" if flown is None else _digits(flown.speed_max_m_s),
        "What happened": unknown if happened is None else Cell(flight.happened or "not known", happened.tone),
        "Loops": unknown if loops is None or not loops.number else Cell(margin, loops.tone),
        "Predicts ahead": unknown if ahead is None or ahead.value is None else Cell(ahead.number, ahead.tone),
        "Thrust of a motor": _thrust(flight),
    }


def _thrust(flight: FlightReport) -> str:
    """Write the thrust of a motor, over the mass unless that was given, as its error allows; four digits at most."""
    known = summary.thrust_of(flight.answer)
    if known is None:
        return "–"
    value, sigma, unit = known
    digits = 3
    if value and sigma and sigma > 0.0:
        digits = min(max(math.floor(math.log10(abs(value))) - math.floor(math.log10(sigma)) + 1, 1), 4)
    return f"{number(value, digits)} {unit}"


def flights_table(numbers: FleetReport, pages: Mapping[str, str]) -> Table | None:
    """Tabulate every flight with its page; None without any."""
    parts = {
        name: word
        for craft in numbers.groups
        for names, word in ((craft.training, "fitted jointly"), (craft.held_out, "judges the joint fit"))
        for name in names
    }
    shown = [(flight, flight_cells(flight)) for flight in numbers.flights]
    rows = []
    for flight, cells in shown:
        under = ", ".join(each for each in (log_words.frame(flight.vehicle), parts.get(flight.name, "")) if each)
        rows.append(Row(Cell(flight.name, under=under), list(cells.values()), link=pages[flight.name]))
    if not rows:
        return None
    heads = list(shown[0][1])
    texts = [heads.index(each) for each in ("Day", "What happened", "Loops")]
    roomy = [place for place, head in enumerate(heads) if head != "What happened"]
    return Table("Flight", heads, rows, texts=texts, style="flights", roomy=roomy)


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
