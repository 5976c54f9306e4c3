"""Canonical tables: one meaning, unit and frame per column, from the messages of any autopilot and age."""

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cached_property, partial

import numpy as np
import pandas as pd

from core.findings import Finding, Severity, info, warning
from core.quantity import counted, joined
from logparse.canonical import actuators, control, events, sensors
from logparse.canonical.batches import BURSTS, bursts
from logparse.canonical.fields import Kind, Messages, Sender, first
from logparse.canonical.remarks import Remarks
from logparse.craft.frames import Vehicle
from logparse.flights import wing_borne, wing_borne_px4
from logparse.kept import Kept
from logparse.tables import Built, Columns, Geodetic, Tables, Times

__all__ = ["gather_tables"]

#: Messages that hold servo outputs.
_OUTPUTS = ("RCOU", "MOT", "SERVO_OUTPUT_RAW", "actuator_outputs")
#: What is measured of rates, whatever carries the craft.
_MEASURED = ("w_x", "w_y", "w_z", "a_up")


def gather_tables(
    messages: Messages,
    *,
    format: str,  # noqa: A002 -- the public argument's name
    parameters: Mapping[str, float],
    vehicle: Vehicle,
    kept: Kept | None = None,
) -> tuple[Tables, Callable[[], tuple[Finding, ...]]]:
    """Return the canonical tables of one boot, which are built when they are asked for and kept in `kept`.

    The function beside them returns what had to be left out or assumed, and builds what is not yet built for it.
    """
    kind = {"ulog": Kind.PX4}.get(format, Kind.DATAFLASH if format.startswith("dataflash") else Kind.TELEMETRY)
    builder = _Builder(Sender(messages) if kind is Kind.TELEMETRY else messages, kind, parameters, vehicle, kept)
    return builder.tables, builder.findings


