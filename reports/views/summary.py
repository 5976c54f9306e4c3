"""The answer first: what a log is and what was identified from it, in sentences for the top of a report."""

import re
from collections.abc import Mapping, Sequence

from core.quantity import joined, uncertain
from core.summary import listed
from pipeline.results.answer import Answer
from pipeline.results.model import ModelReport, ParameterRow, bare_unit, headlines
from pipeline.results.report import CraftReport, FleetReport, FlightReport, LeftOut
from reports.views.log_words import craft
from sysid.rotors.thrust_record import ThrustModel
from sysid.transfer_functions.model_record import FunctionsRecord

_NUMBER = re.compile(r"[0-9]+(?:\.[0-9]+)?")
#: Files of one reason that are named in a line.
MOST_NAMED = 5
TRUST_WORDS: Mapping[str, str] = {"yes": "trust", "limited": "with care", "no": "do not trust", "unknown": "not judged"}


def order(model: FunctionsRecord) -> str:
    """Name the order of a model's transfer functions: ``5 poles, 3 zeros``."""
    return ", ".join(
        f"{count} {kind if count != 1 else kind[:-1]}"
        for kind, count in (("poles", model.poles), ("zeros", model.zeros))
    )


def described(result: ModelReport) -> str:
    """Name a model with what it consists of: ``motor PWM → position (24 transfer functions, 5 poles, 3 zeros)``."""
    model = result.model
    if not isinstance(model, FunctionsRecord):
        return result.title
    count = sum(any(function.num) for row in model.transfer_functions.values() for function in row.values())
    return f"{result.title} ({count} transfer function{'s' if count != 1 else ''}, {order(model)})"


def thrust_of(answer: Answer | None) -> tuple[float, float | None, str] | None:
    """Return thrust of a motor with its error and unit as the first screen of a flight has it; None where unknown."""
    line = None if answer is None else answer.line("Parameters")
    if line is None or line.value is None or line.unit not in ("N", "m/s²") or not line.text.startswith("thrust"):
        return None
    return line.value, line.sigma, line.unit


def facts(numbers: FlightReport) -> str:
    """One line under the title: craft and when."""
    log = numbers.log
    parts = [craft(numbers.vehicle)]
    if log.flight_count > 1:
        parts.insert(0, f"flight {log.flight_number} of {log.flight_count}")
    if log.start_utc:
        parts.append(log.start_utc[:16].replace("T", " ") + " UTC")
    return " · ".join(part for part in parts if part)


def _identified(numbers: CraftReport) -> str:
    parts = [described(result) for result in numbers.models if result.model is not None]
    text = f"Identified: {joined(parts)}." if parts else ""
    coefficient = thrust_coefficient(numbers.thrust, numbers.parameters)
    if coefficient:
        text = f"Thrust: {coefficient}. {text}".strip()
    return text or "Nothing could be identified."


def joint_sentences(group: CraftReport) -> list[str]:
    """Report what was identified from several flights of one craft, and from which."""
    count = len(group.training) + len(group.held_out)
    validating = max((len(result.held_out) for result in group.models), default=0)
    split = f"{len(group.training)} to fit, {len(group.held_out)} held out, of which {validating} judge"
    if validating in (0, len(group.held_out)):
        split = f"{len(group.training)} to fit, {len(group.held_out)} to judge"
    text = f"{count} flights of one craft ({group.name}): {split}."
    if not any(result.model is not None for result in group.models):
        reason = next((result.missing for result in group.models if result.missing), "not fitted")
        return [text, f"No joint model: {reason}."]
    return [text, _identified(group).replace("Identified:", "Identified jointly:")]


def thrust_coefficient(thrust: ThrustModel | None, parameters: Sequence[ParameterRow] | None) -> str:
    """Write the thrust per motor with its uncertainty and conditions; empty when there is none."""
    known = thrust_known(thrust, parameters)
    if known is None or thrust is None:
        return ""
    over = "" if known[2] == "N" else " over the mass,"
    return f"{uncertain(*known)}{over} per motor at full command {thrust_conditions(thrust)}"


def thrust_known(
    thrust: ThrustModel | None, parameters: Sequence[ParameterRow] | None
) -> tuple[float | None, float | None, str] | None:
    """Return the thrust of a motor, or over the mass, with error and unit: of all methods, else of its own fit."""
    known = headlines(parameters).get("thrust over mass")
    if known is not None:
        return *known[:2], bare_unit(known[2])
    if thrust is None or not thrust.common.determined:
        return None
    if thrust.common.newton is not None:
        return thrust.common.newton, thrust.common.newton_sigma, "N"
    return thrust.common.per_mass, thrust.common.sigma, "m/s²"


def thrust_conditions(thrust: ThrustModel) -> str:
    """Report at which voltage and in which air thrust coefficients hold."""
    voltage = thrust.reference_voltage
    at = "at the unknown voltage of the flight" if voltage is None else f"at {voltage:.1f} V"
    return f"{at}, in standard sea-level air"


def first_reason(numbers: FlightReport) -> str:
    """Return the first reason why a flight has no validated model."""
    reasons = [*numbers.missing.values(), *(result.missing for result in numbers.models)]
    return next((str(reason) for reason in reasons if reason), "no model")


def alike(reasons: Sequence[str]) -> dict[str, list[int]]:
    """Gather reasons that differ in numbers only, with their places, the most frequent first.

    ``only 7 s`` and ``only 18 s`` are ``only 7–18 s``.
    """
    places: dict[str, list[int]] = {}
    for place, reason in enumerate(reasons):
        places.setdefault(_NUMBER.sub("0", reason), []).append(place)
    merged = {}
    for same in sorted(places.values(), key=len, reverse=True):
        numbers = zip(*(_NUMBER.findall(reasons[place]) for place in same), strict=True)
        ranges = ["–".join(dict.fromkeys((min(number, key=float), max(number, key=float)))) for number in numbers]
        words = _NUMBER.split(reasons[same[0]])
        merged["".join(f"{word}{span}" for word, span in zip(words, [*ranges, ""], strict=True))] = same
    return merged


def not_used(numbers: FleetReport) -> dict[str, tuple[LeftOut, ...]]:
    """Return what was found but not used, by what it is called."""
    return {
        "Passed over": numbers.passed_over,
        "Copies, analysed once": numbers.duplicates,
        "No longer there, but kept from earlier runs": numbers.removed,
    }


def left_out(numbers: FleetReport) -> list[str]:
    """Name in a sentence for each kind what was found but not used, gathered by reason."""
    sentences = []
    for words, kind in not_used(numbers).items():
        by_reason: dict[str, list[str]] = {}
        for unused in kind:
            by_reason.setdefault(unused.reason, []).append(unused.file)
        parts = [f"{listed(files, MOST_NAMED)} ({reason})" for reason, files in by_reason.items()]
        if len(parts) > MOST_NAMED:  # every copy has a reason of its own
            parts = [*parts[:MOST_NAMED], f"and {len(parts) - MOST_NAMED} more"]
        if parts:
            sentences.append(f"{words}: {'; '.join(parts)}.")
    return sentences
