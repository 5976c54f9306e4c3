"""What a fit to frequency responses found: values, their covariance, the model they make, and its cost J.

And which parameters the data determine, with what error; of the others why not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from core.parameter import Parameter
from core.quantity import uncertain
from core.summary import Summarised, listed
from sysid.frequency.response import Complex, Floats, FrequencyResponse
from sysid.frequency.structures import ParameterSpec, Structure, low_pass
from sysid.transfer_functions.transfer_function import TransferFunction

#: Cost up to which a fit is good, and up to which it can hardly be told from a perfect one.
ACCEPTABLE, EXCELLENT = 100.0, 50.0

#: Cost beyond which the parameters mean nothing.
POOR = 400.0


def coherence_weight(coherence: Floats) -> Floats:
    """Weigh frequencies by coherence: ``(1.58 (1 - exp(-gamma^2)))^2`` (Tischler and Remple 2012, eq. 11.4)."""
    return np.asarray((1.58 * (1.0 - np.exp(-coherence))) ** 2)


def cost(measured: Complex, modelled: Complex, coherence: Floats) -> float:
    """Compute J, the weighted mean of squared dB and degrees, times 20 (Tischler and Remple 2012, eq. 11.3).

    `measured, modelled` (n,): frequency responses; `coherence` (n,): of the measured response, from 0 to 1.
    """
    ratio = measured / modelled
    gain, phase = 20.0 * np.log10(np.abs(ratio)), np.degrees(np.angle(ratio))
    # 1 dB counts as 7.57 deg (section 11.2).
    return float(20.0 * np.mean(coherence_weight(coherence) * (gain**2 + 0.01745 * phase**2)))


#: Times that shift the phase: the sign of each in the effective delay, which shows at low frequency.
TIMES: Mapping[str, float] = {"delay": 1.0, "lag": 1.0, "lead": -1.0}

#: These, and what of a closed loop lags.
_DELAYING = (*TIMES, "corner", "damping_ratio")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FrequencyFit(Summarised):
    """Parameters fitted to one or several frequency responses."""

    axes: tuple[str, ...]
    structure: tuple[Structure, ...]  #: One for each response.
    #: By name; with several responses by ``"roll.gain"`` and so on, shared ones without the axis. A parameter that the
    #: data do not determine has no value, and a reason.
    parameters: Mapping[str, Parameter]
    names: tuple[str, ...]
    values: Floats  #: shape (k,): Of the search, in the order of `names`, determined or not.
    #: shape (k, k): Of `values`: Cramer-Rao's, widened where the response does not fit within its errors.
    covariance: Floats
    #: shape (k,): Smallest change of each parameter alone that shows, in parts of its value (Tischler and Remple 2012,
    #: 11.3.3).
    insensitivity: Floats
    cost: float  #: J, the largest of the responses; up to 100 is good, up to 50 excellent.
    costs: tuple[float, ...]  #: J of each response.
    excess: float  #: Root mean square of the remainder in its own errors; 1 where the structure is right.
    responses: tuple[FrequencyResponse, ...] = field(repr=False)
    columns: tuple[tuple[int, ...], ...] = field(repr=False)
    #: Fits with other structures that explain the response too, with their probability beside this one's 1.
    others: tuple[tuple[float, FrequencyFit], ...] = field(default=(), repr=False)

    @property
    def correlation(self) -> Floats:
        """Return the correlation of the parameters, shape (k, k)."""
        deviation = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        return np.asarray(self.covariance / np.outer(deviation, deviation))

    @property
    def verdict(self) -> str:
        """Return in a word what the fit is good for."""
        if self.cost <= EXCELLENT:
            return "excellent: within what flight tests can tell apart"
        return "good" if self.cost <= ACCEPTABLE else "poor: the structure misses part of the response"

    def sigma_of(self, quantity: Callable[[FrequencyFit], float]) -> float:
        """Return the standard deviation of what is computed from the fit: of its parameters and of its structure."""
        value = quantity(self)
        variance, whole = self._variance(quantity, value), 1.0
        for share, other in self.others:
            there = quantity(other)
            if np.isfinite(there):
                variance += share * (other._variance(quantity, there) + (there - value) ** 2)
                whole += share
        return float(np.sqrt(variance / whole))

    def _variance(self, quantity: Callable[[FrequencyFit], float], value: float) -> float:
        slope = np.zeros(len(self.values))
        for k in range(len(self.values)):
            step = 0.1 * float(np.sqrt(max(self.covariance[k, k], 1e-20)))
            moved = self.values.copy()
            moved[k] += step
            slope[k] = (quantity(self.at(moved)) - value) / step
        return max(float(slope @ self.covariance @ slope), 0.0)

    def at(self, values: Floats) -> FrequencyFit:
        """Return the model at other parameters."""
        return replace(self, values=values)

    def response(self, hz: Floats, which: int = 0) -> Complex:
        """Evaluate the model of one response, with the filter of its measurement, shape (n,)."""
        hz = np.asarray(hz, dtype=np.float64)
        own = self.values[list(self.columns[which])]
        return self.structure[which].response(own, hz) * low_pass(hz, self.responses[which].gyro_filter_hz)

    def transfer_function(self, which: int = 0) -> TransferFunction:
        """Return the model of one response as a ratio of polynomials, without the filter of the measurement."""
        columns = list(self.columns[which])
        own, structure = self.values[columns], self.structure[which]
        covariance = self.covariance[np.ix_(columns, columns)]

        def coefficients(values: Floats) -> Floats:
            num, den = structure.polynomials(values)
            return np.concatenate([num / den[0], den[1:] / den[0], values[-1:]])

        centre = coefficients(own)
        slope = np.empty((len(centre), len(own)))
        for k in range(len(own)):
            step = 1e-5 * max(abs(own[k]), structure.specs[k].scale * 1e-2)
            moved = own.copy()
            moved[k] += step
            slope[:, k] = (coefficients(moved) - centre) / step
        num, den = structure.polynomials(own)
        known = np.asarray(slope @ covariance @ slope.T)
        late = float(np.sqrt(max(known[-1, -1], 0.0)))
        return TransferFunction(num / den[0], den / den[0], known[:-1, :-1], delay=float(own[-1]), delay_std=late)

    def summary(self) -> dict[str, str]:
        """Return the structure, its cost J and the parameters."""
        parts = []
        for name, value in self.parameters.items():
            known = value.value is not None and value.sigma is not None
            parts.append(f"{name} {uncertain(value.value, value.sigma, value.unit) if known else 'unknown'}")
        kinds = "; ".join(dict.fromkeys(structure.name for structure in self.structure))
        return {
            "axes": listed(self.axes),
            "structure": kinds,
            "cost J": f"{self.cost:.1f}",
            "parameters": listed(parts),
        }


def value_of(name: str, model: FrequencyFit) -> float:
    """Return a parameter of a fit; lag and lead are zero in a structure without them, other things are unknown."""
    if name in model.names:
        return float(model.values[model.names.index(name)])
    return 0.0 if name.rpartition(".")[2] in TIMES else float("nan")


#: Powers of the throttle with which thrust may rise about hover: by the square of a speed that is linear in it, or
#: linearised by the firmware, less where the battery sinks; more where motors start late.
_POWERS = (0.7, 4.0)

#: Damping [1/s] and delay [s] that a multirotor can have.
_POSSIBLE: Mapping[str, tuple[float, float]] = {"damping": (-8.0, 40.0), "effective_delay": (0.0, 0.3)}

#: Standard deviations by which a lag, a lead or a mode must stand out, and within which a time below zero is none.
SIGNIFICANT = 3.0

#: Correlation with the delay beyond which a lag or a lead is not told from it: 0.94 to 0.99 in ten yaw responses of
#: firmware craft that have neither, where leads of 10 to 20 ms stood out by 4 to 13 standard deviations; 0.75 to 0.87
#: where there is a lag.
_EXCHANGED = 0.9

#: Standard deviations of what flights have in common over frequency, in parts of the value. The damping goes with the
#: flow through the rotors, which climbs, descents and speed change: forty firmware flights differ by 6 % from that of
#: hover. Spectral windows smear a mode: fifteen simulated ones err by 0.15 % and 4 % where random errors are 0.1, 2.6.
_OF_FLIGHTS: Mapping[str, float] = {"damping": 0.06, "mode_frequency": 0.001, "mode_damping": 0.03}


def of_flights(
    responses: Sequence[FrequencyResponse], columns: Sequence[tuple[int, ...]], names: Sequence[str], values: Floats
) -> Floats:
    """Return the covariance of what all frequencies of a response have in common, shape (k, k)."""
    variance = np.zeros(len(names))
    for response, own in zip(responses, columns, strict=True):
        # The gain comes first. What motors at their limits lack makes it too small, and late, by up to their part.
        variance[own[0]] += (np.hypot(response.systematic, response.limited) * values[own[0]]) ** 2
        if response.unit == "rad/rad":
            continue
        variance[own[-1]] = max(
            variance[own[-1]], response.systematic_delay**2 + (response.limited * values[own[-1]]) ** 2
        )
        for k in own[1:]:
            variance[k] += (_OF_FLIGHTS.get(names[k].rpartition(".")[2], 0.0) * values[k]) ** 2
    return np.diag(variance)


def stated(model: FrequencyFit) -> FrequencyFit:
    """Return the fit with its parameters, each with its error or why it has none."""
    specs = {
        model.names[k]: spec
        for structure, own in zip(model.structure, model.columns, strict=True)
        for k, spec in zip(own, structure.specs, strict=True)
    }
    parameters = {
        name: _parameter(spec, value, model.sigma_of(partial(value_of, name)), model.responses)
        for (name, spec), value in zip(specs.items(), model.values.tolist(), strict=True)
    }
    parameters |= _times(model, specs)
    reason = _refusal(parameters, model)
    if reason:
        parameters = {name: Parameter(None, None, known.unit, reason) for name, known in parameters.items()}
    return replace(model, parameters=parameters)


def _times(model: FrequencyFit, specs: Mapping[str, ParameterSpec]) -> dict[str, Parameter]:
    """Return the effective delay of each axis, and that its parts are not determined where only their sum shows."""
    parameters = {}
    flights = of_flights(model.responses, model.columns, model.names, model.values)
    row = max(response.step for response in model.responses)  # by as much the stamps of two signals may differ
    prefixes = dict.fromkeys(name.removesuffix("gain") for name in specs if name.rpartition(".")[2] == "gain")
    for prefix in prefixes:
        parts = _parts_of_delay(model, prefix)
        places = [model.names.index(name) for name in parts]
        delay = model.names[places[0]]

        def whole(fit: FrequencyFit, prefix: str = prefix) -> float:
            return sum(_parts_of_delay(fit, prefix).values())

        value, sigma = whole(model), model.sigma_of(whole)
        known = _parameter(specs[delay], value, sigma, model.responses)
        if -SIGNIFICANT * sigma - row < value < 0.0:
            known = _of_none(value, sigma)
        parameters[f"{prefix}effective_delay"] = known
        if parts[delay] < 0.0:
            parameters[delay] = _of_none(parts[delay], model.sigma_of(partial(value_of, delay)))
        # A lag or a lead that the structure lacks is in its delay.
        alone = not {"lag", "lead"} & {name.rpartition(".")[2] for name in parts}
        summed = parts if _exchanged(model.covariance - flights, places) else [delay] if alone else []
        reason = "only the sum of what lags, less what leads, is determined: the effective delay"
        parameters |= {name: Parameter(None, None, specs[name].unit, reason) for name in summed}
    return parameters


def _parts_of_delay(fit: FrequencyFit, prefix: str) -> dict[str, float]:
    """Return what parameters of an axis add to the phase of slow inputs, s, by their names, the delay first."""
    own = {part: name for part in _DELAYING for name in (part, f"{prefix}{part}") if name in fit.names}
    values = {part: value_of(name, fit) for part, name in own.items()}
    parts = {own[part]: sign * values[part] for part, sign in TIMES.items() if part in own}
    if "corner" in own:
        parts[own["corner"]] = 1.0 / values["corner"]
    if "damping_ratio" in own:
        parts[own["damping_ratio"]] = 2.0 * values["damping_ratio"] / value_of(f"{prefix}natural_frequency", fit)
    return parts


def _refusal(parameters: Mapping[str, Parameter], model: FrequencyFit) -> str:
    """Return why the parameters of a fit mean nothing; empty where they may."""
    # Coarse rows, averaged, leave a poor fit no excuse that the structure were too simple.
    coarse = any(response.trim is not None for response in model.responses)
    if model.cost > (ACCEPTABLE if coarse else POOR):
        return f"the structure misses the response: cost J {model.cost:.0f}"
    # A closed loop may follow as slowly as it is asked to.
    possible = {} if model.responses[0].unit == "rad/rad" else _POSSIBLE
    for name, known in parameters.items():
        limits = possible.get(name.rpartition(".")[2])
        if limits is not None and known.value is not None and not limits[0] < known.value < limits[1]:
            said = name.replace("_", " ")
            return (
                f"{said} of {known.value:.3g} {known.unit} is none of a craft: the data say something else than the "
                "structure"
            )
    return _power_refusal(model.responses[0], model.values[0])


def _power_refusal(response: FrequencyResponse, gain: float) -> str:
    """Report that thrust would follow no power of the throttle that there is; empty where it may, or none is known."""
    power = gain / response.trim if response.trim else 1.0
    if _POWERS[0] < power < _POWERS[1]:
        return ""
    return (
        f"thrust would rise with the power {power:.2g} of the throttle, in which it hovers: something else than the "
        "throttle moved the craft"
    )


def _of_none(value: float, sigma: float) -> Parameter:
    """Return a time below zero, which is that of no craft."""
    return Parameter(None, None, "s", f"not told from none: {uncertain(value, sigma, 's')}")


def _exchanged(covariance: Floats, places: Sequence[int]) -> bool:
    """Return whether one response does not tell two of the parameters at these places apart."""
    part = covariance[np.ix_(places, places)]
    size = np.sqrt(np.maximum(np.diag(part), 1e-300))
    return bool(np.max(np.abs(part / np.outer(size, size) - np.eye(len(places)))) > _EXCHANGED)


def _parameter(spec: ParameterSpec, value: float, sigma: float, responses: tuple[FrequencyResponse, ...]) -> Parameter:
    """Return a parameter with its error, or why it has none."""
    if np.isfinite(sigma) and (sigma < 0.5 * abs(value) or sigma < spec.absolute):
        return Parameter(value, sigma, spec.unit)
    low = min(float(response.hz[response.counts][0]) for response in responses)
    high = max(float(response.hz[response.counts][-1]) for response in responses)
    return Parameter(
        None, None, spec.unit, f"not determined by {low:.2g} to {high:.2g} Hz: {uncertain(value, sigma, spec.unit)}"
    )
