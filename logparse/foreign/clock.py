"""From the rows of a table to one uniform clock: repeated and jumping time stamps, gaps, spikes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.ndimage import percentile_filter

from core.findings import Finding
from core.runs import runs
from logparse.foreign.files import TableError, table_finding

Floats = npt.NDArray[np.float64]

#: Longest gap that is filled by straight lines, s.
LONGEST_GAP = 0.1

#: Part of a column that may be filled: what is more would be made up.
MOST_MISSING = 0.5

#: Fewest samples that make a record.
FEWEST = 50

#: A sample is a spike if it leaves both neighbours by so many usual steps, in the same direction, and comes back.
SPIKE = 25.0

#: The same of the steps of the samples around it, so many to either side: three samples that leap are six of them.
_LIVELY, _NEARBY = 10.0, 12

#: Usual steps that a value of exactly zero must be away from its neighbours to be one that was lost.
_ZERO = 3.0

#: A value that does not change for so long is held, not measured, s; or for so many times as long as it usually does.
HELD, _USUALLY_HELD = 0.5, 5.0

#: Longest usual step of a record, s: beyond it a unit of time is wrong.
LONGEST_STEP = 1.0

#: Shortest time that is a record of motion, s: below it a unit of time is wrong the other way.
SHORTEST_RECORD = 0.2

#: Longest spike, samples.
_LONGEST_SPIKE = 3


def steady_rows(t: Floats, name: str, label: str) -> tuple[npt.NDArray[np.int64], list[Finding]]:
    """Choose rows whose time stamps increase, in the longest part without a jump."""
    findings: list[Finding] = []
    rows = np.flatnonzero(np.isfinite(t))
    if len(rows) < FEWEST:
        raise TableError(f"{label}: column {name}: {len(rows)} rows have a time; a record needs {FEWEST}")
    if len(rows) < len(t):
        findings.append(_time(name, f"{len(t) - len(rows)} rows have no time and are left out"))
    step = np.diff(t[rows])
    usual = float(np.median(step[step > 0.0])) if np.any(step > 0.0) else 0.0
    if usual <= 0.0 or np.mean(step > 0.0) < 0.5:
        raise TableError(
            f"{label}: column {name}: time does not increase ({100 * np.mean(step <= 0.0):.0f} % of the steps are "
            "zero or negative); is it the time column?"
        )
    if usual > LONGEST_STEP:
        raise TableError(
            f"{label}: column {name}: samples are {usual:.3g} s apart, too far for a record of motion; is the time in "
            "ms or us? (time: {column: ..., unit: ms})"
        )
    repeated = step == 0.0
    if repeated.any():
        findings.append(_time(name, f"{int(repeated.sum())} time stamps repeat; their later rows are left out"))
        rows = rows[np.r_[True, ~repeated]]
        step = np.diff(t[rows])
    # Time that goes back, or leaps, parts the record: nothing tells what happened between.
    cuts = np.flatnonzero((step < 0.0) | (step > max(LONGEST_GAP, 5.0 * usual)))
    if len(cuts):
        edges = np.r_[0, cuts + 1, len(rows)]
        longest = int(np.argmax(np.diff(edges)))
        kept = rows[edges[longest] : edges[longest + 1]]
        worst = float(step[cuts][np.argmax(np.abs(step[cuts]))])
        findings.append(
            _time(
                name,
                f"time jumps {len(cuts)} time(s), by up to {worst:+.3g} s; kept are the {len(kept)} rows of the "
                f"longest part without a jump, of {len(rows)}",
            )
        )
        rows = kept
    if len(rows) < FEWEST:
        raise TableError(f"{label}: column {name}: only {len(rows)} rows in a row have steady times")
    if (span := float(t[rows[-1]] - t[rows[0]])) < SHORTEST_RECORD:
        raise TableError(
            f"{label}: column {name}: {len(rows)} rows last {span:.3g} s, too short for a record of motion; is the "
            "time in days, hours or minutes? (time: {column: ..., unit: d})"
        )
    return rows, findings


def uniform(t: Floats) -> Floats:
    """Return a uniform clock over increasing times, at their usual step."""
    usual = float(np.median(np.diff(t)))
    count = int(np.floor((t[-1] - t[0]) / usual + 0.5)) + 1
    clock = t[0] + usual * np.arange(count)
    if len(t) == count and np.max(np.abs(clock - t)) < 0.3 * usual:
        # Stamps with a little noise on a steady clock: the steady clock is nearer to the truth.
        return np.asarray(t[0] + (t[-1] - t[0]) / (count - 1) * np.arange(count))
    return np.asarray(clock[clock <= t[-1] + 1e-9])


def known_rows(
    values: Floats, names: Sequence[str], dt: float, fill: bool, label: str
) -> tuple[slice, Floats, list[Finding]]:
    """Fill short gaps, and keep the longest part without a long one."""
    findings: list[Finding] = []
    out = values.copy()
    whole = np.ones(len(values), dtype=bool)
    at = np.arange(len(values))
    for k, name in enumerate(names):
        bad = ~np.isfinite(out[:, k])
        if not bad.any():
            continue
        if bad.all():
            raise TableError(f"{label}: column {name} has no numbers; is it text, or are there commas for points?")
        if fill and bad.mean() > MOST_MISSING:
            raise TableError(
                f"{label}: column {name}: {100 * bad.mean():.0f} % of the samples are missing, too many to fill"
            )
        gaps = runs(bad)
        lengths = np.diff(gaps)[:, 0]
        long = gaps[lengths * dt > LONGEST_GAP]
        out[bad, k] = np.interp(at[bad], at[~bad], out[~bad, k])
        findings.append(
            table_finding(
                name,
                f"{int(bad.sum())} of {len(values)} samples are missing, at most {lengths.max() * dt:.2f} s at a time; "
                + ("gaps are filled" if fill or not len(long) else f"{len(long)} gap(s) end the usable part"),
                "export the record without gaps, or allow them to be filled (fill: true)",
            )
        )
        if not fill:
            for first, last in long:
                whole[first:last] = False
    first, last = max(runs(whole).tolist(), key=lambda run: run[1] - run[0], default=(0, 0))
    if last - first < FEWEST:
        where = ", ".join(str(finding.evidence["column"]) for finding in findings)
        raise TableError(f"{label}: no {FEWEST} samples in a row are known of every column; gaps are in {where}")
    return slice(first, last), out, findings


def without_spikes(values: Floats, names: Sequence[str]) -> tuple[Floats, list[Finding]]:
    """Replace values that leave their neighbours and come back within three samples; (N, k)."""
    out, findings = values.copy(), []
    for k, name in enumerate(names):
        column = out[:, k]
        bad = _spikes(column)
        if not bad.any():
            continue
        at = np.arange(len(column))
        worst = float(column[bad][np.argmax(np.abs(column[bad] - np.median(column)))])
        column[bad] = np.interp(at[bad], at[~bad], column[~bad])
        findings.append(
            table_finding(
                name,
                f"{int(bad.sum())} samples leap away and back, such as {worst:.6g}; their neighbours replace them",
                "look for lost packets of the telemetry",
            )
        )
    return out, findings


def _spikes(column: Floats) -> npt.NDArray[np.bool_]:
    n = len(column)
    bad = np.zeros(n, dtype=bool)
    steps = np.abs(np.diff(column))
    usual = float(np.percentile(steps, 90))
    if usual <= 0.0:
        usual = float(np.std(column)) * 1e-3
    if usual <= 0.0:
        return bad
    width = 2 * _LONGEST_SPIKE + 1
    padded = np.pad(column, _LONGEST_SPIKE, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, width), axis=1)
    # Telemetry that is lost is often logged as zero, which in a lively signal is no farther off than other steps.
    lost = (column == 0.0) & (np.abs(middle) > _ZERO * usual)
    # Where it is lively for a while, as in a chirp or at take-off, that is how the signal is.
    nearby = percentile_filter(steps, 75, 2 * _NEARBY + 1)
    lively = np.maximum(np.append(nearby, nearby[-1]), np.append(nearby[0], nearby))
    bad = lost | (np.abs(column - middle) > np.maximum(SPIKE * usual, _LIVELY * lively))
    # What stays is a step, not a spike; a median over seven samples already says so.
    return np.asarray(bad if bad.mean() < 0.05 else np.zeros(n, dtype=bool))


def held_values(values: Floats, names: Sequence[str], dt: float) -> list[Finding]:
    """Find columns that stop changing while others go on: a recorder that repeats its last packet; (N, k).

    A column at its own smallest or largest value is left alone: motors saturate.
    """
    still = np.diff(values, axis=0) == 0.0
    stuck = [name for name, column in zip(names, still.T, strict=True) if column.all()]
    # Rows that repeat as a whole interrupt nothing: they are left out, and counted in the time.
    rows = np.concatenate([[0], 1 + np.flatnonzero(~still.all(axis=1))])
    values, still = values[rows], still[rows[1:] - 1]
    held: dict[tuple[int, int], list[str]] = {}
    for k, name in enumerate(names):
        first, last = runs(still[:, k]).T
        length = rows[last] - rows[first]
        if not len(length) or still[:, k].mean() > 0.5:
            continue
        worst = int(np.argmax(length))
        usual = float(np.percentile(length, 75)) if len(length) > 3 else 1.0
        level = values[first[worst], k]
        if length[worst] * dt > max(HELD, _USUALLY_HELD * usual * dt) and np.min(values[:, k]) < level < np.max(
            values[:, k]
        ):
            held.setdefault((int(rows[first[worst]]), int(length[worst])), []).append(name)
    return [_held(name, "the value never changes while others move") for name in stuck] + [
        _held(", ".join(columns), f"the value stands still for {length * dt:.2f} s while others move")
        for (_, length), columns in held.items()
    ]


def _time(column: str, text: str) -> Finding:
    return table_finding(column, text, "export the record with the time of each sample")


def _held(column: str, text: str) -> Finding:
    return table_finding(column, text, "cut the record there: what a recorder repeats was not measured")
