"""The application: its parts put together."""

import logging
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import FastAPI
from fastapi.staticfiles import StaticFiles

from api import problems
from api.headers import SafeHeaders
from api.jobs import PRELOAD, Runner
from api.routes import analyses, health, logs, pages
from api.settings import Settings
from api.storage import Storage
from api.worker import Analyze, analyze_log

_log = logging.getLogger("rotorid.api")

_DESCRIPTION = """Flight logs of Pixhawk autopilots in, identified models and an honest validation report out."""


def create_app(
    settings: Settings | None = None, analyze: Analyze = analyze_log, *, preload: Sequence[str] = PRELOAD
) -> FastAPI:
    """Make the service.

    Parameters
    ----------
    settings : Settings, optional
        By default those of the environment.
    analyze : callable, optional
        What to do with a log; it runs in a process of its own, so it must be a function of a module.
    preload : sequence of str, optional
        Modules that `analyze` uses and that are worth importing once for all analyses.

    Raises
    ------
    OSError
        The data folder cannot be written.
    """
    settings = settings or Settings()
    storage = Storage(settings.data)
    storage.prepare()
    runner = Runner(
        storage,
        analyze,
        workers=settings.workers,
        time_limit=settings.time_limit,
        memory_limit=settings.memory_limit,
        preload=preload,
    )

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        runner.open()
        _log.info("logs and reports are kept in %s", settings.data.resolve())
        try:
            yield
        finally:
            runner.close()

    app = FastAPI(
        title="rotorid",
        description=_DESCRIPTION,
        version="1",
        lifespan=lifespan,
        docs_url=None,  # FastAPI's own pages load scripts from elsewhere; ours is `pages.reference`
        redoc_url=None,
    )
    app.state.settings = settings
    app.state.storage = storage
    app.state.runner = runner
    problems.install(app)
    app.add_middleware(SafeHeaders)
    app.include_router(logs.router, prefix="/api/v1")
    app.include_router(analyses.router, prefix="/api/v1")
    app.include_router(health.router)
    app.include_router(pages.router)
    app.mount("/static", StaticFiles(directory=Path(__file__).parent / "static"))
    return app
