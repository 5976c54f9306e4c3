"""Whether to trust a model, in one word and one sentence, from flight time that it was not fitted to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

    from sysid import Validation

#: A free run follows a flight when its error is below half of the flight's RMS movement: 50 per cent of fit.
CLOSE_PERCENT = 50.0

#: Shortest held-out record that can judge a model, s: the first three seconds give the initial state and do not count.
SHORTEST_JUDGE = 10.0

#: Held-out records that it takes to trust a model: on a single one a bad model does well now and then.
FEWEST_JUDGES = 2

#: An error of more than so many times that of always predicting the mean is called worse: a tie is not.
WORSE = 1.05


class Trust(StrEnum):
    """How far a model may be trusted to predict flights like those that judged it."""

    YES = "yes"
    LIMITED = "limited"
    NO = "no"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Verdict:
    """A word for the eye, a sentence for the reader."""

    trust: Trust
    sentence: str


def judge(validation: Validation | None, unseen: str = "flight time that it was not fitted to") -> Verdict:
    """Sum a validation up.

    Parameters
    ----------
    validation : Validation or None
    unseen : str
        What judged the model, in words.
    """
    if validation is None:
        return Verdict(Trust.UNKNOWN, "There is no model of the motion to judge.")
    if not validation.unseen:
        return Verdict(Trust.UNKNOWN, "The model is not judged: every flight was used to fit it.")
    scored = validation.table[~validation.table["trained"]]
    outputs = [str(output) for output in scored["output"].unique()]
    longest = float(scored["duration"].max())
    if longest < SHORTEST_JUDGE:
        return Verdict(
            Trust.UNKNOWN,
            f"The model could not be judged: {longest:.0f} s of held-out flight are too short; {SHORTEST_JUDGE:.0f} s "
            "or more are needed.",
        )
    fit = scored.groupby("output", sort=False)["fit_percent"].mean()
    beats = [output for output in outputs if validation.trusted[output]]
    errors = ", ".join(_metres(validation.average[output]) for output in outputs)
    means = scored.groupby("output", sort=False)["rmse_mean"].mean()
    baseline = ", ".join(_metres(means[output]) for output in outputs)
    references = scored.groupby("output", sort=False)["rmse_reference"].mean()
    measured = (
        f"its free run on {unseen}{_about(validation)} errs by {errors} m RMS in {_and(outputs)}, "
        f"where always predicting the mean errs by {baseline} m"
    )
    if references.notna().all():
        asked = ", ".join(_metres(references[output]) for output in outputs)
        measured += f" and taking the target itself by {asked} m"
    if not all(np.isfinite(validation.average[output]) for output in outputs):
        return Verdict(Trust.NO, f"Do not trust the model: its free run on {unseen} diverges.")
    trained = validation.table[validation.table["trained"].astype(bool)]
    own = trained.groupby("output", sort=False)["fit_percent"].mean()
    # What does not even follow the flight that it was fitted to is right elsewhere by luck.
    unfit = [output for output in outputs if output in own and not own[output] > 0.0]
    follows = [output for output in beats if fit[output] >= CLOSE_PERCENT and output not in unfit]
    if len(follows) == len(outputs) and scored["flight"].nunique() < FEWEST_JUDGES:
        return Verdict(
            Trust.LIMITED,
            f"The model looks right, but only one record has judged it: {measured}; judge it on other flights.",
        )
    if len(follows) == len(outputs):
        return Verdict(Trust.YES, f"The model can be trusted for flights like these: {measured}.")
    if follows:
        lost = [output for output in outputs if output not in follows]
        return Verdict(
            Trust.LIMITED,
            f"Trust the model in {_and(follows)} only: {measured}. {_hardly(validation, means, lost, unfit)}.",
        )
    return Verdict(Trust.NO, f"Do not trust the model: {measured}. {_hardly(validation, means, outputs, unfit)}.")


def summarise(verdicts: Mapping[str, Verdict]) -> Verdict:
    """Sum up several models of one motion: what the best can be trusted with, and what holds for the others.

    Parameters
    ----------
    verdicts : mapping of str to Verdict
        By the models' titles.
    """
    if not verdicts:
        return judge(None)
    if len(verdicts) == 1:
        return next(iter(verdicts.values()))
    by_trust = {trust: [title for title, each in verdicts.items() if each.trust is trust] for trust in Trust}
    phrases = {
        Trust.YES: "Trust {} for flights like these",
        Trust.LIMITED: "take {} with care",
        Trust.NO: "do not trust {}",
        Trust.UNKNOWN: "{} could not be judged",
    }
    said = [phrases[trust].format(_and(titles)) for trust, titles in by_trust.items() if titles]
    sentence = "; ".join(said)
    best = next(trust for trust, titles in by_trust.items() if titles)
    # One good model among bad ones must not paint all of them green.
    mixed = best is Trust.YES and any(by_trust[trust] for trust in (Trust.LIMITED, Trust.NO))
    return Verdict(Trust.LIMITED if mixed else best, f"{sentence[0].upper()}{sentence[1:]}.")


def _hardly(validation: Validation, means: pd.Series[float], outputs: list[str], unfit: list[str]) -> str:
    """Say how little a model achieves on outputs that it does not follow, output by output where they differ."""
    words: dict[str, list[str]] = {}
    for output in outputs:
        error, mean = validation.average[output], means[output]
        if error > WORSE * mean:
            word = "worse than always predicting the mean"
        elif output in unfit and validation.trusted[output]:
            word = "worse than the mean on the very flight time that it was fitted to"
        elif validation.trusted[output]:
            word = "hardly better than a guess without any model"
        elif _closed_loop(validation):
            word = "no better than taking the target itself"
        else:
            word = "no better than a guess without any model"
        words.setdefault(word, []).append(output)
    if len(words) == 1:
        return f"In {_and(outputs)} that is {next(iter(words))}"
    return "That is " + _and([f"{word} in {_and(where)}" for word, where in words.items()])


def _about(validation: Validation) -> str:
    """Say what a linear model of the craft must be told of a flight: the mean of its inputs."""
    return ", given the mean of its inputs there," if validation.own_trim else ""


def _closed_loop(validation: Validation) -> bool:
    """Tell whether the model's inputs are what its outputs should be, which is a guess that is hard to beat."""
    return bool(validation.table["rmse_reference"].notna().all())


def _metres(value: float) -> str:
    return f"{value:#.3g}".rstrip(".")


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
