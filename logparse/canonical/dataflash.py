"""Canonical tables of DataFlash logs, binary or text."""

import re
from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd

from core.units import numbers
from logparse.canonical import dataflash_control as control
from logparse.canonical import dataflash_events, dataflash_sensors
from logparse.canonical.batches import batches
from logparse.canonical.dataflash_sensors import Sensor
from logparse.canonical.remarks import Remarks
from logparse.canonical.stray import without_stray, without_stray_rows
from logparse.craft.frames import Vehicle
from logparse.source import LONG
from logparse.tables import Built, LongTable, Tables

#: Messages that the tables of which there may be a row for every step of the fast loop are made of.
_IMU = ("IMU", "IMU2", "IMU3", "ACC1", "ACC", "GYR1", "GYR")
_RATES = ("RATE", "PIDR", "PIDP", "PIDY")

#: Messages that `build` reads wherever they are logged, but for the above and bursts of samples.
TOGETHER = (
    *("RCOU", "RCO2", "RCO3", "GPS", "GPS2", "GPA", "GPA2", "BARO", "BAR2", "BAR3", "MAG", "MAG2", "MAG3"),
    *("BAT", "BAT2", "CURR", "CUR2", "ESC", "RFND", "ATT", "ANG", "CTUN", "PSCN", "PSCE", "PSCD", "XKF1", "XKF4"),
    *("SIM", "SIM2", "SIDD", "SIDS", "ORGN", "MODE", "EV", "ERR"),
)


def long_tables(messages: Mapping[str, pd.DataFrame], said: dict[str, Remarks]) -> dict[str, LongTable]:
    """Return how to build the tables that are long; `said` gets what building them has to say."""
    counts: Mapping[str, int] = getattr(messages, "counts", {})

    def inertial() -> Built:
        said["imu"] = Remarks()
        return _inertial(messages, said["imu"])

    found = {}
    if sum(counts.get(name, 0) for name in _IMU) >= LONG:
        found["imu"] = LongTable(inertial)
    if sum(counts.get(name, 0) for name in _RATES) >= LONG:
        columns = (lambda wanted: control.rate_columns(messages, wanted)) if "RATE" in messages else None
        found["rates"] = LongTable(lambda: (control.rates(messages), ()), columns)
    return found


def build(
    messages: Mapping[str, pd.DataFrame],
    parameters: Mapping[str, float],
    vehicle: Vehicle,
    remarks: Remarks,
    long: Collection[str],
) -> Tables:
    """Build all tables that the messages allow, but for long ones."""
    imu, further_imu = (None, ()) if "imu" in long else _inertial(messages, remarks)
    rates = None if "rates" in long else control.rates(messages)
    gps, further_gps = dataflash_sensors.gps(
        messages, parameters, _old_receiver(messages, parameters, vehicle), remarks
    )
    baro, further_baro = dataflash_sensors.baro(messages, parameters, remarks)
    mag, further_mag = dataflash_sensors.mag(messages, parameters, remarks)
    battery, further_battery = dataflash_sensors.battery(messages, remarks)
    ekf = control.estimate(messages, parameters)
    further = {
        "imu": further_imu,
        "gps": further_gps,
        "baro": further_baro,
        "mag": further_mag,
        "battery": further_battery,
    }
    tables = Tables(
        motors=dataflash_sensors.motors(messages, vehicle.motors, remarks),
        imu=imu,
        gps=gps,
        baro=baro,
        mag=mag,
        battery=battery,
        esc=dataflash_sensors.esc(messages, vehicle.motors),
        attitude=control.attitude(messages),
        setpoints=control.setpoints(messages, vehicle),
        rates=rates,
        systemid=control.systemid(messages),
        ekf=ekf,
        truth=control.truth(messages),
        rangefinder=dataflash_sensors.rangefinder(messages, remarks),
        modes=dataflash_events.modes(messages, vehicle.firmware),
        events=dataflash_events.events(messages),
        further={name: tables for name, tables in further.items() if tables} | batches(messages),
        parameters=parameters,
        origin=control.origin(messages, gps, ekf),
    )
    return without_stray_rows(tables, remarks)


def _inertial(messages: Mapping[str, pd.DataFrame], remarks: Remarks) -> Sensor:
    """IMUs without damaged rows."""
    first, further = dataflash_sensors.imu(messages, remarks)
    return without_stray(first, "imu", remarks), further


def _old_receiver(messages: Mapping[str, pd.DataFrame], parameters: Mapping[str, float], vehicle: Vehicle) -> bool:
    """Whether the GPS receiver is likely of u-blox generation 6 or before.

    Copter 3.5 and later print the receiver's hardware. Before, only a newer one uses two constellations at once and
    so more satellites than GPS alone shows.
    """
    if "MSG" in messages and "Message" in messages["MSG"]:
        for text in messages["MSG"]["Message"]:
            match = re.search(r"u-blox \d HW: (\w{8})", str(text))
            if match:
                return int(match[1], 16) < 0x00070000
    match = re.match(r"(\d+)\.(\d+)", vehicle.version or "")
    recent = "FRAME_CLASS" in parameters if match is None else (int(match[1]), int(match[2])) >= (3, 5)
    if recent or "GPS" not in messages or "NSats" not in messages["GPS"]:
        return not recent
    seen = numbers(messages["GPS"], "NSats")
    return not (seen[np.isfinite(seen)] > 13).any()
