"""What one flight tells of how its craft turns: margins judged by their numbers, kept, and never an error."""

from dataclasses import replace

import numpy as np
import pytest

import logparse
from pipeline.flight.advice.turning import turning as advise
from pipeline.flight.rotation import find_rotation
from pipeline.results.flight import Span
from pipeline.results.rotation import AxisRotation, FittedResponse, LoopMargins, LoopState, RotationResult
from pipeline.storage.kept import read_result, write_result
from pipeline.storage.store import FolderStore
from sysid.frequency.response import FrequencyResponse
from sysid.loops.loop import Margins
from sysid.statistics.parameter import Parameter
from tests.reports.conftest import made_flight

SQUARE = "sample_logs/octa08_denver_square.bin"


def margins(gain: float | None, phase: float | None, *, stable: bool = True, unstable: float = 0.0) -> Margins:
    def known(value: float | None, unit: str) -> Parameter:
        return Parameter(value, None if value is None else 0.1, unit, "" if value is not None else "beyond the band")

    return Margins(
        gain_db=known(gain, "dB"),
        phase_deg=known(phase, "deg"),
        crossover_hz=known(5.0, "Hz"),
        rejection_hz=known(2.0, "Hz"),
        peak_db=known(4.0, "dB"),
        intervals={"gain_db": (5.0, 7.0)},
        stable=stable,
        unstable=unstable,
    )


def turning(computed: Margins) -> RotationResult:
    """Make what a chirp of the roll axis tells: 100 rad/s^2 through an integrator with a delay of 10 ms."""
    hz = np.geomspace(0.5, 20.0, 40)
    s = 2j * np.pi * hz
    response = 100.0 / s * np.exp(-0.01 * s)
    ones = np.ones(len(hz))
    frf = FrequencyResponse(
        axis="roll",
        input="out_roll",
        output="w_x",
        unit="rad/s",
        hz=hz,
        response=response,
        coherence=0.9 * ones,
        sigma=0.05 * ones,
        sigma_phase=0.05 * ones,
        averages=20.0 * ones,
        resolution=0.5 * ones,
        multiple_coherence=0.9 * ones,
        method="instrument",
        instrument="chirp",
        direct=response,
        step=0.0025,
        duration=20.0,
    )
    rate = FittedResponse(
        measured=frf,
        model=response,
        structure="rate",
        parameters={"gain": Parameter(100.0, 2.0, "rad/s^2"), "delay": Parameter(0.01, 0.001, "s")},
        insensitivity={"gain": 0.01, "delay": 0.02},
        cost=3.0,
        verdict="excellent",
    )
    roll = AxisRotation(axis="roll", rate=rate, loop=LoopMargins(gains={"ATC_RAT_RLL_P": 0.1}, computed=computed))
    others = (AxisRotation(axis=axis, reason="nothing moved", loop_reason="no chirp") for axis in ("pitch", "yaw"))
    return RotationResult(axes=(roll, *others))


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
    assert LoopMargins(gains={}, computed=computed).state is state


def test_a_kept_result_has_its_responses(tmp_path):
    flight = replace(made_flight("a", seed=1, fit=False), rotation=turning(margins(9.0, 60.0)))
    write_result(flight, tmp_path)
    found = read_result(FolderStore(tmp_path.parent), tmp_path.name)
    assert found.rotation.to_dict() == flight.rotation.to_dict()


def test_an_ordinary_flight_tells_roll_and_pitch_and_why_not_yaw():
    log = logparse.read_log(SQUARE)
    found = find_rotation(log, Span(log.flight.start, log.flight.stop))
    axes = {axis.axis: axis for axis in found.axes}
    assert axes["roll"].determined
    assert axes["pitch"].determined
    assert not axes["yaw"].determined
    assert "short stick inputs" in axes["yaw"].reason
    assert all("SYSTEMID" in axis.loop_reason for axis in found.axes)


def test_only_the_sound_part_counts():
    log = logparse.read_log(SQUARE)
    start, stop = log.flight.start, log.flight.start + 40.0
    found = find_rotation(log, Span(start, stop))
    for axis in found.axes:
        if axis.rate is not None:
            assert axis.rate.measured.duration <= stop - start
    short = find_rotation(log, Span(start, start + 5.0))
    assert not short.determined
    assert all("s in the air" in axis.reason for axis in short.axes)


def test_advice_names_bits_and_axes():
    flight = replace(made_flight("a", seed=1, fit=False), rotation=turning(margins(9.0, 60.0)))
    advice = {each.id: each for each in advise(flight, [])}
    assert "pitch and yaw" in advice["fly-sticks"].do
    assert "bit 0 (ATTITUDE_FAST) of LOG_BITMASK" in advice["fly-sticks"].do
    assert "SID_AXIS 11 for pitch and 12 for yaw" in advice["chirps-for-margins"].do
    assert "bit 12 (PID)" in advice["chirps-for-margins"].do
    # Asked for once, not twice.
    assert "fly-sticks" not in {each.id for each in advise(flight, ["excite-axes"])}
    assert list(advise(replace(flight, rotation=None), [])) == []


def test_firmware_without_the_mode_is_not_told_to_fly_it(monkeypatch):
    log = logparse.read_log(SQUARE)
    monkeypatch.setitem(vars(log), "vehicle", replace(log.vehicle, firmware="ArduCopter", version="3.3-dev"))
    found = find_rotation(log, Span(log.flight.start, log.flight.stop))
    assert all("3.3-dev" in axis.loop_reason and "SYSTEMID" not in axis.loop_reason for axis in found.axes)
