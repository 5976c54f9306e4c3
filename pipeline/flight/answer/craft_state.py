"""What happened, and the state of the craft in numbers that never move: lines of the account of the flight."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from core.findings import Finding, Severity
from core.quantity import duration, number
from pipeline.results.account import Account, BatteryReading, GpsReading, HoverReading, MotorsReading, VibrationReading
from pipeline.results.answer import AnswerLine, Tone

_TONES = {Severity.INFO: Tone.GOOD, Severity.WARNING: Tone.CARE, Severity.ERROR: Tone.BAD}
#: Full thrust over the weight that pilots are advised to have, and part of a volt per cell that is spent.
_ADVISED, _SPENT = 2.0, 3.3
#: Share of a flight with a motor at its limit that is more than a manoeuvre, and spread of the motors' work that a
#: balanced craft does not have, and that needs no name.
_AT_LIMIT, _UNEVEN, _ALIKE = 0.05, 0.15, 0.05
#: Change of the hover throttle that tells nothing of the battery or the load.
_STEADY = 0.025


def happened(account: Account) -> AnswerLine:
    """Answer with the story of the flight in a sentence."""
    story, others = account.story, [each for each in account.notable if each not in account.story]
    tone = Tone.UNKNOWN if account.flight is None else Tone.GOOD
    if story:
        tone = _TONES[min((each.severity for each in story), key=list(_TONES)[::-1].index)]
    elif others or account.unseen:
        tone = Tone.CARE
    remark = ""
    if others and not story:
        # Vibration stands in a line of its own.
        remark = " Look at vibration." if others[0].id == "vibration" else f" To know: {others[0].reason}"
    return AnswerLine(purpose="Happened", word=account.in_short, tone=tone, text=account.headline + remark)


def state_lines(account: Account) -> Iterator[AnswerLine]:
    """Yield how it flew, battery, vibration, GPS, thrust and motors, each where the log tells it."""
    if account.flight is None:
        return
    flown = _flown(account)
    if flown is not None:
        yield flown
    if account.battery is not None:
        yield _battery(account.battery)
    if account.vibration is not None:
        yield _vibration(account.vibration, harmful=any(each.id == "vibration" for each in account.notable))
    if account.gps is not None:
        yield _gps(account.gps, [each for each in account.notable if each.id == "gps-glitch"])
    if account.hover is not None:
        yield _thrust(account.hover)
    if account.motors is not None:
        yield _motors(account.motors, failed=any(each.id == "motor-fault" for each in account.story))


def _line(purpose: str, text: str, *, care: bool, bad: bool = False) -> AnswerLine:
    return AnswerLine(purpose=purpose, word="", tone=Tone.BAD if bad else Tone.CARE if care else Tone.GOOD, text=text)


def _flown(account: Account) -> AnswerLine | None:
    """Return how long, high, far and fast; None where the first line has said it and all sources agree."""
    assert account.flight is not None
    height = account.height
    disputed = height is not None and any(
        abs(other - height.value) > max(1.0, 0.3 * height.value) for other in height.others.values()
    )
    if not account.story and not disputed:
        return None
    shown = "" if height is None else f"{number(height.value, 2)} m high"
    if height is not None and disputed:
        others = ", ".join(f"{name} {number(value, 2)}" for name, value in height.others.items())
        shown += f" by {height.source} ({others})"
    if not account.story:
        return _line("Height", shown.replace(" high", ""), care=True)
    parts = [duration(account.flight.duration), shown]
    for reading, words in ((account.distance, " away"), (account.ground_speed, "")):
        parts += [] if reading is None else [f"{number(reading.value, 2)} {reading.unit}{words}"]
    return _line("Flown", ", ".join(part for part in parts if part), care=disputed)


def _battery(battery: BatteryReading) -> AnswerLine:
    each = None if battery.cells is None else battery.lowest / battery.cells
    text = f"{battery.start:.1f} to {battery.end:.1f} V, lowest {battery.lowest:.1f} V"
    text += "" if each is None else f" ({each:.2f}/cell)"
    return _line("Battery", text, care=each is not None and each < _SPENT)


def _vibration(shaken: VibrationReading, *, harmful: bool) -> AnswerLine:
    """Answer with the worst of a flight: where nothing else shook it, that of a crash or a landing."""
    along = f"{shaken.axis}, " if shaken.axis else ""
    clips = f", {shaken.clips} clips" if shaken.clips else ""
    text = f"{number(shaken.worst, 2)} m/s² ({along}{shaken.t:.0f} s; limit {shaken.advised:.0f}){clips}"
    return _line("Vibration", text, care=shaken.worst > shaken.advised, bad=harmful)


def _gps(gps: GpsReading, jumps: Sequence[Finding]) -> AnswerLine:
    if gps.fix_share < 0.005:
        return _line("GPS", "no fix", care=True)
    least = "always fixed" if gps.satellites_least is None else f"{gps.satellites_least}+ satellites"
    text = least if gps.fix_share > 0.995 else f"fix {100.0 * gps.fix_share:.0f} % of the time"
    jumped = max((float(each.evidence["jump_m"] or 0.0) for each in jumps), default=0.0)
    text += f", jumped by {number(jumped, 2)} m" if jumped else ""
    return _line("GPS", text, care=gps.fix_share < 0.99 or jumped > 0.0)


def _thrust(hover: HoverReading) -> AnswerLine:
    ratio, steady = hover.thrust_to_weight, abs(hover.end - hover.start) < _STEADY
    text = (
        f"hovers at {100.0 * hover.start:.0f} %"
        + ("" if steady else f", later {100.0 * hover.end:.0f} %")
        + " throttle"
    )
    text += "" if ratio is None else f"; at most {number(ratio, 2)} × weight"
    return _line("Thrust", text, care=ratio is not None and ratio < _ADVISED)


def _motors(motors: MotorsReading, *, failed: bool) -> AnswerLine:
    spread = f"{max(100.0 * motors.spread, 1.0):.0f} %"
    text = f"{motors.hardest} works hardest, by {spread}" if motors.spread > _ALIKE else f"alike within {spread}"
    text = f"one failed; {motors.hardest} works hardest, by {spread}" if failed else text
    text += f"; at a limit {100.0 * motors.at_limit:.0f} %" if motors.at_limit > _AT_LIMIT else ""
    return _line("Motors", text, care=motors.at_limit > _AT_LIMIT or motors.spread > _UNEVEN, bad=failed)
