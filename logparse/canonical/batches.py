"""Bursts of gyro and accelerometer samples at the sensor's full rate: ISBH and ISBD of ArduPilot's batch sampler.

Each ISBH row announces a batch: sensor (type 0 accelerometer, 1 gyro), instance, scale, rate and time of the first
sample. ISBD rows bring its samples, 32 of each axis in a row, until long after they were taken.
"""

from collections import defaultdict
from collections.abc import Mapping

import numpy as np
import pandas as pd

from core.units import numbers, sample_times
from logparse.canonical.series import series

#: Sensor type and names of columns by the name of the tables: rad/s, m/s^2.
BURSTS: Mapping[str, tuple[int, str]] = {"gyro_batch": (1, "gyro"), "accel_batch": (0, "accel")}

#: Samples of each axis in one ISBD row.
_BLOCK = 32


def bursts(messages: Mapping[str, pd.DataFrame], name: str) -> tuple[pd.DataFrame, ...]:
    """Return one of `BURSTS` of each instance, where the log has any."""
    if "ISBH" not in messages or "ISBD" not in messages or not len(messages["ISBH"]) or not len(messages["ISBD"]):
        return ()
    kind, prefix = BURSTS[name]
    heads, data = messages["ISBH"], messages["ISBD"]
    head = {name: numbers(heads, name) for name in ("N", "type", "instance", "mul", "smp_cnt", "smp_rate")}
    sampled = sample_times(heads)
    number, sequence = numbers(data, "N"), numbers(data, "seqno")
    if not {"x", "y", "z"} <= set(data.columns):
        return ()
    # N counts to 65535 and starts again: blocks belong to the last header with their number before them.
    head_time, block_time = heads.index.to_numpy(), data.index.to_numpy()
    blocks: defaultdict[int, list[int]] = defaultdict(list)
    latest: dict[float, int] = {}
    order = np.lexsort((np.repeat((0, 1), (len(heads), len(data))), np.concatenate((head_time, block_time))))
    for position in order:
        if position < len(heads):
            latest[head["N"][position]] = int(position)
        elif (owner := latest.get(number[position - len(heads)])) is not None:
            blocks[owner].append(int(position) - len(heads))

    parts: defaultdict[int, list[tuple[np.ndarray, np.ndarray]]] = defaultdict(list)
    for owner, rows in blocks.items():
        rate, scale, instance = head["smp_rate"][owner], head["mul"][owner], head["instance"][owner]
        if head["type"][owner] != kind or not rate > 0.0 or not scale > 0.0 or not np.isfinite(instance):
            continue
        values = np.stack([_samples(data[axis], rows) for axis in "xyz"], axis=-1) / scale
        first = sampled[owner] + sequence[rows] * (_BLOCK / rate)
        times = first[:, None] + np.arange(_BLOCK) / rate
        parts[int(instance)].append((times.ravel(), values.reshape(-1, 3)))
    return tuple(_joined(parts[instance], prefix) for instance in sorted(parts))


def _joined(batches: list[tuple[np.ndarray, np.ndarray]], prefix: str) -> pd.DataFrame:
    """Make a table of the times and samples of one instance's batches."""
    t, values = (np.concatenate(parts) for parts in zip(*batches, strict=True))
    batch = np.concatenate([np.full(len(times), k) for k, (times, _) in enumerate(batches)])
    return series(t, {f"{prefix}_{axis}": values[:, k] for k, axis in enumerate("xyz")} | {"batch": batch})


def _samples(column: "pd.Series[int]", rows: list[int]) -> np.ndarray:
    """Return the samples of one axis, shape (len(rows), 32)."""
    return np.array([np.asarray(block, dtype=np.float64) for block in column.iloc[rows]], dtype=np.float64)
