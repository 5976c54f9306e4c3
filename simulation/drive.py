"""Drives, from the autopilot's PWM to rotor speed, their battery, and rotors, from speed to thrust and torque."""

import math
from dataclasses import dataclass

import numpy as np

from simulation._kernels import induced_velocity
from simulation._parameters import BladeParameters, DriveParameters, ResponseParameters
from simulation.atmosphere import SEA_LEVEL_DENSITY


@dataclass(frozen=True, slots=True, kw_only=True)
class QuadraticRotor:
    """Thrust ``k w^2`` and torque ``b w^2`` of Elhesasy 2024 (eq. 12), proportional to air density."""

    #: k [N s^2] and b [N m s^2] in sea-level air.
    thrust_coefficient: float
    torque_coefficient: float

    def thrust(self, speed: float, density: float = SEA_LEVEL_DENSITY) -> float:
        """Return the thrust [N] at `speed` [rad/s] in air of `density` [kg/m^3]."""
        return self.thrust_coefficient * density / SEA_LEVEL_DENSITY * speed * speed

    def torque(self, speed: float, density: float = SEA_LEVEL_DENSITY) -> float:
        """Return the torque [N m] at `speed` [rad/s] in air of `density` [kg/m^3]."""
        return self.torque_coefficient * density / SEA_LEVEL_DENSITY * speed * speed


@dataclass(frozen=True, slots=True, kw_only=True)
class BladeElementRotor:
    """Blade-element and momentum rotor of Guntur 2019 (after Stevens and Lewis), linear twist of constant pitch.

    With tip speed ``w R``, velocity through the air (U, V) across the rotor and W along it (positive sinking)::

        T = rho a b c R / 4 [(W - v) w R + 2/3 (w R)^2 (th0 + 3/4 th1) + (U^2 + V^2) (th0 + 1/2 th1)]
        T = 2 eta v rho A sqrt(U^2 + V^2 + (W - v)^2)

    are solved for the induced velocity v. The thesis gives the rotor no torque; here it is that of the ideal power
    ``T (v - W)``, a lower bound.
    """

    radius: float  #: m.
    pitch: float  #: Advance per turn of the propeller as its maker states it, m.
    chord: float  #: Mean chord, m.
    blades: int = 2
    lift_slope: float = 5.7  #: Per rad.
    efficiency: float = 1.0  #: eta.

    def kernel_parameters(self) -> BladeParameters:
        """Return the numbers that the equations of motion read."""
        angle = math.atan2(self.pitch, 2.0 * math.pi * 0.75 * self.radius)
        return BladeParameters(
            radius=float(self.radius),
            area=math.pi * self.radius**2,
            lift=float(self.lift_slope * self.blades * self.chord),
            theta0=2.0 * angle,
            theta1=-4.0 / 3.0 * angle,
            efficiency=float(self.efficiency),
        )

    def induced_velocity(
        self, speed: float, density: float = SEA_LEVEL_DENSITY, across: float = 0.0, sinking: float = 0.0
    ) -> float:
        """Return the induced velocity, m/s."""
        velocity, _ = induced_velocity(speed, across * across, sinking, density, self.kernel_parameters())
        return float(velocity)

    def thrust(
        self, speed: float, density: float = SEA_LEVEL_DENSITY, across: float = 0.0, sinking: float = 0.0
    ) -> float:
        """Return the thrust, N."""
        _, thrust = induced_velocity(speed, across * across, sinking, density, self.kernel_parameters())
        return float(thrust)

    def torque(self, speed: float, density: float = SEA_LEVEL_DENSITY) -> float:
        """Return the torque [N m] of the ideal power at rest in the air."""
        return self.thrust(speed, density) * self.induced_velocity(speed, density) / speed if speed > 0.0 else 0.0


Rotor = QuadraticRotor | BladeElementRotor

