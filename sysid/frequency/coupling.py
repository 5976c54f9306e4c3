"""What the command of one axis does to another: roll that pitches, pitch that rolls.

Of a symmetric craft nothing; a centre of gravity or a flight controller that sits askew, motors that pull unequally or
arms of another length make it. Both commands are inputs of the axis that should not answer, so that what its own
controller does against the coupling does not count.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from core.parameter import Parameter
from sysid.frequency.axes import AXES, Axis, FrequencyError
from sysid.frequency.chirp_records import chirp_record
from sysid.frequency.estimate import response_of_records
from sysid.frequency.excitation import Within, find_chirps
from sysid.frequency.flight_records import flight_record
from sysid.frequency.rate_signals import GivenSignals, LogSignals, sources_of
from sysid.frequency.records import AxisRecord
from sysid.frequency.response import FrequencyResponse


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coupling:
    """How strongly the command of one axis turns the craft about another."""

    axis: str  #: That is commanded.
    other: str  #: That should not answer.
    #: Angular acceleration about the other axis in parts of that about the own one, with its sign; near zero for a
    #: symmetric craft.
    ratio: Parameter
    response: FrequencyResponse = field(repr=False)  #: From the command to the rate about the other axis.

    @property
    def significant(self) -> bool:
        """Return whether it is more than its error could be, three standard deviations."""
        known = self.ratio
        return known.value is not None and known.sigma is not None and abs(known.value) > 3.0 * known.sigma


def coupling(logs: GivenSignals, own: FrequencyResponse, other: str, within: Within | None = None) -> Coupling:
    """Estimate what the command of an axis does to another."""
    commanded, answering = AXES[own.axis], AXES[other]
    records = [record for source in sources_of(logs) for record in _records(source, commanded, answering, within)]
    if not records:
        raise FrequencyError(
            f"{own.axis} to {other}: the logs excite one of both axes only; fly chirps, or sticks, on both"
        )
    across = replace(answering, input=commanded.input)
    cross = response_of_records(records, across, gyro_filter_hz=own.gyro_filter_hz, refined=False)
    return Coupling(axis=own.axis, other=other, ratio=_ratio(own, cross), response=cross)


def _ratio(own: FrequencyResponse, cross: FrequencyResponse) -> Parameter:
    """Average the ratio of two responses over frequency; it is real where both have the same lag."""
    mine = own.at(cross.hz)
    coherent = np.interp(cross.hz, own.hz, own.coherence, 0.0, 0.0) >= 0.6
    known = coherent & np.isfinite(mine) & np.isfinite(cross.sigma) & (np.abs(cross.response) > 0.0)
    counts = cross.weight_of_points[known]
    if float(np.sum(counts)) < 4.0:
        return Parameter(None, None, "1", "too few frequencies at which the axis answers its own command")
    ratio = cross.response[known] / mine[known]
    deviation = cross.sigma[known] * np.abs(ratio)
    weight = counts / deviation**2
    mean = float(np.sum(weight * ratio.real) / np.sum(weight))
    rest = np.abs(ratio - mean) ** 2 / (2.0 * deviation**2)
    excess = max(1.0, float(np.sum(counts * rest) / max(float(np.sum(counts)) - 1.0, 1.0)))
    sigma = float(np.sqrt(excess / np.sum(weight)))
    if sigma > 0.3:
        return Parameter(None, None, "1", f"{mean:.2f} ± {sigma:.2f}: too uncertain to be of use")
    return Parameter(mean, sigma, "1")


def _records(source: LogSignals, commanded: Axis, answering: Axis, within: Within | None) -> list[AxisRecord]:
    """Cut records with the command looked at as first input and that of the answering axis as second."""
    signals, log = source.of(answering), source.log
    if any(name not in signals.columns for name in (commanded.input, answering.input, answering.output)):
        return []
    names = {commanded.name, answering.name}
    pair = [chirp for chirp in find_chirps(log, within) if chirp.worthwhile and chirp.axis in names]
    try:
        if pair:
            both_flown = {chirp.axis for chirp in pair} == names
            return [chirp_record(log, signals, answering, chirp, [commanded]) for chirp in pair] if both_flown else []
        first, second = (flight_record(log, signals, axis, within) for axis in (commanded, answering))
    except FrequencyError:
        return []
    if first.start != second.start or len(first.output) != len(second.output):
        return []
    inputs, instruments = (
        np.column_stack([getattr(each, name)[:, 0] for each in (first, second)]) for name in ("inputs", "instruments")
    )
    return [replace(second, inputs=inputs, instruments=instruments)]
