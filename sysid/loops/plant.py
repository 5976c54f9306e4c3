"""The craft's response from mixer to gyro on a dense grid, smoothed, with draws of its error.

Beyond the frequencies that were measured models that fit below are followed, with errors that grow. A firmware chirp to
10 Hz foretold what one to 40 Hz measured at 33 Hz within 1 % and 1.2 deg; frames that bend and motors that lag do not
show below, which is what the growth is for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sysid.frequency.axes import AXES, FrequencyError
from sysid.frequency.fit import fit
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.response import FrequencyResponse
from sysid.frequency.structures import low_pass
from sysid.loops.controller import GyroPath
from sysid.loops.filters import Complexes, Floats

#: Points of the dense grid per factor e of frequency.
_DENSITY = 110.0

#: Half-widths of the local regression in ln f, narrow to wide, and how few points it may hold.
REACHES, FEWEST = (0.1, 0.2, 0.4, 0.8), 5

#: Draws of the response that intervals are made of, and their seed.
DRAWS, SEED = 200, 20160516

#: What one flight cannot know of the next: standard deviations of the gain (battery, density, trim thrust) and of the
#: delay [s] (where in the loop the gyro sample falls). Measured between the two chirps of firmware flights and kept.
GAIN_BETWEEN_FLIGHTS, DELAY_BETWEEN_FLIGHTS = 0.015, 0.1e-3

#: Standard deviation of ln G per factor e of frequency beyond the measured band, of chirps and of ordinary flights:
#: lags and modes that do not show below.
_OF_CHIRPS, _OF_STICKS = 0.07, 0.10

#: Factor of the last measured frequency up to which models are followed.
FARTHEST = 4.0

#: Chirps that end below [Hz] have not seen the first modes of frames.
FIRST_MODES = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class Plant:
    """Response of an axis on a dense grid."""

    hz: Floats  #: shape (n,): Evenly spaced in ln f.
    response: Complexes  #: shape (n,): rad/s of the rate as measured per unit of mixer input.
    sigma: Floats  #: shape (n,): Standard deviation of gain (relative) and phase (rad) by random error.
    coherence: Floats  #: shape (n,)
    draws: Complexes  #: shape (DRAWS, n): Responses that the data leave possible, for the next flight.
    own_draws: Complexes  #: shape (DRAWS, n): The same for the flight itself.
    seen: float  #: Frequency up to which it was measured, Hz; beyond, models that fit below are followed.


def plant_of(frf: FrequencyResponse, systematic: Callable[[Floats], Floats] | None = None) -> Plant:
    """Smooth a measured response and draw from its error.

    ln G, with the phase unwrapped and the trend of a line in f (delay) and ln f (integration) taken out, is replaced at
    each frequency by a weighted quadratic in ln f over neighbours; its error is the larger of what the spectra and the
    scatter of the neighbours about it claim. The neighbourhood is the widest of `REACHES` that agrees with the narrower
    ones (Lepskii 1991), so that a flexible mode is not smoothed away.
    """
    keep = np.isfinite(frf.sigma) & (np.abs(frf.response) > 0.0)
    if not keep.any():
        raise FrequencyError(f"{frf.axis}: no part of the response has a known error; fly the chirp again")
    hz = frf.hz[keep]
    log_g = np.log(np.abs(frf.response[keep])) + 1j * np.unwrap(np.angle(frf.response[keep]))
    sigma = np.maximum(frf.sigma[keep], 1e-4)
    independent = np.minimum(frf.weight_of_points[keep], 1.0)
    trend = np.column_stack([np.ones(len(hz)), np.log(hz), hz])
    weight = 1.0 / np.maximum(sigma, 0.01)
    coefficients = np.linalg.lstsq(trend * weight[:, None], log_g * weight, rcond=None)[0]
    rest = log_g - trend @ coefficients
    dense = np.exp(np.arange(np.log(hz[0]), np.log(hz[-1]), 1.0 / _DENSITY))
    smooth, error, reach = _smoothed(np.log(dense), np.log(hz), rest, sigma, independent)
    known = error < 0.25
    if known.sum() >= FEWEST:
        first, last = int(np.argmax(known)), len(known) - int(np.argmax(known[::-1]))
        dense, smooth = dense[first:last], smooth[first:last]
        error, reach = error[first:last], reach[first:last]
    response = np.exp(smooth + np.column_stack([np.ones(len(dense)), np.log(dense), dense]) @ coefficients)
    if systematic is not None:
        error = np.hypot(error, systematic(dense))
    resolution = np.interp(dense, hz, frf.resolution[keep])
    coherence = np.interp(dense, hz, frf.coherence[keep])
    here, between = _errors(dense, error, resolution, reach, gain_between_flights(frf.axis))
    return Plant(
        dense, response, error, coherence, response * np.exp(here + between), response * np.exp(here), float(dense[-1])
    )


def _smoothed(
    at: Floats, x: Floats, y: Complexes, sigma: Floats, independent: Floats
) -> tuple[Complexes, Floats, Floats]:
    """Return value, standard deviation and reach, shape (k,) each, of the widest regressions that agree with narrower.

    `at` (k,): where, ln f; `x`, `y`, `sigma`, `independent` (n,): ln f, ln G, its error and weight as independent data.
    """
    values, errors, reaches = _local(at, x, y, sigma, independent, REACHES[0])
    narrower, agrees = [(values, errors)], np.ones(len(at), np.bool_)
    for wanted in REACHES[1:]:
        value, error, reach = _local(at, x, y, sigma, independent, wanted)
        for before, narrow in narrower:
            agrees &= np.abs(value - before) <= 2.5 * np.maximum(narrow, error)
        narrower.append((value, error))
        values, errors = np.where(agrees, value, values), np.where(agrees, error, errors)
        reaches = np.where(agrees, reach, reaches)
    return values, errors, reaches


def _local(
    at: Floats, x: Floats, y: Complexes, sigma: Floats, independent: Floats, wanted: float
) -> tuple[Complexes, Floats, Floats]:
    """Fit a quadratic to the neighbours of each point; return values there, standard deviations and reaches."""
    apart = np.abs(x - at[:, None])
    nearest = np.partition(apart, min(FEWEST, len(x)) - 1, axis=1)[:, min(FEWEST, len(x)) - 1]
    reach = np.maximum(wanted, 1.01 * nearest)
    near = apart < reach[:, None]
    offset = np.where(near, (x - at[:, None]) / reach[:, None], 0.0)
    weight = np.where(near, (1.0 - np.abs(offset) ** 3) ** 3, 0.0) / np.maximum(sigma, 0.005) ** 2
    basis = np.stack([np.ones_like(offset), offset, offset**2], axis=2)
    weighted = (basis * weight[:, :, None]).transpose(0, 2, 1)
    solved = np.linalg.solve(weighted @ basis, weighted)
    beta = solved @ y
    scatter = np.abs(y - np.einsum("knj,kj->kn", basis, beta)) ** 2 / 2.0
    alone = np.where(near, independent, 0.0).sum(axis=1)
    spare = np.maximum(1.0 - 3.0 / np.maximum(alone, 4.0), 0.25)
    variance = np.maximum(sigma**2, ((scatter * weight).sum(axis=1) / weight.sum(axis=1) / spare)[:, None])
    # Points closer than the spectral window share their data: their errors do not average out.
    count = np.maximum(alone / np.maximum(near.sum(axis=1), 1), 1e-3)
    return beta[:, 0], np.sqrt(np.sum(solved[:, 0] ** 2 * variance, axis=1) / count), reach


def gain_between_flights(axis: str) -> float:
    """Return the standard deviation of ln |G| between flights."""
    return float(np.hypot(GAIN_BETWEEN_FLIGHTS, AXES[axis].between_trims))


def _errors(
    hz: Floats, sigma: Floats, resolution: Floats, reach: Floats, other_gain: float
) -> tuple[Complexes, Complexes]:
    """Draw errors of ln G, shape (DRAWS, n): of the estimate, and what the next flight adds.

    Those of the estimate are correlated over the spectral window and the smoothing's reach.
    """
    generator = np.random.default_rng(SEED)
    width = np.maximum(resolution / hz, reach)
    cells = np.concatenate([[0.0], np.cumsum(np.diff(np.log(hz)) / (0.5 * (width[1:] + width[:-1])))])
    knots = np.arange(np.ceil(cells[-1]) + 2.0)
    shape = (DRAWS, len(knots))
    white = generator.standard_normal(shape) + 1j * generator.standard_normal(shape)
    low = np.minimum(cells.astype(int), len(knots) - 2)
    share = cells - low
    mixed = white[:, low] * np.cos(0.5 * np.pi * share) + white[:, low + 1] * np.sin(0.5 * np.pi * share)
    gain = generator.normal(0.0, other_gain, (DRAWS, 1))
    delay = generator.normal(0.0, DELAY_BETWEEN_FLIGHTS, (DRAWS, 1))
    here = np.asarray(mixed * sigma, np.complex128)
    between = np.asarray(gain - 2j * np.pi * delay * hz, np.complex128)
    here[0], between[0] = 0.0, 0.0  # the first draw is the estimate itself
    return here, between


def followed(plant: Plant, frf: FrequencyResponse, gyro: GyroPath) -> Plant:
    """Return a measured response that ends below the first modes of frames with the models that fit it beyond.

    Where no structure fits it ends where it was measured.
    """
    end = float(plant.hz[-1])
    if end >= FIRST_MODES:
        return plant
    try:
        model = fit(replace(frf, response=frf.response / _beside(gyro, frf, frf.hz)))
    except FrequencyError:
        return plant
    step = 1.0 / _DENSITY
    hz = np.exp(np.arange(np.log(end) + step, np.log(FARTHEST * end), step))
    models = _drawn(model, frf, gyro, np.append(end, hz), end, _OF_CHIRPS)
    beyond = models[:, 1:] / models[:, :1]
    # Of another flight's gain and delay the delay turns the phase on.
    other = np.log(plant.draws[:, -1:] / plant.own_draws[:, -1:])
    own = plant.own_draws[:, -1:] * beyond
    draws = own * np.exp(other.real + 1j * other.imag * hz / end)
    sigma = np.std(np.log(np.abs(own)), axis=0)
    return Plant(
        hz=np.concatenate([plant.hz, hz]),
        response=np.concatenate([plant.response, plant.response[-1] * beyond[0]]),
        sigma=np.concatenate([plant.sigma, sigma]),
        coherence=np.concatenate([plant.coherence, np.zeros(len(hz))]),
        draws=np.concatenate([plant.draws, draws], axis=1),
        own_draws=np.concatenate([plant.own_draws, own], axis=1),
        seen=end,
    )


def plant_of_model(model: FrequencyFit, frf: FrequencyResponse, gyro: GyroPath) -> Plant:
    """Return the model that fits ordinary flying."""
    coherent = frf.hz[frf.usable]
    top = float(coherent[-1])
    hz = np.exp(np.arange(np.log(coherent[0]), np.log(FARTHEST * top), 1.0 / _DENSITY))
    draws = _drawn(model, frf, gyro, hz, top, _OF_STICKS)
    sigma = np.std(np.log(np.abs(draws)), axis=0)
    return Plant(hz, draws[0], sigma, np.interp(hz, frf.hz, frf.coherence, right=0.0), draws, draws, seen=top)


def _beside(gyro: GyroPath, frf: FrequencyResponse, hz: Floats) -> Complexes:
    """Return what the gyro's filters, which the parameters tell, do beside the low-pass of the structures."""
    return np.asarray(gyro.response(hz) / low_pass(hz, frf.gyro_filter_hz))


