"""The signal that shows what happened; of a flight where nothing did, its height."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.results.answer import Picture
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.span import Span

#: Time shown before and after what happened, s.
_BEFORE, _AFTER = 8.0, 6.0
#: The signal that shows each kind of happening; height where none is named.
_SHOWS: Mapping[str, Picture] = {
    "motor-fault": Picture.MOTORS,
    "control-lost": Picture.ATTITUDE,
    "oscillation": Picture.RATES,
    "yaw-lost": Picture.MOTORS,
    "vibration": Picture.VIBRATION,
    "battery-low": Picture.BATTERY,
    "gps-lost": Picture.GPS,
    "gps-glitch": Picture.GPS,
    "crash": Picture.ATTITUDE,
}
_FAILSAFES: Mapping[str, Picture] = {"FAILSAFE_BATTERY": Picture.BATTERY, "FAILSAFE_GPS": Picture.GPS}


def picture_of(result: FlightResult) -> tuple[Picture, Span | None]:
    """Choose the plot of the first screen, and the stretch of time that it shows; None for the whole flight."""
    account, flight = present(result.account), present(result.flight)
    if account is not None and flight is not None and (cause := account.cause) is not None and cause.t is not None:
        last = account.story[-1]
        end = max(last.t or cause.t, min(last.end or cause.t, cause.t + 20.0))
        around = Span(max(cause.t - _BEFORE, flight.start - 2.0), end + _AFTER)
        picture = _SHOWS.get(cause.id, Picture.ALTITUDE)
        picture = _FAILSAFES.get(str(cause.evidence.get("subsystem")), picture)
        return (picture if _drawn(result, picture) else Picture.ALTITUDE), around
    return Picture.ALTITUDE, None


def _drawn(result: FlightResult, picture: Picture) -> bool:
    """Return whether the log has the signal."""
    if picture is Picture.MOTORS:
        return result.motors is not None and result.motors.shape[1] > 0
    if picture is Picture.ALTITUDE or isinstance(result.signals, Failure):
        return False
    return bool(getattr(result.signals, str(picture)))
