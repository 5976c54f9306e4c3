"""`response`: from flights to the frequency response of an axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from logparse import FlightLog
from sysid.frequency.axes import Axis, FrequencyError, axis_of
from sysid.frequency.composite import merge
from sysid.frequency.excitation import find_chirps
from sysid.frequency.records import AxisRecord, chirp_record, rate_signals
from sysid.frequency.response import Floats, FrequencyResponse
from sysid.frequency.spectra import band_of_window, estimate, sum_spectra, window_lengths

#: Frequencies per decade of the grid.
PER_DECADE = 45

#: Highest frequency in parts of the sampling rate.
_BELOW_NYQUIST = 0.45


def response(data: FlightLog | Sequence[FlightLog], axis: str) -> FrequencyResponse:
    """Estimate the frequency response of an axis: controller output to body rate, or thrust to vertical acceleration.

    Parameters
    ----------
    data : FlightLog or sequence of FlightLog
        Several logs are summed.
    axis : {"roll", "pitch", "yaw", "vertical"}

    Raises
    ------
    FrequencyError
        Where the data cannot give it; the message says what to fly or log.
    """
    which = axis_of(axis)
    logs = [data] if isinstance(data, FlightLog) else list(data)
    records: list[AxisRecord] = []
    reasons: list[str] = []
    for log in logs:
        try:
            signals = rate_signals(log)
        except FrequencyError as error:
            reasons.append(str(error))
            continue
        for chirp in find_chirps(log):
            if chirp.axis == which.name and chirp.worthwhile:
                try:
                    records.append(chirp_record(log, signals, which, chirp))
                except FrequencyError as error:
                    reasons.append(str(error))
    if not records:
        raise FrequencyError("; ".join(reasons) or f"no chirp on the {axis} axis")
    filters = {log.parameters.get("INS_GYRO_FILTER") for log in logs}
    gyro = filters.pop() if len(filters) == 1 and which.unit == "rad/s" else None
    return response_of_records(records, which, gyro_filter_hz=gyro or None)


def response_of_records(
    records: Sequence[AxisRecord], axis: Axis, *, gyro_filter_hz: float | None = None
) -> FrequencyResponse:
    """Estimate the response of the first input of uniform records.

    Raises
    ------
    FrequencyError
        When all records are too short.
    """
    if axis.attitude:  # a rate axis integrates
        records = [record.difference() for record in records]
    low = min(record.band[0] for record in records)
    high = min(max(record.band[1] for record in records), _BELOW_NYQUIST / max(record.dt for record in records))
    longest = max(record.duration for record in records)
    low = max(low, FEWEST / longest)
    if high <= 1.5 * low:
        raise FrequencyError(f"records of {longest:.1f} s span no band of frequencies on the {axis.name} axis")
    hz = np.geomspace(low, high, max(round(PER_DECADE * np.log10(high / low)), 8))
    parts = []
    lengths = window_lengths(longest, low, high)
    for length in lengths:
        mask = band_of_window(float(length), lengths, hz)
        sums = sum_spectra(records, hz[mask], float(length)) if mask.any() else None
        part = None if sums is None else estimate(sums, float(length))
        if part is not None:
            parts.append((mask, part))
    if not parts:
        raise FrequencyError(f"records of {longest:.1f} s are too short for windows on the {axis.name} axis")
    merged = merge(hz, parts, 0)
    gamma = np.clip(merged.coherence, 1e-6, 1.0 - 1e-12)
    with np.errstate(divide="ignore", invalid="ignore"):
        averages = (1.0 - gamma) / (2.0 * gamma * merged.sigma**2)
    instruments = sorted({record.instrument for record in records} - {""})
    return FrequencyResponse(
        axis=axis.name,
        input=axis.input,
        output=axis.output,
        unit=axis.unit,
        hz=hz,
        response=merged.response,
        coherence=merged.coherence,
        sigma=merged.sigma,
        sigma_phase=merged.sigma.copy(),
        averages=np.asarray(averages, dtype=np.float64),
        resolution=merged.resolution,
        multiple_coherence=merged.multiple,
        method="instrument" if instruments else "direct",
        instrument=", ".join(instruments),
        direct=merged.direct,
        step=max(record.dt for record in records),
        gyro_filter_hz=gyro_filter_hz,
        records=tuple(record.name for record in records),
        duration=float(sum(record.duration for record in records)),
    )


#: Cycles of the lowest frequency in the longest record.
FEWEST = 3.0


def sigma_of(frf: FrequencyResponse) -> Floats:
    """Return the standard deviation of the complex response itself, per real and imaginary part, shape (n,)."""
    return np.asarray(np.abs(frf.response) * frf.sigma)
