"""`read_log`: what a user hands in, from good logs in archives to things that are no logs; tables built on demand."""

import gzip
import os
import pickle
import zipfile
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import logparse.kept
from logparse import COLUMNS, FlightLog, LogError, Tables, read_log
from logparse.canonical.series import join
from logparse.dataflash.writer import write_dataflash
from tests.paths import SAMPLES
from tests.timed import timed


def small_log(path: Path, start: float = 10.0, seconds: float = 20.0) -> Path:
    t = np.arange(start, start + seconds, 0.1)
    messages = [
        ("GPS", "QBIHL", "s-s-D", "F-C-G", timed(t, Status=3, GMS=1000.0 + t, GWk=2300, Lat=47.0)),
        ("ATT", "Qff", "sdd", "F00", timed(t, Roll=np.sin(t), Pitch=np.cos(t))),
        ("PARM", "QNf", "s--", "F--", timed([start] * 4, Name=["A", "B", "A", "C"], Value=[1.0, 2.0, 3.0, np.nan])),
    ]
    write_dataflash(path, messages)
    return path


def test_log_of_one_boot(tmp_path: Path) -> None:
    log = read_log(small_log(tmp_path / "a.ulg"))
    assert log.format == "dataflash", "names do not matter"
    assert log.duration == pytest.approx(19.9)
    assert log.boots == (log.boot,)
    assert dict(log.parameters) == {"A": 3.0, "B": 2.0}
    assert "impossible-values" in {finding.id for finding in log.findings}
    gps_seconds = timedelta(weeks=2300, seconds=1000) - timedelta(seconds=18)
    assert log.start_utc == datetime(1980, 1, 6, tzinfo=UTC) + gps_seconds
    assert log.flights == ()
    assert log.flight is None
    assert log.vehicle is not None


def test_parameters_under_a_damaged_definition_are_left_out(tmp_path: Path) -> None:
    path = small_log(tmp_path / "a.bin")
    path.write_bytes(path.read_bytes().replace(b"TimeUS,Name,Value", b"TimeUS,Nbme,Value", 1))
    log = read_log(path)
    assert dict(log.parameters) == {}
    assert log.tables.attitude is not None


def test_messages_are_a_mapping_of_what_occurs(tmp_path: Path) -> None:
    log = read_log(small_log(tmp_path / "a.bin"))
    messages = log.messages
    assert "ATT" in messages
    assert "IMU" not in messages
    assert messages.get("IMU") is None
    with pytest.raises(KeyError):
        messages["IMU"]
    assert messages["ATT"] is messages["ATT"]
    assert {name: len(frame) for name, frame in messages.items()} == dict(messages.counts)
    assert len(list(messages.values())) == len(messages)


def test_messages_one_by_one_are_those_of_all_at_once() -> None:
    path = SAMPLES / "octa01_zurich_calm.bin"
    one_by_one, at_once = read_log(path).messages, read_log(path).messages
    at_once.load(at_once)
    for name in one_by_one:
        pd.testing.assert_frame_equal(one_by_one[name], at_once[name], check_exact=True)


def test_archives(tmp_path: Path) -> None:
    path = small_log(tmp_path / "a.bin")
    with gzip.open(tmp_path / "a.bin.gz", "wb") as packed:
        packed.write(path.read_bytes())
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("README.txt", "a flight")
        archive.write(path, "logs/a.bin")
    for name in ("a.bin.gz", "a.zip"):
        log = read_log(tmp_path / name)
        pd.testing.assert_frame_equal(log.messages["ATT"], read_log(path).messages["ATT"])


