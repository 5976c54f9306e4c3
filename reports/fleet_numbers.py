"""The numbers of a folder of logs, composed from those of its flights and crafts: what its report.json holds."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

from reports.rows import Numbers, held_out

#: Of a distribution of a flight's speeds, heights and so on, what a summary keeps.
_PERCENTILES = ("title", "unit", "min", "p05", "median", "p95", "max")
#: Of an answer on the first screen, what a summary keeps.
_ANSWER = ("purpose", "word", "tone", "text")
#: Worst first.
SEVERITIES = ("error", "warning", "info")


def fleet_numbers(
    crafts: Sequence[Numbers],
    flights: Sequence[Numbers],
    *,
    failures: Sequence[Numbers] = (),
    passed_over: Sequence[Numbers] = (),
    duplicates: Sequence[Numbers] = (),
    removed: Sequence[Numbers] = (),
    config: Numbers | None = None,
    timings_s: Numbers | None = None,
) -> Numbers:
    """Gather what is known of a folder of logs.

    Parameters
    ----------
    crafts : sequence of dict
        Numbers of every craft, in full.
    flights : sequence of dict
        Summaries of every flight, see `flight_summary`, with their ``findings`` still in full.
    failures, passed_over, duplicates, removed : sequence of dict
        ``file`` and ``reason`` of logs that gave nothing, of files that were not used, of copies, and of logs that an
        earlier run knew and this one did not find.
    config : dict, optional
    timings_s : dict, optional
    """
    return {
        "kind": "fleet",
        "rotorid": version("rotorid"),
        "config": config or {},
        "groups": list(crafts),
        "flights": [
            flight | {"findings": [{"id": f["id"], "severity": f["severity"]} for f in flight["findings"]]}
            for flight in flights
        ],
        "findings": common_findings(flights),
        "failures": list(failures),
        "passed_over": list(passed_over),
        "duplicates": list(duplicates),
        "removed": list(removed),
        "timings_s": timings_s or {},
    }


def flight_summary(numbers: Numbers, folder: str) -> Numbers:
    """Keep of a flight's numbers what tables over all flights show; its own report.json has the rest.

    Parameters
    ----------
    numbers : dict
        Of the flight.
    folder : str
        Of its products, such as ``flights/paper01``.
    """
    vehicle = {name: value for name, value in numbers["vehicle"].items() if name != "motors"}
    thrust = numbers["thrust"]
    return {
        "name": numbers["name"],
        "folder": folder,
        "log": numbers["log"],
        "vehicle": vehicle | {"motor_count": len(numbers["vehicle"]["motors"])},
        "flight": None if numbers["flight"] is None else {k: v for k, v in numbers["flight"].items() if k != "modes"},
        "answer": [{key: line[key] for key in _ANSWER} for line in (numbers["answer"] or {"lines": []})["lines"]],
        "verdict": numbers["verdict"],
        "models": [
            {
                "key": model["key"],
                "title": model["title"],
                "verdict": model["verdict"],
                "uses": model["uses"],
                "model": None if model["model"] is None else {"kind": model["model"]["kind"]},
                "rmse": held_out(model),
                "rmse_average_m": model["rmse_average_m"],
                "missing": model["missing"],
            }
            for model in numbers["models"]
        ],
        "thrust": None if thrust is None else {"common": thrust["common"], "hover_command": thrust["hover_command"]},
        "coverage": _covered(numbers.get("coverage")),
        "findings": numbers["findings"],
        "missing": numbers["missing"],
        "timings_s": numbers["timings_s"],
    }


def _covered(coverage: Numbers | None) -> Numbers | None:
    """Keep percentiles, not how they came about."""
    if coverage is None:
        return None
    kept: dict[str, Any] = {
        "seconds": coverage["seconds"],
        "quantities": {name: {key: each[key] for key in _PERCENTILES} for name, each in coverage["quantities"].items()},
        "wind": coverage["wind"],
        "excitation": coverage["excitation"],
        "health": coverage["health"],
    }
    return kept


def common_findings(flights: Sequence[Numbers]) -> list[Numbers]:
    """Gather the findings of all flights by what they are about, worst and most frequent first."""
    found: dict[tuple[str, str], Numbers] = {}
    for flight in flights:
        for finding in flight["findings"]:
            key = (finding["severity"], finding["id"])
            entry = found.setdefault(
                key,
                {name: finding[name] for name in ("id", "severity", "reason", "advice")}
                | {"example": flight["name"], "flights": []},
            )
            if flight["name"] not in entry["flights"]:
                entry["flights"].append(flight["name"])
    return sorted(found.values(), key=lambda each: (SEVERITIES.index(each["severity"]), -len(each["flights"])))


def rmse_rows(crafts: Sequence[Numbers], flights: Sequence[Numbers]) -> list[Numbers]:
    """List all RMSE rows of crafts and flights, joint models first."""
    return [row for each in (*crafts, *flights) for row in each["rmse"]]
