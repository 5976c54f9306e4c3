"""Does the receiver's clock run with the IMU's: fixes that come later from some moment on, or ever later.

One lag for the whole log is found by likelihood (`tuning`). A lag that changes bends the trajectory until receiver and
IMU agree halfway, so that what is left of either shows it no more. So it is looked for before anything is estimated:
the forces that the IMU felt, turned north and east by the autopilot's attitude, are summed to velocities; in spans so
short that errors of attitude and biases are straight lines, those of the receiver lie on them at the lag of the span.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from estimation.attitude import matrix_from_quat, quat_from_euler
from estimation.segmentation import SLOWEST_IMU
from estimation.timing import ACCEL, sample_rate, usable
from estimation.trust import inconsistent
from logparse import Finding, Severity, Tables

Array = npt.NDArray[np.float64]

#: Spans in which what attitude and biases do to a velocity is a line, s, and fixes of each at least.
SPAN, FEWEST = 5.0, 5
#: Lags that are tried beside that of the tables, s.
LAGS = np.arange(-15, 16) * 0.1
#: Drifts that are tried, by the seconds that they make of the log.
DRIFTS = np.arange(-30, 31) * 0.1
#: So many changes of a clock are set right; one that goes on changing is none.
MOST_CHANGES = 3
#: A lag changes by this at least, s: less is what jitter of the rows and the receiver's filter do.
CHANGED = 0.2
#: Gain in log-likelihood of a second lag, for the fixes on either side of the change.
DECISIVE = 12.0
#: Velocities of a receiver err alike for this long, s.
LASTING = 0.5
#: ... and by no less than this, m/s.
QUIETEST = 0.02
#: Misfits beyond so many times the usual one count as that: fixes that are wrong for other reasons.
FARTHEST = 3.0
#: Longest hole between rows of attitude and IMU that is summed over, s.
HOLE = 0.5
#: Rows whose attitudes are matrices at a time: those of all rows would be larger than the log.
PIECE = 1 << 15


@dataclass(frozen=True, slots=True)
class ClockChange:
    """How a receiver's rows become later than they were."""

    t: float  #: When, s; for a clock that drifts the middle of the log.
    later: float  #: By how much from then on, s, or over the log.
    drift: float  #: Seconds that they become later each second, for a clock that drifts; 0 for one that steps.

    def mended(self, gps: pd.DataFrame) -> pd.DataFrame:
        """Return the fixes with all lags as they were."""
        when = _when(gps)
        late = self.drift * (when - self.t) if self.drift else np.where(when >= self.t, self.later, 0.0)
        return gps.assign(t_valid=when - late)


def in_one_time(tables: Tables) -> tuple[Tables, list[Finding]]:
    """Put fixes at one lag if their clock is not the IMU's, and report it; withdraw what cannot be set right."""
    felt = _velocity_felt(tables)
    findings: list[Finding] = []
    while felt is not None and tables.gps is not None and (change := clock_change(tables.gps, *felt)) is not None:
        if len(findings) == MOST_CHANGES:
            return tables, [*findings, inconsistent("the receiver's clock changes again and again against the IMU's")]
        tables = replace(tables, gps=change.mended(tables.gps))
        findings.append(_changed(change))
    return tables, findings


def _changed(change: ClockChange) -> Finding:
    later = "later" if change.later > 0.0 else "earlier"
    how = (
        f"become {later}, by {abs(change.later):.2f} s over the log"
        if change.drift
        else f"come {abs(change.later):.2f} s {later} from t = {change.t:.0f} s on than before"
    )
    return Finding(
        "sensor-late",
        Severity.WARNING,
        f"The receiver's fixes {how}, by the IMU's movement: they are used at the times found.",
        "Look at the receiver's cable and rate, and at what else its port is used for.",
        {"sensor": "gps", "t": change.t, "later_s": change.later, "drift": change.drift},
    )


def clock_change(gps: pd.DataFrame, t: Array, velocity: Array) -> ClockChange | None:
    """Return how the lag of a receiver changes within the log; None where it does not, or nothing tells."""
    fixes = usable(gps, ["v_n", "v_e"])
    if fixes is None:
        return None
    when = _when(fixes)
    inside = (when > t[0] + LAGS[-1]) & (when < t[-1] + LAGS[0])
    when, measured = when[inside], fixes[["v_n", "v_e"]].to_numpy(np.float64)[inside]
    if len(when) < FEWEST or not np.median(np.diff(when)) > 0.0:  # none while the IMU was logged, or all at one time
        return None
    spans = _spans(when)
    if len(spans) < 4:
        return None
    # Each contiguous: `interp` would copy the column, which is as long as the IMU's, for every lag.
    felt = np.ascontiguousarray(velocity.T)
    shifted = [np.column_stack([np.interp(when - lag, t, v) for v in felt]) for lag in LAGS.tolist()]
    costs = _costs(when, measured, spans, shifted)
    middles = np.array([when[span].mean() for span in spans])
    stepped, drifted = _stepped(costs), _drifted(middles, costs)
    if drifted is not None and (stepped is None or drifted[1] < stepped[3]):
        return ClockChange(float(middles.mean()), drifted[0] * float(np.ptp(when)), drifted[0])
    if stepped is None:
        return None
    k, before, after, _ = stepped
    either = slice(spans[k].start, spans[k + 1].stop)
    one, other = (np.column_stack([np.interp(when[either] - lag, t, v) for v in felt]) for lag in (before, after))
    moment = _moment(when[either], measured[either] - one, measured[either] - other)
    return ClockChange(moment, after - before, 0.0)


