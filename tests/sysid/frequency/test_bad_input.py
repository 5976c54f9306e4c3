"""Flights that look good and are not: what can be had of them, and for the rest why not and what to fly."""

import json
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import logparse
from rotorid.cli.main import app
from simulation.axis_loop import AxisPlant, LoopGains, Shaking, run_axis
from sysid import frequency
from sysid.frequency.records import on_uniform_clock
from sysid.frequency.survey import survey
from sysid.frequency.time_domain import largest_correlation
from tests.sysid.axis_flights import CHIRP, GAINS, PLANT, flown, logged


def worst(frf: frequency.FrequencyResponse, plant: AxisPlant = PLANT, low: float = 0.6, high: float = 15.0) -> float:
    """Return the 95th percentile of the gain's error where it is coherent, dB."""
    good = frf.usable & (frf.hz > low) & (frf.hz < high)
    assert good.sum() > 10
    return float(np.percentile(8.686 * np.abs(np.log(np.abs(frf.response / plant.response(frf.hz))[good])), 95))


@pytest.mark.parametrize("sid_axis", [1, 16])
def test_chirps_before_the_controller_are_instruments_as_well(tmp_path: Path, sid_axis: int) -> None:
    # On angle targets, rate targets, and lateral position and velocity: all turn the craft about roll.
    shaken = replace(CHIRP, sid_axis=7, chirp=(0.4, 15.0, 0.8))
    run = replace(run_axis(PLANT, GAINS, shaken, 2), excitation=replace(shaken, sid_axis=sid_axis))
    log = logged(tmp_path, run)
    assert [(chirp.axis, chirp.at_mixer) for chirp in frequency.find_chirps(log)] == [("roll", False)]
    frf = frequency.response(log, "roll")
    assert frf.instrument == f"chirp of SID_AXIS {sid_axis}"
    assert worst(frf, high=8.0) < 1.0


def test_chirps_on_a_place_that_is_held_are_instruments_as_well(tmp_path: Path) -> None:
    """In position loop: the chirp goes through position, velocity and angle controllers, and gusts come back."""
    holding = replace(GAINS, position_P=1.0, velocity_P=2.0)
    shaken = replace(CHIRP, duration=70.0, sid_axis=14, chirp=(0.1, 4.0, 4.0), chirp_seconds=69.0)
    frf = frequency.response(logged(tmp_path, run_axis(PLANT, holding, shaken, 2)), "roll")
    assert frf.instrument == "chirp of SID_AXIS 14"
    assert worst(frf, low=0.4, high=3.5) < 1.0


def test_an_excitation_of_unknown_frequency_is_an_instrument_too(tmp_path: Path) -> None:
    """Autotuning of PX4 logs what it adds to the rate target, ten times a second, and not its frequency."""
    run = run_axis(PLANT, GAINS, replace(CHIRP, sid_axis=7, chirp=(0.4, 4.0, 0.8)), 2)
    log = logged(tmp_path, run)
    rows = log.messages["SIDD"]
    kept = rows.iloc[::10].assign(F=np.nan)
    log.messages.replace("SIDD", kept)
    frf = frequency.response(log, "roll")
    assert frf.instrument == "chirp of SID_AXIS 7"
    assert worst(frf, high=4.0) < 1.0


def test_a_chirp_aborted_after_five_seconds_is_too_short_and_says_so(tmp_path: Path) -> None:
    run = run_axis(PLANT, GAINS, replace(CHIRP, duration=8.0, chirp=(0.5, 40.0, 0.1), chirp_seconds=20.0), 1)
    cut = 5 * 400
    stopped = replace(run, chirp_hz=np.where(run.elapsed < 5.0, run.chirp_hz, 0.0))
    names = [field.name for field in fields(stopped) if field.name != "excitation"]
    stopped = replace(stopped, **{name: getattr(stopped, name)[:cut] for name in names})
    axis = survey(logged(tmp_path, stopped), ["roll"]).axes[0]
    assert axis.response is None
    assert "was aborted after 5.0 s at 0.66 Hz" in axis.reason
    assert "for 20 s at least" in axis.reason


def test_chirps_on_two_axes_at_once_are_told_apart(tmp_path: Path) -> None:
    """Both sweep the same band; ten seconds apart, they are at different frequencies at any time."""
    pitch = replace(PLANT, gain=200.0)
    runs = {
        "roll": run_axis(PLANT, GAINS, replace(CHIRP, duration=60.0), 1),
        "pitch": run_axis(pitch, GAINS, replace(CHIRP, duration=60.0, sid_axis=11, chirp_start=10.0), 2),
    }
    log = logged(tmp_path, runs)
    roll, pitched = survey(log, ["roll", "pitch"]).axes
    # SYSTEMID logs one chirp at a time: that of roll ends where that of pitch begins, too soon for a fit.
    assert roll.response is not None
    assert "not-determined" in {finding.id for finding in roll.response.findings}
    assert roll.fit is None
    assert "fly a chirp" in roll.reason
    assert pitched.fit is not None
    assert pitched.fit.parameters["gain"].value == pytest.approx(pitch.gain, rel=0.03)


def test_an_aborted_chirp_leaves_the_sticks_of_its_flight_to_speak(tmp_path: Path) -> None:
    shaken = replace(CHIRP, duration=60.0, chirp=(0.5, 40.0, 0.05), chirp_seconds=4.9, chirp_start=50.0, stick=0.2)
    run = run_axis(PLANT, GAINS, shaken, 3)
    frf = frequency.response(logged(tmp_path, replace(run, chirp_hz=np.minimum(run.chirp_hz, 0.55))), "roll")
    assert frf.instrument == "roll target"
    assert "not-determined" in {finding.id for finding in frf.findings}
    assert frequency.fit(frf).parameters["gain"].value == pytest.approx(PLANT.gain, rel=0.1)


