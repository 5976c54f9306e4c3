"""What a report says of how a craft turns: responses, attitude following and margins, axis by axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

Numbers = tuple[float | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """An estimated number, its standard deviation and unit, or why it is not determined."""

    value: float | None
    sigma: float | None
    unit: str
    reason: str
    insensitivity: float | None = None  #: Of a fitted parameter: smallest change that shows, in parts of its value.
    #: Of a margin: interval that holds it with 95 %, where that is not symmetric.
    interval95: tuple[float | None, float | None] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckReport:
    """How a model predicted flying that was held out, see `sysid.frequency.time_domain.Verification`."""

    seconds: float
    fit_percent: float
    theil: float
    correlation: float
    white: bool | None  #: Whether errors one sample ahead are white; None where too little was held out.
    verdict: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ResponseReport:
    """A measured frequency response with the model fitted to it, see `pipeline.results.rotation.FittedResponse`."""

    input: str
    output: str
    unit: str
    method: str
    instrument: str
    source: str = ""  #: What input and output were taken from, where it is not the rate controller's messages.
    seconds: float
    band_hz: tuple[float, float] | None
    structure: str
    parameters: Mapping[str, Estimate]
    cost: float | None
    verdict: str
    check: CheckReport | None = None
    check_reason: str = ""  #: Why nothing was held out; empty where there is a check, or nothing to check.
    hz: Numbers
    gain_db: Numbers
    phase_deg: Numbers
    coherence: Numbers
    sigma: Numbers


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowingReport:
    """How an axis follows its attitude target: bandwidth [rad/s], phase delay [s], peak [dB], and the response."""

    bandwidth: Estimate
    phase_delay: Estimate
    peak: Estimate
    response: ResponseReport


@dataclass(frozen=True, slots=True, kw_only=True)
class MarginsReport:
    """Margins of a loop, and in which part of the responses that the data allow it is unstable."""

    stable: bool
    unstable_part: float | None
    gain_db: Estimate
    phase_deg: Estimate
    crossover_hz: Estimate
    rejection_hz: Estimate
    peak_db: Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopReport:
    """Gains flown, margins computed from response and controller, and measured straight from the chirp."""

    state: str
    gains: Mapping[str, float | None]
    computed: MarginsReport
    measured: MarginsReport | None
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisReport:
    """What a flight tells of one axis, or why not."""

    axis: str
    determined: bool
    rate: ResponseReport | None
    reason: str
    attitude: FollowingReport | None
    attitude_reason: str
    loop: LoopReport | None
    loop_reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CouplingReport:
    """How strongly the command of one axis turns the craft about another, in parts of its own answer."""

    axis: str
    other: str
    ratio: Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class RotationReport:
    """What a flight tells of how its craft turns."""

    determined: bool
    axes: tuple[AxisReport, ...]
    vertical: AxisReport | None = None
    couplings: tuple[CouplingReport, ...] = ()
