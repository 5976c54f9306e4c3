"""The agricultural quadcopter of Guntur 2019: five motors, five payloads, and which motor can carry out the plan.

X frame; rotor 1 front right, 2 rear left, 3 front left, 4 rear right, as the thesis' listing places them. Rotor speeds
are commanded open loop. Units here are SI; the thesis writes turns per minute.
"""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from simulation.atmosphere import SEA_LEVEL_DENSITY
from simulation.drive import Drive, FirstOrder
from simulation.errors import ParameterError
from simulation.fly import propagate
from simulation.rotor import BladeElementRotor
from simulation.vehicle import Multirotor, RotorMount, Tank

RPM = 2.0 * math.pi / 60.0

#: Gravity of the thesis, m/s^2.
GRAVITY = 9.81
#: Share of the full tank (1 kg) for which the thesis gives mass properties.
PAYLOADS = (1.0, 0.75, 0.5, 0.25, 0.0)
#: Distance of each rotor from the x and the y axis [m]. Not printed; with it all printed inertias are possible.
ARM = 0.2


@dataclass(frozen=True, slots=True)
class Motor:
    """A motor of table 3.1 and the craft that carries four of it (section 4.1.2)."""

    name: str
    kv: float  #: Speed per voltage without load, rad/s/V.
    power: float  #: Largest power, W.
    masses: tuple[float, ...]  #: Mass of the craft with each of `PAYLOADS`, kg.
    #: Ixx, Iyy, Izz with each of `PAYLOADS`, kg m^2. Printed as ``4,59E+09 kgmm^2``, which would be 4590 kg m^2; the
    #: same digits with E+04 fit a craft of 2 kg and are taken here.
    inertias: tuple[tuple[float, float, float], ...]


def _motor(name: str, kv_rpm: float, power: float, rows: str) -> Motor:
    values = [tuple(map(float, row.split())) for row in rows.strip().splitlines()]
    return Motor(
        name=name,
        kv=kv_rpm * RPM,
        power=power,
        masses=tuple(row[0] for row in values),
        inertias=tuple((row[1] * 1e-2, row[2] * 1e-2, row[3] * 1e-2) for row in values),
    )


#: Mass [kg] and the digits of Ixx, Iyy, Izz for each of `PAYLOADS`.
MOTORS = (
    _motor(
        "MT-4006-13 740KV",
        740.0,
        500.0,
        """
        2.15758987 4.59 4.59 7.87
        1.89348554 4.56 4.57 7.84
        1.64362485 4.51 4.51 7.80
        1.39345537 4.36 4.35 7.75
        1.19781007 4.13 4.11 7.71
        """,
    ),
    _motor(
        "Sunnysky X2212-13 980KV",
        980.0,
        150.0,
        """
        2.01691751 3.71 3.71 6.18
        1.75281317 3.68 3.69 6.14
        1.50295248 3.63 3.64 6.10
        1.25278300 3.49 3.49 6.06
        1.05713770 3.27 3.26 6.01
        """,
    ),
    _motor(
        "AX-2810Q-750KV",
        750.0,
        444.0,
        """
        2.06966964 4.04 4.04 6.81
        1.80556531 4.01 4.02 6.78
        1.55570462 3.96 3.97 6.74
        1.30553514 3.82 3.82 6.69
        1.10988984 3.59 3.58 6.65
        """,
    ),
    _motor(
        "EMAX RS1108",
        4500.0,
        211.2,
        """
        2.11362976 4.32 4.31 7.34
        1.84952543 4.29 4.29 7.31
        1.59966473 4.23 4.24 7.27
        1.34949526 4.09 4.08 7.22
        1.15384996 3.86 3.84 7.18
        """,
    ),
    _motor(
        "F60 PRO III Motor - 1750KV",
        1750.0,
        950.0,
        """
        1.92899728 3.15 3.16 5.12
        1.66489295 3.12 3.14 5.09
        1.41503225 3.08 3.09 5.05
        1.16486277 2.95 2.96 5.00
        0.96921747 2.74 2.73 4.95
        """,
    ),
)


def rotor() -> BladeElementRotor:
    """Return the propeller of section 3.2.2: radius 0.102 m, pitch 0.1016 m, mean chord 27.4 mm."""
    return BladeElementRotor(radius=0.102, pitch=0.1016, chord=0.0274)


def find(name: str) -> Motor:
    """Return the motor of this name.

    Raises
    ------
    ParameterError
        There is none; the message lists those that there are.
    """
    for motor in MOTORS:
        if motor.name == name:
            return motor
    raise ParameterError(f"no motor called {name!r}; there are: {', '.join(motor.name for motor in MOTORS)}")


def mass_properties(motor: Motor, payload: float) -> tuple[float, np.ndarray]:
    """Mass [kg] and inertia (3, 3) [kg m^2] with a share `payload` of the tank, linear between the thesis' five."""
    if not 0.0 <= payload <= 1.0:
        raise ParameterError(f"payload {payload:g} must lie in 0..1, the share of the full tank of 1 kg")
    shares = PAYLOADS[::-1]
    mass = float(np.interp(payload, shares, motor.masses[::-1]))
    moments = [np.interp(payload, shares, [row[axis] for row in motor.inertias[::-1]]) for axis in range(3)]
    return mass, np.diag(moments)


