"""What a model is good for, by purpose: the one judgement of a model, from which every sentence and colour is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from core.quantity import joined

#: Time that a person needs to react, s.
REACTION_SECONDS = 1.0

#: Why nothing is judged.
NO_MODEL = "There is no model of the motion to judge"

#: An axis whose free run errs by so many times the error of always predicting the mean makes the whole run useless.
FAR = 1.5

#: Held-out records that it takes to trust a free run: on a single one a bad model does well now and then.
FEWEST_HELD_OUT = 2


class Trust(StrEnum):
    """How far a model may be trusted in one use."""

    YES = "yes"
    LIMITED = "limited"
    NO = "no"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Verdict:
    """How far a model may be trusted, as a word and as a sentence."""

    trust: Trust
    sentence: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionUse:
    """How far ahead predictions are worth having."""

    #: The first unbroken run of horizons at which the error of every axis is below half of those of constant position
    #: and constant velocity, s; empty where there are none.
    horizons_s: tuple[float, ...] = ()
    horizon_s: float | None = None  #: The longest of them, s.
    #: Time at which the error reaches that half, between horizons, s, and its standard error; None beyond the longest.
    reach_s: float | None = None
    reach_sigma_s: float | None = None
    rmse_m: Mapping[str, float] = field(default_factory=dict)  #: RMS error by output there, m.
    judged: bool = False  #: False where no record was held out.
    sentence: str = "prediction: not judged"  #: The answer as a clause.

    @property
    def holds(self) -> bool:
        """Whether it predicts for as long as a person needs to react; shorter predictions help a filter only."""
        return (self.horizon_s or 0.0) >= REACTION_SECONDS

    @property
    def ahead(self) -> tuple[float | None, float | None]:
        """How far it predicts, s, with a standard error where that is known between horizons."""
        return (self.horizon_s, None) if self.reach_s is None else (self.reach_s, self.reach_sigma_s)

    @classmethod
    def up_to(cls, horizons: tuple[float, ...], errors: Mapping[str, float]) -> PredictionUse:
        """Return the answer for a judged model from horizons [s] and the errors [m] by output at the last of them."""
        if not horizons:
            no = "no (at no horizon every axis has half the error of constant position and velocity)"
            return cls(judged=True, sentence=f"prediction: {no}")
        sentence = f"prediction: {_ahead(horizons, errors)}"
        return cls(horizons_s=horizons, horizon_s=horizons[-1], rmse_m=errors, judged=True, sentence=sentence)


def _ahead(horizons: tuple[float, ...], errors: Mapping[str, float]) -> str:
    """Write how far ahead predictions are worth having, and their errors [m] by output at the last horizon [s]."""
    first, last = horizons[0], horizons[-1]
    span = f"up to {last:g} s" if first <= 0.1 else f"{last:g} s" if first == last else f"{first:g} to {last:g} s"
    metres = ", ".join(f"{error:#.3g}".rstrip(".") for error in errors.values())
    return f"{span} ahead (there {metres} m in {joined(list(errors))})"


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeRunUse:
    """Whether the model may simulate whole flights from inputs and initial state."""

    trust: Trust
    #: Error by output over that of always predicting the mean, on held-out flights within the fitted envelope (on all
    #: where there are none); None where it diverges.
    error_over_mean: Mapping[str, float | None] = field(default_factory=dict)
    #: Outputs that are followed to `CLOSE_PERCENT` or better, and better than without a model.
    follows: tuple[str, ...] = ()
    #: Where inputs are targets, outputs to which the target itself is as close: there the model adds nothing to it, and
    #: errs no more than the autopilot did.
    as_good_as_target: tuple[str, ...] = ()
    #: Outputs in which the model errs less than the target itself.
    better_than_target: tuple[str, ...] = ()
    #: Held-out flights within the envelope, and those of them that are followed in every axis.
    flights_within: int = 0
    followed_within: int = 0
    #: The same of flights that leave it.
    flights_outside: int = 0
    followed_outside: int = 0
    #: Least and greatest fit over axes and flights of those followed within the envelope.
    fit_percent: tuple[float, float] | None = None
    reason: str = ""  #: Why it is not judged.

    @property
    def far(self) -> tuple[str, ...]:
        """Outputs that err by more than `FAR` times the mean's error, and by more than a target itself."""
        return tuple(
            name
            for name, ratio in self.error_over_mean.items()
            if not (ratio is not None and ratio <= FAR) and name not in self.excused
        )

    @property
    def excused(self) -> tuple[str, ...]:
        """Outputs in which the autopilot itself did no better: of an axis that hardly moved, the mean is no measure."""
        return self.as_good_as_target + self.better_than_target

    def flights(self) -> str:
        """Return how many flights are followed, those outside the envelope apart; empty for a single one within it."""
        if self.flights_within + self.flights_outside < FEWEST_HELD_OUT:
            return ""
        where = " within the envelope" if self.flights_outside else ""
        fit = "" if self.fit_percent is None else f" to {self.fit_percent[0]:.0f}–{self.fit_percent[1]:.0f} %"
        parts = []
        if self.flights_within:
            verb = "is" if self.followed_within == 1 else "are"
            parts.append(
                f"{self.followed_within} of {self.flights_within} flights{where} {verb} followed in every axis{fit}"
            )
        if self.flights_outside:
            parts.append(f"{self.followed_outside} of {self.flights_outside} outside it")
        return "; ".join(parts)

    @property
    def rests_on(self) -> str:
        """What the answer rests on, as clauses; empty where nothing was judged."""
        known = {name: ratio for name, ratio in self.error_over_mean.items() if ratio is not None}
        reasons = [self.flights()]
        if self.trust is Trust.NO and self.far:
            far = [f"{name} {known[name]:.2g} times" if name in known else f"{name} diverges" for name in self.far]
            reasons.append(f"{joined(far)} the error of always predicting the mean")
        elif known:
            ratios = ", ".join(f"{ratio:.2g}" for ratio in known.values())
            reasons.append(f"error over that of the mean {ratios} in {joined(list(known))}")
        if self.as_good_as_target:
            reasons.append(f"in {joined(list(self.as_good_as_target))} the target itself is as good")
        return "; ".join(reason for reason in reasons if reason)

    @property
    def sentence(self) -> str:
        """The answer as a clause."""
        words = {Trust.YES: "yes", Trust.LIMITED: "with care", Trust.NO: "no", Trust.UNKNOWN: "not judged"}
        basis = self.rests_on
        return f"free simulation: {words[self.trust]}" + (f" ({basis})" if basis else "")

    @property
    def verdict(self) -> Verdict:
        """The answer for a reader who asks whether to trust the model."""
        lost = [name for name in self.error_over_mean if name not in self.follows]
        if self.trust is Trust.UNKNOWN:
            return Verdict(self.trust, f"{self.reason or 'The model is not judged'}.")
        if self.trust is Trust.YES:
            word = "The model can be trusted for flights like these"
        elif self.trust is Trust.NO:
            word = "Do not trust the model"
        elif lost:
            word = f"Trust the model in {joined(list(self.follows))} only"
        elif self.flights_outside and not self.flights_within:
            word = "The model looks right, but no held-out record lies within the fitted envelope"
        else:
            word = "The model looks right, but only one record has judged it"
        apart = ""
        if self.trust is Trust.NO and self.follows:
            in_these = joined(list(self.follows))
            apart = (
                f" A free run is no better than its worst axis, however good it is in {in_these}."
                if self.far
                else " A single record must hold in every axis."
            )
        return Verdict(self.trust, f"{word}: {self.rests_on}.{apart}")


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterUse:
    """Whether its parameters mean something by themselves."""

    trust: Trust
    sentence: str = "parameters: not judged"

    @classmethod
    def counted(cls, known: Sequence[bool], *, confirmed: bool) -> ParameterUse:
        """Return the answer for parameters of which each is determined or not.

        They are confirmed where predictions on held-out flights are worth having at some horizon: what predicts nothing
        is determined in the fit alone.
        """
        if not known:
            return cls(trust=Trust.UNKNOWN)
        determined = sum(known)
        trust = Trust.NO if not determined else Trust.YES if all(known) and confirmed else Trust.LIMITED
        doubt = ", but no prediction confirms them" if determined and not confirmed else ""
        sentence = f"parameters: {determined} of {len(known)} determined{doubt}"
        return cls(trust=trust, sentence=sentence)


