"""How a craft turns: frequency responses of its axes, how it follows its attitude target, and what its loops have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from pipeline.results.rotation_report import (
    AxisReport,
    CheckReport,
    CouplingReport,
    Estimate,
    FollowingReport,
    LoopReport,
    MarginsReport,
    ResponseReport,
    RotationReport,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from core.parameter import Parameter
    from logparse import Finding
    from sysid.frequency.coupling import Coupling
    from sysid.frequency.response import FrequencyResponse
    from sysid.frequency.time_domain import Verification
    from sysid.loops.loop import Margins

#: Margins that a loop should have (MIL-F-9490D, table III: 6 dB and 45 deg), dB and deg.
LEAST_GAIN_DB, LEAST_PHASE_DEG = 6.0, 45.0

#: Part of the responses that the data leave possible, for which a loop may be unstable without being called so.
_MAY_BE_UNSTABLE = 0.05


class LoopState(StrEnum):
    """What the margins of a loop say."""

    GOOD = "good"
    THIN = "thin"
    UNSTABLE = "unstable"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedResponse:
    """A measured frequency response, and the model fitted to it."""

    measured: FrequencyResponse
    #: shape (n,): The model at the frequencies of `measured`, with the filter of the measurement; None where none could
    #: be fitted.
    model: NDArray[np.complex128] | None = None
    structure: str = ""  #: Family of the model; empty without one.
    #: By name, such as ``"gain"``, ``"damping"``, ``"delay"``.
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    #: Smallest change of a parameter that shows, in parts of its value.
    insensitivity: Mapping[str, float] = field(default_factory=dict)
    cost: float | None = None  #: J; up to 50 is excellent, up to 100 good (Tischler and Remple 2012, section 11.2).
    verdict: str = ""  #: What the fit is good for, in words; empty without one.
    check: Verification | None = None  #: Of the model on flying that was held out.
    check_reason: str = ""  #: Why nothing was held out; empty where there is a check, or nothing to check.

    @property
    def band(self) -> tuple[float, float] | None:
        """Return the lowest and the highest frequency with a coherence of 0.6 or more, Hz; None where there is none."""
        hz = self.measured.hz[self.measured.usable]
        return (float(hz[0]), float(hz[-1])) if len(hz) else None

    def report(self) -> ResponseReport:
        """Return what a report says of it."""
        frf = self.measured
        return ResponseReport(
            input=frf.input,
            output=frf.output,
            unit=frf.unit,
            method=frf.method,
            instrument=frf.instrument,
            source=frf.source,
            seconds=frf.duration,
            band_hz=self.band,
            structure=self.structure,
            parameters={
                name: _estimate(known, insensitivity=self.insensitivity.get(name))
                for name, known in self.parameters.items()
            },
            cost=self.cost,
            verdict=self.verdict,
            check=None if self.check is None else _check(self.check),
            check_reason=self.check_reason,
            hz=tuple(frf.hz.tolist()),
            gain_db=tuple(frf.gain_db.tolist()),
            phase_deg=tuple(np.degrees(frf.phase).tolist()),
            coherence=tuple(frf.coherence.tolist()),
            sigma=tuple(frf.sigma.tolist()),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
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

    def report(self) -> FollowingReport:
        """Return what a report says of it."""
        return FollowingReport(
            bandwidth=_estimate(self.bandwidth),
            phase_delay=_estimate(self.phase_delay),
            peak=_estimate(self.peak),
            response=self.response.report(),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoopMargins:
    """Margins of one axis' rate and angle loop, with the gains flown."""

    gains: Mapping[str, float]  #: Gains and filters by the names of the autopilot's parameters.
    computed: Margins  #: From the craft's response and the controller of the log's parameters.
    #: Straight from the chirp: the second way; None where the log does not part the two.
    measured: Margins | None = None
    #: What the margins rest on too weakly: limits reached, weak coherence, two ways that disagree.
    remarks: tuple[str, ...] = ()
    ordinary: bool = False  #: From flying without chirps: then only what the whole 95 % interval says is said.

    @property
    def state(self) -> LoopState:
        """Return what the margins say: thin below 6 dB or 45 deg."""
        margins = self.computed
        if not margins.stable:
            return LoopState.UNSTABLE
        if self.ordinary:
            return self._by_intervals()
        gain, phase = margins.gain_db.value, margins.phase_deg.value
        thin = (gain is not None and gain < LEAST_GAIN_DB) or (phase is not None and phase < LEAST_PHASE_DEG)
        if thin or margins.unstable > _MAY_BE_UNSTABLE:
            return LoopState.THIN
        return LoopState.UNKNOWN if gain is None or phase is None else LoopState.GOOD

    def _by_intervals(self) -> LoopState:
        """Return what the whole intervals say."""
        bounds = [
            (self.computed.intervals[name], least)
            for name, least in (("gain_db", LEAST_GAIN_DB), ("phase_deg", LEAST_PHASE_DEG))
            if name in self.computed.intervals
        ]
        if any(high < least for (_, high), least in bounds):
            return LoopState.THIN
        return (
            LoopState.GOOD
            if len(bounds) == 2 and all(low >= least for (low, _), least in bounds)
            else LoopState.UNKNOWN
        )

    def report(self) -> LoopReport:
        """Return what a report says of it."""
        return LoopReport(
            state=str(self.state),
            gains=self.gains,
            computed=margins_report(self.computed),
            measured=None if self.measured is None else margins_report(self.measured),
            remarks=self.remarks,
        )