def _drawn(
    model: FrequencyFit, frf: FrequencyResponse, gyro: GyroPath, hz: Floats, top: float, growth: float
) -> Complexes:
    """Draw models that the data leave possible, of all structures by their probability, the best first, (DRAWS, n).

    From the frequency `top` [Hz] on their errors grow by so much per factor e.
    """
    generator = np.random.default_rng(SEED)
    fits = (model, *(other for _, other in model.others))
    shares = np.array([1.0, *(share for share, _ in model.others)])
    picked = generator.choice(len(fits), DRAWS, p=shares / shares.sum())
    models = np.empty((DRAWS, len(hz)), np.complex128)
    for which in np.unique(picked):
        rows = picked == which
        models[rows] = _models(fits[which], hz, int(rows.sum()), generator)
    unknown = np.maximum(np.log(hz / top), 0.0) * growth
    departures = generator.standard_normal((DRAWS, 1)) + 1j * generator.standard_normal((DRAWS, 1))
    models *= np.exp(departures * unknown)
    models[0] = model.response(hz)
    return models * _beside(gyro, frf, hz)


def _models(model: FrequencyFit, hz: Floats, count: int, generator: np.random.Generator) -> Complexes:
    """Draw models of one structure from the errors of its parameters, shape (count, n)."""
    deviation = np.sqrt(np.maximum(np.diag(model.covariance), 0.0))
    # Positive parameters keep their sign.
    values = generator.multivariate_normal(model.values, model.covariance, count, method="svd")
    positive = np.array([spec.positive for spec in model.structure[0].specs])
    least = np.where(positive, 0.05 * np.abs(model.values), -np.inf)
    values = np.where(deviation > 0.0, np.maximum(values, least), model.values)
    models = np.stack([model.at(one).response(hz) for one in values])
    names = model.structure[0].names
    if "lag" not in names:
        # Below the coherent band's end a lag looks like a delay; how much of the delay is one is open.
        lag = np.maximum(values[:, [names.index("delay")]], 0.0) * generator.uniform(0.0, 1.0, (count, 1))
        models = models * np.exp(2j * np.pi * hz * lag) / (1.0 + 2j * np.pi * hz * lag)
    return np.asarray(models, np.complex128)
