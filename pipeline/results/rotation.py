"""How a craft turns: frequency responses of its axes, how it follows its attitude target, and what its loops have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from core.parameter import Parameter
from logparse import Finding
from sysid.loops.known_margins import Margins

#: Margins that a loop should have (MIL-F-9490D, table III: 6 dB and 45 deg), dB and deg.
LEAST_GAIN_DB, LEAST_PHASE_DEG = 6.0, 45.0

#: A value for each frequency; None where it is not known.
Numbers = tuple[float | None, ...]


class LoopState(StrEnum):
    """What the margins of a loop say."""

    GOOD = "good"
    THIN = "thin"
    UNSTABLE = "unstable"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """How a model predicted flying that was held out, see `sysid.frequency.time_domain.Verification`."""

    seconds: float
    fit_percent: float
    theil: float
    correlation: float
    residuals: str  #: Whether errors one sample ahead are white, in a clause; empty where too little was held out.
    verdict: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedResponse:
    """A measured frequency response, and the model fitted to it; see `sysid.frequency.FrequencyResponse`."""

    axis: str
    input: str
    output: str
    unit: str  #: Of output per input.
    method: str
    instrument: str
    source: str = ""  #: What input and output were taken from, where it is not the rate controller's messages.
    seconds: float
    band_hz: tuple[float, float] | None  #: Lowest and highest coherent frequency; None where there is none.
    hz: Numbers
    gain_db: Numbers
    phase_deg: Numbers
    coherence: Numbers
    #: Standard deviations of ln gain and of the phase, rad.
    sigma: Numbers
    sigma_phase: Numbers
    #: Plain regression, which a closed loop biases, as gain [dB] and phase [deg]; empty without an instrument.
    direct: tuple[Numbers, ...] = ()
    #: The model at the same frequencies, with the filter of the measurement; empty where none could be fitted.
    model: tuple[Numbers, ...] = ()
    structure: str = ""  #: Family of the model; empty without one.
    #: By name, such as ``"gain"``, ``"damping"``, ``"effective_delay"``.
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    #: Smallest change of a parameter that shows, in parts of its value.
    insensitivity: Mapping[str, float] = field(default_factory=dict)
    cost: float | None = None  #: J; up to 50 is excellent, up to 100 good (Tischler and Remple 2012, section 11.2).
    verdict: str = ""  #: What the fit is good for, in words; empty without one.
    check: Check | None = None  #: Of the model on flying that was held out.
    check_reason: str = ""  #: Why nothing was held out; empty where there is a check, or nothing to check.


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeFollowing:
    """How an axis follows its attitude target (ADS-33E-PRF, figure 5)."""

    bandwidth: Parameter  #: rad/s.
    phase_delay: Parameter  #: s.
    peak: Parameter  #: Largest gain over that at low frequency, dB.
    response: FittedResponse

    @property
    def determined(self) -> bool:
        """Return whether bandwidth and delay are known."""
        return self.bandwidth.value is not None and self.phase_delay.value is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisMargins:
    """Margins of one axis' rate and angle loop, with the gains flown."""

    state: LoopState  #: See `state_of`.
    gains: Mapping[str, float]  #: Gains and filters by the names of the autopilot's parameters.
    computed: Margins  #: From the craft's response and the controller of the log's parameters.
    #: Straight from the chirp: the second way; None where the log does not part the two.
    measured: Margins | None = None
    #: What the margins rest on too weakly: limits reached, weak coherence, two ways that disagree.
    remarks: tuple[str, ...] = ()
    ordinary: bool = False  #: From flying without chirps.


def state_of(margins: Margins, *, ordinary: bool = False) -> LoopState:
    """Return what margins say: thin below 6 dB or 45 deg; of ordinary flying only what the whole 95 % interval says."""
    if not margins.stable:
        return LoopState.UNSTABLE
    least = {"gain_db": LEAST_GAIN_DB, "phase_deg": LEAST_PHASE_DEG}
    if ordinary:
        known = {name: margins.intervals[name] for name in least if name in margins.intervals}
    else:
        values = {name: getattr(margins, name).value for name in least}
        known = {name: (value, value) for name, value in values.items() if value is not None}
    thin = any(high < least[name] for name, (_, high) in known.items())
    # Part of the responses that the data leave possible, for which a loop may be unstable without being called so.
    if thin or (not ordinary and margins.unstable > 0.05):
        return LoopState.THIN
    good = len(known) == len(least) and all(low >= least[name] for name, (low, _) in known.items())
    return LoopState.GOOD if good else LoopState.UNKNOWN


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisRotation:
    """What a flight tells of one axis."""

    axis: str  #: ``"roll"``, ``"pitch"``, ``"yaw"`` or ``"vertical"``.
    rate: FittedResponse | None = None  #: From the rate controller's output to the body rate.
    #: Why there is no response or no model of it, with what to fly or log; empty where there are both.
    reason: str = ""
    attitude: AttitudeFollowing | None = None
    attitude_reason: str = ""  #: Why not; empty where there is.
    loop: AxisMargins | None = None
    loop_reason: str = ""  #: Why not, with what to fly or log; empty where there are.

    @property
    def gain(self) -> Parameter:
        """Return how strongly the axis answers its controller, or why that is not known."""
        parameter = None if self.rate is None else self.rate.parameters.get("gain")
        return Parameter(None, None, "", self.reason) if parameter is None else parameter

    @property
    def rate_determined(self) -> bool:
        """Return whether it is known how strongly the axis answers its controller."""
        return self.gain.determined

    @property
    def determined(self) -> bool:
        """Return whether the answer to the controller, or to the attitude target, is known."""
        return self.rate_determined or (self.attitude is not None and self.attitude.determined)


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisCoupling:
    """How strongly the command of one axis turns the craft about another, in parts of its own answer."""

    axis: str
    other: str
    ratio: Parameter
    significant: bool  #: Whether that is more than its error could be.


@dataclass(frozen=True, slots=True, kw_only=True)
class RotationResult:
    """What a flight tells of how its craft turns, axis by axis."""

    axes: tuple[AxisRotation, ...]  #: Roll, pitch and yaw.
    vertical: AxisRotation | None = None  #: Thrust to vertical acceleration, without a loop.
    couplings: tuple[AxisCoupling, ...] = ()  #: Of roll and pitch, as far as they could be looked at.
    findings: tuple[Finding, ...] = ()

    @property
    def determined(self) -> bool:
        """Return whether anything is known of any axis."""
        return any(axis.determined for axis in self.every)

    @property
    def every(self) -> tuple[AxisRotation, ...]:
        """Return all axes, the vertical one last."""
        return self.axes if self.vertical is None else (*self.axes, self.vertical)

    @property
    def loops(self) -> Mapping[str, AxisMargins]:
        """Return the margins that are known, by axis."""
        return {axis.axis: axis.loop for axis in self.axes if axis.loop is not None}