def _when(gps: pd.DataFrame) -> Array:
    valid = gps["t_valid"].to_numpy(np.float64)
    return np.asarray(np.where(np.isfinite(valid), valid, gps.index.to_numpy(np.float64)))


def _velocity_felt(tables: Tables) -> tuple[Array, Array] | None:
    """Sum the forces felt, turned by the autopilot's attitude: times (n,) and velocities north and east (n, 2)."""
    imu, attitude = usable(tables.imu, ACCEL), usable(tables.attitude, ["roll", "pitch", "yaw"])
    if imu is None or attitude is None or len(attitude) < FEWEST or sample_rate(imu) < SLOWEST_IMU:
        return None
    t = imu.index.to_numpy(np.float64)
    own = attitude.index.to_numpy(np.float64)
    angles = [np.unwrap(attitude[name].to_numpy(np.float64)) for name in ("roll", "pitch", "yaw")]
    felt = imu[ACCEL].to_numpy(np.float64)
    force = np.empty((len(t), 2))
    for first in range(0, len(t), PIECE):
        piece = slice(first, first + PIECE)
        turned = matrix_from_quat(quat_from_euler(*(np.interp(t[piece], own, angle) for angle in angles)))
        force[piece] = np.einsum("nij,nj->ni", turned[:, :2], felt[piece])
    step = np.minimum(np.diff(t), HOLE)[:, None]
    return t, np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * (force[1:] + force[:-1]) * step, axis=0)])


def _spans(when: Array) -> list[slice]:
    """Cut fixes into spans, leaving out those with few."""
    number = np.floor((when - when[0]) / SPAN)
    edges = np.flatnonzero(np.diff(number, prepend=-1.0, append=np.inf))
    return [slice(a, b) for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True) if b - a >= FEWEST]


def _costs(when: Array, measured: Array, spans: list[slice], shifted: list[Array]) -> Array:
    """Return minus twice the log-likelihood of each lag in each span, shape (spans, lags)."""
    left = []
    for span in spans:
        x = when[span] - when[span].mean()
        basis, _ = np.linalg.qr(np.column_stack([np.ones_like(x), x]))
        each = np.stack([measured[span] - v[span] for v in shifted])
        left.append(each - basis @ (basis.T @ each))
    best = [each[(each**2).sum(axis=(1, 2)).argmin()].ravel() for each in left]
    usual = 1.4826 * float(np.median(np.abs(np.concatenate(best))))
    correlated = max(LASTING / float(np.median(np.diff(when))), 1.0)
    costs = np.empty((len(spans), len(shifted)))
    for k, (each, least) in enumerate(zip(left, best, strict=True)):
        # Impacts, and what else the forces do not tell, misfit at any lag.
        scale = max(usual, float(np.sqrt(np.mean(least**2))), QUIETEST)
        costs[k] = (np.minimum(np.abs(each) / scale, FARTHEST) ** 2).sum(axis=(1, 2)) / correlated
    return costs


def _stepped(costs: Array) -> tuple[int, float, float, float] | None:
    """Return the likeliest change from one lag to another, if it is one."""
    first = np.cumsum(costs, axis=0)[:-1]
    second = costs.sum(axis=0) - first
    both = first.min(axis=1) + second.min(axis=1)
    k = int(both.argmin())
    before, after = int(first[k].argmin()), int(second[k].argmin())
    gain = 0.5 * (costs[:, after] - costs[:, before])
    lags = _lowest(first[k]), _lowest(second[k])
    if abs(lags[1] - lags[0]) < CHANGED or min(_shared(gain[: k + 1]), _shared(-gain[k + 1 :])) < DECISIVE:
        return None
    return k, *lags, float(both[k])


def _lowest(costs: Array) -> float:
    """Return the lag at which a parabola through the lowest costs is lowest, s."""
    k = int(costs.argmin())
    if not 0 < k < len(costs) - 1:
        return float(LAGS[k])
    left, middle, right = costs[k - 1 : k + 2].tolist()
    return float(LAGS[k] + 0.5 * (LAGS[1] - LAGS[0]) * (left - right) / max(left - 2.0 * middle + right, 1e-9))


def _drifted(middles: Array, costs: Array) -> tuple[float, float] | None:
    """Return the likeliest drift of the lag, s/s, and minus twice its log-likelihood, if it is one."""
    length = max(float(np.ptp(middles)), 1e-9)
    share = (middles - middles.mean()) / length
    lags = LAGS[None, :, None] + DRIFTS[:, None, None] * share  # drifts, lags, spans
    each = np.stack([np.interp(lags[:, :, k], LAGS, row) for k, row in enumerate(costs)], axis=-1)
    best = np.unravel_index(int(each.sum(axis=-1).argmin()), lags.shape[:2])
    drift, mine = float(DRIFTS[best[0]]), each[best]
    gain = 0.5 * (costs[:, costs.sum(axis=0).argmin()] - mine)
    if abs(drift) < CHANGED or _shared(gain) < DECISIVE:
        return None
    return drift / length, float(mine.sum())


def _moment(when: Array, one: Array, other: Array) -> float:
    """Return the time from which fixes suit the other lag, s; misfits of both have shape (n, 2)."""
    x = when - when.mean()
    basis, _ = np.linalg.qr(np.column_stack([np.ones_like(x), x]))
    left = []
    for k in range(len(when) + 1):
        mixed = np.concatenate([one[:k], other[k:]])
        left.append(float(((mixed - basis @ (basis.T @ mixed)) ** 2).sum()))
    k = int(np.argmin(left))
    return float(when[k] if k < len(when) else when[-1] + SPAN)


def _shared(gain: Array) -> float:
    """Return what spans gain together without the one that gains most: one alone may have been a blow."""
    return float(gain.sum() - gain.max())
