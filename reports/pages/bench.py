"""The page of a thrust-stand test: coefficients over voltage, trim, curves, findings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from core.quantity import number, uncertain
from core.table import Row, Table
from logparse import Finding
from reports.figures.figure import Figure, Trace, layout_of
from reports.pages.html import render
from sysid.bench.stand import Bench
from sysid.bench.table import BenchError

#: Colours of motors, the same in every plot of the page, and their line styles beyond the first four.
_COLORS = ("@own", "@joint", "@mixer", "@body")
_DASHES = ("solid", "dash", "dot", "dashdot")


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchPage:
    """What bench.html shows."""

    title: str
    facts: str
    sentences: Sequence[str]
    trims: Table | None
    coefficients: Table
    curve: str
    findings: Sequence[Finding]
    bench_figures: Sequence[Figure]


def bench_page(
    bench: Bench, weight: float | None = None, voltage: float | None = None, motors: int | None = None
) -> str:
    """Render the page.

    Parameters
    ----------
    bench : Bench
    weight : float, optional
        N; with it the page tells the trim.
    voltage : float, optional
        V, for coefficients and trim besides the tested ones.
    motors : int, optional
        How many carry the weight.
    """
    figures = [
        _over_pwm(bench, voltage),
        _over_speed(bench, voltage, "thrust", "thrust (N)", "k"),
        _over_speed(bench, voltage, "torque", "torque (N m)", "b"),
        _over_voltage(bench),
    ]
    drawn = [figure for figure in figures if figure is not None]
    trims, sentences = _trims(bench, weight, voltage, motors)
    page = BenchPage(
        title=f"Thrust stand: {bench.table.name}",
        facts=_facts(bench),
        sentences=sentences,
        trims=trims,
        coefficients=_coefficients(bench, voltage),
        curve=_curve(bench, voltage),
        findings=bench.findings,
        bench_figures=drawn,
    )
    return render("bench.html", drawn, page)


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
            found = bench.coefficients(motor, volts)
            cells = [
                # No stand measures to better than a thousandth.
                uncertain(each.value, max(each.sigma or 0.0, 1e-3 * each.value))
                if each.value is not None
                else f"not determined: {each.reason}"
                for each in (found.thrust, found.torque)
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
        found = bench.command_curve(voltage=voltage)
    except BenchError as error:
        return f"The autopilot’s thrust curve is not determined: {error}."
    at = "" if math.isnan(found.voltage) else f" at {found.voltage:.1f} V"
    full = uncertain(found.full_thrust.value, found.full_thrust.sigma, "N")
    return (
        "With ArduPilot’s default PWM range (MOT_PWM 1000 to 2000 µs, MOT_SPIN_MIN 0.15, MOT_SPIN_MAX 0.95) full "
        f"command gives {full} per motor{at} in sea-level air, "
        f"and MOT_THST_EXPO {uncertain(found.expo.value, found.expo.sigma)} makes thrust linear."
    )


def _style(bench: Bench, motor: str) -> tuple[str, str]:
    at = bench.motors.index(motor)
    return _COLORS[at % len(_COLORS)], _DASHES[at // len(_COLORS) % len(_DASHES)]


def _dots(x: list[float], y: list[float], name: str, color: str) -> Trace:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": x,
        "y": y,
        "name": name,
        "marker": {"color": color, "size": 5, "opacity": 0.6},
        "showlegend": False,
    }


def _line(x: list[float], y: list[float], name: str, style: tuple[str, str]) -> Trace:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": name,
        "line": {"color": style[0], "dash": style[1], "width": 2},
    }


def _over_pwm(bench: Bench, voltage: float | None) -> Figure:
    data: list[Trace] = []
    for motor in bench.motors:
        style = _style(bench, motor)
        rows = bench.table.rows[bench.table.rows["motor"] == motor]
        curve = bench.at_voltage(motor, voltage)
        data.append(_dots(_plain(rows["pwm"], 1), _plain(rows["thrust"], 4), motor, style[0]))
        data.append(_line(_plain(curve.index, 1), _plain(curve["thrust"], 4), motor, style))
    at = "all voltages together" if voltage is None else f"{voltage:.4g} V"
    layout = layout_of(xaxis={"title": {"text": "PWM (µs)"}}, yaxis={"title": {"text": "thrust (N)"}})
    caption = f"Measured thrust (dots) and the curve that trim is read from ({at})."
    return Figure("pwm", caption, data, layout, 340, False)


def _over_speed(bench: Bench, voltage: float | None, name: str, title: str, symbol: str) -> Figure | None:
    data: list[Trace] = []
    for motor in bench.motors:
        found = bench.coefficients(motor, voltage)
        coefficient = found.thrust if symbol == "k" else found.torque
        if coefficient.value is None:
            continue
        style = _style(bench, motor)
        curve = bench.at_voltage(motor, voltage)
        top = float(curve["speed"].max())
        grid = [top * k / 40.0 for k in range(41)]
        data.append(_dots(_plain(curve["speed"], 1), _plain(curve[name], 5), motor, style[0]))
        data.append(
            _line([round(w, 1) for w in grid], [round(coefficient.value * w * w, 5) for w in grid], motor, style)
        )
    if not data:
        return None
    layout = layout_of(xaxis={"title": {"text": "rotor speed (rad/s)"}}, yaxis={"title": {"text": title}})
    caption = f"{title.split(' (')[0].capitalize()} over rotor speed: measured (dots) and {symbol} ω² (line)."
    return Figure(f"speed-{symbol}", caption, data, layout, 320, False)


def _over_voltage(bench: Bench) -> Figure | None:
    if len(bench.voltages) < 2:
        return None
    data: list[Trace] = []
    for motor in bench.motors:
        found = [bench.coefficients(motor, volts).thrust.value for volts in bench.voltages]
        if all(value is not None for value in found):
            values = [round(1e6 * value, 3) for value in found if value is not None]
            data.append(
                _line([round(v, 2) for v in bench.voltages], values, motor, _style(bench, motor))
                | {"mode": "lines+markers"}
            )
    if not data:
        return None
    layout = layout_of(
        xaxis={"title": {"text": "battery voltage (V)"}},
        yaxis={"title": {"text": "k (10⁻⁶ N s²)"}},
    )
    return Figure("voltage", "How the thrust coefficient follows the battery.", data, layout, 300, False)


def _plain(values: Any, decimals: int) -> list[float]:
    return [round(float(value), decimals) for value in values]
