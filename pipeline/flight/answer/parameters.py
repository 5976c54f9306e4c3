"""Thrust, inertia and drag, as far as the flight determines them."""

from __future__ import annotations

import math
import re

from core.quantity import uncertain
from pipeline.flight.answer.words import changed_load
from pipeline.results.answer import AnswerLine, Tone
from pipeline.results.failure import Failure
from pipeline.results.flight import FlightResult
from sysid.rigid_body.physical import HEADLINE, UNITS, quantity

#: Parameters of the first screen: name, and rows of `PhysicalParameters.table` in order of preference.
_SHOWN = (
    ("thrust", ("thrust over mass",)),
    ("inertia", ("roll inertia over mass and arm", "pitch inertia over mass and arm")),
    ("drag", ("linear drag over mass", "quadratic drag over mass")),
)


def parameters(result: FlightResult) -> AnswerLine | None:
    """Answer with thrust first; None where nothing is determined."""
    known: list[tuple[str, float, float, str]] = []
    unknown = []
    for label, rows in _SHOWN:
        found = next(((row, each) for row in rows if (each := _row(result, row)) is not None), None)
        if found is None:
            unknown.append(label)
        else:
            name, (known_value, error, in_full) = found
            what = _divided(name, in_full) + (" per motor" if label == "thrust" else "")
            known.append((what, known_value, error, _unit(in_full)))
    if not known:
        return None
    what, value, sigma, unit = known[0]
    parts = [what]
    parts += [f"{name} {uncertain(known_value, error, its_unit)}" for name, known_value, error, its_unit in known[1:]]
    text = ", ".join(parts)
    disagree = not isinstance(result.parameters, Failure) and bool(result.parameters.findings)
    if disagree:
        text += "; methods disagree"
    changed = changed_load(result)
    if changed:
        text += f"; {changed}: of neither load"
    complete = not unknown and not disagree and not changed
    word = "known" if complete else "disputed" if disagree or changed else "partly"
    tone = Tone.GOOD if complete else Tone.CARE
    return AnswerLine(purpose="Parameters", word=word, tone=tone, text=text, value=value, sigma=sigma, unit=unit)


def _row(result: FlightResult, parameter: str) -> tuple[float, float, str] | None:
    """Return the headline of a parameter with its error, in SI with the mass where that is given."""
    if not isinstance(result.parameters, Failure):
        rows = result.parameters.table.reset_index().to_dict("records")
        row = next((each for each in rows if (each["parameter"], each["method"]) == (parameter, HEADLINE)), None)
        if row is None:
            return None
        for prefix in ("si_", ""):
            value, sigma = float(row[f"{prefix}value"]), float(row[f"{prefix}sigma"])
            if math.isfinite(value) and math.isfinite(sigma) and sigma > 0.0:
                return value, sigma, str(row[f"{prefix}unit"])
        return None
    if parameter == "thrust over mass" and not isinstance(result.thrust, Failure):
        common = result.thrust.common
        if common.determined and common.per_mass is not None and common.sigma is not None:
            return common.per_mass, common.sigma, UNITS[parameter]
    return None


def _divided(parameter: str, unit: str) -> str:
    """Name a number as its unit has it: motion alone gives no inertia, but its ratio to mass and arm."""
    name, divisor = quantity(parameter, unit)
    if not divisor:
        return name
    return f"{name}/({divisor.replace(' and ', '·')})" if " and " in divisor else f"{name}/{divisor}"


def _unit(unit: str) -> str:
    """Leave the conditions out of a unit, which stand in the table of parameters."""
    return re.split(r",| at | \(", unit, maxsplit=1)[0].replace("^2", "²").replace(" ", "·")
