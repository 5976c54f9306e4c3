"""The boot clock of a telemetry log: which frames belong to one power-up, and when in it each of them was sent.

A ground station stamps each frame with its own clock when it arrives. Many messages also tell when the autopilot sent
them, as milliseconds since it started (``time_boot_ms``). The scan reduces these to *clock windows* of one second of
boot time each, in the order of the stream (see `_decode.scan`). From them follow

- the power-ups: the boot clock starts again, or logger time runs ahead of it for good across a gap;
- the *knots*: from each window's beginning on, boot time is logger time less the smallest difference seen in the window
  (the least delayed message), and lies between the first boot time of this window and of the next one. So
  neither a jump of the ground station's clock nor a radio that stalls moves a message by more than the messages around
  it allow.

Positions in the stream, not logger time, order everything: some files hold sessions whose stamps overlap.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from logparse.mavlink._decode import (
    DELAY,
    FIRST_BOOT,
    FIRST_OFFSET,
    KNOT_DELAY,
    KNOT_FIRST,
    KNOT_NEXT,
    KNOT_OFFSET,
    LAST_BOOT,
    LAST_OFFSET,
    RESTART_MS,
    SAMPLES,
)
from logparse.source import Boot

Int64s = npt.NDArray[np.int64]

#: Logger time less boot time must rise by this much for good, us, where messages are missing for as long, ms, ...
_LATER_US = 5_000_000
_GAP_MS = 5_000
#: ... and "for good" is for so many windows.
_LASTING = 10
#: Windows with no more samples than this may be stray.
_FEW = 2
#: Frames before a boot's first window and after its last one are at most so far from it, us.
_FAR_US = 86_400_000_000
_MOST_JUMPS_EXAMINED = 1000


@dataclass(frozen=True, slots=True)
class BootClock:
    """What `find_boots` found."""

    boots: tuple[Boot, ...]
    #: shape (n, 4): Position in the stream, logger time less boot time [us], boot time there and at the next knot [us].
    knots: Int64s
    jumps: tuple[float, ...]  #: Jumps of the logger's clock within a boot, s.
    shuffled: bool = False  #: Whether blocks lie in another order than they were received, or twice.


def find_boots(windows: Int64s, size: int, stamped: bool, boundary: Callable[[int, int], int]) -> BootClock:
    """Split a stream into power-ups and give each a clock."""
    windows = _without_strays(windows, stamped)
    restarts = [0, *_restarts(windows, stamped).tolist()]
    stops = [*restarts[1:], len(windows)]
    edges = [
        0,
        *(boundary(int(windows[k - 1, LAST_OFFSET]), int(windows[k, FIRST_OFFSET])) for k in restarts[1:]),
        size,
    ]
    boots, jumps = [], []
    knots = np.empty((len(windows), 4), np.int64)
    knots[:, KNOT_OFFSET] = windows[:, FIRST_OFFSET]
    knots[:, KNOT_DELAY] = windows[:, DELAY]
    knots[:, KNOT_FIRST] = windows[:, FIRST_BOOT] * 1000
    knots[:-1, KNOT_NEXT] = np.maximum(knots[1:, KNOT_FIRST], knots[:-1, KNOT_FIRST])
    for k, (first, stop) in enumerate(zip(restarts, stops, strict=True)):
        last_boot = int(windows[first:stop, LAST_BOOT].max())
        boots.append(Boot(edges[k], edges[k + 1], int(windows[first, FIRST_BOOT]) / 1e3, last_boot / 1e3))
        knots[first, KNOT_OFFSET] = edges[k]
        knots[stop - 1, KNOT_NEXT] = last_boot * 1000
        if stamped:
            knots[first, KNOT_FIRST] -= _FAR_US
            knots[stop - 1, KNOT_NEXT] += _FAR_US
            jumps += _jumps(windows[first:stop, DELAY])
    back = np.flatnonzero(windows[1:, FIRST_BOOT] < windows[:-1, LAST_BOOT] - RESTART_MS) + 1
    return BootClock(tuple(boots), knots, tuple(jumps), shuffled=not set(back.tolist()) <= set(restarts))


def _continues(before: Int64s, after: Int64s, stamped: bool) -> npt.NDArray[np.bool_]:
    """Whether each window may belong to the same power-up as the one given for before it."""
    restarted = after[:, FIRST_BOOT] < before[:, LAST_BOOT] - RESTART_MS
    if stamped:
        gap = after[:, FIRST_BOOT] - before[:, LAST_BOOT] > _GAP_MS
        # Blocks in another order than they were written, or twice, step back in the logger's time as well.
        restarted &= np.abs(after[:, DELAY] - before[:, DELAY]) > _LATER_US
        restarted |= gap & (after[:, DELAY] - before[:, DELAY] > _LATER_US)
    return ~restarted


def _without_strays(windows: Int64s, stamped: bool) -> Int64s:
    """Leave out windows of a message or two that fit neither of their neighbours, which fit each other."""
    fits = _continues(windows[:-1], windows[1:], stamped)
    # A stray window and its neighbours make one bad fit or two.
    suspects = np.unique(np.concatenate([np.flatnonzero(~fits), np.flatnonzero(~fits) + 1]))
    suspects = suspects[(suspects > 0) & (suspects < len(windows) - 1)]
    suspects = suspects[windows[suspects, SAMPLES] <= _FEW]
    stray = suspects[_continues(windows[suspects - 1], windows[suspects + 1], stamped)]
    return np.delete(windows, stray, axis=0) if len(stray) else windows


def _restarts(windows: Int64s, stamped: bool) -> Int64s:
    """Windows that begin a new boot."""
    candidates = np.flatnonzero(~_continues(windows[:-1], windows[1:], stamped)) + 1
    kept = []
    for k in candidates:
        stepped_back = windows[k, FIRST_BOOT] < windows[k - 1, LAST_BOOT] - RESTART_MS
        # After an outage a link may deliver late for a while, which is not a new boot.
        later = int(windows[k : k + _LASTING, DELAY].min()) - int(windows[k - 1, DELAY]) > _LATER_US
        if stepped_back or later:
            kept.append(k)
    return np.array(kept, np.int64)


def _jumps(delay: Int64s) -> list[float]:
    """Lasting changes of logger time less boot time within a boot, s."""
    found = []
    for k in (np.flatnonzero(np.abs(np.diff(delay)) > _LATER_US) + 1)[:_MOST_JUMPS_EXAMINED]:
        change = np.median(delay[k : k + _LASTING]) - np.median(delay[max(k - _LASTING, 0) : k])
        if abs(change) > _LATER_US:
            found.append(float(change) / 1e6)
    return found


def logger_clock(stamps: Int64s, size: int) -> BootClock:
    """Clock of a stream without a single boot time: seconds since the first stamp."""
    if not len(stamps):
        return BootClock((Boot(0, size, 0.0, 0.0),), np.zeros((1, 4), np.int64), ())
    good = stamps[np.abs(stamps.astype(np.float64) - np.median(stamps)) < 30 * _FAR_US]
    first, last = int(good.min()), int(good.max())
    knots = np.array([[0, first, 0, last - first + _FAR_US]], np.int64)
    return BootClock((Boot(0, size, 0.0, (last - first) / 1e6),), knots, ())
