"""Input sets and frames, what is said of inputs before anything is fitted, and coherence against its definition."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from logparse import Geodetic, MissingDataError, Tables, Vehicle
from logparse.craft.frames import motor_table
from logparse.tables import COLUMNS
from sysid import Experiment
from sysid.records.excitation import coherence, examine
from tests.sysid.flights import made
from tests.sysid.simulated import motion
from tests.timed import timed

T = np.arange(0.0, 60.0, 0.1)


def rates(t=T, **columns):
    zero = np.zeros_like(t)
    return timed(t, **(dict.fromkeys(COLUMNS["rates"], zero) | columns))


def setpoints(t=T, **columns):
    nothing = np.full_like(t, np.nan)
    return timed(t, **(dict.fromkeys(COLUMNS["setpoints"], nothing) | columns))


def path(t):
    return 20.0 * np.sin(0.2 * t)


def level(height):
    return lambda t: np.full_like(t, height)


def hold(t=T, ahead=0.0):
    return setpoints(t, p_n=path(t) + ahead, p_e=np.zeros_like(t), p_d=np.full_like(t, -10.0))


def test_rate_outputs_are_those_of_the_controller():
    tables = Tables(rates=rates(out_roll=0.01 * T, out_pitch=-0.02 * T, out_yaw=0.03 * T, out_thrust=0.3 + 0.001 * T))
    record = Experiment.from_flight(*made(tables), inputs="rate_outputs")
    assert record.input_names == ("roll", "pitch", "yaw", "throttle")
    np.testing.assert_allclose(record.u[0], [0.1, -0.2, 0.3, 0.31], atol=1e-12)
    assert record.output_names == ("x", "y", "z")


def test_rotor_speeds_are_those_that_escs_report():
    speeds = {f"w{k}": 600.0 + k + 0.1 * T for k in range(1, 5)}
    record = Experiment.from_flight(*made(Tables(esc=timed(T, **speeds, volt1=T))), inputs="rotor_speeds")
    assert record.input_names == ("m1", "m2", "m3", "m4")
    assert {record.units[name] for name in record.input_names} == {"rad/s"}
    np.testing.assert_allclose(record.u[0], [602.0, 603.0, 604.0, 605.0], atol=1e-9)


def test_throttle_of_ctun_serves_where_rate_has_none():
    """PID messages in place of RATE know roll, pitch and yaw only."""
    tables = Tables(rates=rates(out_thrust=np.full_like(T, np.nan)), setpoints=setpoints(throttle=0.3 + 0.001 * T))
    record = Experiment.from_flight(*made(tables), inputs="rate_outputs")
    np.testing.assert_allclose(record.u[:, 3], 0.3 + 0.001 * record.t, atol=1e-12)
    assert [finding.id for finding in record.findings] == ["not-logged"]


def test_reference_less_position_is_the_error_of_the_loop():
    """Both count from the first measured position; z is up."""
    tables = Tables(setpoints=hold(ahead=0.25))
    record = Experiment.from_flight(
        *made(tables, north=path, down=lambda t: np.full_like(t, -10.4)), inputs="reference"
    )
    assert record.input_names == ("x", "y", "z")
    np.testing.assert_allclose(record.u[:, 0] - record.y[:, 0], 0.25, atol=2e-3)
    np.testing.assert_allclose(record.u[:, 2] - record.y[:, 2], -0.4, atol=1e-9)
    assert record.units["x"] == "m"


def test_reference_of_another_origin_is_moved():
    """111.3 m per thousandth of a degree of latitude; and an origin that nobody told of is found."""
    log, trajectory = made(Tables(setpoints=hold(ahead=-111.0)), north=path, down=level(-10.0))
    record = Experiment.from_flight(log, trajectory, inputs="reference")
    (doubt,) = record.findings
    assert doubt.id == "reference-doubtful"
    assert "different origins" in doubt.reason
    np.testing.assert_allclose(record.u[:, 0], record.y[:, 0], atol=2e-3)
    trajectory.origin = Geodetic(lat=0.0, lon=0.0, alt=0.0)
    log.tables = Tables(setpoints=hold(ahead=-111.0), origin=Geodetic(lat=111.0 / 6335439.0, lon=0.0, alt=0.0))
    record = Experiment.from_flight(log, trajectory, inputs="reference")
    assert "reference-doubtful" not in {finding.id for finding in record.findings}
    np.testing.assert_allclose(record.u[:, 0], record.y[:, 0], atol=2e-3)


def test_only_the_time_in_which_a_position_is_held_is_used():
    """In STABILIZE the controller does not run and logs nothing: two pieces, of which the longer is taken."""
    manual = (T > 22.0) & (T < 30.0)
    log, trajectory = made(Tables(setpoints=hold()[~manual]), north=path, down=level(-10.0))
    record = Experiment.from_flight(log, trajectory, inputs="reference")
    assert record.t[0] >= 30.0
    assert record.t[-1] == pytest.approx(50.0, abs=0.1)
    assert [finding.id for finding in record.findings] == ["log-gaps"]
    assert "20.0 of 40.0 s" in record.findings[0].reason


@pytest.mark.parametrize(("mode_at", "pieces"), [(30.0, 2), (40.0, 1)])
def test_a_target_that_jumps_at_a_change_of_mode_is_a_restart_and_elsewhere_a_step(mode_at, pieces):
    target = hold()
    target.loc[30.0:, "p_e"] = 5.0
    modes = timed([0.0, mode_at], mode=["AUTO", "LOITER"])
    log, trajectory = made(
        Tables(setpoints=target, modes=modes),
        north=path,
        east=lambda t: np.interp(t, [30.5, 33.0], [0.0, 5.0]),
        down=level(-10.0),
    )
    record = Experiment.from_flight(log, trajectory, inputs="reference")
    assert record.duration == pytest.approx(40.0 if pieces == 1 else 20.0, abs=0.2)
    (finding,) = record.findings
    assert finding.id == ("reference-doubtful" if pieces == 1 else "log-gaps")
    assert ("jump" in finding.reason) == (pieces == 1)


def test_a_target_that_jumps_with_the_autopilots_own_estimate_is_a_reset():
    target = hold()
    target.loc[35.0:, "p_e"] = 3.0
    own = {name: np.zeros_like(T) for name in COLUMNS["ekf"]}
    own |= {"p_n": path(T), "p_e": np.where(T >= 35.0, 3.0, 0.0)}
    tables = Tables(setpoints=target, ekf=timed(T, **own))
    record = Experiment.from_flight(*made(tables, north=path, down=level(-10.0)), inputs="reference")
    assert record.t[-1] == pytest.approx(35.0, abs=0.2)


def test_velocity_reference_is_what_was_asked_for_and_not_what_the_controller_made_of_it():
    asked = setpoints(v_n_ref=0.1 * T, v_e_ref=0.0 * T, v_d_ref=-0.2 * T, v_n=9.0 + T, v_e=T, v_d=T)
    record = Experiment.from_flight(*made(Tables(setpoints=asked)), inputs="velocity_reference", outputs="velocity")
    assert record.input_names == record.output_names == ("v_x", "v_y", "v_z")
    np.testing.assert_allclose(record.u[0], [1.0, 0.0, 2.0], atol=1e-9)
    assert not record.findings
    old = setpoints(v_n=0.1 * T, v_e=0.0 * T, v_d=-0.2 * T)
    record = Experiment.from_flight(*made(Tables(setpoints=old)), inputs="velocity_reference", outputs="velocity")
    (finding,) = record.findings
    assert finding.id == "reference-doubtful"
    assert "contain the measured position" in finding.reason


def test_tilt_commands_push_where_the_thrust_tips():
    """Nose to the east: rolling right pushes south, pitching down pushes east."""
    tables = Tables(rates=rates(out_roll=np.full_like(T, 0.02), out_pitch=np.full_like(T, -0.05)))
    record = Experiment.from_flight(*made(tables, yaw=np.pi / 2.0), inputs="rate_outputs", frame="heading")
    assert record.input_names == ("tilt_x", "tilt_y", "yaw", "throttle")
    np.testing.assert_allclose(record.u[:, 0], -0.02, atol=1e-9)
    np.testing.assert_allclose(record.u[:, 1], 0.05, atol=1e-9)
    assert record.output_names == ("x", "y", "z")


def test_the_motion_is_turned_into_the_heading_where_motors_are_the_inputs():
    """A circle flown nose first is straight ahead: forward is the way flown, right is nothing."""
    motors = timed(T, m1=1500.0 + T, m2=1400.0 - T)
    log, trajectory = made(
        Tables(motors=motors),
        north=lambda t: 10.0 * np.sin(0.3 * t),
        east=lambda t: 10.0 * (1.0 - np.cos(0.3 * t)),
        yaw=lambda t: 0.3 * t,
    )
    record = Experiment.from_flight(log, trajectory, frame="heading")
    assert record.output_names == ("forward", "right", "z")
    np.testing.assert_allclose(record.y[:, 0], 3.0 * (record.t - record.t[0]), atol=2e-3)
    np.testing.assert_allclose(record.y[:, 1], 0.0, atol=2e-3)
    velocity = Experiment.from_flight(log, trajectory, frame="heading", outputs="velocity")
    assert velocity.output_names == ("v_forward", "v_right", "v_z")
    np.testing.assert_allclose(velocity.y[:, 0], 3.0, atol=1e-3)


@pytest.mark.parametrize(
    ("tables", "inputs", "words"),
    [
        (Tables(), "motors", "RCOU.*log them"),
        (Tables(), "rotor_speeds", "ESC messages with RPM"),
        (Tables(motors=timed(T, m1=T, m2=T)), "mixer", "FRAME_CLASS"),
        (Tables(), "rate_outputs", "RATE.*log them"),
        (Tables(rates=rates(out_thrust=T * np.nan)), "rate_outputs", "CTUN"),
        (Tables(), "reference", "PSCN, PSCE and PSCD.*POSITION_TARGET_LOCAL_NED.*navigation tuning"),
        (Tables(setpoints=setpoints(p_d=T)), "reference", "no position targets"),
        (Tables(setpoints=hold(T[T > 55.0][:1])), "reference", "no position targets"),
        (Tables(), "velocity_reference", "no velocity targets"),
        (Tables(setpoints=hold(T[T > 55.0])), "reference", "no position targets in flight"),
        (Tables(setpoints=hold(T[T > 49.6])), "reference", "overlap in flight for 0.[34] s only"),
        (
            Tables(modes=pd.DataFrame({"mode": ["STABILIZE", "ALT_HOLD"]}, index=[0.0, 5.0])),
            "reference",
            "flown in STABILIZE, ALT_HOLD, where no position is held.*LOITER",
        ),
    ],
)
def test_what_is_missing_is_named_with_the_way_to_log_it(tables, inputs, words):
    log, trajectory = made(tables, vehicle=Vehicle())
    with pytest.raises(MissingDataError, match=f"^flight.bin: .*{words}"):
        Experiment.from_flight(log, trajectory, inputs=inputs)


def test_commands_that_drown_in_the_rounding_of_pwm_are_told():
    """Thrust moves an X quad by tens of microseconds; roll by a few tenths, which rounding hides."""
    vehicle = Vehicle(frame_class="quad", frame_type="x", motors=motor_table("quad", "x", {}))
    thrust = 1500.0 + 20.0 * np.sin(0.5 * T)
    roll = {motor.number: np.sign(motor.roll) for motor in vehicle.motors}
    outputs = {f"m{k}": np.round(thrust + 0.2 * roll[k] * np.sin(T)) for k in roll}
    log, trajectory = made(Tables(motors=timed(T, **outputs)), vehicle=vehicle)
    for kind in ("motors", "mixer"):
        findings = {finding.id: finding for finding in Experiment.from_flight(log, trajectory, inputs=kind).findings}
        assert "what was asked in roll" in findings["constant-input"].reason
    # A record of the same outputs over the same time knows it; one of a part of it does not.
    motors = Experiment.from_flight(log, trajectory)
    assert Experiment.from_flight(log, trajectory, rate=50.0, beside=[motors]).findings == motors.findings
    part = Experiment.from_flight(log, trajectory, within=(T[0], T[0] + 0.7 * (T[-1] - T[0])), beside=[motors])
    alone = Experiment.from_flight(log, trajectory, within=(T[0], T[0] + 0.7 * (T[-1] - T[0])))
    assert part.findings == alone.findings != motors.findings


@pytest.mark.slow
def test_projected_motors_are_what_the_autopilot_asked_of_its_mixer(sitl):
    """RATE has the commands as the firmware computed them; motor outputs, ten times slower and rounded, give them back.

    Thrust and yaw move the motors by tens of microseconds. Roll and pitch move them by less than the microsecond to
    which they are rounded, so that no more than a relation can be expected of them.
    """
    mixer, rate = (Experiment.from_flight(*sitl("y6_01_auto"), inputs=kind) for kind in ("mixer", "rate_outputs"))
    for command, logged, least in (("thrust", "throttle", 0.98), ("yaw", "yaw", 0.99), ("pitch", "pitch", 0.4)):
        ours = mixer.select(inputs=[command]).u[:, 0]
        theirs = rate.select(inputs=[logged]).u[:, 0]
        n = min(len(ours), len(theirs))
        assert np.corrcoef(ours[:n], theirs[:n])[0, 1] > least
        if least > 0.9:
            assert np.polyfit(theirs[:n], ours[:n], 1)[0] == pytest.approx(1.0, abs=0.06)


DT = 0.1


def record(u, y=None, vehicle=None, units=None, seed=0, name="a"):
    u = np.asarray(u, dtype=float)
    y = np.random.default_rng(seed).standard_normal(len(u)) if y is None else y
    return Experiment.from_arrays(
        np.arange(len(u)) * DT,
        u,
        y,
        name=name,
        input_names=[f"m{k + 1}" for k in range(u.shape[1])],
        vehicle=vehicle,
        units=units,
    )


def answered(seed, noise, samples=3000, inputs=2):
    """Two inputs and an output that the first drives through a resonance, with noise of a given size."""
    rng = np.random.default_rng(seed)
    u = motion(rng, samples, inputs)
    y = lfilter([1.0, 0.5], [1.0, -1.4, 0.6], u[:, 0])
    return record(u, y / y.std() + noise * rng.standard_normal(samples), name=f"record {seed}")


def test_a_motor_at_its_idle_spin_is_saturated():
    """The mixer keeps motors between MOT_SPIN_MIN and MOT_SPIN_MAX: 1150 and 1950 us here, not 1000 and 2000."""
    vehicle = Vehicle(pwm_min=1000.0, pwm_max=2000.0, spin_min=0.15, spin_max=0.95)
    u = 1500.0 + 100.0 * motion(np.random.default_rng(1), 1000, 3)
    u[:300, 1], u[600:, 2] = 1150.0, 1950.0
    findings = examine([record(u, vehicle=vehicle, units={f"m{k}": "us" for k in (1, 2, 3)})]).findings
    findings = {
        finding.evidence["input"]: finding.evidence["limit"] for finding in findings if finding.id == "motors-at-limits"
    }
    assert findings == {"m2": "lower", "m3": "upper"}


def test_a_dead_motor_and_twins_are_named():
    u = motion(np.random.default_rng(2), 1000, 4)
    u[:, 1], u[:, 3] = 1100.0, u[:, 2]
    excitation = examine([record(u)])
    assert excitation.active == (0, 2, 3)
    assert {finding.id for finding in excitation.findings} == {"constant-input", "inputs-alike"}
    assert excitation.independent == 2
    assert excitation.condition == np.inf


def test_eight_motors_driven_by_four_commands_are_four_signals():
    rng = np.random.default_rng(3)
    angle = 2.0 * np.pi * np.arange(8) / 8.0
    mixer = np.column_stack([np.ones(8), np.sin(angle), np.cos(angle), (-1.0) ** np.arange(8)])
    u = motion(rng, 2000, 4) @ mixer.T + 1e-3 * rng.standard_normal((2000, 8))
    excitation = examine([record(u)])
    assert excitation.independent == 4
    assert excitation.findings[0].id == "inputs-alike"
    assert "like 4 independent signals" in excitation.findings[0].reason


def test_coherence_is_the_part_of_the_power_that_the_input_explains():
    """White noise of a known size on a known answer: coherence is S / (S + N) at every frequency."""
    coherences = coherence([answered(seed, noise=0.3, inputs=1) for seed in range(6)])
    z = np.exp(-1j * coherences.frequency * DT)
    drive = 1.0 / np.abs(1.0 - 0.8 * z) ** 2 * (1.0 - 0.8**2)
    answer = np.abs((1.0 + 0.5 * z) / (1.0 - 1.4 * z + 0.6 * z**2)) ** 2 * drive
    power = answer / np.mean(answer)
    expected = power / (power + 0.3**2)
    assert np.mean(np.abs(coherences.multiple[:, 0] - expected)) < 0.05
    assert not coherences.findings


@pytest.mark.parametrize("inputs", [1, 8])
def test_unrelated_signals_exceed_the_threshold_as_seldom_as_it_says(inputs):
    rng = np.random.default_rng(4)
    shares, findings = [], []
    for k in range(30):
        coherences = coherence([record(motion(rng, 1500, inputs), seed=k)])
        shares.append(np.mean(coherences.multiple > coherences.threshold))
        findings += [finding.id for finding in coherences.findings if finding.notable]
    assert np.mean(shares) < 0.02
    assert findings.count("output-unexplained") > 20


def test_an_input_that_rests_beside_its_trim_is_an_input() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(200) / 10.0
    u = np.column_stack([np.full(200, 1500.0), 1500.0 + 50.0 * rng.standard_normal(200)])
    record = Experiment.from_arrays(t, u, t, input_trim=[1450.0, 1500.0])
    examined = examine([record])
    assert examined.active == (0, 1)
    assert np.isfinite(examined.condition)
