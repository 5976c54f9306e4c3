"""Fly a vehicle: under given rotor commands, or a mission under the PID cascade."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pandas as pd

from simulation import _kernels
from simulation._parameters import AutopilotState, CraftParameters, Forcing, Instant
from simulation.atmosphere import GRAVITY, Atmosphere
from simulation.controllers import Cascade
from simulation.drive import drive_parameters
from simulation.errors import DivergenceError, ParameterError
from simulation.mission import TICK, Mission, Reference
from simulation.place import Place, Wind
from simulation.sensors import Sensors
from simulation.vehicle import Multirotor

STATE_COLUMNS = ("p_n", "p_e", "p_d", "v_n", "v_e", "v_d", "q_w", "q_x", "q_y", "q_z", "w_x", "w_y", "w_z")

#: What the flight loop records, before the rotor speeds (w1 ...) and motor outputs (m1 ..., us). Specific force f,
#: acceleration a (NED) and wind are true; gyro and accel are what the filtered sensors say; the rest is the
#: autopilot's.
RECORD_COLUMNS = (
    "t",
    *STATE_COLUMNS,
    *("f_x", "f_y", "f_z"),
    *("a_n", "a_e", "a_d"),
    *("wind_n", "wind_e", "wind_d"),
    *("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"),
    *("roll_ref", "pitch_ref", "yaw_ref"),
    *("roll", "pitch", "yaw"),
    *("w_x_ref", "w_y_ref", "w_z_ref"),
    *("out_roll", "out_pitch", "out_yaw"),
    *("v_n_ref", "v_e_ref", "v_d_ref"),
    *("a_n_ref", "a_e_ref", "a_d_ref"),
    *("throttle_in", "throttle", "angle_boost"),
    *("voltage", "current", "charge"),
    *("state", "clips", "mass"),
)


def attitude(x: np.ndarray) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of a state."""
    w, i, j, k = x[6:10]
    roll = math.atan2(2.0 * (j * k + w * i), 1.0 - 2.0 * (i * i + j * j))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * j - i * k))))
    return roll, pitch, math.atan2(2.0 * (i * j + w * k), 1.0 - 2.0 * (j * j + k * k))


