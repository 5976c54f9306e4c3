"""The rate controller against an independent recursion, its own response, and firmware's logged terms."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from sysid.loops import RateController, read_settings


def _controller() -> RateController:
    return RateController(P=0.135, I=0.09, D=0.0036, FF=0.02, D_FF=0.001, FLTT=20.0, FLTE=15.0, FLTD=10.0, IMAX=0.5)


def test_terms_are_those_of_the_recursion_written_out():
    c = _controller()
    rng = np.random.default_rng(3)
    target, rate = rng.normal(0.0, 1.0, (2, 300))
    terms = c.run(target, rate)

    dt = 1.0 / 400.0

    def alpha(hz: float) -> float:
        return dt / (dt + 1.0 / (2.0 * np.pi * hz))

    filtered = error = derivative = integral = 0.0
    for k in range(300):
        before_target, before = filtered, error
        filtered += alpha(20.0) * (target[k] - filtered)
        error += alpha(15.0) * (filtered - rate[k] - error)
        slope = 0.0 if k == 0 else (error - before) / dt
        derivative += alpha(10.0) * (slope - derivative)
        integral = np.clip(integral + c.I * error * dt, -0.5, 0.5)
        expected = (c.P * error, integral, c.D * derivative, c.FF * filtered)
        got = (terms.P[k], terms.I[k], terms.D[k], terms.FF[k])
        assert got == pytest.approx(expected, abs=1e-12)
        if k:
            assert terms.DFF[k] == pytest.approx(c.D_FF * (filtered - before_target) / dt, abs=1e-12)


@pytest.mark.parametrize("hz", [3.0, 11.0, 40.0])
def test_responses_agree_with_running(hz):
    """A sine through the recursion, after it has settled, has the gain and phase of the response."""
    c = RateController(P=0.1, I=0.3, D=0.004, FF=0.01, FLTT=30.0, FLTE=25.0, FLTD=20.0, IMAX=10.0)
    n = 16000  # whole cycles of every frequency
    t = np.arange(n) / 400.0
    wave = np.sin(2.0 * np.pi * hz * t)
    half = slice(n // 2, n)

    def line(u):
        return 2.0 * np.mean((u[half] - np.mean(u[half])) * np.exp(-2j * np.pi * hz * t[half])) / -1j

    to_rate = line(c.run(np.zeros(n), wave).total)
    assert to_rate == pytest.approx(-c.error_response(np.array([hz]))[0], rel=2e-3)
    to_target = line(c.run(wave, np.zeros(n)).total)
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
    terms = c.run_error(error, target)
    at = loops.astype(int)
    for name, tolerance in (("I", 0.01), ("D", 0.03)):
        logged = frame[name].to_numpy(float)[100:]
        own = getattr(terms, name)[at][100:]
        own = own - own[0] + logged[0] if name == "I" else own
        assert np.std(own - logged) < tolerance * np.std(logged), name
