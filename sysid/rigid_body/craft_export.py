"""An identified craft as files: JSON, MATLAB, simulator frame, linear hover model."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from core.serialization import as_json
from core.units import STANDARD_GRAVITY
from logparse import Finding, MissingDataError, Severity
from sysid.records.motor_scaling import command_for
from sysid.records.thrust_curve import REFERENCE_DENSITY
from sysid.rigid_body.hover import HoverModel, hover_model
from sysid.rigid_body.model import RigidBodyModel
from sysid.rigid_body.model_record import RigidBodyRecord


@dataclass(frozen=True, slots=True)
class FrameExport:
    """A custom frame."""

    frame: Mapping[str, float | list[float]]  #: Labels and numbers as the simulator reads them.
    notes: Mapping[str, str]  #: For each label where its number comes from.
    undetermined: tuple[str, ...]  #: Labels whose numbers no flight determined.

    def write(self, path: Path) -> None:
        """Write the frame; notes go into a Markdown file beside it, because the simulator knows no comments by us."""
        path.write_text(json.dumps(dict(self.frame), indent=4) + "\n", encoding="ascii")
        lines = [f"# {path.name}: where its numbers come from", ""]
        lines += [
            f"- `{label}`{' (not determined from flight)' if label in self.undetermined else ''}: {note}"
            for label, note in self.notes.items()
        ]
        path.with_suffix(".md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def frame_json(
    model: RigidBodyModel,
    mass: float | None = None,
    *,
    arm: float | None = None,
    disc_area: float | None = None,
) -> FrameExport:
    """Translate an identified rigid body.

    Parameters
    ----------
    model : RigidBodyModel
    mass : float, optional
        kg; the model's own otherwise.
    arm : float, optional
        Distance of the motors from the centre, m. Without it the simulator's 0.35 m stand in; inertia follows the arm,
        so that the craft turns as identified whichever it is.
    disc_area : float, optional
        Of all rotors (coaxial ones counted once), m^2.

    Raises
    ------
    MissingDataError
        Without a mass, thrust or motors.
    """
    weight = mass if mass is not None else model.mass
    if weight is None or not weight > 0.0:
        raise MissingDataError("a simulator frame needs the mass, which motion does not tell; give it (--mass)")
    if not model.parameters["thrust"].determined:
        raise MissingDataError(f"no simulator frame: thrust is not determined ({model.parameters['thrust'].reason})")
    motors = model.vehicle.motors
    if not motors:
        raise MissingDataError("no simulator frame: the log does not tell the motors of the craft")
    sheet = _Sheet()
    _power(sheet, model, weight)
    _outputs(sheet, model)
    _drag(sheet, model, weight, disc_area)
    _rotation(sheet, model, weight, arm)
    sheet.put("num_motors", float(len(motors)), "motors of the frame")
    return FrameExport(sheet.frame, sheet.notes, tuple(sheet.undetermined))


class _Sheet:
    """Numbers with their notes, as they are filled in."""

    def __init__(self) -> None:
        self.frame: dict[str, float | list[float]] = {}
        self.notes: dict[str, str] = {}
        self.undetermined: list[str] = []

    def put(self, label: str, value: float | list[float], note: str, known: bool = True) -> None:
        """Fill one label in."""
        self.frame[label] = [_round(number) for number in value] if isinstance(value, list) else _round(value)
        self.notes[label] = note
        if not known:
            self.undetermined.append(label)


def _round(value: float) -> float:
    return float(f"{value:.7g}")


def _power(sheet: _Sheet, model: RigidBodyModel, mass: float) -> None:
    count, known = len(model.vehicle.motors), model.reference_voltage is not None
    sheet.put("mass", mass, "as given; motion does not tell it")
    volts = 12.6 if model.reference_voltage is None else model.reference_voltage
    sheet.put("maxVoltage", volts, "voltage at which thrust was identified" if known else "assumed", known)
    sheet.put(
        "hoverThrOut",
        STANDARD_GRAVITY / (count * model.value("thrust")),
        "weight over full thrust at refAlt and maxVoltage: 9.80665 / (n k/m)",
    )
    sheet.put("refAlt", 0.0, "identified coefficients hold in sea-level air")
    sheet.put("refTempC", 15.0, "standard atmosphere; the simulator does not use it", False)
    loss = model.parameters["climb_loss"]
    known = loss.determined and loss.used > 0.0
    # The simulator's default craft in hover: 2 x 12.09 V x 29.3 A over 3 kg are 24.08 m/s.
    outflow = math.sqrt(STANDARD_GRAVITY / loss.used) if known else 24.08
    sheet.put("refVoltage", volts, "with refCurrent: power in hover")
    sheet.put(
        "refCurrent",
        outflow * mass * STANDARD_GRAVITY / 2.0 / volts,
        "power in hover whose outflow velocity loses thrust with climb as identified"
        if known
        else "power in hover with the outflow velocity of the simulator's default craft; loss of thrust in climb was "
        "not determined",
        known,
    )
    sheet.put("battCapacityAh", 0.0, "0: voltage stays; a flight does not tell capacity", False)
    sheet.put("refBatRes", 0.0, "without sag there is none", False)


def _outputs(sheet: _Sheet, model: RigidBodyModel) -> None:
    vehicle, expo = model.vehicle, model.parameters["thrust_expo"]
    sheet.put(
        "propExpo",
        expo.used,
        "curvature of thrust over command as identified" if expo.determined else "the autopilot's MOT_THST_EXPO",
        expo.determined,
    )
    sheet.put("pwmMin", vehicle.pwm_min, "MOT_PWM_MIN")
    sheet.put("pwmMax", vehicle.pwm_max, "MOT_PWM_MAX")
    sheet.put("spin_min", vehicle.spin_min, "MOT_SPIN_MIN")
    sheet.put("spin_max", vehicle.spin_max, "MOT_SPIN_MAX")
    lag = model.parameters["motor_lag"]
    known = lag.determined and lag.used > 0.0
    sheet.put(
        "slew_max",
        1.0 / lag.used if known else 150.0,
        "the simulator has a slew limit and no lag: full range in the identified time constant"
        if known
        else "the simulator's default; a lag was not determined",
        known,
    )


def _drag(sheet: _Sheet, model: RigidBodyModel, mass: float, disc_area: float | None) -> None:
    linear, quadratic = (
        0.5 * (max(model.value(f"drag_{law}_x"), 0.0) + max(model.value(f"drag_{law}_y"), 0.0))
        for law in ("linear", "quadratic")
    )
    known = any(
        model.parameters[f"drag_{law}_{axis}"].determined for law in ("linear", "quadratic") for axis in ("x", "y")
    )
    # mdrag sqrt(disc_area) is all that acts; m d = mdrag sqrt(rho disc_area m g).
    product = mass * linear / math.sqrt(REFERENCE_DENSITY * mass * STANDARD_GRAVITY)
    if disc_area is not None:
        area, coefficient, how = disc_area, product / math.sqrt(disc_area), "as given"
    elif product > 0.0:
        area, coefficient, how = (product / 0.2) ** 2, 0.2, "so that mdrag_coef is the simulator's default"
    else:
        area, coefficient, how = 0.385, 0.0, "the simulator's default"
    sheet.put("disc_area", area, f"{how}; acts only in the product mdrag_coef sqrt(disc_area)", disc_area is not None)
    note = "linear drag, mean of body x and y, at hover thrust" if known else "no drag was determined"
    sheet.put("mdrag_coef", coefficient, note, known)
    area_cd = 2.0 * mass * quadratic / REFERENCE_DENSITY
    speed, angle = _reference_flight(mass, area_cd, coefficient, area)
    sheet.put("refSpd", speed, "chosen")
    sheet.put(
        "refAngle",
        math.degrees(angle),
        f"lean at refSpd that gives quadratic drag of {area_cd:.4g} m^2, mean of body x and y; the simulator has "
        "the same on every axis",
        known,
    )


def _reference_flight(mass: float, area_cd: float, mdrag: float, disc_area: float) -> tuple[float, float]:
    """Speed and lean angle [rad] that the simulator turns back into this drag."""
    speed = 10.0

    def surplus(angle: float) -> float:
        cosine = math.cos(angle)
        lift = mass * STANDARD_GRAVITY / cosine
        momentum = cosine * mdrag * speed * cosine * math.sqrt(lift * REFERENCE_DENSITY * disc_area)
        return mass * STANDARD_GRAVITY * math.tan(angle) - momentum - 0.5 * REFERENCE_DENSITY * area_cd * speed**2

    while surplus(math.radians(60.0)) < 0.0:
        speed *= 0.7
    if surplus(1e-9) >= 0.0:
        return speed, 0.0
    return speed, float(scipy.optimize.brentq(surplus, 0.0, math.radians(60.0), xtol=1e-13))


def _rotation(sheet: _Sheet, model: RigidBodyModel, mass: float, arm: float | None) -> None:
    length = arm if arm is not None else 0.35
    sheet.put(
        "diagonal_size",
        length,
        "distance of the motors from the centre (the simulator takes it for the arm)" + ("" if arm else ", assumed"),
        arm is not None,
    )
    damping = 0.5 * (model.value("roll_damping") + model.value("pitch_damping"))
    known = damping > 0.0 and any(model.parameters[f"{axis}_damping"].determined for axis in ("roll", "pitch"))
    sheet.put(
        "refRotRate",
        math.radians(400.0) / damping if damping > 0.0 else 120.0,
        "rate damping, mean of roll and pitch" if known else "rate damping was not determined",
        known,
    )
    gains = {axis: model.parameters[f"{axis}_gain"] for axis in ("roll", "pitch", "yaw")}
    if not (gains["roll"].determined and gains["pitch"].determined):
        sheet.notes["moment_inertia"] = "left to the simulator's estimate: " + (
            gains["roll"].reason or gains["pitch"].reason
        )
        sheet.undetermined.append("moment_inertia")
        return
    thrust = mass * model.value("thrust")
    roll, pitch = (length * thrust / gains[axis].used for axis in ("roll", "pitch"))
    sheet.put(
        "moment_inertia",
        [roll, pitch, roll + pitch],
        "Ixx and Iyy by arm x thrust over roll and pitch effectiveness; Izz as of a flat body, because flight tells "
        "only torque over Izz, which motorN_yaw makes right",
    )
    if not gains["yaw"].determined:
        sheet.notes["motor1_yaw"] = f"left at the simulator's +-1: {gains['yaw'].reason}"
        sheet.undetermined.append("motor1_yaw")
        return
    motors, expo = model.vehicle.motors, model.value("thrust_expo")
    command = min(command_for(STANDARD_GRAVITY / (len(motors) * model.value("thrust")), expo), 1.0)
    curve = (1.0 - expo) * command + expo * command**2
    slope = 1.0 - expo + 2.0 * expo * command
    factor = gains["yaw"].used * (roll + pitch) * slope / (0.05 * length * thrust * (curve + command * slope))
    for motor in motors:
        if motor.spin:
            note = "effect of yaw commands about hover as identified; the simulator's torque goes with c T"
            sheet.put(f"motor{motor.number}_yaw", -motor.spin * factor, note)


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftFile:
    """What craft.json holds."""

    craft: RigidBodyRecord
    hover: HoverModel | None


def write_craft(
    model: RigidBodyModel,
    folder: Path,
    mass: float | None = None,
    *,
    arm: float | None = None,
    disc_area: float | None = None,
) -> tuple[list[Path], list[Finding]]:
    """Write ``craft.json``, ``craft.mat`` and, where flight determined enough, ``sitl_frame.json`` with its notes.

    Parameters
    ----------
    model : RigidBodyModel
    folder : Path
        Made when missing.
    mass : float, optional
        kg; the model's own otherwise.
    arm, disc_area : float, optional
        As `frame_json`.

    Returns
    -------
    files : list of Path
    findings : list of Finding
        What could not be written, and why.
    """
    folder.mkdir(parents=True, exist_ok=True)
    findings: list[Finding] = []
    linear: HoverModel | None = None
    try:
        linear = hover_model(model)
    except MissingDataError as error:
        findings.append(Finding("not-determined", Severity.INFO, str(error)))
    record = CraftFile(craft=model.record(), hover=linear)
    files = [folder / "craft.json", folder / "craft.mat"]
    files[0].write_text(as_json(record), encoding="utf-8")
    scipy.io.savemat(files[1], _for_matlab(model, linear), long_field_names=True, oned_as="column")
    try:
        frame = frame_json(model, mass, arm=arm, disc_area=disc_area)
    except MissingDataError as error:
        findings.append(Finding("not-determined", Severity.INFO, str(error)))
    else:
        path = folder / "sitl_frame.json"
        frame.write(path)
        files += [path, path.with_suffix(".md")]
    return files, findings


def _for_matlab(model: RigidBodyModel, linear: HoverModel | None) -> dict[str, object]:
    """Structures ``parameters`` (value, sigma, unit), ``covariance``, ``hover`` (A, B, trim); NaN: not determined."""
    result: dict[str, object] = {
        "parameters": {
            re.sub(r"\W", "_", name): {
                "value": np.nan if parameter.value is None else parameter.value,
                "sigma": np.nan if parameter.sigma is None else parameter.sigma,
                "used": parameter.used,
                "unit": parameter.unit,
            }
            for name, parameter in model.parameters.items()
        },
        "estimated": np.array(model.estimated, dtype=object),
        "covariance": model.covariance,
        "mass": np.nan if model.mass is None else model.mass,
        "reference_density": model.reference_density,
        "reference_voltage": np.nan if model.reference_voltage is None else model.reference_voltage,
    }
    if linear is not None:
        result["hover"] = {
            "A": linear.A,
            "B": linear.B,
            "eigenvalues": np.array(linear.eigenvalues),
            "trim": linear.trim,
            "input_unit": linear.input_unit,
        }
    return result
