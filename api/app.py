"""The application: its parts put together."""

import logging
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from datetime import timedelta
from pathlib import Path

from fastapi import FastAPI
from fastapi.staticfiles import StaticFiles

from api.access import Rates, Shares, Tokens
from api.crafts.folder_flights import FolderFlights
from api.crafts.hooks import Feeds, Hooks
from api.crafts.registry import Crafts
from api.crafts.reviews import Reviews
from api.logs.catalog import Catalog, Quota
from api.logs.housekeeping import Housekeeping
from api.logs.metrics import CountedRequests, Metrics
from api.routes import (
    alerts,
    analyses,
    craft_pages,
    crafts,
    explore,
    health,
    logs,
    page_forms,
    pages,
    questions,
    shares,
    sign_in,
)
from api.settings import Settings
from api.store.database import Database
from api.store.scratch import Scratch
from api.web import problem_responses
from api.web.dependencies import Parts, nothing_unknown
from api.web.middleware import KnownHosts, SafeHeaders, SmallBodies
from api.web.own_pages import from_our_pages
from api.work.desk import Desk
from api.work.jobs import Runner
from api.work.watch import Workplace
from api.work.worker import Analyze, analyze_logs
from pipeline.storage.store import open_store
from reports import PRELOAD

_log = logging.getLogger("rotorid.api")

#: Packages that bring scripts of others, and their folders: browsers fetch nothing from elsewhere.
_SCRIPTS: list[str | tuple[str, str]] = [
    ("js_lib_htmx", "static/htmx"),
    ("plotly", "package_data"),
    ("fastapi_swagger", "resources"),
]

_DESCRIPTION = """Flight logs of Pixhawk autopilots in, identified models and an honest validation report out."""


def create_app(
    settings: Settings | None = None,
    analyze: Analyze = analyze_logs,
    *,
    preload: Sequence[str] = PRELOAD,
    local_only: bool = False,
) -> FastAPI:
    """Make the service.

    Parameters
    ----------
    settings : Settings, optional
        By default those of the environment.
    analyze : callable, optional
        What to do with logs; it runs in a process of its own, so it must be a function of a module.
    preload : sequence of str, optional
        Modules that `analyze` uses and that are worth importing once for all analyses.
    local_only : bool
        Answer only to who calls the service ``localhost``: it is open because nobody else can reach it.

    Raises
    ------
    OSError
        The data folder or the storage cannot be written.
    sqlalchemy.exc.SQLAlchemyError
        The database cannot be used.
    """
    settings = settings or Settings()
    parts = _assemble(settings, analyze, preload)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        working = (parts.runner, parts.housekeeping, parts.reviews, parts.hooks)
        for worker in working:
            worker.open()
        if parts.recognise is not None:
            parts.desk.open()
        _log.info("logs and reports are kept in %s", settings.storage_url)
        try:
            yield
        finally:
            for part in (*working, parts.desk, parts.database, parts.scratch):
                part.close()

    app = FastAPI(
        title="rotorid",
        description=_DESCRIPTION,
        version="1",
        lifespan=lifespan,
        docs_url=None,  # FastAPI's own pages load scripts from elsewhere; ours is `pages.reference`
        redoc_url=None,
    )
    app.state.parts = parts
    app.add_middleware(SmallBodies, uploads=("/", "/api/v1/logs"), stall=settings.upload_stall)
    problem_responses.install(app)
    if local_only or settings.host_names:
        app.add_middleware(KnownHosts, names=frozenset() if local_only else settings.host_names)
    app.add_middleware(SafeHeaders)
    app.add_middleware(CountedRequests, metrics=parts.metrics)
    for kind in (logs, explore, shares, analyses, crafts, alerts, questions):
        app.include_router(kind.router, prefix="/api/v1", dependencies=[from_our_pages, nothing_unknown])
    own = (explore.pages, alerts.feeds, craft_pages.router, craft_pages.forms, health.router, pages.router)
    for router in (*own, page_forms.router, sign_in.router):
        app.include_router(router)
    app.mount("/static", StaticFiles(directory=Path(__file__).parent / "static", packages=_SCRIPTS))
    return app


def _assemble(settings: Settings, analyze: Analyze, preload: Sequence[str]) -> Parts:
    """Make the parts of the application, ready to be used."""
    scratch = Scratch(settings.data / "scratch")
    objects = open_store(settings.storage_url)
    objects.prepare()
    database = Database(settings.database_url)
    database.migrate()
    catalog = Catalog(database, objects, Quota(settings.logs_limit, settings.bytes_limit, settings.queue_limit))
    desk = Desk(settings.memory_limit, unpacked=settings.upload_limit)
    craft_registry = Crafts(database)
    folder = FolderFlights(database, settings.out)
    runner = Runner(Workplace(database, objects, settings, scratch.folder, analyze, preload))
    return Parts(
        settings=settings,
        database=database,
        objects=objects,
        catalog=catalog,
        scratch=scratch,
        runner=runner,
        desk=desk,
        # What stands in for the pipeline takes whatever it is given.
        recognise=desk.refuse_junk if analyze is analyze_logs else None,
        tokens=Tokens(database),
        shares=Shares(database),
        rates=Rates(settings.upload_rate),
        metrics=Metrics(database),
        crafts=craft_registry,
        reviews=Reviews(database, craft_registry, desk.ask, runner.wake, folder.look),
        folder=folder,
        hooks=Hooks(database, settings.webhooks),
        feeds=Feeds(database),
        housekeeping=Housekeeping(
            database,
            objects,
            catalog,
            settings.data / "cache",
            timedelta(days=settings.retention) if settings.retention else None,
        ),
    )
