"""Thrust stand and pendulum: the paper's tables and formulae, layouts of other stands, and tables with faults."""

import math

import numpy as np
import pytest

from logparse import Vehicle
from simulation import kim2017
from sysid.bench.pendulum import Threads, bifilar, check_thread
from sysid.bench.stand import analyse_bench
from sysid.bench.table import BenchError, read_bench

PWM = np.arange(1000.0, 2001.0, 100.0)
WEIGHT = 2.6 * 9.80665


def rotor_speed(pwm):
    """Any rising curve will do."""
    return 900.0 * np.sqrt(np.clip((pwm - 1000.0) / 1000.0, 0.0, None))


def kim_table(folder, noise=0.0, seed=0):
    """Write what a stand measures where Table 3 of Kim 2017 holds, in the paper's layout."""
    rng = np.random.default_rng(seed)
    lines = ["Motor,PWM (us),Voltage (V),Thrust (N),Torque (N m),RPM,Current (A)"]
    for motor in range(4):
        for row, voltage in enumerate(kim2017.VOLTAGES):
            for pwm in PWM:
                w = rotor_speed(pwm)
                thrust = kim2017.THRUST_COEFFICIENTS[row, motor] * w**2 * (1.0 + noise * rng.standard_normal())
                torque = kim2017.TORQUE_COEFFICIENTS[row, motor] * w**2
                rpm, current = w * 30.0 / math.pi, torque * w
                lines.append(f"{motor + 1},{pwm:.0f},{voltage},{thrust:.8f},{torque:.9f},{rpm:.6f},{current:.3f}")
    path = folder / "kim.csv"
    path.write_text("\n".join(lines))
    return path


def thrusts(full=12.0, pulses=PWM, voltage=",15.8"):
    """Return the rows of a sweep: pulse width, thrust by a smooth curve to its full value, and the voltage."""
    return [f"{pwm:.0f},{full * ((pwm - 1000.0) / 1000.0) ** 1.5:.6f}{voltage}" for pwm in pulses]


def sweep(folder, name="stand.csv", head="ESC signal (µs),Thrust (N),Voltage (V)", rows=None):
    path = folder / name
    path.write_text("\n".join([head, *(thrusts() if rows is None else rows)]), encoding="utf-8")
    return path


def test_coefficients_of_table_3(tmp_path):
    """Algorithm 2 at the tested voltages gives Table 3; between them it interpolates, as the paper's lines do."""
    bench = analyse_bench(read_bench([kim_table(tmp_path)]), density=1.225)
    assert bench.motors == ("m1", "m2", "m3", "m4")
    assert bench.voltages == pytest.approx(tuple(kim2017.VOLTAGES))
    table = bench.coefficient_table()
    # Table 3 follows the voltage by straight lines to its last printed digit only, and lines are what the method fits.
    printed = kim2017.THRUST_COEFFICIENTS
    assert table["k"].to_numpy() == pytest.approx(printed, rel=0.005)
    assert table["b"].to_numpy() == pytest.approx(kim2017.TORQUE_COEFFICIENTS, rel=0.01)
    halfway = bench.coefficients("m1", 14.5).thrust.value
    assert halfway == pytest.approx(0.5 * (printed[1, 0] + printed[2, 0]), rel=0.005)


def test_trim_carries_the_weight(tmp_path):
    """Algorithm 1: at the trim PWM the motor gives a quarter of the weight; a lower battery asks for more PWM."""
    bench = analyse_bench(read_bench([kim_table(tmp_path)]), density=1.225)
    trims = {voltage: bench.trim("m1", WEIGHT, voltage) for voltage in (16.0, 14.5, 13.0)}
    for voltage, trim in trims.items():
        curve = bench.at_voltage("m1", voltage)
        assert np.interp(trim.pwm, curve.index, curve["thrust"]) == pytest.approx(WEIGHT / 4.0, rel=1e-6)
        assert trim.speed == pytest.approx(np.interp(trim.pwm, curve.index, curve["speed"]))
    assert trims[16.0].pwm < trims[14.5].pwm < trims[13.0].pwm