def with_rows_lost(folder: Path, lost: Callable[[np.ndarray], np.ndarray]) -> logparse.FlightLog:
    """Return a log with a chirp whose RATE has lost some rows, by their times."""
    log = flown(folder, seed=6)
    rows = log.messages["RATE"]
    log.messages.replace("RATE", rows[~lost(rows.index.to_numpy())])
    return log


def one_by_one(part: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: np.random.default_rng(3).random(len(t)) < part


def test_rows_lost_one_by_one_leave_a_chirp_right_up_to_a_third(tmp_path: Path) -> None:
    """Taken from the same rows, the instrument shared their gaps: one firmware chirp became 16 % too strong."""
    frf = frequency.response(with_rows_lost(tmp_path, one_by_one(0.15)), "roll")
    assert frequency.fit(frf).parameters["gain"].value == pytest.approx(PLANT.gain, rel=0.05)
    with pytest.raises(frequency.FrequencyError, match="% of the rows are lost one by one"):
        frequency.response(with_rows_lost(tmp_path, one_by_one(0.35)), "roll")


def test_half_of_a_chirp_lost_gives_what_is_left(tmp_path: Path) -> None:
    log = with_rows_lost(tmp_path, lambda t: (t >= 22.0) & (t <= 35.0))
    assert worst(frequency.response(log, "roll")) < 1.0


def test_a_rate_with_the_wrong_sign_is_named(tmp_path: Path) -> None:
    run = run_axis(PLANT, GAINS, CHIRP, 6)
    frf = frequency.response(logged(tmp_path, replace(run, measured=-run.measured)), "roll")
    assert "motor-order" in {finding.id for finding in frf.findings}
    assert frequency.fit(frf).cost < 50.0


def test_every_power_up_of_a_file_counts(tmp_path: Path) -> None:
    """Roll is flown in the first, pitch in the second; nobody yaws, which is said of the file once."""
    chirps = {"roll": CHIRP, "pitch": replace(CHIRP, sid_axis=11)}
    logs = [logged(tmp_path, {a: run_axis(PLANT, GAINS, chirp, k)}) for k, (a, chirp) in enumerate(chirps.items())]
    (tmp_path / "both.BIN").write_bytes(b"".join(log.path.read_bytes() for log in logs))
    done = CliRunner().invoke(app, ["frequency", str(tmp_path / "both.BIN"), "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    answer = json.loads((tmp_path / "frequency.json").read_text())
    gains = [axis["fit"]["parameters"]["gain"]["value"] for axis in answer["axes"] if "fit" in axis]
    assert gains == pytest.approx([300.0, 300.0], rel=0.03)
    assert done.output.count("the yaw target hardly moved, nothing was asked") == 1


def test_rows_in_which_the_command_folds_judge_no_model(tmp_path: Path) -> None:
    # The gain is right, by the instrument; a prediction from aliases is wrong whatever the model is.
    sticks = Shaking(duration=120.0, stick=0.3, gust=0.1, noise=0.003)
    slow = replace(PLANT, gain=100.0, lag=0.1)
    run = run_axis(slow, LoopGains.crossing_at(slow, 0.8), sticks, 3)
    axis = survey(logged(tmp_path, run, rate=10.0), ["roll"]).axes[0]
    assert axis.fit is not None
    assert axis.check is None
    assert "aliases" in axis.check_reason or axis.fit.parameters["gain"].value is None


def test_motors_at_their_limits_are_said(tmp_path: Path) -> None:
    strong = replace(CHIRP, chirp=(0.4, 25.0, 0.6), sid_axis=10)
    gains = replace(GAINS, limit=1.0)
    motors = {"rcou": 50.0, "imu": 100.0}
    frf = frequency.response(logged(tmp_path, run_axis(PLANT, gains, strong, 5), motors=motors), "roll")
    assert "motors-at-limits" in {finding.id for finding in frf.findings}
    frf = frequency.response(logged(tmp_path, run_axis(PLANT, gains, strong, 5)), "roll")
    said = [f.reason for f in frf.findings if f.id == "not-logged"]
    assert any("limits" in reason for reason in said), "without RCOU nothing shows it"


def test_logs_of_two_craft_are_not_summed_unnoticed(tmp_path: Path) -> None:
    logs = [
        logged(tmp_path, run_axis(replace(PLANT, gain=gain), GAINS, CHIRP, k))
        for k, gain in enumerate((300.0, 300.0, 220.0))
    ]
    assert survey(logs[:2], ["roll"]).findings == ()
    (finding,) = survey(logs[1:], ["roll"]).findings
    assert finding.id == "flights-not-alike"


def test_a_held_out_piece_of_two_samples_has_a_correlation() -> None:
    """A damaged log left so little of one of its records; lags of half a second reached beyond it."""
    error, command = np.array([1.0, -1.0]), np.array([0.5, 1.0])
    correlation = largest_correlation(error, command, SimpleNamespace(dt=0.01))  # type: ignore[arg-type]
    assert 0.0 < correlation < 2.0


@pytest.mark.filterwarnings("error")
def test_samples_of_one_time_are_one_sample() -> None:
    t = np.arange(50) * 0.01
    repeated = np.repeat(t, 2)
    clock, values, usable = on_uniform_clock(repeated, [np.sin(repeated)])
    assert usable.all()
    assert values[:, 0] == pytest.approx(np.sin(clock), abs=1e-6)