#: Placeholder in the equations of motion of rotors that follow the quadratic law.
NO_BLADE = BladeParameters(0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ThirdOrder:
    """Speed-stabilised drive of Motion 2018, eq. 6: ``Q (T s + 1) / (a3 s^3 + a2 s^2 + a1 s + 1)`` and its limits.

    The paper prints this as the transfer function from commanded speed to reaction torque. But it limits speed and
    acceleration, so here its output is the speed; the torque follows from the speed by the rotor's own law, about hover
    with ``Q = 2 b w``.
    """

    lead: float  #: T, s.
    #: s, s^2, s^3.
    a1: float
    a2: float
    a3: float
    speed_limit: float = 490.0  #: rad/s.
    acceleration_limit: float = 500.0  #: rad/s^2.
    catch_up: float = 0.005  #: Time constant with which the speed returns to that of the transfer function, s.

    @property
    def order(self) -> int:
        """Number of states beside the speed."""
        return 3

    def kernel_parameters(self) -> ResponseParameters:
        """Return the numbers that the equations of motion read."""
        coefficients = np.array([self.lead, self.a1, self.a2, self.a3])
        return ResponseParameters(self.catch_up, coefficients, self.speed_limit, self.acceleration_limit)


@dataclass(frozen=True, slots=True)
class FirstOrder:
    """First-order lag."""

    time_constant: float  #: s.

    @property
    def order(self) -> int:
        """Number of states beside the speed."""
        return 0

    def kernel_parameters(self) -> ResponseParameters:
        """Return the numbers that the equations of motion read."""
        return ResponseParameters(self.time_constant, np.empty(0), math.inf, math.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """ESC, motor and propeller as a static curve followed by a lag.

    With ``a = (pwm - low) / (high - low)`` clipped to 0..1, where `low` and `high` are the PWM at `spin_min` and
    `spin_max` of the PWM range, the speed settles at
    ``speed_max (V / voltage_reference) sqrt((1 - expo) a + expo a^2)``, so thrust follows the curve that ArduPilot
    inverts with MOT_THST_EXPO. The speed approaches it as `response` says.
    """

    speed_max: float  #: Rotor speed at full command and reference voltage, rad/s.
    response: FirstOrder | ThirdOrder
    expo: float = 0.65  #: Curvature of thrust against command, 0 (linear) to 1 (quadratic).
    voltage_reference: float = 16.8  #: Battery voltage at which `speed_max` holds, V.
    #: Ends of the PWM range, us.
    pwm_min: float = 1000.0
    pwm_max: float = 2000.0
    #: Fractions of the PWM range at idle, at zero thrust and at full thrust.
    spin_arm: float = 0.1
    spin_min: float = 0.15
    spin_max: float = 0.95
    efficiency: float = 0.7  #: Mechanical power over electrical power.

    @property
    def pwm_at_zero_thrust(self) -> float:
        """PWM [us] at which thrust begins."""
        return self.pwm_min + self.spin_min * (self.pwm_max - self.pwm_min)

    @property
    def pwm_at_full_thrust(self) -> float:
        """PWM [us] of full thrust."""
        return self.pwm_min + self.spin_max * (self.pwm_max - self.pwm_min)

    def speed(self, pwm: float, voltage: float | None = None) -> float:
        """Return the settled rotor speed [rad/s] at `pwm` [us] and `voltage` [V] (default: the reference voltage)."""
        span = self.pwm_at_full_thrust - self.pwm_at_zero_thrust
        a = min(max((pwm - self.pwm_at_zero_thrust) / span, 0.0), 1.0)
        ratio = 1.0 if voltage is None else voltage / self.voltage_reference
        return self.speed_max * ratio * math.sqrt((1.0 - self.expo) * a + self.expo * a * a)


@dataclass(frozen=True, slots=True, kw_only=True)
class Battery:
    """Lithium polymer pack: open-circuit voltage falling linearly with charge drawn, and a resistance."""

    #: Open-circuit voltage at full and no charge, V.
    voltage_full: float = 16.8
    voltage_empty: float = 14.0
    capacity: float = 5.2  #: A h.
    resistance: float = 0.012  #: Of pack and wiring, ohm.
    avionics_power: float = 6.0  #: Drawn besides the drives, W.


def drive_parameters(drive: Drive, battery: Battery) -> DriveParameters:
    """Return the numbers that the flight loop reads."""
    return DriveParameters(
        speed_max=drive.speed_max,
        expo=drive.expo,
        voltage_reference=drive.voltage_reference,
        pwm_min=drive.pwm_min,
        pwm_idle=drive.pwm_min + drive.spin_arm * (drive.pwm_max - drive.pwm_min),
        pwm_zero=drive.pwm_at_zero_thrust,
        pwm_full=drive.pwm_at_full_thrust,
        efficiency=drive.efficiency,
        voltage_full=battery.voltage_full,
        voltage_empty=battery.voltage_empty,
        capacity=battery.capacity * 3600.0,
        resistance=battery.resistance,
        avionics_power=battery.avionics_power,
    )
