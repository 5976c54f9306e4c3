"""What to log better: messages that were missing or slow, by the settings of the autopilot that bring them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from core.summary import listed
from logparse.craft.log_settings import Bit, LogSetting, mask
from logparse.formats import TELEMETRY
from pipeline.results.answer import Advice

if TYPE_CHECKING:
    from pipeline.results.coverage import LoggedRate
from pipeline.results.fleet import FlightEntry

#: What it costs a flight that something is not logged, by `what` of the finding.
BRINGS = {
    "motors": "the inputs of every model",
    "fast motors": "the inputs of every model",
    "gps": "a position to fit",
    "imu": "the trajectory at the rate of the IMU",
    "fast imu": "the trajectory at the rate of the IMU",
    "attitude": "attitude",
    "baro": "height, and the density of the air",
    "mag": "a heading that does not drift by some ten degrees",
    "battery": "thrust at a known voltage",
    "fast rates": "roll, pitch and yaw effectiveness and the motors' lag",
}

#: Without these no model of the motion exists.
_VITAL = frozenset(("motors", "fast motors", "gps"))

#: Parameters that only fast rotational signals tell.
_FAST = ("roll inertia over mass and arm", "pitch inertia over mass and arm", "yaw torque over inertia")

#: What tables are called for people.
_TABLES = {"imu": "the IMU", "attitude": "attitude"}


def logging(flights: Sequence[FlightEntry], determined: Collection[str]) -> Iterator[Advice]:
    """Advise on logging."""
    yield from _on_board(flights)
    yield from _settings(flights, determined)
    yield from _lost(flights)
    yield from _esc(flights)


def _on_board(flights: Sequence[FlightEntry]) -> Iterator[Advice]:
    """Ask for the autopilot's own log where there is only telemetry."""
    radio = [flight for flight in flights if flight.format in TELEMETRY]
    if not radio:
        return
    slowest = {
        table: min(rates)
        for table in ("imu", "attitude")
        if (rates := [rate for flight in radio if (rate := _rate(flight, table)) is not None])
    }
    logged = " and ".join(f"{_TABLES[table]} at {rate:.2g} Hz" for table, rate in slowest.items())
    yield Advice(
        id="use-on-board-log",
        rank=12,
        do="Give the autopilot's own log",
        why=f"{names_of(radio, len(flights))} came by radio" + (f", with {logged}" if logged else ""),
        gain="the IMU at 25 Hz or more to integrate, and nothing lost on the link",
        flights=tuple(flight.name for flight in radio),
    )


def _settings(flights: Sequence[FlightEntry], determined: Collection[str]) -> Iterator[Advice]:
    """Combine all missing messages into one value of the parameter that enables them.

    `logparse.craft.log_settings` has decided which bits log it, and the findings carry them.
    """
    asked: dict[str, dict[int, tuple[Bit, list[tuple[str, FlightEntry]]]]] = {}
    for flight in flights:
        for finding in flight.findings:
            evidence = finding.evidence
            if finding.id != "not-logged" or evidence.get("parameter") is None:
                continue
            bit = Bit(int(evidence["bit"] or 0), str(evidence["name"]), "")
            _, lacking = asked.setdefault(str(evidence["parameter"]), {}).setdefault(bit.number, (bit, []))
            lacking.append((str(evidence["what"]), flight))
    for parameter, bits in asked.items():
        ordered = tuple(bits[number][0] for number in sorted(bits))
        setting = LogSetting(parameter, _present(flights, parameter), ordered)
        lacking = [lack for bit in setting.added for lack in bits[bit.number][1]]
        lacked = {what for what, _ in lacking}
        if not lacked or (lacked == {"fast rates"} and set(_FAST) <= set(determined)):
            # The rates logged were enough.
            continue
        named = list({flight.name: flight for _, flight in lacking}.values())
        yield Advice(
            id="log-bitmask" if parameter == "LOG_BITMASK" else "sdlog-profile",
            rank=1 if _VITAL & lacked else 11 if lacked - {"fast rates"} else 21,
            do=setting.sentence(),
            why=f"{names_of(named, len(flights))}: no or too slow messages for it",
            gain=", ".join(dict.fromkeys(BRINGS[what] for what, _ in lacking)),
            settings={} if setting.wanted is None else {parameter: setting.wanted},
            flights=tuple(flight.name for flight in named),
        )


