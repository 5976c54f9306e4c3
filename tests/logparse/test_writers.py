"""What our writers write, as pymavlink, the library of the protocols, reads it."""

import io
import math
import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pymavlink import DFReader, mavutil

from logparse.dataflash.format import MULTIPLIERS, UNITS
from logparse.dataflash.writer import DataflashWriter, write_dataflash
from logparse.mavlink.dialect import definitions, pymavlink_dialect
from logparse.mavlink.writer import TlogWriter, write_tlog
from tests.timed import timed


def rows_by_pymavlink(path: Path) -> dict[str, list[DFReader.DFMessage]]:
    reader = DFReader.DFReader_binary(str(path))
    rows: dict[str, list[DFReader.DFMessage]] = {}
    while (message := reader.recv_msg()) is not None:
        rows.setdefault(message.get_type(), []).append(message)
    reader.close()
    return rows


def test_every_format_character_comes_back_from_pymavlink(tmp_path: Path) -> None:
    """One message with each character at the edges of its range; what goes in scaled comes out scaled."""
    wide = [2**63 - 1, -(2**63)]
    columns = {
        "TimeUS": [1_000_000, 2**63],
        "b": [-128, 127],
        "B": [0, 255],
        "h": [-32768, 32767],
        "H": [0, 65535],
        "i": [-(2**31), 2**31 - 1],
        "I": [0, 2**32 - 1],
        "q": wide,
        "c": [-327.68, 327.67],
        "C": [0.01, 655.35],
        "e": [-21474836.48, 21474836.47],
        "E": [0.0, 42949672.95],
        "L": [-35.3632612, 149.1652374],
        "d": [np.pi, -1e300],
    }
    text = {
        "TimeUS": [1, 2],
        "a": [np.arange(32), -np.arange(32)],
        "g": [0.5, -2.0],
        "f": [1.5, np.inf],
        "n": ["ab", "abcd"],
        "N": ["é", "0123456789abcdef"],
        "Z": ["", "x" * 64],
        "M": [0, 5],
    }
    path = tmp_path / "every.bin"
    with path.open("wb") as stream:
        writer = DataflashWriter(stream)
        writer.define("NUM", "QbBhHiIqcCeELd", list(columns))
        writer.define("TXT", "QagfnNZM", list(text))
        writer.write_table("NUM", columns)
        writer.write_table("TXT", text)
    rows = rows_by_pymavlink(path)
    for name, table in (("NUM", columns), ("TXT", text)):
        for label, values in table.items():
            for row, value in zip(rows[name], values, strict=True):
                got = getattr(row, label)
                assert list(got) == list(value) if label == "a" else got == value, (name, label)


def test_units_and_multipliers_are_declared_as_ardupilot_does(tmp_path: Path) -> None:
    path = tmp_path / "units.bin"
    with path.open("wb") as stream:
        writer = DataflashWriter(stream, start_us=7)
        writer.define("MAG", "QBhhh", "TimeUS,I,MagX,MagY,MagZ", "s#GGG", "F-CCC", id=111)
        writer.write("MAG", 8, 0, 0.25, -0.4, 0.123)
    rows = rows_by_pymavlink(path)
    assert {chr(row.Id): row.Label for row in rows["UNIT"]} == dict(UNITS)
    assert {chr(row.Id): row.Mult for row in rows["MULT"]} == dict(MULTIPLIERS)
    assert [(r.FmtType, r.UnitIds, r.MultIds) for r in rows["FMTU"]][-1] == (111, "s#GGG", "F-CCC")
    mag = rows["MAG"][0]
    assert (mag.MagX, mag.MagY, mag.MagZ) == (250, -400, 123)
    assert mag.fmt.get_unit("MagX") == "mGauss"
    assert mag.fmt.instance_field == "I"


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


def test_a_message_can_be_redefined(tmp_path: Path) -> None:
    path = tmp_path / "again.bin"
    with path.open("wb") as stream:
        writer = DataflashWriter(stream)
        writer.define("X", "QB", "TimeUS,A", id=9)
        writer.write("X", 1, 1)
        writer.define("X", "Qf", "TimeUS,B")
        writer.write("X", 2, 0.5)
    raw = path.read_bytes()
    described = [raw[fmt.end()] for fmt in re.finditer(rb"\xa3\x95\x80", raw)]
    assert sorted(described) == sorted([*set(described), 9]), "X has one number twice, all others their own"
    assert raw.count(b"\xa3\x95\x09") == 2


def read_back(path):
    connection = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    messages = []
    while (message := connection.recv_msg()) is not None:
        assert message.get_type() != "BAD_DATA"
        messages.append(message)
    connection.close()
    return messages


def test_pymavlink_reads_what_is_written(tmp_path):
    path = tmp_path / "two.tlog"
    with path.open("wb") as stream:
        writer = TlogWriter(stream)
        writer.write(1_700_000_000_123_456, "ATTITUDE", time_boot_ms=1500, roll=0.25, yaw=-1.5)
        writer.write(1_700_000_000_200_000, "STATUSTEXT", system=7, component=2, severity=6, text="Frame: OCTA/PLUS")
        writer.write(1_700_000_000_300_000, "BATTERY_STATUS", voltages=[4200, 4199] + [65535] * 8, battery_remaining=-1)
    attitude, text, battery = read_back(path)
    assert (attitude.time_boot_ms, attitude.roll, attitude.pitch, attitude.yaw) == (1500, 0.25, 0.0, -1.5)
    assert attitude._timestamp == pytest.approx(1_700_000_000.123456, abs=1e-6)
    assert (text.get_srcSystem(), text.get_srcComponent(), text.text) == (7, 2, "Frame: OCTA/PLUS")
    assert battery.voltages == [4200, 4199] + [65535] * 8
    assert battery.battery_remaining == -1
    assert [attitude.get_seq(), battery.get_seq(), text.get_seq()] == [0, 1, 0], "each component counts its own frames"


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

    dialect = pymavlink_dialect()
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
