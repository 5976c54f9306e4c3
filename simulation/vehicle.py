"""Multirotors: rotors on a rigid body."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from logparse.craft.frames import FRAME_CLASSES, FRAME_TYPES, motor_table
from simulation._parameters import AirframeParameters, TankParameters
from simulation.atmosphere import SEA_LEVEL_DENSITY
from simulation.drive import NO_BLADE, Battery, BladeElementRotor, Drive, QuadraticRotor, Rotor
from simulation.errors import ParameterError

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class RotorMount:
    """Where an upright rotor sits and how it turns."""

    rotor: Rotor  #: Its thrust and torque.
    position: tuple[float, float, float]  #: From the centre of gravity, body FRD, m.
    spin: int  #: +1 clockwise seen from above, -1 counter-clockwise.
    layer: int = 0  #: +1 upper, -1 lower, 0 where there is one layer.
    #: Of propeller and bell about the axis, kg m^2; makes gyroscopic moments and the kick of a rotor that speeds up.
    inertia: float = 0.0


def mounts(
    rotors: Sequence[Rotor],
    places: Sequence[Vector],
    spins: Sequence[int],
    *,
    layers: Sequence[int] = (),
    inertia: float = 0.0,
) -> tuple[RotorMount, ...]:
    """Mount upright rotors at places (forward, right, down) from the centre of gravity, m."""
    return tuple(
        RotorMount(rotor, place, spin=spin, layer=layer, inertia=inertia)
        for rotor, place, spin, layer in zip(rotors, places, spins, layers or [0] * len(rotors), strict=True)
    )


def on_frame(
    frame: str,
    kind: str,
    rotor: Rotor,
    arm: float,
    downs: dict[int, float],
    *,
    layered: bool = False,
    inertia: float = 0.0,
) -> tuple[RotorMount, ...]:
    """Mount rotors on a frame of ArduPilot, an arm [m] from its middle, as far down [m] as their spin says."""
    motors = motor_table(frame, kind)
    places = [(arm * math.cos(motor.angle), arm * math.sin(motor.angle), downs[motor.spin]) for motor in motors]
    spins = [motor.spin for motor in motors]
    return mounts([rotor] * len(motors), places, spins, layers=spins if layered else (), inertia=inertia)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tank:
    """Payload that flows out in flight: the craft's mass properties over time, linear between the entries."""

    time: tuple[float, ...]  #: s, increasing; before the first and after the last nothing changes.
    mass: tuple[float, ...]  #: Of the whole craft, kg.
    inertia: tuple[np.ndarray, ...]  #: tuple of ndarray, shape (3, 3): kg m^2.


@dataclass(frozen=True, slots=True)
class LandingGear:
    """Four feet at the corners of a square, springs and dampers on flat ground."""

    height: float = 0.18  #: Of the centre of gravity above the feet, m.
    reach: float = 0.22  #: Distance of a foot from the vertical axis, m.
    sag: float = 0.004  #: How far the craft sinks in when it stands, m.
    damping_ratio: float = 0.6  #: Of the vertical motion on all four feet.
    friction: float = 0.6  #: Coulomb coefficient.


