"""Tables by time, as messages of logs and canonical tables are."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd


def timed(t: npt.ArrayLike, units: Mapping[str, str] | None = None, /, **columns: Any) -> pd.DataFrame:
    """Return a table of some times [s]; columns of one number have it in every row."""
    table = pd.DataFrame(columns, index=pd.Index(np.asarray(t, dtype=float), name="t"))
    table.attrs["units"] = dict(units or {})
    return table


def inertial(t: npt.ArrayLike, gyro: npt.ArrayLike, accel: npt.ArrayLike) -> pd.DataFrame:
    """Return a table of an IMU: angular rates and specific forces of shape (n, 3)."""
    axes = zip("xyz", np.transpose(gyro), np.transpose(accel), strict=True)
    rates, forces = {}, {}
    for axis, rate, force in axes:
        rates[f"gyro_{axis}"], forces[f"accel_{axis}"] = rate, force
    return timed(t, **rates, **forces)
