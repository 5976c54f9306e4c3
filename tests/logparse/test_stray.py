"""Rows that a flipped bit damaged, beside what a craft really does."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from logparse.canonical.remarks import Remarks
from logparse.canonical.stray import LIMITS, without_stray, without_stray_rows
from logparse.tables import Tables

N, AT = 200, 120
#: Usual scatter of each table's columns, and what a flipped bit adds to one of them.
DAMAGED = {
    "attitude": (0.02, ("roll", "pitch", "yaw"), {"roll": np.radians(150.0)}),
    "gps": (1e-8, ("lat", "lon", "alt", "v_n", "v_e", "v_d"), {"lon": 3e-4}),
    "baro": (0.1, ("alt",), {"alt": 128.0}),
    "mag": (3e-7, ("mag_x", "mag_y", "mag_z"), {"mag_y": 5e-5}),
    "imu": (0.3, ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"), {"accel_z": 19.6}),
    "ekf": (0.05, ("p_n", "p_e", "p_d", "v_n", "v_e", "v_d", "roll", "pitch", "yaw"), {"p_d": 64.0}),
    "motors": (20.0, ("m1", "m2", "m3", "m4"), {"m2": 512.0}),
}


def table(name, seed=1):
    scatter, columns, added = DAMAGED[name]
    rng = np.random.default_rng(seed)
    index = pd.Index(0.1 * np.arange(N), name="t")
    return pd.DataFrame(scatter * rng.normal(size=(N, len(columns))), index=index, columns=list(columns)), added


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_row_is_taken_as_missing_and_counted(name):
    clean, added = table(name)
    assert without_stray(clean, name, Remarks()) is clean
    damaged = clean.copy()
    for column, much in added.items():
        damaged.loc[damaged.index[AT], column] += much
    remarks = Remarks()
    mended = without_stray(damaged, name, remarks)
    assert np.flatnonzero(mended.isna().all(axis=1)).tolist() == [AT]
    pd.testing.assert_frame_equal(mended.drop(mended.index[AT]), clean.drop(clean.index[AT]))
    (finding,) = remarks.findings()
    assert finding.id == "impossible-values"
    assert f"1 of {N}" in finding.reason


def test_a_heading_that_goes_through_south_is_not_damaged():
    attitude, _ = table("attitude")
    turning = attitude.assign(yaw=np.angle(np.exp(1j * 0.3 * np.arange(N))))
    assert without_stray(turning, "attitude", Remarks()) is turning


@pytest.mark.parametrize("seed", range(3))
def test_what_a_craft_does_stays(seed):
    """A flip of the craft reaches over rows, a blow goes on as turning, a step does not lead back."""
    attitude, _ = table("attitude", seed)
    flip = attitude.copy()
    flip.iloc[AT : AT + 5, 0] += [0.8, 2.0, 3.0, 2.0, 0.8]
    assert without_stray(flip, "attitude", Remarks()) is flip
    imu, _ = table("imu", seed)
    blow = imu.copy()
    blow.iloc[AT, 5] -= 30.0
    blow.iloc[AT:, 0] += 3.0 * np.exp(-np.arange(N - AT) / 3.0)
    assert without_stray(blow, "imu", Remarks()) is blow
    baro, _ = table("baro", seed)
    step = baro.copy()
    step.iloc[AT:] += 20.0
    assert without_stray(step, "baro", Remarks()) is step
    motors, _ = table("motors", seed)
    roll = motors.copy()
    roll.iloc[AT] += [300.0, -300.0, 300.0, -300.0]
    assert without_stray(roll, "motors", Remarks()) is roll


def test_tables_that_are_not_there_stay_away():
    attitude, _ = table("attitude")
    tables = Tables(attitude=attitude)
    assert without_stray_rows(tables, Remarks()) == replace(tables)
    assert set(DAMAGED) == {*LIMITS, "motors"}