def test_standard_errors_are_those_of_repetition(tmp_path):
    """Twenty noisy stands: k scatters as claimed, to a factor of 1.8 (chi-square, 19 degrees of freedom)."""
    values = [
        analyse_bench(read_bench([kim_table(tmp_path, 0.02, seed)]), 1.225).coefficients("m1", 14.5).thrust
        for seed in range(20)
    ]
    assert np.mean([value.value for value in values]) == pytest.approx(2.315e-5, rel=0.01)
    spread = np.std([value.value for value in values])
    claimed = np.sqrt(np.mean([value.sigma**2 for value in values]))
    assert claimed / 1.8 < spread < 1.8 * claimed


def test_layouts_of_other_stands(tmp_path):
    """Tyto/RCbenchmark columns in grams and kilograms, semicolons, negative torque: one thrust curve in newtons."""
    plain = sweep(tmp_path)
    grams = [
        f"{k};{pwm:.0f};0;{1000 / 9.80665 * 12.0 * ((pwm - 1000) / 1000) ** 1.5:.4f};-0.1;15.8;{pwm};;"
        for k, pwm in enumerate(PWM)
    ]
    other = sweep(
        tmp_path,
        "tyto.csv",
        "Time (s);ESC signal (µs);Servo 1 (µs);Thrust (gf);Torque (N·m);Voltage (V);Motor Electrical Speed (RPM);"
        "Motor Efficiency (%);App message",
        grams,
    )
    third = sweep(tmp_path, "kgf.csv", "ESC signal (us),Thrust (kgf),Voltage (V)", thrusts(12.0 / 9.80665))
    curves = [analyse_bench(read_bench([path]), 1.225).at_voltage("m1") for path in (plain, other, third)]
    for curve in curves[1:]:
        assert curve["thrust"].to_numpy() == pytest.approx(curves[0]["thrust"].to_numpy(), abs=1e-3)
    assert curves[1]["speed"].iloc[-1] == pytest.approx(2000.0 * math.pi / 30.0)
    assert curves[1]["torque"].iloc[-1] == pytest.approx(0.1)


def test_thrust_curve_and_prior(tmp_path):
    """A stand that follows the autopilot's curve gives back its curvature; the prior is per unit of mass."""
    craft = Vehicle(pwm_min=1000.0, pwm_max=2000.0, spin_min=0.15, spin_max=0.95, thrust_expo=0.65)
    c = (PWM - 1150.0) / 800.0
    rows = [
        f"{p:.0f},{8.0 * (0.4 * x + 0.6 * x * x) if x > 0 else 0.0:.6f},15.8"
        for p, x in zip(PWM, c, strict=True)
        if x <= 1
    ]
    bench = analyse_bench(read_bench([sweep(tmp_path, rows=rows)]), density=1.1)
    curve = bench.command_curve(craft)
    assert curve.expo.value == pytest.approx(0.6, abs=1e-4)
    assert curve.full_thrust.value == pytest.approx(8.0 * 1.225 / 1.1, rel=1e-4)
    priors = bench.priors(2.0, craft)
    assert priors["thrust"][0] == pytest.approx(4.0 * 1.225 / 1.1, rel=1e-4)
    assert priors["thrust"][1] >= 0.03 * priors["thrust"][0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({5: "1500,-3.0,15.8"}, "with negative thrust"),
        ({6: "1600,568.7,15.8"}, "far from the curve"),
        ({3: "13,2.0,15.8"}, "a PWM no ESC takes"),
    ],
)
def test_implausible_rows_are_named_and_left_out(tmp_path, change, words):
    rows = thrusts()
    clean = analyse_bench(read_bench([sweep(tmp_path)]), 1.225)
    for at, row in change.items():
        rows[at] = row
    faulty = analyse_bench(read_bench([sweep(tmp_path, "faulty.csv", rows=rows)]), 1.225)
    assert [f.id for f in faulty.findings if words in f.reason] == ["table-doubtful"]
    assert not any(words in f.reason for f in clean.findings)
    assert faulty.trim("m1", 16.0).pwm == pytest.approx(clean.trim("m1", 16.0).pwm, abs=15.0)


