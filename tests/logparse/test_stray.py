"""Damaged rows and time stamps beside what a craft really does, and the accelerometer at rest."""

from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from logparse.flights import Flight
from logparse.kept import Kept
from logparse.messages import IntactMessages
from logparse.rest import ACCEL, GYRO, at_rest, calibration
from logparse.stray import find_strays, without
from logparse.tables import Tables
from logparse.timebase import mend_times, utc_from_gps
from tests.timed import timed

N, AT = 200, 120
#: By message the usual scatter of its fields, and what a flipped bit adds to one of them.
DAMAGED = {
    "ATT": (1.0, ("Roll", "Pitch", "Yaw"), {"Roll": 150.0}),
    "GPS": (6e-7, ("Lat", "Lng", "Alt", "Spd"), {"Lng": 0.02}),
    "BARO": (0.1, ("Alt", "Press", "Temp"), {"Alt": 128.0}),
    "MAG": (3.0, ("MagX", "MagY", "MagZ"), {"MagY": 512.0}),
    "IMU": (0.3, ("GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ"), {"AccZ": 19.6}),
    "BAT": (0.02, ("Volt", "Curr"), {"Volt": -4.0}),
    "VIBE": (2.0, ("VibeX", "VibeY", "VibeZ"), {"VibeX": 6e19}),
    "RCOU": (20.0, ("C1", "C2", "C3", "C4"), {"C2": 512.0}),
}


def without_stray(name, frame):
    """Return a message without its damaged values, and how many they were."""
    strays = find_strays(name, frame)
    return without(frame, strays), sum(map(len, strays.values()))


def message(name, seed=1):
    scatter, columns, added = DAMAGED[name]
    rng = np.random.default_rng(seed)
    index = pd.Index(0.1 * np.arange(N), name="t")
    return pd.DataFrame(scatter * rng.normal(size=(N, len(columns))), index=index, columns=list(columns)), added


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_value_is_taken_as_missing_and_counted(name):
    clean, added = message(name)
    same, count = without_stray(name, clean)
    assert same is clean
    assert count == 0
    damaged = clean.copy()
    for column, much in added.items():
        damaged.loc[damaged.index[AT], column] += much
    mended, count = without_stray(name, damaged)
    expected = clean.copy()
    expected.loc[expected.index[AT], list(added)] = np.nan
    pd.testing.assert_frame_equal(mended, expected)
    assert count == 1


def test_two_damaged_values_of_a_size_do_not_hide_each_other():
    frame, _ = message("IMU")
    frame.iloc[[AT, AT + 4], 5] += [19.6, -19.6]
    mended, count = without_stray("IMU", frame)
    assert count == 2
    assert np.flatnonzero(mended["AccZ"].isna()).tolist() == [AT, AT + 4]


def test_what_is_beyond_anything_beside_is_damaged_whatever_the_rest_of_its_row_does():
    """A latitude of 140 m while the course of a hovering craft turns (spark404 with flipped bits)."""
    frame, _ = message("GPS")
    frame.iloc[AT:, 3] += 2e-5
    frame.iloc[AT, 0] += 1e-3
    mended, count = without_stray("GPS", frame)
    assert count == 1
    assert np.flatnonzero(mended["Lat"].isna()).tolist() == [AT]


def test_whole_numbers_and_single_precision_stay_what_they_are_elsewhere():
    clean, _ = message("IMU")
    frame = clean.astype(np.float32).assign(Health=np.uint8(1))
    frame.iloc[AT, 5] += 25.0
    mended, count = without_stray("IMU", frame)
    assert count == 1
    assert mended.dtypes.to_dict() == frame.dtypes.to_dict()


def test_what_never_moves_has_no_noise_to_hide_damage_in():
    satellites = pd.DataFrame({"NSats": np.where(np.arange(N) == AT, 4, 12)}, index=0.1 * np.arange(N))
    mended, count = without_stray("GPS", satellites)
    assert count == 1
    assert np.flatnonzero(mended["NSats"].isna()).tolist() == [AT]


def test_instances_are_looked_at_one_by_one():
    """Two batteries that take turns differ in every row; a bit of one of them stands out in its own rows alone."""
    first, _ = message("BAT")
    both = pd.concat([first.assign(Inst=0), first.add({"Volt": 10.0, "Curr": 0.0}).assign(Inst=1)]).sort_index(
        kind="stable"
    )
    assert without_stray("BAT", both)[1] == 0
    both.iloc[2 * AT + 1, 0] -= 4.0
    mended, count = without_stray("BAT", both)
    assert count == 1
    assert np.flatnonzero(mended["Volt"].isna()).tolist() == [2 * AT + 1]


