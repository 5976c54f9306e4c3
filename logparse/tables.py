"""The canonical tables of a log: one meaning, one unit and one frame per column, whatever the firmware's age.

All tables are pandas DataFrames indexed by ``t``, seconds on the boot clock of the log (float64, strictly
increasing). SI units and radians; world frame NED (north, east, down), body frame FRD (forward, right, down).
A value that was not logged or cannot be is NaN. A table that the log does not have is None.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import pandas as pd

from core.summary import Summarised, listed
from logparse.kept import Kept

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
    named = {str(column.name): column for column in columns}
    return pd.DataFrame(named, copy=False) if named else None


Rows = TypeVar("Rows", pd.DataFrame, "pd.Series[float]")


def between(table: Rows, start: float, stop: float) -> Rows:
    """Return the rows of an ordered table, or of one column, from start to stop [s].

    Looking them up as labels would leave a hash table with the index, four times as large as its times.
    """
    times = table.index.to_numpy()
    return table.iloc[times.searchsorted(start) : times.searchsorted(stop, side="right")]


@dataclass(frozen=True, slots=True)
class Geodetic:
    """A place on WGS84: latitude and longitude in radians, altitude above mean sea level in metres."""

    lat: float
    lon: float
    alt: float


#: A table and those of the other instances of its sensor, and the function that builds them.
Built = tuple[pd.DataFrame | None, tuple[pd.DataFrame, ...]]
Recipe = Callable[[], Built]
#: Function that builds wanted columns one by one.
Columns = Callable[[Collection[str]], Iterator["pd.Series[float]"]]
#: Function that returns the times of a table's rows, s; None where there is no table.
Times = Callable[[], npt.NDArray[np.float64] | None]


class Tables(Summarised):
    """The canonical tables of one log (see `COLUMNS`) as attributes, built when they are first used.

    `imu`, `gps`, `baro` and `mag` hold the first healthy instance of their sensor; the other instances are in
    `further`, by table name. Bursts of the batch sampler are in `further` too, as ``"gyro_batch"`` and
    ``"accel_batch"`` (columns `gyro_x` ... and `batch`, which counts the bursts), one table for each instance.

    Parameters
    ----------
    further : mapping from str to tuple of DataFrame, optional
        Tables of other instances, in place of those that are built.
    parameters : mapping from str to float, optional
        Parameters of the autopilot that say how the tables were sensed.
    origin : Geodetic, optional
        Place of the local frame's origin, or how to find it.
    recipes : mapping, optional
        Functions that build tables that are not given.
    columns : mapping, optional
        Functions that build the columns of tables one by one.
    times : mapping, optional
        Functions that return the times of a table's rows without building a column.
    kept : Kept, optional
        Where built tables are kept as long as there is room.
    **tables : DataFrame or None
    """

    motors: pd.DataFrame | None
    imu: pd.DataFrame | None
    gps: pd.DataFrame | None
    baro: pd.DataFrame | None
    mag: pd.DataFrame | None
    battery: pd.DataFrame | None
    esc: pd.DataFrame | None
    attitude: pd.DataFrame | None
    setpoints: pd.DataFrame | None
    rates: pd.DataFrame | None
    systemid: pd.DataFrame | None
    ekf: pd.DataFrame | None
    truth: pd.DataFrame | None
    rangefinder: pd.DataFrame | None
    modes: pd.DataFrame | None
    events: pd.DataFrame | None

    def __init__(
        self,
        *,
        further: Mapping[str, tuple[pd.DataFrame, ...]] | None = None,
        parameters: Mapping[str, float] | None = None,
        origin: Geodetic | Callable[[], Geodetic | None] | None = None,
        recipes: Mapping[str, Recipe] = MappingProxyType({}),
        columns: Mapping[str, Columns] = MappingProxyType({}),
        times: Mapping[str, Times] = MappingProxyType({}),
        kept: Kept | None = None,
        **tables: pd.DataFrame | None,
    ):
        if unknown := set(tables) - set(COLUMNS):
            raise TypeError(f"there are no tables {listed(sorted(unknown))}")
        self.parameters: Mapping[str, float] = parameters or {}
        self._given, self._given_further, self._origin = tables, further, origin
        self._recipes, self._columns, self._times, self._kept = recipes, columns, times, kept or Kept()

    def __getattr__(self, name: str) -> pd.DataFrame | None:
        if name not in COLUMNS:
            raise AttributeError(f"tables have no {name}")
        return self._given[name] if name in self._given else self._built(name)[0]

    def _built(self, name: str) -> Built:
        if name in self._columns:
            return self._kept.get(name, lambda: (framed(self._one_by_one(name, COLUMNS[name])), ()))
        return self._kept.get(name, self._recipes[name]) if name in self._recipes else (None, ())

    def _one_by_one(self, name: str, wanted: Collection[str]) -> Iterator["pd.Series[float]"]:
        return (column for column in self._columns[name](wanted) if len(column))

    @cached_property
    def origin(self) -> Geodetic | None:
        """Place of the local frame's origin."""
        return self._origin() if callable(self._origin) else self._origin

    @property
    def further(self) -> Mapping[str, tuple[pd.DataFrame, ...]]:
        """Tables of the other instances of sensors, and bursts of the batch sampler, by name."""
        if self._given_further is not None:
            return self._given_further
        return {name: others for name in self._recipes if (others := self.others(name))}

    def others(self, name: str) -> tuple[pd.DataFrame, ...]:
        """Return the tables that `further` has of this name, without building those of other names."""
        return self._built(name)[1] if self._given_further is None else self._given_further.get(name, ())

    def changed(self, **changes: Any) -> "Tables":
        """Return the same tables with some replaced; `changes` as `Tables` takes them."""
        same = {"further": self._given_further, "parameters": self.parameters, "origin": self._origin, **self._given}
        built = {"recipes": self._recipes, "columns": self._columns, "times": self._times, "kept": self._kept}
        return Tables(**(built | same | changes))

    def __reduce__(self) -> tuple[Callable[..., "Tables"], tuple[Mapping[str, object]]]:
        # What builds tables is not sent to another process: all are built before.
        built = {name: getattr(self, name) for name in COLUMNS}
        rest = {"further": self.further, "parameters": self.parameters, "origin": self.origin}
        return _of_parts, (built | rest,)

    def summary(self) -> dict[str, str]:
        """Return the rows and columns of each table that the log has."""
        tables = {name: getattr(self, name) for name in COLUMNS}
        return {
            name: f"{len(table)} rows of {listed(tuple(map(str, table.columns)))}"
            for name, table in tables.items()
            if table is not None
        }

    def has(self, name: str) -> bool:
        """Return whether the log has a table; at most one column is built where columns can be built one by one."""
        return self.times(name) is not None

    def columns(self, name: str, wanted: Collection[str] | None = None) -> Iterator["pd.Series[float]"]:
        """Yield columns of a table, each built without the others where that is possible; none without the table.

        Parameters
        ----------
        name : str
            Name of the table.
        wanted : collection of str, optional
            Names of the columns, in the order in which they come; all by default.
        """
        if name in self._columns and name not in self._given and name not in self._kept:
            yield from self._one_by_one(name, list(COLUMNS[name]) if wanted is None else wanted)
            return
        table = getattr(self, name)
        if table is not None:
            yield from (table[column] for column in (table.columns if wanted is None else wanted) if column in table)

    def column(self, name: str, column: str) -> "pd.Series[float] | None":
        """Return one column of a table without building the others; None where there is none."""
        return next(self.columns(name, (column,)), None)

    def part(self, name: str, wanted: Collection[str]) -> pd.DataFrame | None:
        """Return a table with the wanted columns only; None where it has none of them."""
        return framed(self.columns(name, wanted))

    def times(self, name: str) -> npt.NDArray[np.float64] | None:
        """Return the times of a table's rows, s; None without the table."""
        if name in self._times and name not in self._given and name not in self._kept:
            return self._kept.get(("times", name), self._times[name])
        table = self.column(name, next(iter(COLUMNS[name]))) if name in self._columns else getattr(self, name)
        return None if table is None else table.index.to_numpy(np.float64)


def _of_parts(parts: Mapping[str, Any]) -> Tables:
    return Tables(**parts)
