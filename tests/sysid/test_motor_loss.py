"""Motors that lose thrust, or are weak from the beginning, are named; what is no motor's loss is not."""

import numpy as np
import pytest

from logparse import MissingDataError, Tables, Vehicle, read_log
from sysid.records.mixer import factors_of
from sysid.records.motor_scaling import curve, motor_commands
from sysid.rotors.motor_faults import find_motor_faults
from sysid.rotors.motor_faults.trims import steady_trims, weak_from_start
from sysid.rotors.steady_trims import SteadyTrims
from tests.paths import SAMPLES, SITL
from tests.sysid.failing_motor import Fault, craft, fly, remaining_thrust

#: Trims of three flights of a real log.
REAL = ((-0.148, -0.035, -0.276), (-0.118, -0.017, -0.209), (-0.174, -0.109, -0.209))

CALM = SITL / "octa15_two_flights_logdisarmed.BIN"
FRAMES = [("quad", "x"), ("hexa", "plus"), ("octa", "plus"), ("octa-quad", "x"), ("y6", "y6b")]
SECONDS = 40.0


def trimmed(*trims, variance=(4e-4, 7e-4, 2e-3)):
    """Return flights of a quad x with these trims; motor k takes half of each when it gives nothing."""
    rows = ((-0.5, 0.5, 0.5), (0.5, -0.5, 0.5), (0.5, 0.5, -0.5), (-0.5, -0.5, -0.5))
    return [SteadyTrims(("m1", "m2", "m3", "m4"), trim, variance, rows) for trim in trims]


def losses_in(tables, vehicle, start, stop):
    return tuple(one for one in find_motor_faults(tables, vehicle, start, stop) if one.kind != "pulse")


@pytest.mark.parametrize(("frame_class", "frame_type"), [*FRAMES, ("quad", "plus")])
def test_a_weak_motor_is_named_with_its_time_and_loss(frame_class, frame_type):
    vehicle, part = craft(frame_class, frame_type), 0.88
    seed = [len(frame_class), len(frame_type), round(100 * part)]
    number = 1 + sum(seed) % len(vehicle.motors)
    fault = Fault(number, 21.7, part)
    tables = fly(vehicle, sum(seed), fault)
    (loss,) = losses_in(tables, vehicle, 0.0, 40.0)
    assert loss.motor == number
    assert loss.t == pytest.approx(fault.t, abs=1.0)
    # The issue asks for 5 points of loss; the noise is what `sigma` says, within four of them.
    truth = 1.0 - remaining_thrust(tables, fault)
    assert loss.loss == pytest.approx(truth, abs=0.05)
    assert abs(loss.loss - truth) < 4.0 * loss.sigma + 0.01
    assert loss.output == pytest.approx(part, abs=0.05)


def test_errors_are_as_large_as_sigma_says():
    vehicle = craft("octa", "plus")
    scores = []
    for seed in range(6):
        fault = Fault(1 + seed % 8, 20.0, 0.85)
        tables = fly(vehicle, 100 + seed, fault)
        (loss,) = losses_in(tables, vehicle, 0.0, 40.0)
        assert loss.motor == fault.motor
        scores.append((loss.loss - (1.0 - remaining_thrust(tables, fault))) / loss.sigma)
    # Root mean square of six: 0.3 to 1.95 holds 99.9 % of cases if sigma is right; half that below is allowed, since
    # the long-run variance is estimated upwards.
    assert 0.2 < np.sqrt(np.mean(np.square(scores))) < 1.95


def test_shortly_after_the_take_off_only_a_plain_loss_is_named():
    # Noise is known from 5 s before the change, fewer than two independent pieces: nearly anything may come of it.
    vehicle = craft("quad", "x")
    early, late = (
        losses_in(fly(vehicle, 11, Fault(2, onset, 0.9), gust=0.01), vehicle, 0.0, onset + 8.0) for onset in (7.0, 25.0)
    )
    assert early == ()
    assert [loss.motor for loss in late] == [2]
    # A motor that stops is beyond doubt by then.
    (lost,) = losses_in(fly(vehicle, 11, Fault(2, 12.0, 0.0)), vehicle, 0.0, 20.0)
    assert lost.motor == 2


