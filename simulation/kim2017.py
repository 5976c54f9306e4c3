"""The quadcopter of Kim 2017 (AIAA 2017-1560): bench coefficients that follow the battery, and its LQR autopilot.

X frame, motor 1 right rear, 2 right front, 3 left front, 4 left rear; 1 and 3 turn clockwise. That is the geometry
of the input matrix of eq. 23; the sign of the roll moment in eq. 7 is lost in print.
"""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from simulation.atmosphere import GRAVITY
from simulation.controllers import hover_linearisation, lqr
from simulation.drive import Drive, FirstOrder
from simulation.errors import ParameterError
from simulation.fly import propagate
from simulation.rotor import QuadraticRotor
from simulation.vehicle import Multirotor, RotorMount

MASS = 2.6
#: Time constant of the rotors, s; the paper models none.
LAG = 0.02
#: Table 1 [kg m^2]. Too large by about a hundred for 2.6 kg (all of it at the rotors would give 0.4), but the
#: printed input matrix and gain were computed with them.
INERTIA = np.diag((3.63, 3.25, 5.51))
#: Distance of the rotors from the axis [m]. Not printed; the input matrix of eq. 23 gives it.
ARM = 0.4

#: Battery voltages of Tables 2 and 3 [V], and for each the four motors' numbers.
VOLTAGES = np.array([13.0, 14.0, 15.0, 16.0])
#: Table 3 [N s^2].
THRUST_COEFFICIENTS = np.array(
    [
        [1.77e-5, 1.36e-5, 1.61e-5, 2.57e-5],
        [2.13e-5, 1.85e-5, 1.95e-5, 2.60e-5],
        [2.50e-5, 2.33e-5, 2.30e-5, 2.614e-5],
        [2.86e-5, 2.82e-5, 2.644e-5, 2.638e-5],
    ]
)
#: Table 3 [N m s^2].
TORQUE_COEFFICIENTS = np.array(
    [
        [5.30e-7, 4.34e-7, 2.36e-7, 9.09e-7],
        [6.50e-7, 7.02e-7, 4.09e-7, 9.64e-7],
        [7.70e-7, 9.82e-7, 5.81e-7, 1.02e-6],
        [8.89e-7, 1.26e-6, 7.54e-7, 1.07e-6],
    ]
)
#: Table 2 [rad/s].
TRIM_SPEEDS = np.array(
    [
        [669.76, 669.13, 670.78, 568.0],
        [663.18, 665.77, 668.91, 551.51],
        [633.61, 632.0, 643.44, 534.1],
        [444.18, 452.57, 456.53, 515.78],
    ]
)

#: Input rows of eq. 23 (p, q, r per speed of motor 1 to 4) at 16 V. The yaw row is 3.28 times what Table 3 and Izz
#: give: a length in feet has slipped in.
PRINTED_INPUT = np.array(
    [
        [-0.002, -0.002, 0.0019, 0.0021],
        [-0.0022, 0.0022, 0.0021, -0.0024],
        [-0.00047, 0.00068, -0.00041, 0.00066],
    ]
)
#: Eq. 24: weights of roll, pitch, p, q, r and the integrals of roll and pitch; and of each motor's speed.
STATE_WEIGHTS = np.diag((1.4e7, 1.4e7, 1e-3, 1e-3, 1.0, 0.9e5, 0.9e5))
INPUT_WEIGHTS = 1.33 * np.eye(4)
#: Eq. 25.
PRINTED_GAIN = np.array(
    [
        [-1717.0, -1708.2, -672.3, -634.0, -0.3, 133.4, 132.9],
        [-1613.2, 1616.2, -613.1, 581.1, 0.5, 125.5, -125.9],
        [1631.4, 1623.1, 638.8, 602.4, -0.3, -126.8, -126.3],
        [1719.9, -1723.0, 653.6, -619.5, 0.5, -133.8, 134.2],
    ]
)


def at_voltage(table: np.ndarray, voltage: float) -> np.ndarray:
    """Interpolate Table 2 or 3 at a battery voltage [V]; shape (4,).

    Raises
    ------
    ParameterError
        The voltage lies outside the bench test.
    """
    if not VOLTAGES[0] <= voltage <= VOLTAGES[-1]:
        raise ParameterError(
            f"battery voltage {voltage:g} V: the bench test of Kim 2017 covers {VOLTAGES[0]:g} to {VOLTAGES[-1]:g} V"
        )
    return np.array([np.interp(voltage, VOLTAGES, table[:, motor]) for motor in range(4)])


def quadcopter(voltage: float = 16.0) -> Multirotor:
    """Build the craft with the coefficients of Table 3 at a battery voltage [V].

    The paper models no motor lag; `LAG` stands in for it.
    """
    k = at_voltage(THRUST_COEFFICIENTS, voltage)
    b = at_voltage(TORQUE_COEFFICIENTS, voltage)
    reach = ARM / math.sqrt(2.0)
    corners = ((-reach, reach), (reach, reach), (reach, -reach), (-reach, -reach))
    mounts = tuple(
        RotorMount(
            QuadraticRotor(thrust_coefficient=k[motor], torque_coefficient=b[motor]),
            (forward, right, 0.0),
            spin=1 if motor in (0, 2) else -1,
        )
        for motor, (forward, right) in enumerate(corners)
    )
    return Multirotor(
        name="Kim 2017 quadcopter",
        mass=MASS,
        inertia=INERTIA,
        rotors=mounts,
        drive=Drive(speed_max=1400.0, response=FirstOrder(LAG)),
        frame_class=1,
        frame_type=1,
    )