@dataclass(frozen=True, slots=True, kw_only=True)
class Multirotor:
    """A rigid body with rotors."""

    name: str
    mass: float  #: kg.
    #: shape (3, 3): About the centre of gravity, body FRD, kg m^2. Off-diagonal elements are minus the products of
    #: inertia.
    inertia: np.ndarray
    rotors: tuple[RotorMount, ...]  #: In the order of the autopilot's motor numbers.
    drive: Drive  #: The same for all rotors.
    battery: Battery = field(default_factory=Battery)
    gear: LandingGear = field(default_factory=LandingGear)
    #: Drag per airspeed along body x, y, z at sea-level density, N s/m.
    drag_linear: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drag_area: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: Drag coefficient times area along body x, y, z, m^2.
    tank: Tank | None = None  #: Payload that flows out; mass and inertia above are then those at the start.
    #: ArduPilot's FRAME_CLASS (1 quad, 2 hexa, 3 octa) and FRAME_TYPE (0 plus, 1 x).
    frame_class: int = 3
    frame_type: int = 0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mass) and self.mass > 0.0):
            raise ParameterError(f"{self.name}: mass must be positive, not {self.mass:g} kg")

    @property
    def frame(self) -> str:
        """Frame as ArduPilot names it in its log, such as ``"OCTA/PLUS"``."""
        return f"{FRAME_CLASSES[self.frame_class]}/{FRAME_TYPES[self.frame_type]}".upper()

    @property
    def states(self) -> int:
        """Number of states of the craft with its drives."""
        return 13 + len(self.rotors) * (1 + self.drive.response.order)

    def state(
        self,
        speeds: np.ndarray,
        *,
        position: Vector = (0.0, 0.0, 0.0),
        velocity: Vector = (0.0, 0.0, 0.0),
        attitude: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0),
        rate: Vector = (0.0, 0.0, 0.0),
    ) -> np.ndarray:
        """State with rotors turning steadily at `speeds` (n,) [rad/s]; NED, quaternion to NED, body rates."""
        drives = np.zeros((len(self.rotors), self.drive.response.order))
        drives[:, :1] = speeds[:, None]
        return np.concatenate((position, velocity, attitude, rate, speeds, drives.ravel())).astype(float)

    def hover_speed(self, gravity: float, density: float = SEA_LEVEL_DENSITY) -> float:
        """Speed [rad/s] at which all rotors, turning alike, carry the weight together.

        Static thrust goes with the square of the speed for both kinds of rotor.
        """
        per_square = sum(mount.rotor.thrust(100.0, density) for mount in self.rotors) / 100.0**2
        return math.sqrt(self.mass * gravity / per_square)

    def hover_thrust(self, gravity: float, density: float, voltage: float) -> float:
        """Fraction of full thrust, at this density and voltage, that carries the weight."""
        full_speed = self.drive.speed(self.drive.pwm_max, voltage)
        available = sum(mount.rotor.thrust(full_speed, density) for mount in self.rotors)
        fraction = self.mass * gravity / available
        if fraction > 0.9:
            raise ParameterError(
                f"{self.name}: {self.mass:g} kg cannot be flown in air of {density:.3f} kg/m^3 at {voltage:.1f} V: "
                f"hover takes {100 * fraction:.0f} % of full thrust, control needs a tenth left"
            )
        return fraction

    def kernel_parameters(self, gravity: float, *, ground: bool = True) -> AirframeParameters:
        """Return the numbers that the equations of motion read."""
        gear = self.gear
        first = self.rotors[0].rotor
        quadratic = [mount.rotor for mount in self.rotors if isinstance(mount.rotor, QuadraticRotor)]
        stiffness = self.mass * gravity / gear.sag if gravity > 0.0 else 0.0
        r = gear.reach / math.sqrt(2.0)
        feet = [(sx * r, sy * r, gear.height) for sx in (1.0, -1.0) for sy in (1.0, -1.0)]
        # A craft that tumbled lies on its propellers.
        touching = np.array([*feet, *(mount.position for mount in self.rotors)])
        return AirframeParameters(
            mass=np.array([float(self.mass)]),
            gravity=float(gravity),
            inertia=np.array(self.inertia, dtype=float),
            inertia_inverse=_inverse(np.asarray(self.inertia, dtype=float)),
            tank=self._tank_parameters(),
            rotor_position=np.array([mount.position for mount in self.rotors], dtype=float),
            rotor_spin=np.array([mount.spin for mount in self.rotors], dtype=float),
            rotor_inertia=np.array([mount.inertia for mount in self.rotors], dtype=float),
            thrust_coefficient=np.array([rotor.thrust_coefficient for rotor in quadratic]),
            torque_coefficient=np.array([rotor.torque_coefficient for rotor in quadratic]),
            blade=first.kernel_parameters() if isinstance(first, BladeElementRotor) else NO_BLADE,
            response=self.drive.response.kernel_parameters(),
            drag_linear=np.array(self.drag_linear, dtype=float),
            drag_area=np.array(self.drag_area, dtype=float),
            feet=touching if ground else np.empty((0, 3)),
            ground=gear.height - gear.sag,
            foot_stiffness=stiffness / len(feet),
            foot_damping=2.0 * gear.damping_ratio * math.sqrt(stiffness * self.mass) / len(feet),
            friction=gear.friction,
        )

    def _tank_parameters(self) -> TankParameters:
        if self.tank is None:
            return TankParameters(np.zeros(1), np.array([float(self.mass)]), np.zeros((1, 3, 3)))
        return TankParameters(
            np.array(self.tank.time, dtype=float),
            np.array(self.tank.mass, dtype=float),
            np.ascontiguousarray(self.tank.inertia, dtype=float),
        )


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a 3 x 3 matrix by cofactors: the same to the last bit everywhere, which LAPACK does not promise."""
    a, b, c = matrix
    cofactors = np.column_stack((np.cross(b, c), np.cross(c, a), np.cross(a, b)))
    determinant = float((a * cofactors[:, 0]).sum())
    return np.ascontiguousarray(cofactors / determinant)