@pytest.mark.skipif(not CALM.exists(), reason="needs the logs beside the repository")
@pytest.mark.parametrize("seconds", [2.0, 10.0])
def test_an_axis_at_rest_does_not_hide_a_weak_motor(seconds):
    """A hover without wind: about pitch a hundredth of thrust explained all that rounding leaves, beyond all doubt."""
    log = read_log(CALM)
    vehicle, onset = log.vehicle, log.flight.start + 16.0
    names = [f"m{motor.number}" for motor in vehicle.motors]
    grid = np.linspace(1150.0, 1950.0, 1601)
    asked = curve(motor_commands(log.tables.motors[names].to_numpy(float), vehicle), vehicle.thrust_expo)
    mixer = np.column_stack([factors_of(vehicle), np.ones(len(names))])
    needed, outputs = asked @ mixer, asked.copy()
    for _ in range(20):
        given = outputs * np.where(np.arange(len(names)) == 6, 0.64, 1.0)
        outputs = np.clip(outputs + (needed - given @ mixer) @ np.linalg.pinv(mixer), 0.0, 1.0)
    pwm = np.round(np.interp(outputs, curve(motor_commands(grid, vehicle), vehicle.thrust_expo), grid))
    motors = log.tables.motors.copy()
    weak = motors.index >= onset
    motors.loc[weak, names] = pwm[weak]
    # The log ends in the air, so that no landing is left out.
    cut = log.tables.changed(motors=motors.loc[: onset + seconds], events=None)
    (loss,) = losses_in(cut, vehicle, log.flight.start, onset + seconds)
    assert (loss.motor, loss.loss) == (7, pytest.approx(0.36, abs=0.05))


def test_a_payload_that_drops_is_no_motor():
    # A shift along the nose of a quad X is shared by two motors, and nothing yaws.
    vehicle = craft("quad", "x")
    tables = fly(vehicle, 3, shift=(20.0, 0.0, 0.05, 0.0))
    assert losses_in(tables, vehicle, 0.0, 40.0) == ()


def test_what_is_missing_is_told():
    vehicle = craft("quad", "x")
    tables = fly(vehicle, 1, seconds=10.0)
    with pytest.raises(MissingDataError, match="frame"):
        losses_in(tables, Vehicle(), 0.0, 10.0)
    with pytest.raises(MissingDataError, match="outputs"):
        losses_in(Tables(imu=tables.imu), vehicle, 0.0, 10.0)
    with pytest.raises(MissingDataError, match="IMU"):
        losses_in(Tables(motors=tables.motors), vehicle, 0.0, 10.0)
    with pytest.raises(MissingDataError, match="too short"):
        steady_trims(tables, vehicle, 0.0, 10.0)
    with pytest.raises(MissingDataError, match="frame"):
        steady_trims(tables, Vehicle(), 0.0, 10.0)
    # Slow telemetry cannot tell, and says nothing rather than something wrong.
    slow = Tables(motors=tables.motors.iloc[::10], imu=tables.imu)
    assert losses_in(slow, vehicle, 0.0, 10.0) == ()


def test_a_motor_that_stops_is_lost_whole_though_the_craft_tumbles():
    """What the fall adds is known from the flight before: regressed on the fall itself it took a quarter away."""
    log = read_log(SAMPLES / "quad03_motor_stops.bin")
    (fault,) = find_motor_faults(log.tables, log.vehicle, log.flight.start, 84.2)
    assert (fault.motor, fault.t) == (2, pytest.approx(82.2, abs=0.05))
    assert fault.loss + 3.0 * max(fault.sigma, 0.01) > 1.0


@pytest.mark.parametrize(("frame_class", "frame_type"), FRAMES)
def test_a_motor_weak_from_the_beginning_is_named(frame_class, frame_type):
    vehicle = craft(frame_class, frame_type)
    motor = 1 + len(frame_class) % len(vehicle.motors)
    # 82 % of the signal above 1000 us: about a third of the thrust is missing.
    fault = Fault(motor, -1.0, 0.82)
    flown = [fly(vehicle, seed, fault, off=0.005) for seed in (3, 13)]
    trims = [steady_trims(tables, vehicle, 0.0, SECONDS) for tables in flown]
    # One flight alone names none: of one sound craft in thirty the trims are in a motor's proportion by chance.
    assert weak_from_start(trims[0], []) == ()
    (finding,) = weak_from_start(trims[0], trims[1:])
    assert (finding.id, finding.evidence["motor"]) == ("uneven-motor", f"m{motor}")
    assert finding.evidence["loss"] == pytest.approx(1.0 - remaining_thrust(flown[0], fault), abs=0.06)


