"""Canonical tables: one meaning, unit and frame per column, from the messages of any autopilot and age."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from core.findings import Finding, Severity, info, warning
from core.quantity import counted, joined
from logparse.canonical import actuators, control, events, sensors
from logparse.canonical.batches import batches
from logparse.canonical.fields import Kind, Messages, Sender, Sensor, first
from logparse.canonical.remarks import Remarks
from logparse.craft.frames import Vehicle
from logparse.flights import wing_borne, wing_borne_px4
from logparse.source import LONG
from logparse.tables import COLUMNS, LongTable, Tables, framed

__all__ = ["TOGETHER", "gather_tables"]

#: DataFlash messages of which there may be a row for every step of the fast loop.
_IMU = ("IMU", "IMU2", "IMU3", "ACC1", "ACC", "GYR1", "GYR")
_RATES = ("RATE", "PIDR", "PIDP", "PIDY")
_TARGETS = ("ATT", "ANG", "PSCN", "PSCE", "PSCD")

#: Messages that `gather_tables` reads wherever they are logged, but for the above and bursts of samples.
TOGETHER = (
    *("RCOU", "RCO2", "RCO3", "GPS", "GPS2", "GPA", "GPA2", "BARO", "BAR2", "BAR3", "MAG", "MAG2", "MAG3"),
    *("BAT", "BAT2", "CURR", "CUR2", "ESC", "RFND", "ATT", "ANG", "CTUN", "PSCN", "PSCE", "PSCD", "XKF1", "XKF4"),
    *("SIM", "SIM2", "SIDD", "SIDS", "ORGN", "MODE", "EV", "ERR"),
)

#: Messages that hold servo outputs.
_OUTPUTS = ("RCOU", "MOT", "SERVO_OUTPUT_RAW", "actuator_outputs")


def gather_tables(
    messages: Messages,
    *,
    format: str,  # noqa: A002 -- the public argument's name
    parameters: Mapping[str, float],
    vehicle: Vehicle,
) -> tuple[Tables, Callable[[], tuple[Finding, ...]]]:
    """Return the canonical tables of one boot, the longest of which are built when they are asked for.

    The function beside them returns what had to be left out or assumed, and builds what is not yet built for it.
    """
    remarks = Remarks()
    said: dict[str, Remarks] = {}  # Of long tables, when they are built.
    kind = {"ulog": Kind.PX4}.get(format, Kind.DATAFLASH if format.startswith("dataflash") else Kind.TELEMETRY)
    damaged: Mapping[str, int] = getattr(messages, "damaged", {})
    messages = Sender(messages) if kind is Kind.TELEMETRY else messages
    long: Mapping[str, LongTable] = _long_tables(messages, vehicle, said) if kind is Kind.DATAFLASH else {}
    tables = _build(messages, kind, parameters, vehicle, remarks, long)
    wings: list[tuple[float, float]] = []
    if vehicle.motors and tables.motors is not None:
        if vehicle.firmware == "ArduPlane":
            wings = wing_borne(tables)
        elif kind is Kind.PX4:
            wings = wing_borne_px4(messages.get("vtol_vehicle_status"))
    if wings:
        tables, long = _without_wings(tables, long, wings, remarks)
    # A table without a row says no more than a missing one.
    empty = {name: None for name in COLUMNS if (table := getattr(tables, name)) is not None and len(table) == 0}
    tables = replace(tables, **empty) if empty else tables  # type: ignore[arg-type]
    if long:
        tables = tables.with_long(long)
    _remark_frame(messages, vehicle, remarks)

    def findings() -> tuple[Finding, ...]:
        if "imu" in long and "imu" not in said:
            tables.imu  # noqa: B018 -- kept for who asks for the table next
        together = Remarks()
        for each in (remarks, *said.values()):
            together.take(each)
        return (*together.findings(), *_left_out(damaged))

    return tables, findings


def _left_out(damaged: Mapping[str, int]) -> Iterator[Finding]:
    """Report the values that were left out as damaged, by message."""
    if removed := sum(damaged.values()):
        yield info(
            "impossible-values",
            f"{counted(removed, 'value')} of {joined(sorted(damaged))} stood alone, far off the rows beside: taken as "
            "missing.",
            removed=removed,
        )


#: What is measured of rates, whatever carries the craft.
_MEASURED = ("w_x", "w_y", "w_z", "a_up")


def _without_wings(
    tables: Tables, long: Mapping[str, LongTable], wings: Sequence[tuple[float, float]], remarks: Remarks
) -> tuple[Tables, Mapping[str, LongTable]]:
    """Drop what controllers and motors of a VTOL's hover put out while its wings carried it."""

    def hover(rows: pd.DataFrame) -> pd.DataFrame:
        t, inside = rows.index.to_numpy(np.float64), np.zeros(len(rows), np.bool_)
        for start, stop in wings:
            inside |= (t >= start) & (t <= stop)
        return rows.mask(inside[:, None] & ~rows.columns.isin(_MEASURED))

    if "rates" in long:
        long = {**long, "rates": long["rates"].changed(hover)}
    motors, measured = tables.motors, tables.rates if "rates" not in long else None
    assert motors is not None  # without them no wing is looked for
    end = float(motors.index[-1])
    seconds = sum(min(stop, end) - min(start, end) for start, stop in wings)
    remarks.add(
        info(
            "wing-borne",
            f"Wings carried the craft for {seconds:.0f} s, from {wings[0][0]:.0f} s on: its motors and their "
            "controllers are looked at in hover only, the fixed wing's are not.",
            seconds=seconds,
        )
    )
    return replace(tables, motors=hover(motors), rates=None if measured is None else hover(measured)), long


