"""Cases by name: what they give, how their settings are changed, and what they refuse."""

import json
from functools import cache

import numpy as np
import pandas as pd
import pytest

from logparse import read_log
from simulation import (
    CASES,
    ArrivalError,
    DivergenceError,
    ParameterError,
    find,
    guntur2019,
    kim2017,
    motion2018,
    parse_settings,
    read_settings,
    write,
)
from simulation.papers import motor_order

PAPERS = ("motion-vertical", "motion-spatial", "motion-wind", "kim-recovery", "guntur-profile", "guntur-discharge")


@cache
def flown(name):
    return CASES[name].run()


def facts(outcome):
    return {fact.name: fact.value for fact in outcome.facts}


@pytest.mark.parametrize("name", ["motion-vertical", "guntur-profile", "quad01_davos_esc"])
def test_a_case_gives_plots_characteristics_history_and_a_log(name, tmp_path):
    outcome = flown(name)
    files = {path.suffix: path for path in write(outcome, tmp_path)[:2] + write(outcome, tmp_path)[-2:]}
    assert set(files) == {".txt", ".csv", ".bin", ".json"}
    text = files[".txt"].read_text()
    assert "not flown" in text
    assert all(fact.name in text and fact.text in text for fact in outcome.facts)
    history = pd.read_csv(files[".csv"], index_col="t_s")
    assert len(history) == len(outcome.history)
    assert np.isfinite(history.to_numpy()).all()
    assert outcome.plots
    assert all(len(plot.lines) > 10 and len(plot.lines.columns) > 0 for plot in outcome.plots)
    truth = json.loads(files[".json"].read_text())
    assert truth["what"].startswith("simulated by rotorid, not flown")
    log = read_log(files[".bin"])
    assert len(log.vehicle.motors) == len(truth["vehicle"]["motors"])
    assert log.tables.motors is not None
    assert log.tables.imu is not None
    assert log.tables.truth is not None


@pytest.mark.parametrize("name", PAPERS)
def test_logs_of_the_papers_tell_their_flights(name, tmp_path):
    """Truth rows against the history, GPS against the truth, specific force against thrust over mass."""
    outcome = flown(name)
    write(outcome, tmp_path)
    log = read_log(tmp_path / f"{name}.bin")
    truth, imu, esc = log.tables.truth, log.tables.imu, log.tables.esc
    start = truth.index[0]
    height = -np.interp(outcome.history.index, truth.index - start, truth["p_d"])
    if "y_m" in outcome.history:
        expected = outcome.history["y_m"]
    else:
        expected = -outcome.history["p_d_m" if "p_d_m" in outcome.history else "p_d"]
    inside = outcome.history.index < truth.index[-1] - start
    assert height[inside] == pytest.approx(expected.to_numpy()[inside], abs=0.02)
    described = json.loads((tmp_path / f"{name}.json").read_text())
    if "thrust_coefficient_n_s2" in described["vehicle"] and "motion" in name:
        squares = sum(np.interp(imu.index, esc.index, esc[f"w{k}"]) ** 2 for k in range(1, 5))
        lift = described["vehicle"]["thrust_coefficient_n_s2"] * squares / described["vehicle"]["mass_kg"]
        speed = np.sqrt((truth[["v_n", "v_e", "v_d"]] ** 2).sum(axis=1))
        drag = -truth["v_d"] * (0.1 + 0.5 * 1.225 * 0.02 * speed) / described["vehicle"]["mass_kg"]
        # Noise of the accelerometer averages out; lean and thinner air leave one per cent.
        assert -imu["accel_z"].mean() == pytest.approx(lift.mean() - drag.mean(), rel=0.01)


def test_motors_are_logged_in_the_autopilots_order():
    """ArduPilot's QUAD/X: right front, left rear, left front, right rear; QUAD/PLUS: right, left, front, rear."""
    assert motor_order(kim2017.quadcopter()) == [1, 3, 2, 0]
    assert motor_order(motion2018.quadcopter()) == [2, 3, 0, 1]
    assert motor_order(guntur2019.quadcopter(guntur2019.MOTORS[0], 0.5)) == [0, 1, 2, 3]


