"""Logged units to SI and radians."""

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

#: m/s^2: ``scipy.constants.g``, without which a log can be looked at before scipy is imported.
STANDARD_GRAVITY = 9.80665
#: Mean radius of the Earth, m: for distances within a flight.
EARTH_RADIUS = 6.371e6

#: Factor and offset to SI by unit as DataFlash (FMTU) and MAVLink name it: SI = value * factor + offset.
SI: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "": (1.0, 0.0),
        "1": (1.0, 0.0),
        "rad": (1.0, 0.0),
        "deg": (math.pi / 180.0, 0.0),
        "degheading": (math.pi / 180.0, 0.0),
        "deglatitude": (math.pi / 180.0, 0.0),
        "deglongitude": (math.pi / 180.0, 0.0),
        "cdeg": (math.pi / 18000.0, 0.0),
        "degE7": (math.pi / 180e7, 0.0),
        "rad/s": (1.0, 0.0),
        "deg/s": (math.pi / 180.0, 0.0),
        "mrad/s": (1e-3, 0.0),
        "m": (1.0, 0.0),
        "dm": (1e-1, 0.0),
        "cm": (1e-2, 0.0),
        "mm": (1e-3, 0.0),
        "m/s": (1.0, 0.0),
        "dm/s": (1e-1, 0.0),
        "cm/s": (1e-2, 0.0),
        "mm/s": (1e-3, 0.0),
        "m/s/s": (1.0, 0.0),
        "cm/s/s": (1e-2, 0.0),
        "mG": (1e-3 * STANDARD_GRAVITY, 0.0),
        "Gauss": (1e-4, 0.0),
        "gauss": (1e-4, 0.0),
        "mGauss": (1e-7, 0.0),
        "mgauss": (1e-7, 0.0),
        "V": (1.0, 0.0),
        "cV": (1e-2, 0.0),
        "mV": (1e-3, 0.0),
        "A": (1.0, 0.0),
        "cA": (1e-2, 0.0),
        "mA": (1e-3, 0.0),
        "Pa": (1.0, 0.0),
        "hPa": (1e2, 0.0),
        "mbar": (1e2, 0.0),
        "K": (1.0, 0.0),
        "degC": (1.0, 273.15),
        "cdegC": (1e-2, 273.15),
        "rpm": (math.pi / 30.0, 0.0),
        "s": (1.0, 0.0),
        "ms": (1e-3, 0.0),
        "us": (1e-6, 0.0),
    }
)


def quantity(frame: pd.DataFrame, column: str, unit: str) -> npt.NDArray[np.float64]:
    """Read a column of a message in SI units.

    Returns
    -------
    ndarray, shape (N,)
    """
    return _converted(numbers(frame, column), *_to_si(frame, column, unit))


def quantities(
    frame: pd.DataFrame, columns: Sequence[tuple[str, str]], rows: int
) -> Iterator[list[npt.NDArray[np.float64]]]:
    """Read columns of a long message as `quantity` does, some rows at a time, which then stay in the cache."""
    scales = [_to_si(frame, *column) for column in columns]
    plain = [_plain(frame, column) for column, _ in columns]
    for first in range(0, len(frame), rows):
        pieces = (values[first : first + rows] for values in plain)
        with np.errstate(invalid="ignore"):
            yield [_converted(piece.astype(np.float64), *scale) for piece, scale in zip(pieces, scales, strict=True)]


def _to_si(frame: pd.DataFrame, column: str, unit: str) -> tuple[float, float]:
    """Return factor and offset by which a column becomes SI."""
    declared = str(frame.attrs.get("units", {}).get(column, ""))
    return SI[declared if _alike(declared, unit) else unit]


def _converted(values: npt.NDArray[np.float64], factor: float, offset: float) -> npt.NDArray[np.float64]:
    """Return numbers, which are nobody else's, in SI."""
    # In place, for long columns.
    values *= factor
    values += offset
    infinite = np.isinf(values)
    if infinite.any():
        values[infinite] = np.nan  # no sensor measures it, and its cosine is a warning
    return values


def _plain(frame: pd.DataFrame, column: str) -> npt.NDArray[Any]:
    """Return a column as it is logged where that is a number, else what `numbers` makes of it."""
    if column in frame and isinstance(frame[column].dtype, np.dtype) and frame[column].dtype.kind in "iuf":
        return frame[column].to_numpy()
    return numbers(frame, column)


def numbers(frame: pd.DataFrame, column: str) -> npt.NDArray[np.float64]:
    """Read a column without a unit: flags, counts, states. NaN where the message has none or it is no number."""
    if column not in frame:
        return np.full(len(frame), np.nan)
    logged = frame[column]
    # Damaged floats can be signalling NaN, of which numpy warns when it widens them.
    with np.errstate(invalid="ignore"):
        if isinstance(logged.dtype, np.dtype) and logged.dtype.kind in "iuf":
            return np.asarray(logged.to_numpy().astype(np.float64))
        values = pd.to_numeric(logged, errors="coerce").to_numpy(dtype=np.float64, na_value=np.nan)
    return np.array(values, dtype=np.float64)  # a copy, as above


#: Units of one kind; a declaration of another kind is a slip of the firmware and does not count.
_KINDS = (
    {"rad", "deg", "degheading", "deglatitude", "deglongitude", "cdeg", "degE7"},
    {"rad/s", "deg/s", "mrad/s"},
    {"m", "dm", "cm", "mm"},
    {"m/s", "dm/s", "cm/s", "mm/s"},
    {"m/s/s", "cm/s/s", "mG"},
    {"Gauss", "gauss", "mGauss", "mgauss"},
    {"V", "cV", "mV"},
    {"A", "cA", "mA"},
    {"Pa", "hPa", "mbar"},
    {"K", "degC", "cdegC"},
    {"s", "ms", "us"},
    {"rpm", "rad/s"},
)


def _alike(declared: str, unit: str) -> bool:
    """Whether two units measure the same kind of thing."""
    return any(declared in kind and unit in kind for kind in _KINDS)


def sample_times(frame: pd.DataFrame) -> npt.NDArray[np.float64]:
    """Return the boot time at which a sensor sampled, s: `SampleUS`, in seconds already where the log scales it."""
    raw, written = numbers(frame, "SampleUS"), frame.index.to_numpy(dtype=np.float64)
    scaled = (np.asarray(raw * scale, dtype=np.float64) for scale in (1e-6, 1.0))
    return min(scaled, key=lambda times: float(np.median(np.abs(times - written))) if len(times) else 0.0)