def _long_tables(messages: Messages, vehicle: Vehicle, said: dict[str, Remarks]) -> dict[str, LongTable]:
    """Return how to build the tables that are long; `said` gets what building them has to say."""
    counts: Mapping[str, int] = getattr(messages, "counts", {})

    def inertial() -> Sensor:
        said["imu"] = Remarks()
        return sensors.imu(messages, Kind.DATAFLASH, said["imu"])

    found = {}
    if sum(counts.get(name, 0) for name in _IMU) >= LONG:
        found["imu"] = LongTable(inertial)
    if sum(counts.get(name, 0) for name in _RATES) >= LONG:
        columns = partial(control.rate_columns, messages) if "RATE" in messages else None
        found["rates"] = LongTable(lambda: (control.rates(messages, Kind.DATAFLASH), ()), columns)
    if max(counts.get(name, 0) for name in _TARGETS) >= LONG:
        # Targets of all rates on the times of the fastest: three times as many numbers as were logged.
        targets = partial(control.setpoint_columns, messages, vehicle)
        found["setpoints"] = LongTable(lambda: (framed(targets(COLUMNS["setpoints"])), ()), targets)
    return found


def _build(
    messages: Messages,
    kind: Kind,
    parameters: Mapping[str, float],
    vehicle: Vehicle,
    remarks: Remarks,
    long: Mapping[str, LongTable],
) -> Tables:
    """Build all tables that the messages allow, but for long ones."""
    imu: Sensor = (None, ()) if "imu" in long else sensors.imu(messages, kind, remarks)
    found = {
        "imu": imu,
        "gps": sensors.gps(messages, kind, parameters, vehicle, remarks),
        "baro": sensors.baro(messages, kind, parameters, remarks),
        "mag": sensors.mag(messages, kind, parameters, remarks),
        "battery": sensors.battery(messages, kind, remarks),
    }
    gps, _ = found["gps"]
    attitude = control.attitude(messages, kind)
    origin = control.logged_origin(messages, kind)
    if origin is None and first(messages, "LOCAL_POSITION_NED", "vehicle_local_position") is None:
        place = control.origin_of_fixes(gps, None)  # of positions in latitude and longitude
    else:
        place = origin
    ekf = control.estimate(messages, kind, parameters, attitude, place)
    dataflash = kind is Kind.DATAFLASH
    return Tables(
        **{name: table for name, (table, _) in found.items()},
        motors=actuators.motors(messages, kind, parameters, vehicle, remarks),
        esc=actuators.esc(messages, kind, vehicle.motors),
        attitude=attitude,
        setpoints=None if "setpoints" in long else control.setpoints(messages, kind, vehicle, place, attitude),
        rates=None if "rates" in long else control.rates(messages, kind),
        systemid=control.systemid(messages, kind),
        ekf=ekf,
        truth=control.truth(messages) if dataflash else None,
        rangefinder=sensors.rangefinder(messages, kind, remarks),
        modes=events.modes(messages, kind, vehicle.firmware),
        events=events.events(messages, kind),
        further={name: more for name, (_, more) in found.items() if more} | (batches(messages) if dataflash else {}),
        parameters=parameters,
        origin=origin or (place if kind is Kind.TELEMETRY else None) or control.origin_of_fixes(gps, ekf),
    )


def _remark_frame(messages: Messages, vehicle: Vehicle, remarks: Remarks) -> None:
    """Remark what is not known of the frame, and so of the motors."""
    if vehicle.frame_source == "outputs":
        remarks.add(
            warning(
                "frame-unknown",
                "The log does not name the frame's class; outputs 1 to 4 alone drive motors, so that it is "
                f"taken as a {vehicle.frame_class}.",
                "Check the number of motors: firmware before 3.2 does not log its frame class.",
            )
        )
    elif vehicle.frame_source == "MAV_TYPE" and vehicle.frame_type is None and vehicle.motors:
        remarks.add(
            warning(
                "frame-unknown",
                f"The log says {vehicle.frame_class}, but not which type; motors are taken to sit as in an x.",
                "Check the frame: of another type what is said about roll, pitch and single motors is wrong.",
            )
        )
    other_craft = vehicle.other_craft
    if not vehicle.motors and (other_craft or any(name in messages for name in _OUTPUTS)):
        frame = "/".join(part for part in (vehicle.frame_class, vehicle.frame_type) if part)
        remarks.add(
            Finding(
                id="frame-unknown",
                severity=Severity.ERROR,
                reason=f"Servo outputs are logged, but no motor table is known for the frame {frame}."
                if vehicle.frame_class
                else f"The robot is no multirotor ({vehicle.firmware}): its outputs are not taken for motors."
                if other_craft
                else "Servo outputs are logged, but nothing says which of them drive motors (no FRAME_CLASS).",
                advice="Models are fitted to multirotors only; of this log there is the trajectory alone."
                if other_craft
                else "rotorid knows multirotors; their log needs the parameters, which are written when it starts.",
            )
        )
