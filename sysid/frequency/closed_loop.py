"""How the craft follows its attitude target: closed-loop response, bandwidth and phase delay as ADS-33 defines them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from core.parameter import Parameter
from core.quantity import uncertain
from logparse import FlightLog
from logparse.craft.log_settings import Need, bit_to_set
from sysid.frequency.axes import Axis, FrequencyError, axis_of, log_by_log
from sysid.frequency.estimate import response_of_records
from sysid.frequency.excitation import Within
from sysid.frequency.fit import fit
from sysid.frequency.fitted import POOR, FrequencyFit
from sysid.frequency.flight_records import flight_span
from sysid.frequency.rate_signals import GivenSignals, sources_of
from sysid.frequency.records import AxisRecord, on_uniform_clock
from sysid.frequency.response import Floats, FrequencyResponse

#: Phase whose frequency is the bandwidth, rad.
_BANDWIDTH_PHASE = -0.75 * np.pi

#: Errors by Cramer and Rao are too small where modes, wind and pilot change. Tischler and Remple (2012, 11.3.2)
#: double them; with the choice of structure among them, halves of eleven real flights differ by 1.4 of them.
_REAL_FLIGHT = 1.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AttitudeResponse:
    """How an axis follows its target."""

    axis: str
    #: Frequency at which the phase leaves 45 deg to -180 deg, rad/s (ADS-33E-PRF, figure 5, attitude command).
    bandwidth: Parameter
    phase_delay: Parameter  #: Slope of the phase beyond -180 deg, s (same figure).
    peak: Parameter  #: Largest gain over the gain at low frequency, dB.
    frf: FrequencyResponse = field(repr=False)
    fit: FrequencyFit = field(repr=False)

    @property
    def determined(self) -> bool:
        """Return whether bandwidth and delay are known."""
        return self.bandwidth.value is not None and self.phase_delay.value is not None


def attitude_response(
    data: GivenSignals,
    axis: str,
    *,
    part: tuple[float, float] = (0.0, 1.0),
    within: Within | None = None,
) -> AttitudeResponse:
    """Parameter how an axis follows its attitude target, from any flight with attitude and target at 8 Hz or more.

    Parameters
    ----------
    data : FlightLog, path-like, or a sequence of either
    axis : {"roll", "pitch", "yaw"}
    part : tuple of float
        From where to where in each flight, in parts of its length.
    within : tuple of float, optional
        From when to when a log counts, s on its boot clock; default its longest flight.

    Raises
    ------
    FrequencyError
        Where the data cannot give it, with what to fly or log.
    """
    which = axis_of(axis)
    if not which.attitude:
        raise FrequencyError("the vertical axis has no attitude; ask for roll, pitch or yaw")
    records, reasons = [], []
    for source in sources_of(data):
        try:
            records.append(_record(source.log, which, part, within))
        except FrequencyError as error:
            reasons.append(str(error))
    if not records:
        raise FrequencyError(log_by_log(reasons) or "no logs given")
    frf = response_of_records(records, _following(which))
    found = fit(frf)
    bandwidth = possible_bandwidth(
        _of_level(found, _BANDWIDTH_PHASE, _bandwidth, "rad/s", lambda v, s: s < 0.3 * v), axis
    )
    delay = _of_level(found, -np.pi, _phase_delay, "s", lambda _, sigma: sigma < 0.065)
    return AttitudeResponse(
        axis=axis,
        bandwidth=bandwidth,
        phase_delay=delay,
        peak=_known(found, _peak, "dB", lambda _, sigma: sigma < 3.0),
        frf=frf,
        fit=found,
    )


def _following(axis: Axis) -> Axis:
    """Return the axis with its target as input and its attitude as output; nothing integrates between them."""
    return Axis(axis.name, f"{axis.attitude} target", axis.attitude, "rad/rad", "", "", axis.letter)


def _record(log: FlightLog, axis: Axis, part: tuple[float, float], within: Within | None) -> AxisRecord:
    t, target, angle = _target_and_angle(log, axis)
    start, stop = flight_span(log, float(t[0]), float(t[-1]), within)
    start, stop = (start + share * (stop - start) for share in part)
    rows = (t >= start) & (t <= stop)
    if np.count_nonzero(rows) < 32:
        raise FrequencyError(f"{log.path.name}: too few rows of attitude in the air")
    clock, values, usable = on_uniform_clock(t[rows], [np.unwrap(target[rows]), np.unwrap(angle[rows])])
    if min(np.std(values[:, 0]), np.std(values[:, 1])) < 0.004:
        raise FrequencyError(
            f"{log.path.name}: the {axis.name} target hardly moved; fly two minutes of short stick inputs in STABILIZE"
        )
    return AxisRecord(
        name=f"{log.path.name} [{clock[0]:.1f}-{clock[-1]:.1f} s]",
        start=float(clock[0]),
        dt=float(clock[1] - clock[0]),
        inputs=values[:, :1],
        output=values[:, 1],
        instruments=values[:, :1],
        usable=usable,
        band=(0.1, 20.0),
        instrument="",
    )


def _target_and_angle(log: FlightLog, axis: Axis) -> tuple[Floats, Floats, Floats]:
    """Return times, targets and angles [rad] of an axis at the rows of its attitude."""
    targets, attitude = log.tables.column("setpoints", axis.name), log.tables.attitude
    if targets is None or attitude is None or len(attitude) < 32 or targets.isna().all():
        raise FrequencyError(f"{log.path.name}: no attitude with its target; {bit_to_set(Need.FAST_RATES, log)}")
    wanted = targets.dropna()
    if len(wanted) < 32 or np.median(np.diff(wanted.index)) > 0.13:
        raise FrequencyError(f"{log.path.name}: the {axis.name} target comes less than 8 times a second")
    t, angle = attitude.index.to_numpy(np.float64), attitude[axis.name].to_numpy(np.float64)
    target = np.interp(t, wanted.index.to_numpy(np.float64), np.unwrap(wanted.to_numpy(np.float64)))
    known = np.isfinite(angle)
    if np.count_nonzero(known) < 32:
        raise FrequencyError(f"{log.path.name}: too few rows of attitude with its target")
    return t[known], target[known], angle[known]


def _phase(found: FrequencyFit, omega: float) -> float:
    """Return the model's phase at a frequency, continuous from zero, rad."""
    hz = np.geomspace(1e-2, max(omega / (2.0 * np.pi), 2e-2), 200)
    return float(np.unwrap(np.angle(found.response(hz) * np.sign(found.values[0])))[-1])


