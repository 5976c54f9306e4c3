"""How well a flight was logged: rates and gaps of its tables, GPS, vibration, battery, and the settings behind them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pipeline.flight.account.readings import Readings
from pipeline.results.coverage import BatteryUse, GpsQuality, LoggedRate, LogHealth, PositionSigma, Vibration

if TYPE_CHECKING:
    from estimation import Trajectory
    from logparse import FlightLog, Tables
    from pipeline.results.span import Span

#: Tables whose rate is told.
_TABLES = ("motors", "imu", "gps", "baro", "mag", "battery", "esc", "attitude", "setpoints", "rates")

#: Time without a row that counts as a gap, s, and as a multiple of the usual interval where that is long.
_GAP, _INTERVALS = 1.0, 5.0

#: Parameters that decide what is logged how fast.
_SETTINGS = (
    "LOG_BITMASK",
    "LOG_DISARMED",
    "LOG_FILE_RATEMAX",
    "SCHED_LOOP_RATE",
    "BATT_MONITOR",
    "GPS_RATE_MS",
    "GPS1_RATE_MS",
    "SERVO_BLH_TRATE",
    "SERVO_BLH_BDMASK",
    "SDLOG_PROFILE",
)


def log_health(
    log: FlightLog, trajectory: Trajectory, flight: Span, rates: Mapping[str, LoggedRate] | None = None
) -> LogHealth:
    """Measure how well a flight was logged."""
    sigma = trajectory.sigma.loc[flight.start : flight.stop]
    horizontal = (sigma["p_n"] ** 2 + sigma["p_e"] ** 2) ** 0.5
    parameters = log.parameters
    return LogHealth(
        rates=logged_rates(log.tables, flight) if rates is None else rates,
        gps=_gps(log.tables, flight),
        vibration=_vibration(log, flight),
        battery=_battery(log.tables, flight),
        position_sigma=PositionSigma(median=float(horizontal.median()), max=float(horizontal.max())),
        settings={
            name: float(parameters[name])
            for name in _SETTINGS
            if name in parameters and np.isfinite(float(parameters[name]))
        },
        format=log.format,
    )


def logged_rates(tables: Tables, flight: Span) -> dict[str, LoggedRate]:
    """Measure how fast each table was logged in flight, and with which gaps."""
    rates = {}
    for name in _TABLES:
        whole = tables.times(name)
        if whole is None:
            continue
        t = whole[(whole >= flight.start) & (whole <= flight.stop)]
        if len(t) < 2:
            continue
        usual = float(np.median(np.diff(t)))
        gaps = np.diff(np.concatenate(([flight.start], t, [flight.stop])))
        rates[name] = LoggedRate(
            rate=1.0 / usual,
            gaps=int(np.count_nonzero(gaps > max(_GAP, _INTERVALS * usual))),
            longest_gap=float(gaps.max()),
        )
    return rates


def _gps(tables: Tables, flight: Span) -> GpsQuality | None:
    if tables.gps is None:
        return None
    fixes = tables.gps.loc[flight.start : flight.stop]
    if not len(fixes):
        return None
    known = {name: fixes[name].dropna() for name in ("satellites", "hdop", "h_acc", "s_acc")}
    return GpsQuality(
        fix_part=float(((fixes["fix"] >= 3.0) & fixes["lat"].notna()).mean()),
        **{name: float(values.median()) for name, values in known.items() if len(values)},
    )


def _vibration(log: FlightLog, flight: Span) -> Vibration | None:
    measured = Readings.of(log, flight).vibration
    inside = None if measured is None else (measured.t >= flight.start) & (measured.t <= flight.stop)
    if measured is None or measured.relative or inside is None or not inside.any():
        return None
    return Vibration(
        p95=float(np.percentile(measured.level[inside], 95.0)),
        above=float((measured.level[inside] > measured.advised).mean()),
        clips=measured.clipped(flight) or 0,
    )


def _battery(tables: Tables, flight: Span) -> BatteryUse | None:
    if tables.battery is None:
        return None
    flown = tables.battery.loc[flight.start : flight.stop]
    voltage = flown["voltage"][flown["voltage"] > 1.0]
    if not len(voltage):
        return None
    current = flown["current"].dropna()
    return BatteryUse(
        first=float(voltage.iloc[0]),
        last=float(voltage.iloc[-1]),
        min=float(voltage.min()),
        mean_current=float(current.mean()) if len(current) else None,
    )