@dataclass(frozen=True, slots=True, kw_only=True)
class Uses:
    """What a model is good for, by purpose."""

    prediction: PredictionUse
    free_run: FreeRunUse
    parameters: ParameterUse

    @property
    def every(self) -> tuple[PredictionUse, FreeRunUse, ParameterUse]:
        """The three answers."""
        return self.prediction, self.free_run, self.parameters

    @property
    def sentence(self) -> str:
        """The three answers in one sentence."""
        text = "; ".join(use.sentence for use in self.every)
        return f"{text[0].upper()}{text[1:]}."


def overall(uses: Mapping[str, Uses]) -> Verdict:
    """Sum up several models of one motion: what the best can be trusted with, and what holds for the others."""
    verdict = _summed({title: use.free_run.verdict for title, use in uses.items()})
    ahead = {title: use.prediction for title, use in uses.items() if use.prediction.horizons_s}
    if not ahead:
        return verdict
    best, use = max(ahead.items(), key=lambda item: item[1].horizons_s[-1])
    reach = _ahead(use.horizons_s, use.rmse_m)
    return Verdict(verdict.trust, f"{verdict.sentence} With measurements {best} predicts {reach}.")


def _summed(verdicts: Mapping[str, Verdict]) -> Verdict:
    """Return one verdict on several models, by title."""
    if not verdicts:
        return Verdict(Trust.UNKNOWN, NO_MODEL + ".")
    if len(verdicts) == 1:
        return next(iter(verdicts.values()))
    by_trust = {trust: [title for title, verdict in verdicts.items() if verdict.trust is trust] for trust in Trust}
    phrases = {
        Trust.YES: "Trust {} for flights like these",
        Trust.LIMITED: "take {} with care",
        Trust.NO: "do not trust {}",
        Trust.UNKNOWN: "{} could not be judged",
    }
    sentence = "; ".join(phrases[trust].format(joined(titles)) for trust, titles in by_trust.items() if titles)
    best = next(trust for trust, titles in by_trust.items() if titles)
    # One good model among bad ones must not paint all of them green.
    mixed = best is Trust.YES and any(by_trust[trust] for trust in (Trust.LIMITED, Trust.NO))
    return Verdict(Trust.LIMITED if mixed else best, f"{sentence[0].upper()}{sentence[1:]}.")
