"""`fit`: parameters of an axis from its frequency response, with what they are worth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import scipy

from core.parameter import Parameter
from core.quantity import uncertain
from core.summary import Summarised, listed
from sysid.frequency.axes import FrequencyError
from sysid.frequency.cost import ACCEPTABLE, EXCELLENT, POOR, cost
from sysid.frequency.response import Complex, Floats, FrequencyResponse
from sysid.frequency.structures import STRUCTURES, ParameterSpec, Structure, low_pass
from sysid.transfer_functions.transfer_function import TransferFunction

#: Errors of the response below which no structure is right: 1 % of gain, 0.6 deg of phase.
FLOOR = 0.01

#: Independent frequencies that a fit needs for each parameter.
_PER_PARAMETER = 1.0

#: Lags and leads beyond this [s] are no part of the response any more; modes more damped than this are none.
_LARGEST_LAG, _MODE_DAMPED = 0.5, 0.4

#: Part of the frequencies that are coherent from which on a chirp did show.
_ANSWERED = 0.3

#: Powers of the throttle with which thrust may rise about hover: by the square of a speed that is linear in it, or
#: linearised by the firmware, less where the battery sinks; more where motors start late.
_POWERS = (0.7, 4.0)

#: Damping [1/s] and delay [s] that a multirotor can have.
_POSSIBLE: Mapping[str, tuple[float, float]] = {"damping": (-8.0, 40.0), "effective_delay": (0.0, 0.3)}

#: Root mean square of the remainder in its errors up to which no mode is looked for.
_RIGID_FITS = 1.3

#: Damping and share of a mode below which it is a trick of the noise at one frequency.
_LEAST_MODE = (0.004, 0.02)

#: Standard deviations by which a lag, a lead or a mode must stand out; a delay more negative than this [s] shows that a
#: lag has taken its place.
_SIGNIFICANT, _MOST_NEGATIVE_DELAY = 3.0, -0.003

#: What structures add to the simplest. Below one standard deviation, the structure is the simpler one.
_ADDED = ("lag", "lead", "mode_share", "mode_damping", "speed_moment")

#: Times that shift the phase: the sign of each in the effective delay, which shows at low frequency.
TIMES: Mapping[str, float] = {"delay": 1.0, "lag": 1.0, "lead": -1.0}

#: Correlation with the delay beyond which a lag or a lead is not told from it: 0.94 to 0.99 in ten yaw responses of
#: firmware craft that have neither, where leads of 10 to 20 ms stood out by 4 to 13 standard deviations; 0.75 to 0.87
#: where there is a lag.
_EXCHANGED = 0.9

#: Standard deviations of what flights have in common over frequency, in parts of the value. The damping goes with the
#: flow through the rotors, which climbs, descents and speed change: forty firmware flights differ by 6 % from that of
#: hover. Spectral windows smear a mode: fifteen simulated ones err by 0.15 % and 4 % where random errors are 0.1, 2.6.
_OF_FLIGHTS: Mapping[str, float] = {"damping": 0.06, "mode_frequency": 0.001, "mode_damping": 0.03}


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


def fit(
    frf: FrequencyResponse | Sequence[FrequencyResponse],
    structure: Structure | str | None = None,
    *,
    shared: Sequence[str] = ("lag", "delay"),
    band: tuple[float, float] | None = None,
) -> FrequencyFit:
    """Fit the parameters of an axis, or of several with shared lag and delay, to measured frequency responses.

    Errors are those of the logarithm of the response, weighted by what each frequency is worth; only frequencies with a
    coherence of 0.6 or more count.

    Parameters
    ----------
    frf : FrequencyResponse or sequence of FrequencyResponse
    structure : Structure or str, optional
        One of `STRUCTURES` or its name; by default the one that explains the response with fewest parameters
        (Bayesian information criterion).
    shared : sequence of str
        Parameters that several responses have in common.
    band : tuple of float, optional
        Frequencies, Hz, outside of which nothing counts.

    Raises
    ------
    FrequencyError
        When too few frequencies are coherent, or the structure is unknown.
    """
    responses = (frf,) if isinstance(frf, FrequencyResponse) else tuple(frf)
    if not responses:
        raise FrequencyError("no frequency responses given")
    if band is not None:
        responses = tuple(response.between(*band) for response in responses)
    chosen = tuple(_choose(response, structure) for response in responses)
    if len(responses) == 1:
        return chosen[0]
    return _stated(_search(responses, tuple(part.structure[0] for part in chosen), chosen, tuple(shared)))


def refit(found: FrequencyFit, response: FrequencyResponse) -> FrequencyFit:
    """Fit the structure of an earlier fit to one response, from the values found before."""
    if np.count_nonzero(_good(response)) < len(found.values) + 2:
        raise FrequencyError(f"{response.axis}: too few coherent frequencies are left")
    return _stated(_search((response,), found.structure, None, (), found.values))


def _worth(responses: Sequence[FrequencyResponse]) -> float:
    """Return how many independent numbers the responses are worth where they count."""
    return 2.0 * sum(float(np.sum(response.weight_of_points[_good(response)])) for response in responses)


def _choose(response: FrequencyResponse, structure: Structure | str | None) -> FrequencyFit:
    """Fit one response with the structure asked for, or with the best of those of its axis."""
    kind = "closed" if response.unit == "rad/rad" else response.axis
    candidates = STRUCTURES[kind]
    if isinstance(structure, Structure):
        candidates = (structure,)
    elif structure is not None:
        candidates = tuple(s for group in STRUCTURES.values() for s in group if s.name == structure)[:1]
        if not candidates:
            known = sorted({s.name for group in STRUCTURES.values() for s in group})
            raise FrequencyError(f"there is no structure {structure!r}; there are {', '.join(known)}")
    good = response.usable & np.isfinite(response.sigma)
    worth = float(np.sum(response.weight_of_points[good])) * 2.0
    found: list[tuple[float, int, FrequencyFit]] = []
    for candidate in candidates:
        if worth < _PER_PARAMETER * len(candidate.specs) or np.count_nonzero(good) < len(candidate.specs) + 2:
            continue
        rare = "mode_frequency" in candidate.names or "speed_moment" in candidate.names
        if rare and found and min(attempt.excess for _, _, attempt in found) < _RIGID_FITS:
            continue
        for start in _starts(response, candidate):
            attempt = _search((response,), (candidate,), None, (), start)
            found.append((attempt.excess**2 * worth, len(candidate.specs), attempt))
    if not found:
        low, high = (response.hz[good][0], response.hz[good][-1]) if good.any() else (0.0, 0.0)
        raise FrequencyError(
            f"{response.axis}: {np.count_nonzero(good)} coherent frequencies"
            + (f" from {low:.2g} to {high:.2g} Hz" if good.any() else "")
            + f" are too few for a fit; {_what_to_do(response)}"
        )
    usual = max(1.0, min(misfit / max(worth - count, 1.0) for misfit, count, _ in found))
    scored = [(misfit / usual + count * np.log(max(worth, 2.0)), one) for misfit, count, one in found]
    best, chosen = min([entry for entry in scored if _plausible(entry[1])] or scored[:1], key=lambda entry: entry[0])
    rest = [(score, one) for score, one in scored if one is not chosen and _stands_out(one, 1.0) and _possible(one)]
    others = tuple((float(np.exp(min(0.5 * (best - score), 0.0))), one) for score, one in rest)
    return _stated(replace(chosen, others=others))


def _what_to_do(response: FrequencyResponse) -> str:
    if response.instrument.startswith("chirp"):
        if np.mean(response.usable) > _ANSWERED:
            return "fly a chirp that sweeps more, for 20 s at least"
        return (
            "the chirp that was flown does not show in command and answer alike: check that both are of this axis and "
            "are not at a limit, or fly it stronger"
        )
    return "fly a chirp, or a minute of short, sharp stick inputs on this axis"


def _plausible(attempt: FrequencyFit) -> bool:
    """Return whether what the structure adds lies where the response knows of it, and stands out of its errors."""
    return _stands_out(attempt, _SIGNIFICANT) and _possible(attempt)


def _stands_out(attempt: FrequencyFit, deviations: float) -> bool:
    """Return whether lag, lead, mode and moment of speed are larger than so many of their standard deviations."""
    sigma = np.sqrt(np.maximum(np.diag(attempt.covariance), 0.0))
    added = [k for k, name in enumerate(attempt.names) if name in _ADDED]
    return bool(np.all(np.abs(attempt.values[added]) > deviations * sigma[added])) and (
        _value_of("lag", attempt) == 0.0 or _value_of("lag", attempt) > 0.1 / _fastest(attempt)
    )


def _fastest(attempt: FrequencyFit) -> float:
    """Return the highest usable frequency, rad/s."""
    response = attempt.responses[0]
    return 2.0 * np.pi * float(response.hz[response.usable][-1])


def _possible(attempt: FrequencyFit) -> bool:
    """Return whether lag, lead, delay and mode are those of a craft."""
    values = dict(zip(attempt.names, attempt.values, strict=True))
    response, fastest = attempt.responses[0], _fastest(attempt)
    mode = values.get("mode_frequency")
    return bool(
        max(values.get("lag", 0.0), abs(values.get("lead", 0.0))) < _LARGEST_LAG
        and (
            values["delay"] > _MOST_NEGATIVE_DELAY or "speed_moment" in values
        )  # at its frequencies delays hardly show
        and (mode is None or 2.0 * np.pi * float(response.hz[response.usable][0]) < mode < fastest)
        and _LEAST_MODE[0] < values.get("mode_damping", 0.1) < _MODE_DAMPED
        and abs(values.get("mode_share", 1.0)) > _LEAST_MODE[1]
    )


def _starts(response: FrequencyResponse, structure: Structure) -> list[Floats]:
    """Guess parameters: gain from the middle of the band, delay from the phase at its end, modes from a scan."""
    good = response.usable & np.isfinite(response.sigma)
    hz, measured = response.hz[good], response.response[good] / low_pass(response.hz[good], response.gyro_filter_hz)
    omega = 2.0 * np.pi * hz
    integrates = response.unit == "rad/s"
    plain = measured * (1j * omega) if integrates else measured
    middle = len(hz) // 2
    closed = response.unit == "rad/rad"
    gain = float(np.abs(measured[0])) if closed else float(np.median(np.abs(plain)))
    slow = plain[: max(len(hz) // 3, 3)]  # delays have not turned them yet
    sign = float(np.sign(np.median(slow.real))) or 1.0
    slope = -np.unwrap(np.angle(sign * plain))[middle:] / omega[middle:]
    delay = float(np.clip(np.median(slope), 0.0, 0.05))
    half = np.flatnonzero(np.abs(measured) < 0.7 * np.abs(measured[0]))
    corner = float(omega[half[0]]) if len(half) else float(omega[-1])
    guess = {"gain": sign * gain, "damping": 1.0, "lag": 0.03, "lead": 0.02, "delay": delay}
    guess |= {"natural_frequency": corner, "damping_ratio": 0.7, "corner": corner}
    guess |= {"speed_moment": 50.0, "mode_damping": 0.04, "mode_share": 0.2, "mode_frequency": corner}
    if "lag" in structure.names:
        guess["delay"] = 0.3 * delay
    start = np.array([guess[name] for name in structure.names])
    if "mode_frequency" not in structure.names:
        return [start]
    at = structure.names.index("mode_frequency")
    # A mode is where the phase and the gain bend most against a smooth course.
    bend = np.abs(np.gradient(np.gradient(np.log(np.abs(plain)) + 1j * np.unwrap(np.angle(plain)))))
    bend[: max(len(bend) // 4, 2)] = 0.0
    starts = []
    for k in np.argsort(bend)[::-1][:1]:
        for share in (0.2, -0.2):
            one = start.copy()
            one[at], one[at + 2] = omega[k], share
            starts.append(one)
    return starts


def _search(
    responses: tuple[FrequencyResponse, ...],
    structures: tuple[Structure, ...],
    single: tuple[FrequencyFit, ...] | None,
    shared: tuple[str, ...],
    start: Floats | None = None,
) -> FrequencyFit:
    """Search the parameters of all responses together, from those of each for itself."""
    names: list[str] = []
    specs: list[ParameterSpec] = []
    columns: list[tuple[int, ...]] = []
    initial: list[float] = []
    for k, structure in enumerate(structures):
        own = []
        for j, spec in enumerate(structure.specs):
            common = sum(spec.name in other.names for other in structures) > 1
            alone = len(structures) == 1 or (spec.name in shared and common)
            name = spec.name if alone else f"{responses[k].axis}.{spec.name}"
            if name not in names:
                names.append(name)
                specs.append(spec)
                initial.append(float(start[j] if start is not None else single[k].values[j]))  # type: ignore[index]
            own.append(names.index(name))
        columns.append(tuple(own))
    guess = np.array(initial)
    positive = np.array([spec.positive for spec in specs])
    sign = np.where(positive, np.sign(guess), 1.0)
    scale = np.array([spec.scale for spec in specs])
    data = [_usable(response) for response in responses]

    def values_of(x: Floats) -> Floats:
        return np.asarray(np.where(positive, sign * np.exp(np.clip(x, -40.0, 40.0)), x * scale))

    def remainder(x: Floats) -> Floats:
        values = values_of(x)
        parts = []
        for structure, own, (hz, measured, weight, known) in zip(structures, columns, data, strict=True):
            with np.errstate(all="ignore"):
                error = np.log(measured / (structure.response(values[list(own)], hz) * known)) * weight
            error = np.where(np.isfinite(error), error, 1e3)
            parts += [error.real, error.imag]
        return np.concatenate(parts)

    def slopes(x: Floats) -> Floats:
        values = values_of(x)
        turns, parts = np.where(positive, values, scale), []
        for structure, own, (hz, _, weight, _) in zip(structures, columns, data, strict=True):
            slope = np.zeros((len(hz), len(x)), np.complex128)
            with np.errstate(all="ignore"):
                slope[:, list(own)] = structure.slopes(values[list(own)], hz) * -weight[:, None]
            slope = np.where(np.isfinite(slope), slope, 0.0) * turns
            parts += [slope.real, slope.imag]
        return np.concatenate(parts)

    x0 = np.where(positive, np.log(np.maximum(np.abs(guess), 1e-12)), guess / scale)
    result = scipy.optimize.least_squares(remainder, x0, slopes, method="trf", max_nfev=80, x_scale="jac")
    values = values_of(result.x)
    worth = _worth(responses)
    squares = 2.0 * float(result.cost)
    excess = max(1.0, squares / max(worth - len(specs), 1.0))
    slope = np.asarray(result.jac, dtype=np.float64)
    information = slope.T @ slope
    turn = np.where(positive, np.abs(values), scale)
    covariance = np.linalg.pinv(information, hermitian=True) * np.outer(turn, turn) * excess
    covariance += _of_flights(responses, columns, names, values)
    with np.errstate(divide="ignore"):
        alone_sigma = turn * np.sqrt(excess / np.maximum(np.diag(information), 1e-300))
        insensitivity = alone_sigma / np.maximum(np.abs(values), 1e-300)
    costs: list[float] = []
    for response, structure, places in zip(responses, structures, columns, strict=True):
        good = _good(response)
        model = structure.response(values[list(places)], response.hz[good])
        model = model * low_pass(response.hz[good], response.gyro_filter_hz)
        costs.append(cost(response.response[good], model, response.coherence[good]))
    return FrequencyFit(
        axes=tuple(response.axis for response in responses),
        structure=structures,
        parameters={},
        names=tuple(names),
        values=values,
        covariance=covariance,
        insensitivity=np.asarray(insensitivity),
        cost=max(costs),
        costs=tuple(costs),
        excess=float(np.sqrt(squares / max(worth, 1e-9))),
        responses=responses,
        columns=tuple(columns),
    )


def _of_flights(
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


def _stated(found: FrequencyFit) -> FrequencyFit:
    """Return the fit with its parameters, each with its error or why it has none."""
    specs = {
        found.names[k]: spec
        for structure, own in zip(found.structure, found.columns, strict=True)
        for k, spec in zip(own, structure.specs, strict=True)
    }
    parameters = {
        name: _parameter(spec, value, found.sigma_of(partial(_value_of, name)), found.responses)
        for (name, spec), value in zip(specs.items(), found.values.tolist(), strict=True)
    }
    if any(response.unit != "rad/rad" for response in found.responses):
        parameters |= _times(found, specs)
    reason = _refusal(parameters, found)
    if reason:
        parameters = {name: Parameter(None, None, known.unit, reason) for name, known in parameters.items()}
    return replace(found, parameters=parameters)


def _value_of(name: str, found: FrequencyFit) -> float:
    """Return a parameter of a fit; lag and lead are zero in a structure without them, other things are unknown."""
    if name in found.names:
        return float(found.values[found.names.index(name)])
    return 0.0 if name.rpartition(".")[2] in TIMES else float("nan")


def _times(found: FrequencyFit, specs: Mapping[str, ParameterSpec]) -> dict[str, Parameter]:
    """Return the effective delay of each axis, and that its parts are not determined where only their sum shows."""
    parameters = {}
    flights = _of_flights(found.responses, found.columns, found.names, found.values)
    row = max(response.step for response in found.responses)  # by as much the stamps of two signals may differ
    prefixes = dict.fromkeys(name.removesuffix("gain") for name in specs if name.rpartition(".")[2] == "gain")
    for prefix in prefixes:
        parts = [next((n for n in (f"{prefix}{each}", each) if n in specs), "") for each in TIMES]
        places = [found.names.index(name) for name in parts if name]
        spec = specs[found.names[places[0]]]

        def whole(fit: FrequencyFit, parts: Sequence[str] = parts) -> float:
            return sum(sign * _value_of(part, fit) for sign, part in zip(TIMES.values(), parts, strict=True) if part)

        value, sigma = whole(found), found.sigma_of(whole)
        known = _parameter(spec, value, sigma, found.responses)
        if -_SIGNIFICANT * sigma - row < value < 0.0:
            known = _of_none(value, sigma)
        parameters[f"{prefix}effective_delay"] = known
        delay, late = found.names[places[0]], found.values[places[0]]
        if late < 0.0:
            parameters[delay] = _of_none(float(late), found.sigma_of(partial(_value_of, delay)))
        if len(places) == 1 or _exchanged(found.covariance - flights, places):
            reason = "only the sum of delay and lag, less a lead, is determined: the effective delay"
            parameters |= {found.names[k]: Parameter(None, None, "s", reason) for k in places}
    return parameters


def _refusal(parameters: Mapping[str, Parameter], found: FrequencyFit) -> str:
    """Return why the parameters of a fit mean nothing; empty where they may."""
    # Coarse rows, averaged, leave a poor fit no excuse that the structure were too simple.
    coarse = any(response.trim is not None for response in found.responses)
    if found.cost > (ACCEPTABLE if coarse else POOR):
        return f"the structure misses the response: cost J {found.cost:.0f}"
    for name, known in parameters.items():
        limits = _POSSIBLE.get(name.rpartition(".")[2])
        if limits is not None and known.value is not None and not limits[0] < known.value < limits[1]:
            said = name.replace("_", " ")
            return (
                f"{said} of {known.value:.3g} {known.unit} is none of a craft: the data say something else than the "
                "structure"
            )
    return _power_refusal(found.responses[0], found.values[0])


def _power_refusal(response: FrequencyResponse, gain: float) -> str:
    """Return that thrust would follow no power of the throttle that there is; empty where it may, or none is known."""
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


def _good(response: FrequencyResponse) -> np.ndarray:
    return response.usable & np.isfinite(response.sigma) & (np.abs(response.response) > 0.0)


def _usable(response: FrequencyResponse) -> tuple[Floats, Complex, Floats, Complex]:
    """Return frequencies, response, weights of its logarithm and the measurement's filter, where all that counts."""
    good = _good(response)
    hz = response.hz[good]
    weight = np.sqrt(response.weight_of_points[good]) / np.hypot(response.sigma[good], FLOOR)
    return hz, response.response[good], np.asarray(weight), low_pass(hz, response.gyro_filter_hz)


def _parameter(spec: ParameterSpec, value: float, sigma: float, responses: tuple[FrequencyResponse, ...]) -> Parameter:
    """Return a parameter with its error, or why it has none."""
    if np.isfinite(sigma) and (sigma < 0.5 * abs(value) or sigma < spec.absolute):
        return Parameter(value, sigma, spec.unit)
    low = min(float(response.hz[_good(response)][0]) for response in responses)
    high = max(float(response.hz[_good(response)][-1]) for response in responses)
    return Parameter(
        None, None, spec.unit, f"not determined by {low:.2g} to {high:.2g} Hz: {uncertain(value, sigma, spec.unit)}"
    )
