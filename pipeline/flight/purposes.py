"""What a model is good for: prediction some seconds ahead, free simulation of whole flights, its parameters.

One word for all three misleads: a rigid body that drifts away over a minute may be right a second ahead, and one axis
that is wrong by ten times spoils a free run however good the others are. Each use has its own answer, with the number
that it rests on, on flights that the model was not fitted to. Flights that leave the envelope of those fitted are
counted apart: there a model extrapolates.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.validation.assessment import MARGIN

if TYPE_CHECKING:
    import pandas as pd

    from sysid import Validation

#: A free run follows a flight when its error is below half of the flight's RMS movement: 50 per cent of fit.
CLOSE_PERCENT = 50.0

#: Part of the error of constant position and of constant velocity below which a prediction is worth having.
HALF = 0.5

#: An axis whose free run errs by so many times the error of always predicting the mean makes the whole run useless.
FAR = 1.5

#: Held-out records that it takes to trust a free run: on a single one a bad model does well now and then.
FEWEST_JUDGES = 2

#: Shortest held-out record that can judge a free run, s: the first three seconds give the initial state.
SHORTEST_JUDGE = 10.0


class Trust(StrEnum):
    """How far a model may be trusted in one use."""

    YES = "yes"
    LIMITED = "limited"
    NO = "no"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionUse:
    """How far ahead predictions are worth having."""

    #: Without a break, those at which the error of every axis is below half of that of constant position and of
    #: constant velocity, s; empty where there are none.
    horizons: tuple[float, ...]
    errors: Mapping[str, float] = field(default_factory=dict)  #: RMS error by output at the last of them, m.
    judged: bool = True  #: False where no record was held out.

    @property
    def longest(self) -> float | None:
        """Longest of the horizons, s."""
        return self.horizons[-1] if self.horizons else None

    def sentence(self) -> str:
        """Return the answer as a clause."""
        if not self.judged:
            return "prediction: not judged"
        if not self.horizons:
            return "prediction: no (at no horizon every axis has half the error of constant position and velocity)"
        first, last = self.horizons[0], self.horizons[-1]
        span = f"up to {last:g} s" if first <= 0.1 else f"{last:g} s" if first == last else f"{first:g} to {last:g} s"
        errors = ", ".join(_metres(each) for each in self.errors.values())
        return f"prediction: {span} ahead (there {errors} m in {_and(list(self.errors))})"


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeRunUse:
    """Whether the model may simulate whole flights from inputs and initial state."""

    trust: Trust
    #: Error by output over that of always predicting the mean, on held-out flights within the fitted envelope (on all
    #: where there are none).
    ratios: Mapping[str, float] = field(default_factory=dict)
    #: Outputs that are followed to `CLOSE_PERCENT` or better, and better than without a model.
    follows: tuple[str, ...] = ()
    #: Where inputs are targets, outputs that the target itself follows as well: there the model adds nothing to it, and
    #: errs no more than the autopilot did.
    as_good_as_target: tuple[str, ...] = ()
    #: Held-out flights within the envelope, and those of them that are followed in every axis.
    within: int = 0
    followed: int = 0
    #: The same of flights that leave it.
    outside: int = 0
    followed_outside: int = 0
    #: Least and greatest fit over axes and flights of those followed within the envelope.
    fit_percent: tuple[float, float] | None = None

    @property
    def far(self) -> tuple[str, ...]:
        """Outputs that err by more than `FAR` times the mean's error, and by more than a target itself."""
        return tuple(
            name for name, ratio in self.ratios.items() if not ratio <= FAR and name not in self.as_good_as_target
        )

    def flights(self) -> str:
        """Return how many flights are followed, those outside the envelope apart; empty for a single one within it."""
        if self.within + self.outside < FEWEST_JUDGES:
            return ""
        where = " within the envelope" if self.outside else ""
        fit = "" if self.fit_percent is None else f" to {self.fit_percent[0]:.0f}–{self.fit_percent[1]:.0f} %"
        parts = []
        if self.within:
            verb = "is" if self.followed == 1 else "are"
            parts.append(f"{self.followed} of {self.within} flights{where} {verb} followed in every axis{fit}")
        if self.outside:
            parts.append(f"{self.followed_outside} of {self.outside} outside it")
        return "; ".join(parts)

    def sentence(self) -> str:
        """Return the answer as a clause."""
        words = {Trust.YES: "yes", Trust.LIMITED: "with care", Trust.NO: "no", Trust.UNKNOWN: "not judged"}
        known = [name for name in self.ratios if np.isfinite(self.ratios[name])]
        reasons = [self.flights()]
        far = self.far
        if self.trust is Trust.NO and far:
            reasons.append(
                _and(
                    [
                        f"{name} {self.ratios[name]:.2g} times" if name in known else f"{name} diverges"
                        for name in self.far
                    ]
                )
                + " the error of always predicting the mean"
            )
        elif known:
            ratios = ", ".join(f"{self.ratios[name]:.2g}" for name in known)
            reasons.append(f"error over that of the mean {ratios} in {_and(known)}")
        if self.as_good_as_target:
            reasons.append(f"in {_and(list(self.as_good_as_target))} the target itself is as good")
        told = "; ".join(reason for reason in reasons if reason)
        return f"free simulation: {words[self.trust]}" + (f" ({told})" if told else "")


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterUse:
    """Whether its parameters mean something by themselves."""

    trust: Trust
    #: Parameters, or coefficients, whose standard deviation is below half of them, and all.
    determined: int = 0
    total: int = 0
    #: Whether predictions on held-out flights are worth having at some horizon: what predicts nothing is determined in
    #: the fit alone.
    confirmed: bool = False

    def sentence(self) -> str:
        """Return the answer as a clause."""
        if not self.total:
            return "parameters: not judged"
        text = f"parameters: {self.determined} of {self.total} determined"
        return text if self.confirmed or not self.determined else f"{text}, but no prediction confirms them"


