"""Exported files must carry every row, the units, and names that no log can misuse."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat

from core.errors import RotoridError
from logparse.export import export
from logparse.tables import Tables
from tests.timed import timed


@pytest.fixture
def log():
    t = np.arange(5.0)
    motors = timed(t, m1=1500.0 + t, m2=1500.0 - t)
    modes = timed([0.0, 3.0], mode=["AUTO", "LÄND"])
    messages = {
        "ATT": timed(t, {"Roll": "deg"}, Roll=t, t=2 * t),
        "MSG": timed([1.0, 2.0], Message=["hello", None], Blob=[b"\x00\xff", b""]),
        "../X Y": timed([0.0], **{"1st": [7]}),
    }
    return SimpleNamespace(
        path=Path("some log.bin"),
        messages=messages,
        tables=Tables(motors=motors, modes=modes),
        parameters={"FRAME_CLASS": 3.0},
    )


def test_parquet_with_units(log, tmp_path):
    files = export(log, tmp_path)
    assert {path.relative_to(tmp_path).as_posix() for path in files} == {
        "tables/motors.parquet",
        "tables/modes.parquet",
        "messages/ATT.parquet",
        "messages/MSG.parquet",
        "messages/_X_Y.parquet",
        "parameters/parameters.parquet",
    }
    motors = pq.read_table(tmp_path / "tables" / "motors.parquet")
    assert motors.schema.field("m1").metadata == {b"unit": b"us"}
    assert motors["m2"].to_pylist() == [1500.0, 1499.0, 1498.0, 1497.0, 1496.0]
    attitude = pq.read_table(tmp_path / "messages" / "ATT.parquet")
    # A field that is itself called t must not hide the time.
    assert attitude.column_names == ["t", "Roll", "t_2"]
    assert attitude.schema.field("Roll").metadata == {b"unit": b"deg"}


def test_fields_called_like_the_second_of_a_name_stand_beside_it(log, tmp_path):
    t = np.arange(3.0)
    log.messages["ATT"] = pd.DataFrame([[1.0, 2.0, 3.0]] * 3, columns=["t_2", "t", "t"], index=pd.Index(t, name="t"))
    (attitude,) = export(log, tmp_path, messages=["ATT"])
    assert pq.read_table(attitude).column_names == ["t", "t_2", "t_3", "t_4"]


def test_csv_of_a_part(log, tmp_path):
    (motors, attitude) = export(log, tmp_path, format="csv", messages=["motors", "ATT"], start=1.0, stop=3.0)
    assert pd.read_csv(motors)["t"].tolist() == [1.0, 2.0, 3.0]
    assert pd.read_csv(attitude)["Roll"].tolist() == [1.0, 2.0, 3.0]


def test_texts_of_a_log_are_no_formulas_of_a_spreadsheet(tmp_path):
    """Whoever made the log chose them: a message of the autopilot, the name of a field."""
    made = timed([1.0, 2.0], **{"=x": [1.0, -2.0], "Message": ['=HYPERLINK("http://a")', "Takeoff"]})
    log = SimpleNamespace(path=Path("a.bin"), messages={"MSG": made}, tables=Tables())
    (path,) = export(log, tmp_path, format="csv", messages=["MSG"])
    read = pd.read_csv(path)
    assert read["Message"].tolist() == ['\'=HYPERLINK("http://a")', "Takeoff"]
    assert read["'=x"].tolist() == [1.0, -2.0]


def test_matlab(log, tmp_path):
    (path,) = export(log, tmp_path, format="mat")
    assert path.name == "some_log.mat"
    content = loadmat(path, simplify_cells=True)
    assert content["tables"]["motors"]["m1"].tolist() == [1500, 1501, 1502, 1503, 1504]
    assert list(content["tables"]["modes"]["mode"]) == ["AUTO", "LÄND"]
    assert content["messages"]["x___X_Y"]["x1st"] == 7
    assert content["messages"]["MSG"]["Blob"][0] == "00ff"


def test_array_fields_have_a_column_for_each_element(log, tmp_path):
    arrays = pa.FixedSizeListArray.from_arrays(pa.array(np.arange(6, dtype="i2")), 3)
    log.messages["ISBD"] = timed([0.0, 1.0], x=pd.arrays.ArrowExtensionArray(arrays))
    (path,) = export(log, tmp_path, format="csv", messages=["ISBD"])
    assert path.read_text().splitlines() == ["t,x[0],x[1],x[2]", "0.0,0,1,2", "1.0,3,4,5"]
    (path,) = export(log, tmp_path, format="mat", messages=["ISBD"])
    assert loadmat(path, simplify_cells=True)["messages"]["ISBD"]["x"].tolist() == [[0, 1, 2], [3, 4, 5]]


def test_names_that_the_log_does_not_have(log, tmp_path):
    with pytest.raises(RotoridError, match=r"has no RCOU; it has the tables motors, modes and the messages"):
        export(log, tmp_path, messages=["RCOU"])
    with pytest.raises(RotoridError, match="unknown export format 'xlsx'"):
        export(log, tmp_path, format="xlsx")
