"""What the routes are given: the parts of the application, and the check that a request comes from our own pages."""

from http import HTTPStatus
from typing import Annotated

from fastapi import Depends, Request

from api.jobs import Runner
from api.problems import Problem, ProblemError
from api.settings import Settings
from api.storage import Storage


def _settings(request: Request) -> Settings:
    settings: Settings = request.app.state.settings
    return settings


def _storage(request: Request) -> Storage:
    storage: Storage = request.app.state.storage
    return storage


def _runner(request: Request) -> Runner:
    runner: Runner = request.app.state.runner
    return runner


SettingsPart = Annotated[Settings, Depends(_settings)]
StoragePart = Annotated[Storage, Depends(_storage)]
RunnerPart = Annotated[Runner, Depends(_runner)]


def _refuse_other_sites(request: Request) -> None:
    """Keep pages of other sites from using a visitor's browser to send logs to a service that only it can reach."""
    if request.headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
        detail = "This request comes from a page of another site."
        raise ProblemError(Problem.named("other-site", "Request from another site", HTTPStatus.FORBIDDEN, detail))


from_our_pages = Depends(_refuse_other_sites)
