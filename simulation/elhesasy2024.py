"""The craft of the sample logs: the octocopter of Elhesasy 2024 (Drones 8(7) 286), and a quadcopter of no paper."""

import numpy as np

from simulation.controllers import Cascade
from simulation.drive import Battery, Drive, FirstOrder, QuadraticRotor
from simulation.vehicle import LandingGear, Multirotor, on_frame

#: Table 2 as printed [kg m^2]; see `octocopter`.
PRINTED_INERTIA = np.array([[0.6006, 1.65e-6, 3.57e-6], [1.65e-6, 0.6016, 1.31e-6], [3.57e-6, 1.31e-6, 1.05]])


def octocopter() -> Multirotor:
    """Build the two-layer octocopter of Tables 2 and 3.

    Mass, arm, k and b are as printed. The inertia is a tenth of the print: the printed Izz of 1.05 kg m^2 would need
    all 4.3 kg to sit half a metre from the axis, beyond the rotors at 0.35 m, while a tenth of it fits a frame with
    motors of 80 g; and only with a tenth do the gains of Table 1 give damped loops (damping 0.7 instead of 0.2 in
    roll and pitch). Not printed and chosen here: full speed 1050 rad/s at 16.8 V (thrust is 2.3 times weight at sea
    level), lag 40 ms, drag, battery of 5.2 A h (the printed 1.3 A h would last two minutes), feet.
    """
    rotor = QuadraticRotor(thrust_coefficient=1.105e-5, torque_coefficient=1.779e-7)
    return Multirotor(
        name="Elhesasy 2024 octocopter",
        mass=4.3,
        inertia=np.diag((0.06006, 0.06016, 0.105)),
        rotors=on_frame("octa", "plus", rotor, 0.35, {1: -0.07, -1: -0.01}, layered=True),
        drive=Drive(speed_max=1050.0, response=FirstOrder(0.04)),
        drag_linear=(0.45, 0.45, 0.25),
        drag_area=(0.055, 0.055, 0.09),
        frame_class=3,
        frame_type=0,
    )


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
