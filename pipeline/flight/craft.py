"""Which logs are of the same craft, what changed about it, and which are two recordings of the same flight."""

from __future__ import annotations

import math
import re
from bisect import insort
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, timedelta
from itertools import pairwise
from typing import TYPE_CHECKING, TypeVar

from core.lazy import lazy
from core.summary import listed
from logparse import Finding, Severity
from logparse.formats import TELEMETRY

if TYPE_CHECKING:
    import numpy as np
    import pymap3d
    from numpy.typing import NDArray

    from logparse import Vehicle
    from pipeline.results.fleet import FlightEntry
else:
    # Grouping a folder that did not change needs none of them.
    np, pymap3d = lazy("numpy"), lazy("pymap3d")

Flown = TypeVar("Flown", bound="FlightEntry")

#: Rate-loop gains, by their names of all ages: tuned for each craft, so they tell crafts apart where no board id does.
GAINS = ("ATC_RAT_RLL_P", "ATC_RAT_PIT_P", "ATC_RAT_YAW_P", "RATE_RLL_P", "RATE_PIT_P", "RATE_YAW_P")

#: Parameters of the loops that hold attitude, height and position, of ArduCopter's ages and of PX4. What the
#: autopilot learns in flight (MOT_THST_HOVER, INS offsets) and what a mission sets (WPNAV_, WP_) is not among them.
_TUNE = re.compile(
    r"(ATC_(RAT|ANG|ACC|INPUT_TC|SLEW)|RATE_(RLL|PIT|YAW)|STB_(RLL|PIT|YAW)|PSC_|POS_(XY|Z)|VEL_(XY|Z)|ACCEL_Z_"
    r"|THR_(ACCEL|RATE|ALT)_|LOITER_LAT|HLD_LAT|INS_(GYRO_FILTER|HNTCH|HNTC2)|MC_(ROLL|PITCH|YAW)|MPC_(XY|Z)_(P|VEL))"
)

#: What the gains of a craft are called beside its firmware in a message.
_FIRMWARE = "firmware"

#: Differences up to which flights without a board's id may still be of one craft: more are not made between flights.
_MAY_BE_ONE = 3

#: Two recordings of one flight agree this well in position, m: GPS errors and a second of clock error at cruise.
SAME_PLACE = 20.0

#: A copy of what was written on board begins or ends its flight at the same count of the boot clock, s: simulators fly
#: a craft from one place at one time of day again and again (`methodic_quad15_*`, a metre or two apart).
_COUNT = 1e-4

#: Instants at which two tracks are compared.
_INSTANTS = 20


def build_of(vehicle: Vehicle) -> dict[str, str | float | None]:
    """List how a craft is built and how commands become PWM: what open-loop models of its motion depend on."""
    built: dict[str, str | float | None] = {
        "autopilot": vehicle.autopilot,
        "frame class": vehicle.frame_class,
        "frame type": vehicle.frame_type,
        "motors": len(vehicle.motors),
    }
    return built | {
        name: getattr(vehicle, name)
        for name in ("pwm_min", "pwm_max", "spin_arm", "spin_min", "spin_max", "thrust_expo", "battery_voltage_max")
    }


def tune_of(vehicle: Vehicle, parameters: Mapping[str, float]) -> dict[str, str | float]:
    """List the gains and filters of a craft's loops, and its firmware: what closed-loop models depend on."""
    tune: dict[str, str | float] = {
        name: float(value) for name, value in sorted(parameters.items()) if _TUNE.match(name) and math.isfinite(value)
    }
    if vehicle.version:
        tune[_FIRMWARE] = f"{vehicle.firmware or vehicle.autopilot or ''} {vehicle.version}".strip()
    return tune


def fingerprint(vehicle: Vehicle, parameters: Mapping[str, float], *, simulated: bool) -> str:
    """Describe a craft such that two logs of one craft have equal descriptions.

    What counts is how the craft is built and how commands become PWM. The board's id tells apart twins; where
    it was not logged, and in simulators (which make up an id per process), the rate-loop gains must serve.
    """
    built = build_of(vehicle).values()
    if vehicle.board_id and not simulated:
        return "|".join(str(part) for part in (*built, vehicle.board_id))
    gains = (f"{name}={parameters[name]:.5g}" for name in GAINS if name in parameters)
    return "|".join(str(part) for part in (*built, *gains))


