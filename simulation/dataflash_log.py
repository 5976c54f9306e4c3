"""Write a mission as the DataFlash log that ArduPilot Copter 4.x would have written.

What a simulation without an on-board estimator cannot know (XKF1 and its like) is left out.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from logparse.dataflash.writer import MessageTable, write_dataflash
from simulation._kernels import FLYING, LANDING
from simulation.dataflash_tables import (
    describing_tables,
    motor_table,
    sensor_tables,
    speed_controller_tables,
    table,
    truth_tables,
)
from simulation.instruments import InstrumentedFlight
from simulation.mission import CHIRP_AXES

_STABILIZE, _AUTO, _SYSTEMID = 0, 3, 25
#: EV.Id of ArduPilot (LogEvent).
_EVENT_ARMED, _EVENT_DISARMED, _EVENT_AUTO_ARMED, _EVENT_LANDED, _EVENT_NOT_LANDED = 10, 11, 15, 18, 28


@dataclass(frozen=True, slots=True, kw_only=True)
class Logging:
    """What is logged how often; the rest at ArduPilot's usual 10 Hz."""

    imu: float = 50.0  #: Rows of IMU per second.
    rate: float = 10.0  #: Rows of RATE per second.
    esc: float = 0.0  #: Rows of ESC per second and motor; 0: the speed controllers do not report.


def write_bin(path: Path, log: InstrumentedFlight, logging: Logging = Logging()) -> None:
    """Write the flight as a DataFlash log, truth rows (SIM, SIM2) at 25 Hz.

    Parameters
    ----------
    path : Path
        The log.
    log : InstrumentedFlight
        The flight, with what its instruments said.
    logging : Logging
        How often what is logged.
    """
    tables = [*_descriptive(log), *sensor_tables(log, logging.imu), *_autopilot(log), _rates(log, logging.rate)]
    if logging.esc:
        tables += speed_controller_tables(log, logging.esc)
    write_dataflash(path, [*tables, *_chirps(log), *truth_tables(log)])


def _descriptive(log: InstrumentedFlight) -> list[MessageTable]:
    flight = log.flight
    reference = flight.reference
    events = [
        (reference.arm, _EVENT_ARMED),
        (reference.takeoff, _EVENT_AUTO_ARMED),
        (flight.airborne[0], _EVENT_NOT_LANDED),
        (flight.disarm, _EVENT_LANDED),
        (flight.disarm, _EVENT_DISARMED),
    ]
    # Each chirp is flown in SYSTEMID mode, everything else of the mission in AUTO.
    modes = [(0.0, _STABILIZE, 1), (reference.takeoff, _AUTO, 2)]
    for start, chirp in reference.chirps:
        modes += [(start, _SYSTEMID, 2), (start + chirp.duration, _AUTO, 2)]
    numbers = [mode for _, mode, _ in modes]
    return [
        *describing_tables(log),
        table(
            log,
            "MODE",
            "QMBB",
            "s---",
            "F---",
            [t for t, _, _ in modes],
            {"Mode": numbers, "ModeNum": numbers, "Rsn": [reason for _, _, reason in modes]},
        ),
        table(
            log,
            "ARM",
            "QBIBB",
            "s----",
            "F----",
            [reference.arm, flight.disarm],
            {"ArmState": [1, 0], "ArmChecks": 0, "Forced": 0, "Method": [2, 13]},
        ),
        table(log, "EV", "QB", "s-", "F-", [t for t, _ in events], {"Id": [event for _, event in events]}),
    ]


