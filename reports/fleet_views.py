"""What the page on all flights shows beside its crafts: flights, health of logs, what was left out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

from logparse.quantity import counted, duration, number
from reports import summary
from reports.rows import Numbers, held_out
from reports.views import rmse_lines

View = dict[str, Any]

#: Flights in danger that the first screen names.
MOST_ENDANGERED = 3
#: Where there are flights but no craft.
ALONE = "No craft has two usable flights here, so there is no joint model; every flight stands for itself."


def links(flights: Sequence[Numbers]) -> dict[str, str]:
    """Return the page of every flight, by its name."""
    return {flight["name"]: f"{quote(flight['folder'])}/report.html" for flight in flights}


def title(numbers: Numbers) -> str:
    """Name the report: by its craft where all flights are of one, else by its logs."""
    if not numbers["flights"]:
        return "No flight"
    flights, crafts = counted(len(numbers["flights"]), "flight"), numbers["groups"]
    names = {flight["log"]["file"] for flight in numbers["flights"]}
    if len(names) == 1 and _logs(numbers) == 1:
        return f"{names.pop()}: {flights}"
    if len(crafts) == 1 and len(crafts[0]["training"]) + len(crafts[0]["held_out"]) == len(numbers["flights"]):
        return f"{crafts[0]['name']}: {flights}"
    return f"{flights}, {len(crafts)} craft identified" if crafts else flights


def facts(numbers: Numbers) -> str:
    """One line under the title: how many logs, how long in the air, from when to when."""
    flights = numbers["flights"]
    airborne = sum(flight["flight"]["duration_s"] for flight in flights if flight["flight"])
    starts = sorted(flight["log"]["start_utc"] for flight in flights if flight["log"]["start_utc"])
    parts = [f"{counted(_logs(numbers), 'log')} analysed"]
    for key, words in (("failures", "gave nothing"), ("duplicates", "copies"), ("passed_over", "passed over")):
        if numbers[key]:
            parts.append(f"{len(numbers[key])} {words}")
    if airborne:
        parts.append(f"{duration(airborne)} in the air")
    if starts:
        days = sorted({start[:10] for start in (starts[0], starts[-1])})
        parts.append(" to ".join(days))
    return " · ".join(parts)


def _logs(numbers: Numbers) -> int:
    """Count the files that flights are of."""
    return len({flight["log"]["sha256"] for flight in numbers["flights"]})


def endangered(numbers: Numbers) -> list[str]:
    """Name the flights that were in danger, and why; most are counted."""
    bad = [
        f"{flight['name']}: {line['word']}, {line['text']}"
        for flight in numbers["flights"]
        for line in flight["answer"]
        if line["purpose"] == "Healthy" and line["tone"] == "bad"
    ]
    more = [f"and {len(bad) - MOST_ENDANGERED} more"] if len(bad) > MOST_ENDANGERED else []
    return [*(summary.sentence(each) for each in bad[:MOST_ENDANGERED]), *more]


def flight_rows(numbers: Numbers, pages: dict[str, str]) -> list[View]:
    """List every flight with what was flown, its health, and what the best of its own models achieves."""
    flights = numbers["flights"]
    parts = {
        name: word
        for craft in numbers["groups"]
        for key, word in (("training", "fitted jointly"), ("held_out", "judges the joint fit"))
        for name in craft[key]
    }
    chosen = [summary.best(flight["models"]) for flight in flights]
    held = [None if result is None else held_out(result)[0] for result in chosen]
    cells = iter(rmse_lines(row for row in held if row is not None))
    return [
        _flight_row(flight, pages[flight["name"]], parts.get(flight["name"], ""), result)
        | {
            "cells": [] if row is None else next(cells),
            "reason": "" if row is not None else summary.first_reason(flight),
        }
        for flight, result, row in zip(flights, chosen, held, strict=True)
    ]


def _flight_row(flight: Numbers, page: str, part: str, result: Numbers | None) -> View:
    flown = flight["flight"] or {}
    trust = "unknown" if result is None else result["verdict"]["trust"]
    wind = (flight["coverage"] or {}).get("wind")
    answers = {line["purpose"]: line for line in flight["answer"]}
    return {
        "name": flight["name"],
        "link": page,
        "craft": ", ".join(each for each in (summary.frame(flight["vehicle"]), part) if each),
        "start": "–" if not flight["log"]["start_utc"] else flight["log"]["start_utc"][:10],
        "airborne": "–" if not flown else duration(flown["duration_s"]),
        "height": _digits(flown.get("height_m")),
        "speed": _digits(flown.get("speed_max_m_s")),
        "wind": "–" if wind is None else _digits(wind["speed"]),
        "healthy": answers.get("Healthy"),
        "loops": answers.get("Loops"),
        "model": "" if result is None else result["title"],
        "trust": trust,
        "word": summary.TRUST_WORDS[trust],
    }


def _digits(value: float | None) -> str:
    return "–" if value is None else number(value, 2)


def own_models(numbers: Numbers) -> str:
    """Report how many flights have a model of their own, and how far it can be trusted."""
    chosen = [summary.best(flight["models"]) for flight in numbers["flights"]]
    words = {
        "yes": "a model that can be trusted for flights like it",
        "limited": "a model to be taken with care",
        "no": "no model that can be trusted",
    }
    counts = {trust: sum(each is not None and each["verdict"]["trust"] == trust for each in chosen) for trust in words}
    without = len(chosen) - sum(counts.values())
    parts = [f"{count} {'has' if count == 1 else 'have'} {words[trust]}" for trust, count in counts.items() if count]
    parts += [f"{without} {'has' if without == 1 else 'have'} no model that was judged"] if without else []
    return f"Of {counted(len(chosen), 'flight')}, {', '.join(parts)}." if chosen else "No log gave a flight."


def health_table(numbers: Numbers) -> View | None:
    """Tabulate how well each flight was logged: rates, satellites, vibration, battery, known position."""
    known = [
        (flight["name"], flight["coverage"]["health"])
        for flight in numbers["flights"]
        if flight["coverage"] and flight["coverage"]["health"]
    ]
    if not known:
        return None
    rates = ("imu", "motors", "attitude", "gps")
    return {
        "caption": "How well each flight was logged: samples per second, satellites, vibration exceeded for 5 % of the "
        "time, clipped accelerations, voltage at take-off and least, and the median 1-sigma of the horizontal "
        "position.",
        "label": "Flight",
        "heads": [
            *("IMU (Hz)", "motors (Hz)", "attitude (Hz)", "GPS (Hz)"),
            *("satellites", "vibration (m/s²)", "clips", "battery (V)", "position (m)"),
        ],
        "rows": [
            {
                "kind": "",
                "label": name,
                "cells": [
                    *(_digits((health["rates"].get(rate) or {}).get("rate")) for rate in rates),
                    _whole((health["gps"] or {}).get("satellites")),
                    _digits((health["vibration"] or {}).get("p95")),
                    _whole((health["vibration"] or {}).get("clips")),
                    _volts(health["battery"]),
                    _digits(health["position_sigma"]["median"]),
                ],
            }
            for name, health in known
        ],
    }


def _whole(value: float | None) -> str:
    return "–" if value is None else f"{value:.0f}"


def _volts(battery: Numbers | None) -> str:
    return "–" if battery is None else f"{battery['first']:.1f}, {battery['min']:.1f}"


def common_findings(numbers: Numbers) -> tuple[list[View], list[View]]:
    """List findings about logs, each with the flights that it holds for: what must worry, and notes."""
    total = len(numbers["flights"])
    found = [
        finding
        | {
            "where": f"{finding['example']}"
            if len(finding["flights"]) == 1
            else f"{len(finding['flights'])} of {total} logs; of {finding['example']}, for one",
        }
        for finding in numbers["findings"]
    ]
    return (
        [finding for finding in found if finding["severity"] != "info"],
        [finding for finding in found if finding["severity"] == "info"],
    )
