"""The service's HTML pages, rendered from `templates/` with everything escaped."""

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

from fastapi import Request
from fastapi.responses import RedirectResponse, Response
from fastapi.templating import Jinja2Templates
from jinja2 import StrictUndefined

from api.access import COOKIE
from api.store.resources import Analysis, State
from api.web.dependencies import Item
from api.web.own_pages import fill_in
from core.quantity import size

_FOLDER = Path(__file__).parents[1]

_STATES = {
    State.QUEUED: "Waiting",
    State.RUNNING: "Running",
    State.DONE: "Done",
    State.FAILED: "Failed",
    State.CANCELLED: "Cancelled",
}

#: How the settings of an analysis read to people.
_SETTINGS = {
    "poles": "{} poles",
    "zeros": "{} zeros",
    "rate": "{:g} samples per second",
    "mass": "{:g} kg",
    "training_fraction": "fitted to {:.0%} of the flight",
}


def _moment(when: datetime) -> str:
    """Write a moment as people write it; its time zone is UTC for all, who may be anywhere."""
    return when.astimezone(UTC).strftime("%Y-%m-%d %H:%M UTC")


def _xml_time(when: datetime | None) -> str:
    """Write a moment as RFC 3339 has it; None is the beginning of time."""
    return f"{(when or datetime(1970, 1, 1, tzinfo=UTC)).astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"


def _xml_text(text: str) -> str:
    """Leave out what XML 1.0 cannot hold."""
    return "".join(
        character for character in text if character in "\t\n" or (character >= " " and character not in "\ufffe\uffff")
    )


def _duration(analysis: Analysis) -> str:
    """Report how long an analysis took; empty when it has not been begun or has not ended."""
    if analysis.started is None or analysis.ended is None:
        return ""
    seconds = math.ceil((analysis.ended - analysis.started).total_seconds())
    return f"{seconds} s" if seconds < 120 else f"{seconds // 60} min {seconds % 60} s"


def _stage(analysis: Analysis) -> str:
    """Report what is being done, beginning with a capital."""
    if analysis.state is State.QUEUED:
        return "Waiting for its turn"
    return analysis.stage[:1].upper() + analysis.stage[1:] if analysis.stage else "Starting"


def _settings(configuration: Mapping[str, Any]) -> str:
    """Report what was set when an analysis was ordered; empty when nothing was."""
    known = [text.format(configuration[name]) for name, text in _SETTINGS.items() if name in configuration]
    if configuration.get("flights"):
        known.append(f"joint models of {len(configuration['flights'])} flights")
    if configuration.get("training"):
        known.append(f"fitted to {', '.join(configuration['training'])}")
    return ", ".join(known)


def _elapsed(analysis: Analysis) -> float:
    """Count the seconds since an analysis was begun, 0 before."""
    return 0.0 if analysis.started is None else max(0.0, (datetime.now(UTC) - analysis.started).total_seconds())


_templates = Jinja2Templates(directory=_FOLDER / "templates")
_templates.env.trim_blocks = _templates.env.lstrip_blocks = True
_templates.env.undefined = StrictUndefined
_templates.env.filters |= {
    "size": size,
    "moment": _moment,
    "xml_time": _xml_time,
    "xml_text": _xml_text,
    "duration": _duration,
    "stage": _stage,
    "settings": _settings,
    "elapsed": _elapsed,
    "state_word": _STATES.__getitem__,
}


def render(
    request: Request,
    template: str,
    context: Mapping[str, Any],
    status: int = 200,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Fill a template; `signed_in` says whether there is a token that the visitor could forget."""
    signed_in = COOKIE in request.cookies
    page = _templates.TemplateResponse(request, template, {"signed_in": signed_in, **context}, status, headers)
    return fill_in(page, request)


def part_of(listing: Sequence[Item], count: int, **kept: str | None) -> tuple[Sequence[Item], str]:
    """Return the part of a list that a page shows, and the query of the next part; empty at the end."""
    shown = listing[:count]
    query = {"after": shown[-1].id} | {name: value for name, value in kept.items() if value} if shown else {}
    return shown, urlencode(query) if len(listing) > count else ""


def lead_to(path: str) -> Response:
    """Lead a browser on after what it posted, on this service only."""
    return RedirectResponse(local_path(path), HTTPStatus.SEE_OTHER)


def local_path(address: str) -> str:
    """Return the path to return to that a form names, or that of the start where it would lead to another site."""
    parts = urlsplit(address)
    local = address.startswith("/") and not address.startswith("//") and not parts.scheme and not parts.netloc
    return address if local and "\\" not in address and address.isprintable() else "/"