@pytest.mark.parametrize(("frame_class", "frame_type"), FRAMES)
def test_sound_motors_raise_nothing_whatever_the_load(frame_class, frame_type):
    vehicle = craft(frame_class, frame_type)
    # Nothing; loads ahead, to one side and at a corner; motors twisted about their arms.
    for shift in (None, (0.0, 0.0, 0.1, 0.0), (0.0, 0.1, 0.0, 0.0), (0.0, 0.07, -0.07, 0.0), (0.0, 0.0, 0.0, 0.1)):
        flown = [fly(vehicle, seed, off=0.005, shift=shift) for seed in (4, 14)]
        trims = [steady_trims(tables, vehicle, 0.0, SECONDS) for tables in flown]
        assert weak_from_start(trims[0], trims[1:]) == ()


def test_readings_that_damage_made_do_not_count():
    vehicle = craft("quad", "x")
    tables = fly(vehicle, 4, off=0.005)
    clean = steady_trims(tables, vehicle, 0.0, SECONDS)
    tables.imu.iloc[[300, 500, 700], :4] = [[np.inf] * 4, [1e30] * 4, [np.nan] * 4]
    assert steady_trims(tables, vehicle, 0.0, SECONDS).trims == pytest.approx(clean.trims, abs=0.01)


def test_a_hint_that_other_flights_do_not_bear_out_is_not_stated():
    """The last of three is trimmed as if m4 were weak, the others have no such pitch."""
    first, second, third = trimmed(*REAL)
    assert weak_from_start(third, [third])[0].evidence["motor"] == "m4"
    assert weak_from_start(third, [first, second]) == ()


def test_a_motor_that_is_weak_in_all_flights_or_became_weak_is_named():
    weak = trimmed((-0.15, -0.14, -0.16), (-0.12, -0.15, -0.14), (-0.16, -0.13, -0.15), variance=(2e-4,) * 3)
    (finding,) = weak_from_start(weak[0], weak[1:])
    assert (finding.evidence["motor"], finding.evidence["flights"]) == ("m4", 3)
    sound = trimmed((0.0, 0.0, 0.0), (0.01, 0.02, 0.01), variance=(2e-4,) * 3)
    assert weak_from_start(weak[0], sound)[0].evidence["motor"] == "m4"


# Motors that drop out for moments; gusts, sticks and lasting losses are none.


def dropouts_in(tables, vehicle, start, stop):
    return [one for one in find_motor_faults(tables, vehicle, start, stop) if one.kind == "pulse"]


@pytest.mark.parametrize(("frame_class", "frame_type"), FRAMES)
def test_dropouts_of_a_motor_are_named_with_its_number_and_their_seconds(frame_class, frame_type):
    """Half of the output lost for a second, three times: most are found, and none of another motor."""
    vehicle = craft(frame_class, frame_type)
    times = (11.3, 19.8, 28.4)
    count = 0
    for seed in range(12):
        motor = 1 + seed % len(vehicle.motors)
        tables = fly(vehicle, seed, *(Fault(motor, t, 0.5, t + 1.0) for t in times))
        for one in dropouts_in(tables, vehicle, 0.0, 40.0):
            assert one.motor == motor
            assert min(abs(one.t - t) for t in times) < 1.0
            assert 0.25 <= one.loss <= 1.0
            count += 1
    assert count >= 0.6 * 3 * 12  # 0.81 with six motors, more with others


@pytest.mark.parametrize(("frame_class", "frame_type"), FRAMES)
def test_sound_motors_in_gusts_neither_weaken_nor_drop_out(frame_class, frame_type):
    vehicle = craft(frame_class, frame_type)
    for seed in range(12):
        assert find_motor_faults(fly(vehicle, 50 + seed, gust=0.01, drift=0.03), vehicle, 0.0, SECONDS) == ()


def test_a_lasting_loss_is_no_dropout():
    vehicle = craft("quad", "x")
    dropouts = dropouts_in(fly(vehicle, 5, Fault(2, 20.0, 0.6)), vehicle, 0.0, 40.0)
    assert all(one.t > 19.0 for one in dropouts)
    assert len(dropouts) < 2