def test_settings_change_a_mission():
    calm = CASES["octa01_zurich_calm"].run(parse_settings(["points=5,0,6;5,5,9", "takeoff=4", "speed=2"]))
    assert facts(calm)["greatest height"] == pytest.approx(9.0, abs=0.6)
    assert facts(calm)["mission"] == "2 x hold, 2 x relocation"
    heavy = CASES["octa01_zurich_calm"].run({"mass": 5.0, "wind": 3, "wind_from": "270"})
    assert facts(heavy)["mass"] == 5.0
    assert facts(heavy)["hover thrust"] / 51.37 == pytest.approx(5.0 / 4.3, rel=1e-3)
    assert heavy.history["wind_e_m_s"].mean() > 2.0


def test_settings_come_from_yaml_and_toml(tmp_path):
    (tmp_path / "a.yaml").write_text("start: [5, 3, 16]\ntarget: [10, 8, 20]\nwind: [0, 0, 1.5]\nmass: 1.1\n")
    (tmp_path / "a.toml").write_text("start = [5, 3, 16]\ntarget = [10, 8, 20]\nwind = [0, 0, 1.5]\nmass = 1.1\n")
    (tmp_path / "empty.yaml").write_text("")
    from_yaml, from_toml = (read_settings(tmp_path / name) for name in ("a.yaml", "a.toml"))
    assert from_yaml == from_toml
    assert read_settings(tmp_path / "empty.yaml") == {}
    outcome = CASES["motion-spatial"].run(from_yaml)
    assert outcome.history[["x_m", "y_m", "z_m"]].iloc[-1].to_numpy() == pytest.approx([10.0, 8.0, 20.0], abs=0.1)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.yaml", "wind: [1, 2", "not well-formed YAML: .*line 1"),
        ("a.toml", "wind = = 3", "not well-formed TOML"),
    ],
)
def test_malformed_files_are_told(name, text, message, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(ParameterError, match=message):
        read_settings(tmp_path / name)


@pytest.mark.parametrize(
    ("case", "changes", "message"),
    [
        ("motion-wind", {"wnd": 3}, r"no setting 'wnd' \(did you mean wind\?\)"),
        ("motion-wind", {"mass": "heavy"}, "mass must be a number, not 'heavy'"),
        ("motion-wind", {"target": "1,2"}, "target must be three numbers"),
        ("octa01_zurich_calm", {"seed": 1.5}, "seed must be a whole number"),
        ("octa01_zurich_calm", {"points": "90000,0,9"}, "within 20 km of the take-off"),
        ("octa01_zurich_calm", {"points": "9000,0,9;0,0,9"}, r"would take \d+ s, and 3600 s are the most"),
        ("octa01_zurich_calm", {"mass": 12}, "12 kg cannot be flown"),
        ("octa01_zurich_calm", {"mass": -1}, "mass must be positive"),
        ("octa01_zurich_calm", {"takeoff": 0}, "take-off height 0 m"),
        ("octa01_zurich_calm", {"latitude": 95}, "below 89 deg"),
        ("octa01_zurich_calm", {"altitude": -1000}, "outside the standard troposphere"),
        ("octa01_zurich_calm", {"wind": -1}, "wind speed"),
        ("octa01_zurich_calm", {"step": 0.1}, r"step 0\.1 s must lie in"),
        ("kim-recovery", {"voltage": 20}, "covers 13 to 16 V"),
        ("guntur-profile", {"motor": "Duracell"}, "no motor called 'Duracell'"),
        ("guntur-profile", {"payload": 2}, r"payload 2 must lie in 0\.\.1"),
    ],
)
def test_settings_that_cannot_be_are_refused(case, changes, message):
    with pytest.raises(ParameterError, match=message):
        CASES[case].run(changes)


def test_unknown_cases_suggest_those_that_look_alike():
    with pytest.raises(ParameterError, match=r"no case called 'motion-winds' \(did you mean motion-wind"):
        find("motion-winds")
    with pytest.raises(ParameterError, match="no case called 'zzz'; `rotorid simulate --list`"):
        find("zzz")


def test_what_diverges_says_when_and_what_does_not_arrive_says_where():
    with pytest.raises(DivergenceError, match=r"at \d+\.\d+ s"):
        CASES["kim-recovery"].run({"height_rate": 3000.0, "duration": 60.0})
    with pytest.raises(ArrivalError, match="did not arrive within 5 s"):
        CASES["motion-spatial"].run({"time_limit": 5})
