"""The craft beyond the frequencies that were measured: models that fit below, followed with errors that grow.

A firmware chirp to 10 Hz foretold what one to 40 Hz measured at 33 Hz within 1 % and 1.2 deg; frames that bend and
motors that lag do not show below, which is what the growth is for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.frequency.axes import FrequencyError
from sysid.frequency.fit import fit
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.response import FrequencyResponse
from sysid.frequency.structures import low_pass
from sysid.loops.controller import GyroPath
from sysid.loops.filters import Complexes, Floats
from sysid.loops.plant import DENSITY, DRAWS, SEED, Plant

#: Standard deviation of ln G per factor e of frequency beyond the measured band, of chirps and of ordinary flights:
#: lags and modes that do not show below.
_OF_CHIRPS, OF_STICKS = 0.07, 0.10

#: Factor of the last measured frequency up to which chirps are followed, and where that is enough, Hz.
_FARTHEST, _ENOUGH = 4.0, 30.0


def followed(plant: Plant, frf: FrequencyResponse, gyro: GyroPath) -> Plant:
    """Return a measured response that ends below the first modes of frames with the models that fit it beyond.

    The gyro's filters are known from the parameters. Where no structure fits it ends where it was measured.
    """
    end = float(plant.hz[-1])
    if end >= _ENOUGH:
        return plant
    try:
        found = fit(replace(frf, response=frf.response / _known(gyro, frf, frf.hz)))
    except FrequencyError:
        return plant
    step = 1.0 / DENSITY
    hz = np.exp(np.arange(np.log(end) + step, np.log(_FARTHEST * end), step))
    models = drawn_models(found, np.append(end, hz), end, _OF_CHIRPS) * _known(gyro, frf, np.append(end, hz))
    model = found.response(np.append(end, hz)) * _known(gyro, frf, np.append(end, hz))
    beyond = models[:, 1:] / models[:, :1]
    beyond[0] = model[1:] / model[0]
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


def _known(gyro: GyroPath, frf: FrequencyResponse, hz: Floats) -> Complexes:
    """Return what the gyro's filters do beside the low-pass of the structures."""
    return np.asarray(gyro.response(hz) / low_pass(hz, frf.gyro_filter_hz))


def drawn_models(found: FrequencyFit, hz: Floats, top: float, growth: float) -> Complexes:
    """Draw models that the data leave possible, of all structures by their probability, shape (DRAWS, n).

    From the frequency `top` [Hz] on their errors grow by so much per factor e.
    """
    generator = np.random.default_rng(SEED)
    fits = (found, *(other for _, other in found.others))
    shares = np.array([1.0, *(share for share, _ in found.others)])
    picked = generator.choice(len(fits), DRAWS, p=shares / shares.sum())
    models = np.empty((DRAWS, len(hz)), np.complex128)
    for which in np.unique(picked):
        rows = picked == which
        models[rows] = _models(fits[which], hz, int(rows.sum()), generator)
    unknown = np.maximum(np.log(hz / top), 0.0) * growth
    unseen = generator.standard_normal((DRAWS, 1)) + 1j * generator.standard_normal((DRAWS, 1))
    return np.asarray(models * np.exp(unseen * unknown), np.complex128)


def _models(found: FrequencyFit, hz: Floats, count: int, generator: np.random.Generator) -> Complexes:
    """Draw models of one structure from the errors of its parameters, shape (count, n)."""
    deviation = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    # Positive parameters keep their sign.
    values = generator.multivariate_normal(found.values, found.covariance, count, method="svd")
    positive = np.array([spec.positive for spec in found.structure[0].specs])
    least = np.where(positive, 0.05 * np.abs(found.values), -np.inf)
    values = np.where(deviation > 0.0, np.maximum(values, least), found.values)
    models = np.stack([found.at(one).response(hz) for one in values])
    names = found.structure[0].names
    if "lag" not in names:
        # Below the coherent band's end a lag looks like a delay; how much of the delay is one is open.
        lag = np.maximum(values[:, [names.index("delay")]], 0.0) * generator.uniform(0.0, 1.0, (count, 1))
        models = models * np.exp(2j * np.pi * hz * lag) / (1.0 + 2j * np.pi * hz * lag)
    return np.asarray(models, np.complex128)
