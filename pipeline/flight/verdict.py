"""Whether to trust a model, in one word and one sentence, from flight time that it was not fitted to."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

import numpy as np

from core.quantity import joined
from pipeline.flight.purposes import SHORTEST_JUDGE, free_run_use
from pipeline.results.verdict import PredictionUse, Trust, Verdict

if TYPE_CHECKING:
    import pandas as pd

    from sysid import Validation

#: An error of more than so many times that of always predicting the mean is called worse: a tie is not.
WORSE = 1.05


def assess(
    validation: Validation | None,
    unseen: str = "flight time that it was not fitted to",
    outside: Collection[str] = (),
) -> Verdict:
    """Sum a validation up."""
    if validation is None:
        return Verdict(Trust.UNKNOWN, "There is no model of the motion to judge.")
    if not validation.unseen:
        return Verdict(Trust.UNKNOWN, "The model is not judged: every flight was used to fit it.")
    scored = validation.table[~validation.table["trained"]]
    within = scored[~scored["flight"].isin(list(outside))]
    average = dict(validation.average)
    if 0 < len(within) < len(scored):
        # Flights outside the fitted envelope are counted apart (`Uses`), and do not blur the others' error.
        scored = within
        average = {str(name): float(rmse) for name, rmse in within.groupby("output", sort=False)["rmse"].mean().items()}
    outputs = [str(output) for output in scored["output"].unique()]
    longest = float(scored["duration"].max())
    if longest < SHORTEST_JUDGE:
        return Verdict(
            Trust.UNKNOWN,
            f"The model could not be judged: {longest:.0f} s of held-out flight are too short; {SHORTEST_JUDGE:.0f} s "
            "or more are needed.",
        )
    errors = ", ".join(_metres(average[output]) for output in outputs)
    means = scored.groupby("output", sort=False)["rmse_mean"].mean()
    baseline = ", ".join(_metres(means[output]) for output in outputs)
    references = scored.groupby("output", sort=False)["rmse_reference"].mean()
    measured = (
        f"its free run on {unseen}{_about(validation)} errs by {errors} m RMS in {joined(outputs)}, "
        f"where always predicting the mean errs by {baseline} m"
    )
    if references.notna().all():
        asked = ", ".join(_metres(references[output]) for output in outputs)
        measured += f" and taking the target itself by {asked} m"
    if not all(np.isfinite(average[output]) for output in outputs):
        return Verdict(Trust.NO, f"Do not trust the model: its free run on {unseen} diverges.")
    use = free_run_use(validation, outside)
    lost = [output for output in outputs if output not in use.follows]
    if use.trust is Trust.YES:
        return Verdict(
            Trust.YES, f"The model can be trusted for flights like these: {measured}.{_target(use.as_good_as_target)}"
        )
    if not lost and use.trust is Trust.LIMITED:
        if use.flights_outside:
            judged = "only one held-out record within the fitted envelope has judged it"
            if not use.flights_within:
                judged = "no held-out record lies within the fitted envelope"
            return Verdict(
                Trust.LIMITED, f"The model looks right, but {judged}: {measured}; judge it on other flights."
            )
        return Verdict(
            Trust.LIMITED,
            f"The model looks right, but only one record has judged it: {measured}; judge it on other flights.",
        )
    hardly = _hardly(validation, average, means, lost or outputs)
    if use.trust is Trust.LIMITED:
        return Verdict(Trust.LIMITED, f"Trust the model in {joined(list(use.follows))} only: {measured}. {hardly}.")
    apart = ""
    if use.follows and use.far:
        apart = f" A free run is no better than its worst axis, however good it is in {joined(list(use.follows))}."
    elif use.follows:
        apart = " A single record must hold in every axis."
    return Verdict(Trust.NO, f"Do not trust the model: {measured}. {hardly}.{apart}")


def _target(outputs: tuple[str, ...]) -> str:
    return f" In {joined(list(outputs))} taking the target itself is as good." if outputs else ""


def summarise(verdicts: Mapping[str, Verdict], predictions: Mapping[str, PredictionUse] | None = None) -> Verdict:
    """Sum up several models of one motion: what the best can be trusted with, and what holds for the others."""
    verdict = _summed(verdicts)
    ahead = {title: use for title, use in (predictions or {}).items() if use.horizon_s is not None}
    if not ahead:
        return verdict
    best = max(ahead, key=lambda title: ahead[title].horizon_s or 0.0)
    told = ahead[best].sentence.removeprefix("prediction: ")
    return Verdict(verdict.trust, f"{verdict.sentence} With measurements {best} predicts {told}.")


def _summed(verdicts: Mapping[str, Verdict]) -> Verdict:
    if not verdicts:
        return assess(None)
    if len(verdicts) == 1:
        return next(iter(verdicts.values()))
    by_trust = {trust: [title for title, each in verdicts.items() if each.trust is trust] for trust in Trust}
    phrases = {
        Trust.YES: "Trust {} for flights like these",
        Trust.LIMITED: "take {} with care",
        Trust.NO: "do not trust {}",
        Trust.UNKNOWN: "{} could not be judged",
    }
    said = [phrases[trust].format(joined(titles)) for trust, titles in by_trust.items() if titles]
    sentence = "; ".join(said)
    best = next(trust for trust, titles in by_trust.items() if titles)
    # One good model among bad ones must not paint all of them green.
    mixed = best is Trust.YES and any(by_trust[trust] for trust in (Trust.LIMITED, Trust.NO))
    return Verdict(Trust.LIMITED if mixed else best, f"{sentence[0].upper()}{sentence[1:]}.")


def _hardly(validation: Validation, average: Mapping[str, float], means: pd.Series[float], outputs: list[str]) -> str:
    """Report how little a model achieves on outputs that it does not follow, output by output where they differ."""
    trained = validation.table[validation.table["trained"].astype(bool)]
    own = trained.groupby("output", sort=False)["fit_percent"].mean()
    words: dict[str, list[str]] = {}
    for output in outputs:
        error, mean = average[output], means[output]
        if error > WORSE * mean:
            word = "worse than always predicting the mean"
        elif output in own and not own[output] > 0.0 and validation.trusted[output]:
            word = "worse than the mean on the very flight time that it was fitted to"
        elif validation.trusted[output]:
            word = "hardly better than a guess without any model"
        elif _closed_loop(validation):
            word = "no better than taking the target itself"
        else:
            word = "no better than a guess without any model"
        words.setdefault(word, []).append(output)
    if len(words) == 1:
        return f"In {joined(outputs)} that is {next(iter(words))}"
    return "That is " + joined([f"{word} in {joined(where)}" for word, where in words.items()])


def _about(validation: Validation) -> str:
    """Report what a linear model of the craft must be told of a flight: the mean of its inputs."""
    return ", given the mean of its inputs there," if validation.own_trim else ""


def _closed_loop(validation: Validation) -> bool:
    """Return whether the model's inputs are what its outputs should be, which is a guess that is hard to beat."""
    return bool(validation.table["rmse_reference"].notna().all())


def _metres(value: float) -> str:
    return f"{value:#.3g}".rstrip(".")
