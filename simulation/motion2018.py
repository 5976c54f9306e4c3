"""The quadcopter of Motion 2018, flown to a point by its autopilot.

The paper's axes are x forward, y up, z right; here x is north, z east and y minus down. Printed are the form of the
drive (eq. 6), its limits, the inertias (eq. 7-9), Euler's method with 1e-4 s, GOST 4401-81 for the air, what counts
as arrival, and the points of three flights. Masses, coefficients and gains are not printed: those below are chosen so
that a craft of 1 kg hovers at 300 rad/s, and the drive settles within 0.15 s.
"""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from simulation.atmosphere import GRAVITY, SEA_LEVEL_DENSITY, Atmosphere
from simulation.drive import Drive, QuadraticRotor, ThirdOrder
from simulation.errors import ArrivalError, ParameterError
from simulation.fly import attitude, propagate
from simulation.outcome import CaseOutcome, CasePlot, Fact, rotor_speeds, with_units
from simulation.papers import write_paper_log
from simulation.vehicle import Multirotor, Vector, mounts

#: Limits of section 2.3: rotor speed [rad/s] and acceleration [rad/s^2]; arrival within [m].
SPEED_LIMIT, ACCELERATION_LIMIT, ARRIVAL_DISTANCE = 490.0, 500.0, 0.1
#: Base step of the paper, s.
STEP = 1e-4

#: The body is a ball, the motors are points on weightless beams.
MOTOR_MASS, BEAM = 0.05, 0.25

#: Poles at 25 rad/s and a pair at 80 rad/s of damping 0.7, a zero at 50 rad/s.
DRIVE = ThirdOrder(
    lead=0.02,
    a1=1 / 25 + 1.4 / 80,
    a2=1 / 80**2 + 1.4 / (80 * 25),
    a3=1 / (25 * 80**2),
    speed_limit=SPEED_LIMIT,
    acceleration_limit=ACCELERATION_LIMIT,
)

#: Time between two commands of the autopilot, s.
CONTROL_STEP = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class PointToPoint:
    """A flight from point to point, in the paper's axes."""

    #: x, y, z, m.
    start: Vector = (0.0, 10.0, 17.0)
    target: Vector = (0.0, 25.0, 17.0)
    wind: Vector = (0.0, 0.0, 0.0)  #: Velocity of the air along x, y, z, m/s.
    mass: float = 1.0  #: Of the whole craft, kg.
    speed: float = 5.0  #: That the autopilot does not exceed, m/s.
    step: float = STEP  #: Of Euler's method, s.
    time_limit: float = 200.0  #: When to give up, s.

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.start, *self.target, *self.wind))):
            raise ParameterError("start, target and wind want finite numbers")
        if not (0.0 <= self.start[1] <= 5000.0 and 0.0 <= self.target[1] <= 5000.0):
            raise ParameterError(
                f"start and target must lie 0 to 5000 m above the ground, not {self.start[1]:g} and "
                f"{self.target[1]:g} m"
            )
        if not self.mass > 4.0 * MOTOR_MASS:
            raise ParameterError(f"mass {self.mass:g} kg: the four motors alone weigh {4.0 * MOTOR_MASS:g} kg")
        if not 0.1 <= self.speed <= 20.0:
            raise ParameterError(f"speed {self.speed:g} m/s must lie in 0.1 to 20 m/s")
        if not 1e-5 <= self.step <= 2e-3 or abs(CONTROL_STEP / self.step % 1.0 - 0.5) < 0.5 - 1e-6:
            raise ParameterError(
                f"step {self.step:g} s must divide the {CONTROL_STEP:g} s between commands and lie in 1e-5 to 2e-3 s"
            )
        if not 1.0 <= self.time_limit <= 600.0:
            raise ParameterError(f"time_limit {self.time_limit:g} s must lie in 1 to 600 s")


#: The three flights of section 3.
VERTICAL = PointToPoint()
SPATIAL = PointToPoint(start=(5.0, 3.0, 16.0), target=(48.0, 35.0, 81.0))
WITH_WIND = PointToPoint(start=(5.0, 3.0, 16.0), target=(48.0, 35.0, 81.0), wind=(-0.5, 0.0, 0.0))


