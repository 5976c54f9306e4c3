"""Tables that are built when they are asked for are the same as those built at once."""

import pickle
from dataclasses import fields, replace
from pathlib import Path

import pandas as pd
import pytest

import logparse.canonical
import logparse.messages
from logparse import Tables, read_log
from logparse.canonical.series import join

LOG = Path(__file__).parents[2] / "sample_logs" / "quad02_delft_systemid.bin"


@pytest.fixture(scope="module")
def at_once():
    log = read_log(LOG)
    return log.tables, log.findings


@pytest.fixture
def deferred(monkeypatch):
    """Return the log as if a thousand rows were many."""
    monkeypatch.setattr(logparse.canonical, "LONG", 1000)
    monkeypatch.setattr(logparse.messages, "LONG", 1000)
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
    for each in fields(Tables):
        same(getattr(a, each.name), getattr(b, each.name))


def test_tables_and_findings_are_the_same(at_once, deferred):
    same_tables(at_once[0], deferred.tables)
    assert deferred.findings == at_once[1]


def test_a_long_table_is_kept_until_another_is_asked_for_or_it_is_released(deferred):
    tables = deferred.tables
    imu = tables.imu
    assert tables.imu is imu
    assert tables.rates is not None
    again = tables.imu
    assert again is not imu
    same(imu, again)
    tables.release()
    assert tables.imu is not again


@pytest.mark.parametrize(
    ("name", "wanted"),
    [("rates", ("out_roll", "w_x_ref", "out_thrust")), ("setpoints", ("throttle", "yaw", "p_d", "v_n_ref"))],
)
def test_columns_come_one_by_one_without_their_table(at_once, deferred, name, wanted):
    whole, tables = at_once[0], deferred.tables
    kept, table = tables.imu, getattr(whole, name)
    for source in (whole, tables):
        columns = list(source.columns(name, wanted))
        assert [column.name for column in columns] == list(wanted)
        for column in columns:
            pd.testing.assert_series_equal(column, table[column.name], check_exact=True)
        same(source.part(name, wanted), table[list(wanted)])
        same(source.column(name, wanted[0]).to_frame(), table[[wanted[0]]])
    assert tables.imu is kept, "no other long table was made, which would have taken its place"
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


def test_copies_hold_what_was_deferred(deferred):
    tables = deferred.tables
    same_tables(pickle.loads(pickle.dumps(tables)), tables)
    without = replace(tables, imu=None)
    assert without.imu is None
    same(without.rates, tables.rates)


def test_long_messages_are_kept_only_for_who_asks_for_them(deferred):
    assert deferred.tables.rates is not None
    assert "RATE" not in deferred.messages.decoded
    rate = deferred.messages["RATE"]
    assert deferred.messages["RATE"] is rate


def test_a_table_may_be_kept_when_the_others_are_released(deferred):
    imu = deferred.tables.imu
    deferred.tables.release(keep="imu")
    assert deferred.tables.imu is imu


def test_messages_held_together_are_not_kept(deferred):
    assert deferred.tables.attitude is not None
    assert deferred.messages.counts["ATT"] >= 1000
    assert "ATT" not in deferred.messages.decoded