def _present(flights: Sequence[FlightEntry], parameter: str) -> int | None:
    """Return a parameter's value in the latest flight that tells it."""
    for flight in reversed(flights):
        value = mask(_setting(flight, parameter))
        if value is not None:
            return value
        for finding in flight.findings:
            present = finding.evidence.get("present")
            if finding.evidence.get("parameter") == parameter and present is not None:
                return int(present)
    return None


def _lost(flights: Sequence[FlightEntry]) -> Iterator[Advice]:
    """Ask for a faster card where the autopilot's own log has gaps in flight."""
    # Gaps may be flight on wings, or bytes that the file lost after the card had taken them.
    otherwise = having(flights, "wing-borne", "file-damaged")
    gaps = [
        flight for flight in having(flights, "log-gaps") if flight.format not in TELEMETRY and flight not in otherwise
    ]
    if not gaps:
        return
    px4 = all(flight.format == "ulog" for flight in gaps)
    longest = max(
        (
            float(finding.evidence.get("longest") or 0.0)
            for flight in gaps
            for finding in flight.findings
            if finding.id == "log-gaps"
        ),
        default=0.0,
    )
    yield Advice(
        id="faster-card",
        rank=13,
        do="Use a faster card, or log fewer topics"
        if px4
        else "Use a faster card and raise LOG_FILE_BUFSIZE, or log fewer messages",
        why=f"the log of {names_of(gaps, len(flights))} has gaps in flight"
        + (f", the longest of {longest:.1f} s" if longest > 0.0 else ""),
        gain="models of the whole flight: they are fitted to the longest piece without a gap",
        flights=tuple(flight.name for flight in gaps),
    )


def _esc(flights: Sequence[FlightEntry]) -> Iterator[Advice]:
    """Ask for rotor speeds where motors work unlike and nothing tells why."""
    uneven = having(flights, "uneven-motor")
    if not uneven or any(_rate(flight, "esc") is not None for flight in flights):
        return
    px4 = all(flight.format == "ulog" for flight in uneven)
    yield Advice(
        id="esc-telemetry",
        rank=31,
        do="Log the rotors' speeds by ESC telemetry "
        f"(bidirectional DShot, {'DSHOT_BIDIR_EN' if px4 else 'SERVO_BLH_BDMASK'}, or a telemetry wire)",
        why=f"in {names_of(uneven, len(flights))} a motor works far harder than the others, and motor outputs alone do "
        "not tell a weak motor from an off-centre load",
        gain="a weak motor shows as fewer turns at the same command",
        flights=tuple(flight.name for flight in uneven),
    )


def _rates(flight: FlightEntry) -> Mapping[str, LoggedRate]:
    return {} if flight.coverage is None else flight.coverage.health.rates


def _rate(flight: FlightEntry, table: str) -> float | None:
    known = _rates(flight).get(table)
    return None if known is None else known.rate


def _setting(flight: FlightEntry, name: str) -> float | None:
    return None if flight.coverage is None else flight.coverage.health.settings.get(name)


def names_of(flights: Sequence[FlightEntry], total: int) -> str:
    """Name flights in a sentence; all of several are not listed."""
    if len(flights) == total:
        return f"all {total} flights" if total > 1 else "this flight"
    return listed([flight.name for flight in flights], 4)


def having(flights: Sequence[FlightEntry], *findings: str) -> list[FlightEntry]:
    """Choose the flights with one of these findings."""
    return [flight for flight in flights if any(finding.id in findings for finding in flight.findings)]
