"""Write rate loops as the DataFlash log that ArduPilot would have written."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from logparse.dataflash.writer import MessageTable, write_dataflash
from simulation.axis_loop.axis import LOOP_HZ, AxisRun, LoopGains
from simulation.axis_loop.motors import LINEAR, motor_tables
from sysid.loops.settings import AXES

_SYSTEMID, _STABILIZE = 25, 0
_LETTERS = {"roll": "R", "pitch": "P", "yaw": "Y", "vertical": "A"}
_BOOT = 10.0


def write_rate_log(
    path: Path,
    axes: Mapping[str, AxisRun],
    *,
    rate: float = 400.0,
    filter_hz: float = 20.0,
    parameters: Mapping[str, float] | None = None,
    motors: Mapping[str, float] | None = None,
    gains: Mapping[str, LoopGains] | None = None,
) -> None:
    """Write RATE, SIDD, SIDS, ATT, MODE and PARM of axes that were run over the same time.

    Parameters
    ----------
    path : Path
    axes : mapping of str to AxisRun
        By name: roll, pitch, yaw, vertical; those left out stand still.
    rate : float
        Rows of RATE and SIDD per second: samples, not averages, as the autopilot logs them.
    filter_hz : float
        INS_GYRO_FILTER.
    parameters : mapping, optional
        More parameters.
    motors : mapping, optional
        Rates of motor outputs, gyros, ESCs and bursts, as `motor_tables` takes them: these instead of RATE.
    gains : mapping of str to LoopGains, optional
        By axis: adds the parameters of the loops, PID messages, and height and vibration of a hover.
    """
    first = next(iter(axes.values()))
    rows = slice(None, None, max(round(LOOP_HZ / rate), 1))
    if motors is not None:
        parameters = dict(LINEAR) | dict(parameters or {})
    t = first.t[rows] + _BOOT
    zero = np.zeros(len(t))
    columns = {}
    for name, letter in _LETTERS.items():
        run = axes.get(name)
        scale = 1.0 if name == "vertical" else np.degrees(1.0)
        columns[f"{letter}Des"] = zero if run is None else scale * run.asked[rows]
        columns[letter] = zero if run is None else scale * run.measured[rows]
        columns[f"{letter}Out"] = zero if run is None else run.output[rows] + (0.35 if name == "vertical" else 0.0)
    flown = _loop_parameters(gains or {}) | dict(parameters or {})
    tables = [
        _table("MSG", "QZ", "s-", "F-", [1.0], {"Message": ["ArduCopter V4.7.0-dev"]}),
        _parameters({"INS_GYRO_FILTER": filter_hz, "FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0} | flown),
        _modes(axes),
        *(
            [_table("RATE", "Qffffffffffff", "skk-kk-kk-oo-", "F?????????BB-", t, columns)]
            if motors is None
            else motor_tables(axes, _BOOT, **motors)
        ),
        _attitude(axes),
        *_chirps(axes, rows),
        *(_pid(axes[name], one, name, rows) for name, one in (gains or {}).items()),
        *(_hover(first.t) if gains else ()),
    ]
    write_dataflash(path, tables)


def _table(
    name: str, form: str, units: str, multipliers: str, t: object, columns: Mapping[str, object]
) -> MessageTable:
    times = np.rint(np.asarray(t, dtype=np.float64) * 1e6).astype(np.uint64)
    return name, form, units, multipliers, pd.DataFrame({"TimeUS": times, **columns})


def _parameters(values: Mapping[str, float]) -> MessageTable:
    columns = {"Name": list(values), "Value": [float(value) for value in values.values()]}
    return _table("PARM", "QNf", "s--", "F--", np.full(len(values), 1.0), columns)


def _loop_parameters(gains: Mapping[str, LoopGains]) -> dict[str, float]:
    values = {"SCHED_LOOP_RATE": LOOP_HZ} if gains else {}
    for axis, one in gains.items():
        terms = {name: getattr(one, name) for name in ("P", "I", "D", "FF", "FLTT", "FLTE", "FLTD", "IMAX")}
        values |= {f"ATC_RAT_{AXES[axis]}_{name}": float(value) for name, value in terms.items()}
        values[f"ATC_ANG_{AXES[axis]}_P"] = one.angle_P
    return values


def _pid(run: AxisRun, gains: LoopGains, axis: str, rows: slice) -> MessageTable:
    forward = gains.FF * run.target
    terms = {"I": run.integral, "D": run.derivative, "FF": forward}
    proportional = run.feedback - run.integral - run.derivative - forward
    columns = {"Tar": run.target, "Act": run.measured, "P": proportional} | terms
    values = {name: each[rows] for name, each in columns.items()}
    zero = np.zeros(len(run.t[rows]))
    return _table(
        f"PID{_LETTERS[axis]}", "QffffffB", "s-------", "F-------", run.t[rows] + _BOOT, values | {"Flags": zero}
    )


def _hover(t: NDArray[np.float64]) -> list[MessageTable]:
    """Return height and vibration of a craft that rises by 5 m after a twentieth of its time and stays."""
    rows = t[:: round(LOOP_HZ / 10.0)]
    heights = {"Alt": np.clip(rows - 0.05 * t[-1], 0.0, 5.0)}
    shaken = {name: np.full(len(rows), 2.0) for name in ("VibeX", "VibeY", "VibeZ")}
    return [
        _table("BARO", "Qf", "sm", "F0", rows + _BOOT, heights),
        _table("VIBE", "Qfff", "s---", "F---", rows + _BOOT, shaken),
    ]


def _modes(axes: Mapping[str, AxisRun]) -> MessageTable:
    rows = [(_BOOT, _STABILIZE)]
    for run in axes.values():
        if run.excitation.chirp[2]:
            start = _BOOT + run.excitation.chirp_start
            rows += [(start, _SYSTEMID), (start + run.excitation.chirp_seconds, _STABILIZE)]
    rows.sort()
    modes = [mode for _, mode in rows]
    columns = {"Mode": modes, "ModeNum": modes, "Rsn": [1] * len(rows)}
    return _table("MODE", "QMBB", "s---", "F---", [t for t, _ in rows], columns)


def _attitude(axes: Mapping[str, AxisRun]) -> MessageTable:
    """Lay out ATT, 100 rows a second."""
    first = next(iter(axes.values()))
    rows = slice(None, None, round(LOOP_HZ / 100.0))
    zero = np.zeros(len(first.t[rows]))
    columns = {}
    for name in ("roll", "pitch", "yaw"):
        run = axes.get(name)
        columns[f"Des{name.title()}"] = zero if run is None else np.degrees(run.stick[rows])
        columns[name.title()] = zero if run is None else np.degrees(run.attitude[rows])
    return _table("ATT", "Qffffff", "sdddddd", "F------", first.t[rows] + _BOOT, columns)


def _chirps(axes: Mapping[str, AxisRun], rows: slice) -> list[MessageTable]:
    chirped = [run for run in axes.values() if run.excitation.chirp[2]]
    if not chirped:
        return []
    chirped.sort(key=lambda run: run.excitation.chirp_start)
    parts = []
    for run in chirped:
        during = np.isfinite(run.elapsed[rows])
        scale = 1.0 if run.excitation.sid_axis >= 10 else np.degrees(1.0)
        columns = {"Time": run.elapsed[rows][during], "Targ": scale * run.chirp[rows][during]}
        columns |= {"F": run.chirp_hz[rows][during]}
        for axis, name in zip("xyz", ("roll", "pitch", "yaw"), strict=True):
            felt = axes[name].unfiltered[rows][during] if name in axes else np.zeros(int(during.sum()))
            columns[f"G{axis}"] = np.degrees(felt)
        columns |= {f"A{axis}": np.zeros(int(during.sum())) for axis in "xyz"}
        parts.append(pd.DataFrame({"t": run.t[rows][during] + _BOOT + 2e-4} | columns))
    data = pd.concat(parts)
    settings = {
        "Ax": [run.excitation.sid_axis for run in chirped],
        "Mag": [run.excitation.chirp[2] for run in chirped],
        "FSt": [run.excitation.chirp[0] for run in chirped],
        "FSp": [run.excitation.chirp[1] for run in chirped],
        "TFin": [1.0] * len(chirped),
        "TC": [2.0 / run.excitation.chirp[0] for run in chirped],
        "TR": [run.excitation.chirp_seconds for run in chirped],
        "TFout": [1.0] * len(chirped),
    }
    starts = [_BOOT + run.excitation.chirp_start for run in chirped]
    values = {name: data[name].to_numpy() for name in data.columns if name != "t"}
    return [
        _table("SIDS", "QBfffffff", "s--ssssss", "F--------", starts, settings),
        _table("SIDD", "Qfffffffff", "ss-zkkkooo", "F---------", data["t"], values),
    ]
