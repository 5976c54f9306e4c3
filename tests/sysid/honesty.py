"""Numbers that are stated with a sigma against craft whose truth is known: z = (value - truth) / sigma."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from core.units import STANDARD_GRAVITY
from simulation.vehicle import Multirotor
from sysid import Experiment, PhysicalParameters, RigidBodyModel
from sysid.records.motor_scaling import motor_commands
from sysid.records.thrust_curve import REFERENCE_DENSITY

#: Speed at which drag is judged as a whole, m/s.
DRAG_SPEED = 4.0


@dataclass(frozen=True, slots=True)
class Stated:
    """One number that was stated with a sigma, and what it should be."""

    flight: str
    method: str
    parameter: str
    value: float
    sigma: float
    truth: float

    @property
    def z(self) -> float:
        return (self.value - self.truth) / self.sigma


@dataclass(frozen=True, slots=True)
class Truth:
    """What the equations of `sysid.rigid_body` should find at a reference voltage, in sea-level air.

    `parameters` by the names of the rigid body, `wind` towards north and east 10 m above the ground.
    """

    parameters: Mapping[str, float]
    wind: tuple[float, float]
    lever: tuple[float, float]
    yaw_lever: float


def firmware_truth(facts: Mapping, record: Experiment, voltage: float, *, rotor_drag: bool = True) -> Truth:
    """Read the truth beside a log of ArduPilot's simulator (its JSON), at a voltage [V], in the air of a record.

    Its yaw torque goes with command times thrust: linearised about the record's hover. Linear drag as fitted, by the
    rotors' speed or by density.
    """
    truth, wind = facts["truth"], facts["wind"]
    inputs, mass, arm = truth["model_inputs"], truth["mass_kg"], truth["arm_length_m"]
    count, inertia = truth["num_motors"], truth["inertia_kgm2"]
    full = truth["max_thrust_per_motor_N_sea_level_static_full_voltage"] * (voltage / inputs["maxVoltage"]) ** 2
    momentum = truth["mdrag_coef_used"] * np.sqrt(1.225 * truth["true_prop_area_per_motor"])
    linear = momentum * np.sqrt(count * STANDARD_GRAVITY / mass)
    if not rotor_drag:
        linear /= np.sqrt(float(record.context["density"].mean()) / REFERENCE_DENSITY)
    expo = inputs["propExpo"]
    command = float(np.mean(motor_commands(record.u, record.vehicle)))
    # Motors that move through the air as the craft turns are dragged too, at hover thrust in the flight's air.
    air = float(record.context["density"].mean()) / REFERENCE_DENSITY
    drag = momentum * np.sqrt(air * mass * STANDARD_GRAVITY / count)
    across, along = (sum(motor[name] ** 2 for motor in truth["motors"]) for name in ("y_m", "x_m"))
    damped = {"roll": across / inertia["Ixx"], "pitch": along / inertia["Iyy"]}
    damped["yaw"] = (across + along) / inertia["Izz"]
    pull, slope = (1.0 - expo) * command + expo * command**2, 1.0 - expo + 2.0 * expo * command
    parameters = {
        "thrust": full / mass,
        "thrust_expo": expo,
        "climb_loss": 0.6125 * count * truth["effective_prop_area_per_motor"] / mass,
        "tilt_x": 0.0,
        "tilt_y": 0.0,
        "wind_exponent": 0.5,
        # No lag but a slew limit: full range in 1 / slew_max.
        "motor_lag": 0.0,
        "roll_gain": arm * full / inertia["Ixx"],
        "pitch_gain": arm * full / inertia["Iyy"],
        "yaw_gain": 0.05 * arm * full / inertia["Izz"] * (command + pull / slope),
        **{f"{axis}_damping": truth["rotational_damping_per_s"] + drag * arms for axis, arms in damped.items()},
        "cg_x": 0.0,
        "cg_y": 0.0,
        **{f"drag_linear_{axis}": float(linear) for axis in "xyz"},
        **{f"drag_quadratic_{axis}": 0.6125 * truth["areaCd_m2"] / mass for axis in "xyz"},
    }
    if not wind["SIM_WIND_SPD"]:
        del parameters["wind_exponent"]
    towards = np.radians(wind["SIM_WIND_DIR"] + 180.0)
    speed = wind["SIM_WIND_SPD"] * (np.sqrt(10.0 / 60.0) if wind["SIM_WIND_T"] == 0 else 1.0)
    return Truth(
        parameters,
        (float(speed * np.cos(towards)), float(speed * np.sin(towards))),
        (inertia["Ixx"] / (mass * arm), inertia["Iyy"] / (mass * arm)),
        inertia["Izz"] / (mass * arm),
    )


def simulated_truth(craft: Multirotor, voltage: float, wind: tuple[float, float]) -> Truth:
    """Read the truth from a craft of `simulation`."""
    rotor, drive = craft.rotors[0].rotor, craft.drive
    full = rotor.thrust_coefficient * (drive.speed_max * voltage / drive.voltage_reference) ** 2
    mass, arm = craft.mass, float(np.hypot(*craft.rotors[0].position[:2]))
    parameters = {
        "thrust": full / mass,
        "thrust_expo": drive.expo,
        "motor_lag": drive.response.time_constant,
        "tilt_x": 0.0,
        "tilt_y": 0.0,
        "cg_x": 0.0,
        "cg_y": 0.0,
        "roll_gain": arm * full / craft.inertia[0, 0],
        "pitch_gain": arm * full / craft.inertia[1, 1],
        "yaw_gain": rotor.torque_coefficient / rotor.thrust_coefficient * full / craft.inertia[2, 2],
        "wind_exponent": 0.0,
        "climb_loss": 0.0,
        **{f"drag_linear_{axis}": craft.drag_linear[k] / mass for k, axis in enumerate("xyz")},
        **{f"drag_quadratic_{axis}": 0.6125 * craft.drag_area[k] / mass for k, axis in enumerate("xyz")},
    }
    inertia = np.diag(craft.inertia)
    return Truth(
        parameters, wind, (inertia[0] / (mass * arm), inertia[1] / (mass * arm)), float(inertia[2] / (mass * arm))
    )


def stated_by_body(model: RigidBodyModel, record: Experiment, truth: Truth) -> Iterator[Stated]:
    """Yield what a rigid body states of its craft and of the flight's wind."""
    name, expected = record.name, truth.parameters
    for parameter in model.parameters.values():
        if parameter.value is not None and parameter.sigma is not None and parameter.name in expected:
            yield Stated(name, "rigid body", parameter.name, parameter.value, parameter.sigma, expected[parameter.name])
    for axis in "xyz":
        whole, sigma = model.drag(axis, DRAG_SPEED)
        drag = expected[f"drag_linear_{axis}"] * DRAG_SPEED + expected[f"drag_quadratic_{axis}"] * DRAG_SPEED**2
        if 0.0 < sigma < 0.25 * whole:
            yield Stated(name, "rigid body", f"drag at 4 m/s, {axis}", whole, sigma, drag)
    trim = model.flights.get(name)
    if trim is not None:
        for axis, component, wind in zip("ne", (trim.wind_n, trim.wind_e), truth.wind, strict=True):
            yield Stated(name, "rigid body", f"wind_{axis}", component, trim.wind_sigma, wind)
        if "wind_exponent" in expected:
            yield Stated(
                name, "rigid body", "wind_exponent", trim.wind_exponent, trim.wind_exponent_sigma,
                expected["wind_exponent"],
            )  # fmt: skip


