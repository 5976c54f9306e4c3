"""What happened, and the state of the craft in numbers that never move: lines of the account of the flight."""

from __future__ import annotations

from collections.abc import Iterator

from core.findings import Severity
from core.quantity import duration, number
from pipeline.results.account import Account, BatteryReading, Reading
from pipeline.results.answer import AnswerLine, Tone

_TONES = {Severity.INFO: Tone.GOOD, Severity.WARNING: Tone.CARE, Severity.ERROR: Tone.BAD}
#: Full thrust over the weight that pilots are advised to have, and part of a volt per cell that is spent.
_ADVISED, _SPENT = 2.0, 3.3
#: Share of a flight with a motor at its limit that is more than a manoeuvre, and spread of the motors' work that a
#: balanced craft does not have, and that cannot be told from none.
_AT_LIMIT, _UNEVEN, _ALIKE = 0.05, 0.15, 0.01


def happened(account: Account) -> AnswerLine:
    """Answer with the story of the flight in a sentence."""
    story, others = account.story, [each for each in account.notable if each not in account.story]
    tone = Tone.UNKNOWN if account.flight is None else Tone.GOOD
    if story:
        tone = _TONES[min((each.severity for each in story), key=list(_TONES)[::-1].index)]
    elif others:
        tone = Tone.CARE
    remark = f" To know: {others[0].reason}" if others and not story else ""
    return AnswerLine(purpose="Happened", word="", tone=tone, text=account.headline + remark)


def state_lines(account: Account) -> Iterator[AnswerLine]:
    """Yield how it flew, battery, vibration, GPS, thrust and motors, each where the log tells it."""
    if account.flight is None:
        return
    yield _flown(account)
    if account.battery is not None:
        yield _battery(account.battery)
    if (shaken := account.vibration) is not None:
        along = f" along {shaken.axis}" if shaken.axis else ""
        clips = f", {shaken.clips} clips" if shaken.clips else ""
        tone = Tone.BAD if shaken.worst > shaken.harmful else Tone.CARE if shaken.worst > shaken.advised else Tone.GOOD
        text = (
            f"{number(shaken.worst, 2)} m/s² at worst{along}, at {shaken.t:.0f} s (limit {shaken.advised:.0f}){clips}"
        )
        yield AnswerLine(purpose="Vibration", word="", tone=tone, text=text)
    if account.gps is not None:
        least = account.gps.satellites_least
        tone = Tone.GOOD if account.gps.fix_share > 0.99 else Tone.CARE
        text = f"fix for {100.0 * account.gps.fix_share:.0f} % of the flight"
        text += "" if least is None else f", at least {least} satellites"
        yield AnswerLine(purpose="GPS", word="", tone=tone, text=text)
    if account.hover is not None:
        ratio = account.hover.thrust_to_weight
        text = f"hovers at {100.0 * account.hover.start:.0f} % throttle, at the end {100.0 * account.hover.end:.0f} %"
        text += "" if ratio is None else f"; full thrust {number(ratio, 2)} times the weight"
        yield AnswerLine(
            purpose="Thrust",
            word="",
            tone=Tone.CARE if ratio is not None and ratio < _ADVISED else Tone.GOOD,
            text=text,
        )
    if account.motors is not None:
        motors = account.motors
        uneven = motors.at_limit > _AT_LIMIT or motors.spread > _UNEVEN
        text = f"motor {motors.hardest} works hardest, {100.0 * motors.spread:.0f} % above the least"
        text = text if motors.spread > _ALIKE else "all work alike"
        text += f"; one at its limit for {100.0 * motors.at_limit:.0f} %" if motors.at_limit > 0.005 else ""
        yield AnswerLine(purpose="Motors", word="", tone=Tone.CARE if uneven else Tone.GOOD, text=text)


def _flown(account: Account) -> AnswerLine:
    assert account.flight is not None
    parts = [duration(account.flight.duration)]
    parts += [
        f"{number(reading.value, 2)} {reading.unit} {words}"
        for reading, words in (
            (account.height, "high"),
            (account.distance, "away"),
            (account.ground_speed, "over the ground"),
        )
        if reading is not None
    ]
    height = account.height
    disputed = height is not None and any(_apart(height, other) for other in height.others.values())
    if height is not None and disputed:
        others = ", ".join(f"{name} {number(value, 2)}" for name, value in height.others.items())
        parts[1] += f" by {height.source} ({others})"
    return AnswerLine(
        purpose="Flown",
        word="",
        tone=Tone.CARE if disputed else Tone.GOOD,
        text=", ".join(parts),
        value=None,
    )


def _apart(height: Reading, other: float) -> bool:
    """Return whether another source contradicts a height: by more than 10 % and 1 m, twice over."""
    return abs(other - height.value) > max(2.0, 0.3 * height.value)


def _battery(battery: BatteryReading) -> AnswerLine:
    each = None if battery.cells is None else battery.lowest / battery.cells
    text = f"{battery.start:.1f} V to {battery.end:.1f} V, lowest {battery.lowest:.1f} V"
    text += "" if each is None else f" ({each:.2f} V a cell)"
    return AnswerLine(
        purpose="Battery", word="", tone=Tone.CARE if each is not None and each < _SPENT else Tone.GOOD, text=text
    )
