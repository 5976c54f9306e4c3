"""What the scan of a DataFlash log had to say, as findings: one per kind, however long the list behind it."""

from typing import TYPE_CHECKING

import numpy as np

from logparse.findings import Finding, Severity

if TYPE_CHECKING:
    from logparse.dataflash import DataflashSource

_NAMED = 8


def scan_findings(source: "DataflashSource") -> list[Finding]:
    """Damage, unknown messages, contradictory or changed definitions, dropped messages and several boots."""
    return [
        *_damage(source),
        *_unknown_messages(source),
        *_definitions(source),
        *_dropped_by_autopilot(source),
        *_several_boots(source),
    ]


def _damage(source: "DataflashSource") -> list[Finding]:
    findings = []
    starts, stops = source.gaps
    size = source.size
    if len(stops) and stops[-1] == size:
        findings.append(_tail(source, int(starts[-1]), size))
        starts, stops = starts[:-1], stops[:-1]
    if len(starts):
        skipped = int((stops - starts).sum())
        lost = max(len(starts), round(skipped / source.mean_length))
        findings.append(
            Finding(
                "bytes-skipped",
                Severity.WARNING,
                f"{skipped} bytes in {len(starts)} places, the first at byte {int(starts[0])}, are not intact "
                f"messages; about {lost} messages are lost.",
                "Copy the log from the card again; when it comes out the same, the card failed while writing.",
                {"bytes": skipped, "places": len(starts), "first_byte": int(starts[0]), "messages_lost": lost},
            )
        )
    return findings


def _tail(source: "DataflashSource", start: int, size: int) -> Finding:
    evidence = {"first_byte": start, "bytes": size - start}
    # A look at both ends tells erased flash from messages without reading a tail of any length.
    ends = np.concatenate((source.data[start : start + 4096], source.data[max(start, size - 4096) :]))
    if size - start >= 16 and (np.all(ends == 0xFF) or np.all(ends == 0)):
        return Finding(
            "erased-tail",
            Severity.INFO,
            f"The last {size - start} bytes were never written (all {int(ends[0]):#04x}).",
            evidence=evidence,
        )
    if source.truncated_at >= start:
        return Finding(
            "truncated-tail",
            Severity.WARNING,
            f"The log ends inside a message at byte {start}: power was lost or the file is cut short.",
            evidence=evidence,
        )
    return Finding(
        "stray-tail",
        Severity.INFO,
        f"The last {size - start} bytes, from byte {start}, are not messages.",
        evidence=evidence,
    )


def _unknown_messages(source: "DataflashSource") -> list[Finding]:
    unknown = {k: int(n) for k, n in enumerate(source.unknown_ids) if n}
    if not unknown:
        return []
    listed = sorted(unknown, key=lambda k: -unknown[k])
    names = ", ".join(str(k) for k in listed[:_NAMED]) + (" ..." if len(listed) > _NAMED else "")
    total = sum(unknown.values())
    return [
        Finding(
            "unknown-messages",
            Severity.WARNING,
            f"{total} messages have an id that no FMT row explains (ids {names}); they were skipped.",
            evidence={"messages": total, "ids": names},
        )
    ]


def _definitions(source: "DataflashSource") -> list[Finding]:
    findings = []
    contradictory = source.contradictory_in_use
    if contradictory:
        names = ", ".join(contradictory[:_NAMED]) + (" ..." if len(contradictory) > _NAMED else "")
        findings.append(
            Finding(
                "contradictory-format",
                Severity.WARNING,
                f"The FMT rows of {names} declare a length that their format does not have; of their messages the "
                "fields that fit were read.",
                evidence={"messages": names},
            )
        )
    redefined = source.redefined_in_use
    if redefined:
        names = ", ".join(redefined[:_NAMED]) + (" ..." if len(redefined) > _NAMED else "")
        findings.append(
            Finding(
                "redefined-format",
                Severity.INFO,
                f"The layout of {names} changes within the file; each row was read by the layout in force there.",
                evidence={"messages": names},
            )
        )
    return findings


def _dropped_by_autopilot(source: "DataflashSource") -> list[Finding]:
    dropped = source.dropped_by_autopilot
    if not dropped:
        return []
    return [
        Finding(
            "dropped-messages",
            Severity.WARNING,
            f"The autopilot itself dropped {dropped} messages because its card was too slow (DSF.Dp).",
            "Use a faster card, raise LOG_FILE_BUFSIZE or log less (LOG_BITMASK).",
            {"messages": dropped},
        )
    ]


def _several_boots(source: "DataflashSource") -> list[Finding]:
    n = len(source.boots)
    if n == 1:
        return []
    return [
        Finding(
            "several-boots",
            Severity.INFO,
            f"The file holds {n} power-ups of the autopilot; they have different clocks and are read one at a time.",
            evidence={"boots": n},
        )
    ]