def inertia(mass: float) -> np.ndarray:
    """Moments of inertia about the body's x (forward), y (right) and z (down) axis by eq. 7-9; (3, 3), kg m^2.

    ``J = 2 m R^2 / 5 + 2 r^2 m_d`` about the horizontal axes and twice the second term about the vertical one, with
    m of the ball alone.
    """
    ball = 0.4 * (mass - 4.0 * MOTOR_MASS) * 0.1**2
    beams = 2.0 * BEAM**2 * MOTOR_MASS
    return np.diag((ball + beams, ball + beams, ball + 2.0 * beams))


def quadcopter(mass: float = 1.0) -> Multirotor:
    """Build the craft: rotors 1 front and 2 rear, whose difference pitches, 3 right and 4 left, whose difference rolls.

    The paper has 1 and 3 turn clockwise and 2 and 4 against. With 1 and 2 on one beam the yaw moment would then be
    the sum of what pitch and roll ask for, and nothing could turn the nose alone; so 1 and 2 turn clockwise here.
    """
    rotor = QuadraticRotor(thrust_coefficient=GRAVITY / (4.0 * 300.0**2), torque_coefficient=4.4e-7)
    places = ((BEAM, 0.0, 0.0), (-BEAM, 0.0, 0.0), (0.0, BEAM, 0.0), (0.0, -BEAM, 0.0))
    return Multirotor(
        name="Motion 2018 quadcopter",
        mass=mass,
        inertia=inertia(mass),
        rotors=mounts([rotor] * 4, places, (1, 1, -1, -1)),
        drive=Drive(speed_max=SPEED_LIMIT, response=DRIVE),
        drag_linear=(0.1, 0.1, 0.1),
        drag_area=(0.01, 0.01, 0.02),
        frame_class=1,
        frame_type=0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Gains:
    """Gains of the autopilot, innermost loop last."""

    position: float = 1.0  #: Speed per distance, 1/s.
    #: Acceleration per speed, 1/s, and per its integral, 1/s^2.
    velocity: float = 2.0
    velocity_integral: float = 0.4
    angle: float = 5.0  #: Rate per angle, 1/s.
    rate: float = 12.0  #: Angular acceleration per rate, 1/s.
    brake: float = 1.0  #: Deceleration that the approach counts on, m/s^2.
    tilt_deg: float = 25.0  #: Largest lean.


class Autopilot:
    """Leads the craft to a point: speed towards it, acceleration, lean and lift, moments, rotor speeds."""

    def __init__(self, craft: Multirotor, target: np.ndarray, speed: float):
        self.craft, self.target, self.speed, self.gains = craft, target, speed, Gains()
        self.air = Atmosphere.standard(0.0)
        self.inertia = np.diag(craft.inertia)
        self.integral = np.zeros(3)
        rotor = craft.rotors[0].rotor
        self.lift = rotor.thrust(1.0)
        ratio = rotor.torque(1.0) / self.lift
        arms = np.array([mount.position for mount in craft.rotors])
        spins = np.array([mount.spin for mount in craft.rotors])
        # Thrusts of the rotors to lift and moments about the body axes; see `quadcopter` why it can be inverted.
        self.allocation = np.linalg.inv(np.vstack((np.ones(4), -arms[:, 1], arms[:, 0], -spins * ratio)))

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Commanded rotor speeds [rad/s] for a state; shape (4,)."""
        gains = self.gains
        acceleration = self._acceleration(x)
        up = GRAVITY - acceleration[2]
        roll, pitch, yaw = attitude(x)
        forward = math.cos(yaw) * acceleration[0] + math.sin(yaw) * acceleration[1]
        right = -math.sin(yaw) * acceleration[0] + math.cos(yaw) * acceleration[1]
        lean = -math.atan2(forward, up)
        bank = math.atan2(right * math.cos(lean), up)
        error = np.array([bank - roll, lean - pitch, -yaw])
        moment = self.inertia * gains.rate * (gains.angle * error - x[10:13])
        lift = self.craft.mass * up / max(math.cos(roll) * math.cos(pitch), 0.5)
        density = self.air.density_at(-x[2]) / SEA_LEVEL_DENSITY
        squares = self.allocation @ np.array([lift, *moment]) / (self.lift * density)
        speeds: np.ndarray = np.sqrt(np.clip(squares, 0.0, SPEED_LIMIT**2))
        return speeds

    def _acceleration(self, x: np.ndarray) -> np.ndarray:
        """Acceleration to ask for; (3,), NED."""
        gains = self.gains
        offset = self.target - x[0:3]
        distance = math.sqrt(float(offset @ offset))
        # No faster than the remaining distance allows to brake.
        speed = min(gains.position * distance, math.sqrt(2.0 * gains.brake * distance), self.speed)
        error = speed * offset / max(distance, 1e-9) - x[3:6]
        acceleration: np.ndarray = gains.velocity * error + self.integral
        acceleration[2] = min(max(acceleration[2], -0.5 * GRAVITY), 0.5 * GRAVITY)
        limit = math.tan(math.radians(gains.tilt_deg)) * (GRAVITY - acceleration[2])
        horizontal = math.hypot(acceleration[0], acceleration[1])
        if horizontal > limit:
            acceleration[:2] *= limit / horizontal
        elif distance < 3.0:
            self.integral += gains.velocity_integral * CONTROL_STEP * error
        return acceleration


def fly_to_point(flight: PointToPoint = VERTICAL) -> pd.DataFrame:
    """Fly until the craft is within 0.1 m of the target and slower than 0.1 m/s."""
    craft = quadcopter(flight.mass)
    density = min(Atmosphere.standard(0.0).density_at(point[1]) for point in (flight.start, flight.target))
    hover = craft.hover_speed(GRAVITY, density)
    if hover > 0.9 * SPEED_LIMIT:
        raise ParameterError(
            f"mass {flight.mass:g} kg: hover takes {hover:.0f} rad/s of the {SPEED_LIMIT:g} rad/s that the rotors can "
            "turn, and control needs a tenth of it"
        )
    target = np.array(_ned(flight.target))
    distance = math.dist(flight.start, flight.target)
    if distance < ARRIVAL_DISTANCE:
        raise ParameterError(
            f"start and target lie {distance:g} m apart, and {ARRIVAL_DISTANCE:g} m count as arrival: nothing to fly"
        )
    autopilot = Autopilot(craft, target, flight.speed)

    def arrived(_t: float, x: np.ndarray) -> bool:
        offset, velocity = target - x[0:3], x[3:6]
        return float(offset @ offset) < ARRIVAL_DISTANCE**2 and float(velocity @ velocity) < 0.1**2

    hold = round(CONTROL_STEP / flight.step)
    path = propagate(
        craft,
        craft.state(np.full(4, craft.hover_speed(GRAVITY)), position=_ned(flight.start)),
        autopilot,
        flight.time_limit,
        dt=flight.step,
        hold=hold,
        every=hold // 10 if hold % 10 == 0 else hold,
        method="euler",
        wind=_ned(flight.wind),
        stop=arrived,
    )
    last = path.iloc[-1].to_numpy()
    if not arrived(path.index[-1], last):
        raise ArrivalError(
            f"the craft did not arrive within {flight.time_limit:g} s: it is "
            f"{np.linalg.norm(target - last[0:3]):.1f} m from the target at "
            f"{np.linalg.norm(last[3:6]):.2f} m/s; give it more time, more speed or less wind"
        )
    return path


def in_paper_axes(path: pd.DataFrame) -> pd.DataFrame:
    """Return x, y, z [m], v_x, v_y, v_z [m/s], rotor speeds w1 ... w4 [rad/s] and accelerations a1 ... a4 [rad/s^2]."""
    columns = {"x": path["p_n"], "y": -path["p_d"], "z": path["p_e"]}
    columns |= {"v_x": path["v_n"], "v_y": -path["v_d"], "v_z": path["v_e"]}
    speeds = {f"w{k}": path[f"w{k}"] for k in range(1, 5)}
    changes = {f"a{k}": np.gradient(path[f"w{k}"], path.index) for k in range(1, 5)}
    return pd.DataFrame({**columns, **speeds, **changes}, index=path.index)


def _ned(point: Vector) -> Vector:
    """Turn a vector of the paper (x forward, y up, z right) into NED."""
    return point[0], point[2], -point[1]


#: Name, summary and settings of each flight of section 3.
FLIGHTS = (
    ("motion-vertical", "Motion 2018: straight up from (0, 10, 17) to (0, 25, 17)", VERTICAL),
    ("motion-spatial", "Motion 2018: from (5, 3, 16) to (48, 35, 81)", SPATIAL),
    ("motion-wind", "Motion 2018: from (5, 3, 16) to (48, 35, 81) against 0.5 m/s of wind along x", WITH_WIND),
)


_NOTES = (
    "Masses, dimensions, coefficients of the drive and gains are not printed; they are chosen (docs/simulation.md), "
    "so times and peaks are those of this craft.",
    "Printed senses of rotation (1 and 3 clockwise, 2 and 4 against, 1 and 2 on one beam) leave yaw without control; "
    "here 1 and 2 turn clockwise.",
    "The paper adds the wind to the craft's velocity; here it acts through the drag, and the autopilot's integral "
    "holds against it.",
)


def simulate(name: str, summary: str, settings: PointToPoint) -> CaseOutcome:
    """Fly from start to target."""
    flown = fly_to_point(settings)
    path = in_paper_axes(flown)
    per_row = max(round(0.01 / (path.index[1] - path.index[0])), 1)
    rows = pd.concat((path.iloc[:-1:per_row], path.iloc[-1:]))

    craft, wind = quadcopter(settings.mass), _ned(settings.wind)
    return CaseOutcome(
        name=name,
        summary=summary,
        facts=_facts(settings, path),
        notes=_NOTES,
        plots=_plots(rows),
        history=with_units(rows),
        write_log=lambda folder: write_paper_log(flown, craft, folder, name, summary, gravity=GRAVITY, wind=wind),
    )


def _facts(settings: PointToPoint, path: pd.DataFrame) -> tuple[Fact, ...]:
    places, velocities = path[["x", "y", "z"]].to_numpy(), path[["v_x", "v_y", "v_z"]].to_numpy()
    speeds = np.linalg.norm(velocities, axis=1)
    rotors = path[["w1", "w2", "w3", "w4"]].to_numpy()
    accelerations = np.abs(path[["a1", "a2", "a3", "a4"]].to_numpy())

    def point(values: np.ndarray | tuple[float, ...]) -> str:
        return ", ".join(f"{value:.3g}" for value in values)

    return (
        Fact("start (x, y, z)", point(settings.start), "m"),
        Fact("target (x, y, z)", point(settings.target), "m"),
        Fact("wind (x, y, z)", point(settings.wind), "m/s"),
        Fact("step of Euler's method", settings.step, "s"),
        Fact("time of arrival", float(path.index[-1]), "s"),
        Fact("distance from the target at arrival", float(np.linalg.norm(places[-1] - settings.target)), "m"),
        Fact("speed at arrival", float(speeds[-1]), "m/s"),
        Fact("straight distance", math.dist(settings.start, settings.target), "m"),
        Fact("length of the path", float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum()), "m"),
        Fact("greatest speed", float(speeds.max()), "m/s"),
        Fact("mean speed", float(speeds.mean()), "m/s"),
        Fact("rotor speeds", f"{rotors.min():.0f} to {rotors.max():.0f}", f"rad/s (limit {SPEED_LIMIT:g})"),
        Fact("greatest rotor acceleration", float(accelerations.max()), f"rad/s² (limit {ACCELERATION_LIMIT:g})"),
    )


def _plots(rows: pd.DataFrame) -> tuple[CasePlot, ...]:
    accelerations = rows.filter(regex=r"^a\d$").rename(columns=lambda name: f"rotor {name[1:]}")
    coordinates = "Coordinates in the paper's axes: x forward, y up, z right (figures 3, 7 and 11)."
    speeds = "Speeds of the rotors (figures 5, 9 and 13); the drive's limit is 490 rad/s."
    changes = "Accelerations of the rotors (figures 6, 10 and 14); the drive's limit is 500 rad/s²."
    places = rows[["x", "y", "z"]].rename(columns={"y": "y (up)"})
    velocities = rows[["v_x", "v_y", "v_z"]].rename(columns={"v_x": "x", "v_y": "y (up)", "v_z": "z"})
    return (
        CasePlot(coordinates, "coordinate (m)", places),
        CasePlot("Velocities (figures 4, 8 and 12).", "velocity (m/s)", velocities),
        CasePlot(speeds, "rotor speed (rad/s)", rotor_speeds(rows)),
        CasePlot(changes, "rotor acceleration (rad/s²)", accelerations),
    )
