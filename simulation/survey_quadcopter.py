"""A small quadcopter in X, of no paper: what ten-inch propellers on 1.6 kg usually are."""

import numpy as np

from simulation.controllers import Cascade
from simulation.drive import Battery, Drive, FirstOrder, QuadraticRotor
from simulation.vehicle import LandingGear, Multirotor, on_frame

#: Gains for damped loops: the rate loops close at about 16 rad/s, half of what rotor lag and gyro filter allow.
CASCADE = Cascade(
    angle_p=(5.0, 5.0, 2.5),
    roll_rate=(0.065, 0.04, 0.0008),
    pitch_rate=(0.065, 0.04, 0.0008),
    yaw_rate=(0.35, 0.02, 0.0),
)


def quadcopter() -> Multirotor:
    """Build the craft: arms of 0.23 m, thrust three times weight, rotors whose inertia is felt."""
    rotor = QuadraticRotor(thrust_coefficient=1.2e-5, torque_coefficient=1.9e-7)
    return Multirotor(
        name="survey quadcopter",
        mass=1.6,
        inertia=np.diag((0.016, 0.018, 0.029)),
        rotors=on_frame("quad", "x", rotor, 0.23, {1: -0.03, -1: -0.03}, inertia=4.5e-5),
        drive=Drive(speed_max=1000.0, response=FirstOrder(0.03), expo=0.55),
        battery=Battery(capacity=4.0, resistance=0.02),
        gear=LandingGear(height=0.12, reach=0.18, sag=0.003),
        drag_linear=(0.18, 0.18, 0.1),
        drag_area=(0.02, 0.02, 0.035),
        frame_class=1,
        frame_type=1,
    )
