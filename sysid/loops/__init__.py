"""The autopilot's own loops: controllers and filters as firmware runs them, margins, tuning, proof, next flights."""

from sysid.loops.controller import AngleController, PidTerms, RateController
from sysid.loops.errors import LoopError
from sysid.loops.loop import Margins, RateLoop, rate_loop
from sysid.loops.proof import Proof, prove
from sysid.loops.settings import GyroPath, LoopSettings, read_settings
from sysid.loops.tuning import AIMS, Aim, Tuning, tune

__all__ = [
    "AIMS",
    "Aim",
    "AngleController",
    "GyroPath",
    "LoopError",
    "LoopSettings",
    "Margins",
    "PidTerms",
    "Proof",
    "RateController",
    "RateLoop",
    "Tuning",
    "prove",
    "rate_loop",
    "read_settings",
    "tune",
]