def test_rows_without_numbers_are_named_by_their_lines(tmp_path):
    rows = [
        "1000,0,15",
        "abc,1,15",
        "1200,1.1,15",
        "1300,nan,15",
        "",
        "1400,,15",
        "1500,4,15",
        "1600,inf,1",
        "1800,8,15",
    ]
    table = read_bench([sweep(tmp_path, rows=rows)])
    assert len(table.rows) == 4
    (finding,) = [finding for finding in table.findings if finding.id == "table-doubtful"]
    assert "4 row(s) without PWM and thrust as numbers (line 3, 5, 7, 9); left out" in finding.reason


def test_pwm_out_of_order_and_negative_thrust_throughout(tmp_path):
    rows = thrusts(-12.0, np.random.default_rng(1).permutation(PWM))
    bench = analyse_bench(read_bench([sweep(tmp_path, rows=rows)]), 1.225)
    doubtful = [f.reason for f in bench.findings if f.id == "table-doubtful"]
    assert any("its sign is turned" in sentence for sentence in doubtful)
    assert bench.at_voltage("m1").index.is_monotonic_increasing
    assert bench.at_voltage("m1")["thrust"].iloc[-1] == pytest.approx(12.0)


def test_what_was_not_measured_is_said(tmp_path):
    bench = analyse_bench(read_bench([sweep(tmp_path, head="PWM,Thrust", rows=thrusts(voltage=""))]))
    said = " ".join(f.reason for f in bench.findings if f.id == "conditions-assumed")
    for words in ("carries no unit", "no battery voltage", "no rotor speeds", "air at the stand"):
        assert words in said
    k = bench.coefficients("m1").thrust
    assert k.value is None
    assert "rotor speed was not measured" in k.reason
    with pytest.raises(BenchError, match="no voltages"):
        bench.coefficients("m1", 15.0)


@pytest.mark.parametrize(
    ("head", "rows", "words"),
    [
        ("Time (s),Voltage (V)", ["1,2", "2,3"], "no PWM .* and no thrust"),
        ("PWM (us),Thrust (furlong)", ["1100,1", "1200,2"], "unit 'furlong'"),
        ("PWM (us),Thrust (N)", ["a,b"], "no row has both"),
        ("PWM (us),Thrust (N)", ["1100,1", "1200,2"], "three or more"),
        (
            "PWM (us),Thrust (N)",
            ["0.1,1", "0.2,2", "0.3,3"],
            "no plausible row .* a PWM no ESC takes .* check the unit",
        ),
    ],
)
def test_unusable_tables_are_refused(tmp_path, head, rows, words):
    with pytest.raises(BenchError, match=words):
        analyse_bench(read_bench([sweep(tmp_path, head=head, rows=rows)]))


def test_what_the_motors_cannot_do_is_refused(tmp_path):
    bench = analyse_bench(read_bench([kim_table(tmp_path)]), 1.225)
    with pytest.raises(BenchError, match="its share of the weight is 250"):
        bench.trim("m1", 1000.0, 16.0)
    with pytest.raises(BenchError, match="outside the voltages tested"):
        bench.trim("m1", WEIGHT, 11.1)
    with pytest.raises(BenchError, match="m9 was not tested"):
        bench.coefficients("m9")


def test_a_motor_that_never_turned_gives_reasons_and_no_numbers(tmp_path):
    rows = [f"{pwm},0,16,0" for pwm in (1200, 1300, 1400, 1500, 1600)]
    head = "ESC signal (µs),Thrust (N),Voltage (V),RPM"
    bench = analyse_bench(read_bench([sweep(tmp_path, head=head, rows=rows)]))
    k = bench.coefficients("m1").thrust
    assert (k.value, k.reason) == (None, "the rotor never turned")
    with pytest.raises(BenchError, match="no thrust at full command"):
        bench.command_curve()


def test_weak_motor_shows(tmp_path):
    good = [sweep(tmp_path, f"{k}.csv") for k in range(3)]
    weak = sweep(tmp_path, "weak.csv", rows=thrusts(9.0))
    findings = analyse_bench(read_bench([*good, weak]), 1.225).findings
    assert [f.evidence["motor"] for f in findings if f.id == "uneven-motor"] == ["m4"]


