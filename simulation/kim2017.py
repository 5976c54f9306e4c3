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
from simulation.drive import Drive, FirstOrder, QuadraticRotor
from simulation.errors import DivergenceError, ParameterError
from simulation.fly import attitude, propagate
from simulation.instruments import attitude_angles
from simulation.outcome import CaseOutcome, CasePlot, Fact, named, rotor_speeds
from simulation.papers import PRINTED, write_paper_log
from simulation.vehicle import Multirotor, mounts

MASS = 2.6
#: Time constant of the rotors, s; the paper models none.
LAG = 0.02
#: Table 1 [kg m^2]. Too large by about a hundred for 2.6 kg (all of it at the rotors would give 0.4), but the
#: printed input matrix and gain were computed with them.
INERTIA = np.diag((3.63, 3.25, 5.51))
#: Distance of the rotors from the axis [m]. Not printed; the input matrix of eq. 23 gives it.
ARM = 0.4

_PRINTED = {name: np.array(rows) for name, rows in PRINTED["kim2017"].items()}
#: Battery voltages of Tables 2 and 3 [V], and for each the four motors' numbers: Table 3 [N s^2, N m s^2], Table 2
#: [rad/s].
VOLTAGES, TRIM_SPEEDS = _PRINTED["voltages"], _PRINTED["trim"]
THRUST_COEFFICIENTS, TORQUE_COEFFICIENTS = _PRINTED["thrust"], _PRINTED["torque"]
#: Input rows of eq. 23 (p, q, r per speed of motor 1 to 4) at 16 V, and the gain of eq. 25.
PRINTED_INPUT, PRINTED_GAIN = _PRINTED["input"], _PRINTED["gain"]


def at_voltage(table: np.ndarray, voltage: float) -> np.ndarray:
    """Interpolate Table 2 or 3 at a battery voltage [V]; shape (4,)."""
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
    corners = ((-reach, reach, 0.0), (reach, reach, 0.0), (reach, -reach, 0.0), (-reach, -reach, 0.0))
    rotors = [QuadraticRotor(thrust_coefficient=k[m], torque_coefficient=b[m]) for m in range(4)]
    return Multirotor(
        name="Kim 2017 quadcopter",
        mass=MASS,
        inertia=INERTIA,
        rotors=mounts(rotors, corners, (1, -1, 1, -1)),
        drive=Drive(speed_max=1400.0, response=FirstOrder(LAG)),
        frame_class=1,
        frame_type=1,
    )


def gain(voltage: float = 16.0) -> np.ndarray:
    """Gain of the LQR with integrals of roll and pitch, from the model of eq. 20 and the weights of eq. 24; (4, 7).

    At 16 V it agrees with eq. 25 to 0.2 % in the angles and 0.6 % in the rates.
    """
    A, B = hover_linearisation(quadcopter(voltage), at_voltage(TRIM_SPEEDS, voltage))
    # Eq. 24: weights of roll, pitch, p, q, r and the integrals of roll and pitch; and of each motor's speed.
    of_states = np.diag((1.4e7, 1.4e7, 1e-3, 1e-3, 1.0, 0.9e5, 0.9e5))
    return lqr(*with_integrals(A, B), of_states, 1.33 * np.eye(4))