def crossing_of(found: FrequencyFit, phase: float) -> float:
    """Return the first frequency at which the model's phase passes a level, rad/s; NaN if it never does below 50 Hz."""
    hz = np.geomspace(1e-2, 50.0, 3000)
    phases = np.unwrap(np.angle(found.response(hz) * np.sign(found.values[0])))
    if phases[0] > 0.5 * np.pi:  # A response to a target leads by less: it lags by more than half a turn.
        phases -= 2.0 * np.pi
    beyond = np.flatnonzero(phases <= phase)
    # A model that starts beyond the level is of no craft: it never passed it either.
    if not len(beyond) or beyond[0] == 0:
        return float("nan")
    k = int(beyond[0])
    part = (phase - phases[k - 1]) / (phases[k] - phases[k - 1])
    return float(2.0 * np.pi * (hz[k - 1] + part * (hz[k] - hz[k - 1])))


def _bandwidth(found: FrequencyFit) -> float:
    return crossing_of(found, _BANDWIDTH_PHASE)


def _phase_delay(found: FrequencyFit) -> float:
    at = crossing_of(found, -np.pi)
    return (-_phase(found, 2.0 * at) - np.pi) / (2.0 * at) if np.isfinite(at) else float("nan")


def _peak(found: FrequencyFit) -> float:
    gain = np.abs(found.response(np.geomspace(0.02, 20.0, 300)))
    return float(20.0 * np.log10(np.max(gain) / gain[0])) if np.argmax(gain) else 0.0


def possible_bandwidth(bandwidth: Parameter, axis: str) -> Parameter:
    """Return a bandwidth, or why it is none: firmware lets the yaw target follow the heading while nobody turns."""
    if axis != "yaw" or bandwidth.value is None or bandwidth.value < 30.0:
        return bandwidth
    reason = f"{bandwidth.value:.3g} {bandwidth.unit}: no multirotor yaws so fast; its target follows the heading here"
    return Parameter(None, None, bandwidth.unit, reason)


def _known(
    found: FrequencyFit, quantity_of: Callable[[FrequencyFit], float], unit: str, good: Callable[[float, float], bool]
) -> Parameter:
    """Return a quantity of a fit with its error (delta method), or why it is not determined."""
    value = quantity_of(found)
    if not np.isfinite(value):
        return Parameter(None, None, unit, "the model's phase never passes this level below 50 Hz")
    sigma = _REAL_FLIGHT * found.sigma_of(quantity_of)
    if not sigma:
        return Parameter(None, None, unit, f"the structure that fits, {found.structure[0].name}, cannot show it")
    if found.cost > POOR:
        return Parameter(None, None, unit, f"the structure misses the response: cost J {found.cost:.0f}")
    if not (np.isfinite(sigma) and good(value, sigma)):
        return Parameter(None, None, unit, f"{uncertain(value, sigma, unit)}: too uncertain to be of use")
    return Parameter(value, sigma, unit)


def _of_level(
    found: FrequencyFit,
    phase: float,
    quantity_of: Callable[[FrequencyFit], float],
    unit: str,
    good: Callable[[float, float], bool],
) -> Parameter:
    """Return what a fit says of where its phase passes a level, or why that is not determined."""
    known, at = _known(found, quantity_of, unit, good), crossing_of(found, phase)
    if known.value is None or at <= 4.0 * np.pi * float(found.responses[0].hz[found.responses[0].usable][-1]):
        return known
    level = f"the phase passes {np.degrees(phase):.0f} deg at {at:.3g} rad/s"
    return Parameter(None, None, unit, f"{level}, beyond the frequencies that were excited")