@dataclass(frozen=True, slots=True, kw_only=True)
class Uses:
    """What a model is good for, by purpose."""

    prediction: PredictionUse
    free_run: FreeRunUse
    parameters: ParameterUse

    def sentence(self) -> str:
        """Return the three answers in a sentence."""
        parts = [each.sentence() for each in (self.prediction, self.free_run, self.parameters)]
        text = "; ".join(parts)
        return f"{text[0].upper()}{text[1:]}."

    def to_dict(self) -> dict[str, Any]:
        """Return numbers and text for JSON."""
        run = self.free_run
        return {
            "sentence": self.sentence(),
            "prediction": {
                "horizon_s": self.prediction.longest,
                "horizons_s": list(self.prediction.horizons),
                "rmse_m": dict(self.prediction.errors),
                "sentence": self.prediction.sentence(),
            },
            "free_run": {
                "trust": str(run.trust),
                "error_over_mean": dict(run.ratios),
                "follows": list(run.follows),
                "as_good_as_target": list(run.as_good_as_target),
                "flights_within": run.within,
                "followed_within": run.followed,
                "flights_outside": run.outside,
                "followed_outside": run.followed_outside,
                "fit_percent": None if run.fit_percent is None else list(run.fit_percent),
                "sentence": run.sentence(),
            },
            "parameters": {
                "trust": str(self.parameters.trust),
                "determined": self.parameters.determined,
                "total": self.parameters.total,
                "confirmed": self.parameters.confirmed,
                "sentence": self.parameters.sentence(),
            },
        }


def uses_of(validation: Validation | None, model: object | None, outside: Collection[str] = ()) -> Uses:
    """Judge a model by purpose.

    Parameters
    ----------
    validation : Validation or None
    model : Model or None
        Whose parameters are counted.
    outside : collection of str
        Held-out flights that leave the envelope of those fitted.
    """
    prediction = prediction_use(validation, outside)
    return Uses(
        prediction=prediction,
        free_run=free_run_use(validation, outside),
        parameters=_parameter_use(model, confirmed=bool(prediction.horizons)),
    )


def prediction_use(validation: Validation | None, outside: Collection[str] = ()) -> PredictionUse:
    """Find how far ahead every axis beats constant position and constant velocity by half, on held-out flights."""
    if validation is None or not validation.unseen or validation.horizons.empty:
        return PredictionUse(horizons=(), judged=False)
    table = _within(validation.horizons[~validation.horizons["trained"].astype(bool)], outside)
    columns = ["rmse", "rmse_constant_position", "rmse_constant_velocity"]
    means = table.groupby(["horizon", "output"], sort=False)[columns].mean().reset_index()
    run: list[float] = []
    for horizon, rows in means.groupby("horizon", sort=True):
        limit = HALF * rows[columns[1:]].min(axis=1)
        if bool((rows["rmse"] < limit).all()):
            run.append(float(str(horizon)))
        elif run:
            break
    if not run:
        return PredictionUse(horizons=())
    last = means[means["horizon"] == run[-1]]
    errors = {str(output): float(rmse) for output, rmse in zip(last["output"], last["rmse"], strict=True)}
    return PredictionUse(horizons=tuple(run), errors=errors)


