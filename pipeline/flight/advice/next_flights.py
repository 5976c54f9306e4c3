"""How to log and fly better next time: a short list for this craft, most useful first, each with reason and gain.

Nothing here is general wisdom: every piece of advice follows from something that these flights lacked, names them,
and says in numbers what changes. Where nothing was lacking, the list is empty.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from core.quantity import joined
from logparse.craft.log_settings import TELEMETRY, Need, bits_of
from pipeline.flight.advice.flying import flying
from pipeline.flight.advice.log_settings import logging
from pipeline.flight.craft import in_order
from pipeline.flight.flight_parameters import WIND_AS_DRAG
from pipeline.flight.summary import flight_entry
from pipeline.results.answer import Advice
from pipeline.results.failure import Failure
from sysid.frequency.axes import SID_AXES

if TYPE_CHECKING:
    from pipeline.results.coverage import Envelope
    from pipeline.results.drift import Drift
    from pipeline.results.entry import FlightEntry
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
    told = {row.parameter for flight in flights for row in flight.parameters}
    if parameters is not None:
        told |= _determined(parameters)
    found = [*logging(flights, told), *flying(flights, envelope, told), *_craft(flights, drift)]
    return tuple(sorted(found, key=lambda advice: advice.rank)[:MOST])


def for_flight(result: FlightResult) -> tuple[Advice, ...]:
    """Advise on repeating one flight better; nothing of a craft for which there are no models."""
    if result.log.vehicle.other_craft:
        return ()
    found = for_craft([flight_entry(result)])
    return tuple(sorted([*found, *_margins(result)], key=lambda advice: advice.rank)[:MOST])


def _determined(parameters: PhysicalParameters) -> set[str]:
    """Name what several flights together tell, by a method that does not take wind for drag."""
    table = parameters.table[parameters.table["value"].notna()]
    return {str(name) for name, method in table.index if (name, method) != WIND_AS_DRAG}


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
    if flights and all(any(found.evidence.get("what") == "mass" for found in each.findings) for each in flights):
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
    at_mixer = {name: number for number, (name, mixer) in SID_AXES.items() if mixer}
    return joined([f"{at_mixer[axis.axis]} for {axis.axis}" for axis in axes])


def _logged(result: FlightResult, *needs: Need) -> str:
    """Name the bits of LOG_BITMASK that the flight must be logged with; empty for telemetry and unknown firmware."""
    known = bits_of(result.log.vehicle)
    bits = [str(known[need]) for need in needs if need in known]
    if result.log.format in TELEMETRY or not bits:
        return ""
    parameter = "SDLOG_PROFILE" if result.log.vehicle.autopilot == "PX4" else "LOG_BITMASK"
    return f", with {joined(list(dict.fromkeys(bits)))} of {parameter} set"


def _has_systemid(result: FlightResult) -> bool:
    """Return whether the firmware has mode SYSTEMID: ArduCopter since 4.0; unknown versions count as recent."""
    vehicle = result.log.vehicle
    major = (vehicle.version or "4").partition(".")[0]
    return vehicle.firmware == "ArduCopter" and (not major.isdecimal() or int(major) >= 4)
