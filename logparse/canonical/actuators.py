"""Motor outputs and ESC telemetry by motor number of the autopilot's frame, not by output channel."""

import re
from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from core.findings import Finding, warning
from core.units import numbers
from logparse.canonical.fields import Kind, Messages, first, has, instances, table, value, values
from logparse.canonical.remarks import Remarks
from logparse.canonical.series import Array, sample, series
from logparse.craft.frames import Motor, Vehicle
from logparse.craft.vehicle import assumed_outputs

#: Range of servo pulses [us]; outside are unused outputs (0), unset memory (65535, negative) and DShot numbers.
_PULSE_RANGE = (800.0, 2250.0)

#: Messages with servo outputs, and their column by age of the firmware. RCO2 and RCO3 hold outputs from 15.
_OUTPUTS: Mapping[Kind, tuple[tuple[str, ...], str]] = {
    Kind.DATAFLASH: (("RCOU", "RCO2", "RCO3"), "C{0} | Ch{0} | Chan{0}"),
    Kind.TELEMETRY: (("SERVO_OUTPUT_RAW",), "servo{0}_raw"),
}


def motors(
    messages: Messages, kind: Kind, parameters: Mapping[str, float], vehicle: Vehicle, remarks: Remarks
) -> pd.DataFrame | None:
    """Return motor outputs [us] by motor number."""
    if kind is Kind.PX4:
        return _px4_motors(messages, vehicle, _dshot(parameters), remarks)
    names, field = _OUTPUTS[kind]
    if first(messages, names[0]) is None:
        return _before_3_1(messages, vehicle.motors, remarks)
    logged: dict[str, tuple[pd.Index[float], Array]] = {}
    for motor in vehicle.motors:
        output = None if motor.channel is None else _output(messages, names, field.format(motor.channel), remarks)
        if output is None:
            remarks.add(_unmapped(motor.number, names[0]))
        else:
            logged[f"m{motor.number}"] = output
    if kind is Kind.TELEMETRY:
        _remark_assumed(vehicle.motors, parameters, remarks)
    if not logged:
        return None
    t, _ = next(iter(logged.values()))
    outputs = series(t, {name: pulse for name, (at, pulse) in logged.items() if at.equals(t)})
    for name, (at, pulse) in logged.items():
        if name not in outputs:  # RCO2 is written right after RCOU with the same time
            outputs[name] = sample(series(at, {name: pulse}), outputs.index.to_numpy(), gap=0.05)[:, 0]
    return outputs[list(logged)]


def _output(
    messages: Messages, names: tuple[str, ...], field: str, remarks: Remarks
) -> "tuple[pd.Index[float], Array] | None":
    """Return the times and pulses of one servo output, from the first of the messages that has it."""
    for name in names:
        frame = first(messages, name)
        if frame is not None and "port" in frame:
            frame = frame[frame["port"] == 0]  # port 1 of SERVO_OUTPUT_RAW holds outputs from 17
        if frame is not None and has(frame, field):
            return frame.index, _pulses(value(frame, field), name, remarks)
    return None


def _before_3_1(messages: Messages, frame_motors: tuple[Motor, ...], remarks: Remarks) -> pd.DataFrame | None:
    """Return the motor outputs of MOT, which firmware before 3.1 wrote."""
    frame = first(messages, "MOT")
    if frame is None:
        return None
    logged = sorted(int(str(name)[3:]) for name in frame if re.fullmatch(r"Mot\d+", str(name)))
    wanted = [motor.number for motor in frame_motors if motor.number in logged] or logged
    columns = {f"m{k}": _pulses(numbers(frame, f"Mot{k}"), "MOT", remarks) for k in wanted}
    return series(frame.index, columns) if columns else None


def _unmapped(number: int, message: str) -> Finding:
    """Return the finding that a motor's output is not in the log."""
    return warning(
        "not-logged",
        f"Motor {number} of the frame has no logged servo output.",
        f"Check SERVOn_FUNCTION on the autopilot; {message} must hold the output that drives this motor.",
        motor=number,
    )


def _remark_assumed(frame_motors: tuple[Motor, ...], parameters: Mapping[str, float], remarks: Remarks) -> None:
    """Remark which motors are assumed on the output of their number because SERVOn_FUNCTION is missing."""
    assumed = assumed_outputs(frame_motors, parameters)
    if assumed:
        listed = ", ".join(map(str, assumed))
        remarks.add(
            warning(
                "frame-unknown",
                f"The log lacks SERVOn_FUNCTION of outputs {listed}; "
                "the motors of these numbers are taken to be on them.",
                "Let the ground station download all parameters before take-off.",
                motors=listed,
            )
        )


def _pulses(widths: Array, message: str, remarks: Remarks) -> Array:
    """Return pulse widths [us] with NaN where there is no pulse (0, which is no error) or an impossible one."""
    low, high = _PULSE_RANGE
    silent = widths == 0.0
    bad = ~((widths >= low) & (widths <= high)) & ~silent
    return remarks.remove(
        np.where(silent, np.nan, widths), bad, message, f"pulse of a motor outside {low:.0f}..{high:.0f} us"
    )


