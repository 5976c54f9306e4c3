"""Thrust-stand tables: CSV of any layout with units in its headers, read into SI, with findings on implausible rows.

A table has one row per measurement: PWM, voltage, thrust, and where measured torque, speed and current, perhaps a motor
number (Kim 2017) and much else (RCbenchmark and Tyto write some twenty columns). Headers carry units in brackets:
``Thrust (gf)``, ``Torque (N·m)``, ``Motor Electrical Speed (RPM)``, ``ESC signal (µs)``, ``Voltage [V]``.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from core.findings import info, warning
from core.robust import robust_sigma
from core.units import STANDARD_GRAVITY
from logparse import Finding, RotoridError, Severity
from sysid.records.experiment import Floats

Flags = NDArray[np.bool_]

#: Columns of a `BenchTable` and their units.
COLUMNS = {"pwm": "us", "voltage": "V", "thrust": "N", "torque": "N m", "speed": "rad/s", "current": "A"}

_KGF = STANDARD_GRAVITY
_POUND = 4.4482216152605

#: Factor to SI by quantity and unit, the unit in lower case without blanks, dots and stars.
_UNITS: dict[str, dict[str, float]] = {
    "pwm": {"us": 1.0, "ms": 1000.0, "s": 1e6},
    "voltage": {"v": 1.0, "mv": 1e-3, "volt": 1.0, "volts": 1.0},
    "thrust": {
        **{"n": 1.0, "mn": 1e-3, "gf": _KGF / 1000.0, "g": _KGF / 1000.0, "kgf": _KGF, "kg": _KGF},
        **{"lbf": _POUND, "lb": _POUND, "ozf": _POUND / 16.0, "oz": _POUND / 16.0},
    },
    "torque": {
        **{"nm": 1.0, "n-m": 1.0, "mnm": 1e-3, "ncm": 0.01, "nmm": 1e-3, "kgfcm": _KGF / 100.0, "kgfm": _KGF},
        **{"gfcm": _KGF / 1e5, "lbfin": _POUND * 0.0254, "lbin": _POUND * 0.0254, "lbfft": _POUND * 0.3048},
        **{"ozfin": _POUND / 16.0 * 0.0254, "ozin": _POUND / 16.0 * 0.0254},
    },
    "speed": {
        **{"rpm": math.pi / 30.0, "1/min": math.pi / 30.0, "rad/s": 1.0, "rad/sec": 1.0},
        **{"hz": 2.0 * math.pi, "rps": 2.0 * math.pi, "rev/s": 2.0 * math.pi, "1/s": 2.0 * math.pi},
    },
    "current": {"a": 1.0, "ma": 1e-3, "amp": 1.0, "amps": 1.0},
    "density": {"kg/m3": 1.0, "kg/m^3": 1.0, "kg/m³": 1.0, "g/l": 1.0},
}

#: Words that name a quantity, the preferred first.
_WORDS: dict[str, tuple[str, ...]] = {
    "pwm": ("esc signal", "esc throttle", "pwm", "throttle", "signal", "esc"),
    "voltage": ("voltage", "volts", "volt"),
    "thrust": ("thrust", "force", "lift"),
    "torque": ("torque", "moment"),
    "speed": ("motor optical speed", "motor electrical speed", "rotation speed", "rotational speed", "rpm", "omega"),
    "current": ("current", "amps"),
    "density": ("air density", "density"),
    "motor": ("motor number", "motor no", "motor id", "motor", "engine"),
}

_UNIT = re.compile(r"[(\[]\s*([^)\]]*)\s*[)\]]")

#: Warning of an implausible measurement.
table_warning = partial(warning, "table-doubtful")

#: Thrust below this part of the largest is noise.
NOISE = 0.01


class BenchError(RotoridError):
    """A bench table or pendulum test that cannot be used."""


@dataclass(frozen=True, slots=True)
class BenchTable:
    """Measurements of a thrust stand."""

    name: str
    #: ``motor`` (str) and the columns of `COLUMNS` in SI; NaN where not measured. Implausible rows are left out.
    rows: pd.DataFrame
    density: float | None  #: Air at the stand, kg/m^3, where the table has it.
    findings: tuple[Finding, ...]

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the motors, in order."""
        return tuple(dict.fromkeys(self.rows["motor"]))


