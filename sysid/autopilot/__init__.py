"""Numbers that an autopilot reads, of what flights determined: each with its sigma, its reason, and a file that loads.

`autopilot_values` gathers them from the flights of one craft; `AutopilotValues.write` writes the files.
"""

from typing import TYPE_CHECKING

from core.lazy import exports

if TYPE_CHECKING:
    from sysid.autopilot.gathering import autopilot_values
    from sysid.autopilot.values import AutopilotValue, AutopilotValues

__all__ = ["AutopilotValue", "AutopilotValues", "autopilot_values"]

__getattr__, __dir__ = exports(__name__, __file__)
