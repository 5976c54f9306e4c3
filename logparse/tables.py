"""The canonical tables of a log: one meaning, one unit and one frame per column, whatever the firmware's age.

All tables are pandas DataFrames indexed by ``t``, seconds on the boot clock of the log (float64, strictly
increasing). SI units and radians; world frame NED (north, east, down), body frame FRD (forward, right, down).
A value that was not logged or cannot be is NaN. A table that the log does not have is None.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from core.summary import Summarised, listed

#: Columns of each canonical table with their unit and meaning. Tables named here have exactly these columns,
#: except `motors` and `esc`, which have one column (or one of each kind) per motor.
COLUMNS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "motors": {"m{k}": "us; PWM of motor k of the autopilot's frame, by motor number, not by output channel"},
        "imu": {
            "gyro_x": "rad/s; angular rate about body x (forward)",
            "gyro_y": "rad/s; about body y (right)",
            "gyro_z": "rad/s; about body z (down)",
            "accel_x": "m/s^2; specific force along body x",
            "accel_y": "m/s^2; along body y",
            "accel_z": "m/s^2; along body z (near -9.8 at rest)",
        },
        "gps": {
            "t_valid": "s; time at which the sample was true: write time less the receiver's lag",
            "lat": "rad; geodetic latitude, WGS84",
            "lon": "rad; longitude, WGS84",
            "alt": "m; altitude above mean sea level",
            "v_n": "m/s; velocity north",
            "v_e": "m/s; velocity east",
            "v_d": "m/s; velocity down; NaN where the receiver does not give it",
            "fix": "1; 0/1 none, 2 two-dimensional, 3 three-dimensional, 4 differential, 5 float, 6 fixed RTK",
            "satellites": "1; satellites used",
            "hdop": "1; horizontal dilution of precision",
            "h_acc": "m; reported 1-sigma horizontal position accuracy",
            "v_acc": "m; reported 1-sigma vertical position accuracy",
            "s_acc": "m/s; reported 1-sigma speed accuracy",
        },
        "baro": {
            "alt": "m; pressure altitude, up, relative to the autopilot's ground calibration",
            "pressure": "Pa; static pressure",
            "temperature": "K; sensor temperature",
        },
        "mag": {
            "mag_x": "T; field along body x, with the autopilot's calibration applied",
            "mag_y": "T; along body y",
            "mag_z": "T; along body z",
        },
        "battery": {"voltage": "V; at the power module", "current": "A; drawn"},
        "esc": {
            "w{k}": "rad/s; rotor speed of motor k as its ESC reports it",
            "voltage{k}": "V; at the ESC",
            "current{k}": "A; through the ESC",
        },
        "attitude": {
            "roll": "rad; autopilot's estimate",
            "pitch": "rad; autopilot's estimate",
            "yaw": "rad; autopilot's estimate, 0 north, clockwise from above",
        },
        "setpoints": {
            "p_n": "m; position target north of the autopilot's origin",
            "p_e": "m; position target east",
            "p_d": "m; position target down",
            "v_n": "m/s; velocity target north",
            "v_e": "m/s; velocity target east",
            "v_d": "m/s; velocity target down",
            "v_n_ref": "m/s; velocity asked for north, before the position controller adds its correction",
            "v_e_ref": "m/s; velocity asked for east",
            "v_d_ref": "m/s; velocity asked for down",
            "roll": "rad; attitude target",
            "pitch": "rad; attitude target",
            "yaw": "rad; attitude target",
            "throttle": "1; throttle output of the altitude controller, 0..1",
        },
        "rates": {
            "w_x_ref": "rad/s; rate target about body x",
            "w_y_ref": "rad/s; about body y",
            "w_z_ref": "rad/s; about body z",
            "w_x": "rad/s; rate as the controller saw it",
            "w_y": "rad/s",
            "w_z": "rad/s",
            "out_roll": "1; roll output to the mixer, -1..1",
            "out_pitch": "1; pitch output to the mixer, -1..1",
            "out_yaw": "1; yaw output to the mixer, -1..1",
            "out_thrust": "1; thrust output to the mixer, 0..1",
            "a_up": "m/s^2; vertical acceleration as the height controller saw it, up",
            "a_up_ref": "m/s^2; its target",
        },
        "systemid": {
            "axis": "1; what the chirp was added to, as SID_AXIS numbers it (10-13: mixer roll, pitch, yaw, thrust)",
            "target": "chirp as added, in the unit of the axis (mixer: -1..1, angles: deg, rates: deg/s)",
            "elapsed": "s; since the chirp began",
            "planned": "s; how long it was announced to last; NaN where the log does not tell",
            "frequency": "rad/s; of the chirp now; NaN where the log does not tell (PX4's autotuning)",
            "w_x": "rad/s; angular rate about body x",
            "w_y": "rad/s",
            "w_z": "rad/s",
            "f_x": "m/s^2; specific force along body x",
            "f_y": "m/s^2",
            "f_z": "m/s^2",
        },
        "ekf": {
            "p_n": "m; the autopilot's own estimate, north of its origin",
            "p_e": "m",
            "p_d": "m",
            "v_n": "m/s",
            "v_e": "m/s",
            "v_d": "m/s",
            "roll": "rad",
            "pitch": "rad",
            "yaw": "rad",
        },
        "truth": {
            "p_n": "m; simulator's truth, north of its origin",
            "p_e": "m",
            "p_d": "m",
            "v_n": "m/s",
            "v_e": "m/s",
            "v_d": "m/s",
            "q_w": "1; body-to-NED quaternion, scalar first",
            "q_x": "1",
            "q_y": "1",
            "q_z": "1",
        },
        "rangefinder": {"distance": "m; measured distance along the sensor's axis, down where mounted so"},
        "modes": {"mode": "name of the flight mode from this time on"},
        "events": {
            "event": "name: ARMED, DISARMED, TAKEOFF, LAND, ERROR ...",
            "detail": "text or number as logged",
        },
    }
)


def framed(columns: Iterable["pd.Series[float]"]) -> pd.DataFrame | None:
    """Make a table of columns that share their index, without copies; None without a column."""
    found = {str(column.name): column for column in columns}
    return pd.DataFrame(found, copy=False) if found else None


@dataclass(frozen=True, slots=True)
class Geodetic:
    """A place on WGS84: latitude and longitude in radians, altitude above mean sea level in metres."""

    lat: float
    lon: float
    alt: float


#: A table and those of the other instances of its sensor.
Built = tuple[pd.DataFrame | None, tuple[pd.DataFrame, ...]]


@dataclass(frozen=True, slots=True)
class LongTable:
    """How to build a table of which an hour at 400 Hz is 1.4 million rows: several times the log, beside its messages.

    `columns` yields wanted columns one by one, without the table.
    """

    build: Callable[[], Built]
    columns: Callable[[Collection[str]], Iterator["pd.Series[float]"]] | None = None

    def changed(self, change: Callable[[pd.DataFrame], pd.DataFrame]) -> "LongTable":
        """Return the table as `change` leaves it, which must do to a column alone what it does to it among others."""
        columns = self.columns

        def build() -> Built:
            table, others = self.build()
            return None if table is None else change(table), others

        def one_by_one(wanted: Collection[str]) -> Iterator["pd.Series[float]"]:
            assert columns is not None
            return (change(each.to_frame())[each.name] for each in columns(wanted))

        return LongTable(build, None if columns is None else one_by_one)


class _LongTables:
    """Slots of `Tables` for the long ones, which are built when they are asked for: their own slots stay empty."""

    __slots__ = ("_built", "_long", "_others")
    _long: Mapping[str, LongTable]
    _built: dict[str, Built]  # The one asked for last, until another is: two are as large as the log.
    _others: Mapping[str, tuple[pd.DataFrame, ...]]

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Build what stands in an empty slot."""
            if name == "_long":
                return {}
            if name == "further":
                others = self._build("imu")[1]
                return {**self._others, "imu": others} if others else self._others
            if name not in self._long:
                raise AttributeError(f"tables have no {name}")
            return self._build(name)[0]

    def _build(self, name: str) -> Built:
        if name not in self._built:
            self._built.clear()
            table, others = self._long[name].build()
            self._built[name] = (table if table is not None and len(table) else None), others
        return self._built[name]


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Tables(_LongTables, Summarised):
    """The canonical tables of one log (see `COLUMNS`) and the parameters that say how they were sensed.

    `imu`, `gps`, `baro` and `mag` hold the first healthy instance of their sensor; the other instances are in
    `further`, by table name. Bursts of the batch sampler are in `further` too, as ``"gyro_batch"`` and
    ``"accel_batch"`` (columns `gyro_x` ... and `batch`, which counts the bursts), one table for each instance.
    """

    motors: pd.DataFrame | None = None
    imu: pd.DataFrame | None = None
    gps: pd.DataFrame | None = None
    baro: pd.DataFrame | None = None
    mag: pd.DataFrame | None = None
    battery: pd.DataFrame | None = None
    esc: pd.DataFrame | None = None
    attitude: pd.DataFrame | None = None
    setpoints: pd.DataFrame | None = None
    rates: pd.DataFrame | None = None
    systemid: pd.DataFrame | None = None
    ekf: pd.DataFrame | None = None
    truth: pd.DataFrame | None = None
    rangefinder: pd.DataFrame | None = None
    modes: pd.DataFrame | None = None
    events: pd.DataFrame | None = None
    further: Mapping[str, tuple[pd.DataFrame, ...]] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    origin: Geodetic | None = None

    def with_long(self, long: Mapping[str, LongTable]) -> "Tables":
        """Return the same tables with long ones in place of some, built when they are first asked for."""
        made = replace(self)
        for name, value in (("_long", long), ("_built", {}), ("_others", self.further)):
            object.__setattr__(made, name, value)
        for name in (*long, *(("further",) if "imu" in long else ())):
            object.__delattr__(made, name)
        return made

    def summary(self) -> dict[str, str]:
        """Return the rows and columns of each table that the log has."""
        found = {each.name: getattr(self, each.name) for each in fields(self)}
        return {
            name: f"{len(table)} rows of {listed(tuple(map(str, table.columns)))}"
            for name, table in found.items()
            if isinstance(table, pd.DataFrame)
        }

    def has(self, name: str) -> bool:
        """Whether the log has a table; a long one need not be built for that."""
        return name in self._long or getattr(self, name) is not None

    def others(self, name: str) -> tuple[pd.DataFrame, ...]:
        """Return the tables of `further` by this name, without building the IMU's, which is long, for another."""
        further = self._others if "imu" in self._long and name != "imu" else self.further
        return further.get(name, ())

    def columns(self, name: str, wanted: Collection[str] | None = None) -> Iterator["pd.Series[float]"]:
        """Yield columns of a table one by one, of a long one no more than one in memory; none without the table.

        Parameters
        ----------
        name : str
            Name of the table.
        wanted : collection of str, optional
            Names of the columns, in the order in which they come; all by default.
        """
        long = self._long.get(name)
        if long is not None and long.columns is not None and name not in self._built:
            yield from long.columns(list(COLUMNS[name]) if wanted is None else wanted)
            return
        table = getattr(self, name)
        if table is not None:
            yield from (table[column] for column in (table.columns if wanted is None else wanted) if column in table)

    def column(self, name: str, column: str) -> "pd.Series[float] | None":
        """Return one column of a table without building the others; None where there is none."""
        return next(self.columns(name, (column,)), None)

    def part(self, name: str, wanted: Collection[str]) -> pd.DataFrame | None:
        """Return a table with no more than the wanted columns; None where it has none of them."""
        return framed(self.columns(name, wanted))

    def times(self, name: str) -> npt.NDArray[np.float64] | None:
        """Return the times of a table's rows, s; None without the table."""
        lean = name in self._long and self._long[name].columns is not None
        found = self.column(name, next(iter(COLUMNS[name]))) if lean else getattr(self, name)
        return None if found is None else found.index.to_numpy(np.float64)

    def release(self, keep: str = "") -> None:
        """Release the long table that is kept, unless it is `keep`: it is built anew when it is asked for again."""
        if self._long and keep not in self._built:
            self._built.clear()