def read_bench(paths: Sequence[Path]) -> BenchTable:
    """Read thrust-stand tables: several motors in one table, or a table for each motor.

    Parameters
    ----------
    paths : sequence of Path
        CSV files; comma, semicolon or tab. A table without a motor column is one motor, ``m1``, ``m2`` ... in order.

    Raises
    ------
    BenchError
        When a table has no PWM or no thrust, or no plausible row is left.
    """
    findings: list[Finding] = []
    parts, densities = [], []
    for number, path in enumerate(paths, start=1):
        rows, density, more = _read(path, f"m{number}")
        findings += more
        parts.append(rows)
        densities += [] if density is None else [density]
    if not parts:
        raise BenchError("no bench table given")
    plausible = []
    for motor, rows in pd.concat(parts, ignore_index=True).groupby("motor", sort=False):
        rows, more = _plausible(str(motor), rows)
        plausible.append(rows)
        findings += more
    rows = pd.concat(plausible, ignore_index=True)
    if rows.empty:
        why = "; ".join(
            f"{finding.reason}: {finding.advice}" for finding in findings if finding.severity is Severity.WARNING
        )
        raise BenchError(f"{paths[0].name}: no plausible row is left: {why}")
    density = float(np.median(densities)) if densities else None
    return BenchTable(" + ".join(path.name for path in paths), rows, density, tuple(findings))


def _read(path: Path, motor: str) -> tuple[pd.DataFrame, float | None, list[Finding]]:
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise BenchError(f"{path}: {error.strerror or error}") from error
    numbered = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip(" ,;\t")]
    lines = [line for _, line in numbered]
    head = next((k for k, line in enumerate(lines) if _assign(_cells(line, line)).keys() >= {"pwm", "thrust"}), None)
    if head is None:
        columns = _assign(_cells(lines[0], lines[0])) if lines else {}
        missing = " and no ".join(
            label for key, label in {"pwm": "PWM (ESC signal)", "thrust": "thrust"}.items() if key not in columns
        )
        raise BenchError(
            f"{path.name}: no {missing} column; a bench table needs a header such as 'PWM (us), Voltage (V), "
            "Thrust (N), Torque (N m), RPM, Current (A)'"
        )
    header = _cells(lines[head], lines[head])
    columns = _assign(header)
    cells = [_cells(line, lines[head]) for line in lines[head + 1 :]]
    findings: list[Finding] = []
    data: dict[str, object] = {}
    for quantity in (*COLUMNS, "density"):
        if quantity not in columns:
            data[quantity] = np.full(len(cells), np.nan)
            continue
        at = columns[quantity]
        factor, remark = _factor(quantity, header[at], path.name)
        findings += remark
        data[quantity] = factor * np.array([_number(row[at]) if at < len(row) else np.nan for row in cells])
    density = np.asarray(data.pop("density"))
    rows = pd.DataFrame(data)
    at = columns.get("motor", -1)
    rows.insert(0, "motor", [_motor(row[at]) if 0 <= at < len(row) else motor for row in cells])
    measured = np.isfinite(rows["pwm"]) & np.isfinite(rows["thrust"])
    if not measured.any():
        raise BenchError(f"{path.name}: no row has both PWM and thrust as numbers")
    findings += _unread(path.name, [numbered[head + 1 + k][0] for k in np.flatnonzero(~measured)])
    air = density[measured.to_numpy() & np.isfinite(density)]
    return rows[measured], float(np.median(air)) if len(air) else None, findings


def _unread(file: str, lines: Sequence[int]) -> list[Finding]:
    """Report the lines without both PWM and thrust."""
    if not lines:
        return []
    where = ", ".join(str(line) for line in lines[:5]) + (" ..." if len(lines) > 5 else "")
    return [
        table_warning(
            f"{file}: {len(lines)} row(s) without PWM and thrust as numbers (line {where}); left out",
            "fill in what the stand measured, or delete these lines",
            file=file,
            rows=len(lines),
        )
    ]


def _cells(line: str, header: str) -> list[str]:
    separator = max(",;\t", key=header.count)
    cells = next(csv.reader([line], delimiter=separator), [])
    return [cell.strip() for cell in cells]


def _assign(header: Sequence[str]) -> dict[str, int]:
    """Find the column of each quantity."""
    plain = [re.sub(r"\s+", " ", _UNIT.sub(" ", name).replace("_", " ").strip().lower()) for name in header]
    # Words that mark a column as something else although it names a quantity.
    others = re.compile("efficiency|power|limit|cutoff|max|min|std|tare|command rate|kv|temperature")
    result: dict[str, int] = {}
    for quantity, words in _WORDS.items():
        for word in words:
            hits = [
                k
                for k, name in enumerate(plain)
                if re.search(rf"\b{word}\b", name)
                and not others.search(name)
                and k not in result.values()
                and (quantity != "motor" or (name.split()[0] in ("motor", "engine") and len(name.split()) <= 2))
            ]
            if hits:
                result[quantity] = hits[0]
                break
    return result