def test_archive_that_is_cut_short_gives_what_it_holds(tmp_path: Path) -> None:
    path = small_log(tmp_path / "a.bin")
    packed = gzip.compress(path.read_bytes())
    (tmp_path / "cut.gz").write_bytes(packed[: len(packed) // 2])
    log = read_log(tmp_path / "cut.gz")
    assert 0 < len(log.messages["ATT"]) < 200
    assert "file-damaged" in {finding.id for finding in log.findings}
    (tmp_path / "stub.gz").write_bytes(packed[:12])
    with pytest.raises(LogError, match="cannot be unpacked"):
        read_log(tmp_path / "stub.gz")


def test_archives_that_are_refused(tmp_path: Path, limit_unpacked: Callable[[int], None]) -> None:
    path = small_log(tmp_path / "a.bin")
    with zipfile.ZipFile(tmp_path / "two.zip", "w") as archive:
        archive.write(path, "a.bin")
        archive.write(path, "b.bin")
    with pytest.raises(LogError, match="2 logs"):
        read_log(tmp_path / "two.zip")
    with zipfile.ZipFile(tmp_path / "none.zip", "w") as archive:
        archive.writestr("README.txt", "nothing")
    with pytest.raises(LogError, match="no log"):
        read_log(tmp_path / "none.zip")
    (tmp_path / "broken.zip").write_bytes(b"PK\x03\x04" + b"x" * 100)
    with pytest.raises(LogError, match="cannot be opened"):
        read_log(tmp_path / "broken.zip")
    limit_unpacked(1000)
    with gzip.open(tmp_path / "bomb.gz", "wb") as packed:
        packed.write(path.read_bytes())
    with pytest.raises(LogError, match="unpacks to more"):
        read_log(tmp_path / "bomb.gz")


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_damaged_zip_archives_are_refused_or_read_whatever_the_decompressor_raises(tmp_path: Path, method: int) -> None:
    """An LZMAError, an IndexError and an UnicodeDecodeError got through."""
    path, rng = tmp_path / "a.zip", np.random.default_rng(19)
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr("a.bin", small_log(tmp_path / "a.bin").read_bytes())
    whole, said = path.read_bytes(), list[str]()
    for _ in range(60):
        damaged = bytearray(whole)
        for at in rng.choice([*range(4, 60), *range(len(whole) - 80, len(whole))], 3):
            damaged[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:
            read_log(path)
        except LogError as error:
            said.append(str(error))
    assert said
    assert all(path.name in sentence for sentence in said)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"\0" * 5000, "nothing but zeros"),
        (b'{"t": 0.1, "roll": 0.2}\n' * 50, "JSON"),
        (b"time,roll\n0,1\n", "a text that begins 'time,roll'"),
        (np.random.default_rng(3).bytes(4000), "binary data of an unknown kind"),
    ],
)
def test_what_is_no_log_is_refused_in_words(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "thing.bin"
    path.write_bytes(content)
    with pytest.raises(LogError, match=words) as caught:
        read_log(path)
    assert "thing.bin" in str(caught.value)


def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="No such file"):
        read_log(tmp_path / "none.bin")
    with pytest.raises(LogError, match="folder"):
        read_log(tmp_path)
    os.mkfifo(tmp_path / "flight.bin")
    with pytest.raises(LogError, match="not a file"):
        read_log(tmp_path / "flight.bin")


def test_boot_is_chosen_by_the_user_or_by_length(tmp_path: Path) -> None:
    parts = [small_log(tmp_path / f"{k}.bin", start, seconds) for k, (start, seconds) in enumerate(((90, 5), (10, 30)))]
    with (tmp_path / "both.bin").open("wb") as both:
        for part in parts:
            both.write(part.read_bytes())
    log = read_log(tmp_path / "both.bin")
    assert len(log.boots) == 2
    assert log.boot == log.boots[1]
    assert log.messages["ATT"].index[0] == pytest.approx(10.0)
    first = read_log(tmp_path / "both.bin", boot=0)
    assert first.messages["ATT"].index[0] == pytest.approx(90.0)
    with pytest.raises(LogError, match="holds 2 power-ups, not 3"):
        read_log(tmp_path / "both.bin", boot=2)


def test_a_power_up_without_parameters_has_those_of_the_one_before(tmp_path: Path) -> None:
    """A clock that jumps back makes two power-ups of one: what was flown after it was flown without parameters."""
    t = np.arange(10.0, 20.0, 0.1)
    attitude = timed(t, Roll=np.sin(t), Pitch=np.cos(t))
    write_dataflash(tmp_path / "b.bin", [("ATT", "Qff", "sdd", "F00", attitude)])
    parts = small_log(tmp_path / "a.bin", 90, 5), tmp_path / "b.bin"
    (tmp_path / "both.bin").write_bytes(b"".join(part.read_bytes() for part in parts))
    for boot in (0, 1):
        assert dict(read_log(tmp_path / "both.bin", boot=boot).parameters) == {"A": 3.0, "B": 2.0}
    assert dict(read_log(tmp_path / "b.bin").parameters) == {}


