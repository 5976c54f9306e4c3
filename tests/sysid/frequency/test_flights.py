"""Chirps, sticks and bad logs of simulated rate loops, whose response is a formula, through the whole chain."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat
from scipy.signal import lfilter

from logparse import FlightLog
from simulation.axis_loop import Shaking, run_axis
from sysid import Experiment, frequency
from sysid.frequency.export import to_control, write
from sysid.frequency.survey import survey
from sysid.frequency.time_domain import UNRELATED, verify
from tests.sysid.axis_flights import CHIRP, GAINS, PLANT, STICKS, flown, logged


@pytest.fixture(scope="module")
def chirped(tmp_path_factory: pytest.TempPathFactory) -> FlightLog:
    return flown(tmp_path_factory.mktemp("chirp"))


@pytest.fixture(scope="module")
def fitted(chirped: FlightLog) -> frequency.FrequencyFit:
    return frequency.fit(frequency.response(chirped, "roll"))


def test_chirp_in_a_closed_loop_with_gusts_gives_the_true_response(chirped: FlightLog) -> None:
    frf = frequency.response(chirped, "roll")
    good = frf.usable & (frf.hz >= 0.5) & (frf.hz <= 15.0)
    error = np.log(frf.response / PLANT.response(frf.hz))[good]
    assert np.mean(good[(frf.hz >= 0.5) & (frf.hz <= 15.0)]) > 0.9
    # 1 dB and 5 deg are what margins are worth.
    assert np.percentile(np.abs(error.real), 95) * 8.686 < 1.0
    assert np.percentile(np.degrees(np.abs(error.imag)), 95) < 5.0
    score = np.sqrt(np.mean(np.abs(error) ** 2 / (2.0 * frf.sigma[good] ** 2)))
    assert 0.4 < score < 1.6


def test_a_chirp_above_half_the_rate_of_rows_does_not_fold_onto_the_response_below(tmp_path: Path) -> None:
    """A chirp to 40 Hz in rows at 25 Hz: swept on beyond 12.5 Hz, it took a third of the gain at 6 Hz."""
    frf = frequency.response(flown(tmp_path, CHIRP, rate=25.0), "roll")
    good = frf.usable & (frf.hz >= 0.6) & (frf.hz <= 8.0)
    error = np.log(frf.response / PLANT.response(frf.hz))[good]
    assert np.mean(good[(frf.hz >= 0.6) & (frf.hz <= 8.0)]) > 0.9
    assert np.max(np.abs(error.real)) * 8.686 < 1.0
    assert np.max(np.degrees(np.abs(error.imag))) < 5.0


def test_plain_regression_is_biased_where_the_instrument_is_not(tmp_path: Path) -> None:
    # Gusts beat the chirp at low frequency: regression finds the controller's inverse, not the craft.
    logs = [flown(tmp_path, replace(CHIRP, gust=5.0), seed) for seed in range(3)]
    frf = frequency.response(logs, "roll")
    low = (frf.hz > 0.7) & (frf.hz < 2.0)
    truth = PLANT.response(frf.hz)
    bias_direct = np.mean(np.log(np.abs(frf.direct / truth))[low])
    bias = np.mean(np.log(np.abs(frf.response / truth))[low])
    assert bias_direct < -0.5
    assert abs(bias) < 3.0 * np.median(frf.sigma[low])


def test_parameters_of_a_chirp(fitted: frequency.FrequencyFit) -> None:
    value = {name: known.value for name, known in fitted.parameters.items()}
    sigma = {name: known.sigma for name, known in fitted.parameters.items()}
    assert fitted.cost < 50.0
    assert value["gain"] == pytest.approx(300.0, rel=0.05)
    assert value["lag"] == pytest.approx(0.03, rel=0.05)
    assert value["delay"] == pytest.approx(PLANT.total_delay, abs=0.005)
    truth = {"gain": 300.0, "lag": 0.03, "delay": PLANT.total_delay, "damping": 2.0}
    assert all(abs(value[name] - true) < 3.0 * sigma[name] for name, true in truth.items())


def test_verification_on_sticks_that_were_not_fitted(fitted: frequency.FrequencyFit, tmp_path: Path) -> None:
    log = flown(tmp_path, STICKS, 5)
    good = verify(fitted, log)
    assert good.theil < 0.3
    wrong = fitted.at(fitted.values * np.where(np.array(fitted.names) == "gain", 3.0, 1.0))
    assert verify(wrong, log).theil > 2.0 * good.theil


def test_a_survey_holds_the_last_part_of_an_only_flight_out(tmp_path: Path) -> None:
    checked = survey(flown(tmp_path, STICKS, 5), ["roll"]).axes[0].check
    assert checked is not None
    assert 30.0 < checked.seconds < 40.0
    assert checked.theil < 0.1
    assert checked.residuals is not None


def test_errors_that_go_with_what_was_asked_are_seen(fitted: frequency.FrequencyFit, tmp_path: Path) -> None:
    """Gusts come back through the controller: held against the command, errors of the right model would go with it."""
    log = flown(tmp_path, replace(STICKS, gust=1.0), 6)
    strong = fitted.at(fitted.values * np.where(np.array(fitted.names) == "gain", 2.0, 1.0))
    assert verify(fitted, log).correlation < UNRELATED < verify(strong, log).correlation


def test_a_fit_to_a_chirp_is_not_judged_by_the_chirp(chirped: FlightLog) -> None:
    # The flight is nothing else, and nobody moved the sticks.
    axis = survey(chirped, ["roll"]).axes[0]
    assert axis.check is None
    assert "hardly moved" in axis.check_reason


def test_a_weak_mode_is_found_among_frequencies_that_count_though_noise_rules_them(tmp_path: Path) -> None:
    """Beyond 17 Hz the chirp is not coherent: chance bends the last frequencies more than the mode bends its own."""
    plant = replace(PLANT, lag=0.048, flex_hz=21.5, flex_damping=0.06, flex_share=0.14, filter_hz=20.0)
    excitation = replace(CHIRP, gust=1.0, noise=0.02)
    fitted = frequency.fit(frequency.response(flown(tmp_path, excitation, 3, plant, rate=400.0), "roll"))
    assert fitted.parameters["mode_frequency"].value == pytest.approx(2.0 * np.pi * 21.5, rel=0.03)
    assert fitted.parameters["mode_damping"].value == pytest.approx(0.06, rel=0.2)
    assert np.min(np.abs(np.abs(fitted.transfer_function().poles) - 2.0 * np.pi * 21.5)) < 4.0
    assert fitted.transfer_function().state_space[0].shape == (4, 4)


def test_the_moment_that_air_makes_with_speed_is_told_from_inertia() -> None:
    """Of a light craft most of the slow command works against the air: without it in the structure nothing fits."""
    rng = np.random.default_rng(8)
    t = np.arange(12000) * 0.01
    state, rates = np.zeros(3), np.zeros(len(t))
    u = lfilter([0.03], [1.0, -0.97], rng.normal(0.0, 0.02, len(t)))
    for k in range(1, len(t)):  # rate, tilt and speed, held steady by what a pilot would do
        u[k] -= 0.02 * state[0] + 0.1 * state[1] + 0.02 * state[2]
        w, tilt, speed = state
        state = state + 0.01 * np.array([400.0 * u[k] - 2.0 * w - 22.0 * speed, w, 9.8 * tilt])
        rates[k] = state[0]
    data = Experiment.from_arrays(t, u, rates, input_names=["roll"], output_names=["w_x"])
    fitted = frequency.fit(frequency.response([data], "roll"), band=(0.1, 8.0))
    assert fitted.structure[0].name == "rate, speed"
    assert fitted.parameters["gain"].value == pytest.approx(400.0, rel=0.05)
    assert fitted.parameters["speed_moment"].value == pytest.approx(22.0 * 9.8, rel=0.1)


@pytest.mark.slow
def test_several_axes_share_lag_and_delay(tmp_path: Path) -> None:
    runs = {
        name: run_axis(
            replace(PLANT, gain=gain),
            GAINS,
            replace(CHIRP, duration=80.0, chirp_start=start, sid_axis=axis),
            axis,
        )
        for name, gain, start, axis in (("roll", 300.0, 0.0, 10), ("pitch", 250.0, 40.0, 11))
    }
    log = logged(tmp_path, runs)
    joint = frequency.fit([frequency.response(log, axis) for axis in ("roll", "pitch")])
    assert joint.parameters["lag"].value == pytest.approx(0.03, rel=0.05)
    assert joint.parameters["roll.gain"].value == pytest.approx(300.0, rel=0.05)
    assert joint.parameters["pitch.gain"].value == pytest.approx(250.0, rel=0.05)


class TestBadInput:
    def test_an_axis_of_which_nothing_was_asked_is_refused_though_gusts_move_it(self, tmp_path: Path) -> None:
        # The rate target answers gusts and would make a coherent instrument of minus the controller's inverse.
        log = flown(tmp_path, Shaking(duration=60.0, gust=2.0, noise=0.01))
        with pytest.raises(frequency.FrequencyError, match="nothing was asked of this axis"):
            frequency.response(log, "roll")

    def test_ten_hertz_is_said_to_fold(self, tmp_path: Path) -> None:
        frf = frequency.response(flown(tmp_path, CHIRP, rate=10.0), "roll")
        assert any(f.id == "not-logged" and "fold" in f.reason for f in frf.findings)
        assert frf.hz[-1] <= 4.5

    def test_an_unknown_axis_is_named(self, chirped: FlightLog) -> None:
        with pytest.raises(frequency.FrequencyError, match="the axes are roll, pitch, yaw, vertical"):
            frequency.response(chirped, "rol")


def test_files_for_other_tools(chirped: FlightLog, tmp_path: Path) -> None:
    control = pytest.importorskip("control")
    surveyed = survey(chirped, ["roll"])
    frf, fit = surveyed.axes[0].response, surveyed.axes[0].fit
    assert frf is not None
    assert fit is not None
    write(surveyed, tmp_path)
    table = pd.read_csv(tmp_path / "frequency_roll.csv", index_col="hz")
    np.testing.assert_allclose(table["real"] + 1j * table["imag"], frf.response)
    np.testing.assert_allclose(table["gain_db"], 20.0 * np.log10(np.abs(frf.response)))
    np.testing.assert_allclose(np.radians(table["phase_deg"]), np.unwrap(np.angle(frf.response)))
    kept = loadmat(tmp_path / "frequency.mat", squeeze_me=True, struct_as_record=False)["roll"]
    np.testing.assert_allclose(kept.hz, frf.hz)
    np.testing.assert_allclose(kept.response, frf.response)
    assert kept.gyro_filter_hz == frf.gyro_filter_hz
    measured, modelled = to_control(frf), to_control(fit)
    assert isinstance(measured, control.FRD)
    hz = 2.0
    without_filter = fit.structure[0].response(fit.values, np.array([hz]))[0]
    assert abs(modelled(2j * np.pi * hz)) == pytest.approx(abs(without_filter), rel=0.02)
