"""What the aiding sensors measured, as one stream of scalar measurements for the filter."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from estimation import _kernels
from estimation.place import LocalFrame
from estimation.states import SensorNoise
from estimation.timing import GYRO_MOVING, usable
from logparse import Geodetic, Tables

#: What one sensor measured: kind, times (n,), values (n, c) and variances (n, c).
Block = tuple[int, np.ndarray, np.ndarray, np.ndarray]

#: Sensor names of the kernel's kinds, in their order.
KIND_NAMES = (
    "gps_position",
    "gps_height",
    "gps_velocity",
    "gps_climb",
    "baro",
    "mag",
    "gps2_position",
    "gps2_velocity",
    "range_finder",
)
#: How often the variance of a wander known to both receivers must be counted, so that two agree no better than half of
#: it allows: with half of each variance common to both, the mean of two has 3/4 of the variance of one.
COMMON_WANDER = 3.0
#: Axes that a block of the receiver holds.
LEVEL, VERTICAL = np.array([1.0, 1.0, np.nan]), np.array([np.nan, np.nan, 1.0])
#: Ranges that are used, m: nearer than the first is the blind zone of many sensors (and the craft's own legs), farther
#: than the second the ground is no longer that of the place.
SHORTEST_RANGE, LONGEST_RANGE = 0.3, 10.0
#: A magnetometer that reads the same so often while the craft turns is not measuring.
FEWEST_REPEATED = 50


@dataclass(frozen=True, slots=True)
class Observations:
    """Groups of scalar measurements that one sensor took at one time, sorted by time."""

    #: shape (g,): Time of validity [s] and kind (`KIND_NAMES`) of each group.
    t: np.ndarray
    kind: np.ndarray
    start: np.ndarray  #: shape (g + 1,): Group k consists of the scalars ``start[k]:start[k + 1]``.
    #: shape (m,): Component, value and white variance of each scalar, SI.
    axis: np.ndarray
    z: np.ndarray
    variance: np.ndarray
    admitted: np.ndarray  #: shape (g,): Groups that may be fused; what the others differ by is looked at all the same.

    @classmethod
    def merge(cls, blocks: Sequence[Block]) -> "Observations":
        """Merge blocks of (kind, t (n,), z (n, c), variance (n, c)); components that are NaN are left out."""
        if not blocks:
            nothing = np.empty(0)
            none = np.empty(0, np.int64)
            return cls(nothing, none, np.zeros(1, np.int64), none, nothing, nothing, np.empty(0, np.bool_))
        t = np.concatenate([block[1] for block in blocks])
        kind = np.concatenate([np.full(len(block[1]), block[0], np.int64) for block in blocks])
        z = np.full((len(t), 3), np.nan)
        variance = np.full((len(t), 3), np.nan)
        row = 0
        for _, block_t, block_z, block_variance in blocks:
            z[row : row + len(block_t), : block_z.shape[1]] = block_z
            variance[row : row + len(block_t), : block_z.shape[1]] = block_variance
            row += len(block_t)
        order = np.argsort(t, kind="stable")
        z, variance = z[order], variance[order]
        there = np.isfinite(z)
        count = there.sum(axis=1)
        axis = np.broadcast_to(np.arange(3), z.shape)[there]
        start = np.concatenate([[0], np.cumsum(count)])
        return cls(
            t[order],
            kind[order],
            start.astype(np.int64),
            axis.astype(np.int64),
            z[there],
            variance[there],
            np.ones(len(t), np.bool_),
        )

    def between(self, start: float, stop: float) -> "Observations":
        """Keep the groups in a span of time."""
        a, b = np.searchsorted(self.t, [start, stop])
        m = slice(int(self.start[a]), int(self.start[b]))
        return Observations(
            self.t[a:b],
            self.kind[a:b],
            self.start[a : b + 1] - self.start[a],
            self.axis[m],
            self.z[m],
            self.variance[m],
            self.admitted[a:b],
        )

    def earlier(self, kinds: Sequence[int], lag: float) -> "Observations":
        """Report that the groups of some kinds were true by `lag` seconds before the time they have here."""
        if lag == 0.0:
            return self
        t = self.t - lag * np.isin(self.kind, kinds)
        return self._chosen(np.argsort(t, kind="stable"), t)

    def thinned(self, kinds: Sequence[int], apart: float) -> "Observations":
        """Keep of some kinds only the first reading in every `apart` seconds."""
        keep = np.ones(len(self.t), np.bool_)
        for kind in kinds:
            mine = np.flatnonzero(self.kind == kind)
            keep[mine] = np.diff(np.floor(self.t[mine] / apart), prepend=-np.inf) > 0.0
        return self._chosen(np.flatnonzero(keep), self.t)

    def within(self, kinds: Sequence[int], start: float, stop: float) -> "Observations":
        """Leave out the groups of some kinds that lie outside a span of time."""
        kept = ~np.isin(self.kind, kinds) | ((self.t >= start) & (self.t <= stop))
        return self._chosen(np.flatnonzero(kept), self.t)

    def without(self, kind: int) -> "Observations":
        """Leave out the groups of one kind."""
        return self._chosen(np.flatnonzero(self.kind != kind), self.t)

    def _chosen(self, groups: np.ndarray, t: np.ndarray) -> "Observations":
        """Keep some groups in the order given; `t` (g,) are the times of all."""
        count = np.diff(self.start)[groups]
        start = np.concatenate([[0], np.cumsum(count)])
        m = np.repeat(self.start[:-1][groups] - start[:-1], count) + np.arange(start[-1])
        return Observations(
            t[groups], self.kind[groups], start, self.axis[m], self.z[m], self.variance[m], self.admitted[groups]
        )

    @property
    def readings(self) -> _kernels.Measurements:
        """What the compiled filter reads of them."""
        return _kernels.Measurements(self.kind, self.start, self.axis, self.z, self.variance, self.admitted)

    @property
    def scalar_kind(self) -> np.ndarray:
        """Kind of each scalar, shape (m,)."""
        return np.repeat(self.kind, np.diff(self.start))


def usable_fixes(gps: pd.DataFrame | None) -> pd.DataFrame | None:
    """Keep three-dimensional fixes with a place; rows of lat = lon = 0 are a receiver without one."""
    fixes = usable(gps, ["lat", "lon", "alt"])
    if fixes is None:
        return None
    fixes = fixes[(fixes["lat"] != 0.0) | (fixes["lon"] != 0.0)]
    fixes = fixes[~(fixes["fix"] < 3.0)]
    return None if fixes.empty else fixes


def find_origin(tables: Tables) -> Geodetic | None:
    """Return the autopilot's origin where logged, else the first good fix, else None."""
    fixes = usable_fixes(tables.gps)
    if tables.origin is not None or fixes is None:
        return tables.origin
    first = fixes.iloc[0]
    return Geodetic(float(first["lat"]), float(first["lon"]), float(first["alt"]))


