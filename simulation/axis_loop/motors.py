"""What motors got and gyros felt of rate loops, as DataFlash has it: RCOU, ESC, IMU, bursts of the batch sampler."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from logparse import Motor
from logparse.craft.frames import motor_table
from logparse.dataflash.writer import MessageTable
from simulation.axis_loop.axis import LOOP_HZ, AxisRun

#: Mean thrust of the craft in parts of full, and the speed of its rotors there, rad/s.
HOVER, _SPEED = 0.35, 600.0

#: Parameters with which a motor's thrust is linear in its PWM.
LINEAR: Mapping[str, float] = {
    "MOT_PWM_MIN": 1000.0,
    "MOT_PWM_MAX": 2000.0,
    "MOT_SPIN_MIN": 0.1,
    "MOT_SPIN_MAX": 1.0,
    "MOT_SPIN_ARM": 0.05,
    "MOT_THST_EXPO": 0.0,
    "FRAME_CLASS": 1.0,
    "FRAME_TYPE": 1.0,
    **{f"SERVO{k}_FUNCTION": 32.0 + k for k in range(1, 5)},
}

#: Samples of a burst and of a row of it, and int16 per rad/s.
_BURST, _BLOCK, _SCALE = 1024, 32, 1000


def motor_tables(
    axes: Mapping[str, AxisRun],
    boot: float,
    *,
    rcou: float = 0.0,
    imu: float = 0.0,
    esc: float = 0.0,
    lag: float = 0.0,
    pause: float = 0.0,
) -> list[MessageTable]:
    """Return rows of a quadcopter's RCOU, IMU and ESC at these rates [Hz], and bursts of gyro samples this [s] apart.

    Rotors, whose speeds ESCs report, follow with a time constant `lag` [s].

    Parameters
    ----------
    axes : mapping of str to AxisRun
        Runs of roll, pitch and yaw; those that are missing do not move.
    boot : float
        Time since boot at the start of the runs, s.
    rcou, imu, esc : float
        Rows per second; 0 leaves the message out.
    lag : float
        Time constant of the rotors, s.
    pause : float
        From burst to burst of the batch sampler, s; 0 for none.
    """
    first = next(iter(axes.values()))
    n = len(first.t)
    motors = motor_table("quad", "x")
    gyro = np.column_stack([axes[name].measured if name in axes else np.zeros(n) for name in ("roll", "pitch", "yaw")])
    tables = []
    if rcou:
        rows = slice(None, None, round(LOOP_HZ / rcou))
        thrust = np.clip(_thrust(axes, motors, n)[rows], 0.0, 1.0)
        pwm = np.rint(1100.0 + 900.0 * thrust).astype(np.uint16)
        columns = {f"C{k}": pwm[:, k - 1] for k in range(1, 5)}
        tables.append(_table("RCOU", "QHHHH", "sYYYY", "F----", first.t[rows] + boot, columns))
    if imu:
        rows = slice(None, None, round(LOOP_HZ / imu))
        columns = {f"Gyr{axis}": gyro[rows, k] for k, axis in enumerate("XYZ")}
        columns |= {"AccX": np.zeros(len(gyro[rows])), "AccY": np.zeros(len(gyro[rows]))}
        lifted = axes["vertical"].measured if "vertical" in axes else np.zeros(n)
        columns["AccZ"] = -9.81 - lifted[rows]
        tables.append(_table("IMU", "Qffffff", "sEEEooo", "F------", first.t[rows] + boot, columns))
    if esc:
        tables.append(_esc(axes, motors, boot, esc, lag))
    if "vertical" in axes:
        tables += _throttle(axes["vertical"], boot)
    if pause:
        tables += _bursts(gyro, first.t + boot, pause)
    return tables


def _throttle(run: AxisRun, boot: float) -> list[MessageTable]:
    """Return the pilot's throttle and that of the controller, ten times a second."""
    rows = slice(None, None, round(LOOP_HZ / 10.0))
    asked, t = {"C3": np.rint(1500.0 + 50.0 * run.stick[rows]).astype(np.uint16)}, run.t[rows] + boot
    return [
        _table("CTUN", "Qf", "s-", "F-", t, {"ThO": HOVER + run.output[rows]}),
        _table("RCIN", "QH", "sY", "F-", t, asked),
    ]


def _thrust(axes: Mapping[str, AxisRun], motors: tuple[Motor, ...], n: int) -> np.ndarray:
    """Return what the mixer asks of each motor, shape (N, motors), in parts of full thrust."""
    outputs = {name: run.output for name, run in axes.items()}
    none = np.zeros(n)
    columns = [
        HOVER
        + outputs.get("vertical", none)
        + motor.roll * outputs.get("roll", none)
        + motor.pitch * outputs.get("pitch", none)
        + motor.yaw * outputs.get("yaw", none)
        for motor in motors
    ]
    return np.column_stack(columns)


def _esc(axes: Mapping[str, AxisRun], motors: tuple[Motor, ...], boot: float, rate: float, lag: float) -> MessageTable:
    thrust = _thrust(axes, motors, len(next(iter(axes.values())).t))
    if lag:
        decay = float(np.exp(-1.0 / (LOOP_HZ * lag)))
        thrust = HOVER + lfilter([0.0, 1.0 - decay], [1.0, -decay], thrust - HOVER, axis=0)
    rows = slice(None, None, round(LOOP_HZ / rate))
    rpm = _SPEED * np.sqrt(np.maximum(thrust[rows], 1e-3) / HOVER) * 30.0 / np.pi
    t = next(iter(axes.values())).t[rows] + boot
    columns = {"Instance": np.tile(np.arange(len(motors)), len(t)), "RPM": rpm.ravel(), "RawRPM": rpm.ravel()}
    columns |= {name: np.zeros(rpm.size) for name in ("Volt", "Curr", "Temp")}
    return _table("ESC", "QBfffff", "s#qqvAO", "F-00--0", np.repeat(t, len(motors)), columns)


def _bursts(gyro: np.ndarray, t: np.ndarray, pause: float) -> list[MessageTable]:
    """Return ISBH and ISBD rows of bursts, at the rate of the loop."""
    starts = np.arange(0, len(t) - _BURST, _BURST + round(pause * LOOP_HZ))
    numbers = np.arange(len(starts)) % 65536
    heads = {
        "N": numbers,
        "type": 1,
        "instance": 0,
        "mul": _SCALE,
        "smp_cnt": _BURST,
        "SampleUS": np.rint(t[starts] * 1e6).astype(np.uint64),
        "smp_rate": LOOP_HZ,
    }
    blocks = _BURST // _BLOCK
    at = (starts[:, None] + _BLOCK * np.arange(blocks)).ravel()
    raw = np.rint(gyro * _SCALE).astype(np.int16)
    written = t[np.minimum(at + _BURST + 8, len(t) - 1)]
    data: dict[str, object] = {"N": np.repeat(numbers, blocks), "seqno": np.tile(np.arange(blocks), len(starts))}
    data |= {axis: [raw[k : k + _BLOCK, j] for k in at] for j, axis in enumerate("xyz")}
    return [
        _table("ISBH", "QHBBHHQf", "s-----sz", "F-----F-", t[starts + _BURST], heads),
        _table("ISBD", "QHHaaa", "s-----", "F-----", written, data),
    ]


def _table(
    name: str, form: str, units: str, multipliers: str, t: np.ndarray, columns: Mapping[str, object]
) -> MessageTable:
    times = np.rint(t * 1e6).astype(np.uint64)
    return name, form, units, multipliers, pd.DataFrame({"TimeUS": times, **columns})
