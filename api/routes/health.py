"""Whether the service is alive and able to work, and how much it does."""

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST
from sqlalchemy import text

from api import problems
from api.problems import Problem, ProblemError
from api.web.dependencies import PartsOf

router = APIRouter(tags=["operation"])


@router.get("/healthz", summary="Whether the service is alive", responses=problems.RESPONSES)
async def healthz() -> dict[str, str]:
    """Answer; that is the whole test."""
    return {"status": "ok"}


@router.get("/readyz", summary="Whether the service can work", responses=problems.RESPONSES)
def readyz(parts: PartsOf) -> dict[str, str]:
    """Ask the database and write to the storage; 503 when one of them fails."""
    with parts.database.read() as session:
        session.execute(text("SELECT 1"))
    try:
        parts.objects.prepare()
    except Exception as error:  # every storage fails in its own way
        problem = Problem.of("storage-unavailable", f"Nothing can be written to the storage: {error}.")
        raise ProblemError(problem) from error
    return {"status": "ok"}


@router.get(
    "/metrics",
    summary="Numbers for Prometheus",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}, **problems.RESPONSES},
)
def metrics(parts: PartsOf) -> Response:
    """Count requests, their durations, and analyses by state, as Prometheus reads them."""
    return Response(parts.metrics.text(), media_type=CONTENT_TYPE_LATEST)