def craft_name(vehicle: Vehicle) -> str:
    """Name a craft for people, such as ``"ArduCopter octa plus"``."""
    frame = [part for part in (vehicle.frame_class, vehicle.frame_type) if part] or ["of unknown frame"]
    return " ".join((vehicle.firmware or vehicle.autopilot or "craft", *frame))


def by_craft(flights: Iterable[FlightEntry]) -> list[tuple[FlightEntry, ...]]:
    """Gather the flights that a joint fit can use, one tuple for each craft, in the order given.

    Only flights with an experiment and a known position count, and of several recordings of one flight only one
    (see `same_flight`): the on-board recording, which holds more samples than telemetry of the same flight.
    """
    usable = [flight for flight in flights if flight.experiments and flight.position_known]
    crafts: dict[str, list[FlightEntry]] = {}
    for flight in once(usable):
        crafts.setdefault(flight.craft, []).append(flight)
    return [tuple(sorted(craft, key=lambda flight: flight.name)) for craft in crafts.values()]


def same_flight(a: FlightEntry, b: FlightEntry) -> bool:
    """Return whether two logs recorded the same flight, such as DataFlash on board and telemetry on the ground.

    They have the same content, or the same frame was in the air at the same time and place. A copy among the flights
    that judge a model would make it look better than it is. Time alone does not tell: simulators fly several craft at
    once, and faster than the clock.
    """
    if a.sha256 == b.sha256:
        return a.number == b.number
    if a.frame_class != b.frame_class or (_on_board(a) and _on_board(b) and not _same_clock(a, b)):
        return False
    spans = [span for span in (_time_of_day(a), _time_of_day(b)) if span is not None]
    if len(spans) < 2:
        return False
    start, stop = max(start for start, _ in spans), min(stop for _, stop in spans)
    if stop - start <= 0.5 * min(stop - start for start, stop in spans):
        return False
    times = [start + (stop - start) * (k / (_INSTANTS - 1)) for k in range(_INSTANTS)]
    return _near(a, b, times)


def _on_board(flight: FlightEntry) -> bool:
    return flight.format not in TELEMETRY


def _same_clock(a: FlightEntry, b: FlightEntry) -> bool:
    """Return whether two flights begin or end at the same count of the boot clock; also where one of them is none."""
    if a.flight is None or b.flight is None:
        return True
    return min(abs(a.flight.start - b.flight.start), abs(a.flight.stop - b.flight.stop)) < _COUNT


def _near(a: FlightEntry, b: FlightEntry, times: Sequence[datetime]) -> bool:
    """Return whether two tracks are at one place at the same times; also where one of them does not tell."""
    tracks = [track for track in (_places(a, times), _places(b, times)) if track is not None]
    if len(tracks) < 2:
        return True
    return float(np.median(np.linalg.norm(tracks[0] - tracks[1], axis=1))) < SAME_PLACE


def changes(flights: Sequence[FlightEntry]) -> tuple[Finding, ...]:
    """Report what was changed about one craft between its flights: gains, filters, firmware."""
    ordered = in_order(flights)
    return tuple(
        Finding(
            "tune-changed",
            Severity.INFO,
            f"between {before.name} and {after.name} the craft was changed: {differences}; "
            + (
                "its firmware is another, so that gains and filters may mean something else"
                if changed == {_FIRMWARE}
                else "models of craft and autopilot together mix the two, those of the craft alone do not"
            ),
            "fit the flights before and after it apart (--training, --validation) to see what it did",
            {"before": before.name, "after": after.name, "changed": len(changed)},
        )
        for before, after in pairwise(ordered)
        if (changed := _changed(before.tune, after.tune))
        and (differences := _differences(before.tune, after.tune, changed))
    )


