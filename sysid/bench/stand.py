"""Thrust and torque coefficients from a thrust stand, at any battery voltage, after Kim 2017 (section II.E).

A test runs PWM through its range at several battery voltages. At each PWM thrust, torque and rotor speed follow the
voltage by a straight line; evaluated at the voltage of the day they give

- algorithm 1: the trim PWM, by linear interpolation of thrust over PWM at the weight that a motor carries;
- algorithm 2: the coefficients k and b of ``T = k w^2`` and ``tau = b w^2`` (eq. 13, 14), by least squares over PWM.

Without rotor speeds the thrust at full command and the curvature of thrust over command stand in for k
(`sysid.records.thrust_curve`), which is what the rigid body takes from a stand as a prior.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from core.findings import info, warning
from core.parameter import Parameter
from logparse import Finding, Vehicle
from sysid.bench.table import NOISE, BenchError, BenchTable
from sysid.records.experiment import Floats
from sysid.records.motor_scaling import motor_commands
from sysid.records.thrust_curve import REFERENCE_DENSITY

#: Voltages closer than this are one, V: what a pack sags by along a sweep is part of the test, not another test.
APART = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Coefficients:
    """Coefficients of one motor at one voltage (algorithm 2), in the air of the stand."""

    motor: str
    voltage: float | None  #: V; None where all voltages stand together.
    #: k [N s^2] and b [N m s^2].
    thrust: Parameter
    torque: Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Trim:
    """Hover of one motor at one voltage (algorithm 1), under a weight of the craft."""

    motor: str
    voltage: float | None
    weight: float  #: N.
    pwm: float  #: us.
    thrust: float  #: N.
    #: rad/s and A where measured.
    speed: float | None
    current: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class NoTrim:
    """Why a motor cannot carry its share of a weight [N]."""

    motor: str
    voltage: float | None
    weight: float
    reason: str


@dataclass(frozen=True, slots=True)
class CommandCurve:
    """Thrust over the autopilot's command, common to the motors: k and e of `sysid.records.thrust_curve`."""

    full_thrust: Parameter  #: N at full command and `voltage`, in sea-level air.
    expo: Parameter  #: MOT_THST_EXPO that makes thrust linear in what the autopilot asks for.
    voltage: float  #: V.