def gain(voltage: float = 16.0) -> np.ndarray:
    """Gain of the LQR with integrals of roll and pitch, from the model of eq. 20 and the weights of eq. 24; (4, 7).

    At 16 V it agrees with eq. 25 to 0.2 % in the angles and 0.6 % in the rates.
    """
    A, B = hover_linearisation(quadcopter(voltage), at_voltage(TRIM_SPEEDS, voltage))
    return lqr(*with_integrals(A, B), STATE_WEIGHTS, INPUT_WEIGHTS)


def with_integrals(A: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Append the integrals of the roll and pitch errors to the hover model (eq. 20): (7, 7) and (7, 4)."""
    augmented = np.zeros((7, 7))
    augmented[:5, :5] = A
    augmented[5, 0] = augmented[6, 1] = -1.0
    return augmented, np.vstack((B, np.zeros((2, B.shape[1]))))


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightGains:
    """Gains from height error (target below the craft positive) to the speed of every rotor.

    The printed PI (Kp -80, Ki -200) cannot hold height: hover is a double integrator, and without a term on the climb
    rate the cubic ``s^3 + a (80 s + 200)`` has a pair of roots to the right for any a. `rate` supplies it.
    """

    proportional: float = -80.0  #: rad/s per m.
    integral: float = -200.0  #: rad/s per m s.
    rate: float = -120.0  #: rad/s per m/s.


def height_fault(height: HeightGains, voltage: float = 16.0) -> str:
    """Report which gain makes the height loop unstable about hover; empty when it is stable.

    With ``a`` the vertical acceleration per rad/s of all rotors and ``tau`` their lag, the loop's characteristic
    polynomial is ``tau s^4 + s^3 - a (rate s^2 + proportional s + integral)``.
    """
    a = 2.0 * float(at_voltage(THRUST_COEFFICIENTS, voltage) @ at_voltage(TRIM_SPEEDS, voltage)) / MASS
    gains = {"height_rate": height.rate, "height_p": height.proportional, "height_i": height.integral}
    polynomial = [LAG, 1.0, *(-a * gain for gain in gains.values())]
    # Without an integral the loop has a root at zero that is not its own.
    growth = float(np.roots(polynomial if height.integral else polynomial[:-1]).real.max())
    if growth <= 0.0:
        return ""
    wrong = [f"{name} = {gain:g}" for name, gain in gains.items() if gain > 0.0]
    if wrong:
        why = f"{' and '.join(wrong)} must be negative, as down is positive"
    elif not height.rate:
        why = "height_rate = 0 leaves it without damping; it must be negative"
    else:
        why = (
            f"height_i = {height.integral:g} is too strong for height_p = {height.proportional:g} and "
            f"height_rate = {height.rate:g}"
        )
    return f"the height loop is unstable with these gains, an error grows e-fold in {1.0 / growth:.2g} s: {why}"


def recovery(
    *,
    voltage: float = 16.0,
    duration: float = 20.0,
    roll_deg: float = 20.0,
    pitch_deg: float = 20.0,
    height: HeightGains = HeightGains(),
    feedback: np.ndarray | None = None,
) -> pd.DataFrame:
    """Level the craft from the tilted start of Table 5 (Kim 2017, figure 12).

    Parameters
    ----------
    voltage : float
        Battery voltage, V.
    duration : float
        s.
    roll_deg, pitch_deg : float
        Where the craft starts; 20 deg in Table 5.
    height : HeightGains
    feedback : ndarray, shape (4, 7), optional
        Attitude gain; default `gain` at this voltage.

    Returns
    -------
    DataFrame
        As `simulation.fly.propagate`; control at 100 Hz.
    """
    craft = quadcopter(voltage)
    trim = at_voltage(TRIM_SPEEDS, voltage)
    K = gain(voltage) if feedback is None else feedback
    control_step, hold = 0.01, 10
    integrals = np.zeros(3)

    def command(t: float, x: np.ndarray) -> np.ndarray:
        w, i, j, k = x[6:10]
        roll = math.atan2(2.0 * (j * k + w * i), 1.0 - 2.0 * (i * i + j * j))
        pitch = math.asin(2.0 * (w * j - i * k))
        error = -x[2]
        integrals[:] += control_step * np.array([-roll, -pitch, error])
        state = np.array([roll, pitch, *x[10:13], integrals[0], integrals[1]])
        climb = height.proportional * error + height.integral * integrals[2] - height.rate * x[5]
        speeds: np.ndarray = np.maximum(trim + climb - K @ state, 0.0)
        return speeds

    start = _table_5(trim, roll_deg, pitch_deg)
    return propagate(craft, start, command, duration, dt=control_step / hold, hold=hold, gravity=GRAVITY)


def _table_5(trim: np.ndarray, roll_deg: float, pitch_deg: float) -> np.ndarray:
    """Return the initial state of Table 5: tilted, turning back at 4 deg/s, 0.3045 m below the target."""
    roll, pitch = math.radians(roll_deg), math.radians(pitch_deg)
    cr, sr, cp, sp = math.cos(roll / 2), math.sin(roll / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    u, v = 0.1523, 0.035
    north = u * math.cos(pitch) + v * math.sin(roll) * math.sin(pitch)
    east = v * math.cos(roll)
    down = -u * math.sin(pitch) + v * math.sin(roll) * math.cos(pitch)
    rate = math.radians(-4.0)
    return np.array([0, 0, 0.3045, north, east, down, cr * cp, sr * cp, cr * sp, -sr * sp, rate, rate, 0, *trim])