def test_a_heading_that_goes_through_north_is_not_damaged():
    attitude, _ = message("ATT")
    turning = attitude.assign(Yaw=np.degrees(0.3 * np.arange(N)) % 360.0)
    assert without_stray("ATT", turning)[1] == 0
    touching = attitude.assign(Yaw=(11.0 * np.cos(0.6 * np.arange(N)) - 10.0) % 360.0)  # in some rows alone
    assert without_stray("ATT", touching)[1] == 0


def test_events_are_not_looked_at():
    modes = pd.DataFrame({"Mode": np.where(np.arange(N) == AT, 200, np.arange(N) % 2)}, index=0.1 * np.arange(N))
    assert without_stray("MODE", modes)[1] == 0


@pytest.mark.parametrize("seed", range(3))
def test_what_a_craft_does_stays(seed):
    """A flip of the craft reaches over rows, a blow goes on as turning, a step does not lead back."""
    flip, _ = message("ATT", seed)
    flip.iloc[AT : AT + 5, 0] += [50.0, 120.0, 180.0, 120.0, 50.0]
    assert without_stray("ATT", flip)[1] == 0
    blow, _ = message("IMU", seed)
    blow.iloc[AT, 5] -= 30.0
    blow.iloc[AT:, 0] += 3.0 * np.exp(-np.arange(N - AT) / 3.0)
    assert without_stray("IMU", blow)[1] == 0
    step, _ = message("BARO", seed)
    step.iloc[AT:] += 20.0
    assert without_stray("BARO", step)[1] == 0
    roll, _ = message("RCOU", seed)
    roll.iloc[AT] += [300.0, -300.0, 300.0, -300.0]
    assert without_stray("RCOU", roll)[1] == 0


RATE = 50.0