def propagate(
    vehicle: Multirotor,
    initial: np.ndarray,
    command: Callable[[float, np.ndarray], np.ndarray],
    duration: float,
    *,
    dt: float = 1e-3,
    hold: int = 1,
    every: int = 1,
    method: Literal["rk4", "euler"] = "rk4",
    gravity: float = GRAVITY,
    atmosphere: Atmosphere | None = None,
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ground: bool = False,
    stop: Callable[[float, np.ndarray], bool] | None = None,
) -> pd.DataFrame:
    """Integrate a vehicle under given rotor commands.

    Parameters
    ----------
    vehicle : Multirotor
    initial : ndarray, shape (13 + n,) or (13 + 4 n,)
        Position, velocity (NED), quaternion, angular rate, rotor speeds, and the states of drives of third order;
        see `Multirotor.state`.
    command : callable
        Commanded rotor speeds (n,) [rad/s] for the time [s] and the state: open loop or a controller.
    duration, dt : float
        s.
    hold : int
        Steps over which a command is held.
    every : int
        Steps between rows of the result; divides `hold`.
    method : {"rk4", "euler"}
        Classical Runge-Kutta, fourth order, or Euler's method, first order.
    gravity : float
        m/s^2.
    atmosphere : Atmosphere, optional
        Default: standard at sea level.
    wind : tuple of 3 float
        Velocity of the air, NED, m/s.
    ground : bool
        Whether there is ground to stand on.
    stop : callable, optional
        Asked with time and state before each command whether the simulation is over.

    Returns
    -------
    DataFrame
        Index `t` [s], state columns and rotor speeds w1 ... wn.

    Raises
    ------
    ParameterError
        The initial state has the wrong size or is not finite, or the step is not positive.
    DivergenceError
        The state left every sensible range.
    """
    n = len(vehicle.rotors)
    x = np.array(initial, dtype=float)
    if x.shape != (vehicle.states,) or not np.isfinite(x).all():
        raise ParameterError(f"the initial state needs {vehicle.states} finite numbers for {n} rotors, not {x.shape}")
    if not (dt > 0.0 and duration > 0.0 and hold >= 1 and every >= 1 and hold % every == 0):
        raise ParameterError(
            f"step {dt:g} s and duration {duration:g} s must be positive, hold {hold} a multiple of every {every}"
        )
    x[6:10] /= math.sqrt(float((x[6:10] ** 2).sum()))
    rows = round(duration / dt) // every
    states = np.empty((rows + 1, x.size))
    states[0] = x
    air = (atmosphere or Atmosphere.standard(0.0)).kernel_parameters()
    frame = vehicle.kernel_parameters(gravity, ground=ground)
    wind_n = np.array(wind, dtype=float)
    for row in range(0, rows, hold // every):
        t = row * every * dt
        if stop is not None and stop(t, x):
            rows = row
            break
        chunk = states[1 + row : 1 + min(row + hold // every, rows)]
        speeds = np.ascontiguousarray(command(t, x.copy()), dtype=float)
        if speeds.shape != (n,):
            raise ParameterError(f"a command for {n} rotors has {n} speeds, not {speeds.shape}")
        done = _kernels.propagate(x, speeds, wind_n, t, float(dt), every, method == "euler", frame, air, chunk)
        if done < len(chunk) * every:
            raise _divergence(t + (done + 1) * dt, states[row + done // every])
    columns = [*STATE_COLUMNS, *(f"w{k}" for k in range(1, n + 1))]
    times = pd.Index(np.arange(rows + 1) * (every * dt), name="t")
    return pd.DataFrame(states[: rows + 1, : 13 + n], index=times, columns=columns)


@dataclass(frozen=True, slots=True)
class MotorLoss:
    """A motor that gives only a part of the thrust that it is asked for."""

    motor: int  #: As the autopilot numbers it, from 1.
    t: float  #: Since when, s from the start of the simulation.
    thrust: float  #: The part that is left; 0: it stands.


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """Everything that determines a simulated flight."""

    mission: Mission
    place: Place
    vehicle: Multirotor
    wind: Wind = field(default_factory=Wind)
    cascade: Cascade = field(default_factory=Cascade)
    sensors: Sensors = field(default_factory=Sensors)
    losses: tuple[MotorLoss, ...] = ()
    seed: int = 0  #: Of all noise.
    step: float = TICK / 10.0  #: Of the physics, s; attitude is controlled every second step, position every tenth.

    def __post_init__(self) -> None:
        if not 1e-5 <= self.step <= 2e-3:
            raise ParameterError(f"step {self.step:g} s must lie in 1e-5 to 2e-3 s (control runs every second step)")
        if not 0 <= self.seed <= 400_000_000:
            raise ParameterError(f"seed {self.seed} must lie in 0 to 400 000 000")
        for loss in self.losses:
            if not (1 <= loss.motor <= len(self.vehicle.rotors) and loss.t >= 0.0 and 0.0 <= loss.thrust <= 1.0):
                raise ParameterError(f"{loss}: wants a motor of the craft, t >= 0 and 0 <= thrust <= 1")

    def rotor_speed(self, t: np.ndarray) -> np.ndarray:
        """Share of the commanded speed that each rotor follows at times [s]; shape (t.size, n)."""
        share = np.ones((t.size, len(self.vehicle.rotors)))
        for loss in self.losses:
            share[t >= loss.t, loss.motor - 1] = math.sqrt(loss.thrust)
        return share


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedFlight:
    """A simulated flight before it is logged."""

    setup: Setup
    truth: pd.DataFrame  #: Index `t` [s from boot]; `RECORD_COLUMNS` without t, then w1 ... and m1 ...
    reference: Reference
    navigation: np.ndarray  #: shape (M, 9): Errors of the autopilot's own position, velocity and attitude at each tick.
    hover_thrust: float  #: Fraction of thrust that the autopilot takes for hover.
    airborne: tuple[float, float]  #: First and last time off the ground, s; a crash ends with its hardest shock.
    disarm: float  #: Time at which the autopilot disarmed after landing or a crash, s.

    @property
    def crashed(self) -> bool:
        """Whether the craft was disarmed before it was to land."""
        return self.disarm < self.reference.land


def fly(setup: Setup, *, rate: float = 100.0) -> SimulatedFlight:
    """Fly a mission.

    Parameters
    ----------
    setup : Setup
    rate : float
        Records per second; the steps per second divided by a whole number.

    Raises
    ------
    ParameterError
        The craft cannot hover there.
    DivergenceError
        The craft tumbled away; the message says when and in which state.
    """
    step = setup.step
    every = round(1.0 / (rate * step))
    if every < 1 or abs(every * rate * step - 1.0) > 1e-9:
        raise ParameterError(f"record rate {rate:g} Hz must divide {1.0 / step:g} Hz, the steps per second")
    vehicle, place, mission = setup.vehicle, setup.place, setup.mission
    gravity, atmosphere = place.gravity, place.atmosphere
    density = atmosphere.density_at(mission.takeoff)
    # The hover throttle that the autopilot has learnt: weight over thrust with a pack under load.
    voltage = 0.94 * vehicle.battery.voltage_full
    hover_thrust = vehicle.hover_thrust(gravity, density, voltage)
    hover_speed = vehicle.hover_speed(gravity, density)

    reference = mission.reference(10.0 * step)
    ticks = len(reference.phase)
    steps = ticks * 10
    # RandomState, not Generator: its streams are frozen for good, so a seed gives the same log under any NumPy.
    random = np.random.RandomState(setup.seed)
    noise = random.standard_normal((steps, 6))
    winds = np.ascontiguousarray(setup.wind.sample(steps, step, random))
    navigation = setup.sensors.navigation.sample(ticks, reference.tick, random)
    drift = setup.sensors.inertial.drift(ticks, reference.tick, random)

    n = len(vehicle.rotors)
    yaw = math.radians(mission.heading_deg)
    x = vehicle.state(np.zeros(n), attitude=(math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)))
    records = np.empty((steps // every + 1, len(RECORD_COLUMNS) + 2 * n))
    craft = CraftParameters(
        frame=vehicle.kernel_parameters(gravity),
        air=atmosphere.kernel_parameters(),
        drive=drive_parameters(vehicle.drive, vehicle.battery),
        cascade=setup.cascade.kernel_parameters(vehicle, hover_thrust),
        sensors=setup.sensors.inertial.kernel_parameters(step, hover_speed),
    )
    speed = setup.rotor_speed(np.arange(ticks) * reference.tick)
    planned = reference.phase, reference.samples, reference.excitation(), reference.level()
    forcing = Forcing(*planned, navigation, drift, speed, winds, noise)
    start = AutopilotState.at_boot(), Instant.at_boot(n, vehicle.battery.voltage_full)
    rows, end, last = _kernels.fly_cascade(x, step, every, forcing, craft, *start, records)
    if end == _kernels.DIVERGED:
        raise _divergence(last * step, x)
    if end == _kernels.OVERTURNED:
        raise _divergence(last * step, x, "the craft turned over")
    names = (*RECORD_COLUMNS[1:], *(f"w{k + 1}" for k in range(n)), *(f"m{k + 1}" for k in range(n)))
    truth = pd.DataFrame(records[:rows, 1:], index=pd.Index(records[:rows, 0], name="t"), columns=list(names))

    up = truth.index[truth["p_d"] < -0.05]
    landed = truth.index[truth["state"] == _kernels.LANDED]
    if len(up) == 0:
        raise DivergenceError(f"the craft never left the ground at {place.name} (hover thrust {hover_thrust:.2f})")
    if len(landed) == 0:
        raise DivergenceError(
            f"the craft did not come to rest on the ground: at {truth.index[-1]:.1f} s it is "
            f"{-truth['p_d'].iloc[-1]:.1f} m above it, having left it at {up[0]:.1f} s"
        )
    disarm = float(landed[0])
    down = float(up[-1])
    if disarm < reference.land:
        # A craft that fell bounces: its flight ended with the hardest shock.
        force = truth.loc[up[0] : up[-1], ["f_x", "f_y", "f_z"]]
        down = float(force.index.to_numpy()[np.argmax((force * force).sum(axis=1))])
    return SimulatedFlight(
        setup=setup,
        truth=truth.loc[: disarm + 3.0],
        reference=reference,
        navigation=navigation,
        hover_thrust=hover_thrust,
        airborne=(float(up[0]), down),
        disarm=disarm,
    )


def _divergence(t: float, x: np.ndarray, what: str = "the simulation diverged") -> DivergenceError:
    values = ", ".join(f"{name} {value:.4g}" for name, value in zip(STATE_COLUMNS, x, strict=False))
    return DivergenceError(f"{what} at {t:.3f} s; last state: {values}")
