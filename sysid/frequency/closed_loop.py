"""How the craft follows its attitude target: closed-loop response, bandwidth and phase delay as ADS-33 defines them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from core.parameter import Parameter
from core.quantity import uncertain
from logparse.craft.log_settings import Need, bit_to_set
from sysid.frequency.axes import Axis, FrequencyError, axis_of
from sysid.frequency.estimate import response_of_records
from sysid.frequency.excitation import Within
from sysid.frequency.fit import fit
from sysid.frequency.fitted import POOR, FrequencyFit
from sysid.frequency.flight_records import flight_span
from sysid.frequency.rate_signals import GivenSignals, LogSignals, records_of_each, sources_of
from sysid.frequency.records import AxisRecord, on_uniform_clock
from sysid.frequency.response import FrequencyResponse, lagging

#: Phase whose frequency is the bandwidth, rad.
_BANDWIDTH_PHASE = -0.75 * np.pi

#: Errors by Cramer and Rao are too small where modes, wind and pilot change. Tischler and Remple (2012, 11.3.2)
#: double them; with the choice of structure among them, halves of eleven real flights differ by 1.4 of them.
_REAL_FLIGHT = 1.5

#: Rounding [dB] of a response that only falls: it made a peak of 2e-15 ± 3e-14 dB of log_0036 with flipped bits.
_NO_PEAK = 1e-9

#: Standard deviations from which on phase delay and peak are of no use.
_LARGEST = {"s": 0.065, "dB": 3.0}


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


def attitude_response(data: GivenSignals, axis: str, *, within: Within | None = None) -> AttitudeResponse:
    """Parameter how an axis follows its attitude target, from any flight with attitude and target at 8 Hz or more.

    Parameters
    ----------
    data : FlightLog, path-like, or a sequence of either
    axis : {"roll", "pitch", "yaw"}
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
    records = records_of_each(sources_of(data, within), lambda source: _record(source, which))
    # Its target as input and its attitude as output; nothing integrates between them.
    following = Axis(axis, f"{axis} target", axis, "rad/rad", "", "", which.letter)
    frf = response_of_records(records, following)
    fitted = fit(frf)
    wider = {
        name: known if known.sigma is None else replace(known, sigma=_REAL_FLIGHT * known.sigma)
        for name, known in fitted.parameters.items()
    }
    model = replace(fitted, parameters=wider)
    bandwidth = _known(model, lambda fit: _passing(fit, _BANDWIDTH_PHASE)[0], "rad/s", _BANDWIDTH_PHASE)
    return AttitudeResponse(
        axis=axis,
        bandwidth=possible_bandwidth(bandwidth, axis),
        phase_delay=_known(model, _phase_delay, "s", -np.pi),
        peak=_known(model, peak_of, "dB"),
        frf=frf,
        fit=model,
    )


def _record(source: LogSignals, axis: Axis) -> AxisRecord:
    """Cut target and attitude [rad] of a flight, at the rows of the attitude."""
    log = source.log
    targets, attitude = log.tables.column("setpoints", axis.name), log.tables.attitude
    if targets is None or attitude is None or len(attitude) < 32 or targets.isna().all():
        raise FrequencyError(f"{log.path.name}: no attitude with its target; {bit_to_set(Need.FAST_RATES, log)}")
    wanted = targets.dropna()
    if len(wanted) < 32 or np.median(np.diff(wanted.index)) > 0.13:
        raise FrequencyError(f"{log.path.name}: the {axis.name} target comes less than 8 times a second")
    t, angle = attitude.index.to_numpy(np.float64), attitude[axis.name].to_numpy(np.float64)
    start, stop = flight_span(source, float(t[0]), float(t[-1]))
    rows = (t >= start) & (t <= stop) & np.isfinite(angle)
    if np.count_nonzero(rows) < 32:
        raise FrequencyError(f"{log.path.name}: too few rows of attitude in the air")
    target = np.interp(t[rows], wanted.index.to_numpy(np.float64), np.unwrap(wanted.to_numpy(np.float64)))
    clock, values, usable = on_uniform_clock(t[rows], [target, np.unwrap(angle[rows])])
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


def crossing_of(model: FrequencyFit, phase: float) -> float:
    """Return the first frequency at which the model's phase passes a level, rad/s; NaN if never below 100 Hz."""
    return _passing(model, phase)[0]


def _passing(model: FrequencyFit, level: float) -> tuple[float, float]:
    """Return where the model's phase first passes a level, rad/s, and its phase at twice that frequency, rad."""
    hz = np.geomspace(1e-2, 100.0, 3200)
    at, beyond = lagging(hz, (model.response(hz) * np.sign(model.values[0]))[None], level)
    return 2.0 * np.pi * float(at[0]), float(beyond[0])


def _phase_delay(model: FrequencyFit) -> float:
    at, beyond = _passing(model, -np.pi)
    return (-beyond - np.pi) / (2.0 * at)


def peak_of(model: FrequencyFit) -> float:
    """Return the largest gain over that at low frequency, dB; 0 of a response that only falls."""
    gain = np.abs(model.response(np.geomspace(0.02, 20.0, 300)))
    over = float(20.0 * np.log10(np.max(gain) / gain[0]))
    return over if over > _NO_PEAK else 0.0


def possible_bandwidth(bandwidth: Parameter, axis: str) -> Parameter:
    """Return a bandwidth, or why it is none: firmware lets the yaw target follow the heading while nobody turns."""
    if axis != "yaw" or bandwidth.value is None or bandwidth.value < 30.0:
        return bandwidth
    reason = f"{bandwidth.value:.3g} {bandwidth.unit}: no multirotor yaws so fast; its target follows the heading here"
    return Parameter(None, None, bandwidth.unit, reason)


def _known(
    model: FrequencyFit, quantity: Callable[[FrequencyFit], float], unit: str, level: float | None = None
) -> Parameter:
    """Return a quantity of a fit, of where its phase passes a level if one is given, or why it is not determined."""
    value = quantity(model)
    if not np.isfinite(value):
        return Parameter(None, None, unit, "the model's phase never passes this level below 100 Hz")
    sigma = _REAL_FLIGHT * model.sigma_of(quantity)
    if not sigma:
        return Parameter(None, None, unit, f"the structure that fits, {model.structure[0].name}, cannot show it")
    if model.cost > POOR:
        return Parameter(None, None, unit, f"the structure misses the response: cost J {model.cost:.0f}")
    if not sigma < (0.3 * value if unit == "rad/s" else _LARGEST[unit]):
        return Parameter(None, None, unit, f"{uncertain(value, sigma, unit)}: too uncertain to be of use")
    at = 0.0 if level is None else crossing_of(model, level)
    if level is not None and at > 4.0 * np.pi * float(model.responses[0].hz[model.responses[0].usable][-1]):
        passes = f"the phase passes {np.degrees(level):.0f} deg at {at:.3g} rad/s"
        return Parameter(None, None, unit, f"{passes}, beyond the frequencies that were excited")
    return Parameter(value, sigma, unit)
