"""How a flight met the ground: hard landings, crashes, and motors that were switched off in the air."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from core.catalogue import finding
from core.findings import Happening
from core.units import STANDARD_GRAVITY
from logparse.tables import between
from pipeline.flight.account.power import SINKING
from pipeline.flight.account.readings import SHAKE, Readings, at, stretches
from pipeline.results.span import Span

#: Specific force [m/s^2] of a shock that no manoeuvre makes.
SHOCK = 4.0 * STANDARD_GRAVITY
#: Lean [rad] that no craft under control has on the ground, and rate of sink [m/s] at contact that breaks legs.
_OVER, _FAST = np.radians(45.0), 6.0
#: Time [s] around touch-down in which the craft hits the ground, bounces and comes to rest.
_AROUND = 5.0
#: Height [m] that a craft which was switched off in the air loses; time [s] beside a flight whose log was cut.
_DROP, _CUT = 1.5, 1.0


@dataclass(frozen=True, slots=True)
class Contact:
    """The largest shock as a flight ends."""

    t: float
    force: float  #: m/s^2; NaN where not known.
    sink: float  #: m/s just before it; NaN where not known.
    lean: float  #: rad, how it came to rest; NaN where not known.


def contact(readings: Readings) -> Contact | None:
    """Return the largest shock around the touch-down, and how the craft came to rest; None of a log cut in the air."""
    if ends_in_the_air(readings):
        return None
    stop = _down(readings)
    around = (
        None
        if readings.force is None
        else between(readings.force, max(stop - _AROUND, readings.flight.start + SHAKE), readings.flight.stop + _AROUND)
    )
    t, force = readings.flight.stop, np.nan
    if around is not None and len(around) > 2:
        t, force = float(around.index[int(np.argmax(around.to_numpy()))]), float(around.max())
    sink = None if readings.own_height or readings.sink is None else readings.sink.dropna()
    touched = min(readings.flight.stop, t)
    return Contact(
        t=t,
        force=force,
        sink=float(at(np.linspace(touched - 0.5, touched), sink).max()) if sink is not None and len(sink) else np.nan,
        lean=_rest(readings, Span(max(t, readings.flight.stop), t + _AROUND)),
    )


def begins_in_the_air(readings: Readings) -> bool:
    """Return whether the log has nothing of the ground that the craft left."""
    start = readings.flight.start
    return _cut_in_the_air(readings, Span(start, start + _CUT), Span(start - _AROUND, start - _CUT))


def ends_in_the_air(readings: Readings) -> bool:
    """Return whether the log has nothing of the ground on which the craft came down."""
    stop = readings.flight.stop
    return _cut_in_the_air(readings, Span(_down(readings), stop + _CUT), Span(stop + _CUT, stop + _AROUND))


def unseen(readings: Readings) -> Iterator[str]:
    """Yield a sentence for each part of the flight that the log does not hold: its ends, and holes in it."""
    if begins_in_the_air(readings):
        yield "The log begins in the air."
    for hole in readings.holes:
        yield f"Nothing was logged from {hole.start:.0f} to {hole.stop:.0f} s."
    if ends_in_the_air(readings):
        yield "The log ends in the air."


def _cut_in_the_air(readings: Readings, near: Span, beyond: Span) -> bool:
    """Return whether the height is that of the air at an end of the flight, and not known beyond."""
    height = readings.height
    if height is None or len(height.loc[beyond.start : beyond.stop]):
        return False
    known, flown = height.loc[near.start : near.stop], height.loc[readings.flight.start : readings.flight.stop]
    level = not readings.ground_logged and bool(np.ptp(flown) < 2.0 * _DROP)
    return len(known) > 0 and (level or bool(known.min() > _DROP))


def _rest(readings: Readings, after: Span) -> float:
    """Return the lean of a craft at rest, rad; NaN where not known.

    By its attitude and by its weight, whichever is less: an estimate runs away (7-9-2014_24), and who carries the craft
    accelerates it.
    """
    leans = [] if readings.lean is None else [float(between(readings.lean, after.start + 0.5, after.stop).median())]
    axes = readings.specific_force
    if axes is not None and len(rest := between(axes, after.start + 1.0, after.stop).to_numpy(np.float64)) > 2:
        x, y, z = np.median(rest, axis=0)
        leans.append(float(np.arctan2(np.hypot(x, y), -z)))
    return min((lean for lean in leans if np.isfinite(lean)), default=np.nan)


def _down(readings: Readings) -> float:
    """Return when the craft was last seen in the air: motors may run on for seconds where it lies after a crash."""
    height = readings.height
    inside = None if height is None else height.loc[readings.flight.start : readings.flight.stop]
    if inside is None or not len(above := inside[inside > _DROP]):
        return readings.flight.stop
    return float(above.index[-1])


def ground_happenings(
    readings: Readings, touch: Contact | None, *, out_of_control: bool, sank: bool
) -> Iterator[Happening]:
    """Yield crash or hard landing, shocks in flight, and disarming in the air.

    `out_of_control` and `sank` say whether control or lift was lost as the craft met the ground.
    """
    off = _disarmed_in_air(readings)
    if off is not None:
        yield off
    if touch is None:
        return
    over = touch.lean > _OVER
    if over or (touch.force > SHOCK and (out_of_control or sank or off is not None or touch.sink > _FAST)):
        yield finding(
            "crash",
            f"The craft hit the ground{_how(touch)}{' and tipped over' if over else ''}.",
            t=touch.t,
            force_m_s2=touch.force,
            sink_m_s=touch.sink,
            lean_rad=touch.lean,
        )
    elif touch.force > SHOCK:
        yield finding(
            "hard-landing",
            f"The landing was hard{_how(touch)}.",
            t=touch.t,
            force_m_s2=touch.force,
            sink_m_s=touch.sink,
        )
    yield from _touches(readings, touch.t)


def _how(touch: Contact) -> str:
    sink = f" at {touch.sink:.0f} m/s" if touch.sink > SINKING else ""
    return sink + (f" ({touch.force:.0f} m/s²)" if touch.force > 0.0 else "")


def _touches(readings: Readings, until: float) -> Iterator[Happening]:
    """Find shocks in flight, after which the craft flew on."""
    if readings.force is None:
        return
    t, force = readings.force.index.to_numpy(np.float64), readings.force.to_numpy(np.float64)
    on = (force > SHOCK) & readings.flying(t) & (t < until - _AROUND)
    for first, last, rows in stretches(t, on, join=_AROUND):
        worst = float(force[rows].max())
        yield finding(
            "shock-in-flight", f"The craft was hit ({worst:.0f} m/s²) and flew on.", t=first, end=last, force_m_s2=worst
        )


def _disarmed_in_air(readings: Readings) -> Happening | None:
    events = readings.tables.events
    if events is None:
        return None
    flight = readings.flight
    near = events.loc[flight.start + 0.5 : flight.stop + 1.5]
    off = near.index[(near["event"] == "DISARMED") | near["detail"].str.startswith("Disarming motors")]
    if not len(off):
        return None
    t = float(off[0])
    height = readings.height
    if height is None or not len(after := height.loc[t : t + _AROUND]):
        return None
    lost = float(at(t, height)) - float(after.min())
    if lost < _DROP:
        return None
    return finding(
        "disarmed-in-air", f"The motors were switched off {lost:.0f} m above the ground.", t=t, height_m=lost
    )
