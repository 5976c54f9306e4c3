"""The flight plan of Guntur 2019 as a case: five payloads, five motors, and a tank that empties."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from simulation import guntur2019
from simulation.errors import ParameterError
from simulation.guntur2019 import GRAVITY, MOTORS, PAYLOADS, RPM
from simulation.outcome import Fact, Outcome, Plot, Table
from simulation.paper_log import write_paper_log


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """What of the plan can be changed."""

    motor: str = "Sunnysky X2212-13 980KV"  #: One of the thesis' five.
    payload: float = 0.5  #: Share of the full tank of 1 kg, 0..1, with which the logged flight begins.
    trim_rpm: float = 0.0  #: Turns per minute about which the plan commands; 0: those that hover.
    discharge: float = 0.0  #: Share of the full tank that flows out per second.
    discharge_start: float = 5.0  #: s.
    voltage: float = 11.1  #: Of the battery, for the table of feasibility, V.
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


_NOTES = (
    "At 4600 turns per minute the printed rotor gives 1.32 N, so four of them carry 0.54 kg, and at the listing's 3200 "
    "less: the craft hovers at 6200 to 9200, about which the plan is flown here.",
    "Inertias are printed with E+09 kg mm², which would be thousands of kg m²; E+04 fits the craft and is taken.",
    "The thesis names no battery; three cells (11.1 V) decide which motor turns fast enough.",
)


def simulate(name: str, summary: str, settings: Profile) -> Outcome:
    """Fly the plan with every payload, and with the payload of the settings for the log.

    Parameters
    ----------
    name : str
        Name of the case, which its log has too.
    summary : str
        What it shows, in a line.
    settings : Profile
        What the user chose.
    """
    motor = guntur2019.find(settings.motor)
    trim = settings.trim_rpm or None
    craft = guntur2019.quadcopter(
        motor, settings.payload, discharge=settings.discharge, discharge_start=settings.discharge_start
    )
    flown = guntur2019.fly_profile(
        motor,
        settings.payload,
        trim_rpm=trim,
        duration=settings.duration,
        dt=settings.step,
        discharge=settings.discharge,
        discharge_start=settings.discharge_start,
    )
    mass = pd.Series(np.full(len(flown), craft.mass), index=flown.index)
    if craft.tank is not None:
        mass[:] = np.interp(flown.index, craft.tank.time, craft.tank.mass)
    feasible = guntur2019.feasibility(settings.voltage)

    def write_log(folder: Path) -> list[Path]:
        return write_paper_log(flown, craft, folder, name, summary, gravity=GRAVITY)

    speeds = flown[["w1", "w2", "w3", "w4"]]
    plots = [
        Plot(
            "Height of the flight that is logged: climb, pitch forward and back, more lift.",
            "height (m)",
            pd.DataFrame({"height": -flown["p_d"]}),
        ),
        Plot(
            "Distance north: the plan pitches forward at 8 s and, more strongly, back at 12 s.",
            "distance (m)",
            pd.DataFrame({"north": flown["p_n"]}),
        ),
        Plot(
            "Speeds of the rotors.",
            "rotor speed (rpm)",
            (speeds / RPM).rename(columns=lambda column: f"rotor {column[1:]}"),
        ),
    ]
    if craft.tank is None:
        heights, thrusts = _all_payloads(settings)
        plots += [
            Plot(
                "Height with each payload: about its own hover each craft flies nearly the same plan.",
                "height (m)",
                heights,
            ),
            Plot("Thrust of all rotors with each payload.", "thrust (N)", thrusts),
        ]
    else:
        plots.append(Plot("Mass of the craft while the tank empties.", "mass (kg)", pd.DataFrame({"mass": mass})))
    columns = {f"p_{axis}": f"p_{axis}_m" for axis in "ned"} | {f"v_{axis}": f"v_{axis}_m_s" for axis in "ned"}
    columns |= {f"w{k}": f"w{k}_rad_s" for k in range(1, 5)}
    history = flown[list(columns)].rename(columns=columns).assign(mass_kg=mass).rename_axis("t_s")
    return Outcome(
        name=name,
        summary=summary,
        facts=_facts(settings, flown, mass, feasible),
        notes=_NOTES,
        plots=tuple(plots),
        tables=(_feasibility(feasible, settings.voltage),),
        history=history,
        write_log=write_log,
    )


def _all_payloads(settings: Profile) -> tuple[pd.DataFrame, pd.DataFrame]:
    motor = guntur2019.find(settings.motor)
    rotor = guntur2019.rotor()
    per_square = rotor.thrust(100.0) / 100.0**2
    heights, thrusts = {}, {}
    for payload in PAYLOADS:
        flown = guntur2019.fly_profile(motor, payload, duration=settings.duration, dt=settings.step)
        heights[f"{100 * payload:.0f} %"] = -flown["p_d"]
        thrusts[f"{100 * payload:.0f} %"] = per_square * (flown[["w1", "w2", "w3", "w4"]] ** 2).sum(axis=1)
    return pd.DataFrame(heights), pd.DataFrame(thrusts)


def _facts(settings: Profile, flown: pd.DataFrame, mass: pd.Series, feasible: pd.DataFrame) -> tuple[Fact, ...]:
    motor = guntur2019.find(settings.motor)
    full, empty = (guntur2019.hover_rpm(motor, payload) for payload in (1.0, 0.0))
    held = [name for name in feasible["motor"].unique() if feasible[feasible["motor"] == name]["feasible"].all()]
    return (
        Fact("motor", motor.name),
        Fact("mass at the start, at the end", f"{mass.iloc[0]:.3f}, {mass.iloc[-1]:.3f}", "kg"),
        Fact("hover at the start", guntur2019.hover_rpm(motor, settings.payload), "rpm"),
        Fact("hover with full and empty tank", f"{full:.0f} and {empty:.0f}", "rpm"),
        Fact("thrust of a rotor at 4600 rpm", guntur2019.rotor().thrust(4600.0 * RPM), "N"),
        Fact("greatest height", float(-flown["p_d"].min()), "m"),
        Fact("climb rate at the end", float(-flown["v_d"].iloc[-1]), "m/s"),
        Fact("distance north at the end", float(flown["p_n"].iloc[-1]), "m"),
        Fact("motors that hold the plan with every payload", ", ".join(held) or "none"),
    )


def _feasibility(feasible: pd.DataFrame, voltage: float) -> Table:
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
    return Table(
        f"Which motor holds the plan at {voltage:g} V: its top speed must stay below KV times voltage, its ideal power "
        f"below the motor's ({len(MOTORS)} motors, {len(PAYLOADS)} payloads).",
        frame,
    )