def _factor(quantity: str, header: str, file: str) -> tuple[float, list[Finding]]:
    """Return the factor to SI of a header's unit; if it has none, that of an assumed unit, with a finding."""
    written = _UNIT.search(header)
    unit = written[1] if written else (header if quantity == "speed" and "rpm" in header.lower() else "")
    if not written and "_" in header:
        unit = header.rsplit("_", 1)[1]
    key = re.sub(r"[\s·.*⋅]", "", unit).replace("µ", "u").replace("μ", "u").lower()
    known = _UNITS[quantity]
    if quantity == "speed" and "rpm" in key:
        key = "rpm"
    if key in known:
        return known[key], []
    if key and written:
        raise BenchError(f"{file}: unit {unit!r} of column {header!r} is not known; use one of {', '.join(known)}")
    assumed = next(iter(known))
    if quantity == "speed":
        assumed = "rpm"
    return known[assumed], [] if quantity in ("pwm", "voltage", "current") else [
        warning(
            "conditions-assumed",
            f"{file}: column {header!r} carries no unit; {'N m' if assumed == 'nm' else assumed.upper()} is assumed",
            "write units into the header, such as 'Thrust (gf)'",
            column=header,
        )
    ]


def _number(cell: str) -> float:
    for text in (cell, cell.replace(",", ".")):
        with suppress(ValueError):
            return float(text)
    return math.nan


def _motor(cell: str) -> str:
    digits = re.search(r"\d+", cell)
    return f"m{digits[0].lstrip('0') or 0}" if digits else (cell or "m1")


def _plausible(motor: str, rows: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Drop implausible rows, with a finding for each reason."""
    findings: list[Finding] = []

    def leave_out(bad: Flags, what: str, advice: str) -> None:
        nonlocal rows
        count = int(np.count_nonzero(bad))
        if count:
            where = ", ".join(f"{pwm:.0f}" for pwm in rows.loc[bad, "pwm"].head(5))
            findings.append(
                table_warning(
                    f"motor {motor}: {count} row(s) {what} (PWM {where}{' ...' if count > 5 else ''} us); left out",
                    advice,
                    motor=motor,
                    rows=count,
                )
            )
            rows = rows[~bad]

    pwm = rows["pwm"].to_numpy()
    outside = (pwm < 700.0) | (pwm > 2300.0)
    leave_out(outside, "with a PWM no ESC takes", "check the unit of PWM")
    if len(rows) and float(rows["thrust"].median()) < 0.0:
        rows = rows.assign(thrust=-rows["thrust"])
        findings.append(
            info(
                "table-doubtful",
                f"motor {motor}: thrust is counted negative (the stand pulls); its sign is turned",
                motor=motor,
            )
        )
    rows = rows.assign(torque=rows["torque"].abs())
    if rows.empty:
        return rows, findings
    largest = float(rows["thrust"].quantile(0.98))
    negative = rows["thrust"].to_numpy() < -NOISE * largest
    leave_out(negative, "with negative thrust", "tare the load cell before the test")
    with np.errstate(over="ignore", invalid="ignore"):  # absurdly large thrusts
        residual = _surface_residual(rows)
    scale = robust_sigma(residual)
    far = np.abs(residual) > max(6.0 * scale, 0.05 * float(rows["thrust"].max()))
    leave_out(far, "far from the curve of thrust over PWM", "repeat these points")
    findings += _power(motor, rows)
    return rows, findings


def _surface_residual(rows: pd.DataFrame) -> Floats:
    """Return thrust minus a robustly fitted cubic in PWM, with voltage terms if voltage varies."""
    pwm = rows["pwm"].to_numpy()
    x = (pwm - pwm.mean()) / max(float(np.std(pwm)), 1.0)
    columns = [np.ones_like(x), x, x**2, x**3][: min(4, rows["pwm"].round().nunique())]
    voltage = rows["voltage"].to_numpy()
    if np.isfinite(voltage).all() and np.ptp(voltage) > 0.05 * voltage.mean():
        v = (voltage - voltage.mean()) / np.std(voltage)
        columns += [v, v * x]
    a, y = np.column_stack(columns), rows["thrust"].to_numpy()
    weight = np.ones(len(y))
    residual = y
    for _ in range(30):
        root = np.sqrt(weight)
        residual = y - a @ np.linalg.lstsq(a * root[:, None], y * root, rcond=1e-10)[0]
        scale = max(robust_sigma(residual), 1e-6 * float(np.abs(y).max()), 1e-12)
        # Cauchy weights, so that a row in other units does not pull the curve.
        weight = 1.0 / (1.0 + (residual / (2.4 * scale)) ** 2)
    return np.asarray(residual)


def _power(motor: str, rows: pd.DataFrame) -> list[Finding]:
    """Report a shaft power above the electrical power."""
    shaft = (rows["torque"] * rows["speed"]).to_numpy()
    electric = (rows["voltage"] * rows["current"]).to_numpy()
    known = np.isfinite(shaft) & np.isfinite(electric) & (electric > 5.0)
    ratio = float(np.median(shaft[known] / electric[known])) if np.count_nonzero(known) > 2 else 0.0
    if ratio <= 1.0:
        return []
    return [
        table_warning(
            f"motor {motor}: the shaft gives {ratio:.1f} times the power that the battery puts in",
            "check the units of torque, speed and current, and the motor's pole count",
            motor=motor,
            ratio=ratio,
        )
    ]
