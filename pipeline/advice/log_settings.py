"""What to log better: messages that were missing or slow, by the settings of the autopilot that bring them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING

from pipeline.advice.recommendation import Advice, having, names_of

if TYPE_CHECKING:
    from pipeline.entry import FlightEntry

#: Findings of `logparse.health` that a bit of LOG_BITMASK cures: finding, bit, its name.
_BITS = (
    ("no-motor-outputs", 10, "RCOUT"),
    ("motors-slow", 10, "RCOUT"),
    ("no-gps", 2, "GPS"),
    ("no-imu", 7, "IMU"),
    ("imu-slow", 18, "IMU_FAST"),
    ("no-attitude", 1, "ATTITUDE_MED"),
    ("no-baro", 4, "CTUN"),
    ("no-mag", 13, "COMPASS"),
    ("no-battery", 9, "CURRENT"),
    ("no-fast-rates", 0, "ATTITUDE_FAST"),
)

#: What each of those brings.
_BRINGS = {
    10: "the inputs of every model",
    2: "a position to fit",
    7: "the trajectory at the rate of the IMU",
    18: "the trajectory at the rate of the IMU",
    1: "attitude",
    4: "height, and the density of the air",
    13: "a heading that does not drift by some ten degrees",
    9: "thrust at a known voltage",
    0: "roll, pitch and yaw effectiveness and the motors' lag",
}

#: Without these no model of the motion exists.
_VITAL = frozenset((10, 2))

#: Parameters that only fast rotational signals tell.
_FAST = ("roll inertia over mass and arm", "pitch inertia over mass and arm", "yaw torque over inertia")

#: What tables are called for people.
_TABLES = {"imu": "the IMU", "attitude": "attitude"}

#: Findings of gaps in flight.
_GAPS = ("gap-in-motors", "gap-in-imu", "gap-in-gps", "gap-in-attitude", "imu-hole")

_TELEMETRY = ("tlog", "mavlink-raw")


def logging(flights: Sequence[FlightEntry], told: Collection[str]) -> Iterator[Advice]:
    """Advise on logging.

    Parameters
    ----------
    flights : sequence of FlightEntry
        Of one craft, in order of date.
    told : collection of str
        Physical parameters that are determined.
    """
    yield from _on_board(flights)
    yield from _bitmask([flight for flight in flights if flight.format.startswith("dataflash")], len(flights), told)
    yield from _px4(flights)
    yield from _lost(flights)
    yield from _esc(flights)


def _on_board(flights: Sequence[FlightEntry]) -> Iterator[Advice]:
    """Ask for the autopilot's own log where there is only telemetry."""
    radio = [flight for flight in flights if flight.format in _TELEMETRY]
    if not radio:
        return
    slowest = {
        table: min(rates)
        for table in ("imu", "attitude")
        if (rates := [rate for flight in radio if (rate := _rate(flight, table)) is not None])
    }
    told = " and ".join(f"{_TABLES[table]} at {rate:.2g} Hz" for table, rate in slowest.items())
    yield Advice(
        id="use-on-board-log",
        rank=12,
        do="Give the log that the autopilot wrote on board (.bin from its card) instead of the telemetry recording",
        why=f"{names_of(radio, len(flights))} came by radio" + (f", with {told}" if told else ""),
        gain="the IMU at 25 Hz or more to integrate, and nothing lost on the link",
        flights=tuple(flight.name for flight in radio),
    )


