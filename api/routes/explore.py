"""Explore a log: its messages and fields, and any of them over time, thinned to what a screen shows."""

import math
import pathlib
from collections.abc import Sequence
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request, Response

from api import problems
from api.machine.answers import LoggedFields, LoggedMessages, LoggedParameters, Signals
from api.problems import Problem, ProblemError
from api.store.owned import missing
from api.store.records import LogRecord
from api.web.dependencies import Owner, OwnLog, PartsOf
from api.web.middleware import PLOT_POLICY
from api.web.page_templates import render
from api.web.results import local_copy

router = APIRouter(prefix="/logs", tags=["logs"], responses=problems.RESPONSES)
pages = APIRouter(include_in_schema=False)

#: Most signals of one request, and most points of each.
_SIGNALS, _POINTS = 16, 20_000


def _file(log: OwnLog, parts: PartsOf) -> pathlib.Path:
    """Return a log as a file of this computer."""
    path = local_copy(f"logs/{log.id}", parts)
    if path is None:
        raise missing(LogRecord)
    return path


LogFile = Annotated[pathlib.Path, Depends(_file)]
MessageName = Annotated[str, Path(description="Name of a message.")]
Seconds = Annotated[float | None, Query(description="On the log's clock [s].")]


@router.get("/{log_id}/messages", summary="The messages of a log, with how many rows each has")
def list_messages(log: OwnLog, path: LogFile, parts: PartsOf) -> LoggedMessages:
    """List the messages that a log holds, with its flight modes, events and texts."""
    messages: LoggedMessages = parts.desk.ask("list_messages", path, log.name)
    return messages


@router.get("/{log_id}/messages/{message}", summary="The numeric fields of a message, with their units")
def list_fields(log: OwnLog, path: LogFile, message: MessageName, parts: PartsOf) -> LoggedFields:
    """List the fields of a message as they are written in expressions, such as `IMU[0].GyrX`."""
    fields: LoggedFields = parts.desk.ask("list_fields", path, log.name, message)
    return fields


@router.get("/{log_id}/parameters", summary="The autopilot's parameters, and what was changed since the flight before")
def list_parameters(log: OwnLog, path: LogFile, parts: PartsOf, owner: Owner) -> LoggedParameters:
    """List the parameters of a log, those first that differ from the log of its craft's flight before."""
    known = parts.crafts.log_before(log.id, owner)
    before = None if known is None else local_copy(f"logs/{known[0]}", parts)
    earlier = None if known is None or before is None else (before, known[1])
    parameters: LoggedParameters = parts.desk.ask("list_parameters", path, log.name, earlier)
    return parameters


@router.get("/{log_id}/signals", summary="Fields of a log over time, or expressions of them")
def read_signals(
    log: OwnLog,
    path: LogFile,
    parts: PartsOf,
    signal: Annotated[
        Sequence[str], Query(description="Such as `ATT.Roll` or `ATT.Roll - ATT.DesRoll`.", max_length=_SIGNALS)
    ] = (),
    start: Seconds = None,
    stop: Seconds = None,
    points: Annotated[int, Query(ge=2, le=_POINTS, description="Of each signal, most values in the answer.")] = 2000,
    spectrum: Annotated[
        bool, Query(description="Answer with amplitudes by frequency; `points` does not matter.")
    ] = False,
) -> Signals:
    """Evaluate signals over a time span; of many samples the smallest and largest of each stretch are kept."""
    if any(value is not None and not math.isfinite(value) for value in (start, stop)):
        raise ProblemError(Problem.of_status(HTTPStatus.UNPROCESSABLE_ENTITY, "start and stop must be numbers."))
    asked = (path, log.name, signal, start, stop)
    signals: Signals = (
        parts.desk.ask("read_spectra", *asked) if spectrum else parts.desk.ask("read_signals", *asked, points)
    )
    return signals


@pages.api_route("/logs/{log_id}/explore", methods=["GET", "HEAD"])
def explore_page(
    request: Request,
    log: OwnLog,
    _: LogFile,
    signal: Annotated[list[str] | None, Query(max_length=_SIGNALS)] = None,
) -> Response:
    """Show the page on which any fields of a log are plotted."""
    view = {"log": log, "chosen": signal or []}
    return render(request, "explore.html", view, headers={"Content-Security-Policy": PLOT_POLICY})
