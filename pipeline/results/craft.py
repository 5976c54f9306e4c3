"""All flights of one craft, identified jointly."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from core.summary import Summarised, listed
from pipeline.results.failure import Failure
from pipeline.results.flight import FlightResult, ModelResult
from pipeline.results.report import CraftReport


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class GroupResult(Summarised):
    """All flights of one craft, identified jointly."""

    report: CraftReport  #: What report.json has of it.
    models: tuple[ModelResult, ...] = ()  #: Side by side, fitted to the training flights and judged on the others.

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {
            "craft": self.report.name,
            "training": listed(self.report.training),
            "held out": listed(self.report.held_out),
            "models": listed([model.title for model in self.models if not isinstance(model.model, Failure)]) or "none",
        }


#: ``publish(result, folder)`` writes what people and programs read of a result. Without a result it draws the pages of
#: a folder anew, or raises FileNotFoundError where the folder does not hold what that takes.
Publish = Callable[["FlightResult | GroupResult | None", Path], object]