def test_power_ups_shorter_than_a_flight_found_are_not_looked_into(tmp_path: Path) -> None:
    """A file of many power-ups took as long as building all tables of each."""
    flown = SAMPLES / "octa01_zurich_calm.bin"
    (tmp_path / "both.bin").write_bytes(small_log(tmp_path / "a.bin", 90, 5).read_bytes() + flown.read_bytes())
    looked_into: list[int] = []

    class Watched(FlightLog):
        @property
        def tables(self) -> Tables:
            looked_into.append(self.boots.index(self.boot))
            return super().tables

    log = read_log(tmp_path / "both.bin", kind=Watched)
    assert log.flight is not None
    assert log.boot == log.boots[1]
    assert set(looked_into) == {1}


LOG = SAMPLES / "quad02_delft_systemid.bin"


@pytest.fixture(scope="module")
def at_once():
    log = read_log(LOG)
    return log.tables, log.findings


@pytest.fixture
def deferred(monkeypatch):
    """Return the log as if there were room for next to nothing."""
    monkeypatch.setattr(logparse.kept, "_OF_EACH", 0)
    monkeypatch.setattr(logparse.kept, "_ALWAYS", 8000)
    return read_log(LOG)


def same(a, b):
    if isinstance(a, pd.DataFrame):
        pd.testing.assert_frame_equal(a, b, check_exact=True)
    elif isinstance(a, dict):
        assert a.keys() == b.keys()
        for name in a:
            for one, other in zip(a[name], b[name], strict=True) if isinstance(a[name], tuple) else ():
                same(one, other)
    else:
        assert a == b


def same_tables(a, b):
    for name in (*COLUMNS, "further", "parameters", "origin"):
        same(getattr(a, name), getattr(b, name))


def test_tables_and_findings_are_the_same(at_once, deferred):
    same_tables(at_once[0], deferred.tables)
    assert deferred.findings == at_once[1]


def test_what_was_made_last_is_kept_and_the_rest_as_long_as_there_is_room(at_once, deferred):
    tables = deferred.tables
    imu = tables.imu
    assert tables.imu is imu
    assert tables.rates is not None
    again = tables.imu
    assert again is not imu
    same(imu, again)
    assert at_once[0].imu is at_once[0].imu
    assert at_once[0].gps is at_once[0].gps


@pytest.mark.parametrize(
    ("name", "wanted"),
    [("rates", ("out_roll", "w_x_ref", "out_thrust")), ("setpoints", ("throttle", "yaw", "p_d", "v_n_ref"))],
)
def test_columns_come_one_by_one_without_their_table(at_once, deferred, name, wanted):
    whole, tables = at_once[0], deferred.tables
    table = getattr(whole, name)
    for source in (whole, tables):
        columns = list(source.columns(name, wanted))
        assert [column.name for column in columns] == list(wanted)
        for column in columns:
            pd.testing.assert_series_equal(column, table[column.name], check_exact=True)
        same(source.part(name, wanted), table[list(wanted)])
        same(source.column(name, wanted[0]).to_frame(), table[[wanted[0]]])
    assert list(Tables().columns(name, wanted)) == []
    assert Tables().column(name, wanted[0]) is Tables().part(name, wanted) is None


def test_of_targets_logged_as_often_by_two_messages_the_later_counts():
    first, second = (pd.DataFrame({"roll": [k, k], "pitch": 0.0}, index=[0.1 * k, 0.1 * k + 1.0]) for k in (1.0, 2.0))
    joined = join([first, second.drop(columns="pitch")], ("roll", "pitch"), gap=0.3)
    assert joined.index.tolist() == [0.2, 1.2]
    assert joined["roll"].tolist() == [2.0, 2.0]


def test_times_are_those_of_the_table(at_once, deferred):
    for name in ("imu", "rates", "setpoints", "gps"):
        assert deferred.tables.times(name).tolist() == at_once[0].times(name).tolist()
    assert Tables().times("imu") is None
    # RATE may have two rows of one time, of which the table has one.
    log = read_log(LOG)
    log.messages.replace("RATE", log.messages["RATE"].loc[np.repeat(log.messages["RATE"].index, 2)])
    assert log.tables.times("rates").tolist() == at_once[0].times("rates").tolist()


def test_copies_hold_what_was_deferred(deferred):
    tables = deferred.tables
    same_tables(pickle.loads(pickle.dumps(tables)), tables)
    without = tables.changed(imu=None)
    assert without.imu is None
    same(without.rates, tables.rates)


def test_tables_follow_rows_that_somebody_corrected():
    log = read_log(LOG)
    assert log.tables.baro is not None
    rows = log.messages["BARO"]
    log.messages.replace("BARO", rows.assign(Alt=rows["Alt"] + 100.0))
    assert float(log.tables.baro["alt"].median()) > 90.0
    assert log.messages["BARO"].attrs == rows.attrs
