"""What the writer writes must be what pymavlink, the protocol's own library, reads."""

import io
import math
from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pytest
from pymavlink import mavutil

from logparse.mavlink.dialect import definitions, pymavlink_dialect
from logparse.mavlink.writer import TlogWriter, write_tlog


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
    attitude = pd.DataFrame({"roll": np.sin(t)}, index=pd.Index(t, name="t"))
    motors = pd.DataFrame({"servo1_raw": 1500.4 + t, "system": 3}, index=pd.Index(t + 0.1, name="t"))
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
