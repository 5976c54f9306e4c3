"""The rate controller's responses against the recursion, and the recursion against firmware's logged terms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from sysid.loops import RateController, read_settings


def run(c: RateController, target: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Run the recursion of AC_PID loop by loop; P, I, D, FF and DFF of each, shape (N, 5)."""
    dt = 1.0 / c.loop_rate

    def alpha(hz: float) -> float:
        return dt / (dt + 1.0 / (2.0 * np.pi * hz)) if hz > 0.0 else 1.0

    filtered = error = derivative = integral = 0.0
    terms = np.zeros((len(target), 5))
    for k in range(len(target)):
        before_target, before = filtered, error
        filtered += alpha(c.FLTT) * (target[k] - filtered)
        error += alpha(c.FLTE) * (filtered - rate[k] - error)
        slope, rise = ((error - before) / dt, (filtered - before_target) / dt) if k else (0.0, 0.0)
        derivative += alpha(c.FLTD) * (slope - derivative)
        integral = min(max(integral + c.I * error * dt, -c.IMAX), c.IMAX)
        terms[k] = c.P * error, integral, c.D * derivative, c.FF * filtered, c.D_FF * rise
    return terms


@pytest.mark.parametrize("hz", [3.0, 11.0, 40.0])
def test_responses_agree_with_running(hz):
    """A sine through the recursion, after it has settled, has the gain and phase of the response."""
    c = RateController(P=0.1, I=0.3, D=0.004, FF=0.01, D_FF=0.001, FLTT=30.0, FLTE=25.0, FLTD=20.0, IMAX=10.0)
    n = 16000  # whole cycles of every frequency
    t = np.arange(n) / 400.0
    wave = np.sin(2.0 * np.pi * hz * t)
    half = slice(n // 2, n)

    def line(u):
        return 2.0 * np.mean((u[half] - np.mean(u[half])) * np.exp(-2j * np.pi * hz * t[half])) / -1j

    to_rate = line(run(c, np.zeros(n), wave).sum(axis=1))
    assert to_rate == pytest.approx(-c.error_response(np.array([hz]))[0], rel=2e-3)
    to_target = line(run(c, wave, np.zeros(n)).sum(axis=1))
    assert to_target == pytest.approx(c.target_response(np.array([hz]))[0], rel=2e-3)


@pytest.fixture(scope="module")
def firmware_log(flown):
    return flown("quad15_id")


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "message"), [("roll", "PIDR"), ("pitch", "PIDP")])
def test_firmware_logs_the_same_terms(firmware_log, axis, message):
    """P to the log's rounding; I and D as far as rows at a quarter of the loop rate let the error be interpolated.

    The error at 400 Hz is a spline through every fourth sample: up to 15 Hz, within the first half of the chirp, that
    is good to 1 %; rows just after take-off are left out, as integrators start there.
    """
    frame = firmware_log.messages[message]
    chirps = firmware_log.messages["SIDS"]
    start = float(chirps.index[chirps["Ax"] == (10 if axis == "roll" else 11)][0])
    frame = frame[(frame.index > start + 1.0) & (frame.index < start + 17.0)]
    c = read_settings(firmware_log, axis).controller
    np.testing.assert_allclose(frame["P"], np.float32(c.P) * frame["Err"], rtol=2e-6, atol=1e-9)

    loops = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(frame.index) * c.loop_rate))])
    every = np.arange(int(loops[-1]) + 1)
    error, target = (make_interp_spline(loops, frame[name].to_numpy(float), k=5)(every) for name in ("Err", "Tar"))
    terms = run(replace(c, FLTT=0.0, FLTE=0.0), target, target - error)  # logged behind their filters
    at = loops.astype(int)
    for column, name, tolerance in ((1, "I", 0.01), (2, "D", 0.03)):
        logged = frame[name].to_numpy(float)[100:]
        own = terms[at, column][100:]
        own = own - own[0] + logged[0] if name == "I" else own
        assert np.std(own - logged) < tolerance * np.std(logged), name
