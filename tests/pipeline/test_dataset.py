"""What a log held, as Parquet: exact for us, plain for pandas, PyArrow and DuckDB."""

import dataclasses
import shutil

import duckdb
import numpy as np
import pandas as pd
import pyarrow.dataset
import pyarrow.parquet as pq
import pytest

from logparse import Finding, Severity, Tables
from pipeline.storage import dataset
from tests.reports.conftest import made_flight
from tests.timed import timed


@pytest.fixture(scope="module")
def flights():
    """Two flights of a craft; what one log has as text the other has as numbers, and one lacks a table."""
    made = []
    for number, detail in ((1, ["1", "two"]), (2, [3, 4])):
        flight = made_flight(f"0000000{number}", seed=number, fit=False)
        tables = Tables(
            motors=flight.motors,
            gps=flight.gps if number == 1 else None,
            events=pd.DataFrame({"event": ["ARMED", None], "detail": detail}, index=[1.0, 2.0]),
        )
        made.append(dataclasses.replace(flight, tables=tables))
    return made


@pytest.fixture(scope="module")
def folder(flights, tmp_path_factory):
    root = tmp_path_factory.mktemp("out")
    for flight in flights:
        for name, file in dataset.write_tables(flight, root / flight.name).items():
            place = root / dataset.part(dataset.TABLES, name, "quad-1", f"log_{flight.name}")
            place.parent.mkdir(parents=True)
            shutil.move(file, place)
    return root / dataset.TABLES


def test_pandas_pyarrow_and_duckdb_read_the_dataset(flights, folder):
    """The two flights stay apart by their partition, and every engine sees the same rows."""
    frame = pd.read_parquet(folder / "motors")
    assert list(frame.columns) == ["t", "m1", "m2", "vehicle", "flight"]
    assert set(frame["flight"]) == {"log_00000001", "log_00000002"}
    first = frame[frame["flight"] == "log_00000001"]
    assert np.array_equal(first["m2"], flights[0].motors["m2"])
    assert np.array_equal(first["t"], flights[0].motors.index)

    lazy = pyarrow.dataset.dataset(folder / "trajectory", partitioning="hive")
    rows = lazy.to_table(filter=pyarrow.dataset.field("flight") == "log_00000002", columns=["p_n", "sigma_p_n"])
    assert np.array_equal(rows["p_n"], flights[1].trajectory.states["p_n"])
    assert np.array_equal(rows["sigma_p_n"], flights[1].trajectory.sigma["p_n"])

    answers = duckdb.sql(
        f"select flight, count(*) as n, max(m1) as top from read_parquet('{folder}/motors/**/*.parquet', "
        "hive_partitioning = true) group by flight order by flight"
    ).fetchall()
    assert answers == [(f"log_{flight.name}", len(flight.motors), flight.motors["m1"].max()) for flight in flights]


def test_columns_have_one_type_in_every_log_and_their_units(folder):
    events = pd.read_parquet(folder / "events").sort_values(["flight", "t"])
    assert list(events["detail"]) == ["1", "two", "3", "4"]
    assert events["event"].isna().tolist() == [False, True] * 2
    (file,) = (folder / "gps").rglob("*.parquet")
    assert pq.read_schema(file).field("lat").metadata == {b"unit": b"rad"}
    assert pq.read_schema(file).field("t").metadata == {b"unit": b"s"}


def test_an_experiment_comes_back_to_the_last_bit(flights, tmp_path):
    made = flights[0].experiment
    rng = np.random.default_rng(7)
    context = timed(made.t, roll=rng.normal(size=len(made.t)), density=np.nan)
    given = dataclasses.replace(
        made,
        context=context,
        input_trim=rng.normal(size=2) / 3.0,
        output_trim=rng.normal(size=3) * 1e-300,
        findings=(Finding("gap", Severity.WARNING, "“Lücke”", "", {"s": 0.1}),),
    )
    dataset.write_experiment(given, tmp_path / "part.parquet")
    read = dataset.read_experiment((tmp_path / "part.parquet").read_bytes())
    for field in dataclasses.fields(given):
        one, other = getattr(given, field.name), getattr(read, field.name)
        if isinstance(one, np.ndarray):
            assert one.tobytes() == other.tobytes(), field.name
            assert other.flags.c_contiguous
        elif isinstance(one, pd.DataFrame):
            pd.testing.assert_frame_equal(one, other, check_exact=True)
        else:
            assert one == other, field.name
