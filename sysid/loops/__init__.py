"""The autopilot's own loops: controllers and filters as firmware runs them, margins, tuning, proof, next flights."""

from typing import TYPE_CHECKING

from core.lazy import exports

if TYPE_CHECKING:
    from sysid.loops.chirps import Limits
    from sysid.loops.controller import AngleController, GyroPath, LoopError, LoopSettings, RateController
    from sysid.loops.design import Design, design
    from sysid.loops.known_margins import Margins
    from sysid.loops.loop import RateLoop, ordinary_loop, rate_loop
    from sysid.loops.proof import Proof, prove
    from sysid.loops.safety import AIMS, Aim
    from sysid.loops.settings import read_settings
    from sysid.loops.tuning import Tuning, tune

__all__ = [
    "AIMS",
    "Aim",
    "AngleController",
    "Design",
    "GyroPath",
    "Limits",
    "LoopError",
    "LoopSettings",
    "Margins",
    "Proof",
    "RateController",
    "RateLoop",
    "Tuning",
    "design",
    "ordinary_loop",
    "prove",
    "rate_loop",
    "read_settings",
    "tune",
]

__getattr__, __dir__ = exports(__name__, __file__)