def reported(table: pd.DataFrame, column: str, default: float) -> np.ndarray:
    """Return the reported accuracy, or the default where the receiver says nothing, which some drivers write as 0."""
    value = table[column].to_numpy(float)
    return np.where(np.isfinite(value) & (value > 0.0), value, default)


def observe_gps(fixes: pd.DataFrame, frame: LocalFrame, noise: SensorNoise) -> list[Block]:
    """Turn GPS fixes into blocks of positions [m] and velocities [m/s], NED, at their times of validity."""
    t = fixes["t_valid"].to_numpy(float)
    t = np.where(np.isfinite(t), t, fixes.index.to_numpy(float))
    position = frame.to_ned(*(fixes[c].to_numpy(float) for c in ("lat", "lon", "alt")))
    horizontal = reported(fixes, "h_acc", noise.h_acc)
    vertical = reported(fixes, "v_acc", noise.v_acc)
    sigma = noise.gps_white_share * np.column_stack([horizontal, horizontal, vertical])
    velocity = fixes[["v_n", "v_e", "v_d"]].to_numpy(float)
    speed = np.repeat(reported(fixes, "s_acc", noise.s_acc)[:, None], 3, axis=1)
    return [
        (_kernels.GPS_POSITION, t, position * LEVEL, sigma**2),
        (_kernels.GPS_HEIGHT, t, position * VERTICAL, sigma**2),
        (_kernels.GPS_VELOCITY, t, velocity * LEVEL, speed**2),
        (_kernels.GPS_CLIMB, t, velocity * VERTICAL, speed**2),
    ]


