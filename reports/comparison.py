"""Two reports of a craft against each other: what changed by more than flights differ anyway, and what did not.

Parameters are compared over flights, not over fits: the values of single flights scatter more than their standard
errors say, because wind, battery and temperature differ. The difference of the two means is the slope of a
random-effects meta-regression on before/after (Knapp and Hartung 2003), corrected for the number of parameters
(Holm 1979).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
import scipy

from logparse.quantity import number, uncertain
from pipeline.fleet.meta_analysis import holm, meta_regression
from reports.numbers import plain
from reports.rows import Numbers, average, held_out

#: Chance of calling any parameter of a pair changed when none did.
SIGNIFICANCE = 0.05

#: Chance with which a change of the size called detectable is found.
POWER = 0.8

#: Methods from the one that uses most of the data to the one that uses least: the first that both sides have counts.
METHODS = ("rigid body", "rotor", "Kim 2017", "Refinement 2020, stacked", "mean thrust", "Refinement 2020, mean")

#: Flights on each side from which on errors of models are tested and not only set side by side.
FEWEST_JUDGES = 3

#: Standard errors that a value must differ from zero by for a change of it to be told in percent.
KNOWN = 3.0

#: Flights on each side from which on a difference of a few standard errors is more than chance.
ENOUGH = 3

#: Settings of an analysis that do not change what is found.
_NO_MATTER = frozenset({"time_limit", "training", "validation"})


@dataclass(frozen=True, slots=True)
class Subject:
    """What is compared: a craft over its flights, or one flight where there is no joint model.

    Attributes
    ----------
    name : str
    numbers : dict
        Of the craft or flight, as its report.json has them.
    flights : sequence of dict
        Its flights, as the report has them.
    points : mapping of (str, str) to sequence of (float, float)
        Value and sigma in each flight that determined a parameter, by parameter and method.
    units : mapping of str to str
        By parameter.
    config : dict
        Settings of the analysis.
    """

    name: str
    numbers: Numbers
    config: Numbers
    flights: Sequence[Numbers]
    points: Mapping[tuple[str, str], Sequence[tuple[float, float]]]
    units: Mapping[str, str]


def subjects(report: Numbers) -> list[Subject]:
    """Find what a report can be compared by: its crafts; its one flight when it is the report of a flight."""
    if report["kind"] == "flight":
        return [_of_flight(report)]
    by_name = {flight["name"]: flight for flight in report["flights"]}
    return [
        _of_craft(
            craft,
            report["config"],
            [by_name[name] for name in (*craft["training"], *craft["held_out"]) if name in by_name],
        )
        for craft in report["groups"]
    ]


def _of_flight(flight: Numbers) -> Subject:
    rows = [row for row in flight["parameters"] or () if row["value"] is not None and row["sigma"]]
    return Subject(
        name=flight["name"],
        numbers=flight,
        config=flight["config"],
        flights=[flight],
        points={(row["parameter"], row["method"]): [(row["value"], row["sigma"])] for row in rows},
        units={row["parameter"]: row["unit"] for row in rows},
    )


def _of_craft(craft: Numbers, config: Numbers, flights: Sequence[Numbers]) -> Subject:
    followed = (craft["drift"] or {}).get("parameters", [])
    return Subject(
        name=craft["name"],
        numbers=craft,
        config=config,
        flights=flights,
        points={
            (each["parameter"], method): [
                (row["value"], row["sigma"]) for row in rows if row["value"] is not None and row["sigma"]
            ]
            for each in followed
            for method, rows in {each["method"]: each["flights"], **each["others"]}.items()
        },
        units={each["parameter"]: each["unit"] for each in followed},
    )


def compare_reports(a: Numbers, b: Numbers, names: tuple[str, str]) -> Numbers:
    """Compare two reports craft by craft.

    Parameters
    ----------
    a, b : dict
        What `report.json` holds, of a flight or a fleet.
    names : (str, str)
        What to call them, such as their folders.

    Returns
    -------
    dict
        ``pairs`` with ``parameters``, ``errors``, ``changed`` settings and ``sentences``; ``unpaired`` names.
    """
    pairs, left, right = _pair(subjects(a), subjects(b))
    return plain(
        {
            "kind": "comparison",
            "rotorid": version("rotorid"),
            "a": {"report": names[0], "rotorid": a["rotorid"]},
            "b": {"report": names[1], "rotorid": b["rotorid"]},
            "pairs": [_compare(before, after) for before, after in pairs],
            "unpaired": {"a": [each.name for each in left], "b": [each.name for each in right]},
        }
    )


def _pair(
    a: Sequence[Subject], b: Sequence[Subject]
) -> tuple[list[tuple[Subject, Subject]], list[Subject], list[Subject]]:
    """Pair what is called alike, in order; what is alone on both sides is a pair whatever it is called."""
    pairs, left, right = [], [], list(b)
    for each in a:
        match = next((other for other in right if other.name == each.name), None)
        if match is None:
            left.append(each)
        else:
            pairs.append((each, match))
            right.remove(match)
    if len(left) == len(right) == 1:
        pairs.append((left.pop(), right.pop()))
    return pairs, left, right


def _compare(a: Subject, b: Subject) -> Numbers:
    parameters = _parameters(a, b)
    errors = _errors(a, b)
    changed = _changed(a, b)
    return {
        "a": _facts(a),
        "b": _facts(b),
        "changed": changed,
        "parameters": parameters,
        "errors": errors,
        "verdicts": _verdicts(a, b),
        "sentences": _sentences(parameters, changed),
    }


def _facts(subject: Subject) -> Numbers:
    starts = sorted(flight["log"]["start_utc"] for flight in subject.flights if flight["log"]["start_utc"])
    return {
        "name": subject.name,
        "flights": len(subject.flights),
        "first_utc": starts[0] if starts else None,
        "last_utc": starts[-1] if starts else None,
    }


def _parameters(a: Subject, b: Subject) -> list[Numbers]:
    """Test every parameter that both sides determined; one method for each."""
    rows: list[Numbers] = []
    for parameter in dict.fromkeys(name for name, _ in a.points):
        method = next(
            (each for each in METHODS if a.points.get((parameter, each)) and b.points.get((parameter, each))), None
        )
        if method is not None:
            rows.append(
                {"parameter": parameter, "method": method, "unit": a.units[parameter]}
                | _difference(a.points[parameter, method], b.points[parameter, method])
            )
    for row, p in zip(rows, holm([row["p"] for row in rows]), strict=True):
        row["p_adjusted"] = p
        row["significant"] = p < SIGNIFICANCE
    return rows


def _difference(a: Sequence[tuple[float, float]], b: Sequence[tuple[float, float]]) -> Numbers:
    """Compare the means of a parameter over the flights of both sides."""
    values, sigmas = np.array([*a, *b]).T
    after = np.repeat([0.0, 1.0], [len(a), len(b)])
    fit = meta_regression(values, sigmas, np.column_stack([1.0 - after, after]))
    change, sigma, p = fit.test([-1.0, 1.0])
    before, before_sigma = float(fit.beta[0]), math.sqrt(fit.covariance[0, 0])
    # Percent of what may be zero mean nothing.
    percent = 100.0 / before if abs(before) > KNOWN * before_sigma else 0.0
    return {
        "a": {"value": before, "sigma": before_sigma, "flights": len(a)},
        "b": {"value": float(fit.beta[1]), "sigma": math.sqrt(fit.covariance[1, 1]), "flights": len(b)},
        "between_flights": fit.tau if fit.df else None,
        "difference": change,
        "difference_sigma": sigma,
        "difference_percent": percent * change if percent else None,
        "interval_percent": [percent * (change + side * _interval(fit.df) * sigma) for side in (-1.0, 1.0)]
        if percent
        else None,
        "detectable_percent": abs(percent) * _detectable(fit.df) * sigma if percent else None,
        "p": p,
    }


def _detectable(df: int) -> float:
    """Multiple of the standard error that a true change must have to be found four times out of five."""
    return _interval(df) + float((scipy.stats.t(df) if df else scipy.stats.norm).ppf(POWER))


def _interval(df: int) -> float:
    """Half the width of a 95 % interval in standard errors."""
    return float((scipy.stats.t(df) if df else scipy.stats.norm).ppf(1.0 - SIGNIFICANCE / 2.0))


def _errors(a: Subject, b: Subject) -> list[Numbers]:
    """Set held-out errors of the models that both sides have side by side, output by output."""
    rows = []
    after = {model["key"]: model for model in b.numbers["models"]}
    for model in a.numbers["models"]:
        other = after.get(model["key"])
        if other is None or not (held_out(model) and held_out(other)):
            continue
        for output in model["rmse_average_m"]:
            left, right = ([row["rmse_m"][output] for row in held_out(each)] for each in (model, other))
            means = [average(held_out(each), "rmse_mean_m")[output] for each in (model, other)]
            error, later = model["rmse_average_m"][output], other["rmse_average_m"][output]
            rows.append(
                {
                    "model": model["key"],
                    "title": model["title"],
                    "output": output,
                    "a": {"rmse_m": error, "mean_m": means[0], "flights": len(left)},
                    "b": {"rmse_m": later, "mean_m": means[1], "flights": len(right)},
                    "ratio": later / error if error and later else None,
                    "p": _different(left, right),
                }
            )
    return rows


def _different(a: Sequence[float | None], b: Sequence[float | None]) -> float | None:
    """Chance of errors as different as these (Welch's t of their logarithms); None with too few flights."""
    left, right = ([math.log(value) for value in values if value] for values in (a, b))
    if min(len(left), len(right)) < FEWEST_JUDGES:
        return None
    return float(scipy.stats.ttest_ind(left, right, equal_var=False).pvalue)


def _verdicts(a: Subject, b: Subject) -> list[Numbers]:
    after = {model["key"]: model for model in b.numbers["models"]}
    return [
        {
            "model": model["key"],
            "title": model["title"],
            "a": model["verdict"]["trust"],
            "b": after[model["key"]]["verdict"]["trust"],
        }
        for model in a.numbers["models"]
        if model["key"] in after
    ]


def _changed(a: Subject, b: Subject) -> list[Numbers]:
    """List what differs of the craft and of the settings of the analysis: a change of parameters may come from it."""
    sides = [{"craft": each.numbers["vehicle"], "analysis": each.config} for each in (a, b)]
    return [
        {"of": of, "name": name, "a": sides[0][of].get(name), "b": sides[1][of].get(name)}
        for of in ("craft", "analysis")
        for name in dict.fromkeys([*sides[0][of], *sides[1][of]])
        if name not in _NO_MATTER and sides[0][of].get(name) != sides[1][of].get(name)
    ]


def _sentences(parameters: list[Numbers], changed: list[Numbers]) -> list[str]:
    """Report what changed, what did not as far as can be seen, and what these flights cannot tell."""
    if not parameters:
        return [
            "No parameter is determined on both sides, so none can be compared; the reports say why "
            "(“not determined”) and how to fly for them."
        ]
    text = []
    moved = [row for row in parameters if row["significant"]]
    if moved:
        what = "; ".join(f"{row['parameter']} {change(row)}" for row in moved)
        text.append(f"Changed, of {len(parameters)} parameters compared: {what}.")
    else:
        text.append(f"None of the {len(parameters)} parameters compared changed by more than chance explains.")
    still = [row for row in parameters if not row["significant"] and row["detectable_percent"] is not None]
    if still:
        least = ", ".join(f"{row['parameter']} {number(row['detectable_percent'], 2)} %" for row in still)
        text.append(f"Where no change is seen, one smaller than this would hardly have been found: {least}.")
    alone = [row["parameter"] for row in parameters if row["between_flights"] is None]
    if alone:
        text.append(
            f"With one flight on each side that tells it ({', '.join(alone)}) nobody knows how much flights differ "
            "anyway; wind, battery and temperature alone move parameters. Analyse several flights before and after."
        )
    elif any(row[side]["flights"] < ENOUGH for row in still for side in "ab"):
        text.append(
            "So few flights can hardly tell a change from how flights differ anyway; analyse three or more on each "
            "side."
        )
    if any(each["of"] == "craft" for each in changed):
        text.append("The craft itself was set differently; the table of settings says how.")
    if any(each["of"] == "analysis" for each in changed):
        text.append("The two analyses had different settings, which may make a difference of their own.")
    return text


def change(row: Numbers) -> str:
    """Write the difference of a parameter in percent where that means something, else in its unit."""
    if row["difference_percent"] is None:
        return uncertain(row["difference"], row["difference_sigma"])
    scale = row["difference_percent"] / row["difference"] if row["difference"] else 0.0
    sign = "+" if row["difference_percent"] > 0.0 else ""
    return sign + uncertain(row["difference_percent"], abs(scale) * row["difference_sigma"], "%")
