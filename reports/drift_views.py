"""What pages say of parameters over flights: value, scatter, trend, and whether any of it is more than chance."""

from __future__ import annotations

from typing import Any

from logparse.quantity import number, per_degree, uncertain, with_unit
from reports import summary
from reports.drift_figures import changes
from reports.rows import Numbers

View = dict[str, Any]


def drift_table(drift: Numbers | None) -> View | None:
    """Tabulate each parameter over the flights, those that change first."""
    if drift is None or not drift["parameters"]:
        return None
    rows = []
    for each in sorted(drift["parameters"], key=lambda each: not changes(each)):
        degrees, unit = per_degree(each["unit"].partition(",")[0])
        trend, step = each["trend"], each["step"]
        rows.append(
            {
                "kind": "strong" if changes(each) else "",
                "label": with_unit(f"{each['parameter'][:1].upper()}{each['parameter'][1:]}, {each['method']}", unit),
                "cells": [
                    str(len(each["flights"])),
                    _written(each["mean"], each["mean_sigma"], degrees),
                    "–" if each["between"] is None else number(each["between"] * degrees, 2),
                    *(("–", "–") if trend is None else _tested(trend, "per_flight", "per_flight_sigma", degrees)),
                    *(("–", "–") if step is None else _tested(step, "change", "sigma", degrees)),
                ],
            }
        )
    return {
        "caption": "Mean over flights with one standard error, scatter between flights beyond their own errors, trend "
        "per flight and change at once between two flights, each with the chance of it where nothing changes, "
        "corrected for the number of questions asked.",
        "label": "Parameter",
        "heads": ["flights", "mean", "scatter", "trend per flight", "p", "step", "p"],
        "rows": rows,
    }


def drift_sentences(drift: Numbers | None) -> list[str]:
    """Report what changes over the flights, the gravest first; of what does not, only that."""
    if drift is None:
        return []
    motors = drift["motors"]
    about_motors = [] if motors is None else [motors["sentence"]]
    said = [each["sentence"] for each in drift["parameters"] if changes(each)]
    said = [*about_motors, *said] if motors is not None and motors["weakening"] else [*said, *about_motors]
    steady = sum(not changes(each) for each in drift["parameters"])
    if steady and steady == len(drift["parameters"]):
        said.append(f"None of the {steady} parameters followed over {len(drift['flights'])} flights is seen to change")
    return [summary.sentence(each) for each in said if each]


def _written(value: float | None, sigma: float | None, factor: float) -> str:
    return "–" if value is None else uncertain(factor * value, None if sigma is None else factor * sigma)


def _tested(found: Numbers, value: str, sigma: str, factor: float) -> tuple[str, str]:
    """Write a change and the chance of it."""
    p = found["p_adjusted"]
    return _written(found[value], found[sigma], factor), "–" if p is None else _chance(p)


def _chance(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"{p:.3f}"
