"""How well a flight was logged: rates and gaps of its tables, GPS, vibration, battery, and the settings behind them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pipeline.flight.account import state
from pipeline.flight.account.readings import Readings
from pipeline.results.coverage import LoggedRate, LogHealth, PositionSigma

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
    parameters, readings = log.parameters, Readings.of(log, flight)
    return LogHealth(
        rates=logged_rates(log.tables, flight) if rates is None else rates,
        gps=state.gps(readings),
        vibration=state.worst_vibration(readings),
        battery=state.battery(readings),
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