def kept_apart(crafts: Sequence[Sequence[FlightEntry]]) -> dict[str, tuple[Finding, ...]]:
    """Explain, by fingerprint, why flights that look like those of one craft are not analysed together.

    That is one finding for each other group of the same board, or, where no board is known, of the same frame and with
    few differences.
    """
    apart: dict[str, tuple[Finding, ...]] = {}
    for craft in crafts:
        first = craft[0]
        others = [other[0] for other in crafts if other[0] is not first and _looks_alike(first, other[0])]
        findings = []
        for other in others:
            mine, theirs = (dict(flight.build) | _gains(flight) for flight in (first, other))
            changed = _changed(mine, theirs)
            if not changed or (not first.board and len(changed) > _MAY_BE_ONE):
                continue
            board = "the same board" if first.board else "the same frame"
            findings.append(
                Finding(
                    "flights-not-alike",
                    Severity.INFO,
                    f"flights such as {other.name} are of {board} but not analysed together with these: "
                    f"{_differences(mine, theirs, changed)} (here → there)",
                    "where it is the same craft, set the parameters alike before the next flights",
                    {"other": other.name, "changed": len(changed)},
                )
            )
        apart[first.craft] = tuple(findings)
    return apart


def in_order(flights: Iterable[Flown]) -> list[Flown]:
    """Sort flights by when they began; by name, where one of them does not tell."""
    flights = list(flights)
    if any(flight.start_utc is None for flight in flights):
        return sorted(flights, key=lambda flight: flight.name)
    return sorted(flights, key=lambda flight: (str(took_off(flight)), flight.name))


def took_off(flight: FlightEntry) -> datetime | None:
    """Return when the flight began, UTC."""
    if flight.start_utc is None:
        return None
    return flight.start_utc + timedelta(seconds=flight.flight.start if flight.flight else 0.0)


def _looks_alike(a: FlightEntry, b: FlightEntry) -> bool:
    if a.board or b.board:
        return a.board == b.board
    return a.frame_class is not None and a.frame_class == b.frame_class


def _gains(flight: FlightEntry) -> dict[str, str | float | None]:
    return {} if flight.board else {name: flight.tune[name] for name in GAINS if name in flight.tune}


def _changed(a: Mapping[str, object], b: Mapping[str, object]) -> set[str]:
    """Names whose values differ; what only one of two logs tells did not change (logs can lack parameters)."""
    return {name for name in a.keys() & b.keys() if a[name] != b[name]}


def _differences(a: Mapping[str, object], b: Mapping[str, object], changed: Iterable[str]) -> str:
    return listed([f"{name} {_text(a[name])} → {_text(b[name])}" for name in sorted(changed)], 4)


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def once(flights: Sequence[FlightEntry]) -> list[FlightEntry]:
    """Keep one recording of each flight, in the order given: the first of those on board, else the first.

    Flights are swept in the order of their beginning, so that only those that overlap in time are compared.
    """
    recordings = [{k} for k in range(len(flights))]

    def join(a: int, b: int) -> None:
        if recordings[a] is not recordings[b]:
            recordings[a] |= recordings[b]
            for k in recordings[b]:
                recordings[k] = recordings[a]

    first: dict[tuple[str, int], int] = {}
    for k, flight in enumerate(flights):
        join(first.setdefault((flight.sha256, flight.number), k), k)
    spans = [(*span, k) for k, flight in enumerate(flights) if (span := _time_of_day(flight)) is not None]
    in_the_air: list[tuple[datetime, int]] = []
    for start, stop, k in sorted(spans):
        while in_the_air and in_the_air[0][0] <= start:
            del in_the_air[0]
        for _, other in in_the_air:
            if same_flight(flights[other], flights[k]):
                join(other, k)
        insort(in_the_air, (stop, k))
    kept = {min(group, key=lambda k: (not _on_board(flights[k]), k)) for group in recordings}
    return [flight for k, flight in enumerate(flights) if k in kept]


def _time_of_day(flight: FlightEntry) -> tuple[datetime, datetime] | None:
    """When the flight began and ended, UTC; None where the log does not tell."""
    if flight.start_utc is None or flight.flight is None:
        return None
    start, stop = (flight.start_utc + timedelta(seconds=t) for t in (flight.flight.start, flight.flight.stop))
    return start, stop


def _places(flight: FlightEntry, times: Sequence[datetime]) -> NDArray[np.float64] | None:
    """Earth-centred positions at given times, m, shape (n, 3); None where the track has no place on earth."""
    if flight.origin is None or flight.start_utc is None or not flight.track:
        return None
    t = [(time - flight.start_utc).total_seconds() for time in times]
    known, *ned = np.array(flight.track).T
    north, east, down = (np.interp(t, known, part) for part in ned)
    return np.column_stack(pymap3d.ned2ecef(north, east, down, *flight.origin, deg=False))
