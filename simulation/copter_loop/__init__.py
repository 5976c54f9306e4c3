"""One axis of known response in ArduCopter's rate and angle controllers, as firmware runs them at 400 Hz."""

from simulation.copter_loop.axis import CraftAxis, LoopFlight, LoopGains, fly_chirp, random_axis

__all__ = ["CraftAxis", "LoopFlight", "LoopGains", "fly_chirp", "random_axis"]
