"""Which logs are of the same craft, and which are two recordings of the same flight."""

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, timedelta

import numpy as np
import pymap3d
from numpy.typing import NDArray

from logparse import Vehicle
from pipeline.results import FlightResult

#: Rate-loop gains, by their names of all ages: tuned for each craft, so they tell crafts apart where no board id does.
GAINS = ("ATC_RAT_RLL_P", "ATC_RAT_PIT_P", "ATC_RAT_YAW_P", "RATE_RLL_P", "RATE_PIT_P", "RATE_YAW_P")

#: Two recordings of one flight agree this well in position, m: GPS errors and a second of clock error at cruise.
SAME_PLACE = 20.0


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

    Only flights with an experiment and a known position count, and of two recordings of one flight only the first
    (see `same_flight`).
    """
    crafts: dict[str, list[FlightResult]] = {}
    # On-board recordings first: they hold more samples than telemetry of the same flight.
    usable = sorted(
        (flight for flight in flights if flight.experiment is not None and flight.position_known),
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

    They have the same content, or the same frame was in the air at the same time and place. A copy among the flights
    that judge a model would make it look better than it is. Time alone does not tell: simulators fly several craft at
    once, and faster than the clock.
    """
    if a.log.sha256 == b.log.sha256:
        return True
    if a.log.vehicle.frame_class != b.log.vehicle.frame_class:
        return False
    spans = [span for span in (_time_of_day(a), _time_of_day(b)) if span is not None]
    if len(spans) < 2:
        return False
    start, stop = max(start for start, _ in spans), min(stop for _, stop in spans)
    if stop - start <= 0.5 * min(stop - start for start, stop in spans):
        return False
    times = [start + (stop - start) * part for part in np.linspace(0.0, 1.0, 20)]
    tracks = [track for track in (_places(a, times), _places(b, times)) if track is not None]
    return len(tracks) < 2 or float(np.median(np.linalg.norm(tracks[0] - tracks[1], axis=1))) < SAME_PLACE


def _time_of_day(result: FlightResult) -> tuple[datetime, datetime] | None:
    """When the flight began and ended, UTC; None where the log does not tell."""
    if result.log.start_utc is None or result.flight is None:
        return None
    start, stop = (result.log.start_utc + timedelta(seconds=t) for t in (result.flight.start, result.flight.stop))
    return start, stop


def _places(result: FlightResult, times: Sequence[datetime]) -> NDArray[np.float64] | None:
    """Earth-centred positions at given times, m, shape (n, 3); None where the trajectory has no place on earth."""
    if result.trajectory is None or result.log.start_utc is None:
        return None
    origin, states = result.trajectory.origin, result.trajectory.states
    if not np.isfinite([origin.lat, origin.lon, origin.alt]).all():
        return None
    t = [(time - result.log.start_utc).total_seconds() for time in times]
    ned = (np.interp(t, states.index.to_numpy(), states[name].to_numpy()) for name in ("p_n", "p_e", "p_d"))
    return np.column_stack(pymap3d.ned2ecef(*ned, origin.lat, origin.lon, origin.alt, deg=False))


def craft_name(vehicle: Vehicle) -> str:
    """Name a craft for people, such as ``"ArduCopter octa plus"``."""
    return (
        " ".join(
            part for part in (vehicle.firmware or vehicle.autopilot, vehicle.frame_class, vehicle.frame_type) if part
        )
        or "craft"
    )