def tank(motor: Motor, payload: float, rate: float, start: float) -> Tank:
    """Empty the tank from `start` [s] on, `rate` [share of the tank per s], until the tank is empty.

    The thesis varies the payload from flight to flight and leaves the discharge in flight to further work; it assumes
    as is done here that what flows out takes no momentum along.

    Parameters
    ----------
    motor : Motor
        One of the five of the thesis.
    payload : float
        Share of the full tank at the start.
    rate : float
        Share of the full tank (1 kg) that flows out per second.
    start : float
        When it begins to flow, s.

    Raises
    ------
    ParameterError
        Rate or payload is not positive.
    """
    if not (rate > 0.0 and payload > 0.0):
        raise ParameterError(f"discharge: rate {rate:g} and payload {payload:g} must be positive")
    shares = [payload, *(share for share in PAYLOADS if share < payload)]
    properties = [mass_properties(motor, share) for share in shares]
    return Tank(
        time=tuple(start + (payload - share) / rate for share in shares),
        mass=tuple(mass for mass, _ in properties),
        inertia=tuple(inertia for _, inertia in properties),
    )


def quadcopter(motor: Motor, payload: float, *, discharge: float = 0.0, discharge_start: float = 0.0) -> Multirotor:
    """Build the craft with a motor and a payload.

    The thesis' rotors follow their command at once; 20 ms of lag stand in for that.

    Parameters
    ----------
    motor : Motor
    payload : float
        Share of the full tank, 0..1.
    discharge : float
        Share of the full tank that flows out per second; 0: nothing does.
    discharge_start : float
        When it begins, s.
    """
    mass, inertia = mass_properties(motor, payload)
    propeller = rotor()
    corners = ((ARM, ARM), (-ARM, -ARM), (ARM, -ARM), (-ARM, ARM))
    mounts = tuple(
        RotorMount(propeller, (forward, right, 0.0), spin=-1 if number < 2 else 1)
        for number, (forward, right) in enumerate(corners)
    )
    return Multirotor(
        name=f"Guntur 2019 quadcopter, {motor.name}, {100 * payload:.0f} % payload",
        mass=mass,
        inertia=inertia,
        rotors=mounts,
        drive=Drive(speed_max=motor.kv * 16.8, response=FirstOrder(0.02)),
        tank=tank(motor, payload, discharge, discharge_start) if discharge else None,
        frame_class=1,
        frame_type=1,
    )


def profile(t: float, trim: float) -> np.ndarray:
    """Rotor speeds of the flight plan (appendix A): climb, pitch forward and back, more lift; shape (4,), rad/s.

    `trim` [rad/s] is 3200 turns per minute in the listing and 4600 in the text; neither hovers (see `hover_rpm`).
    """
    climb = (500.0 if t < 11.0 else 0.0) if t <= 16.0 else 150.0
    pitch = 0.0
    for start, end, command in ((8.0, 9.0, -10.0), (9.0, 10.0, 10.0), (12.0, 13.0, 15.0), (13.0, 14.0, -15.0)):
        if start < t <= end:
            pitch = command
    return trim + RPM * np.array([pitch + climb, -pitch + climb, pitch + climb, -pitch + climb]) / 4.0


def hover_rpm(motor: Motor, payload: float) -> float:
    """Return the turns per minute at which the craft hovers at sea level."""
    return quadcopter(motor, payload).hover_speed(GRAVITY) / RPM


def fly_profile(
    motor: Motor,
    payload: float,
    *,
    trim_rpm: float | None = None,
    duration: float = 30.0,
    dt: float = 0.01,
    discharge: float = 0.0,
    discharge_start: float = 0.0,
) -> pd.DataFrame:
    """Fly the plan open loop; RK4 at 0.01 s as in the thesis.

    Parameters
    ----------
    motor : Motor
    payload : float
        Share of the full tank, 0..1.
    trim_rpm : float, optional
        Turns per minute about which the plan commands; default `hover_rpm` of this craft.
    duration, dt : float
        s.
    discharge, discharge_start : float
        As for `quadcopter`.

    Returns
    -------
    DataFrame
        As `simulation.fly.propagate`.
    """
    craft = quadcopter(motor, payload, discharge=discharge, discharge_start=discharge_start)
    trim = RPM * (hover_rpm(motor, payload) if trim_rpm is None else trim_rpm)
    start = craft.state(profile(0.0, trim))
    return propagate(craft, start, lambda t, x: profile(t, trim), duration, dt=dt, gravity=GRAVITY)


def feasibility(voltage: float = 11.1) -> pd.DataFrame:
    """Return which motor holds the flight plan with which payload.

    A motor holds it when the highest speed of the plan, about hover, stays below KV times voltage, and the ideal
    power of one rotor at that speed below the motor's largest power.

    Parameters
    ----------
    voltage : float
        Of the battery, V; not printed in the thesis, three cells are taken.

    Returns
    -------
    DataFrame
        One row for each motor and payload: motor, payload, mass [kg], hover_rpm, top_rpm, limit_rpm, power [W],
        limit_power [W], feasible.
    """
    rows = []
    times = np.arange(0.0, 30.0, 0.25)
    for motor in MOTORS:
        for payload, mass in zip(PAYLOADS, motor.masses, strict=True):
            hover = hover_rpm(motor, payload)
            top = max(float(profile(t, hover * RPM).max()) for t in times)
            power = rotor().torque(top, SEA_LEVEL_DENSITY) * top
            limit = motor.kv * voltage
            rows.append(
                {
                    "motor": motor.name,
                    "payload": payload,
                    "mass": mass,
                    "hover_rpm": hover,
                    "top_rpm": top / RPM,
                    "limit_rpm": limit / RPM,
                    "power": power,
                    "limit_power": motor.power,
                    "feasible": top < limit and power < motor.power,
                }
            )
    return pd.DataFrame(rows)
