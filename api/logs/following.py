"""Following an analysis: its changes one by one, until it has ended."""

import asyncio
from collections.abc import AsyncIterator, Callable

from fastapi.concurrency import run_in_threadpool

from api.logs.catalog import Catalog
from api.problems import ProblemError
from api.store.resources import Analysis

#: Seconds between two looks at the database: workers may be in other processes and on other computers.
_LOOK = 0.25


async def changes(catalog: Catalog, analysis: Analysis, stopping: Callable[[], bool]) -> AsyncIterator[Analysis]:
    """Yield an analysis as it is, and again whenever it has changed, up to its end, its removal or ours."""
    yield analysis
    while not (analysis.state.ended or stopping()):
        await asyncio.sleep(_LOOK)
        try:
            now = await run_in_threadpool(catalog.find_analysis, analysis.id, None)
        except ProblemError:
            return
        if now != analysis:
            analysis = now
            yield analysis


async def ended(catalog: Catalog, analysis: Analysis, stopping: Callable[[], bool]) -> Analysis:
    """Wait for the end of an analysis, or until the service stops, and give it as it is then."""
    async for now in changes(catalog, analysis, stopping):
        analysis = now
    return analysis