@dataclass(frozen=True, slots=True)
class Level:
    """Measurements at one PWM: voltage (M,) and columns thrust, torque, speed, current (M, 4)."""

    pwm: float
    voltage: Floats
    readings: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchReport:
    """What bench.json holds."""

    kind: Literal["bench"] = "bench"
    table: str
    density: float
    voltages: tuple[float, ...]
    coefficients: tuple[Coefficients, ...]
    trim: tuple[Trim | NoTrim, ...]
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """A thrust-stand test."""

    table: BenchTable
    density: float  #: Air at the stand, kg/m^3.
    voltages: tuple[float, ...]  #: Voltages tested, V; empty when not recorded.
    findings: tuple[Finding, ...]  #: Of the table and of the test.
    _levels: Mapping[str, tuple[Level, ...]]

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the motors tested."""
        return self.table.motors

    def at_voltage(self, motor: str, voltage: float | None = None) -> pd.DataFrame:
        """Evaluate a motor's lines over voltage at each PWM: thrust, torque, speed, current; NaN if not measured.

        Without a voltage [V] all of the test stand together. BenchError where motor or voltage was not tested.
        """
        levels = self._levels.get(motor)
        if levels is None:
            raise BenchError(f"motor {motor} was not tested; tested: {', '.join(self.motors)}")
        if voltage is not None:
            self._require_tested(voltage)
        rows = [at_voltage(level, voltage) for level in levels]
        index = pd.Index([level.pwm for level in levels], name="pwm")
        return pd.DataFrame(rows, index=index, columns=["thrust", "torque", "speed", "current"])

    def coefficients(self, motor: str, voltage: float | None = None) -> Coefficients:
        """Fit k and b at a voltage [V] (algorithm 2)."""
        curve = self.at_voltage(motor, voltage)
        return Coefficients(
            motor=motor,
            voltage=voltage,
            thrust=through_origin(curve["speed"], curve["thrust"], "N s^2"),
            torque=through_origin(curve["speed"], curve["torque"], "N m s^2"),
        )

    def trim(self, motor: str, weight: float, voltage: float | None = None, motors: int | None = None) -> Trim:
        """Find the PWM at which the motors carry a weight [N] (algorithm 1).

        As many share it as were tested, or four where one was. BenchError where the motor cannot lift its share.
        """
        count = motors or (len(self.motors) if len(self.motors) > 1 else 4)
        if not (weight > 0.0 and count > 0):
            raise BenchError(f"weight {weight:g} N on {count} motors: both must be positive")
        curve, share = self.at_voltage(motor, voltage), weight / count
        thrust = np.maximum.accumulate(curve["thrust"].to_numpy(np.float64))
        where = f" at {voltage:g} V" if voltage is not None else ""
        if not thrust[0] < share <= thrust[-1]:
            raise BenchError(
                f"motor {motor}{where} gives {max(thrust[0], 0.0):.2f} to {thrust[-1]:.2f} N; its share of the weight "
                f"is {share:.2f} N ({weight:.2f} N over {count} motors)"
            )
        rising = np.concatenate([[True], np.diff(thrust) > 0.0])
        pwm = curve.index.to_numpy(np.float64)
        trim = float(np.interp(share, thrust[rising], pwm[rising]))

        def there(name: str) -> float | None:
            values = curve[name].to_numpy(np.float64)
            return float(np.interp(trim, pwm, values)) if np.isfinite(values).all() else None

        return Trim(
            motor=motor,
            voltage=voltage,
            weight=weight,
            pwm=trim,
            thrust=share,
            speed=there("speed"),
            current=there("current"),
        )

    def command_curve(self, vehicle: Vehicle | None = None, voltage: float | None = None) -> CommandCurve:
        """Fit thrust over the autopilot's command for all motors together, at the highest voltage tested or another.

        BenchError when fewer than four levels of PWM lie within the range, or no thrust was measured in it.
        """
        craft = vehicle or Vehicle()
        volts = voltage if voltage is not None else (max(self.voltages) if self.voltages else None)
        curves = [self.at_voltage(motor, volts) for motor in self.motors]
        pwm = np.concatenate([curve.index.to_numpy(np.float64) for curve in curves])
        thrust = np.concatenate([curve["thrust"].to_numpy(np.float64) for curve in curves])
        command = motor_commands(pwm, craft)
        inside = (command > 0.02) & (command <= 1.0001)
        c, t = command[inside], thrust[inside] * REFERENCE_DENSITY / self.density
        if len(np.unique(np.round(c, 3))) < 4:
            raise BenchError(
                f"{len(np.unique(np.round(c, 3)))} levels of PWM lie between idle and full spin of the autopilot "
                "(MOT_PWM_*, MOT_SPIN_*); four or more show the thrust curve"
            )
        rows = np.column_stack([c, c * c])
        (linear, square), covariance = least_squares(rows, t)
        if not linear + square > 0.0:
            raise BenchError("no thrust at full command: was the motor armed, and does the stand pull or push?")
        full, expo = linear + square, square / (linear + square)
        spread = np.array([-square, linear]) / full**2
        return CommandCurve(
            Parameter(float(full), float(np.sqrt(covariance.sum())), "N at full command"),
            Parameter(float(expo), float(np.sqrt(spread @ covariance @ spread)), "1"),
            float(volts) if volts is not None else float("nan"),
        )

    def priors(
        self, mass: float, vehicle: Vehicle | None = None, voltage: float | None = None
    ) -> dict[str, tuple[float, float]]:
        """Return the rigid body what the stand knows: mean and standard deviation by its parameters' names.

        ``thrust`` [m/s^2, one motor at full command] for a mass [kg] and voltage [V], and ``thrust_expo``. Motors
        differ from each other and propellers in flight from those on a stand by some percent, so that no standard
        deviation is below 3 % of thrust and 0.05 of curvature.
        """
        if not mass > 0.0:
            raise BenchError(f"mass must be positive, not {mass:g} kg")
        curve = self.command_curve(vehicle, voltage)
        (full, full_sigma), (expo, expo_sigma) = (_known(parameter) for parameter in (curve.full_thrust, curve.expo))
        return {
            "thrust": (full / mass, float(np.hypot(full_sigma, 0.03 * full)) / mass),
            "thrust_expo": (expo, float(np.hypot(expo_sigma, 0.05))),
        }

    def coefficient_table(self) -> pd.DataFrame:
        """Return k and b in the form of Table 3: rows voltages, columns (coefficient, motor)."""
        rows: dict[float, dict[tuple[str, str], float]] = {}
        for voltage in self.voltages or (float("nan"),):
            coefficients = {m: self.coefficients(m, voltage if np.isfinite(voltage) else None) for m in self.motors}
            rows[voltage] = {("k", m): _known(pair.thrust)[0] for m, pair in coefficients.items()}
            rows[voltage] |= {("b", m): _known(pair.torque)[0] for m, pair in coefficients.items()}
        table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("voltage")
        pairs = [(coefficient, motor) for coefficient in ("k", "b") for motor in self.motors]
        table.columns = pd.MultiIndex.from_tuples(pairs, names=["coefficient", "motor"])
        return table

    def report(
        self, weight: float | None = None, voltage: float | None = None, motors: int | None = None
    ) -> BenchReport:
        """Return coefficients at the tested voltages, and trim at a weight [N] and voltage [V], for bench.json."""
        volts: list[float | None] = [*self.voltages] or [None]
        if voltage is not None and voltage not in volts:
            volts.append(voltage)
        return BenchReport(
            table=self.table.name,
            density=self.density,
            voltages=self.voltages,
            coefficients=tuple(self.coefficients(motor, volt) for motor in self.motors for volt in volts),
            trim=()
            if weight is None
            else tuple(self._trim_row(motor, weight, voltage, motors) for motor in self.motors),
            findings=self.findings,
        )

    def _trim_row(self, motor: str, weight: float, voltage: float | None, motors: int | None) -> Trim | NoTrim:
        try:
            return self.trim(motor, weight, voltage, motors)
        except BenchError as error:
            return NoTrim(motor=motor, voltage=voltage, weight=weight, reason=str(error))

    def _require_tested(self, voltage: float) -> None:
        if not self.voltages:
            raise BenchError(f"the table has no voltages, so that nothing can be said at {voltage:g} V")
        low, high = min(self.voltages), max(self.voltages)
        if not 0.98 * low <= voltage <= 1.02 * high:
            raise BenchError(
                f"{voltage:g} V is outside the voltages tested ({low:.4g} to {high:.4g} V); test the motors there"
            )


def analyse_bench(table: BenchTable, density: float | None = None) -> Bench:
    """Arrange a table by motor, PWM and voltage.

    Parameters
    ----------
    table : BenchTable
    density : float, optional
        Air at the stand, kg/m^3; the table's own otherwise, or sea-level air with a finding.

    Raises
    ------
    BenchError
        When a motor has fewer than three levels of PWM.
    """
    findings = list(table.findings)
    air = density if density is not None else table.density
    if air is None:
        air = REFERENCE_DENSITY
        findings.append(
            info(
                "conditions-assumed",
                f"the air at the stand is not known; coefficients are taken to hold at {REFERENCE_DENSITY} kg/m^3",
                "give the density (--density): pressure [Pa] / (287.05 (273.15 + deg C))",
            )
        )
    if not 0.5 < air < 1.6:
        raise BenchError(f"air of {air:g} kg/m^3 is not found on earth; give the density in kg/m^3")
    levels = {}
    for motor, rows in table.rows.groupby("motor", sort=False):
        # Steps of 5 us are one level.
        steps = np.round(rows["pwm"] / 5.0)
        of_motor = [
            Level(
                float(level["pwm"].mean()),
                level["voltage"].to_numpy(np.float64),
                level[["thrust", "torque", "speed", "current"]].to_numpy(np.float64),
            )
            for _, level in rows.groupby(steps)
        ]
        if len(of_motor) < 3:
            raise BenchError(f"motor {motor}: {len(of_motor)} level(s) of PWM; a thrust curve needs three or more")
        levels[str(motor)] = tuple(of_motor)
    voltages = voltages_tested(table.rows)
    if not voltages:
        findings.append(
            warning(
                "conditions-assumed",
                "the table has no battery voltage: coefficients hold for the unknown voltage of the test only",
                "record the voltage",
            )
        )
    elif len(voltages) == 1:
        findings.append(
            info(
                "conditions-assumed",
                f"tested at {voltages[0]:.4g} V only: how coefficients and trim follow the battery is not determined",
                "repeat the test with the battery half and nearly empty",
            )
        )
    if table.rows["speed"].isna().all():
        findings.append(
            warning(
                "conditions-assumed",
                "no rotor speeds were measured, so that k and b per square of speed are not determined; trim and the "
                "thrust curve over PWM are",
                "measure speed (optical probe, or ESC)",
            )
        )
    findings += weak_motors(levels)
    return Bench(table=table, density=air, voltages=voltages, findings=tuple(findings), _levels=levels)


def voltages_tested(rows: pd.DataFrame) -> tuple[float, ...]:
    """Find the voltages of the test: of each sweep over PWM the median, those close together once."""
    parts = []
    for _, motor in rows.groupby("motor", sort=False):
        pwm, voltage = motor["pwm"].to_numpy(), motor["voltage"].to_numpy()
        if not np.isfinite(voltage).all():
            return ()
        # A sweep ends where PWM falls back by more than half of the range.
        cuts = np.flatnonzero(np.diff(pwm) < -0.5 * np.ptp(pwm)) + 1
        parts += [float(np.median(part)) for part in np.split(voltage, cuts) if len(part) > 2]
    groups: list[list[float]] = []
    for volts in sorted(parts):
        if groups and volts - groups[-1][-1] < APART:
            groups[-1].append(volts)
        else:
            groups.append([volts])
    return tuple(float(np.mean(group)) for group in groups)


def at_voltage(level: Level, voltage: float | None) -> Floats:
    """Evaluate thrust, torque, speed and current on straight lines over voltage."""
    volts = level.voltage
    if voltage is None or not np.isfinite(volts).all() or np.ptp(volts) < APART:
        return np.asarray(np.mean(level.readings, axis=0))
    rows = np.column_stack([np.ones_like(volts), volts - voltage])
    return np.asarray(np.linalg.lstsq(rows, level.readings, rcond=None)[0][0])


def least_squares(rows: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Fit and covariance for white residuals."""
    values = np.linalg.lstsq(rows, y, rcond=None)[0]
    left = y - rows @ values
    variance = float(left @ left) / max(len(y) - rows.shape[1], 1)
    return np.asarray(values, dtype=np.float64), np.asarray(variance * np.linalg.inv(rows.T @ rows), dtype=np.float64)


