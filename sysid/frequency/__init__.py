"""Frequency responses of a flight's axes: spectra, conditioning, composite windows, and fits to them.

``frf = response(data, "roll")`` estimates the response of the body rate to the rate controller's output, ``fit(frf)``
its parameters, and ``attitude_response(log, "roll")`` how the attitude follows its target (bandwidth and phase delay).
"""

from sysid.frequency.axes import AXES, FrequencyError
from sysid.frequency.closed_loop import AttitudeResponse, attitude_response
from sysid.frequency.estimate import response
from sysid.frequency.excitation import Chirp, find_chirps
from sysid.frequency.fit import fit
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.response import FrequencyResponse
from sysid.frequency.time_domain import verify

__all__ = [
    "AXES",
    "AttitudeResponse",
    "Chirp",
    "FrequencyError",
    "FrequencyFit",
    "FrequencyResponse",
    "attitude_response",
    "find_chirps",
    "fit",
    "response",
    "verify",
]
