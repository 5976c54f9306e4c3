"""What can be measured about the service, in the text format of Prometheus."""

import time
from collections import Counter as Tally
from collections.abc import Iterator
from datetime import UTC, datetime

from prometheus_client import CollectorRegistry, Counter, Histogram, generate_latest
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from sqlalchemy import func, select
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.store.database import Database
from api.store.records import AnalysisRecord, LogRecord
from api.store.resources import State


class Metrics:
    """Counts requests as they pass, and asks the database for the rest when somebody wants to know."""

    def __init__(self, database: Database) -> None:
        self._registry = CollectorRegistry()
        self._registry.register(_Stock(database))
        self.requests = Counter(
            "rotorid_requests", "Requests answered.", ("method", "route", "status"), registry=self._registry
        )
        self.durations = Histogram(
            "rotorid_request_seconds", "Time until the answer began.", ("method", "route"), registry=self._registry
        )

    def text(self) -> bytes:
        """Write everything down."""
        return generate_latest(self._registry)


class _Stock(Collector):
    """What is in the database."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def collect(self) -> Iterator[Metric]:
        """Count analyses by state, stage and problem, the age of the queue, and logs and their bytes."""
        with self._database.read() as session:
            by_state = select(AnalysisRecord.state, func.count()).group_by(AnalysisRecord.state)
            states = {state: count for state, count in session.execute(by_state)}  # noqa: C416 -- rows, not pairs
            queued = select(func.min(AnalysisRecord.created)).where(AnalysisRecord.state == State.QUEUED)
            oldest = session.scalar(queued)
            running_now = select(AnalysisRecord.stage).where(AnalysisRecord.state == State.RUNNING)
            stages = Tally(session.scalars(running_now))
            problems = session.scalars(select(AnalysisRecord.problem).where(AnalysisRecord.state == State.FAILED))
            failures = Tally(
                str((problem or {}).get("type", "")).rpartition(":")[2] or "unknown" for problem in problems
            )
            logs, size = session.execute(select(func.count(), func.coalesce(func.sum(LogRecord.size), 0))).one()
        analyses = GaugeMetricFamily("rotorid_analyses", "Analyses by state.", labels=("state",))
        for state in State:
            analyses.add_metric((state.value,), states.get(state, 0))
        yield analyses
        age = GaugeMetricFamily(
            "rotorid_queue_age_seconds",
            "How long the oldest waiting analysis has waited.",
            value=0.0 if oldest is None else max(0.0, (datetime.now(UTC) - oldest).total_seconds()),
        )
        yield age
        running = GaugeMetricFamily("rotorid_stage", "Analyses that run, by stage.", labels=("stage",))
        for stage, count in stages.items():
            running.add_metric((stage.partition(":")[0] or "starting",), count)
        yield running
        failed = GaugeMetricFamily("rotorid_failures", "Failed analyses by problem.", labels=("problem",))
        for problem, count in sorted(failures.items()):
            failed.add_metric((problem,), count)
        yield failed
        yield GaugeMetricFamily("rotorid_logs", "Logs kept.", value=logs)
        yield GaugeMetricFamily("rotorid_logs_bytes", "Bytes of the logs kept.", value=float(size))


class CountedRequests:
    """ASGI middleware: counts requests and the time that they take."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and count it when its answer begins."""
        start = time.perf_counter()

        async def count(message: Message) -> None:
            if message["type"] == "http.response.start":
                # The route and not the path, which would make a series of every id.
                route = getattr(scope.get("route"), "path", "other")
                method = scope["method"] if scope["method"] in _METHODS else "other"
                self._metrics.requests.labels(method, route, str(message["status"])).inc()
                self._metrics.durations.labels(method, route).observe(time.perf_counter() - start)
            await send(message)

        await self.app(scope, receive, count if scope["type"] == "http" else send)


_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
