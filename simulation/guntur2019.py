"""The agricultural quadcopter of Guntur 2019: five motors, five payloads, and which motor can fly the plan.

X frame; rotor 1 front right, 2 rear left, 3 front left, 4 rear right, as the thesis' listing places them. Rotor speeds
are commanded open loop. Units here are SI; the thesis writes turns per minute.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from simulation.atmosphere import SEA_LEVEL_DENSITY
from simulation.drive import BladeElementRotor, Drive, FirstOrder
from simulation.errors import ParameterError
from simulation.fly import propagate
from simulation.outcome import CaseOutcome, CasePlot, CaseTable, Fact, named, rotor_speeds, with_units
from simulation.papers import PRINTED, write_paper_log
from simulation.vehicle import Multirotor, Tank, mounts

RPM = 2.0 * math.pi / 60.0

#: Gravity of the thesis, m/s^2.
GRAVITY = 9.81
#: Share of the full tank (1 kg) for which the thesis gives mass properties.
PAYLOADS = (1.0, 0.75, 0.5, 0.25, 0.0)
#: Distance of each rotor from the x and the y axis [m]. Not printed; with it all printed inertias are possible.
ARM = 0.2


@dataclass(frozen=True, slots=True)
class PropulsionUnit:
    """A motor of table 3.1 and the craft with four of them (section 4.1.2)."""

    name: str
    kv: float  #: Speed per voltage without load, rad/s/V.
    power: float  #: Largest power, W.
    masses: tuple[float, ...]  #: Mass of the craft with each of `PAYLOADS`, kg.
    inertias: tuple[tuple[float, ...], ...]  #: Ixx, Iyy, Izz with each of `PAYLOADS`, kg m^2.


MOTORS = tuple(
    PropulsionUnit(
        name=row["name"],
        kv=row["kv_rpm"] * RPM,
        power=row["power"],
        masses=tuple(row["masses"]),
        inertias=tuple(tuple(moment * 1e-2 for moment in moments) for moments in row["inertias"]),
    )
    for row in PRINTED["guntur2019"]
)


def rotor() -> BladeElementRotor:
    """Return the propeller of section 3.2.2: radius 0.102 m, pitch 0.1016 m, mean chord 27.4 mm."""
    return BladeElementRotor(radius=0.102, pitch=0.1016, chord=0.0274)


def find(name: str) -> PropulsionUnit:
    """Return the motor of this name."""
    for motor in MOTORS:
        if motor.name == name:
            return motor
    raise ParameterError(f"no motor called {name!r}; there are: {', '.join(motor.name for motor in MOTORS)}")


def mass_properties(motor: PropulsionUnit, payload: float) -> tuple[float, np.ndarray]:
    """Interpolate mass [kg] and inertia (3, 3) [kg m^2] at `payload`, a share of the tank."""
    if not 0.0 <= payload <= 1.0:
        raise ParameterError(f"payload {payload:g} must lie in 0..1, the share of the full tank of 1 kg")
    shares = PAYLOADS[::-1]
    mass = float(np.interp(payload, shares, motor.masses[::-1]))
    moments = [np.interp(payload, shares, [row[axis] for row in motor.inertias[::-1]]) for axis in range(3)]
    return mass, np.diag(moments)


def tank(motor: PropulsionUnit, payload: float, rate: float, start: float) -> Tank:
    """Return a tank that empties from `start` [s] on at `rate` [share of the full tank per s].

    The thesis varies the payload from flight to flight and leaves discharge in flight to further work; as there, the
    outflow is assumed to carry no momentum.
    """
    if not (rate > 0.0 and payload > 0.0):
        raise ParameterError(f"discharge: rate {rate:g} and payload {payload:g} must be positive")
    shares = [payload, *(share for share in PAYLOADS if share < payload)]
    masses, inertias = zip(*(mass_properties(motor, share) for share in shares), strict=True)
    return Tank(time=tuple(start + (payload - share) / rate for share in shares), mass=masses, inertia=inertias)


def quadcopter(
    motor: PropulsionUnit, payload: float, *, discharge: float = 0.0, discharge_start: float = 0.0
) -> Multirotor:
    """Build the craft with a motor and a payload [share of the full tank]; `discharge` and its start as for `tank`.

    The thesis' rotors follow their command at once, which a lag of 20 ms approximates.
    """
    mass, inertia = mass_properties(motor, payload)
    corners = ((ARM, ARM, 0.0), (-ARM, -ARM, 0.0), (ARM, -ARM, 0.0), (-ARM, ARM, 0.0))
    return Multirotor(
        name=f"Guntur 2019 quadcopter, {motor.name}, {100 * payload:.0f} % payload",
        mass=mass,
        inertia=inertia,
        rotors=mounts([rotor()] * 4, corners, (-1, -1, 1, 1)),
        drive=Drive(speed_max=motor.kv * 16.8, response=FirstOrder(0.02)),
        tank=tank(motor, payload, discharge, discharge_start) if discharge else None,
        frame_class=1,
        frame_type=1,
    )


def profile(t: float, trim: float) -> np.ndarray:
    """Return rotor speeds of the flight plan (appendix A): climb, pitch forward and back, more lift; shape (4,), rad/s.

    `trim` [rad/s] is 3200 turns per minute in the listing and 4600 in the text; neither hovers (see `hover_rpm`).
    """
    climb = (500.0 if t < 11.0 else 0.0) if t <= 16.0 else 150.0
    pitch = 0.0
    for start, end, command in ((8.0, 9.0, -10.0), (9.0, 10.0, 10.0), (12.0, 13.0, 15.0), (13.0, 14.0, -15.0)):
        if start < t <= end:
            pitch = command
    return trim + RPM * np.array([pitch + climb, -pitch + climb, pitch + climb, -pitch + climb]) / 4.0


def hover_rpm(motor: PropulsionUnit, payload: float) -> float:
    """Return the turns per minute at which the craft hovers at sea level."""
    return quadcopter(motor, payload).hover_speed(GRAVITY) / RPM


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """Settings of the plan."""

    motor: str = "Sunnysky X2212-13 980KV"  #: One of the thesis' five.
    payload: float = 0.5  #: Share of the full tank of 1 kg, 0..1, with which the logged flight begins.
    trim_rpm: float = 0.0  #: Turns per minute about which the plan commands; 0 for those of hover.
    discharge: float = 0.0  #: Share of the full tank that flows out per second.
    discharge_start: float = 5.0  #: s.
    voltage: float = 11.1  #: Of the battery, for `feasibility`, V.
    #: s.
    duration: float = 30.0
    step: float = 0.01

    def __post_init__(self) -> None:
        if not (self.discharge >= 0.0 and self.discharge_start >= 0.0):
            raise ParameterError("discharge and discharge_start cannot be negative")
        if not 3.0 <= self.voltage <= 60.0:
            raise ParameterError(f"voltage {self.voltage:g} V must lie in 3 to 60 V")
        if not (1.0 <= self.duration <= 600.0 and self.step in (0.01, 0.005, 0.0025, 0.002, 0.001)):
            raise ParameterError(
                f"duration {self.duration:g} s must lie in 1 to 600 s, step {self.step:g} s be 0.01, 0.005, 0.0025, "
                "0.002 or 0.001 s"
            )
        if not 0.0 <= self.trim_rpm <= 30000.0:
            raise ParameterError(f"trim_rpm {self.trim_rpm:g} must lie in 0 to 30000 turns per minute")


def fly_profile(settings: Profile, craft: Multirotor) -> pd.DataFrame:
    """Fly the plan open loop about a trim, RK4 at 0.01 s as in the thesis; see `propagate`."""
    trim = RPM * (settings.trim_rpm or hover_rpm(find(settings.motor), settings.payload))
    start = craft.state(profile(0.0, trim))
    return propagate(craft, start, lambda t, x: profile(t, trim), settings.duration, dt=settings.step, gravity=GRAVITY)


def feasibility(voltage: float = 11.1) -> pd.DataFrame:
    """Return which motor can fly the plan with which payload: a row for each combination, speeds in rpm.

    The highest speed of the plan, about hover, must be below KV times voltage, and the ideal power of one rotor at
    that speed below the motor's largest power. The thesis names no battery; three cells are assumed.
    """
    rows = []
    times = np.arange(0.0, 30.0, 0.25)
    for motor in MOTORS:
        for payload, mass in zip(PAYLOADS, motor.masses, strict=True):
            hover = hover_rpm(motor, payload)
            top = max(float(profile(t, hover * RPM).max()) for t in times)
            power = rotor().torque(top, SEA_LEVEL_DENSITY) * top
            limit = motor.kv * voltage
            feasible = top < limit and power < motor.power
            rows.append((motor.name, payload, mass, hover, top / RPM, limit / RPM, power, motor.power, feasible))
    names = ["motor", "payload", "mass", "hover_rpm", "top_rpm", "limit_rpm", "power", "limit_power", "feasible"]
    return pd.DataFrame(rows, columns=names)


_NOTES = (
    "At 4600 turns per minute the printed rotor gives 1.32 N, so four of them carry 0.54 kg, and at the listing's 3200 "
    "less: the craft hovers at 6200 to 9200, about which the plan is flown here.",
    "Inertias are printed with E+09 kg mm², which would be thousands of kg m²; E+04 fits the craft and is taken.",
    "The thesis names no battery; three cells (11.1 V) decide which motor turns fast enough.",
)


def simulate(name: str, summary: str, settings: Profile) -> CaseOutcome:
    """Fly the plan with the payload of the settings, which is logged, and with every payload."""
    motor = find(settings.motor)
    craft = quadcopter(motor, settings.payload, discharge=settings.discharge, discharge_start=settings.discharge_start)
    flown = fly_profile(settings, craft)
    mass = pd.Series(np.full(len(flown), craft.mass), index=flown.index)
    if craft.tank is not None:
        mass[:] = np.interp(flown.index, craft.tank.time, craft.tank.mass)
    feasible = feasibility(settings.voltage)
    height, distance = named(flown, height="p_d") * -1.0, named(flown, north="p_n")
    plots = [
        CasePlot(
            "Height of the flight that is logged: climb, pitch forward and back, more lift.", "height (m)", height
        ),
        CasePlot(
            "Distance north: the plan pitches forward at 8 s and, more strongly, back at 12 s.",
            "distance (m)",
            distance,
        ),
        CasePlot("Speeds of the rotors.", "rotor speed (rpm)", rotor_speeds(flown) / RPM),
    ]
    if craft.tank is None:
        flights = {
            f"{100 * payload:.0f} %": fly_profile(
                replace(settings, payload=payload, trim_rpm=0.0), quadcopter(motor, payload)
            )
            for payload in PAYLOADS
        }
        per_square = rotor().thrust(100.0) / 100.0**2
        heights = {payload: -table["p_d"] for payload, table in flights.items()}
        thrusts = {payload: per_square * (rotor_speeds(table) ** 2).sum(axis=1) for payload, table in flights.items()}
        about = "Height with each payload: about its own hover each craft flies nearly the same plan."
        plots += [
            CasePlot(about, "height (m)", pd.DataFrame(heights)),
            CasePlot("Thrust of all rotors with each payload.", "thrust (N)", pd.DataFrame(thrusts)),
        ]
    else:
        plots.append(CasePlot("Mass of the craft while the tank empties.", "mass (kg)", pd.DataFrame({"mass": mass})))
    columns = ["p_n", "p_e", "p_d", "v_n", "v_e", "v_d", "w1", "w2", "w3", "w4"]
    return CaseOutcome(
        name=name,
        summary=summary,
        facts=_facts(settings, flown, mass, feasible),
        notes=_NOTES,
        plots=tuple(plots),
        tables=(_table(feasible, settings.voltage),),
        history=with_units(flown[columns].assign(mass=mass)),
        write_log=lambda folder: write_paper_log(flown, craft, folder, name, summary, gravity=GRAVITY),
    )


def _facts(settings: Profile, flown: pd.DataFrame, mass: pd.Series, feasible: pd.DataFrame) -> tuple[Fact, ...]:
    motor = find(settings.motor)
    full, empty = (hover_rpm(motor, payload) for payload in (1.0, 0.0))
    suitable = [name for name in feasible["motor"].unique() if feasible[feasible["motor"] == name]["feasible"].all()]
    return (
        Fact("motor", motor.name),
        Fact("mass at the start, at the end", f"{mass.iloc[0]:.3f}, {mass.iloc[-1]:.3f}", "kg"),
        Fact("hover at the start", hover_rpm(motor, settings.payload), "rpm"),
        Fact("hover with full and empty tank", f"{full:.0f} and {empty:.0f}", "rpm"),
        Fact("thrust of a rotor at 4600 rpm", rotor().thrust(4600.0 * RPM), "N"),
        Fact("greatest height", float(-flown["p_d"].min()), "m"),
        Fact("climb rate at the end", float(-flown["v_d"].iloc[-1]), "m/s"),
        Fact("distance north at the end", float(flown["p_n"].iloc[-1]), "m"),
        Fact("motors that hold the plan with every payload", ", ".join(suitable) or "none"),
    )


def _table(feasible: pd.DataFrame, voltage: float) -> CaseTable:
    frame = pd.DataFrame(
        {
            "motor": feasible["motor"],
            "payload (%)": 100.0 * feasible["payload"],
            "holds": np.where(feasible["feasible"], "yes", "no"),
            "mass (kg)": feasible["mass"].round(3),
            "hover (rpm)": feasible["hover_rpm"].round(),
            "top (rpm)": feasible["top_rpm"].round(),
            "limit (rpm)": feasible["limit_rpm"].round(),
            "power (W)": feasible["power"].round(1),
            "limit (W)": feasible["limit_power"],
        }
    )
    return CaseTable(
        f"Which motor holds the plan at {voltage:g} V: its top speed must stay below KV times voltage, its ideal power "
        f"below the motor's ({len(MOTORS)} motors, {len(PAYLOADS)} payloads).",
        frame,
    )
