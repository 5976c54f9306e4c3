"""What the scan of a DataFlash log had to say, as findings: one per kind, however long the list behind it."""

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING

import numpy as np

from core.findings import Finding, Severity, info, warning
from core.quantity import counted
from core.summary import listed
from logparse.source import COPY_AGAIN, behind_the_end, misplaced_blocks, several_boots

if TYPE_CHECKING:
    from logparse.dataflash.chain import Chain


def scan_findings(chain: "Chain") -> Iterator[Finding]:
    """Find damage, unknown messages, contradictory or changed definitions, dropped messages and several boots."""
    yield from _damage(chain)
    if unknown := {k: int(n) for k, n in enumerate(chain.unknown_ids) if n}:
        total, commonest = sum(unknown.values()), sorted(unknown, key=lambda k: -unknown[k])
        ids = listed(commonest)
        if len(chain.gap_start) and chain.gap_start[0] == 0:
            yield Finding(
                "message-layout",
                Severity.ERROR,
                f"The beginning of the log is missing, which says what its messages mean; those with ids {ids} were "
                "skipped.",
                "Copy the log again, from its beginning.",
                {"messages": total, "ids": ids},
            )
        else:
            yield warning(
                "message-layout",
                f"{total} messages have an id that no FMT row explains (ids {ids}); they were skipped.",
                messages=total,
                ids=ids,
            )
    yield from _definitions(chain)
    yield from _dropped_by_autopilot(chain)
    if chain.shuffled:
        yield misplaced_blocks()
    if any(slot.is_receivers_clock for slot in chain.slots):
        yield info(
            "clock-doubtful",
            "The firmware of this log wrote no boot clock; times are the GPS receiver's, seconds of the week.",
        )
    yield from several_boots(chain.boots)


def crowded_names(names: Collection[str]) -> Iterator[Finding]:
    """Name messages with more layouts than are read."""
    if names:
        yield warning(
            "file-damaged",
            f"The layout of {listed(sorted(names))} changes more often than any autopilot changes it; only the "
            "commonest were read.",
            COPY_AGAIN,
            messages=listed(sorted(names)),
        )


def _damage(chain: "Chain") -> Iterator[Finding]:
    starts, stops = chain.gap_start, chain.gap_stop
    if len(stops) and stops[-1] == len(chain.data):
        start = int(starts[-1])
        yield behind_the_end(chain.data, start, "message", cut_short=chain.truncated_at >= start)
        starts, stops = starts[:-1], stops[:-1]
    if len(starts):
        mean_length = float(chain.totals @ chain.length[: len(chain.slots)]) / len(chain.positions)
        skipped = int((stops - starts).sum())
        lost = max(len(starts), round(skipped / mean_length))
        yield warning(
            "file-damaged",
            f"About {counted(lost, 'message')} lost: {skipped} bytes in {counted(len(starts), 'place')}, the first at "
            f"byte {int(starts[0])}, are no intact messages.",
            COPY_AGAIN,
            bytes=skipped,
            places=len(starts),
            first_byte=int(starts[0]),
            messages_lost=lost,
        )


def _definitions(chain: "Chain") -> Iterator[Finding]:
    used = np.flatnonzero(chain.totals).tolist()
    if names := listed(dict.fromkeys(chain.slots[k].name for k in used if k in chain.contradictory)):
        yield warning(
            "message-layout",
            f"The FMT rows of {names} declare a length that their format does not have; of their messages the fields "
            "that fit were read.",
            messages=names,
        )
    layouts: dict[int, set[tuple[str, tuple[str, ...]]]] = {}
    for k in used:
        definition = chain.slots[k].definition
        layouts.setdefault(definition.id, set()).add((definition.format, definition.labels))
    redefined = (chain.slots[k].name for k in used if len(layouts[chain.slots[k].definition.id]) > 1)
    if names := listed(dict.fromkeys(redefined)):
        yield info(
            "message-layout",
            f"The layout of {names} changes within the file; each row was read by the layout in force there.",
            messages=names,
        )


def _dropped_by_autopilot(chain: "Chain") -> Iterator[Finding]:
    # DSF.Dp counts from each boot on.
    starts = [boot.start for boot in chain.boots]
    counts: dict[int, int] = {}
    for place, count in chain.distinct_rows("DSF", {"Dp": int}):
        boot = int(np.searchsorted(starts, place, "right"))
        counts[boot] = max(counts.get(boot, 0), count)
    if dropped := sum(counts.values()):
        yield warning(
            "log-gaps",
            f"The autopilot itself dropped {dropped} messages because its card was too slow (DSF.Dp).",
            "Use a faster card, raise LOG_FILE_BUFSIZE or log less (LOG_BITMASK).",
            messages=dropped,
        )