#: Margins by name, as `Margins` has them.
_MARGINS = ("gain_db", "phase_deg", "crossover_hz", "rejection_hz", "peak_db")


def _estimate(known: Parameter, insensitivity: float | None = None) -> Estimate:
    return Estimate(
        value=known.value, sigma=known.sigma, unit=known.unit, reason=known.reason, insensitivity=insensitivity
    )


def _check(check: Verification) -> CheckReport:
    return CheckReport(
        seconds=check.seconds,
        fit_percent=check.fit_percent,
        theil=check.theil,
        correlation=check.correlation,
        white=None if check.residuals is None else check.residuals.white,
        verdict=check.verdict,
    )


def margins_report(margins: Margins) -> MarginsReport:
    """Return margins with their errors and intervals as reports hold them."""
    return MarginsReport(
        stable=margins.stable,
        unstable_part=margins.unstable,
        **{
            name: replace(_estimate(getattr(margins, name)), interval95=margins.intervals.get(name))
            for name in _MARGINS
        },
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisRotation:
    """What a flight tells of one axis."""

    axis: str  #: ``"roll"``, ``"pitch"`` or ``"yaw"``.
    rate: FittedResponse | None = None  #: From the rate controller's output to the body rate.
    #: Why there is no response or no model of it, with what to fly or log; empty where there are both.
    reason: str = ""
    attitude: AttitudeFollowing | None = None
    attitude_reason: str = ""  #: Why not; empty where there is.
    loop: LoopMargins | None = None
    loop_reason: str = ""  #: Why not, with what to fly or log; empty where there are.

    @property
    def rate_determined(self) -> bool:
        """Return whether it is known how strongly the axis answers its controller."""
        return self.rate is not None and "gain" in self.rate.parameters and self.rate.parameters["gain"].determined

    @property
    def determined(self) -> bool:
        """Return whether the answer to the controller, or to the attitude target, is known."""
        return self.rate_determined or (self.attitude is not None and self.attitude.determined)

    def report(self) -> AxisReport:
        """Return what a report says of it."""
        return AxisReport(
            axis=self.axis,
            determined=self.determined,
            rate=None if self.rate is None else self.rate.report(),
            reason=self.reason,
            attitude=None if self.attitude is None else self.attitude.report(),
            attitude_reason=self.attitude_reason,
            loop=None if self.loop is None else self.loop.report(),
            loop_reason=self.loop_reason,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RotationResult:
    """What a flight tells of how its craft turns, axis by axis."""

    axes: tuple[AxisRotation, ...]  #: Roll, pitch and yaw.
    vertical: AxisRotation | None = None  #: Thrust to vertical acceleration, without a loop.
    couplings: tuple[Coupling, ...] = ()  #: Of roll and pitch, as far as they could be looked at.
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
    def loops(self) -> Mapping[str, LoopMargins]:
        """Return the margins that are known, by axis."""
        return {axis.axis: axis.loop for axis in self.axes if axis.loop is not None}

    def report(self) -> RotationReport:
        """Return what a report says of it."""
        return RotationReport(
            determined=self.determined,
            axes=tuple(axis.report() for axis in self.axes),
            vertical=None if self.vertical is None else self.vertical.report(),
            couplings=tuple(
                CouplingReport(axis=each.axis, other=each.other, ratio=_estimate(each.ratio)) for each in self.couplings
            ),
        )
