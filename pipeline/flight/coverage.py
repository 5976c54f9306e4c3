"""What a flight covered: how fast, how high, in which air and wind, how it moved, and how well that was logged.

Numbers here decide which flights train (`pipeline.flight.training`), where a model has been fitted and validated
(`pipeline.fleet.envelope`), and what to fly and log better (`pipeline.flight.advice`). Distributions are seconds per
bin of grids that are the same for all flights, so that those of several flights add up.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

import sysid
from pipeline.flight.excitation import excitation_of
from pipeline.flight.kinds import RIGID_BODY_KEY
from pipeline.flight.logged import log_health
from pipeline.results.coverage import MAP, QUANTITIES, Cell, Coverage, Distribution, LoggedRate, MeanWind
from sysid.records.context import resample_frame, shared_context
from sysid.records.motor_scaling import curve, motor_commands
from sysid.rigid_body.conditions.wind import WIND_HEIGHT, FlightTrim

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from estimation import Trajectory
    from logparse import FlightLog
    from pipeline.results.flight import ModelResult
    from pipeline.results.span import Span

    Floats = NDArray[np.float64]

#: Rate at which a flight is counted out into bins, Hz: that of motor outputs.
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
    """Measure what a flight covered."""
    states = trajectory.states
    start, stop = max(flight.start, float(states.index[0])), min(flight.stop, float(states.index[-1]))
    t = start + np.arange(max(int((stop - start) * RATE), 1) + 1) / RATE
    context = shared_context([each.context for each in experiments], trajectory, log.tables, t)
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
        name: found for name in QUANTITIES if (found := distribution(name, series.get(name, np.empty(0)))) is not None
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
        health=log_health(log, trajectory, flight, rates),
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
    body = next((each.model for each in models if each.key == RIGID_BODY_KEY), None)
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
