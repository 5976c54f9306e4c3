"""What the scan of a telemetry log had to say, as findings: one per kind, however long the list behind it."""

from collections.abc import Iterator

import numpy as np

from core.findings import Finding, info, warning
from core.summary import listed
from logparse.mavlink import _decode
from logparse.mavlink.clock import BootClock
from logparse.mavlink.scan import Scan, dialect_arrays
from logparse.source import COPY_AGAIN, behind_the_end, misplaced_blocks, several_boots

#: So many frames of a message with a wrong checksum, and hardly one with a right one, come from another definition.
_FOREIGN = 10
#: A link that loses more than this part of its frames leaves holes that matter.
_LOSSY = 0.1
#: More than this part of a file that is not intact frames is more than a radio's noise.
_DAMAGED = 0.01
#: Mean step between sequence numbers, on a scale to 256, of a sender that does not count.
_UNCOUNTED = 50
#: Bytes of the longest signed frame of MAVLink 2 with its time stamp.
_LONGEST_FRAME = 8 + 10 + 255 + 2 + 13


def scan_findings(scan: Scan, clock: BootClock, autopilot: int, *, has_boot_time: bool) -> Iterator[Finding]:
    """Find damage, unknown messages, frames lost on the way, doubtful clocks, several boots and several vehicles."""
    yield from _damage(scan)
    yield from _foreign_messages(scan)
    unknown = scan.unknown[scan.unknown[:, 1] > 0]
    if total := int(unknown[:, 1].sum()):
        ids = listed(unknown[np.argsort(-unknown[:, 1]), 0])
        yield info(
            "message-layout",
            f"{total} frames have an id that the ArduPilot dialect of MAVLink does not define (ids {ids}); they were "
            "skipped.",
            messages=total,
            ids=ids,
        )
    yield from _frames_lost(scan, autopilot)
    yield from several_boots(clock.boots)
    yield from _clock(scan, clock, has_boot_time)
    yield from _senders(scan, autopilot)


def _damage(scan: Scan) -> Iterator[Finding]:
    state, size = scan.state, len(scan.data)
    tail = int(state[_decode.TAIL])
    if tail < size:
        yield behind_the_end(scan.data, tail, "frame", cut_short=size - tail < _LONGEST_FRAME)
    bad, stray, places, first = (
        int(state[k]) for k in (_decode.BAD_CHECKSUMS, _decode.STRAY_BYTES, _decode.BREAKS, _decode.FIRST_BREAK)
    )
    if stray:
        wrong = f"; {bad} frames have a wrong checksum" if bad else ""
        many = stray > _DAMAGED * size
        yield (warning if many else info)(
            "file-damaged",
            f"{stray} bytes in {places} places, the first at byte {first}, are not intact frames{wrong}.",
            COPY_AGAIN if many else "",
            bytes=stray,
            places=places,
            first_byte=first,
            bad_checksums=bad,
        )


def _foreign_messages(scan: Scan) -> Iterator[Finding]:
    found = {}
    for slot in np.flatnonzero(scan.bad_by_slot >= _FOREIGN):
        intact = sum(int(chunk.starts[slot + 1] - chunk.starts[slot]) for chunk in scan.chunks)
        if intact * 10 < scan.bad_by_slot[slot]:
            found[dialect_arrays().messages[slot].name] = int(scan.bad_by_slot[slot])
    if found:
        names = listed(f"{name} ({found[name]})" for name in sorted(found, key=lambda name: -found[name]))
        yield warning(
            "message-layout",
            f"All frames of {names} have a wrong checksum: the sender defines these messages otherwise than the "
            "ArduPilot dialect of MAVLink.",
            messages=names,
            frames=sum(found.values()),
        )


def _frames_lost(scan: Scan, autopilot: int) -> Iterator[Finding]:
    frames, lost = scan.link_frames, scan.link_lost
    # A radio's own messages carry a number that does not count.
    links = np.flatnonzero((lost > 0) & (lost < _UNCOUNTED * frames))
    if not len(links):
        return
    links = links[np.argsort(-lost[links])]
    senders = listed(f"{lost[k]} of {lost[k] + frames[k]} from {k >> 8}/{k & 0xFF}" for k in links)
    share = float(lost[autopilot] / max(1, lost[autopilot] + frames[autopilot]))
    yield (warning if share > _LOSSY else info)(
        "log-gaps",
        f"By their sequence numbers frames were lost on the way (system/component): {senders}.",
        "The log on the autopilot's own card has what the radio lost." if share > _LOSSY else "",
        frames=int(lost[autopilot]),
        share=share,
        all_senders=int(lost[links].sum()),
    )


def _clock(scan: Scan, clock: BootClock, has_boot_time: bool) -> Iterator[Finding]:
    if not scan.stamp_bytes:
        how = "are interpolated between those that tell it" if has_boot_time else "are unknown and read as 0"
        yield warning(
            "clock-doubtful",
            f"The stream has no time stamps; times of messages without boot time {how}.",
            "Give the ground station's .tlog instead of its raw log (.rlog, .log.raw).",
        )
    elif not has_boot_time:
        yield warning(
            "clock-doubtful",
            "No message tells the autopilot's boot time; times are those of the ground station, from the first frame "
            "on.",
            "Raise the telemetry rates of attitude and position above 0.",
        )
    if clock.shuffled:
        yield misplaced_blocks()
    if clock.jumps:
        jumps = listed(f"{jump:+.1f} s" for jump in clock.jumps)
        yield info(
            "clock-doubtful",
            f"The ground station's clock jumps against the autopilot's ({jumps}); the autopilot's is used.",
            jumps=len(clock.jumps),
            largest=max(clock.jumps, key=abs),
        )


def _senders(scan: Scan, autopilot: int) -> Iterator[Finding]:
    vehicles = np.flatnonzero(scan.link_votes)
    system, component = autopilot >> 8, autopilot & 0xFF
    if not len(vehicles):
        yield warning(
            "several-in-file",
            f"No heartbeat of an autopilot is in the log; system {system}, component {component} is taken for it.",
            system=system,
            component=component,
        )
    elif len(vehicles) > 1:
        senders = listed(f"{link >> 8}/{link & 0xFF}" for link in vehicles)
        yield warning(
            "several-in-file",
            f"Heartbeats of {len(vehicles)} autopilots are in the log (system/component {senders}); "
            f"{system}/{component}, heard most often, is analysed.",
            vehicles=len(vehicles),
            system=system,
            component=component,
        )
