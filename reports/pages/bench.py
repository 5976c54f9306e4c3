"""The page of a thrust-stand test: coefficients over voltage, trim, curves, findings."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from core.quantity import number, uncertain
from core.table import Row, Table
from reports.figures.figure import DASHES, Figure, Plot, curve, dots
from reports.pages.html import render
from sysid.bench.stand import Bench
from sysid.bench.table import BenchError

#: Colours of motors, the same in every plot of the page.
_COLORS = ("@own", "@joint", "@mixer", "@body")


def bench_page(
    bench: Bench, weight: float | None = None, voltage: float | None = None, motors: int | None = None
) -> str:
    """Render the page."""
    figures = [
        _over_pwm(bench, voltage),
        _over_speed(bench, voltage, "thrust", "thrust (N)", "k"),
        _over_speed(bench, voltage, "torque", "torque (N m)", "b"),
        _over_voltage(bench),
    ]
    drawn = [figure for figure in figures if figure is not None]
    trims, sentences = _trims(bench, weight, voltage, motors)
    return render(
        "bench.html",
        drawn,
        title=f"Thrust stand: {bench.table.name}",
        facts=_facts(bench),
        sentences=sentences,
        trims=trims,
        coefficients=_coefficients(bench, voltage),
        curve=_curve(bench, voltage),
        findings=bench.findings,
        bench_figures=drawn,
    )


def _facts(bench: Bench) -> str:
    parts = [
        f"{len(bench.motors)} motor{'s' if len(bench.motors) > 1 else ''}",
        f"{len(bench.table.rows)} measurements",
    ]
    if bench.voltages:
        parts.append(" / ".join(f"{volts:.1f}" for volts in bench.voltages) + " V")
    return " · ".join([*parts, f"air of {bench.density:.3f} kg/m³"])


def _volts(bench: Bench, voltage: float | None) -> Sequence[float | None]:
    tested = sorted({*bench.voltages, *([] if voltage is None else [voltage])}, reverse=True)
    return tested or [None]


def _coefficients(bench: Bench, voltage: float | None) -> Table:
    rows: list[Row] = []
    for volts in _volts(bench, voltage):
        rows.append(Row("at the voltage of the test" if volts is None else f"{volts:.4g} V", kind="part"))
        for motor in bench.motors:
            coefficients = bench.coefficients(motor, volts)
            cells = [
                # No stand measures to better than a thousandth.
                uncertain(parameter.value, max(parameter.sigma or 0.0, 1e-3 * parameter.value))
                if parameter.value is not None
                else f"not determined: {parameter.reason}"
                for parameter in (coefficients.thrust, coefficients.torque)
            ]
            rows.append(Row(motor, cells))
    return Table(
        label="Motor",
        heads=["k (N s²)", "b (N m s²)"],
        rows=rows,
        caption="T = k ω² and τ = b ω² by least squares over PWM, with thrust and torque at each voltage read from "
        f"straight lines over voltage; in air of {bench.density:.3f} kg/m³.",
    )


def _trims(
    bench: Bench, weight: float | None, voltage: float | None, motors: int | None
) -> tuple[Table | None, list[str]]:
    if weight is None:
        return None, [
            "Give the craft’s weight (--weight, N) and the PWM at which the motors carry it is read from the curves."
        ]
    rows, sentences = [], []
    for volts in _volts(bench, voltage):
        for motor in bench.motors:
            where = "at the voltage of the test" if volts is None else f"at {volts:.4g} V"
            try:
                trim = bench.trim(motor, weight, volts, motors)
            except BenchError as error:
                rows.append(Row(f"{motor} {where}", ["–", "–", "–"]))
                sentences.append(f"{error}.")
                continue
            cells = [number(trim.pwm, 4), number(trim.thrust), "–" if trim.speed is None else number(trim.speed)]
            rows.append(Row(f"{motor} {where}", cells))
            if volts == voltage or voltage is None:
                sentences.append(
                    f"Motor {motor} carries its share of {weight:.1f} N, {trim.thrust:.2f} N, at {trim.pwm:.0f} µs "
                    f"{where}."
                )
    return Table("Motor", ["PWM (µs)", "thrust (N)", "speed (rad/s)"], rows), sentences[:6]


def _curve(bench: Bench, voltage: float | None) -> str:
    try:
        command_curve = bench.command_curve(voltage=voltage)
    except BenchError as error:
        return f"The autopilot’s thrust curve is not determined: {error}."
    at = "" if math.isnan(command_curve.voltage) else f" at {command_curve.voltage:.1f} V"
    full = uncertain(command_curve.full_thrust.value, command_curve.full_thrust.sigma, "N")
    return (
        "With ArduPilot’s default PWM range (MOT_PWM 1000 to 2000 µs, MOT_SPIN_MIN 0.15, MOT_SPIN_MAX 0.95) full "
        f"command gives {full} per motor{at} in sea-level air, "
        f"and MOT_THST_EXPO {uncertain(command_curve.expo.value, command_curve.expo.sigma)} makes thrust linear."
    )


def _style(bench: Bench, motor: str) -> tuple[str, str]:
    at = bench.motors.index(motor)
    return _COLORS[at % len(_COLORS)], DASHES[at // len(_COLORS) % len(DASHES)]


def _over_pwm(bench: Bench, voltage: float | None) -> Figure:
    plot = Plot("thrust (N)", x="PWM (µs)")
    for motor in bench.motors:
        color, dash = _style(bench, motor)
        rows = bench.table.rows[bench.table.rows["motor"] == motor]
        over = bench.at_voltage(motor, voltage)
        plot.add(dots(rows["pwm"], rows["thrust"], motor, color), legend=False)
        plot.add(curve(over.index, over["thrust"], motor, color, dash=dash))
    at = "all voltages together" if voltage is None else f"{voltage:.4g} V"
    return plot.figure("pwm", f"Measured thrust (dots) and the curve that trim is read from ({at}).", 340)


def _over_speed(bench: Bench, voltage: float | None, name: str, title: str, symbol: str) -> Figure | None:
    plot = Plot(title, x="rotor speed (rad/s)")
    for motor in bench.motors:
        coefficients = bench.coefficients(motor, voltage)
        coefficient = coefficients.thrust if symbol == "k" else coefficients.torque
        if coefficient.value is None:
            continue
        color, dash = _style(bench, motor)
        over = bench.at_voltage(motor, voltage)
        grid = np.linspace(0.0, float(over["speed"].max()), 41)
        plot.add(dots(over["speed"], over[name], motor, color), legend=False)
        plot.add(curve(grid, coefficient.value * grid**2, motor, color, dash=dash))
    caption = f"{title.split(' (')[0].capitalize()} over rotor speed: measured (dots) and {symbol} ω² (line)."
    return plot.figure(f"speed-{symbol}", caption, 320) if plot.data else None


def _over_voltage(bench: Bench) -> Figure | None:
    if len(bench.voltages) < 2:
        return None
    plot = Plot("k (10⁻⁶ N s²)", x="battery voltage (V)")
    for motor in bench.motors:
        thrusts = [bench.coefficients(motor, volts).thrust.value for volts in bench.voltages]
        values = [1e6 * value for value in thrusts if value is not None]
        if len(values) == len(thrusts):
            color, dash = _style(bench, motor)
            plot.add(curve(bench.voltages, values, motor, color, dash=dash), mode="lines+markers")
    return plot.figure("voltage", "How the thrust coefficient follows the battery.", 300) if plot.data else None