def test_uncertainty_of_inertia_agrees_with_monte_carlo():
    """All inputs drawn from their uncertainties, 2000 times: the spread is what is claimed, to 10 %."""
    rng, truth = np.random.default_rng(3), 0.03
    spread = []
    for _ in range(2000):
        length, distance, mass = 1.96 + 0.002 * rng.standard_normal(), 0.2 + 0.001 * rng.standard_normal(), 2.6
        g = 9.80665 * (1.0 + 0.001 * rng.standard_normal())
        period = math.sqrt(
            truth * 4.0 * math.pi**2 * length / ((mass + 0.005 * rng.standard_normal()) * g * distance**2)
        )
        times = 10.0 * period * (1.0 + 0.005 * rng.standard_normal(8))
        spread.append(bifilar(list(times), mass, Threads(1.96, 0.2)))
    claimed = np.sqrt(np.mean([swing.sigma**2 for swing in spread]))
    found = [swing.inertia for swing in spread]
    assert np.std(found) == pytest.approx(claimed, rel=0.1)
    assert np.mean(found) == pytest.approx(truth, rel=0.002)


def test_gravity_of_the_paper_s_simple_pendulum():
    """28.19, 27.55 and 28.58 s for ten swings on 1.96 m: 9.46 to 10.2 m/s^2; the paper prints 9.46, 9.91, 9.45."""
    checks = [check_thread([time], 1.96) for time in (28.19, 27.55, 28.58)]
    assert checks[0].gravity == pytest.approx(9.737, abs=0.01)
    assert checks[1].gravity == pytest.approx(10.19, abs=0.01)
    assert [bool(checked.findings) for checked in checks] == [False, True, True]
    assert checks[1].length == pytest.approx(9.80665 * (2.755 / (2.0 * math.pi)) ** 2)


def test_miscounted_swings_and_bad_numbers():
    result = bifilar([30.1, 30.0, 33.1, 29.9, 30.05], 2.6, Threads(1.96, 0.2))
    assert result.repetitions == 4
    (miscounted,) = result.findings
    assert (miscounted.id, "by about a swing" in miscounted.reason) == ("table-doubtful", True)
    slow = bifilar([300.0, 301.0], 2.6, Threads(1.96, 0.2))
    assert any(f.id == "table-doubtful" and "from the axis" in f.reason for f in slow.findings)
    for times, mass, sigma in (
        ([30.0], 2.6, 0.0),
        ([30.0, -1.0], 2.6, 0.0),
        ([1e300, 1e300], 1.0, 0.0),
        ([30.0, 30.0], 0.0, 0.0),
        ([30.0, 30.0], 1.0, math.nan),
        ([30.0, 30.0], 1.0, -1.0),
    ):
        with pytest.raises(BenchError):
            bifilar(times, mass, Threads(1.96, 0.2), mass_sigma=sigma)


def test_identical_times_are_known_to_the_stop_watch_only():
    result = bifilar([10.0, 10.0, 10.0], 1.0, Threads(1.0, 0.2))
    assert result.std == 0.0
    assert result.parts["period"] == pytest.approx(2.0 * 0.01 / math.sqrt(12.0) / 10.0)


def test_a_mass_hardly_known_leaves_the_inertia_undetermined():
    result = bifilar([10.0, 10.1], 1.0, Threads(1.0, 0.2), mass_sigma=5.0)
    assert not result.determined
    (finding,) = result.findings
    assert "most of it from the mass (500 %)" in finding.reason


def test_a_motor_of_any_number_of_digits_is_a_motor(tmp_path):
    """Python converts no number of 4,301 digits."""
    rows = [f"{motor},{row}" for motor in ("007", "9" * 5000) for row in thrusts()]
    path = sweep(tmp_path, head="Motor,PWM (us),Thrust (N),Voltage (V)", rows=rows)
    assert list(read_bench([path]).rows["motor"].unique()) == ["m7", "m" + "9" * 5000]
