"""What a flight covered: how fast, how high, in which air and wind, how it moved, and how well that was logged.

Numbers here decide which flights train (`pipeline.flight.training`), where a model has been fitted and validated
(`pipeline.fleet.envelope`), and what to fly and log better (`pipeline.flight.next_flights`). Distributions are seconds
per bin of grids that are the same for all flights, so that those of several flights add up.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import pi
from typing import TYPE_CHECKING

import numpy as np

import sysid
from core.units import STANDARD_GRAVITY
from logparse.completeness import longest_step
from pipeline.flight.kinds import RIGID_BODY_KEY
from pipeline.results.coverage import (
    MAP,
    QUANTITIES,
    AxisExcitation,
    Cell,
    Coverage,
    Distribution,
    Linearity,
    LoggedRate,
    LogHealth,
    MeanWind,
    Movement,
    PositionSigma,
)
from sysid.records.context import resample_frame, shared_context
from sysid.records.excitation import Coherence
from sysid.records.motor_scaling import curve, motor_commands
from sysid.records.thrust_curve import VARYING
from sysid.rigid_body.model_record import WIND_HEIGHT, FlightTrim
from sysid.rigid_body.rotation import STILL

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray

    from estimation import Trajectory
    from logparse import FlightLog, Tables
    from pipeline.results.flight import ModelResult
    from pipeline.results.span import Span

    Floats = NDArray[np.float64]


#: Rate at which coverage is computed, Hz: that of motor outputs.
RATE = 10.0

#: Height below which the wind is that of this height, m, as in the equations of motion.
_LOWEST = 0.5


def measure(
    log: FlightLog,
    trajectory: Trajectory,
    flight: Span,
    models: Sequence[ModelResult] = (),
    *,
    experiments: Iterable[sysid.Experiment] = (),
    rates: Mapping[str, LoggedRate] | None = None,
) -> Coverage:
    """Measure what a flight covered, and how well it was logged: with its `rates`, where they are known already."""
    states = trajectory.states
    start, stop = max(flight.start, float(states.index[0])), min(flight.stop, float(states.index[-1]))
    t = start + np.arange(max(int((stop - start) * RATE), 1) + 1) / RATE
    context = shared_context([experiment.context for experiment in experiments], trajectory, log.tables, t)
    position = resample_frame(states[["p_n", "p_e", "p_d"]], t)
    missing: dict[str, str] = {}
    series: dict[str, Floats] = {
        "ground_speed": np.hypot(context["v_n"].to_numpy(), context["v_e"].to_numpy()),
        "climb_rate": -context["v_d"].to_numpy(),
        "altitude": position[0, 2] - position[:, 2],
        "density": context["density"].to_numpy(),
        "tilt": np.arccos(np.clip(np.cos(context["roll"]) * np.cos(context["pitch"]), -1.0, 1.0)).to_numpy(),
        "yaw_rate": np.abs(context["w_z"].to_numpy()),
    }
    if trajectory.unknown_position(flight.start, flight.stop):
        series["ground_speed"][:] = np.nan  # what inertial navigation alone drifted to
        missing["ground_speed"] = "the horizontal position is not known"
    if not np.isfinite(series["density"]).any():
        missing["density"] = "neither a barometer nor an altitude was logged"
    thrust = _thrust(log, t)
    if thrust is None:
        missing["thrust"] = "no motor output was logged"
    else:
        series["thrust"] = thrust
    trim = _fitted_wind(models)
    if trim is None:
        missing["wind"] = missing["airspeed"] = "no rigid body was fitted, and nothing else here tells the wind"
    else:
        height = np.maximum(max(position[0, 2], position[-1, 2]) - position[:, 2], _LOWEST)
        wind = trim.wind(t) * ((height / WIND_HEIGHT) ** trim.wind_exponent)[:, None]
        series["airspeed"] = np.hypot(context["v_n"] - wind[:, 0], context["v_e"] - wind[:, 1]).to_numpy()
    known = {
        name: quantity
        for name in QUANTITIES
        if (quantity := distribution(name, series.get(name, np.empty(0)))) is not None
    }
    return Coverage(
        seconds=len(t) / RATE,
        quantities=known,
        map=_cells(*(series[name] for name in MAP)),
        wind=None
        if trim is None
        else MeanWind.towards(
            float(trim.wind_n), float(trim.wind_e), float(trim.wind_sigma), "rigid body fitted to this flight"
        ),
        excitation=excitation_of(trajectory, context),
        health=log_health(log, trajectory, flight, logged_rates(log.tables, flight) if rates is None else rates),
        missing=missing,
    )


def _thrust(log: FlightLog, t: Floats) -> Floats | None:
    """Mean thrust command of the motors, in parts of full thrust; None without outputs."""
    motors = log.tables.motors
    if motors is None or len(motors) < 2:
        return None
    pwm = resample_frame(motors, t)
    pwm = pwm[:, np.isfinite(pwm).all(axis=0)]
    if not pwm.size:
        return None
    command = np.clip(motor_commands(pwm, log.vehicle), 0.0, 1.0)
    return np.asarray(curve(command, log.vehicle.thrust_expo).mean(axis=1))


def _fitted_wind(models: Sequence[ModelResult]) -> FlightTrim | None:
    """Return the wind that the rigid body was fitted with."""
    body = next((model.model for model in models if model.key == RIGID_BODY_KEY), None)
    if not isinstance(body, sysid.RigidBodyModel):
        return None
    return next((body.flights[name] for name in body.training if name in body.flights), None)


def distribution(name: str, values: Floats) -> Distribution | None:
    """Count a quantity out; None where it is not known."""
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    bins, quantity = _bins(name, values), QUANTITIES[name]
    first = int(bins.min())
    p05, median, p95 = (float(value) for value in np.percentile(values, [5.0, 50.0, 95.0]))
    return Distribution(
        title=quantity.title,
        unit=quantity.unit,
        min=float(values.min()),
        p05=p05,
        median=median,
        p95=p95,
        max=float(values.max()),
        step=quantity.step,
        first=first,
        seconds=tuple(float(count) / RATE for count in np.bincount(bins - first)),
    )


def _cells(x: Floats, y: Floats) -> tuple[Cell, ...]:
    known = np.isfinite(x) & np.isfinite(y)
    cells, counts = np.unique(
        np.column_stack([_bins(MAP[0], x[known]), _bins(MAP[1], y[known])]), axis=0, return_counts=True
    )
    return tuple((int(i), int(j), float(count) / RATE) for (i, j), count in zip(cells, counts, strict=True))


def _bins(name: str, values: Floats) -> NDArray[np.int64]:
    return np.floor(values / QUANTITIES[name].step).astype(np.int64)


#: Time over which changes of velocity are taken, s: shorter ones are noise of the estimate and gusts.
SPAN = 1.0

#: Frequencies over which coherence is summed up, rad/s: where a multirotor answers to its commands.
BAND = (0.5, 5.0)

#: Sectors of heading that are counted.
SECTORS = 8

#: Time in a sector of heading that counts, s.
IN_SECTOR = 3.0

#: Excitation in multiples of what hardly tells anything: below the first none, then weak, fair, strong.
_WORDS = ((0.5, "none"), (1.0, "weak"), (4.0, "fair"), (float("inf"), "strong"))


def excitation_of(trajectory: Trajectory, context: pd.DataFrame) -> Movement:
    """Measure how much a flight moved."""
    t = context.index.to_numpy(np.float64)
    dt = float(t[1] - t[0])
    velocity = context[["v_n", "v_e", "v_d"]].to_numpy()
    step = min(max(round(SPAN / dt), 1), len(t) - 1)
    change = (velocity[step:] - velocity[:-step]) / (step * dt)
    sigma = trajectory.sigma.loc[t[0] : t[-1], ["v_n", "v_e", "v_d"]].to_numpy(np.float64)
    yaw, departure = context["yaw"].to_numpy(), velocity[:, :2] - velocity[:, :2].mean(axis=0)
    along = np.cos(yaw) * departure[:, 0] + np.sin(yaw) * departure[:, 1]
    across = np.cos(yaw) * departure[:, 1] - np.sin(yaw) * departure[:, 0]
    # Sectors are centred on the points of the compass, so that a heading held north is one of them.
    sectors = np.rint(yaw * SECTORS / (2.0 * pi)).astype(np.int64) % SECTORS
    return Movement(
        acceleration_rms=_rms(change),
        # Errors a second apart are taken as independent, which can only make the noise larger than it is.
        acceleration_noise=float(np.sqrt(2.0 * np.mean(np.sum(sigma**2, axis=1))) / (step * dt))
        if len(sigma)
        else None,
        speed_std=(float(along.std()), float(across.std())),
        headings=int(np.sum(np.bincount(sectors, minlength=SECTORS) * dt >= IN_SECTOR)),
        axes=_axes(context, round(1.0 / dt)),
    )


def _rms(vectors: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def _axes(context: pd.DataFrame, per_second: int) -> dict[str, AxisExcitation]:
    force = context["f_z"].rolling(max(per_second, 1), center=True).mean().dropna().to_numpy()
    size = float(np.std(force)) if len(force) else 0.0
    axes = {
        axis: AxisExcitation(
            rms=float(context[rate].std(ddof=0)),
            unit="rad/s",
            word=word_of(float(context[rate].std(ddof=0)) / STILL),
        )
        for axis, rate in (("roll", "w_x"), ("pitch", "w_y"), ("yaw", "w_z"))
    }
    axes["thrust"] = AxisExcitation(rms=size, unit="m/s^2", word=word_of(size / (VARYING * STANDARD_GRAVITY)))
    return axes


def word_of(multiple: float) -> str:
    """Return the word for how much moved, as a multiple of what a craft at rest shows."""
    return next(word for limit, word in _WORDS if multiple < limit or limit == float("inf"))


def in_band(coherence: Coherence) -> dict[str, Linearity] | None:
    """Sum a coherence up over the frequencies at which a multirotor answers; None where it has none of them."""
    band = (coherence.frequency >= BAND[0]) & (coherence.frequency <= BAND[1])
    if not band.any():
        return None
    return {
        output: Linearity(
            multiple_median=float(np.median(multiple[band])),
            above_chance=float(np.mean(multiple[band] > coherence.threshold)),
        )
        for output, multiple in zip(coherence.output_names, coherence.multiple.T, strict=True)
    }


#: Tables whose rate is told.
_TABLES = ("motors", "imu", "gps", "baro", "mag", "battery", "esc", "attitude", "setpoints", "rates")

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


def log_health(log: FlightLog, trajectory: Trajectory, flight: Span, rates: Mapping[str, LoggedRate]) -> LogHealth:
    """Report how well a flight was logged."""
    sigma = trajectory.sigma.loc[flight.start : flight.stop]
    horizontal = (sigma["p_n"] ** 2 + sigma["p_e"] ** 2) ** 0.5
    parameters = log.parameters
    return LogHealth(
        rates=rates,
        position_sigma=PositionSigma(median=float(horizontal.median()), max=float(horizontal.max())),
        settings={
            name: float(parameters[name])
            for name in _SETTINGS
            if name in parameters and np.isfinite(float(parameters[name]))
        },
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
        rate = 1.0 / float(np.median(np.diff(t)))
        gaps = np.diff(np.concatenate(([flight.start], t, [flight.stop])))
        rates[name] = LoggedRate(
            rate=rate,
            gaps=int(np.count_nonzero(gaps > longest_step(rate))),
            longest_gap=float(gaps.max()),
        )
    return rates
