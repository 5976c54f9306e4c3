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

#: Name of the tables and of their columns by sensor type.
_SENSORS: Mapping[int, tuple[str, str]] = {0: ("accel_batch", "accel"), 1: ("gyro_batch", "gyro")}

#: Samples of each axis in one ISBD row.
_BLOCK = 32


def batches(messages: Mapping[str, pd.DataFrame]) -> dict[str, tuple[pd.DataFrame, ...]]:
    """Return ``"gyro_batch"`` [rad/s] and ``"accel_batch"`` [m/s^2] of each instance, where the log has any."""
    if "ISBH" not in messages or "ISBD" not in messages or not len(messages["ISBH"]) or not len(messages["ISBD"]):
        return {}
    heads, data = messages["ISBH"], messages["ISBD"]
    head = {name: numbers(heads, name) for name in ("N", "type", "instance", "mul", "smp_cnt", "smp_rate")}
    sampled = sample_times(heads)
    number, sequence = numbers(data, "N"), numbers(data, "seqno")
    if not {"x", "y", "z"} <= set(data.columns):
        return {}
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

    parts: defaultdict[tuple[str, int], list[tuple[np.ndarray, np.ndarray, int]]] = defaultdict(list)
    for owner, rows in blocks.items():
        sensor = _SENSORS.get(int(head["type"][owner])) if np.isfinite(head["type"][owner]) else None
        rate, scale = head["smp_rate"][owner], head["mul"][owner]
        if sensor is None or not rate > 0.0 or not scale > 0.0 or not np.isfinite(head["instance"][owner]):
            continue
        values = np.stack([_samples(data[axis], rows) for axis in "xyz"], axis=-1) / scale
        first = sampled[owner] + sequence[rows] * (_BLOCK / rate)
        times = first[:, None] + np.arange(_BLOCK) / rate
        parts[sensor[0], int(head["instance"][owner])].append((times.ravel(), values.reshape(-1, 3), owner))
    result: dict[str, tuple[pd.DataFrame, ...]] = {}
    for name, prefix in _SENSORS.values():
        tables = []
        for key in sorted(key for key in parts if key[0] == name):
            t = np.concatenate([part[0] for part in parts[key]])
            values = np.concatenate([part[1] for part in parts[key]])
            batch = np.concatenate([np.full(len(part[0]), k) for k, part in enumerate(parts[key])])
            columns = {f"{prefix}_{axis}": values[:, k] for k, axis in enumerate("xyz")}
            tables.append(series(t, columns | {"batch": batch}))
        if tables:
            result[name] = tuple(tables)
    return result


def _samples(column: "pd.Series[int]", rows: list[int]) -> np.ndarray:
    """Return the samples of one axis, shape (len(rows), 32)."""
    return np.array([np.asarray(block, dtype=np.float64) for block in column.iloc[rows]], dtype=np.float64)
