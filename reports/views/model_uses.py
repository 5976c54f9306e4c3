"""Which models hold, and for what they are of use."""

from __future__ import annotations

from collections.abc import Sequence

from core.quantity import number
from pipeline.results.answer import HOLDS
from pipeline.results.model_report import ModelReport
from pipeline.results.verdict import PredictionUse
from reports.views import summary

#: Advice that stands on a page; the rest is folded.
MOST_ADVICE = 3


def holding(models: Sequence[ModelReport]) -> list[tuple[str, str]]:
    """Return models that predict for as long as a person needs to react, and for what they are of use."""
    return [(summary.sentence(each.title)[:-1], _reach(each.uses.prediction)) for each in models if _holds(each)]


def failing(models: Sequence[ModelReport]) -> list[tuple[str, str]]:
    """Return the other models, and why they are of no use."""
    return [(summary.sentence(each.title)[:-1], _why_not(each)) for each in models if not _holds(each)]


def _reach(use: PredictionUse) -> str:
    errors = ", ".join(f"{number(error, 2)} m in {output}" for output, error in use.rmse_m.items())
    return f"Predicts {use.horizon_s:g} s ahead" + (f", to {errors}." if errors else ".")


def _holds(model: ModelReport) -> bool:
    return model.model is not None and (model.uses.prediction.horizon_s or 0.0) >= HOLDS


def _why_not(model: ModelReport) -> str:
    if model.model is None:
        return summary.sentence(model.missing)
    horizon = model.uses.prediction.horizon_s
    return f"Predicts {horizon:g} s ahead only." if horizon else "Does not predict this flight."
