"""The service's HTML pages, rendered from `templates/` with everything escaped."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fastapi import Request
from fastapi.responses import Response
from fastapi.templating import Jinja2Templates
from pydantic import ByteSize

_FOLDER = Path(__file__).parent


def _size(count: int) -> str:
    """Write a number of bytes as a person would: ``1 GB``, ``3.2 MB``."""
    text = ByteSize(count).human_readable(decimal=True, separator=" ")
    return text.replace(".0 ", " ")


_templates = Jinja2Templates(directory=_FOLDER / "templates")
_templates.env.filters["size"] = _size


def render(
    request: Request,
    template: str,
    context: Mapping[str, Any],
    status: int = 200,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Fill a template."""
    return _templates.TemplateResponse(request, template, dict(context), status, headers)
