"""What physical models read of a flight besides inputs and outputs: attitude, rates, specific force, air, voltage.

Columns of `Experiment.context`, all on the experiment's `t`:

=====================================  =============================================================================
``roll pitch yaw``                     rad, unwrapped, from the smoothed attitude
``w_x w_y w_z``                        rad/s, angular rate, FRD, bias removed
``f_x f_y f_z``                        m/s^2, specific force, FRD, bias removed
``phi_n phi_e phi_d``                  rad, standard deviation of the attitude's error about north, east and down
``v_n v_e v_d``                        m/s
``height``                             m above the ground of take-off; only where the craft was seen at rest there
``density``                            kg/m^3, NaN where neither pressure nor altitude is known
``voltage``                            V, NaN where not logged
``rate_x rate_y rate_z``               rad/s as the rate controller saw them; only where RATE or its like is logged
``out_roll out_pitch out_yaw``         the rate controller's outputs to the mixer, -1..1; only where logged
``out_thrust``                         0..1; only where logged
``rotor_speed_1 ...``                  rad/s of motor k from its ESC; only where logged
=====================================  =============================================================================
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from core.attitude import euler_from_quat
from logparse import Tables
from sysid.records import Floats
from sysid.records.resampling import NewClock

if TYPE_CHECKING:
    from estimation import Trajectory

#: Columns of the table of rates and their names here.
RATE_COLUMNS = {
    "w_x": "rate_x",
    "w_y": "rate_y",
    "w_z": "rate_z",
    "out_roll": "out_roll",
    "out_pitch": "out_pitch",
    "out_yaw": "out_yaw",
    "out_thrust": "out_thrust",
}

#: International standard atmosphere, sea level.
_PRESSURE_0, _TEMPERATURE_0, _LAPSE, _GAS, _EXPONENT = 101325.0, 288.15, 0.0065, 287.053, 5.25588


def flight_context(trajectory: Trajectory, tables: Tables, t: Floats) -> pd.DataFrame:
    """Resample the inputs of physical models to the clock of an experiment.

    `t` (N,) is uniform, s; columns are those that this module says.
    """
    columns = _motion(trajectory, t)
    columns["density"] = _density(trajectory, tables, t)
    columns["voltage"] = np.full(len(t), np.nan)
    if tables.battery is not None and tables.battery["voltage"].gt(1.0).sum() > 1:
        voltage = tables.battery["voltage"].where(tables.battery["voltage"] > 1.0).to_frame()
        columns["voltage"] = resample_frame(voltage, t)[:, 0]
    clock: NewClock | None = None
    for rate in tables.columns("rates", RATE_COLUMNS):
        if len(rate) < 2:
            break
        if clock is None or not np.array_equal(clock.source_t, rate.index):
            clock = NewClock(rate.index.to_numpy(np.float64), t)
        values = clock.bring(np.asarray(rate, np.float64))
        if np.isfinite(values).all():
            columns[RATE_COLUMNS[str(rate.name)]] = values
    if tables.esc is not None and len(tables.esc) > 1:
        speeds = [str(name) for name in tables.esc.columns if str(name).startswith("w")]
        for name, values in zip(speeds, resample_frame(tables.esc[speeds], t).T, strict=True):
            if np.isfinite(values).all():
                columns[f"rotor_speed_{name[1:]}"] = values
    return pd.DataFrame(columns, index=pd.Index(t, name="t"), copy=False)


def _motion(trajectory: Trajectory, t: Floats) -> dict[str, Floats]:
    """Resample attitude, rates, specific force and velocity of a trajectory, which are released when it returns."""
    states = trajectory.states
    angles = pd.DataFrame(angles_of(states[["q_w", "q_x", "q_y", "q_z"]].to_numpy(np.float64)), index=states.index)
    rest = ["w_x", "w_y", "w_z", "f_x", "f_y", "f_z", "v_n", "v_e", "v_d"]
    source = pd.concat([angles, states[rest], trajectory.sigma[["phi_n", "phi_e", "phi_d"]]], axis=1)
    return dict(zip(map(str, source.columns), resample_frame(source, t).T, strict=True))


def angles_of(quaternions: Floats) -> dict[str, Floats]:
    """Return roll, pitch and yaw [rad], roll and yaw unwrapped, of body-to-NED quaternions, shape (N, 4)."""
    roll, pitch, yaw = euler_from_quat(quaternions).T
    return {"roll": np.unwrap(roll), "pitch": pitch, "yaw": np.unwrap(yaw)}


def shared_context(
    contexts: Iterable[pd.DataFrame | None], trajectory: Trajectory, tables: Tables, t: Floats
) -> pd.DataFrame:
    """Return the context of the same flight with the clock `t` (N,) [s], made if there is none."""
    same = (context for context in contexts if context is not None and np.array_equal(context.index, t))
    shared = next(same, None)
    return flight_context(trajectory, tables, t) if shared is None else shared


def resample_frame(frame: pd.DataFrame, t: Floats) -> Floats:
    """Resample every column of a table indexed by time; shape (N, columns)."""
    clock = NewClock(frame.index.to_numpy(np.float64), t)
    # One by one: the rates of a fast loop are long.
    columns = [clock.bring(frame[name].to_numpy(np.float64)) for name in frame.columns]
    return np.column_stack(columns) if columns else np.empty((len(t), 0))


def air_density(pressure: Floats) -> Floats:
    """Density of the standard atmosphere at a static pressure, kg/m^3.

    The temperature is that of the standard atmosphere at the pressure altitude: barometers report the temperature of
    the board, which is often 20 K above that of the air.
    """
    temperature = _TEMPERATURE_0 * (pressure / _PRESSURE_0) ** (1.0 / _EXPONENT)
    return np.asarray(pressure / (_GAS * temperature))


def standard_density(altitude: Floats) -> Floats:
    """Density of the standard atmosphere at an altitude, kg/m^3."""
    warmth = 1.0 - _LAPSE * altitude / _TEMPERATURE_0
    return np.asarray(_PRESSURE_0 * warmth ** (_EXPONENT - 1.0) / (_GAS * _TEMPERATURE_0))


def has_pressure(tables: Tables) -> bool:
    """Return whether the log has a barometer with pressures."""
    return tables.baro is not None and bool(tables.baro["pressure"].gt(0.0).sum() > 1)


def _has_altitude(tables: Tables) -> bool:
    """Return whether altitudes count from the sea: the log has an origin or a fix."""
    return tables.origin is not None or (tables.gps is not None and bool(tables.gps["alt"].notna().any()))


def _density(trajectory: Trajectory, tables: Tables, t: Floats) -> Floats:
    if tables.baro is not None and has_pressure(tables):
        pressure = tables.baro["pressure"].where(tables.baro["pressure"] > 0.0).to_frame()
        return air_density(resample_frame(pressure, t)[:, 0])
    if _has_altitude(tables):
        return standard_density(trajectory.origin.alt - resample_frame(trajectory.states[["p_d"]], t)[:, 0])
    return np.full(len(t), np.nan)