class _Builder:
    """Builds the tables of one boot, and remembers what had to be left out or assumed for each."""

    def __init__(
        self, messages: Messages, kind: Kind, parameters: Mapping[str, float], vehicle: Vehicle, kept: Kept | None
    ):
        self._messages, self._kind, self._parameters, self._vehicle = messages, kind, parameters, vehicle
        self._remarks: dict[str, Remarks] = {}
        dataflash = kind is Kind.DATAFLASH
        columns: dict[str, Columns] = {}
        times: dict[str, Times] = {}
        if dataflash:
            columns["setpoints"] = partial(control.setpoint_columns, messages, vehicle)
            columns["systemid"] = partial(control.chirp_columns, messages)
        if dataflash and "RATE" in messages:
            columns["rates"], times["rates"] = self._rate_columns, partial(control.rate_times, messages)
        self._recipes: dict[str, Callable[[Remarks], Built | pd.DataFrame | None]] = {
            "imu": lambda remarks: sensors.imu(messages, kind, remarks),
            "gps": lambda remarks: sensors.gps(messages, kind, parameters, vehicle, remarks),
            "baro": lambda remarks: sensors.baro(messages, kind, parameters, remarks),
            "mag": lambda remarks: sensors.mag(messages, kind, parameters, remarks),
            "battery": lambda remarks: sensors.battery(messages, kind, remarks),
            "motors": lambda remarks: actuators.motors(messages, kind, parameters, vehicle, remarks),
            "esc": lambda _: actuators.esc(messages, kind, vehicle.motors),
            "attitude": lambda _: control.attitude(messages, kind),
            "setpoints": lambda _: control.setpoints(messages, kind, self._place, self.tables.attitude),
            "rates": lambda _: control.rates(messages, kind),
            "systemid": lambda _: control.autotune(messages) if kind is Kind.PX4 else None,
            "ekf": lambda _: self._estimate(),
            "truth": lambda _: control.truth(messages) if dataflash else None,
            "rangefinder": lambda remarks: sensors.rangefinder(messages, kind, remarks),
            "modes": lambda _: events.modes(messages, kind, vehicle.firmware),
            "events": lambda _: events.events(messages, kind),
        }
        self.tables = Tables(
            recipes={name: partial(self._build, name) for name in self._recipes}
            | ({name: partial(_bursts, messages, name) for name in BURSTS} if dataflash else {}),
            columns=columns,
            times=times,
            kept=kept,
            parameters=parameters,
            origin=self._origin,
        )

    def findings(self) -> tuple[Finding, ...]:
        """Return what had to be left out or assumed."""
        together = Remarks()
        for name in self._recipes:
            if name not in self._remarks and name not in ("setpoints", "rates"):  # of which there is nothing to say
                getattr(self.tables, name)
            together.take(self._remarks.setdefault(name, Remarks()))
        together.take(self._wings[1])
        _remark_frame(self._messages, self._vehicle, together)
        return (*together.findings(), *_left_out(getattr(self._messages, "damaged", {})))

    def _build(self, name: str) -> Built:
        remarks = self._remarks[name] = Remarks()
        built = self._recipes[name](remarks)
        table, others = built if isinstance(built, tuple) else (built, ())
        if name in ("motors", "rates") and table is not None and self._wings[0]:
            table = self._hover(table)
        # A table without a row says no more than a missing one.
        return (table if table is not None and len(table) else None), others

    def _rate_columns(self, wanted: Collection[str]) -> Iterator["pd.Series[float]"]:
        columns = control.rate_columns(self._messages, wanted)
        return (self._hover(column.to_frame())[column.name] for column in columns) if self._wings[0] else columns

    def _estimate(self) -> pd.DataFrame | None:
        """Return what the autopilot's filter knew."""
        needed = self._kind is not Kind.DATAFLASH
        attitude, place = (self.tables.attitude, self._place) if needed else (None, None)
        return control.estimate(self._messages, self._kind, self._parameters, attitude, place)

    @cached_property
    def _logged_origin(self) -> Geodetic | None:
        return control.logged_origin(self._messages, self._kind)

    @property
    def _place(self) -> Geodetic | None:
        """Origin of positions in latitude and longitude."""
        if self._logged_origin or first(self._messages, "LOCAL_POSITION_NED", "vehicle_local_position") is not None:
            return self._logged_origin
        return control.origin_of_fixes(self.tables.gps, None)

    def _origin(self) -> Geodetic | None:
        known = self._place if self._kind is Kind.TELEMETRY else self._logged_origin
        return known or control.origin_of_fixes(self.tables.gps, self.tables.ekf)

    @cached_property
    def _wings(self) -> tuple[list[tuple[float, float]], Remarks]:
        """When wings carried a VTOL, and the remark that they did."""
        remarks = Remarks()
        px4, plane = self._kind is Kind.PX4, self._vehicle.firmware == "ArduPlane"
        wings = wing_borne_px4(self._messages.get("vtol_vehicle_status")) if px4 else []
        if not self._vehicle.motors or not (wings or plane):
            return [], remarks
        motors = actuators.motors(self._messages, self._kind, self._parameters, self._vehicle, Remarks())
        if motors is None or not len(motors):
            return [], remarks
        wings = wing_borne(self.tables, motors) if plane else wings
        if wings:
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
        return wings, remarks

    def _hover(self, rows: pd.DataFrame) -> pd.DataFrame:
        """Drop what controllers and motors of a VTOL's hover put out while its wings carried it."""
        t, inside = rows.index.to_numpy(np.float64), np.zeros(len(rows), np.bool_)
        for start, stop in self._wings[0]:
            inside |= (t >= start) & (t <= stop)
        return rows.mask(inside[:, None] & ~rows.columns.isin(_MEASURED))


def _left_out(damaged: Mapping[str, int]) -> Iterator[Finding]:
    """Report the values that were left out as damaged, by message."""
    if names := sorted(name for name, count in damaged.items() if count):
        removed = sum(damaged.values())
        yield info(
            "impossible-values",
            f"{counted(removed, 'value')} of {joined(names)} stood alone, far off the rows beside: taken as missing.",
            removed=removed,
        )


def _bursts(messages: Messages, name: str) -> Built:
    return None, bursts(messages, name)


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