def _autopilot(log: InstrumentedFlight) -> list[MessageTable]:
    rows = log.rows(10.0)
    flight, place = log.flight, log.flight.setup.place
    gravity = place.gravity
    plan, nav = log.planned(rows), log.navigated(rows)
    active = rows["state"].isin((FLYING, LANDING)).to_numpy()
    degrees = {name: np.degrees(rows[name].to_numpy()) for name in _ANGLES}
    baro_altitude = np.interp(rows.index, log.baro.index, log.pressure_altitude())
    climb = -nav["v_d"].to_numpy()

    tables = [
        table(
            log,
            "ATT",
            "QffffffB",
            "sddddhh-",
            "F000000-",
            rows.index,
            {
                "DesRoll": degrees["roll_ref"],
                "Roll": degrees["roll"],
                "DesPitch": degrees["pitch_ref"],
                "Pitch": degrees["pitch"],
                "DesYaw": degrees["yaw_ref"] % 360.0,
                "Yaw": degrees["yaw"] % 360.0,
                "AEKF": 3,
            },
        ),
        motor_table(log),
        table(
            log,
            "CTUN",
            "Qffffffefffhh",
            "s----mmmmmmnn",
            "F----00B000BB",
            rows.index,
            {
                "ThI": rows["throttle_in"].to_numpy(),
                "ABst": rows["angle_boost"].to_numpy(),
                "ThO": rows["throttle"].to_numpy(),
                "ThH": flight.hover_thrust,
                "DAlt": -plan["p_d"].to_numpy(),
                "Alt": -nav["p_d"].to_numpy(),
                "BAlt": baro_altitude,
                "DSAlt": math.nan,
                "SAlt": 0.0,
                "TAlt": 0.0,
                "DCRt": np.where(active, -rows["v_d_ref"], 0.0),
                "CRt": climb,
            },
        ),
    ]
    for axis in "NED":
        low = axis.lower()
        form, units, multipliers = "Qfffffffff", "smmmnnnooo", "F000000000"
        accel = rows[f"a_{low}"].to_numpy()
        measured = nav[f"p_{low}"].to_numpy()
        position = np.where(active, plan[f"p_{low}"], measured)
        tables.append(
            table(
                log,
                f"PSC{axis}",
                form,
                units,
                multipliers,
                rows.index,
                {
                    f"DP{axis}": position,
                    f"TP{axis}": position,
                    f"P{axis}": measured,
                    f"DV{axis}": np.where(active, plan[f"v_{low}"], 0.0),
                    f"TV{axis}": np.where(active, rows[f"v_{low}_ref"], 0.0),
                    f"V{axis}": nav[f"v_{low}"].to_numpy(),
                    f"DA{axis}": np.where(active, plan[f"a_{low}"], 0.0),
                    f"TA{axis}": np.clip(rows[f"a_{low}_ref"].to_numpy(), -gravity, gravity),
                    f"A{axis}": accel,
                },
            )
        )
    return tables


_ANGLES = ("roll_ref", "pitch_ref", "yaw_ref", "roll", "pitch", "yaw")
_RATES = ("w_x_ref", "w_y_ref", "w_z_ref", "gyro_x", "gyro_y", "gyro_z")


def _rates(log: InstrumentedFlight, rate: float) -> MessageTable:
    """RATE at `rate` [Hz]: the innermost loop and what it puts out."""
    rows = log.rows(rate)
    degrees = {name: np.degrees(rows[name].to_numpy()) for name in _RATES}
    # The autopilot controls on the rate less its estimate of the gyro bias.
    bias = np.degrees(log.sensors.inertial.gyro_bias)
    return table(
        log,
        "RATE",
        "Qfffffffffffff",
        "skk-kk-kk-oo--",
        "F?????????BB--",
        rows.index,
        {
            "RDes": degrees["w_x_ref"],
            "R": degrees["gyro_x"] - bias[0],
            "ROut": rows["out_roll"].to_numpy(),
            "PDes": degrees["w_y_ref"],
            "P": degrees["gyro_y"] - bias[1],
            "POut": rows["out_pitch"].to_numpy(),
            "YDes": degrees["w_z_ref"],
            "Y": degrees["gyro_z"] - bias[2],
            "YOut": rows["out_yaw"].to_numpy(),
            "ADes": -rows["a_d_ref"].to_numpy(),
            "A": -rows["a_d"].to_numpy(),
            "AOut": rows["throttle"].to_numpy(),
            "AOutSlew": 0.0,
        },
    )


def _chirps(log: InstrumentedFlight) -> list[MessageTable]:
    """SIDS and SIDD of SYSTEMID mode: what the chirps were, and what they did, at the rate of the attitude loop."""
    chirps = log.flight.reference.chirps
    if not chirps:
        return []
    first, times = 10, [start for start, _ in chirps]
    settings = {
        "Ax": [first + CHIRP_AXES.index(chirp.axis) for _, chirp in chirps],
        "Mag": [chirp.magnitude for _, chirp in chirps],
        "FSt": [chirp.start_hz for _, chirp in chirps],
        "FSp": [chirp.stop_hz for _, chirp in chirps],
        "TFin": [chirp.fade for _, chirp in chirps],
        "TC": [chirp.hold for _, chirp in chirps],
        "TR": [chirp.duration for _, chirp in chirps],
        "TFout": [chirp.fade for _, chirp in chirps],
    }
    rows = log.rows(1.0 / (2.0 * log.flight.setup.step))
    parts = []
    for start, chirp in chirps:
        during = rows.loc[start : start + chirp.duration]
        t = during.index.to_numpy() - start
        part = {"Time": t, "Targ": chirp.signal(t), "F": chirp.frequency(t)}
        part |= {f"G{axis}": np.degrees(during[f"gyro_{axis}"].to_numpy()) for axis in "xyz"}
        part |= {f"A{axis}": during[f"accel_{axis}"].to_numpy() for axis in "xyz"}
        parts.append(pd.DataFrame(part, index=during.index))
    data = pd.concat(parts)
    return [
        table(log, "SIDS", "QBfffffff", "s--ssssss", "F--------", times, settings),
        table(
            log,
            "SIDD",
            "Qfffffffff",
            "ss-zkkkooo",
            "F---------",
            data.index,
            {name: data[name].to_numpy() for name in data.columns},
        ),
    ]