def _observe_second_gps(fixes: pd.DataFrame, frame: LocalFrame, noise: SensorNoise) -> list[Block]:
    """Turn a second receiver's fixes into measurements.

    Its position wanders too, but has no state of its own: the wander is taken for white noise that is as strong at low
    frequencies, ``2 tau / dt`` times its variance. So it bounds drift while its level velocities do the work.
    """
    (_, t, level, white), (_, _, height, _), (_, _, velocity, speed), _ = observe_gps(fixes, frame, noise)
    position = np.column_stack([level[:, :2], height[:, 2]])
    step = float(np.median(np.diff(t))) if len(t) > 1 else noise.gps_error_time
    share = noise.gps_error_share / noise.gps_white_share
    wander = COMMON_WANDER * white * share**2 * max(2.0 * noise.gps_error_time / step, 1.0)
    return [
        (_kernels.GPS2_POSITION, t, position, white + wander),
        (_kernels.GPS2_VELOCITY, t, velocity, speed),
    ]


def observe(tables: Tables, frame: LocalFrame | None, noise: SensorNoise) -> Observations:
    """Collect everything that GPS receivers, baro, magnetometer and range finder measured."""
    blocks: list[Block] = []
    fixes = usable_fixes(tables.gps)
    if fixes is not None and frame is not None:
        blocks += observe_gps(fixes, frame, noise)
        second = next((usable_fixes(gps) for gps in tables.others("gps")), None)
        if second is not None:
            blocks += _observe_second_gps(second, frame, noise)
    baro = usable(tables.baro, ["alt"])
    if baro is not None:
        alt = baro[["alt"]].to_numpy(float)
        blocks.append((_kernels.BARO, baro.index.to_numpy(float), alt, np.full_like(alt, noise.baro**2)))
    mag = usable_field(tables.mag)
    if mag is not None:
        field = mag[["mag_x", "mag_y", "mag_z"]].to_numpy(float)
        blocks.append((_kernels.MAG, mag.index.to_numpy(float), field, noise.mag**2 * run_lengths(field)))
    ranges = usable_ranges(tables.rangefinder)
    if ranges is not None:
        distance = ranges[["distance"]].to_numpy(float)
        variance = np.full_like(distance, noise.range_finder**2)
        blocks.append((_kernels.RANGE, ranges.index.to_numpy(float), distance, variance))
    return Observations.merge(blocks)


def run_lengths(values: np.ndarray) -> np.ndarray:
    """Count for each value the equal ones in a row that it is one of, column by column, shape (n, c).

    Readings that repeat to the last digit share one rounding error: together they tell as much as one.
    """
    lengths = np.empty_like(values)
    for k, column in enumerate(values.T):
        edges = np.flatnonzero(np.concatenate([[True], np.diff(column) != 0.0, [True]]))
        count = np.diff(edges)
        lengths[:, k] = np.repeat(count, count)
    return lengths


def usable_ranges(rangefinder: pd.DataFrame | None) -> pd.DataFrame | None:
    """Keep distances to the ground close by."""
    rows = usable(rangefinder, ["distance"])
    if rows is None:
        return None
    rows = rows[rows["distance"].between(SHORTEST_RANGE, LONGEST_RANGE)]
    return None if rows.empty else rows


def usable_field(mag: pd.DataFrame | None) -> pd.DataFrame | None:
    """Keep magnetometer rows that hold a field: all zeros is how a missing sensor is logged."""
    rows = usable(mag, ["mag_x", "mag_y", "mag_z"])
    if rows is None:
        return None
    rows = rows[(rows[["mag_x", "mag_y", "mag_z"]] != 0.0).any(axis=1)]
    return None if rows.empty else rows


def is_stuck(mag: pd.DataFrame | None, imu: pd.DataFrame | None) -> bool:
    """Return whether the magnetometer repeats one reading for good while the craft turns."""
    field = usable_field(mag)
    if field is None or imu is None or len(field) < FEWEST_REPEATED:
        return False
    readings = field[["mag_x", "mag_y", "mag_z"]].to_numpy(float)
    if (readings != readings[0]).any():
        return False
    rates = imu.loc[field.index[0] : field.index[-1], ["gyro_x", "gyro_y", "gyro_z"]].to_numpy(float)
    return bool(np.nanmax(np.abs(rates - np.nanmedian(rates, axis=0)), initial=0.0) > GYRO_MOVING)
