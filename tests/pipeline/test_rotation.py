"""What one flight tells of how its craft turns and shakes: margins by their numbers, lines by their rotors."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import logparse
from logparse import Tables
from pipeline.flight.next_flights import for_flight
from pipeline.flight.rotation import find_rotation
from pipeline.flight.spectrum import vibration_spectrum
from pipeline.results.failure import Failure
from pipeline.results.rotation import LoopState, state_of
from pipeline.results.span import Span
from reports.figures.signals import peaks_in_words
from tests.paths import REAL
from tests.pipeline.builders import margins, turning
from tests.reports.conftest import made_flight
from tests.timed import inertial

SQUARE = "sample_logs/octa08_denver_square.bin"


@pytest.mark.parametrize(
    ("computed", "state"),
    [
        (margins(9.0, 60.0), LoopState.GOOD),
        (margins(5.9, 60.0), LoopState.THIN),
        (margins(9.0, 44.0), LoopState.THIN),
        (margins(None, 44.0), LoopState.THIN),
        (margins(None, 60.0), LoopState.UNKNOWN),
        (margins(9.0, 60.0, stable=False), LoopState.UNSTABLE),
        # Stable at the best estimate, unstable for a fifth of what the data leave possible: not to be relied on.
        (margins(9.0, 60.0, unstable=0.2), LoopState.THIN),
    ],
)
def test_margins_are_judged_by_their_numbers(computed, state):
    assert state_of(computed) is state


def test_an_ordinary_flight_tells_roll_and_pitch_and_why_not_yaw():
    log = logparse.read_log(SQUARE)
    rotation, _ = find_rotation(log, Span(log.flight.start, log.flight.stop))
    axes = {axis.axis: axis for axis in rotation.axes}
    assert axes["roll"].determined
    assert axes["pitch"].determined
    assert not axes["yaw"].determined
    assert "short stick inputs" in axes["yaw"].reason
    assert all("SYSTEMID" in axis.loop_reason for axis in rotation.axes)


def test_only_the_sound_part_counts():
    log = logparse.read_log(SQUARE)
    start, stop = log.flight.start, log.flight.start + 40.0
    rotation, _ = find_rotation(log, Span(start, stop))
    for axis in rotation.axes:
        if axis.rate is not None:
            assert axis.rate.seconds <= stop - start
    short, _ = find_rotation(log, Span(start, start + 5.0))
    assert not short.determined
    assert all("s in the air" in axis.reason for axis in short.axes)


def test_advice_names_bits_and_axes():
    flight = replace(made_flight("a", seed=1, fit=False), rotation=turning(margins(9.0, 60.0)))
    advice = {item.id: item for item in for_flight(flight)}
    assert "SID_AXIS 11 for pitch and 12 for yaw" in advice["chirps-for-margins"].do
    assert "bit 12 (PID)" in advice["chirps-for-margins"].do
    without = for_flight(replace(flight, rotation=Failure("rotation", "no rates")))
    assert "chirps-for-margins" not in {item.id for item in without}


@pytest.mark.parametrize(
    ("gain", "phase", "state"),
    [
        ((6.5, 9.0), (46.0, 60.0), LoopState.GOOD),
        ((5.0, 9.0), (46.0, 60.0), LoopState.UNKNOWN),
        ((3.0, 5.5), (40.0, 60.0), LoopState.THIN),
        (None, (46.0, 60.0), LoopState.UNKNOWN),
    ],
)
def test_margins_of_ordinary_flying_say_only_what_the_whole_interval_says(gain, phase, state):
    bounds = {name: bound for name, bound in (("gain_db", gain), ("phase_deg", phase)) if bound is not None}
    computed = replace(margins(7.0, 50.0), intervals=bounds)
    assert state_of(computed, ordinary=True) is state


def test_firmware_without_the_mode_is_not_told_to_fly_it(monkeypatch):
    log = logparse.read_log(SQUARE)
    monkeypatch.setitem(vars(log), "vehicle", replace(log.vehicle, firmware="ArduCopter", version="3.3-dev"))
    rotation, _ = find_rotation(log, Span(log.flight.start, log.flight.stop))
    assert all("3.3-dev" in axis.loop_reason and "SYSTEMID" not in axis.loop_reason for axis in rotation.axes)


FLIGHT = Span(0.0, 60.0)
NOTCH = {"INS_HNTCH_ENABLE": 1.0, "INS_HNTCH_FREQ": 80.0, "INS_HNTCH_BW": 40.0, "INS_HNTCH_HMNCS": 3.0}


def flown(*lines: float, swing: float = 0.0, frame: float = 0.0, esc: bool = False) -> Tables:
    """Turn the rotors at 80 Hz, more or less with the outputs by `swing`; shake at multiples, and at `frame` Hz."""
    random = np.random.default_rng(1)
    t = np.arange(0.0, 60.0, 1.0 / 400.0)
    part = np.sin(2.0 * np.pi * 0.05 * t)
    rotor = 80.0 * (1.0 + swing * part)
    angle = 2.0 * np.pi * np.cumsum(rotor) / 400.0
    gyro = random.normal(0.0, 0.02, (len(t), 3))
    gyro[:, 0] += sum((0.1 * np.sin(multiple * angle) for multiple in lines), np.zeros(len(t)))
    gyro[:, 1] += 0.1 * np.sin(2.0 * np.pi * frame * t) if frame else 0.0
    imu = inertial(t, gyro, np.zeros_like(gyro))
    motors = pd.DataFrame({f"m{k}": 1500.0 + 200.0 * swing * part[::40] for k in (1, 2)}, index=imu.index[::40])
    speeds = pd.DataFrame({f"w{k}": 2.0 * np.pi * rotor[::8] for k in (1, 2)}, index=imu.index[::8])
    return Tables(imu=imu, motors=motors, esc=speeds if esc else None)


def test_lines_at_the_rotors_speed_and_its_multiples_are_theirs():
    spectrum = vibration_spectrum(flown(1.0, 2.0, frame=130.0, esc=True), FLIGHT, NOTCH | {"INS_HNTCH_HMNCS": 1.0})
    peaks = {round(peak.hz): (peak.rotor_multiple, peak.notch) for peak in spectrum.peaks}
    assert peaks == {80: (1, "INS_HNTCH"), 160: (2, ""), 130: (0, "")}
    text = peaks_in_words(spectrum)
    assert "160 Hz (rotors × 2)" in text
    assert "No notch covers 160 Hz." in text
    assert "Lines at 130 Hz, " in text


def test_without_telemetry_a_line_that_goes_with_the_outputs_is_the_rotors():
    moving = vibration_spectrum(flown(1.0, swing=0.15), FLIGHT, {})
    still = vibration_spectrum(flown(frame=90.0, swing=0.15), FLIGHT, {})
    assert all(peak.rotor_multiple == 1 for peak in moving.peaks if 68.0 <= peak.hz <= 92.0)
    assert [peak.rotor_multiple for peak in still.peaks] == [0]


def test_notches_reach_as_far_as_their_bandwidth_and_harmonics_say():
    notches = {notch.name: (notch.low, notch.high) for notch in vibration_spectrum(flown(), FLIGHT, NOTCH).notches}
    assert notches["INS_HNTCH"] == pytest.approx((60.0, 100.0))
    assert notches["INS_HNTCH × 2"] == pytest.approx((120.0, 200.0))


def test_a_notch_on_esc_telemetry_follows_the_rotors_from_its_frequency_on():
    by_esc = NOTCH | {"INS_HNTCH_MODE": 3.0, "INS_HNTCH_REF": 1.0}
    for lowest, bandwidth in ((80.0, 40.0), (60.0, 30.0)):
        parameters = by_esc | {"INS_HNTCH_FREQ": lowest, "INS_HNTCH_BW": bandwidth}
        followed = vibration_spectrum(flown(1.0, swing=0.1, esc=True), FLIGHT, parameters)
        low, high = followed.rotors_hz
        assert 60.0 < low < 80.0 < high
        assert followed.notches[0].low == pytest.approx(0.75 * max(low, lowest))
        assert followed.notches[0].high == pytest.approx(1.25 * high)


def test_quiet_flights_name_no_line():
    spectrum = vibration_spectrum(flown(), FLIGHT, {})
    assert spectrum.peaks == ()
    assert peaks_in_words(spectrum) == "No line stands out."


@pytest.mark.skipif(not REAL.is_dir(), reason="shared logs are not here")
def test_bursts_of_a_real_log_show_its_rotors():
    """Its bursts were timed by microseconds taken for seconds, so that none lay in the flight."""
    (path,) = REAL.glob("pypi-mavparser*.BIN")
    log = logparse.read_log(path)
    spectrum = vibration_spectrum(log.tables, Span(log.flight.start, log.flight.stop), log.parameters)
    assert "bursts at 6407 Hz" in spectrum.source
    assert spectrum.peaks[0].hz == pytest.approx(122.0, abs=10.0)
    assert spectrum.peaks[0].notch == "INS_HNTCH × 2"
