"""Whether the service is alive."""

from fastapi import APIRouter

router = APIRouter(tags=["operation"])


@router.get("/healthz", summary="Whether the service is alive")
async def healthz() -> dict[str, str]:
    """Answer; that is the whole test."""
    return {"status": "ok"}