def with_integrals(A: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Append the integrals of the roll and pitch errors to the hover model (eq. 20): (7, 7) and (7, 4)."""
    augmented = np.zeros((7, 7))
    augmented[:5, :5] = A
    augmented[5, 0] = augmented[6, 1] = -1.0
    return augmented, np.vstack((B, np.zeros((2, B.shape[1]))))


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """What of the recovery can be changed."""

    voltage: float = 16.0  #: Of the battery, V: coefficients and gain follow it.
    #: Where the craft starts, deg.
    roll: float = 20.0
    pitch: float = 20.0
    duration: float = 20.0  #: s.
    #: Gains from height error (target below the craft positive) to the speed of every rotor, rad/s per m, m s and m/s.
    #: The printed PI (-80, -200) cannot hold height: hover is a double integrator, and without a term on the climb rate
    #: the cubic ``s^3 + a (80 s + 200)`` has a pair of roots to the right for any a. `height_rate` supplies it.
    height_p: float = -80.0
    height_i: float = -200.0
    height_rate: float = -120.0

    def __post_init__(self) -> None:
        if not (abs(self.roll) <= 85.0 and abs(self.pitch) <= 85.0):
            raise ParameterError(f"roll {self.roll:g} and pitch {self.pitch:g} deg must lie within 85 deg")
        if not 0.5 <= self.duration <= 600.0:
            raise ParameterError(f"duration {self.duration:g} s must lie in 0.5 to 600 s")


def height_fault(settings: Recovery) -> str:
    """Report which gain makes the height loop unstable about hover; empty when it is stable.

    With ``a`` the vertical acceleration per rad/s of all rotors and ``tau`` their lag, the loop's characteristic
    polynomial is ``tau s^4 + s^3 - a (height_rate s^2 + height_p s + height_i)``.
    """
    thrust, speeds = (at_voltage(table, settings.voltage) for table in (THRUST_COEFFICIENTS, TRIM_SPEEDS))
    a = 2.0 * float(thrust @ speeds) / MASS
    gains = {name: getattr(settings, name) for name in ("height_rate", "height_p", "height_i")}
    polynomial = [LAG, 1.0, *(-a * gain for gain in gains.values())]
    # Without an integral the loop has a root at zero that is not its own.
    growth = float(np.roots(polynomial if settings.height_i else polynomial[:-1]).real.max())
    if growth <= 0.0:
        return ""
    wrong = [f"{name} = {gain:g}" for name, gain in gains.items() if gain > 0.0]
    if wrong:
        why = f"{' and '.join(wrong)} must be negative, as down is positive"
    elif not settings.height_rate:
        why = "height_rate = 0 leaves it without damping; it must be negative"
    else:
        why = (
            f"height_i = {settings.height_i:g} is too strong for height_p = {settings.height_p:g} and "
            f"height_rate = {settings.height_rate:g}"
        )
    return f"the height loop is unstable with these gains, an error grows e-fold in {1.0 / growth:.2g} s: {why}"


def recovery(settings: Recovery = Recovery()) -> pd.DataFrame:
    """Level the craft from the tilted start of Table 5 (Kim 2017, figure 12)."""
    craft, trim, K = quadcopter(settings.voltage), at_voltage(TRIM_SPEEDS, settings.voltage), gain(settings.voltage)
    control_step, hold = 0.01, 10
    integrals = np.zeros(3)

    def command(_t: float, x: np.ndarray) -> np.ndarray:
        roll, pitch, _ = attitude(x)
        error = -x[2]
        integrals[:] += control_step * np.array([-roll, -pitch, error])
        state = np.array([roll, pitch, *x[10:13], integrals[0], integrals[1]])
        climb = settings.height_p * error + settings.height_i * integrals[2] - settings.height_rate * x[5]
        speeds: np.ndarray = np.maximum(trim + climb - K @ state, 0.0)
        return speeds

    start = _table_5(trim, settings.roll, settings.pitch)
    return propagate(craft, start, command, settings.duration, dt=control_step / hold, hold=hold, gravity=GRAVITY)


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


_NOTES = (
    "The printed height PI (Kp -80, Ki -200) alone cannot hold height: its cubic has roots to the right for any "
    "actuation. A term on the climb rate is added.",
    "The printed inertias (3.63, 3.25, 5.51 kg m²) are about a hundred times those of a craft of 2.6 kg, but the "
    "printed input matrix and gain rest on them, so they are used.",
    "Table 2 with Table 3 lifts 94 % of the weight at 16 V; the integral of the height loop supplies the rest.",
)


def simulate(name: str, summary: str, settings: Recovery) -> CaseOutcome:
    """Level the craft from the start of Table 5."""
    fault = height_fault(settings)
    try:
        path = recovery(settings)
    except DivergenceError as error:
        if not fault:
            raise
        raise DivergenceError(f"{error}; {fault}") from error
    roll, pitch, yaw = attitude_angles(path)
    turned = {"roll": roll, "pitch": pitch, "yaw": np.unwrap(yaw)}
    angles = pd.DataFrame({name: np.degrees(angle) for name, angle in turned.items()}, index=path.index)
    craft = quadcopter(settings.voltage)
    rows = slice(None, None, 10)
    rates = named(path, roll_rate="w_x", pitch_rate="w_y", yaw_rate="w_z")
    height = pd.DataFrame({"height above the target": -path["p_d"]})
    history = pd.concat((angles.add_suffix("_deg"), path), axis=1).iloc[rows].rename_axis("t_s")
    return CaseOutcome(
        name=name,
        summary=summary,
        facts=_facts(settings, path, angles),
        notes=(f"{fault[0].upper()}{fault[1:]}.", *_NOTES) if fault else _NOTES,
        fault=fault,
        plots=(
            CasePlot(
                "Roll and pitch go to zero (figure 12).",
                "angle (deg)",
                angles[["roll", "pitch"]].iloc[rows],
            ),
            CasePlot("Yaw is not controlled and turns on (figure 12).", "yaw (deg)", angles[["yaw"]].iloc[rows]),
            CasePlot("Angular rates.", "rate (deg/s)", rates.iloc[rows] * (180.0 / np.pi)),
            CasePlot("Height: the craft starts 0.30 m below its target.", "height (m)", height.iloc[rows]),
            CasePlot("Speeds of the rotors.", "rotor speed (rad/s)", rotor_speeds(path, "motor").iloc[rows]),
        ),
        history=history,
        write_log=lambda folder: write_paper_log(path, craft, folder, name, summary, gravity=GRAVITY),
    )


def _facts(settings: Recovery, path: pd.DataFrame, angles: pd.DataFrame) -> tuple[Fact, ...]:
    computed = gain(settings.voltage)
    columns = [0, 1, 2, 3, 5, 6]
    off = np.abs(computed[:, columns] / PRINTED_GAIN[:, columns] - 1.0).max()
    level = angles[["roll", "pitch"]].abs().max(axis=1)
    outside = level.index[level > 1.0]
    below = path.index[path["p_d"].abs() > 0.05]

    def after(times: pd.Index) -> float | str:
        if len(times) == 0:
            return 0.0
        return float(times[-1]) if times[-1] < path.index[-1] else "not within the flight"

    levelled, reached = after(outside), after(below)
    return (
        Fact("battery voltage", settings.voltage, "V"),
        Fact("start: roll, pitch", f"{settings.roll:g}, {settings.pitch:g}", "deg"),
        Fact("gain against eq. 25 (16 V), largest difference", 100.0 * float(off), "%"),
        Fact("roll and pitch within 1 deg after", levelled, "" if isinstance(levelled, str) else "s"),
        Fact("height within 5 cm after", reached, "" if isinstance(reached, str) else "s"),
        Fact("yaw rate at the end", float(np.degrees(path["w_z"].iloc[-1])), "deg/s"),
        Fact("drift north, east", f"{path['p_n'].iloc[-1]:.2f}, {path['p_e'].iloc[-1]:.2f}", "m"),
        Fact("greatest rotor speed", float(rotor_speeds(path).max().max()), "rad/s"),
    )
