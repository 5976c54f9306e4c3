"""Rate loops with known frequency responses: motor lag, delay, filters, a flexible mode; logged at loop rate.

Not a flight: each axis of the craft for itself, in its controllers, shaken by chirps, sticks and gusts. Its truth is a
formula (`AxisPlant.response`), which firmware's never is.
"""

from simulation.rate_loop.axis import AxisController, AxisPlant, AxisRun, Excitation, run_axis
from simulation.rate_loop.log import write_rate_log

__all__ = ["AxisController", "AxisPlant", "AxisRun", "Excitation", "run_axis", "write_rate_log"]
