"""Messages that the autopilot could not write in flight."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from core.findings import Severity
from logparse.events.event import FlightEvent
from logparse.events.stretches import stretches, within
from logparse.flights import Flight


def recording_events(messages: Mapping[str, pd.DataFrame], flights: tuple[Flight, ...]) -> Iterator[FlightEvent]:
    """Yield times at which the logger dropped messages (DSF.Dp counts them).

    Parameters
    ----------
    messages : mapping of str to DataFrame
    flights : tuple of Flight
    """
    if "DSF" not in messages or "Dp" not in messages["DSF"]:
        return
    frame = messages["DSF"]
    t, counts = frame.index.to_numpy(np.float64), frame["Dp"].to_numpy(np.float64)
    if len(t) < 2:
        return
    rises = np.concatenate(([0.0], np.maximum(np.diff(counts), 0.0)))
    flying = within(t, [(flight.start, flight.stop) for flight in flights])
    for first, last in stretches(t, flying & (rises > 0.0), join=3.0):
        lost = int(rises[(t >= first) & (t <= last)].sum())
        yield FlightEvent(
            id="messages-dropped",
            t=first,
            end=last,
            severity=Severity.WARNING,
            reason=f"The logger dropped {lost} message{'s' if lost > 1 else ''}.",
            advice="Use a faster card, a larger LOG_FILE_BUFSIZE, or fewer bits in LOG_BITMASK.",
            evidence={"messages": lost},
            source="ArduPilot, DSF.Dp",
        )
