"""From log and trajectory to a record: axes, clock, filtering and what may be missing, GPS among it."""

import numpy as np
import pytest

import sysid
from estimation import estimate
from logparse import Geodetic, MissingDataError, Tables, read_log
from sysid import Experiment, ExperimentError
from sysid.records.context import standard_density
from sysid.records.resampling import resample
from tests.sysid import flights
from tests.timed import timed


def made(motors=None, flight=(10.0, 50.0), down=lambda t: -3.0 - 2.0 * t):
    """Make a climb to the north-west at sea level, 60 s with motors at 10 Hz and states at 50 Hz."""
    tm = np.arange(0.0, 60.0, 0.1)
    if motors is None:
        motors = timed(tm, m1=1500.0 + tm, m2=1400.0 - tm)
    baro = timed(tm, alt=tm, pressure=np.full_like(tm, 101325.0), temperature=np.full_like(tm, 310.0))
    path = {"north": lambda t: 100.0 + t, "east": lambda t: -t, "down": down}
    return flights.made(Tables(motors=motors, baro=baro), flight=flight, **path)


def test_position_is_north_east_up_of_the_first_airborne_sample():
    record = Experiment.from_flight(*made())
    # From where the craft, which climbs at 2 m/s, is 0.3 m above the ground.
    assert record.t[0] == pytest.approx(10.16, abs=0.02)
    assert record.t[-1] == pytest.approx(50.0, abs=0.1)
    assert record.rate == pytest.approx(10.0)
    np.testing.assert_allclose(record.y[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(record.y[-1], [39.8, -39.8, 79.6], atol=1e-6)
    np.testing.assert_allclose(record.u[0], [1510.16, 1389.84])
    assert record.units["z"] == "m"
    assert record.context["density"].iloc[0] == pytest.approx(1.225, rel=1e-3)
    assert record.context["voltage"].isna().all()


def test_height_counts_from_where_the_craft_rested():
    """Where a flight begins the craft has risen already: 0.4 m bent the profile of the wind by ten standard errors."""
    before = Experiment.from_flight(*made(down=lambda t: -1.0 - np.maximum(t - 9.0, 0.0)))
    np.testing.assert_allclose(before.context["height"], before.t - 9.0, atol=1e-6)
    after = Experiment.from_flight(*made(down=lambda t: -2.0 - np.maximum(51.0 - t, 0.0)))
    np.testing.assert_allclose(after.context["height"], 51.0 - after.t, atol=1e-6)
    assert "height" not in Experiment.from_flight(*made()).context


@pytest.mark.parametrize("lost", ["rows", "a motor"])
def test_gaps_in_the_motor_outputs_end_the_record(lost):
    log, _ = made()
    kept = log.tables.motors.copy()
    kept.loc[20.0:25.0, ["m2"] if lost == "a motor" else ["m1", "m2"]] = np.nan
    kept = kept.dropna(how="all")
    record = Experiment.from_flight(*made(motors=kept))
    assert record.t[0] >= 25.0
    assert [finding.id for finding in record.findings] == ["log-gaps"]
    assert "24.9 of 39.8 s" in record.findings[0].reason


def test_a_motor_without_values_is_left_out():
    log, _ = made()
    record = Experiment.from_flight(*made(motors=log.tables.motors.assign(m2=np.nan)))
    assert record.input_names == ("m1",)
    assert record.findings[0].id == "not-logged"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"motors": timed([])}, "log them"),
        ({"flight": None}, "never left the ground"),
        ({"flight": (59.5, 59.9)}, "overlap in flight for"),
    ],
)
def test_missing_data_is_named(arguments, words):
    with pytest.raises(MissingDataError, match=words):
        Experiment.from_flight(*made(**arguments))


def test_resampling_removes_what_would_fold_and_keeps_what_is_slow():
    """A 23 Hz vibration sampled at 10 Hz would show as 3 Hz; a ramp and a 1 Hz sine must come through unchanged."""
    fine = np.arange(0.0, 20.0, 0.01)
    t = np.arange(0.0, 20.0, 0.1)
    slow = 3.0 + 0.5 * fine + np.sin(2.0 * np.pi * fine)
    result = resample(fine, (slow + np.sin(2.0 * np.pi * 23.0 * fine))[:, None], t)[:, 0]
    expected = 3.0 + 0.5 * t + np.sin(2.0 * np.pi * t)
    assert np.max(np.abs(result - expected)[10:-10]) < 0.01
    ramp = resample(fine, (3.0 + 0.5 * fine)[:, None], t)[:, 0]
    np.testing.assert_allclose(ramp, 3.0 + 0.5 * t, atol=1e-9)


def test_a_time_stamp_years_away_costs_neither_memory_nor_accuracy() -> None:
    """A clock of the whole log at the source's rate would have 8,000,000,000 samples here."""
    fine = np.arange(0.0, 20.0, 0.02)
    values = np.column_stack([np.sin(fine), fine**2])
    t = np.arange(2.0, 18.0, 0.1)
    later = np.concatenate([fine, 1.6e8 + fine[:200]])
    both = np.concatenate([values, values[:200]])
    np.testing.assert_array_equal(resample(later, both, t), resample(fine, values, t))
    np.testing.assert_allclose(resample(later, both, t)[:, 0], np.sin(t), atol=1e-3)
    # A clock that the source does not reach holds its last value.
    np.testing.assert_allclose(resample(fine, values, t + 100.0)[:, 1], values[-1, 1])


def test_without_a_barometer_the_altitude_tells_the_density():
    """Origin at 2850 m, climbing at 2 m/s from 23 m at 10 s: 0.92 kg/m^3 and not 1.225."""
    log, trajectory = made()
    place = Geodetic(lat=0.0, lon=0.0, alt=2850.0)
    trajectory.origin = place
    log.tables = Tables(motors=log.tables.motors, origin=place)
    record = Experiment.from_flight(log, trajectory)
    assert record.context["density"].iloc[0] == pytest.approx(0.9215, rel=2e-3)
    assert "conditions-assumed" in {finding.id for finding in record.findings}
    np.testing.assert_allclose(standard_density(np.array([0.0, 1000.0, 3000.0])), [1.225, 1.1116, 0.9091], rtol=2e-4)
    # Without either it is not known.
    log, trajectory = made()
    log.tables = Tables(motors=log.tables.motors)
    assert Experiment.from_flight(log, trajectory).context["density"].isna().all()


def test_a_record_says_that_its_position_is_not_known_and_no_motion_is_fitted_to_it():
    """On craft flown without GPS the wind was wrong by 8 of its own standard errors."""
    log = read_log("sample_logs/quad01_davos_esc.bin")
    trajectory = estimate(log.tables.changed(gps=None), date=log.start_utc)
    drifting = Experiment.from_flight(log, trajectory, rate=25.0)
    (finding,) = [finding for finding in drifting.findings if finding.id == "position-unknown"]
    assert "1-sigma grows to" in finding.reason
    assert drifting.split(0.7)[0].findings == drifting.findings
    with pytest.raises(ExperimentError, match="position is not known"):
        sysid.fit_rigid_body(drifting)
    assert sysid.fit_thrust(drifting).common.per_mass == pytest.approx(7.3, rel=0.1)