def free_run_use(validation: Validation | None, outside: Collection[str] = ()) -> FreeRunUse:
    """Judge the free run on held-out flights, those outside the fitted envelope apart."""
    if validation is None or not validation.unseen:
        return FreeRunUse(trust=Trust.UNKNOWN)
    scored = validation.table[~validation.table["trained"].astype(bool)]
    if float(scored["duration"].max()) < SHORTEST_JUDGE:
        return FreeRunUse(trust=Trust.UNKNOWN)
    chosen = _within(scored, outside)
    outputs = [str(output) for output in scored["output"].unique()]
    averaged = chosen.groupby("output", sort=False)[[each for each in _ERRORS if each in chosen]].mean()
    means = {str(output): {str(k): float(v) for k, v in row.items()} for output, row in averaged.iterrows()}
    ratios = {output: _ratio(means[output]) for output in outputs}
    fit = chosen.groupby("output", sort=False)["fit_percent"].mean()
    trained = validation.table[validation.table["trained"].astype(bool)]
    own = trained.groupby("output", sort=False)["fit_percent"].mean()
    follows = tuple(
        output
        for output in outputs
        # What does not even follow the flight that it was fitted to is right elsewhere by luck.
        if fit[output] >= CLOSE_PERCENT and _beats(means[output]) and not (output in own and not own[output] > 0.0)
    )
    counts = _counts(scored, outside)
    complete = set(follows) == set(outputs)
    as_good = tuple(output for output in outputs if _as_good_as_target(means[output]))
    if any(not ratio <= FAR and output not in as_good for output, ratio in ratios.items()):
        trust = Trust.NO
    elif complete and counts["within"] >= FEWEST_JUDGES:
        trust = Trust.YES
    elif complete:
        trust = Trust.LIMITED
    elif chosen["flight"].nunique() < FEWEST_JUDGES:
        # A single record must hold in every axis.
        trust = Trust.NO
    else:
        trust = Trust.LIMITED if follows else Trust.NO
    return FreeRunUse(
        trust=trust,
        ratios=ratios,
        follows=follows,
        as_good_as_target=as_good,
        fit_percent=_fit_range(scored, outside),
        **counts,
    )


#: Errors of free runs and of what could be said without a model.
_ERRORS = ("rmse", "rmse_mean", "rmse_constant_position", "rmse_constant_velocity", "rmse_reference")


def _within(table: pd.DataFrame, outside: Collection[str]) -> pd.DataFrame:
    """Leave flights outside the envelope out, unless nothing else is there."""
    inside = table[~table["flight"].isin(list(outside))]
    return inside if len(inside) else table


def _ratio(errors: Mapping[str, float]) -> float:
    error, mean = errors["rmse"], errors["rmse_mean"]
    return error / mean if np.isfinite(error) and mean > 0.0 else float("inf")


def _beats(errors: Mapping[str, float]) -> bool:
    baselines = [errors[name] for name in _ERRORS[2:4] if name in errors]
    return all(errors["rmse"] < (1.0 - MARGIN) * each for each in baselines if np.isfinite(each))


def _as_good_as_target(errors: Mapping[str, float]) -> bool:
    """Return whether a model and the target itself err alike."""
    target = errors.get("rmse_reference", float("nan"))
    return bool(np.isfinite(target)) and abs(errors["rmse"] - target) <= MARGIN * target


def _followed(scored: pd.DataFrame) -> Iterator[tuple[str, bool, list[float]]]:
    """Return of each flight whether it is followed in every axis, and its fits in percent."""
    for flight, rows in scored.groupby("flight", sort=False):
        fits = [float(each) for each in rows["fit_percent"]]
        yield str(flight), all(each >= CLOSE_PERCENT for each in fits), fits


def _counts(scored: pd.DataFrame, outside: Collection[str]) -> dict[str, int]:
    counts = {"within": 0, "followed": 0, "outside": 0, "followed_outside": 0}
    for flight, good, _ in _followed(scored):
        there = flight in outside
        counts["outside" if there else "within"] += 1
        counts["followed_outside" if there else "followed"] += good
    return counts


def _fit_range(scored: pd.DataFrame, outside: Collection[str]) -> tuple[float, float] | None:
    fits = [fit for flight, good, fits in _followed(scored) if good and flight not in outside for fit in fits]
    return (min(fits), max(fits)) if fits else None


def _parameter_use(model: object | None, *, confirmed: bool) -> ParameterUse:
    known = list(_determined(model))
    if not known:
        return ParameterUse(trust=Trust.UNKNOWN)
    trust = Trust.NO if not any(known) else Trust.YES if all(known) and confirmed else Trust.LIMITED
    return ParameterUse(trust=trust, determined=sum(known), total=len(known), confirmed=confirmed)


def _determined(model: object | None) -> Iterator[bool]:
    """Return of each parameter or coefficient of a model whether it is determined."""
    parameters: Any = getattr(model, "parameters", None)
    if isinstance(parameters, Mapping):
        yield from (bool(each.determined) for each in parameters.values())
        return
    functions: Any = getattr(model, "transfer_functions", None)
    for row in functions.values() if isinstance(functions, Mapping) else ():
        for function in row.values():
            if function.determined is not None and any(function.num):
                yield from (bool(each) for each in function.determined)


def _metres(value: float) -> str:
    return f"{value:#.3g}".rstrip(".")


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""
