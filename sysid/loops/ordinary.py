"""Loops of flights without chirps: the craft's model, from sticks, through the controller of the log's parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from logparse import FlightLog
from sysid.frequency.estimate import response
from sysid.frequency.fit import fit
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.response import FrequencyResponse
from sysid.frequency.structures import low_pass
from sysid.loops.beyond import OF_STICKS, drawn_models
from sysid.loops.controller import LoopError, LoopSettings
from sysid.loops.loop import RateLoop
from sysid.loops.plant import DENSITY, Plant
from sysid.loops.settings import shared_settings

#: Factor of the highest coherent frequency up to which the model is followed.
_FARTHEST = 4.0

#: Frequency [Hz] up to which the coherent band must reach.
_COHERENT_TO = 3.0

#: Time between rows [s] beyond which the loop's own frequencies fold.
_LONGEST_STEP = 0.045

#: Standard deviation of the phase margin [deg] and of ln crossover beyond which the margins are of no use.
_PHASE_KNOWN, _CROSSOVER_KNOWN = 12.0, 0.2


def ordinary_loop(name: str, frf: FrequencyResponse, found: FrequencyFit, settings: LoopSettings) -> RateLoop:
    """Close the loop around a craft's model that was fitted to ordinary flying.

    Parameters
    ----------
    name : str
        Of the log or logs.
    frf : FrequencyResponse
        From controller output to rate, through the gyro's filters.
    found : FrequencyFit
        To it, of one axis.
    settings : LoopSettings
        As flown.

    Raises
    ------
    LoopError
        Where the model is not known well enough, or says that what flew cannot fly.
    """
    if frf.method == "direct":
        raise LoopError(
            f"{settings.axis}: without the attitude target there is no instrument, and plain regression of a closed "
            "loop takes its controller for the craft; log ATT or ANG"
        )
    if frf.step > _LONGEST_STEP:
        raise LoopError(
            f"{settings.axis}: the rate loop is logged at {1.0 / frf.step:.0f} Hz, which folds what is near its "
            "crossover; log it at 25 Hz or more, and fly a chirp of mode SYSTEMID"
        )
    gain = found.parameters["gain"]
    if gain.value is None:
        raise LoopError(f"{settings.axis}: the craft's gain is not determined: {gain.reason}")
    if gain.value <= 0.0:
        raise LoopError(f"{settings.axis}: the rate answers against the controller's output: the signals are no loop's")
    coherent = frf.hz[frf.usable]
    top = float(coherent[-1])
    if top < _COHERENT_TO:
        raise LoopError(
            f"{settings.axis}: this flight tells of the craft up to {top:.1f} Hz only; fly a minute of short, sharp "
            "stick inputs, or a chirp of mode SYSTEMID"
        )
    hz = np.exp(np.arange(np.log(coherent[0]), np.log(_FARTHEST * top), 1.0 / DENSITY))
    gyro = settings.gyro.response(hz) / low_pass(hz, frf.gyro_filter_hz)
    model = np.asarray(found.response(hz) * gyro)
    draws = drawn_models(found, hz, top, OF_STICKS) * gyro
    draws[0] = model
    sigma = np.std(np.log(np.abs(draws)), axis=0)
    coherence = np.interp(hz, frf.hz, frf.coherence, right=0.0)
    plant = Plant(hz, model, sigma, coherence, draws, draws, seen=top)
    loop = RateLoop(name, frf, plant, settings, settings, None)
    _useful(loop, top)
    return loop


def loop_of_flights(logs: Sequence[FlightLog], axis: str) -> RateLoop:
    """Identify an axis' loop from what sticks, AutoTune or chirps on targets (SID_AXIS 1 to 9) showed of the craft.

    LoopError, FrequencyError where that is too little, or the flights differ in their settings.
    """
    settings = shared_settings(logs, axis)
    frf = response(logs, axis)
    return ordinary_loop(", ".join(log.path.name for log in logs), frf, fit(frf), settings)


def _useful(loop: RateLoop, top: float) -> None:
    """Refuse margins that mean nothing."""
    margins = loop.margins
    axis = loop.axis
    if not margins.stable:
        raise LoopError(
            f"{axis}: by the model of this flight, known up to {top:.1f} Hz, the loop that flew is unstable: it does "
            "not reach to the crossover; fly a chirp of mode SYSTEMID"
        )
    crossover, phase = margins.crossover_hz, margins.phase_deg
    if crossover.value is None or phase.value is None:
        raise LoopError(
            f"{axis}: the crossover lies beyond {_FARTHEST * top:.0f} Hz, and this flight tells of the craft up to "
            f"{top:.1f} Hz; fly a chirp of mode SYSTEMID"
        )
    assert crossover.sigma is not None
    assert phase.sigma is not None
    if phase.sigma > _PHASE_KNOWN or crossover.sigma > _CROSSOVER_KNOWN * crossover.value:
        raise LoopError(
            f"{axis}: the margins are too uncertain to be of use (phase margin {phase.value:.0f} +- {phase.sigma:.0f} "
            f"deg): this flight tells of the craft up to {top:.1f} Hz, and the crossover is at {crossover.value:.1f} "
            "Hz; fly a chirp of mode SYSTEMID"
        )
