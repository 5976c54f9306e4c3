"""The questions of machine access over HTTP; `rotorid mcp` answers the same ones to assistants."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated

from fastapi import APIRouter, Depends, Query

from api import problems
from api.machine.answers import (
    Answers,
    Changes,
    ComparedFlights,
    CraftList,
    Events,
    FlightList,
    LoopMargins,
    NextFlights,
    Parameters,
    Predictions,
)
from api.machine.service_library import ServiceLibrary
from api.machine.tools import MOST, Tools, UnknownError
from api.problems import ProblemError
from api.web.dependencies import Owner, PartsOf
from pipeline.results.quantity import ParameterChange

router = APIRouter(prefix="/questions", tags=["questions"], responses=problems.RESPONSES)


def _tools(parts: PartsOf, owner: Owner) -> Tools:
    def compare(a: bytes, b: bytes, names: tuple[str, str]) -> Sequence[ParameterChange]:
        found: Sequence[ParameterChange] = parts.desk.ask("compare_numbers", a, b, names)
        return found

    return Tools(ServiceLibrary(parts.database, parts.objects, owner, compare, parts.folder.folder))


Asked = Annotated[Tools, Depends(_tools)]
Flight = Annotated[str, Query(max_length=200, description="Id or name of a flight.")]
CraftName = Annotated[str, Query(max_length=200, description="Id or name of a craft.")]


@contextmanager
def _answering() -> Iterator[None]:
    try:
        yield
    except UnknownError as error:
        detail = f"{str(error)[:1].upper()}{str(error)[1:]}."
        raise ProblemError.missing(detail) from error


@router.get("/flights", summary="List flights")
def list_flights(
    tools: Asked,
    craft: CraftName = "",
    text: Annotated[str, Query(max_length=200, description="Part of a flight's name.")] = "",
    limit: Annotated[int, Query(ge=1, le=MOST, description="Items at most.")] = 100,
) -> FlightList:
    """List flights, the newest first: id, name, craft, take-off, and whether they were healthy."""
    with _answering():
        return tools.list_flights(craft, text, limit)


@router.get("/craft", summary="List craft")
def list_craft(tools: Asked) -> CraftList:
    """List craft with how many flights each has."""
    return tools.list_craft()


@router.get("/answers", summary="The first screen of a flight")
def get_answers(tools: Asked, flight: Flight) -> Answers:
    """Answer for each purpose: flown, healthy, loops, predict ahead, parameters, simulate."""
    with _answering():
        return tools.get_answers(flight)


@router.get("/parameters", summary="Physical parameters")
def get_parameters(tools: Asked, flight: Flight = "", craft: CraftName = "") -> Parameters:
    """Answer with parameters of one flight by every method, or of a craft over its flights."""
    with _answering():
        return tools.get_parameters(flight, craft)


@router.get("/margins", summary="Margins of the loops")
def get_margins(tools: Asked, flight: Flight) -> LoopMargins:
    """Answer with margins and bandwidths of each axis, or why they are not determined."""
    with _answering():
        return tools.get_margins(flight)


@router.get("/health", summary="What happened in a flight")
def get_health(tools: Asked, flight: Flight) -> Events:
    """Answer with events and findings, when they were and what to do."""
    with _answering():
        return tools.get_health(flight)


@router.get("/predictions", summary="How far ahead models predict")
def get_predictions(tools: Asked, flight: Flight) -> Predictions:
    """Answer with the horizon of each model and its error there, on held-out time."""
    with _answering():
        return tools.get_predictions(flight)


@router.get("/changes", summary="What changes over the flights of a craft")
def get_changes(tools: Asked, craft: CraftName) -> Changes:
    """Answer with slopes, steps, motors, and what changed with the last boundary."""
    with _answering():
        return tools.get_changes(craft)


@router.get("/comparison", summary="Compare two flights")
def compare(
    tools: Asked,
    before: Annotated[str, Query(max_length=200, description="Id or name of a flight.")],
    after: Annotated[str, Query(max_length=200, description="Id or name of a flight.")],
) -> ComparedFlights:
    """Answer with the parameters of both, their difference, its error and the chance of it."""
    with _answering():
        return tools.compare(before, after)


@router.get("/advice", summary="What to fly next")
def what_to_fly(tools: Asked, flight: Flight) -> NextFlights:
    """Answer with what to log and fly next time, the most useful first."""
    with _answering():
        return tools.what_to_fly(flight)
