"""The autopilot's own loops: controllers and filters as firmware runs them, margins, tuning, proof and the next flight."""

from sysid.loops.controller import AngleController, PidTerms, RateController
from sysid.loops.errors import LoopError
from sysid.loops.loop import Margins, RateLoop, rate_loop
from sysid.loops.settings import GyroPath, LoopSettings, read_settings

__all__ = [
    "AngleController",
    "GyroPath",
    "LoopError",
    "LoopSettings",
    "Margins",
    "PidTerms",
    "RateController",
    "RateLoop",
    "rate_loop",
    "read_settings",
]
