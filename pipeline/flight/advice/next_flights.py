"""How to log and fly better next time: a short list for this craft, most useful first, each with reason and gain.

Nothing here is general wisdom: every piece of advice follows from something that these flights lacked, names them,
and says in numbers what changes. Where nothing was lacking, the list is empty.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from pipeline.flight.advice.flying import flying
from pipeline.flight.advice.log_settings import logging
from pipeline.flight.advice.turning import turning
from pipeline.flight.craft import in_order
from pipeline.flight.flight_parameters import WIND_AS_DRAG
from pipeline.flight.summary import summarise_flight
from pipeline.results.advice import Advice, having

if TYPE_CHECKING:
    from pipeline.results.drift import Drift
    from pipeline.results.entry import FlightSummary
    from pipeline.results.envelope import Envelope
    from pipeline.results.flight import FlightResult
    from sysid import PhysicalParameters

#: Longest list: who gets more does nothing.
MOST = 8


def for_craft(
    entries: Sequence[FlightSummary],
    envelope: Envelope | None = None,
    drift: Drift | None = None,
    parameters: PhysicalParameters | None = None,
) -> tuple[Advice, ...]:
    """Advise on the next flights of a craft.

    Returns
    -------
    tuple of Advice
        Most useful first, at most `MOST`.
    """
    flights = in_order(entries)
    told = {row.parameter for flight in flights for row in flight.parameters}
    if parameters is not None:
        told |= _determined(parameters)
    found = [*logging(flights, told), *flying(flights, envelope, told), *_craft(flights, drift)]
    return tuple(sorted(found, key=lambda advice: advice.rank)[:MOST])


def for_flight(result: FlightResult) -> tuple[Advice, ...]:
    """Advise on repeating one flight better."""
    found = for_craft([summarise_flight(result)])
    further = turning(result, [advice.id for advice in found])
    return tuple(sorted([*found, *further], key=lambda advice: advice.rank)[:MOST])


def _determined(parameters: PhysicalParameters) -> set[str]:
    """Name what several flights together tell, by a method that does not take wind for drag."""
    table = parameters.table[parameters.table["value"].notna()]
    return {str(name) for name, method in table.index if (name, method) != WIND_AS_DRAG}


def _craft(flights: Sequence[FlightSummary], drift: Drift | None) -> Iterator[Advice]:
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
    if flights and len(having(flights, "mass-unknown")) == len(flights):
        yield Advice(
            id="weigh-the-craft",
            rank=40,
            do="Weigh the craft with its battery and give the mass (--mass)",
            why="motion alone tells thrust, drag and inertia per unit of mass",
            gain="thrust in newtons and inertia in kg m² (with the arm), comparable with a test stand",
        )