def _dshot(parameters: Mapping[str, float]) -> bool:
    """Return whether DShot drives the motors: a timer of the outputs set to -5..-2, or DSHOT_CONFIG before 1.13."""
    timers = [value for name, value in parameters.items() if name.startswith(("PWM_MAIN_TIM", "PWM_AUX_TIM"))]
    return any(-5.0 <= value <= -2.0 for value in timers) or parameters.get("DSHOT_CONFIG", 0.0) > 0.0


def _px4_motors(messages: Messages, vehicle: Vehicle, dshot: bool, remarks: Remarks) -> pd.DataFrame | None:
    """Return motor outputs [us]: pulses as logged, DShot commands and commands of 0..1 as the pulses for them."""
    frame = _moving_group(messages, vehicle.motors)
    largest = float(np.nanmax(frame.to_numpy(), initial=0.0)) if frame is not None else 0.0
    if frame is not None and dshot and largest > 1.0:
        return _pulses_of_dshot(frame)
    low, _ = _PULSE_RANGE
    if frame is not None and largest >= low and not (frame.gt(0.0) & frame.lt(low)).to_numpy().any():
        columns = {
            str(name): _pulses(frame[name].fillna(0.0).to_numpy(), "actuator_outputs", remarks) for name in frame
        }
        return series(frame.index, columns)
    # Outputs of simulators and CAN are speeds; the commands of the mixer are not.
    commanded = first(messages, "actuator_motors")
    if commanded is None:
        return None if frame is None or largest <= 1.0 else _pulses_of_dshot(frame)
    commands = {k: value(commanded, f"control[{k - 1}]") for k in range(1, 13)}
    wanted = [motor.number for motor in vehicle.motors] or [k for k in commands if np.isfinite(commands[k]).any()]
    return series(commanded.index, {f"m{k}": 1000.0 + 1000.0 * commands[k] for k in wanted})


def _pulses_of_dshot(throttle: pd.DataFrame) -> pd.DataFrame:
    """Return the pulses [us] for DShot throttle, which runs from 0 to 1999 (48..2047 on the wire)."""
    return 1000.0 + 0.5 * throttle.clip(0.0, 2000.0)


def _moving_group(messages: Messages, frame_motors: tuple[Motor, ...]) -> pd.DataFrame | None:
    """Return the outputs of the motors in the first group (main, auxiliary, CAN) in which all of them move."""
    groups = []
    for name in messages:
        if frame_motors and re.fullmatch(r"actuator_outputs(_\d+)?", name):
            for start in (1, 9):  # auxiliary outputs are numbered from 9, and from 1 in a group of their own
                fields = {f"m{m.number}": f"output[{(m.channel or m.number) - start}]" for m in frame_motors}
                groups.append(series(messages[name].index, values(messages[name], fields)))
    moving = (group for group in groups if len(group) and (group.max() > group.min()).all())
    return next(moving, groups[0] if groups else None)


def esc(messages: Messages, kind: Kind, frame_motors: tuple[Motor, ...]) -> pd.DataFrame | None:
    """Return ESC telemetry by motor number, at the times of the first motor that has any."""
    by_output = dict(_escs(messages, kind))
    if kind is Kind.PX4:
        frame = first(messages, "esc_status")
        # Since 1.13 an ESC says which motor it drives (101 for the first).
        drives = {} if frame is None else {k: value(frame, f"esc[{k}].actuator_function") for k in range(12)}
        entries = {int(np.nanmax(drives[k], initial=0)) - 100: k + 1 for k in drives}
        outputs = {motor.number: entries.get(motor.number, motor.number) for motor in frame_motors}
    else:
        outputs = {motor.number: motor.channel or motor.number for motor in frame_motors}
    by_motor = {number: by_output[output] for number, output in outputs.items() if output in by_output}
    if not by_motor:
        return None
    times = next(iter(by_motor.values())).index.to_numpy()
    interval = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    gap = 2.0 if kind is Kind.TELEMETRY else 2.0 * interval
    joined = {number: sample(telemetry, times, gap=gap) for number, telemetry in by_motor.items()}
    return series(
        times,
        {
            f"{name}{number}": columns[:, k]
            for k, name in enumerate(("w", "voltage", "current"))
            for number, columns in joined.items()
        },
    )


def _escs(messages: Messages, kind: Kind) -> Iterator[tuple[int, pd.DataFrame]]:
    """Yield the telemetry of each ESC with the number of its output."""
    if kind is Kind.DATAFLASH:
        fields = {"w": "RPM rpm", "voltage": "Volt V", "current": "Curr A"}
        for name, frame in instances(messages, "ESC", *(f"ESC{k}" for k in range(1, 13))):
            number = re.search(r"-?\d+", name)  # of instances from 0, of messages from 1
            yield int(number[0]) + name.endswith("]") if number else 1, table(frame, fields)
        return
    if kind is Kind.TELEMETRY:  # in groups of four
        groups = {f"ESC_TELEMETRY_{k}_TO_{k + 3}": k for k in range(1, 33, 4)}
        fields, count = {"w": "rpm[{0}] rpm", "voltage": "voltage[{0}] cV", "current": "current[{0}] cA"}, 4
    else:
        groups, count = {"esc_status": 1}, 12
        fields = {"w": "esc[{0}].esc_rpm rpm", "voltage": "esc[{0}].esc_voltage V", "current": "esc[{0}].esc_current A"}
    for name, start in groups.items():
        group = first(messages, name)
        if group is not None:
            for k in range(count):
                yield start + k, table(group, {column: field.format(k) for column, field in fields.items()})
