"""One record of inputs and outputs on a uniform clock: the argument of every estimator and every validation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from core.lazy import lazy
from core.summary import Summarised, listed
from logparse import Finding, RotoridError, Vehicle
from sysid.records import MIN_SAMPLES as MIN_SAMPLES
from sysid.records import Floats as Floats
from sysid.records.context import angles_of
from sysid.records.flight_record import record_flight
from sysid.records.resampling import FASTER
from sysid.records.resampling import resample as resample_columns

if TYPE_CHECKING:
    from estimation import Trajectory
    from logparse import FlightLog
    from logparse.foreign import motion as foreign_motion
else:
    foreign_motion = lazy("logparse.foreign.motion")


class ExperimentError(RotoridError):
    """Records that cannot be used for identification: not uniform, not finite, too short, or not alike."""


class ModelOrderError(RotoridError, ValueError):
    """Poles, zeros, delays or a structure that no model can have."""


def horizon_steps(horizon: float, dt: float) -> int:
    """Return a prediction horizon in samples, at least one."""
    if not (np.isfinite(horizon) and horizon > 0.0):
        raise ExperimentError(f"the prediction horizon must be a positive number of seconds, not {horizon:g}")
    return max(round(horizon / dt), 1)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Experiment(Summarised):
    """Inputs and outputs of one flight, or one part of it, sampled uniformly."""

    name: str  #: Which flight, and which part of it.
    t: Floats  #: shape (N,): Seconds on the log's boot clock, uniform.
    u: Floats  #: shape (N, m): Inputs, such as PWM in us.
    y: Floats  #: shape (N, p): Outputs, such as metres north, east and up of the flight's first airborne sample.
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    #: Unit of each input and output by name; absent where unknown.
    units: Mapping[str, str] = field(default_factory=dict)
    #: shape (m,): Input about which linear models work; the record's own mean unless given. Inputs are known in advance
    #: in every simulation, but their mean over a flight from rest to rest says what hovering takes in its air, and a
    #: free run of the height stands and falls with it (docs/transfer-functions.md).
    input_trim: Floats
    output_trim: Floats  #: shape (p,): Output from which linear models count; the record's first sample unless given.
    #: What physical models also read, on the same `t`: ``roll pitch yaw`` [rad], ``w_x w_y w_z`` [rad/s], ``f_x f_y
    #: f_z`` [m/s^2, specific force, FRD], ``v_n v_e v_d`` [m/s], ``density`` [kg/m^3] and ``voltage`` [V]; a column is
    #: NaN where the log does not tell.
    context: pd.DataFrame | None = None
    vehicle: Vehicle | None = None
    findings: tuple[Finding, ...] = ()  #: What resampling had to say.
    #: From which it was cut, where it was cut by ``log.experiment``: what needs more than the record holds, such as a
    #: frequency response at the full rate, reads this stretch of it.
    log: FlightLog | None = field(default=None, compare=False)
    #: The part of the same flight before this one, where `split` parted them: a model fitted to it knows the flight's
    #: wind from there.
    before: Experiment | None = field(default=None, compare=False)

    def __reduce__(self) -> tuple[object, ...]:
        """Leave the log behind, which is an open file that no other process has, and the part before."""
        kept = {
            attribute.name: getattr(self, attribute.name)
            for attribute in fields(self)
            if attribute.name not in ("log", "before")
        }
        return partial(Experiment, **kept), ()

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {
            "name": self.name,
            "time": f"{self.t[0]:.1f} to {self.t[-1]:.1f} s, {len(self.t)} samples at {self.rate:.4g} Hz",
            "inputs": listed(self.input_names, 8),
            "outputs": listed(self.output_names, 8),
            "context": "none" if self.context is None else listed(list(self.context.columns), 8),
            "findings": listed(dict.fromkeys(finding.id for finding in self.findings)) or "none",
        }

    @classmethod
    def from_arrays(
        cls,
        t: ArrayLike,
        u: ArrayLike,
        y: ArrayLike,
        *,
        name: str = "record",
        input_names: Sequence[str] | None = None,
        output_names: Sequence[str] | None = None,
        units: Mapping[str, str] | None = None,
        input_trim: ArrayLike | None = None,
        output_trim: ArrayLike | None = None,
        context: pd.DataFrame | None = None,
        vehicle: Vehicle | None = None,
        findings: tuple[Finding, ...] = (),
    ) -> Experiment:
        """Make a record of data from anywhere.

        Parameters
        ----------
        t : array_like, shape (N,)
            Seconds, uniform to 1 % of the step.
        u : array_like, shape (N, m) or (N,)
        y : array_like, shape (N, p) or (N,)
        name, input_names, output_names, units, input_trim, output_trim, context, vehicle, findings
            As the attributes; names default to ``u1 ...`` and ``y1 ...``.

        Raises
        ------
        ExperimentError
            When shapes disagree, values are not finite, or time is not uniform.
        """
        time = np.ascontiguousarray(t, dtype=np.float64)
        inputs = _columns(u)
        outputs = _columns(y)
        if time.ndim != 1:
            raise ExperimentError(f"{name}: t must have one dimension, not {time.ndim}")
        if inputs.shape[0] != len(time) or outputs.shape[0] != len(time):
            raise ExperimentError(
                f"{name}: t has {len(time)} samples, u {inputs.shape[0]} and y {outputs.shape[0]}; they must agree"
            )
        if len(time) < MIN_SAMPLES:
            raise ExperimentError(f"{name}: {time.size} samples; a record needs at least {MIN_SAMPLES}")
        names_u = tuple(input_names or (f"u{k + 1}" for k in range(inputs.shape[1])))
        names_y = tuple(output_names or (f"y{k + 1}" for k in range(outputs.shape[1])))
        if len(names_u) != inputs.shape[1] or len(names_y) != outputs.shape[1]:
            raise ExperimentError(
                f"{name}: {len(names_u)} input names for {inputs.shape[1]} inputs, "
                f"{len(names_y)} output names for {outputs.shape[1]} outputs"
            )
        if not np.isfinite(time).all():
            raise ExperimentError(f"{name}: time has values that are not finite")
        for kind, names, values in (("input", names_u, inputs), ("output", names_y, outputs)):
            for column, label in enumerate(names):
                bad = int(np.count_nonzero(~np.isfinite(values[:, column])))
                if bad:
                    raise ExperimentError(f"{name}: {kind} {label} has {bad} of {len(time)} values that are not finite")
        step = np.diff(time)
        dt = (time[-1] - time[0]) / (len(time) - 1)
        if dt <= 0.0 or np.max(np.abs(step - dt)) > 0.01 * dt:
            raise ExperimentError(
                f"{name}: time is not uniform (steps {step.min():.4g} to {step.max():.4g} s); resample"
            )
        return cls(
            name=name,
            t=time,
            u=inputs,
            y=outputs,
            input_names=names_u,
            output_names=names_y,
            units=dict(units or {}),
            input_trim=inputs.mean(axis=0) if input_trim is None else np.asarray(input_trim, dtype=np.float64),
            output_trim=outputs[0].copy() if output_trim is None else np.asarray(output_trim, dtype=np.float64),
            context=context,
            vehicle=vehicle,
            findings=findings,
        )

    @classmethod
    def from_flight(
        cls,
        log: FlightLog,
        trajectory: Trajectory,
        rate: float = 10.0,
        inputs: str = "motors",
        outputs: str = "position",
        frame: str = "earth",
        *,
        name: str | None = None,
        beside: Iterable[Experiment] = (),
        within: tuple[float, float] | None = None,
    ) -> Experiment:
        """Cut the longest usable piece of a log's longest flight and bring it to one clock.

        Parameters
        ----------
        log : FlightLog
        trajectory : Trajectory
            Of the same log.
        rate : float
            Samples per second. What was logged faster is low-pass filtered first (zero phase).
        inputs : {"motors", "rotor_speeds", "mixer", "rate_outputs", "reference", "velocity_reference"}
            See `sysid.records.inputs`: PWM in us by motor number, ``m1 ...``, or rad/s as ESCs report it; the mixer's
            commands ``thrust roll pitch yaw`` that the motors' outputs amount to; ``roll pitch yaw throttle`` of the
            rate controller; position or velocity asked for by the position controller.
        outputs : {"position", "velocity"}
            ``x y z``: metres north, east and up of the piece's first sample (axes of Elhesasy 2024); or
            ``v_x v_y v_z``, m/s.
        frame : {"earth", "heading"}
            With ``"heading"`` a craft that turns keeps one linear model: commands of roll and pitch are turned into the
            earth frame by the measured yaw; with motors as inputs the motion is turned into the heading instead. See
            `sysid.records.inputs`.
        name : str, optional
            Defaults to the file's name.
        beside : iterable of Experiment
            Others of the same log and trajectory: one with the same clock shares its context.
        within : tuple of float, optional
            First and last time to use, s; default the whole flight.

        Raises
        ------
        MissingDataError
            Without these inputs, without a flight, or when the trajectory does not cover it.
        """
        contexts = [experiment.context for experiment in beside]
        make = cls.from_arrays
        return record_flight(make, log, trajectory, rate, inputs, outputs, frame, name, contexts, within)

    @classmethod
    def from_table(
        cls,
        source: str | Path | pd.DataFrame,
        columns: Mapping[str, Any] | str | Path,
        *,
        name: str | None = None,
    ) -> Experiment:
        """Read a table of other origin: motion capture, a recorder, a published benchmark.

        Parameters
        ----------
        source : str, Path or DataFrame
            CSV (also compressed), Parquet or MATLAB file, or a table in memory.
        columns : mapping, str or Path
            Which column is what, in which unit and frame: a mapping, or a YAML file with it (docs/tables.md).
        name : str, optional
            Defaults to that of the description, then of the file.

        Returns
        -------
        Experiment
            Inputs ``m1 ...`` (rad/s, us or 0..1) and further inputs by name; outputs x, y, z, m north, east and up of
            the first sample; context with velocity, attitude and rates.

        Raises
        ------
        TableError
            When columns are missing or contradict each other; the text names them, with the evidence.
        """
        return cls.from_motion(foreign_motion.read_motion(source, columns, name))

    @classmethod
    def from_motion(cls, motion: foreign_motion.MotionTable) -> Experiment:
        """Make a record of a table that is read already; see `from_table`."""
        motors = tuple(f"m{motor.number}" for motor in motion.vehicle.motors)
        unknown = np.full(len(motion.t), np.nan)
        context = {
            **angles_of(motion.quaternion),
            **{f"w_{axis}": motion.rates[:, k] for k, axis in enumerate("xyz")},
            **{f"v_{axis}": motion.velocity[:, k] for k, axis in enumerate("ned")},
            **{f"q_{part}": motion.quaternion[:, k] for k, part in enumerate("wxyz")},
            "voltage": unknown if motion.voltage is None else motion.voltage,
            "density": unknown,
        }
        return cls.from_arrays(
            motion.t,
            np.column_stack([motion.motors, motion.inputs]),
            (motion.position - motion.position[0]) * np.array([1.0, 1.0, -1.0]),
            name=motion.name,
            input_names=(*motors, *motion.input_names),
            output_names=("x", "y", "z"),
            units={**dict.fromkeys(motors, motion.motor_unit), **dict.fromkeys("xyz", "m")},
            context=pd.DataFrame(context, index=pd.Index(motion.t, name="t")),
            vehicle=motion.vehicle,
            findings=motion.findings,
        )

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    @property
    def rate(self) -> float:
        """Samples per second."""
        return 1.0 / self.dt

    @property
    def duration(self) -> float:
        """Length of the record, s."""
        return float(self.t[-1] - self.t[0])

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.t)

    def __getitem__(self, samples: slice) -> Experiment:
        """Cut samples by number, such as ``record[100:200]``, into a record of their own."""
        if not isinstance(samples, slice) or samples.step not in (None, 1):
            raise ExperimentError(f"{self.name}: cut samples as record[first:last]; for another rate use resample")
        return self._cut(samples)

    def window(self, t0: float, t1: float) -> Experiment:
        """Cut the samples with t0 <= t < t1 into a record of their own, with trims of its own."""
        return self._cut(slice(int(np.searchsorted(self.t, t0)), int(np.searchsorted(self.t, t1))))

    def split(self, fraction: float) -> tuple[Experiment, Experiment]:
        """Divide into the first `fraction` of the time and the rest, each with trims of its own."""
        if not 0.0 < fraction < 1.0:
            raise ValueError(f"fraction must be between 0 and 1, not {fraction}")
        at = round(fraction * len(self.t))
        first = self._cut(slice(0, at))
        return first, replace(self._cut(slice(at, len(self.t))), before=first)

    def resample(self, rate: float) -> Experiment:
        """Resample the record, with a zero-phase low-pass to a lower rate.

        Parameters
        ----------
        rate : float
            Samples per second.

        Raises
        ------
        ExperimentError
            The rate is not positive, or leaves too few samples.
        """
        return self._resampled(rate)

    def _resampled(self, rate: float, later: float = 0.0) -> Experiment:
        """Resample, with inputs as they are so many seconds after each new sample."""
        if not rate > 0.0:
            raise ExperimentError(f"{self.name}: a rate of {rate:g} Hz; choose more than 0")
        t = self.t[0] + np.arange(int(self.duration * rate * (1.0 + 1e-9)) + 1) / rate
        if len(t) < MIN_SAMPLES:
            raise ExperimentError(f"{self.name}: {rate:g} Hz leave {len(t)} samples; a record needs {MIN_SAMPLES}")
        context = self.context
        if context is not None:
            values = resample_columns(self.t, context.to_numpy(np.float64), t)
            context = pd.DataFrame(values, index=pd.Index(t, name=context.index.name), columns=context.columns)
        u = resample_columns(self.t, self.u, np.minimum(t + later, self.t[-1]) if later else t)
        return replace(self, t=t, u=u, y=resample_columns(self.t, self.y, t), context=context)

    def at_most(self, rate: float) -> Experiment:
        """Return the record itself, or resampled where it has clearly more samples per second than `rate`.

        Inputs are held from one sample to the next: those of the new record are taken in the middle of what each of its
        intervals spans, so that a delay stays what it was.
        """
        if not self.rate > FASTER * rate:
            return self
        return self._resampled(rate, later=0.5 * (1.0 / rate - 1.0 / self.rate))

    def select(self, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None) -> Experiment:
        """Keep some of the inputs and outputs, in the order given; all of them where nothing is given.

        Raises
        ------
        ExperimentError
            When the record has none of that name.
        """
        columns_u = self._columns(self.input_names, inputs, "input")
        columns_y = self._columns(self.output_names, outputs, "output")
        return replace(
            self,
            u=self.u[:, columns_u],
            y=self.y[:, columns_y],
            input_names=tuple(self.input_names[k] for k in columns_u),
            output_names=tuple(self.output_names[k] for k in columns_y),
            input_trim=self.input_trim[columns_u],
            output_trim=self.output_trim[columns_y],
        )

    def _columns(self, names: Sequence[str], wanted: Sequence[str] | None, kind: str) -> list[int]:
        if wanted is None:
            return list(range(len(names)))
        unknown = [name for name in wanted if name not in names]
        if unknown or not wanted:
            raise ExperimentError(
                f"{self.name} has no {kind} {', '.join(unknown)}; its {kind}s are {', '.join(names)}"
                if unknown
                else f"{self.name}: no {kind} is selected"
            )
        return [list(names).index(name) for name in wanted]

    def _cut(self, rows: slice) -> Experiment:
        t = self.t[rows]
        if len(t) < MIN_SAMPLES:
            raise ExperimentError(f"{self.name}: a window of {len(t)} samples; a record needs at least {MIN_SAMPLES}")
        return replace(
            self,
            name=f"{self.name} [{t[0]:z.1f}-{t[-1]:.1f} s]",
            t=t,
            u=self.u[rows],
            y=self.y[rows],
            input_trim=self.u[rows].mean(axis=0),
            output_trim=self.y[rows][0].copy(),
            context=None if self.context is None else self.context.iloc[rows],
            before=None,
        )


def require_alike(experiments: Experiment | Sequence[Experiment]) -> tuple[Experiment, ...]:
    """Check that records can be fitted jointly: same inputs, outputs and rate. One record counts as a list of one."""
    records = (experiments,) if isinstance(experiments, Experiment) else tuple(experiments)
    if not records:
        raise ExperimentError("no experiments given")
    first = records[0]
    for record in records[1:]:
        if record.input_names != first.input_names or record.output_names != first.output_names:
            raise ExperimentError(
                f"{record.name} has inputs {', '.join(record.input_names)} and outputs "
                f"{', '.join(record.output_names)}, {first.name} has {', '.join(first.input_names)} and "
                f"{', '.join(first.output_names)}; only records of one kind can be fitted jointly"
            )
        if abs(record.dt - first.dt) > 1e-3 * first.dt:
            raise ExperimentError(
                f"{record.name} is sampled at {record.rate:.4g} Hz, {first.name} at {first.rate:.4g} Hz; "
                "resample to one rate"
            )
    return records


def require_signals(experiment: Experiment, input_names: Sequence[str], output_names: Sequence[str]) -> None:
    """Check that a record has the inputs and outputs of a model, in its order."""
    if experiment.input_names != tuple(input_names) or experiment.output_names != tuple(output_names):
        raise ExperimentError(
            f"{experiment.name} has inputs {', '.join(experiment.input_names)} and outputs "
            f"{', '.join(experiment.output_names)}; the model takes {', '.join(input_names)} and gives "
            f"{', '.join(output_names)}"
        )


def _columns(values: ArrayLike) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or array.shape[1] == 0:
        raise ExperimentError(f"expected samples in rows and signals in columns, got shape {array.shape}")
    return np.ascontiguousarray(array)
