"""Assessment of a model by purpose: prediction some seconds ahead, free simulation of whole flights, parameters.

One verdict for all three misleads: a rigid body that drifts away over a minute may be right a second ahead, and one
axis that is wrong by ten times spoils a free run however good the others are. Each use has its own verdict, with the
number that supports it, from held-out flights. Flights outside the envelope of the training flights are counted
separately, because there a model extrapolates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from sysid.validation.uses import FEWEST_HELD_OUT, NO_MODEL, FreeRunUse, ParameterUse, PredictionUse, Trust, Uses

#: Relative standard error from which on a reach is not stated.
VAGUE = 0.5

#: Fit from which on a free run follows a flight: an error below half of the flight's RMS movement.
CLOSE_PERCENT = 50.0

#: Relative reduction of a baseline's error that is more than chance.
MARGIN = 0.05

#: Part of the error of constant position and of constant velocity below which a prediction is useful.
HALF = 0.5

#: Shortest held-out record for a free run, s: the first three seconds give the initial state.
SHORTEST_HELD_OUT = 10.0


def uses_of(
    model: object | None,
    free_runs: pd.DataFrame | None = None,
    horizons: pd.DataFrame | None = None,
    outside: Set[str] = frozenset(),
) -> Uses:
    """Assess a model by purpose, from its validation; flights `outside` the training envelope count separately."""
    prediction, free_run = PredictionUse(), FreeRunUse(trust=Trust.UNKNOWN, reason=NO_MODEL)
    if free_runs is not None:
        free_run = _free_run(free_runs, outside)
        held_out = _held_out(free_runs)
        if horizons is not None and len(held_out) and len(horizons):
            seconds = float(_within(held_out, outside).groupby("flight")["duration"].first().sum())
            prediction = _prediction(_within(_held_out(horizons), outside), seconds)
    determined = list(_determined(model))
    parameters = ParameterUse.counted(determined, confirmed=bool(prediction.horizons_s))
    return Uses(prediction=prediction, free_run=free_run, parameters=parameters)


def _held_out(table: pd.DataFrame) -> pd.DataFrame:
    return table[~table["trained"].astype(bool)]


def _prediction(table: pd.DataFrame, seconds: float) -> PredictionUse:
    """Find how far ahead every axis halves the error of constant position and velocity, from `seconds` of flight."""
    columns = ["rmse", "rmse_constant_position", "rmse_constant_velocity"]
    means = table.groupby(["horizon", "output"], sort=False)[columns].mean().reset_index()
    means["excess"] = np.log(means["rmse"] / (HALF * means[columns[1:]].min(axis=1)))
    means["good"] = means["excess"] < 0.0
    horizons = means.groupby("horizon").agg({"excess": "max", "good": "all"})
    good = horizons["good"].to_numpy()
    first = int(np.argmax(good))
    end = first + int(np.argmin([*good[first:], False]))
    run = tuple(float(horizon) for horizon in horizons.index[first:end])
    if not run:
        return PredictionUse.up_to((), {})
    last = means[means["horizon"] == run[-1]]
    errors = {str(output): float(rmse) for output, rmse in zip(last["output"], last["rmse"], strict=True)}
    reach, sigma = _reach(horizons["excess"].iloc[end - 1 : end + 1], seconds)
    return replace(PredictionUse.up_to(run, errors), reach_s=reach, reach_sigma_s=sigma)


def _reach(excess: pd.Series, seconds: float) -> tuple[float | None, float | None]:
    """Interpolate where the error of the worst axis reaches half of the baselines', with its standard error.

    Logarithms are interpolated. The logarithm of the RMS error of n independent predictions, those one horizon apart,
    has the standard error 1 / sqrt(2 n); that of the ratio of two, taken as independent, 1 / sqrt(n).
    """
    if len(excess) < 2 or not np.isfinite(excess).all() or excess.iloc[1] <= excess.iloc[0]:
        return None, None
    (below, above), (last, after) = excess.to_numpy(), excess.index.to_numpy(float)
    slope = (above - below) / np.log(after / last)
    reach = float(last * np.exp(-below / slope))
    relative = float(max(seconds / reach, 1.0) ** -0.5 / slope)
    return (reach, reach * relative) if relative < VAGUE else (None, None)


def _free_run(table: pd.DataFrame, outside: Set[str]) -> FreeRunUse:
    """Assess the free run on held-out flights, those outside the training envelope separately."""
    scored = _held_out(table)
    if scored.empty:
        return FreeRunUse(trust=Trust.UNKNOWN, reason="The model is not judged: every flight was used to fit it")
    longest = float(scored["duration"].max())
    if longest < SHORTEST_HELD_OUT:
        why = f"{longest:.0f} s of held-out flight are too short; {SHORTEST_HELD_OUT:.0f} s or more are needed"
        return FreeRunUse(trust=Trust.UNKNOWN, reason=f"The model could not be judged: {why}")
    chosen = _within(scored, outside)
    outputs = [str(output) for output in scored["output"].unique()]
    averaged = chosen.groupby("output", sort=False)[[column for column in _ERRORS if column in chosen]].mean()
    means = {str(output): {str(k): float(v) for k, v in row.items()} for output, row in averaged.iterrows()}
    ratios = {output: _ratio(means[output]) for output in outputs}
    fit = chosen.groupby("output", sort=False)["fit_percent"].mean()
    training = table[table["trained"].astype(bool)]
    own = training.groupby("output", sort=False)["fit_percent"].mean()
    follows = tuple(
        output
        for output in outputs
        # An output that does not even follow the training flights is right on others by chance.
        if fit[output] >= CLOSE_PERCENT and _beats(means[output]) and (output not in own or own[output] > 0.0)
    )
    fits = {str(flight): rows["fit_percent"].to_list() for flight, rows in scored.groupby("flight", sort=False)}
    followed = {flight for flight, values in fits.items() if all(value >= CLOSE_PERCENT for value in values)}
    within, beyond = fits.keys() - outside, fits.keys() & outside
    percents = [percent for flight in followed & within for percent in fits[flight]]
    complete = set(follows) == set(outputs)
    as_good = tuple(output for output in outputs if _as_good_as_target(means[output]))
    run = FreeRunUse(
        trust=Trust.NO,
        error_over_mean=ratios,
        follows=follows,
        as_good_as_target=as_good,
        better_than_target=tuple(o for o in outputs if o not in as_good and _beats_target(means[o])),
        fit_percent=(min(percents), max(percents)) if percents else None,
        flights_within=len(within),
        followed_within=len(followed & within),
        flights_outside=len(beyond),
        followed_outside=len(followed & beyond),
    )
    if run.far:
        trust = Trust.NO
    elif complete and run.flights_within >= FEWEST_HELD_OUT:
        trust = Trust.YES
    elif complete:
        trust = Trust.LIMITED
    elif chosen["flight"].nunique() < FEWEST_HELD_OUT:
        # A single record must be followed in every axis.
        trust = Trust.LIMITED if follows and set(follows) | set(run.excused) == set(outputs) else Trust.NO
    else:
        trust = Trust.LIMITED if follows else Trust.NO
    return replace(run, trust=trust)


#: Errors of free runs and of baselines without a model.
_ERRORS = ("rmse", "rmse_mean", "rmse_constant_position", "rmse_constant_velocity", "rmse_reference")


def _within(table: pd.DataFrame, outside: Set[str]) -> pd.DataFrame:
    """Drop flights outside the envelope, unless there are no others."""
    inside = table[~table["flight"].isin(list(outside))]
    return inside if len(inside) else table


def _ratio(errors: Mapping[str, float]) -> float | None:
    error, mean = errors["rmse"], errors["rmse_mean"]
    return error / mean if np.isfinite(error) and mean > 0.0 else None


def _beats(errors: Mapping[str, float]) -> bool:
    baselines = [errors[name] for name in _ERRORS[2:4] if name in errors]
    return all(errors["rmse"] < (1.0 - MARGIN) * baseline for baseline in baselines if np.isfinite(baseline))


def _as_good_as_target(errors: Mapping[str, float]) -> bool:
    """Return whether the model's error equals that of the target itself, within `MARGIN`."""
    target = errors.get("rmse_reference", float("nan"))
    return bool(np.isfinite(target)) and abs(errors["rmse"] - target) <= MARGIN * target


def _beats_target(errors: Mapping[str, float]) -> bool:
    return bool(errors["rmse"] < errors.get("rmse_reference", float("nan")))


def _determined(model: object | None) -> Iterator[bool]:
    """Yield for each parameter or coefficient of a model whether it is determined."""
    parameters: Any = getattr(model, "parameters", None)
    if isinstance(parameters, Mapping):
        yield from (bool(parameter.determined) for parameter in parameters.values())
        return
    functions: Any = getattr(model, "transfer_functions", None)
    for row in functions.values() if isinstance(functions, Mapping) else ():
        for function in row.values():
            if function.determined is not None and any(function.num):
                yield from (bool(flag) for flag in function.determined)