def stated_side_by_side(parameters: PhysicalParameters, record: Experiment, truth: Truth) -> Iterator[Stated]:
    """Yield what all methods state in one table, the rigid body's column excepted."""
    expected = {
        "thrust over mass": truth.parameters["thrust"],
        "thrust over mass at hover": truth.parameters["thrust"] * hover_part(record, truth.parameters["thrust_expo"]),
        "thrust curve": truth.parameters["thrust_expo"],
        "motor lag": truth.parameters["motor_lag"],
        "roll inertia over mass and arm": truth.lever[0],
        "pitch inertia over mass and arm": truth.lever[1],
        "yaw torque over inertia": truth.parameters["yaw_gain"],
        "linear drag over mass": np.mean([truth.parameters[f"drag_linear_{axis}"] for axis in "xy"]),
        "quadratic drag over mass": np.mean([truth.parameters[f"drag_quadratic_{axis}"] for axis in "xy"]),
    }
    for (parameter, method), row in parameters.table.iterrows():
        if (method == "rigid body" and not parameter.endswith("arm")) or parameter not in expected:
            continue
        if np.isfinite([row["value"], row["sigma"]]).all() and row["sigma"] > 0.0:
            yield Stated(record.name, method, parameter, row["value"], row["sigma"], float(expected[parameter]))


def hover_part(record: Experiment, expo: float) -> float:
    """Return the part of full thrust at the command flown on average."""
    command = float(np.mean(np.clip(motor_commands(record.u, record.vehicle), 0.0, 1.0)))
    return (1.0 - expo) * command + expo * command**2


def table(stated: list[Stated]) -> list[tuple[str, str, int, float, float, float, float, str]]:
    """Sum up by method and parameter: count, rms z, largest |z|, median error and sigma, the farthest flight."""
    rows = []
    for key in dict.fromkeys((statement.method, statement.parameter) for statement in stated):
        those = [statement for statement in stated if (statement.method, statement.parameter) == key]
        z = np.array([statement.z for statement in those])
        farthest = those[int(np.argmax(np.abs(z)))]
        errors = [abs(statement.value - statement.truth) for statement in those]
        rows.append(
            (
                *key,
                len(those),
                float(np.sqrt(np.mean(z**2))),
                float(np.max(np.abs(z))),
                float(np.median(errors)),
                float(np.median([statement.sigma for statement in those])),
                farthest.flight,
            )
        )
    return rows
