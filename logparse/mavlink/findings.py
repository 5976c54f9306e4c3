"""What the scan of a telemetry log had to say, as findings: one per kind, however long the list behind it."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from core.findings import Finding, Severity
from logparse.mavlink import _decode
from logparse.mavlink.clock import BootClock
from logparse.mavlink.scan import Scan
from logparse.source import Boot
from logparse.tail import erased_tail

_NAMED = 8
#: So many frames of a message with a wrong checksum, and hardly one with a right one, come from another definition.
_FOREIGN = 10
#: A link that loses more than this part of its frames leaves holes that matter.
_LOSSY = 0.1
#: More than this part of a file that is not intact frames is more than a radio's noise.
_DAMAGED = 0.01
#: Mean step between sequence numbers, on a scale to 256, of a sender that does not count.
_UNCOUNTED = 50


class Scanned(Protocol):
    """What the findings are about: a telemetry log after its scan (`logparse.mavlink.tlog.TlogSource`)."""

    has_boot_time: bool

    @property
    def data(self) -> npt.NDArray[np.uint8]:
        """Bytes of the file."""

    @property
    def format(self) -> str:
        """``"tlog"``, or ``"mavlink-raw"`` without time stamps."""

    @property
    def boots(self) -> Sequence[Boot]:
        """Power-ups of the autopilot."""

    @property
    def autopilot(self) -> tuple[int, int]:
        """System and component of the autopilot."""

    @property
    def clock(self) -> BootClock:
        """How boot time follows the logger's."""

    @property
    def message_names(self) -> list[str]:
        """Names of all messages of the dialect by slot."""

    @property
    def scan(self) -> Scan:
        """The walk over the stream."""


def scan_findings(source: Scanned) -> list[Finding]:
    """Damage, unknown messages, frames lost on the way, clocks, several boots and several vehicles."""
    return [
        *_damage(source),
        *_unknown_messages(source),
        *_frames_lost(source),
        *_clock(source),
        *_senders(source),
    ]


def _damage(source: Scanned) -> list[Finding]:
    state = source.scan.state
    findings = []
    tail = int(state[_decode.TAIL])
    if tail < len(source.data):
        findings.append(_tail(source, tail))
    bad = int(state[_decode.BAD_CHECKSUMS])
    stray = int(state[_decode.STRAY_BYTES])
    places = int(state[_decode.BREAKS])
    if stray:
        first = int(state[_decode.FIRST_BREAK])
        wrong = f"; {bad} frames have a wrong checksum" if bad else ""
        many = stray > _DAMAGED * len(source.data)
        findings.append(
            Finding(
                "file-damaged",
                Severity.WARNING if many else Severity.INFO,
                f"{stray} bytes in {places} places, the first at byte {first}, are not intact frames{wrong}.",
                "Copy the log again; when it comes out the same, the link or the ground station's disk failed."
                if many
                else "",
                {"bytes": stray, "places": places, "first_byte": first, "bad_checksums": bad},
            )
        )
    foreign = _foreign_messages(source)
    if foreign:
        names = ", ".join(f"{name} ({count})" for name, count in foreign[:_NAMED])
        findings.append(
            Finding(
                "message-layout",
                Severity.WARNING,
                f"All frames of {names} have a wrong checksum: the sender defines these messages otherwise than the "
                "ArduPilot dialect of MAVLink.",
                evidence={"messages": names, "frames": sum(count for _, count in foreign)},
            )
        )
    return findings


def _tail(source: Scanned, start: int) -> Finding:
    size = len(source.data)
    evidence = {"first_byte": start, "bytes": size - start}
    erased = erased_tail(source.data, start)
    if erased is not None:
        return erased
    # The longest signed frame of MAVLink 2 with its time stamp.
    if size - start < 8 + 10 + 255 + 2 + 13:
        return Finding(
            "file-end",
            Severity.INFO,
            f"The log ends inside a frame at byte {start}, as when the ground station is closed.",
            evidence=evidence,
        )
    return Finding(
        "file-end",
        Severity.WARNING,
        f"The last {size - start} bytes, from byte {start}, are not intact frames.",
        "Copy the log again; when it comes out the same, the ground station's disk failed while writing.",
        evidence,
    )


def _foreign_messages(source: Scanned) -> list[tuple[str, int]]:
    bad = source.scan.bad_by_slot
    found = []
    for slot in np.flatnonzero(bad >= _FOREIGN):
        intact = sum(int(chunk.starts[slot + 1] - chunk.starts[slot]) for chunk in source.scan.chunks)
        if intact * 10 < bad[slot]:
            found.append((source.message_names[slot], int(bad[slot])))
    return sorted(found, key=lambda item: -item[1])


