"""Axes with known frequency responses (motor lag, delay, filters, a flexible mode) in ArduCopter's controllers.

Not a flight: each axis of the craft for itself, shaken by chirps, sticks and gusts. Its truth is a formula
(`AxisPlant.response`), which firmware's never is.
"""

from simulation.axis_loop.axis import AxisPlant, AxisRun, Excitation, LoopGains, random_axis, run_axis
from simulation.axis_loop.log import write_rate_log

__all__ = ["AxisPlant", "AxisRun", "Excitation", "LoopGains", "random_axis", "run_axis", "write_rate_log"]
