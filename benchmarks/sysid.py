"""How fast and how well transfer functions are found: Rao-Garnier, and a physical craft."""

import time

import numpy as np
from scipy.linalg import expm
from scipy.signal import lsim

from benchmarks._measure import Row, listed, row, timed
from sysid import Experiment, fit_transfer_functions
from tests.sysid.rao_garnier import DEN, NUM, SAMPLES, STEP, inputs, rao_garnier, response

#: Of the noise of Rao and Garnier's problem.
SEEDS = 20

#: What each motor of Elhesasy 2024 gives of thrust, roll, pitch and yaw, per unit of lift and arm.
_C = np.sqrt(0.5)
MIXER = np.array(
    [
        [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
        [0.0, 0.0, -_C, -_C, _C, _C, 1.0, -1.0],
        [1.0, -1.0, _C, -_C, _C, -_C, 0.0, 0.0],
        [1.0, 1.0, -1.0, -1.0, -1.0, -1.0, 1.0, 1.0],
    ]
)

#: Of the craft: mass [kg], arm [m], inertia [kg m^2], lift per PWM [N/us], and lags: motor [s], roll and pitch rate,
#: horizontal and vertical speed [1/s].
MASS, ARM, INERTIA, LIFT = 4.3, 0.35, 0.06, 0.012
MOTOR_LAG, RATE_DAMPING, DRAG, HEAVE = 0.06, 2.0, 0.35, 0.5


def run() -> list[Row]:
    return [*two_modes(), *physical_truth()]


def two_modes() -> list[Row]:
    """Fit 20 seeds at 10 dB and judge the free run on a clean record with another input."""
    records = [rao_garnier_record(seed) for seed in range(SEEDS)]
    fresh = inputs(8)
    clean = response(fresh)
    test = Experiment.from_arrays(np.arange(SAMPLES) * STEP, fresh, clean, input_trim=[0.0], output_trim=[0.0])
    truth = np.array([*NUM, *DEN[1:]])
    fit_transfer_functions(records[:1], 4, 1)  # compiles
    fits, errors, deviations, seconds = [], [], [], []
    for seed, record in enumerate(records):
        model, spent = timed(lambda: fit_transfer_functions([record], 4, 1, seed=seed))  # noqa: B023
        seconds.append(spent)
        function = model.transfer_functions["y1"]["u1"]
        errors.append(np.concatenate([function.num, function.den[1:]]) - truth)
        deviations.append(function.standard_deviation)
        fits.append(_fit_percent(clean, model.simulate(test)[:, 0]))
    scatter = np.sqrt(np.mean(np.square(errors), axis=0))
    bound = _cramer_rao(inputs(7))
    claimed = np.mean(deviations, axis=0) / bound
    quality = f"{np.mean(fits):.2f} %, least {min(fits):.2f} %"
    failures = f"{sum(fit < 95.0 for fit in fits)} of {SEEDS}"
    return [
        row("Rao-Garnier, 10 dB, 20 seeds: fit on clean fresh data", quality, goal=">= 99.0 %"),
        row("Rao-Garnier: failures (fit below 95 %)", failures, goal="<= 0"),
        row(
            "Rao-Garnier: RMSE over Cramer-Rao bound, worst parameter", f"{(scatter / bound).max():.2f}", goal="< 1.25"
        ),
        row("Rao-Garnier: claimed deviation over bound", f"{claimed.min():.2f}-{claimed.max():.2f}", goal="1"),
        row("Rao-Garnier: time for a fit", f"{1e3 * float(np.median(seconds)):.0f} ms", goal="< 20 ms"),
    ]


def physical_truth() -> list[Row]:
    """Motor commands of an octocopter to its position, inputs projected by the mixer; free run over 180 s from rest.

    The truth is the linearised physics, steered by a controller, so that eight motors have four degrees of freedom. The
    projected structure is of its order; how well do 180 s with 0.05 m of noise determine lags and gains?
    """
    rows = []
    poles, integrators = [[0, 0, 5, 0], [0, 5, 0, 0], [3, 0, 0, 0]], [2, 2, 1]
    every = [[5] * 4, [5] * 4, [3, 0, 0, 0]]
    for label, spread, structure in (
        ("alike, one input for each axis", 0.0, poles),
        ("different by 3 %, all four inputs", 0.03, every),
    ):
        tests = [_craft_record(100 + seed, spread, 0.0) for seed in range(3)]
        errors, seconds = [], []
        for seed in range(10):
            record = _craft_record(seed, spread, 0.05)
            begun = time.process_time()
            model = fit_transfer_functions([record], structure, 0, "common", integrators=integrators)
            seconds.append(time.process_time() - begun)
            errors += [np.sqrt(np.mean((model.simulate(test) - test.y) ** 2, axis=0)) for test in tests]
        axes = listed(np.median(errors, axis=0), ".4f")
        what = f"physical octocopter, 180 s, motors {label}: "
        rows += [
            row(f"{what}free run on new flights (median; x, y, z)", f"{axes} m", goal="0.004 m"),
            row(f"{what}time", f"{np.median(seconds):.2f} s", goal="< 0.2 s"),
        ]
    return rows


def rao_garnier_record(seed: int) -> Experiment:
    t = np.arange(SAMPLES) * STEP
    return Experiment.from_arrays(t, *rao_garnier(seed), name=f"seed {seed}", input_trim=[0.0], output_trim=[0.0])


def _cramer_rao(u: np.ndarray) -> np.ndarray:
    """Least standard deviation of (num, den) at 10 dB, from rest: derivatives ``s^k / A`` and ``-s^k B / A^2``."""
    t, one = np.arange(len(u)) * STEP, [1.0]
    columns = [lsim((one + [0.0] * k, DEN), u, t, interp=False)[1] for k in (1, 0)]
    for k in (3, 2, 1, 0):
        numerator = np.convolve(NUM, one + [0.0] * k)
        columns.append(-lsim((numerator, np.convolve(DEN, DEN)), u, t, interp=False)[1])
    psi = np.column_stack(columns)
    variance = response(u).var() / 10.0
    return np.asarray(np.sqrt(variance * np.diag(np.linalg.inv(psi.T @ psi))))


def _craft_record(seed: int, spread: float, sigma: float) -> Experiment:
    """Fly random position steps for 180 s; inputs as the mixer projects the motors' PWM."""
    transition, gain = _craft(spread)
    rng = np.random.default_rng([1, seed])
    samples, dt = 1800, 0.1
    target, k = np.zeros((samples, 3)), 50
    while k < samples:
        stay = int(rng.integers(30, 90))
        target[k : k + stay] = rng.uniform(-1.0, 1.0, 3) * [6.0, 6.0, 3.0]
        k += stay
    allocation = np.linalg.pinv(MIXER * np.array([1.0, ARM, ARM, 1.0])[:, None]) / LIFT
    pwm, y, x = np.zeros((samples, 8)), np.zeros((samples, 3)), np.zeros(len(transition))
    for k in range(samples):
        y[k] = x[15], x[11], x[17]
        error = target[k] - y[k]
        theta, phi = np.clip([-0.08 * error[0] + 0.16 * x[14], 0.08 * error[1] - 0.16 * x[10]], -0.35, 0.35)
        moments = INERTIA * np.array([3.0 * (phi - x[9]) - 1.5 * x[8], 3.0 * (theta - x[13]) - 1.5 * x[12]])
        yaw = 0.02 * rng.standard_normal() if k > 50 else 0.0
        pwm[k] = allocation @ [MASS * (0.6 * error[2] - 1.2 * x[16]), *moments, yaw]
        x = transition @ x + gain @ pwm[k]
    return Experiment.from_arrays(
        np.arange(samples) * dt,
        pwm @ np.linalg.pinv(MIXER),
        y + sigma * np.random.default_rng([2, seed]).standard_normal(y.shape),
        name=f"flight {seed}",
        input_names=("thrust", "roll", "pitch", "yaw"),
        output_names=("x", "y", "z"),
        input_trim=np.zeros(4),
        output_trim=np.zeros(3),
    )


def _craft(spread: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and input matrix over 0.1 s: lifts (8), then p phi v_y y, q theta v_x x, v_z z."""
    effect = 1.0 + spread * np.random.default_rng(0).standard_normal(8)
    a, b = np.zeros((18, 18)), np.zeros((18, 8))
    a[:8, :8], b[:8] = -np.eye(8) / MOTOR_LAG, np.diag(LIFT * effect) / MOTOR_LAG
    for k, moment, gravity in ((8, MIXER[1], 9.81), (12, MIXER[2], -9.81)):
        a[k, :8], a[k, k] = ARM * moment / INERTIA, -RATE_DAMPING
        a[k + 1, k], a[k + 2, k + 1], a[k + 2, k + 2], a[k + 3, k + 2] = 1.0, gravity, -DRAG, 1.0
    a[16, :8], a[16, 16], a[17, 16] = 1.0 / MASS, -HEAVE, 1.0
    exponential = expm(0.1 * np.block([[a, b], [np.zeros((8, 26))]]))
    return exponential[:18, :18], exponential[:18, 18:]


def _fit_percent(y: np.ndarray, predicted: np.ndarray) -> float:
    return 100.0 * (1.0 - float(np.linalg.norm(y - predicted) / np.linalg.norm(y - y.mean())))