def _unknown_messages(source: Scanned) -> list[Finding]:
    unknown = source.scan.unknown
    unknown = unknown[unknown[:, 1] > 0]
    if not len(unknown):
        return []
    unknown = unknown[np.argsort(-unknown[:, 1])]
    ids = ", ".join(str(number) for number in unknown[:_NAMED, 0]) + (" ..." if len(unknown) > _NAMED else "")
    total = int(unknown[:, 1].sum())
    return [
        Finding(
            "message-layout",
            Severity.INFO,
            f"{total} frames have an id that the ArduPilot dialect of MAVLink does not define (ids {ids}); they were "
            "skipped.",
            evidence={"messages": total, "ids": ids},
        )
    ]


def _frames_lost(source: Scanned) -> list[Finding]:
    frames, lost = source.scan.link_frames, source.scan.link_lost
    # A radio's own messages carry a number that does not count.
    links = np.flatnonzero((lost > 0) & (lost < _UNCOUNTED * frames))
    if not len(links):
        return []
    links = links[np.argsort(-lost[links])]
    told = ", ".join(
        f"{lost[link]} of {lost[link] + frames[link]} from {link >> 8}/{link & 0xFF}" for link in links[:_NAMED]
    )
    told += " ..." if len(links) > _NAMED else ""
    system, component = source.autopilot
    ours = system << 8 | component
    share = float(lost[ours] / max(1, lost[ours] + frames[ours]))
    return [
        Finding(
            "messages-dropped",
            Severity.WARNING if share > _LOSSY else Severity.INFO,
            f"By their sequence numbers frames were lost on the way (system/component): {told}.",
            "The log on the autopilot's own card has what the radio lost." if share > _LOSSY else "",
            {"frames": int(lost[ours]), "share": share, "all_senders": int(lost[links].sum())},
        )
    ]


def _clock(source: Scanned) -> list[Finding]:
    findings = []
    n = len(source.boots)
    if n > 1:
        findings.append(
            Finding(
                "several-in-file",
                Severity.INFO,
                f"The file holds {n} power-ups of the autopilot; they have different clocks and are read one at a "
                "time.",
                evidence={"boots": n},
            )
        )
    if source.format == "mavlink-raw":
        how = "are interpolated between those that tell it" if source.has_boot_time else "are unknown and read as 0"
        findings.append(
            Finding(
                "clock-doubtful",
                Severity.WARNING,
                f"The stream has no time stamps; times of messages without boot time {how}.",
                "Give the ground station's .tlog instead of its raw log (.rlog, .log.raw).",
            )
        )
    elif not source.has_boot_time:
        findings.append(
            Finding(
                "clock-doubtful",
                Severity.WARNING,
                "No message tells the autopilot's boot time; times are those of the ground station, from the first "
                "frame on.",
                "Raise the telemetry rates of attitude and position above 0.",
            )
        )
    jumps = source.clock.jumps
    if jumps:
        told = ", ".join(f"{jump:+.1f} s" for jump in jumps[:_NAMED]) + (" ..." if len(jumps) > _NAMED else "")
        findings.append(
            Finding(
                "clock-doubtful",
                Severity.INFO,
                f"The ground station's clock jumps against the autopilot's ({told}); the autopilot's is used.",
                evidence={"jumps": len(jumps), "largest": max(jumps, key=abs)},
            )
        )
    return findings


def _senders(source: Scanned) -> list[Finding]:
    votes = source.scan.link_votes
    vehicles = np.flatnonzero(votes)
    system, component = source.autopilot
    if not len(vehicles):
        return [
            Finding(
                "several-in-file",
                Severity.WARNING,
                f"No heartbeat of an autopilot is in the log; system {system}, component {component} is taken for it.",
                evidence={"system": system, "component": component},
            )
        ]
    if len(vehicles) == 1:
        return []
    told = ", ".join(f"{link >> 8}/{link & 0xFF}" for link in vehicles[:_NAMED])
    return [
        Finding(
            "several-in-file",
            Severity.WARNING,
            f"Heartbeats of {len(vehicles)} autopilots are in the log (system/component {told}); "
            f"{system}/{component}, heard most often, is analysed.",
            evidence={"vehicles": len(vehicles), "system": system, "component": component},
        )
    ]
