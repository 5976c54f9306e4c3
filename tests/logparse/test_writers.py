"""What our writers write, as pymavlink, the library of the protocols, reads it."""

import io
import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pymavlink import DFReader, mavutil

from logparse.dataflash.writer import DataflashWriter, write_dataflash
from logparse.mavlink.dialect import definitions, pymavlink_dialect
from logparse.mavlink.writer import TlogWriter, write_tlog
from tests.timed import timed


def test_tables_are_interleaved_by_time_and_time_is_made_from_the_index(tmp_path: Path) -> None:
    t = np.arange(10.0, 20.0, 0.5)
    fast = timed(t, Roll=np.sin(t))
    slow = pd.DataFrame({"TimeUS": np.array([12_250_000, 11_250_000]), "Alt": [2.0, 1.0]})
    path = tmp_path / "two.bin"
    write_dataflash(path, [("ATT", "Qf", "sd", "F0", fast), ("BARO", "Qf", "sm", "F0", slow)])
    reader = DFReader.DFReader_binary(str(path))
    order = []
    while (message := reader.recv_match(type=["ATT", "BARO", "FMTU"])) is not None:
        order.append(message.TimeUS)
    reader.close()
    assert order == sorted(order)
    assert len(order) == len(t) + 2 + 6


def test_what_does_not_fit_is_refused_by_name() -> None:
    writer = DataflashWriter(io.BytesIO())
    writer.define("X", "QhN", "TimeUS,A,B")
    with pytest.raises(ValueError, match=r"X\.A .*values reach"):
        writer.write("X", 0, 40000, "")
    with pytest.raises(ValueError, match=r"X\.A .*NaN"):
        writer.write("X", 0, float("nan"), "")
    with pytest.raises(ValueError, match=r"X\.B .*17 bytes"):
        writer.write("X", 0, 0, "a" * 17)
    with pytest.raises(ValueError, match="column B is missing"):
        writer.write_table("X", {"TimeUS": [1], "A": [1]})
    with pytest.raises(ValueError, match="different labels"):
        writer.define("Y", "Qh", "TimeUS")
    with pytest.raises(ValueError, match="255 bytes"):
        writer.define("Y", "QZZZZ", "TimeUS,A,B,C,D")


def read_back(path):
    connection = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    messages = []
    while (message := connection.recv_msg()) is not None:
        assert message.get_type() != "BAD_DATA"
        messages.append(message)
    connection.close()
    return messages


def test_bytes_are_those_of_pymavlink_for_every_message():
    for name in sorted(definitions()):
        written, expected = written_and_expected(name)
        assert written == (5).to_bytes(8, "big") + expected, name


def written_and_expected(name):
    """Return a message of random bytes as we write it, and as pymavlink does."""
    definition = definitions()[name]
    rng = np.random.default_rng(definition.id)
    record = np.frombuffer(rng.integers(1, 120, definition.wire.itemsize, dtype=np.uint8).tobytes(), definition.wire)
    fields = {field: record[0][field] for field in definition.fields}
    stream = io.BytesIO()
    TlogWriter(stream).write(5, name, **fields)

    dialect = pymavlink_dialect
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    values = dict(zip(definition.wire.names, record.tolist()[0], strict=True))
    expected = dialect.mavlink_map[definition.id](*(values[field] for field in definition.fields)).pack(link)
    return stream.getvalue(), expected


def test_tables_are_interleaved_by_time_and_clocks_filled(tmp_path):
    path = tmp_path / "flight.tlog"
    t = np.arange(5) * 0.25 + 12.0
    attitude = timed(t, roll=np.sin(t))
    motors = timed(t + 0.1, servo1_raw=1500.4 + t, system=3)
    write_tlog(path, [("ATTITUDE", attitude), ("SERVO_OUTPUT_RAW", motors)], datetime(2024, 3, 1, tzinfo=UTC))
    messages = read_back(path)
    assert [m.get_type() for m in messages] == ["ATTITUDE", "SERVO_OUTPUT_RAW"] * 5
    assert [m.time_boot_ms for m in messages[::2]] == [12000, 12250, 12500, 12750, 13000]
    assert [m.time_usec for m in messages[1::2]] == [12100000, 12350000, 12600000, 12850000, 13100000]
    assert [m.servo1_raw for m in messages[1::2]] == [1512, 1513, 1513, 1513, 1513], "rounded, not cut"
    assert {m.get_srcSystem() for m in messages[1::2]} == {3}
    assert messages[0]._timestamp == pytest.approx(datetime(2024, 3, 1, 0, 0, 12, tzinfo=UTC).timestamp(), abs=1e-6)


@pytest.mark.parametrize(
    ("name", "fields", "message"),
    [
        ("ATTITUTE", {}, "no message 'ATTITUTE'"),
        ("ATTITUDE", {"rol": 1.0}, "no field 'rol'; it has time_boot_ms, roll"),
        ("ATTITUDE", {"time_boot_ms": -1}, "ATTITUDE.time_boot_ms: outside 0"),
        ("SERVO_OUTPUT_RAW", {"servo1_raw": math.nan}, "servo1_raw: not finite"),
        ("STATUSTEXT", {"text": "x" * 51}, "51 bytes of text do not fit into 50"),
    ],
)
def test_values_that_do_not_fit_are_named(name, fields, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        TlogWriter(io.BytesIO()).write(0, name, **fields)