def _bitmask(flights: Sequence[FlightEntry], total: int, told: Collection[str]) -> Iterator[Advice]:
    """Put all bits that were missing into one value of LOG_BITMASK."""
    if not flights:
        return
    masks = [_setting(flight, "LOG_BITMASK") for flight in flights]
    mask = next((int(each) for each in reversed(masks) if each is not None and each >= 0), None)
    lacking = {bit: having(flights, *(f for f, b, _ in _BITS if b == bit)) for _, bit, _ in _BITS}
    if 0 in lacking and set(_FAST) <= set(told):
        # The rates logged were enough.
        del lacking[0]
    bits = {bit: those for bit, those in lacking.items() if those and not (mask is not None and mask >> bit & 1)}
    if not bits:
        return
    names = {bit: name for _, bit, name in _BITS}
    wanted = ", ".join(f"bit {bit} ({names[bit]})" for bit in sorted(bits))
    named = list({flight.name: flight for those in bits.values() for flight in those}.values())
    lost = list(dict.fromkeys(_BRINGS[bit] for bit in sorted(bits)))
    yield Advice(
        id="log-bitmask",
        rank=1 if _VITAL & bits.keys() else 11 if bits.keys() - {0} else 21,
        do=f"Set LOG_BITMASK to {_joined(mask, bits)}: it adds {wanted}"
        if mask is not None
        else f"Add {wanted} to LOG_BITMASK, {_joined(0, bits)} in all",
        why=f"{names_of(named, total)}: no or too slow messages for it"
        + ("" if mask is None else f" (LOG_BITMASK is {mask})"),
        gain=", ".join(lost),
        settings={} if mask is None else {"LOG_BITMASK": float(_joined(mask, bits))},
        flights=tuple(flight.name for flight in named),
    )


def _px4(flights: Sequence[FlightEntry]) -> Iterator[Advice]:
    slow = [flight for flight in having(flights, *(f for f, _, _ in _BITS)) if flight.format == "ulog"]
    if slow:
        yield Advice(
            id="sdlog-profile",
            rank=11,
            do="Set bits 0 (default set) and 4 (high rate) of SDLOG_PROFILE",
            why=f"{names_of(slow, len(flights))}: messages for identification are missing or slow",
            gain="actuator outputs and rates fast enough for rotational dynamics",
            settings={"SDLOG_PROFILE": 17.0},
            flights=tuple(flight.name for flight in slow),
        )


def _lost(flights: Sequence[FlightEntry]) -> Iterator[Advice]:
    """Ask for a faster card where the autopilot's own log has gaps in flight."""
    gaps = [flight for flight in having(flights, *_GAPS) if flight.format not in _TELEMETRY]
    if not gaps:
        return
    longest = max(
        (
            float(finding["evidence"].get("longest") or 0.0)
            for flight in gaps
            for finding in flight.findings
            if finding["id"] in _GAPS
        ),
        default=0.0,
    )
    yield Advice(
        id="faster-card",
        rank=13,
        do="Use a faster card and raise LOG_FILE_BUFSIZE, or log fewer messages",
        why=f"the log of {names_of(gaps, len(flights))} has gaps in flight"
        + (f", the longest of {longest:.1f} s" if longest > 0.0 else ""),
        gain="the whole flight in one piece: models are fitted to the longest piece without a gap only",
        flights=tuple(flight.name for flight in gaps),
    )


def _esc(flights: Sequence[FlightEntry]) -> Iterator[Advice]:
    """Ask for rotor speeds where motors work unlike and nothing tells why."""
    uneven = having(flights, "uneven-motor")
    if not uneven or any(_rate(flight, "esc") is not None for flight in flights):
        return
    yield Advice(
        id="esc-telemetry",
        rank=31,
        do="Log the rotors' speeds by ESC telemetry (bidirectional DShot, SERVO_BLH_BDMASK, or a telemetry wire)",
        why=f"in {names_of(uneven, len(flights))} a motor works far harder than the others, and motor outputs alone do "
        "not tell a weak motor from an off-centre load",
        gain="a weak motor shows as fewer turns at the same command",
        flights=tuple(flight.name for flight in uneven),
    )


def _joined(mask: int, bits: dict[int, list[FlightEntry]]) -> int:
    for bit in bits:
        mask |= 1 << bit
    return mask


def _rates(flight: FlightEntry) -> dict[str, dict[str, float]]:
    return dict(flight.coverage.get("health", {}).get("rates", {}))


def _rate(flight: FlightEntry, table: str) -> float | None:
    return _rates(flight).get(table, {}).get("rate")


def _setting(flight: FlightEntry, name: str) -> float | None:
    value = flight.coverage.get("health", {}).get("settings", {}).get(name)
    return None if value is None else float(value)