def through_origin(speed: pd.Series[float], force: pd.Series[float], unit: str) -> Parameter:
    """Fit ``force = coefficient speed^2``."""
    w, y = np.asarray(speed, dtype=np.float64), np.asarray(force, dtype=np.float64)
    known = np.isfinite(w) & np.isfinite(y) & (w > 0.0)
    if np.count_nonzero(known) < 3:
        if np.isfinite(w).any() and not np.nanmax(w) > 0.0:
            return Parameter(None, None, unit, "the rotor never turned")
        missing = "rotor speed" if not np.isfinite(w).any() else "thrust" if unit == "N s^2" else "torque"
        return Parameter(None, None, unit, f"{missing} was not measured")
    values, covariance = least_squares(w[known, None] ** 2, y[known])
    if not values[0] > 0.0:
        return Parameter(None, None, unit, "the fit is not positive: check the sign and the speeds")
    return Parameter(float(values[0]), float(np.sqrt(covariance[0, 0])), unit)


def weak_motors(levels: Mapping[str, tuple[Level, ...]]) -> list[Finding]:
    """Name motors that give less thrust than the others at the same PWM."""
    if len(levels) < 2:
        return []
    grid = np.linspace(
        max(level[0].pwm for level in levels.values()), min(level[-1].pwm for level in levels.values()), 20
    )
    curves = {
        motor: np.interp(grid, [level.pwm for level in level], [float(level.readings[:, 0].mean()) for level in level])
        for motor, level in levels.items()
    }
    usual = np.median(np.array(list(curves.values())), axis=0)
    strong = usual > max(NOISE, 0.2) * usual.max()
    findings = []
    for motor, curve in curves.items():
        ratio = float(np.median(curve[strong] / usual[strong])) if strong.any() else 1.0
        if ratio < 0.9:
            findings.append(
                warning(
                    "uneven-motor",
                    f"motor {motor} gives {100.0 * (1.0 - ratio):.0f} % less thrust on the stand than the others at "
                    "the same PWM",
                    "check propeller, bearings and ESC calibration",
                    motor=motor,
                    ratio=ratio,
                )
            )
    return findings


def _known(quantity: Parameter) -> tuple[float, float]:
    """Return value and standard error; NaN where they are not determined."""
    return (np.nan if quantity.value is None else quantity.value), (
        np.nan if quantity.sigma is None else quantity.sigma
    )
