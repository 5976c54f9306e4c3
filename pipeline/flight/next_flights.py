"""How to log and fly better next time: a short list for this craft, most useful first, each with reason and gain.

Nothing here is general wisdom: every piece of advice follows from something that these flights lacked, names them,
and says in numbers what changes. Where nothing was lacking, the list is empty.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING

from core.quantity import joined
from core.summary import listed
from logparse.craft.log_settings import Need, bits_of
from logparse.formats import TELEMETRY
from pipeline.flight.craft import in_order
from pipeline.flight.logging_advice import logging, names_of
from pipeline.flight.summary import WIND_AS_DRAG, flight_entry
from pipeline.flight.training import hardly_moves, position_good, position_sigma
from pipeline.results.answer import Advice
from pipeline.results.failure import Failure
from sysid.frequency.axes import MIXER_CHIRPS
from sysid.rigid_body.model_record import LIGHT, TURBULENCE

if TYPE_CHECKING:
    from pipeline.results.coverage import Envelope
    from pipeline.results.drift import Drift
    from pipeline.results.fleet import FlightEntry
    from pipeline.results.flight import FlightResult
    from pipeline.results.rotation import AxisRotation
    from sysid import PhysicalParameters


#: Longest list: who gets more does nothing.
MOST = 8


def for_craft(
    entries: Sequence[FlightEntry],
    envelope: Envelope | None = None,
    drift: Drift | None = None,
    parameters: PhysicalParameters | None = None,
) -> tuple[Advice, ...]:
    """Advise on the next flights of a craft."""
    flights = in_order(entries)
    determined = {row.parameter for flight in flights for row in flight.parameters}
    if parameters is not None:
        # By a method that does not take wind for drag.
        known = parameters.table[parameters.table["value"].notna()]
        determined |= {str(name) for name, method in known.index if (name, method) != WIND_AS_DRAG}
    recommended = [*logging(flights, determined), *flying(flights, envelope, determined), *_craft(flights, drift)]
    return tuple(sorted(recommended, key=lambda advice: advice.rank)[:MOST])


def for_flight(result: FlightResult) -> tuple[Advice, ...]:
    """Advise on repeating one flight better; nothing of a craft for which there are no models."""
    if result.vehicle.other_craft:
        return ()
    recommended = for_craft([flight_entry(result)])
    return tuple(sorted([*recommended, *_margins(result)], key=lambda advice: advice.rank)[:MOST])


def _craft(flights: Sequence[FlightEntry], drift: Drift | None) -> Iterator[Advice]:
    """Advise on the craft itself: what changed about it, and its mass."""
    for finding in drift.findings if drift is not None else ():
        yield Advice(
            id=f"look-at-{finding.id}",
            rank=3 if finding.id == "motor-weakening" else 16,
            do=finding.advice[:1].upper() + finding.advice[1:] if finding.advice else "Look for what changed",
            why=finding.reason,
            gain="a model of one craft instead of a mean over two, and a motor that does not fail in flight"
            if finding.id == "motor-weakening"
            else "a model of one craft instead of a mean over two",
        )
    if flights and all(
        any(finding.evidence.get("what") == "mass" for finding in flight.findings) for flight in flights
    ):
        yield Advice(
            id="weigh-the-craft",
            rank=40,
            do="Weigh the craft with its battery and give the mass (--mass)",
            why="motion alone tells thrust, drag and inertia per unit of mass",
            gain="thrust in newtons and inertia in kg m² (with the arm), comparable with a test stand",
        )


def _margins(result: FlightResult) -> Iterator[Advice]:
    """Ask for chirps where margins of loops are not measured."""
    if isinstance(result.rotation, Failure):
        return
    loopless = [axis for axis in result.rotation.axes if axis.loop is None or axis.loop.ordinary]
    if loopless and _has_systemid(result):
        yield Advice(
            id="chirps-for-margins",
            rank=26,
            do="Fly mode SYSTEMID for two minutes with a chirp at the mixer on one axis after the other "
            f"(SID_AXIS {_chirps(loopless)}; rotorid design --for rates writes the parameters)"
            + _logged(result, Need.FAST_RATES, Need.PID),
            why=f"margins of the {joined([axis.axis for axis in loopless])} loop{'s' if len(loopless) > 1 else ''} "
            "are not measured: ordinary flying shows them through the craft's model at most",
            gain="gain and phase margins with errors, from which rotorid tune proposes gains",
        )


def _chirps(axes: list[AxisRotation]) -> str:
    return joined([f"{MIXER_CHIRPS[axis.axis]} for {axis.axis}" for axis in axes])


def _logged(result: FlightResult, *needs: Need) -> str:
    """Name the bits of LOG_BITMASK that the flight must be logged with; empty for telemetry and unknown firmware."""
    known = bits_of(result.vehicle)
    bits = [str(known[need]) for need in needs if need in known]
    if result.log.format in TELEMETRY or not bits:
        return ""
    parameter = "SDLOG_PROFILE" if result.vehicle.autopilot == "PX4" else "LOG_BITMASK"
    return f", with {joined(list(dict.fromkeys(bits)))} of {parameter} set"


def _has_systemid(result: FlightResult) -> bool:
    """Return whether the firmware has mode SYSTEMID: ArduCopter since 4.0; unknown versions count as recent."""
    vehicle = result.vehicle
    major = (vehicle.version or "4").partition(".")[0]
    return vehicle.firmware == "ArduCopter" and (not major.isdecimal() or int(major) >= 4)


#: Relative error at which drag is worth having; the speeds that give it follow from the gusts.
DRAG_ERROR = 0.15

#: Slowest and fastest legs that are asked for, m/s: slower ones are hover, faster ones need more room than most have.
SLOW_LEG, FAST_LEG = 3, 12

#: Standard error of the wind above which turns on the spot pay, m/s.
WIND_ERROR = 0.3

#: Sectors of 45 degrees that turns should reach: a quarter turn to either side.
FEW_HEADINGS = 3

#: Flights of one craft that make a joint model: 4 leave the error on unseen ones 12 % above that of the best model.
ENOUGH = 4

#: Either tells that drag is determined.
_DRAG = frozenset(("linear drag over mass", "quadratic drag over mass"))

#: What models of the motion tell of an axis.
_TELLS = {
    "roll": "roll inertia over mass and arm",
    "pitch": "pitch inertia over mass and arm",
    "yaw": "yaw torque over inertia",
}


def flying(flights: Sequence[FlightEntry], envelope: Envelope | None, determined: Collection[str]) -> Iterator[Advice]:
    """Advise on flying."""
    # Their position is too uncertain to say anything of their speeds.
    lost = [
        flight for flight in flights if flight.coverage and (not flight.position_known or not position_good(flight))
    ]
    measured = [flight for flight in flights if flight.coverage and flight not in lost]
    yield from _repeat(flights, [flight for flight in lost if _under_the_sky(flight)])
    yield from _drag(measured, len(flights), determined)
    yield from _turns(measured, len(flights), determined)
    yield from _axes(len(flights), determined)
    if envelope is not None:
        yield from _extrapolated(envelope)
        yield from _more(envelope)


def _under_the_sky(flight: FlightEntry) -> bool:
    """Return whether a fix could have been had: a receiver without one satellite is indoors, for a reason."""
    gps = None if flight.account is None else flight.account.gps
    return gps is None or gps.satellites_median != 0


def _repeat(flights: Sequence[FlightEntry], lost: Sequence[FlightEntry]) -> Iterator[Advice]:
    """Name the flights that gave no position or hardly moved."""
    if lost:
        sigmas = [sigma for flight in lost if (sigma := position_sigma(flight)) is not None]
        hdop = [
            gps.hdop
            for flight in lost
            if flight.account is not None and (gps := flight.account.gps) is not None and gps.hdop is not None
        ]
        yield Advice(
            id="repeat-with-gps",
            rank=2,
            do=f"Repeat {names_of(lost, len(flights))} with a good fix before take-off, under open sky",
            why=(
                f"the horizontal position is uncertain by up to {max(sigmas):.0f} m"
                if sigmas
                else "how uncertain the horizontal position is was not determined"
            )
            + (f" (dilution of precision {max(hdop):.1f})" if hdop else " (no GPS in the log)"),
            gain="they can train and judge models of the motion, which they cannot now",
            flights=tuple(flight.name for flight in lost),
        )
    still = [flight for flight in flights if flight not in lost and position_good(flight) and hardly_moves(flight)]
    if still:
        yield Advice(
            id="repeat-with-movement",
            rank=20,
            do=f"Repeat {names_of(still, len(flights))} with legs of 20 m to and fro and height changes of 5 m",
            why="they hardly move: what they show is the noise of the estimate",
            gain="they can train models; a hover tells thrust and nothing else",
            flights=tuple(flight.name for flight in still),
        )


def _drag(flights: Sequence[FlightEntry], total: int, determined: Collection[str]) -> Iterator[Advice]:
    """Recommend a speed at which drag stands out from unmeasured wind."""
    if not flights or _DRAG & set(determined):
        return
    windy = {
        flight.name: known for flight in flights if (known := flight.coverage) is not None and known.wind is not None
    }
    if not windy:
        return
    speeds = [known.excitation.speed_std for known in windy.values()]
    least = min(math.sqrt(sum(s[axis] ** 2 for s in speeds) / len(speeds)) for axis in (0, 1))
    # Legs to and fro tell the mean wind from drag; what passes for drag then is what the wind does meanwhile.
    wind = statistics.median(known.wind.speed for known in windy.values() if known.wind is not None)
    gusts = TURBULENCE * max(wind, LIGHT)
    needed = min(max(math.ceil(gusts / math.sqrt(DRAG_ERROR)), SLOW_LEG), FAST_LEG)
    if needed <= least:
        return
    yield Advice(
        id="fly-legs-for-drag",
        rank=22,
        do=f"Fly straight legs to and fro at {needed:.0f} m/s or more, 15 s each, along the nose and across it, and "
        "again at half that speed",
        why=f"drag is not determined: along one axis of the craft the speed varied by {least:.2g} m/s only, in a wind "
        f"of about {wind:.2g} m/s that nobody measured",
        gain=f"drag to about {100.0 * DRAG_ERROR:.0f} %, and free runs that hold at speed",
        flights=tuple(windy) if len(windy) < total else (),
    )


def _turns(flights: Sequence[FlightEntry], total: int, determined: Collection[str]) -> Iterator[Advice]:
    """Ask for turns on the spot where wind stays uncertain, though drag is known, and the nose pointed one way."""
    if not _DRAG & set(determined):
        return
    held = [
        flight
        for flight in flights
        if (known := flight.coverage) is not None
        and known.excitation.headings < FEW_HEADINGS
        and known.wind is not None
        and (known.wind.sigma is None or known.wind.sigma > WIND_ERROR)
    ]
    if not held or len(held) <= total // 2:
        return
    sigmas = [
        wind.sigma
        for flight in held
        if flight.coverage is not None and (wind := flight.coverage.wind) is not None and wind.sigma is not None
    ]
    known_to = f"known to {statistics.median(sigmas):.2g} m/s only" if sigmas else "not determined"
    yield Advice(
        id="turn-on-the-spot",
        rank=24,
        do="Turn on the spot by 90° twice in every flight, a few seconds' hover in each direction",
        why=f"in {names_of(held, total)} the nose pointed one way or two; the wind is {known_to}",
        gain="the lean of the thrust is told from the wind: 0.1° of it passes for 0.07 m/s",
        flights=tuple(flight.name for flight in held),
    )


def _axes(total: int, determined: Collection[str]) -> Iterator[Advice]:
    """Ask for stick inputs on axes of which neither inertia nor effectiveness is determined."""
    unknown = [axis for axis, tells in _TELLS.items() if not {tells, f"{axis} effectiveness"} & set(determined)]
    if not unknown or not total:
        return
    names = joined(unknown)
    yield Advice(
        id="fly-sticks",
        rank=25,
        do=f"Fly two minutes of short stick inputs on {names}, from slow to as quick as you can, in STABILIZE or "
        "LOITER in calm air",
        why=f"how {names} answer{'s' if len(unknown) == 1 else ''} the controller is not determined",
        gain="effectiveness, damping and delay of the axis with their errors, no GPS needed",
    )


def _extrapolated(envelope: Envelope) -> Iterator[Advice]:
    """Recommend training flights where held-out flights left the training envelope."""
    flights = [str(finding.evidence["flight"]) for finding in envelope.findings]
    if not flights:
        return
    yield Advice(
        id="train-where-you-fly",
        rank=15,
        do=f"Let {'one of ' if len(flights) > 1 else ''}{listed(flights, 4)} train (--training), or fly a training "
        "flight there",
        why="; ".join(finding.reason for finding in envelope.findings[:3]),
        gain="errors of interpolation instead of extrapolation over that range",
        flights=tuple(flights),
    )


def _more(envelope: Envelope) -> Iterator[Advice]:
    """Ask for more flights where a joint model rests on few."""
    k = len(envelope.training)
    if k == 0 or k >= ENOUGH:
        return
    now, then = (100.0 * (math.sqrt(1.0 + 1.0 / n) - 1.0) for n in (k, ENOUGH))
    yield Advice(
        id="fly-more",
        rank=30,
        do=f"Fly {2 * (ENOUGH - k)} more flights like these, on other days and in other wind",
        why=f"the joint models rest on {k} flight{'s' if k > 1 else ''}",
        gain=f"scatter between flights adds {then:.0f} % instead of {now:.0f} % to the error on unseen ones",
    )
