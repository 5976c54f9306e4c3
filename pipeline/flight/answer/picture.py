"""The plot that matters most of a flight, and the model that it shows."""

from __future__ import annotations

from pipeline.flight.answer.healthy import during, led_to
from pipeline.flight.purposes import uses_of
from pipeline.results.answer import Picture
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.span import Span
from pipeline.results.verdict import Trust

#: Time shown before and after an event, s.
_BEFORE, _AFTER = 8.0, 6.0


def picture_of(result: FlightResult, model: str) -> tuple[Picture, Span | None]:
    """Choose the plot that matters most: what failed, else how the models predict, else how the attitude followed."""
    health = present(result.health)
    signals = None if health is None else health.signals
    event = health.cause if health is not None else None
    if event is None and health is not None and not isinstance(result.flight, Failure):
        event = next((each for each in during(health, result.flight) if str(each.severity) == "error"), None)
    if event is not None and health is not None and not isinstance(result.flight, Failure):
        first = led_to(event, health) or event
        around = Span(max(first.t - _BEFORE, result.flight.start), event.t + _AFTER)
        by_motors = first.id in ("motor-loss", "motor-at-limit") or not _asked(result)
        if by_motors and result.motors is not None and result.motors.shape[1]:
            return Picture.MOTORS, around
        if signals is not None and signals.attitude:
            return Picture.ATTITUDE, around
    if model:
        return Picture.PREDICTION, None
    if signals is not None and signals.attitude:
        return Picture.ATTITUDE, None
    return Picture.ALTITUDE, None


def shown_model(result: FlightResult) -> str:
    """Choose the model whose free run is shown: of those that follow the flight, the one that predicts furthest."""
    best, furthest = "", -1.0
    for each in result.models:
        uses = uses_of(present(each.validation), present(each.model))
        reach = uses.prediction.horizon_s or 0.0
        if each.predictions and uses.free_run.trust in (Trust.YES, Trust.LIMITED) and reach > furthest:
            best, furthest = each.key, reach
    return best


def _asked(result: FlightResult) -> bool:
    """Return whether asked and flown attitude are known."""
    health = present(result.health)
    return health is not None and health.signals is not None and bool(health.signals.attitude)
