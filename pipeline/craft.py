"""Which logs are of the same craft, and which are two recordings of the same flight."""

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, timedelta

from logparse import Vehicle
from pipeline.results import FlightResult

#: Rate-loop gains, by their names of all ages: tuned for each craft, so they tell crafts apart where no board id does.
GAINS = ("ATC_RAT_RLL_P", "ATC_RAT_PIT_P", "ATC_RAT_YAW_P", "RATE_RLL_P", "RATE_PIT_P", "RATE_YAW_P")


def fingerprint(vehicle: Vehicle, parameters: Mapping[str, float], *, simulated: bool) -> str:
    """Describe a craft such that two logs of one craft have equal descriptions.

    What counts is how the craft is built and how commands become PWM. The board's id tells apart twins; where
    it was not logged, and in simulators (which make up an id per process), the rate-loop gains must serve.
    """
    built = (
        vehicle.autopilot,
        vehicle.frame_class,
        vehicle.frame_type,
        len(vehicle.motors),
        vehicle.pwm_min,
        vehicle.pwm_max,
        vehicle.spin_arm,
        vehicle.spin_min,
        vehicle.spin_max,
        vehicle.thrust_expo,
        vehicle.battery_voltage_max,
    )
    if vehicle.board_id and not simulated:
        return "|".join(str(part) for part in (*built, vehicle.board_id))
    gains = (f"{name}={parameters[name]:.5g}" for name in GAINS if name in parameters)
    return "|".join(str(part) for part in (*built, *gains))


def by_craft(flights: Iterable[FlightResult]) -> list[tuple[FlightResult, ...]]:
    """Gather the flights that a joint fit can use, one tuple for each craft, in the order given.

    Only flights with an experiment count, and of two recordings of one flight only the first (see `same_flight`).
    """
    crafts: dict[str, list[FlightResult]] = {}
    # On-board recordings first: they hold more samples than telemetry of the same flight.
    usable = sorted(
        (flight for flight in flights if flight.experiment is not None),
        key=lambda flight: flight.log.format in ("tlog", "mavlink-raw"),
    )
    kept: list[FlightResult] = []
    for flight in usable:
        if any(same_flight(flight, other) for other in kept):
            continue
        kept.append(flight)
        crafts.setdefault(flight.log.craft, []).append(flight)
    return [tuple(sorted(craft, key=lambda flight: flight.name)) for craft in crafts.values()]


def same_flight(a: FlightResult, b: FlightResult) -> bool:
    """Tell whether two logs recorded the same flight, such as DataFlash on board and telemetry on the ground.

    They have the same content, or the same frame in the air at the same time of day. A copy among the flights that
    judge a model would make it look better than it is.
    """
    if a.log.sha256 == b.log.sha256:
        return True
    if a.log.vehicle.frame_class != b.log.vehicle.frame_class:
        return False
    spans = [span for span in (_time_of_day(a), _time_of_day(b)) if span is not None]
    if len(spans) < 2:
        return False
    overlap = min(stop for _, stop in spans) - max(start for start, _ in spans)
    return overlap > 0.5 * min(stop - start for start, stop in spans)


def _time_of_day(result: FlightResult) -> tuple[datetime, datetime] | None:
    """When the flight began and ended, UTC; None where the log does not tell."""
    if result.log.start_utc is None or result.flight is None:
        return None
    start, stop = (result.log.start_utc + timedelta(seconds=t) for t in (result.flight.start, result.flight.stop))
    return start, stop


def craft_name(flights: Sequence[FlightResult]) -> str:
    """Name a craft for people, such as ``"ArduCopter octa plus"``."""
    vehicle = flights[0].log.vehicle
    return " ".join(part for part in (vehicle.autopilot, vehicle.frame_class, vehicle.frame_type) if part) or "craft"
