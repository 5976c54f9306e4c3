"""What the scan of a DataFlash log had to say, as findings: one per kind, however long the list behind it."""

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from core.findings import Finding, Severity
from logparse.tail import erased_tail

if TYPE_CHECKING:
    from logparse.dataflash.chain import Chain

_NAMED = 8


def scan_findings(chain: "Chain") -> list[Finding]:
    """Damage, unknown messages, contradictory or changed definitions, dropped messages and several boots."""
    return [
        *_damage(chain),
        *_unknown_messages(chain),
        *_definitions(chain),
        *_dropped_by_autopilot(chain),
        *_several_boots(chain),
    ]


def decoding_findings(crowded: Collection[str], mended: Mapping[str, int]) -> list[Finding]:
    """Return what decoding came upon: names with more layouts than are read, rows by name whose time was mended."""
    findings = [
        Finding(
            "clock-doubtful",
            Severity.WARNING,
            f"{count} rows of {name} carry a time outside the boot or far from their neighbours; "
            "their time was interpolated.",
            evidence={"message": name, "rows": count},
        )
        for name, count in mended.items()
    ]
    if crowded:
        findings.append(
            Finding(
                "file-damaged",
                Severity.WARNING,
                f"The layout of {_listed(sorted(crowded))} changes more often than any autopilot changes it; "
                "only the commonest were read.",
                "Copy the log from the card again.",
                {"messages": _listed(sorted(crowded))},
            )
        )
    return findings


def _listed(names: Sequence[object]) -> str:
    return ", ".join(str(name) for name in names[:_NAMED]) + (" ..." if len(names) > _NAMED else "")


def _damage(chain: "Chain") -> list[Finding]:
    findings = []
    starts, stops = chain.gap_start, chain.gap_stop
    size = len(chain.data)
    if len(stops) and stops[-1] == size:
        findings.append(_tail(chain, int(starts[-1]), size))
        starts, stops = starts[:-1], stops[:-1]
    if len(starts):
        totals = chain.totals(chain.whole)
        mean_length = float(totals @ chain.length[: len(totals)]) / len(chain.sequence)
        skipped = int((stops - starts).sum())
        lost = max(len(starts), round(skipped / mean_length))
        findings.append(
            Finding(
                "file-damaged",
                Severity.WARNING,
                f"{skipped} bytes in {len(starts)} places, the first at byte {int(starts[0])}, are not intact "
                f"messages; about {lost} messages are lost.",
                "Copy the log from the card again; when it comes out the same, the card failed while writing.",
                {"bytes": skipped, "places": len(starts), "first_byte": int(starts[0]), "messages_lost": lost},
            )
        )
    return findings


def _tail(chain: "Chain", start: int, size: int) -> Finding:
    evidence = {"first_byte": start, "bytes": size - start}
    erased = erased_tail(chain.data, start)
    if erased is not None:
        return erased
    if chain.truncated_at >= start:
        return Finding(
            "file-end",
            Severity.INFO,
            f"The log ends inside a message at byte {start}, which is lost: power was cut or the file is cut short.",
            evidence=evidence,
        )
    return Finding(
        "file-end",
        Severity.INFO,
        f"The last {size - start} bytes, from byte {start}, are not messages.",
        evidence=evidence,
    )


def _unknown_messages(chain: "Chain") -> list[Finding]:
    unknown = {k: int(n) for k, n in enumerate(chain.unknown_ids) if n}
    if not unknown:
        return []
    listed = sorted(unknown, key=lambda k: -unknown[k])
    names = _listed(listed)
    total = sum(unknown.values())
    return [
        Finding(
            "message-layout",
            Severity.WARNING,
            f"{total} messages have an id that no FMT row explains (ids {names}); they were skipped.",
            evidence={"messages": total, "ids": names},
        )
    ]


def _definitions(chain: "Chain") -> list[Finding]:
    findings = []
    used = np.flatnonzero(chain.totals(chain.whole)).tolist()
    contradictory = list(dict.fromkeys(chain.slots[k].name for k in used if k in chain.contradictory))
    if contradictory:
        names = _listed(contradictory)
        findings.append(
            Finding(
                "message-layout",
                Severity.WARNING,
                f"The FMT rows of {names} declare a length that their format does not have; of their messages the "
                "fields that fit were read.",
                evidence={"messages": names},
            )
        )
    layouts: dict[int, set[tuple[str, tuple[str, ...]]]] = {}
    for k in used:
        definition = chain.slots[k].definition
        layouts.setdefault(definition.id, set()).add((definition.format, definition.labels))
    redefined = list(dict.fromkeys(chain.slots[k].name for k in used if len(layouts[chain.slots[k].definition.id]) > 1))
    if redefined:
        names = _listed(redefined)
        findings.append(
            Finding(
                "message-layout",
                Severity.INFO,
                f"The layout of {names} changes within the file; each row was read by the layout in force there.",
                evidence={"messages": names},
            )
        )
    return findings


def _dropped_by_autopilot(chain: "Chain") -> list[Finding]:
    # DSF.Dp counts from each boot on.
    starts = [span.first for span in chain.spans.values()]
    counts: dict[int, int] = {}
    for index, count in chain.distinct_rows("DSF", {"Dp": int}):
        boot = int(np.searchsorted(starts, index, "right"))
        counts[boot] = max(counts.get(boot, 0), count)
    dropped = sum(counts.values())
    if not dropped:
        return []
    return [
        Finding(
            "messages-dropped",
            Severity.WARNING,
            f"The autopilot itself dropped {dropped} messages because its card was too slow (DSF.Dp).",
            "Use a faster card, raise LOG_FILE_BUFSIZE or log less (LOG_BITMASK).",
            {"messages": dropped},
        )
    ]


def _several_boots(chain: "Chain") -> list[Finding]:
    n = len(chain.spans)
    if n == 1:
        return []
    return [
        Finding(
            "several-in-file",
            Severity.INFO,
            f"The file holds {n} power-ups of the autopilot; they have different clocks and are read one at a time.",
            evidence={"boots": n},
        )
    ]
