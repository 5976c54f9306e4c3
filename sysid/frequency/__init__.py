"""Frequency responses of a flight's axes: spectra, conditioning, composite windows, and fits to them."""

from sysid.frequency.axes import AXES, FrequencyError
from sysid.frequency.estimate import response
from sysid.frequency.excitation import Chirp, find_chirps
from sysid.frequency.response import FrequencyResponse

__all__ = ["AXES", "Chirp", "FrequencyError", "FrequencyResponse", "find_chirps", "response"]
