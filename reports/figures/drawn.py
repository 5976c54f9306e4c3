"""The plots of a flight or craft that need the result itself: drawn once and kept, so that pages can be made anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pipeline.results.fleet import GroupResult
from pipeline.results.flight import FlightResult
from pipeline.results.report import CraftReport, FlightReport
from reports.figures.figure import Figure
from reports.figures.first_screen import first_figures
from reports.figures.flight import flight_figures
from reports.figures.models import Board, joint_predictions, model_board, off_by_default, prediction
from reports.figures.signals import signal_figures


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightFigures:
    """The plots of a flight in the order of its pages."""

    first: tuple[Figure, ...]
    flight: tuple[Figure, ...]
    signals: tuple[Figure, ...]
    predicted: tuple[Figure, ...]
    board: Board


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftFigures:
    """The plots of a craft: of all models, and measured and predicted position by flight."""

    board: Board
    predictions: Mapping[str, Figure]


def draw_flight(result: FlightResult, numbers: FlightReport) -> FlightFigures:
    """Draw the plots of a flight."""
    hidden = off_by_default(numbers.models)
    first = first_figures(result)
    # What the first screen shows of the whole flight is not shown twice.
    shown = {figure.id.removeprefix("first-") for figure in first if figure.time or figure.id == "track"}
    predicted = prediction(result, hidden)
    return FlightFigures(
        first=tuple(first),
        flight=tuple(each for each in flight_figures(result) if each.id not in shown),
        signals=tuple(signal_figures(result)),
        predicted=() if predicted is None else (predicted,),
        board=model_board(result.models, hidden),
    )


def draw_craft(group: GroupResult, numbers: CraftReport) -> CraftFigures:
    """Draw the plots of a craft."""
    hidden = off_by_default(numbers.models)
    return CraftFigures(board=model_board(group.models, hidden), predictions=joint_predictions(group, hidden))
