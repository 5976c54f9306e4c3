"""Tables and experiments of flights as Parquet: hive-partitioned by vehicle and flight, for any query engine.

``tables/TABLE/vehicle=V/flight=F/part.parquet`` holds a canonical table (`logparse.COLUMNS`) or the trajectory, with
time `t` as first column, numbers as float64 and the unit of each column in its metadata;
``experiments/KIND/vehicle=V/flight=F/part.parquet`` what a kind of model is fitted to: inputs ``u_NAME``, outputs
``y_NAME`` and context ``context_NAME``, with all else of the experiment as JSON in the metadata of the schema.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

import sysid
from core.serialization import as_json, from_json
from estimation.trajectory import SIGMA_COLUMNS, STATE_COLUMNS
from logparse import COLUMNS, Finding, Vehicle
from logparse.export import unit
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.span import around
from pipeline.storage.store import Store

#: The names of both datasets, which are folders of the store.
TABLES, EXPERIMENTS = "tables", "experiments"

#: Under which the schema's metadata has what the columns of an experiment do not tell.
_METADATA = b"rotorid"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rest:
    """What the columns of an experiment do not tell of it."""

    name: str
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    units: Mapping[str, str]
    input_trim: tuple[float, ...]
    output_trim: tuple[float, ...]
    vehicle: Vehicle | None
    findings: tuple[Finding, ...]
    context: tuple[str, ...] | None  #: Names of its columns.
    index: str | None  #: Name of its index.


#: Fields that are those of the experiment.
_REST = tuple(field.name for field in fields(_Rest) if field.name not in ("context", "index"))


def part(dataset: str, name: str, vehicle: str, flight: str) -> str:
    """Report where in the store a flight's part of a table lies."""
    return f"{dataset}/{name}/vehicle={vehicle}/flight={flight}/part.parquet"


def partitions(store: Store, vehicle: str, flight: str, below: str = "") -> list[str]:
    """List where in a store both datasets may have parts of a flight; those `below` another folder of the store."""
    names = [(dataset, name) for dataset in (TABLES, EXPERIMENTS) for name in store.names(f"{below}{dataset}")]
    return [str(PurePosixPath(part(*name, vehicle, flight)).parent) for name in names]


def write_tables(result: FlightResult, folder: Path) -> dict[str, Path]:
    """Write ``NAME.parquet`` for each canonical table of a log and for its trajectory; return the files by name.

    Of a log with several flights each has the rows that are nearest to it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = {}
    part, alone = around(present(result.flight), result.log.flights), result.log.flight_count == 1
    for name, whole, units in _frames(result):
        frame = whole if alone else whole[(whole.index >= part.start) & (whole.index < part.stop)]
        if frame.empty:
            continue
        written[name] = folder / f"{name}.parquet"
        _write(frame, units, written[name])
    return written


def _frames(result: FlightResult) -> Iterator[tuple[str, pd.DataFrame, Mapping[str, str]]]:
    for name in COLUMNS:
        frame = getattr(result.tables, name, None)
        if frame is not None and len(frame):
            yield name, frame, {str(column): unit(name, str(column)) for column in frame}
    if not isinstance(result.trajectory, Failure):
        states, sigma = result.trajectory.states, result.trajectory.sigma.add_prefix("sigma_")
        described = {**STATE_COLUMNS, **{f"sigma_{name}": text for name, text in SIGMA_COLUMNS.items()}}
        units = {name: text.partition(";")[0] for name, text in described.items()}
        yield "trajectory", states.join(sigma), units


def _write(frame: pd.DataFrame, units: Mapping[str, str], path: Path) -> None:
    """Write a table whose columns have one type in every log: engines take the types of the first file for all."""
    columns = {"t": pa.array(frame.index.to_numpy(dtype=float))}
    for name in frame.columns:
        column = frame[name]
        if pd.api.types.is_numeric_dtype(column.dtype):
            columns[str(name)] = pa.array(column.to_numpy(dtype=float))
        else:
            columns[str(name)] = pa.array([None if pd.isna(value) else str(value) for value in column], pa.string())
    schema = pa.schema(
        pa.field(name, column.type, metadata={"unit": known} if (known := {"t": "s", **units}.get(name)) else None)
        for name, column in columns.items()
    )
    pq.write_table(pa.table(list(columns.values()), schema=schema), path)


def write_experiments(result: FlightResult, folder: Path) -> dict[str, Path]:
    """Write ``KIND.parquet`` for each experiment of a flight; give the files by kind."""
    folder.mkdir(parents=True, exist_ok=True)
    written = {kind: folder / f"{kind}.parquet" for kind in result.experiments}
    for kind, experiment in result.experiments.items():
        write_experiment(experiment, written[kind])
    return written


def write_experiment(experiment: sysid.Experiment, path: Path) -> None:
    """Write an experiment such that `read_experiment` gives it back, to the last bit."""
    columns = {"t": experiment.t}
    columns |= {f"u_{name}": experiment.u[:, k] for k, name in enumerate(experiment.input_names)}
    columns |= {f"y_{name}": experiment.y[:, k] for k, name in enumerate(experiment.output_names)}
    context = experiment.context
    if context is not None:
        columns |= {f"context_{name}": context[name].to_numpy() for name in context}
    rest = {name: getattr(experiment, name) for name in _REST} | {
        "context": None if context is None else [str(name) for name in context],
        "index": None if context is None else str(context.index.name),
    }
    table = pa.table({name: pa.array(np.ascontiguousarray(column)) for name, column in columns.items()})
    pq.write_table(table.replace_schema_metadata({_METADATA: as_json(rest, None)}), path)


def read_experiment(content: bytes) -> sysid.Experiment:
    """Read what `write_experiment` wrote."""
    table = pq.read_table(pa.BufferReader(content))
    rest = from_json(table.schema.metadata[_METADATA], _Rest)
    t = table["t"].to_numpy()
    context = None
    if rest.context is not None:
        named = {name: table[f"context_{name}"].to_numpy() for name in rest.context}
        context = pd.DataFrame(named, index=pd.Index(t, name=rest.index))
    known = {name: getattr(rest, name) for name in _REST}
    known |= {name: np.array(known[name]) for name in ("input_trim", "output_trim")}
    return sysid.Experiment(
        t=t,
        u=np.column_stack([table[f"u_{name}"].to_numpy() for name in rest.input_names]),
        y=np.column_stack([table[f"y_{name}"].to_numpy() for name in rest.output_names]),
        context=context,
        **known,
    )
