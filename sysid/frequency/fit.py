"""`fit`: parameters of an axis from its frequency response, with what they are worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from sysid.frequency.axes import FrequencyError
from sysid.frequency.fitted import SIGNIFICANT, cost, of_flights, stated, value_of
from sysid.frequency.fitted import FrequencyFit as FrequencyFit
from sysid.frequency.response import Complex, Floats, FrequencyResponse
from sysid.frequency.structures import STRUCTURES, ParameterSpec, Structure, low_pass

#: Errors of the response below which no structure is right: 1 % of gain, 0.6 deg of phase.
FLOOR = 0.01

#: Damping and share of a mode below which it is a trick of the noise at one frequency.
_LEAST_MODE = (0.004, 0.02)


def fit(
    frf: FrequencyResponse | Sequence[FrequencyResponse],
    structure: Structure | str | None = None,
    *,
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
    starts = [part.values for part in chosen]
    return stated(_search(responses, tuple(part.structure[0] for part in chosen), starts))


def refit(earlier: FrequencyFit, response: FrequencyResponse) -> FrequencyFit:
    """Fit the structure of an earlier fit to one response, from the values found before."""
    if np.count_nonzero(response.counts) < len(earlier.values) + 2:
        raise FrequencyError(f"{response.axis}: too few coherent frequencies are left")
    return stated(_search((response,), earlier.structure, [earlier.values]))


def _worth(responses: Sequence[FrequencyResponse]) -> float:
    """Return how many independent numbers the responses are worth where they count."""
    return 2.0 * sum(float(np.sum(response.weight_of_points[response.counts])) for response in responses)


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
    good = response.counts
    worth = _worth((response,))
    attempts: list[tuple[float, int, FrequencyFit]] = []
    for candidate in candidates:
        if worth < len(candidate.specs) or np.count_nonzero(good) < len(candidate.specs) + 2:
            continue
        rare = "mode_frequency" in candidate.names or "speed_moment" in candidate.names
        # No mode is looked for where the remainder is its errors already.
        if rare and attempts and min(attempt.excess for _, _, attempt in attempts) < 1.3:
            continue
        for start in _starts(response, candidate):
            attempt = _search((response,), (candidate,), [start])
            attempts.append((attempt.excess**2 * worth, len(candidate.specs), attempt))
    if not attempts:
        low, high = (response.hz[good][0], response.hz[good][-1]) if good.any() else (0.0, 0.0)
        raise FrequencyError(
            f"{response.axis}: {np.count_nonzero(good)} coherent frequencies"
            + (f" from {low:.2g} to {high:.2g} Hz" if good.any() else "")
            + f" are too few for a fit; {_what_to_do(response)}"
        )
    usual = max(1.0, min(misfit / max(worth - count, 1.0) for misfit, count, _ in attempts))
    scored = [(misfit / usual + count * np.log(max(worth, 2.0)), one) for misfit, count, one in attempts]
    best, chosen = min([entry for entry in scored if _plausible(entry[1])] or scored[:1], key=lambda entry: entry[0])
    rest = [(score, one) for score, one in scored if one is not chosen and _stands_out(one, 1.0) and _possible(one)]
    others = tuple((float(np.exp(min(0.5 * (best - score), 0.0))), one) for score, one in rest)
    return stated(replace(chosen, others=others))


def _what_to_do(response: FrequencyResponse) -> str:
    if response.instrument.startswith("chirp"):
        if np.mean(response.usable) > 0.3:
            return "fly a chirp that sweeps more, for 20 s at least"
        return (
            "the chirp that was flown does not show in command and answer alike: check that both are of this axis and "
            "are not at a limit, or fly it stronger"
        )
    return "fly a chirp, or a minute of short, sharp stick inputs on this axis"


def _plausible(attempt: FrequencyFit) -> bool:
    """Return whether what the structure adds lies where the response knows of it, and stands out of its errors."""
    return _stands_out(attempt, SIGNIFICANT) and _possible(attempt)


def _stands_out(attempt: FrequencyFit, deviations: float) -> bool:
    """Return whether lag, lead, mode and moment of speed are larger than so many of their standard deviations."""
    sigma = np.sqrt(np.maximum(np.diag(attempt.covariance), 0.0))
    adds = ("lag", "lead", "mode_share", "mode_damping", "speed_moment")  # to the simplest structure
    added = [k for k, name in enumerate(attempt.names) if name in adds]
    return bool(np.all(np.abs(attempt.values[added]) > deviations * sigma[added])) and (
        value_of("lag", attempt) == 0.0 or value_of("lag", attempt) > 0.1 / _fastest(attempt)
    )


def _fastest(attempt: FrequencyFit) -> float:
    """Return the highest frequency that counts, rad/s."""
    response = attempt.responses[0]
    return 2.0 * np.pi * float(response.hz[response.counts][-1])


def _possible(attempt: FrequencyFit) -> bool:
    """Return whether lag, lead, delay and mode are those of a craft."""
    values = dict(zip(attempt.names, attempt.values, strict=True))
    response, fastest = attempt.responses[0], _fastest(attempt)
    mode = values.get("mode_frequency")
    return bool(
        max(values.get("lag", 0.0), abs(values.get("lead", 0.0))) < 0.5
        and (values["delay"] > -0.003 or "speed_moment" in values)  # at its frequencies delays hardly show
        and (mode is None or 2.0 * np.pi * float(response.hz[response.counts][0]) < mode < fastest)
        and _LEAST_MODE[0] < values.get("mode_damping", 0.1) < 0.4
        and abs(values.get("mode_share", 1.0)) > _LEAST_MODE[1]
    )


def _starts(response: FrequencyResponse, structure: Structure) -> list[Floats]:
    """Guess parameters: gain from the middle of the band, delay from the phase at its end, modes from a scan."""
    good = response.counts
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
    guess |= {"speed_moment": 50.0, "mode_damping": 0.04}
    if "lag" in structure.names:
        guess["delay"] = 0.3 * delay
    guesses = [guess]
    if "mode_frequency" in structure.names:
        # A mode is where the phase and the gain bend most against a smooth course, beyond their errors.
        bend = np.abs(np.gradient(np.gradient(np.log(np.abs(plain)) + 1j * np.unwrap(np.angle(plain)))))
        bend /= np.hypot(response.sigma[good], FLOOR)
        bend[: max(len(bend) // 4, 2)] = 0.0
        mode = float(omega[np.argmax(bend)])
        guesses = [guess | {"mode_frequency": mode, "mode_share": share} for share in (0.2, -0.2)]
    return [np.array([guess[name] for name in structure.names]) for guess in guesses]


def _search(
    responses: tuple[FrequencyResponse, ...], structures: tuple[Structure, ...], starts: Sequence[Floats]
) -> FrequencyFit:
    """Search the parameters of all responses together, from values of each for itself."""
    names: list[str] = []
    specs: list[ParameterSpec] = []
    columns: list[tuple[int, ...]] = []
    initial: list[float] = []
    for k, structure in enumerate(structures):
        own = []
        for j, spec in enumerate(structure.specs):
            common = sum(spec.name in other.names for other in structures) > 1
            alone = len(structures) == 1 or (spec.name in ("lag", "delay") and common)
            name = spec.name if alone else f"{responses[k].axis}.{spec.name}"
            if name not in names:
                names.append(name)
                specs.append(spec)
                initial.append(float(starts[k][j]))
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
    # A millionth of the cost, or of a parameter, is far within its error: what came after took a third of the steps.
    result = scipy.optimize.least_squares(
        remainder, x0, slopes, method="lm", max_nfev=80, x_scale="jac", ftol=1e-6, xtol=1e-6, gtol=1e-6
    )
    values = values_of(result.x)
    worth = _worth(responses)
    squares = 2.0 * float(result.cost)
    excess = max(1.0, squares / max(worth - len(specs), 1.0))
    slope = np.asarray(result.jac, dtype=np.float64)
    information = slope.T @ slope
    turn = np.where(positive, np.abs(values), scale)
    covariance = _inverse(information) * np.outer(turn, turn) * excess
    covariance += of_flights(responses, columns, names, values)
    with np.errstate(divide="ignore"):
        alone_sigma = turn * np.sqrt(excess / np.maximum(np.diag(information), 1e-300))
        insensitivity = alone_sigma / np.maximum(np.abs(values), 1e-300)
    costs: list[float] = []
    for response, structure, places in zip(responses, structures, columns, strict=True):
        good = response.counts
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


def _inverse(information: Floats) -> Floats:
    """Invert an information matrix; a direction that it knows nothing of gets a large variance, never none."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-12 * max(float(np.max(np.diag(information))), 1e-300)))
    known, directions = np.linalg.eigh(information / np.outer(size, size))
    return np.asarray((directions / np.maximum(known, 1e-12)) @ directions.T / np.outer(size, size))


def _usable(response: FrequencyResponse) -> tuple[Floats, Complex, Floats, Complex]:
    """Return frequencies, response, weights of its logarithm and the measurement's filter, where all that counts."""
    good = response.counts
    hz = response.hz[good]
    weight = np.sqrt(response.weight_of_points[good]) / np.hypot(response.sigma[good], FLOOR)
    return hz, response.response[good], np.asarray(weight), low_pass(hz, response.gyro_filter_hz)