def imu(seconds=20.0, force=(0.0, 0.0, -9.81), turning=0.0, shaking=0.05, seed=1):
    """Make an IMU that stands, turns or shakes, with noise of a usual sensor."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / RATE)
    columns = {name: turning * np.sin(3.0 * t) + 0.005 * rng.standard_normal(len(t)) for name in GYRO}
    columns |= {name: f + shaking * rng.standard_normal(len(t)) for name, f in zip(ACCEL, force, strict=True)}
    return Tables(imu=timed(t, **columns))


def ids(tables, flights=(), parameters=None):
    return [finding.id for finding in calibration(at_rest(tables, flights), parameters or {})]


@pytest.mark.parametrize("tilt", [0.0, 0.5, 3.1])
def test_a_calibrated_one_reads_gravity_however_it_stands(tilt):
    force = (9.81 * np.sin(tilt), 0.0, -9.81 * np.cos(tilt))
    assert ids(imu(force=force)) == ids(imu(force=force, shaking=0.4)) == [], "nor do idling motors matter"


@pytest.mark.parametrize("reads", [8.28, 10.66])
def test_one_that_is_not_calibrated_is_found(reads):
    """The Erle boards of 2014 read 8.3 to 8.8 m/s^2 at rest, and their second IMU 10.7."""
    tables = imu(force=(0.2, 0.1, -reads), shaking=0.4)
    assert at_rest(tables, ()).specific_force == pytest.approx(np.hypot(reads, np.hypot(0.2, 0.1)), abs=0.05)
    (finding,) = calibration(at_rest(tables, ()), {f"INS_ACCOFFS_{axis}": 0.0 for axis in "XYZ"})
    assert finding.id == "sensor-doubtful"
    assert "never calibrated" in finding.reason
    assert "Calibrate" in finding.advice


def test_flight_and_handling_are_no_rest():
    bad = imu(force=(0.0, 0.0, -12.0))
    assert at_rest(bad, [Flight(0.0, 20.0)]) is None
    assert at_rest(imu(force=(0.0, 0.0, -12.0), turning=0.3), ()) is None
    assert at_rest(imu(force=(0.0, 0.0, -12.0), shaking=2.0), ()) is None
    assert at_rest(imu(seconds=2.0), ()) is None
    assert at_rest(Tables(), ()) is None


@pytest.mark.parametrize(
    ("utc", "leap"),
    [
        # Offsets of GPS time from UTC as IERS Bulletin C announced them, on both sides of their dates.
        (datetime(2012, 6, 30, 23, 59, 59, tzinfo=UTC), 15),
        (datetime(2012, 7, 1, 0, 0, 1, tzinfo=UTC), 16),
        (datetime(2014, 1, 26, 15, 42, 44, tzinfo=UTC), 16),
        (datetime(2015, 7, 1, 0, 0, 1, tzinfo=UTC), 17),
        (datetime(2016, 12, 31, 23, 59, 59, tzinfo=UTC), 17),
        (datetime(2017, 1, 1, 0, 0, 1, tzinfo=UTC), 18),
        (datetime(2024, 5, 5, 12, 0, 0, tzinfo=UTC), 18),
    ],
)
def test_utc_of_gps_week_and_milliseconds(utc: datetime, leap: int) -> None:
    seconds = (utc - datetime(1980, 1, 6, tzinfo=UTC)).total_seconds() + leap
    week, rest = divmod(seconds, 604800)
    assert utc_from_gps(int(week), rest * 1e3) == utc


def test_times_out_of_the_order_of_their_rows_are_interpolated() -> None:
    """A bit of half a second put a fix of 11-2-2015_112 among others, from where the craft seemed to jump."""
    t = 0.1 * np.arange(20.0)
    damaged = t.copy()
    damaged[9] -= 0.512
    mended, count = mend_times(damaged, 0.0, 2.0)
    assert count == 1
    np.testing.assert_allclose(mended, t)
    t = np.array([10.0, 11.0, 9e9, 13.0, 14.0, 2.0, 16.0, np.nan, 18.0])
    mended, count = mend_times(t, 0.0, 20.0)
    assert count == 3
    np.testing.assert_allclose(mended, np.arange(10.0, 19.0))


@given(st.lists(st.floats(width=32), max_size=12))
@settings(deadline=None, derandomize=True)
def test_whatever_the_times_they_come_back_within_the_boot(times: list[float]) -> None:
    mended, _ = mend_times(np.array(times), 0.0, 100.0)
    assert len(mended) == len(times)
    assert ((mended >= -5.0) & (mended <= 105.0)).all()


def test_a_damaged_number_that_signals_is_passed_without_a_warning():
    """A flipped bit may make a float32 a signalling NaN, of whose conversion NumPy warns."""
    values = np.zeros(N, np.float32)
    values.view(np.uint32)[AT] = 0x7FA00000
    kept, count = without_stray("ATT", pd.DataFrame({"Roll": values}, index=0.1 * np.arange(N)))
    assert count == 0
    assert np.isnan(kept["Roll"].iloc[AT])


class Parts(dict):
    """Messages of which fields can be had alone."""

    def once(self, name, fields=None):
        return self[name][sorted(fields)] if fields else self[name]


def test_fields_are_looked_at_though_others_of_the_message_were_intact():
    """What was found intact of the first fields that somebody asked for was taken for the whole message."""
    frame, added = message("IMU")
    frame.iloc[AT, frame.columns.get_loc("AccZ")] += added["AccZ"]
    messages = IntactMessages(Parts(IMU=frame), Kept(), checked=False)
    assert messages.part("IMU", ("GyrX", "GyrY")).notna().all(axis=None)
    assert np.isnan(messages.part("IMU", ("AccX", "AccZ"))["AccZ"].iloc[AT])
    assert messages.damaged == {"IMU": 1}


def test_damage_is_told_by_all_fields_of_a_message_that_is_read_in_parts():
    """A blow moves several fields; read one at a time, each would stand alone and be taken for damage."""
    frame, _ = message("IMU")
    frame.iloc[AT, :4] += 19.6
    messages = IntactMessages(Parts(IMU=frame), Kept(), checked=False)
    assert messages.part("IMU", ("GyrX",), of_all=True).notna().all(axis=None)
    frame.iloc[AT + 50, 0] += 19.6
    messages = IntactMessages(Parts(IMU=frame), Kept(), checked=False)
    assert messages.part("IMU", ("GyrX",), of_all=True)["GyrX"].isna().sum() == 1
    assert messages.part("IMU", ("GyrY",), of_all=True).notna().all(axis=None)
