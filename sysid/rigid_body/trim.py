"""Wind and thrust scale of one flight, for a craft whose parameters are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from logparse import Finding, Severity
from sysid.records.experiment import Floats
from sysid.rigid_body._rigid_kernels import LEVEL_BELOW
from sysid.rigid_body.body_motion import BLOCK_SECONDS, LAG, OWN, SHARED, BodyMotion, velocity_increments
from sysid.rigid_body.carried import (
    ANY_FLIGHT,
    ANY_SIGMA,
    FIXED,
    HIGHEST,
    LOWEST,
    WIND_SIGMA,
    Carried,
    along_run,
    carry_states,
)
from sysid.rigid_body.model_record import LIGHT, TURBULENCE, FlightTrim, varying_wind
from sysid.rigid_body.systematic import wind_error
from sysid.rotors.thrust_regression import AIR_SIGMA

#: Place of the first wind coefficient among the parameters of a flight.
_WIND = len(OWN)


def trim_prior() -> tuple[Floats, Floats, Floats, Floats]:
    """Return mean, sigma and limits of a training flight's exponent, thrust scale and wind.

    Flights that are fitted together are of one load, so that air temperature is what their thrust may differ by.
    """
    return ANY_FLIGHT, np.array([ANY_SIGMA[0], AIR_SIGMA, WIND_SIGMA, WIND_SIGMA]), LOWEST, HIGHEST


def early_trim(flight: BodyMotion, shared: Floats, law: int, source: str, craft_covariance: Floats) -> FlightTrim:
    """Find wind and thrust scale from the beginning of a flight, for what comes after it.

    They are what a filter that knows gusts for gusts expects of the rest of the flight: matching one free run would
    take every gust for the mean, and paths that are tens of metres off for noise that prior knowledge outvotes.

    `craft_covariance` is that of the craft's parameters as `left_open` returns it.
    """
    states = carry_states(flight, shared, law)
    trim = _trim(flight, shared, law, source, states, states.own[-1], craft_covariance)
    return replace(trim, looked_until=float(flight.t[-1]))


def whole_trim(
    flight: BodyMotion, shared: Floats, law: int, source: str, spacing: float | None, craft_covariance: Floats
) -> FlightTrim:
    """Match the free run over a whole flight from the measured initial state by wind and thrust scale alone.

    The start and the wind's exponent are those of the filter (`early_trim`), and so are standard errors, because one
    free run has no scatter to tell errors from; what lies between the two is added. The mean of a wind that varies goes
    to the mean wind.
    """
    states, knots = carry_states(flight, shared, law), wind_knots(flight.t, spacing)
    values = match_path(flight, shared, states, law, knots)
    own, departures = values[:FIXED].copy(), values[FIXED:].reshape(-1, 2)
    if len(knots):
        # Each knot stands for the time about it.
        width = np.gradient(knots)
        width[[0, -1]] *= 0.5
        average = width @ departures / width.sum()
        own[_WIND:], departures = own[_WIND:] + average, departures - average
    variation = tuple((float(t), float(n), float(e)) for t, (n, e) in zip(knots, departures, strict=True))
    return replace(_trim(flight, shared, law, source, states, own, craft_covariance, whole=True), variation=variation)


def _trim(
    flight: BodyMotion,
    shared: Floats,
    law: int,
    source: str,
    states: Carried,
    own: Floats,
    craft_covariance: Floats,
    *,
    whole: bool = False,
) -> FlightTrim:
    """Name exponent, thrust scale and wind of a flight, (4,), with errors by a filter to which the craft is open.

    Errors for runs are those of what a filter found with the craft's parameters held (`states`); that of the wind holds
    the attitude's besides. The mean wind of a `whole` flight is that with which its forces balance, gusts included: a
    filter's is of a process, of which the flight is a sample.
    """
    wide = carry_states(flight, shared, law, craft_covariance=craft_covariance, like=states)
    at_best = known_at_best(own[_WIND:]) ** 2
    errors = np.diag(wide.covariances[-1])[:FIXED] + (own - wide.own[-1]) ** 2 + at_best
    in_runs = np.sqrt(np.diag(states.covariances[-1])[:FIXED] + at_best).tolist()
    blocks = velocity_increments(flight, np.concatenate([shared, own]), law)
    pushed = np.concatenate([blocks.by_craft, blocks.by_flight], axis=2)[:, :2].mean(axis=0)
    to_wind = np.linalg.pinv(pushed[:, SHARED + _WIND :], rcond=1e-9)
    if whole:
        others = scipy.linalg.block_diag(craft_covariance, np.diag(errors[:_WIND]))
        slope = to_wind @ pushed[:, : SHARED + _WIND]
        noise = states.wander.noise(blocks.seconds)[0] / len(blocks.missed) * to_wind @ to_wind.T
        errors[_WIND:] = np.diag(slope @ others @ slope.T + noise) + at_best[_WIND:]
    drag = float(np.sqrt(abs(np.linalg.det(pushed[:, SHARED + _WIND :])))) / blocks.seconds
    leant = wind_error(flight, own[_WIND:], drag)
    exponent, scale, north, east = own.tolist()
    exponent_sigma, scale_sigma = np.sqrt(errors[:_WIND]).tolist()
    known = 1.0 / (errors[_WIND:].max() + leant**2) + 1.0 / WIND_SIGMA**2  # nothing is known worse than beforehand
    return FlightTrim(
        wind_n=north,
        wind_e=east,
        wind_sigma=float(known**-0.5),
        in_runs=(in_runs[0], in_runs[1], max(in_runs[_WIND:])),
        thrust_scale=scale,
        thrust_scale_sigma=scale_sigma,
        source=source,
        wind_exponent=exponent,
        wind_exponent_sigma=exponent_sigma,
    )


def match_path(flight: BodyMotion, shared: Floats, states: Carried, law: int, knots: Floats) -> Floats:
    """Find thrust scale and wind, (4 + 2 k,), by which the free run is nearest to the measured path.

    What the path leaves open is as a filter found it (in hovers runs ended in winds of 50 m/s); the wind's exponent
    stays. Winds at the k `knots` depart from the mean as far as turbulence lets them.
    """
    start, sigma = states.own[-1], np.sqrt(np.diag(states.covariances[-1])[1:FIXED])
    gust = TURBULENCE * max(float(np.hypot(*start[_WIND:])), LIGHT)
    half = max(round(BLOCK_SECONDS / flight.dt), 1)
    every = 2 * half
    first = np.concatenate([start[1:], np.zeros(2 * len(knots))])

    def run(own: Floats) -> Floats:
        wind = varying_wind(flight.t, own[1:3], knots, own[3:].reshape(-1, 2))
        return flight.run(np.concatenate([shared, start[:1], own[:1], [1.0, 0.0, 0.0, 1.0]]), wind, law)

    def missed(own: Floats) -> Floats:
        return np.asarray((run(own)[::every, :3] - flight.position[::every]).ravel())

    spread = max(float(np.sqrt(np.mean(missed(first) ** 2))), 1e-4) if len(knots) else 1.0

    def weighted(own: Floats) -> Floats:
        return np.concatenate([missed(own) / spread, (own - first) / scales])

    more = np.full(2 * len(knots), HIGHEST[-1])
    limits = np.concatenate([LOWEST[1:], -more]), np.concatenate([HIGHEST[1:], more])
    scales = np.concatenate([sigma, np.full(2 * len(knots), gust)])
    # A path is nearly linear in the wind, so that its slopes at the start serve for all steps.
    theta = np.concatenate([shared, start])
    by_path = _path_slopes(flight, run(first), theta, law, knots, np.arange(0, len(flight.t), half))[::2]
    slopes = np.vstack([by_path.reshape(-1, len(first)) / spread, np.diag(1.0 / scales)])

    def slope(_: Floats) -> Floats:
        return slopes

    solution = scipy.optimize.least_squares(weighted, first, slope, bounds=limits, x_scale=scales, ftol=1e-3)
    return np.concatenate([start[:1], solution.x])


def _path_slopes(flight: BodyMotion, run: Floats, theta: Floats, law: int, knots: Floats, edges: np.ndarray) -> Floats:
    """Differentiate the positions of a free run by thrust scale, mean wind and departures at `knots` at some samples.

    Integrated beside the run as the errors of `drift_sigma` are (Heun's method); shape (edges, 3, 1 + 2 w).
    """
    by_theta, by_velocity = along_run(flight, run, theta, law, edges)
    scale, wind = SHARED + _WIND - 1, slice(SHARED + _WIND, SHARED + _WIND + 2)
    by_wind = by_theta[:, :, wind]
    shapes = wind_shapes(flight.t[edges], knots)
    drive = np.concatenate(
        [by_theta[:, :, scale : scale + 1], *(by_wind * shape[:, None, None] for shape in shapes.T)], axis=2
    )
    # A craft that climbs meets more wind, as a power of the height.
    height = flight.ground - run[edges, 2:3]
    steeper = np.where(height > LEVEL_BELOW, theta[scale - 1] / np.maximum(height, LEVEL_BELOW), 0.0)
    by_down = -steeper * (by_wind @ theta[wind])
    state = np.zeros((len(edges), 6, drive.shape[2]))

    def rate(k: int, x: Floats) -> Floats:
        return np.concatenate([x[3:], by_velocity[k] @ x[3:] + np.outer(by_down[k], x[2]) + drive[k]])

    for k, seconds in enumerate(np.diff(flight.t[edges])):
        first = rate(k, state[k])
        state[k + 1] = state[k] + 0.5 * seconds * (first + rate(k + 1, state[k] + seconds * first))
    return state[:, :3]


def known_at_best(wind: Floats) -> Floats:
    """Return the least standard deviations of exponent, thrust scale and wind, (4,), in a wind [m/s], (2,)."""
    # Where the ground is and how the wind grows with height above it are not known better. Winds carried through 13
    # firmware flights err by up to 4 % of 0.8 m/s, by nothing in calm. Shaken
    # by chirps, craft miss their thrust scale by 1 to 3 times as much as is said here.
    best = float(np.hypot(0.002, 0.02 * np.hypot(*wind)))
    return np.array([0.02, 1e-3, best, best])


def unusual_thrust(flight: str, trim: FlightTrim) -> Finding | None:
    """Return a finding where the thrust scale of a flight is not what air temperature explains."""
    departure, sigma = trim.thrust_scale - 1.0, float(np.hypot(AIR_SIGMA, trim.thrust_scale_sigma))
    if abs(departure) <= 2.5 * sigma:
        return None
    heavier = "less" if departure < 0.0 else "more"
    return Finding(
        "thrust-differs",
        Severity.WARNING,
        f"at the same commands the thrust per mass of {flight} is {100.0 * abs(departure):.1f} % {heavier} than that "
        f"of the flights fitted, {abs(departure) / sigma:.1f} times what air temperature explains: another payload, "
        "battery or propellers, or another craft",
        "weigh the craft and check battery and propellers; fit flights of one load together",
        {"flight": flight, "thrust_scale": trim.thrust_scale, "sigma": trim.thrust_scale_sigma},
    )


def wind_knots(t: Floats, spacing: float | None) -> Floats:
    """Place the points in time of a varying wind; none for a constant one."""
    if spacing is None:
        return np.zeros(0)
    count = max(round((t[-1] - t[0]) / spacing), 1)
    return np.linspace(t[0], t[-1], count + 1)


def wind_shapes(t: Floats, knots: Floats) -> Floats:
    """Arrange how the wind varies: a constant, and a triangle of height 1 about each knot; shape (N, 1 + knots)."""
    shapes = np.ones((len(t), 1 + len(knots)))
    for column, row in enumerate(np.eye(len(knots)), start=1):
        shapes[:, column] = np.interp(t, knots, row)
    return shapes


def left_open(covariance: Floats) -> Floats:
    """Return the covariance of a craft's parameters, (SHARED, SHARED), without what a trim compensates.

    That is the part that a flight's thrust scale compensates, and the lag, whose effect is small.
    """
    left = covariance.copy()
    left[LAG], left[:, LAG] = 0.0, 0.0
    left[0, 0] = left[0, 1:] @ np.linalg.pinv(left[1:, 1:]) @ left[1:, 0]
    return left
