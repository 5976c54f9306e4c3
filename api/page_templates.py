"""The service's HTML pages, rendered from `templates/` with everything escaped."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fastapi import Request
from fastapi.responses import Response
from fastapi.templating import Jinja2Templates

from api import sizes

_FOLDER = Path(__file__).parent


_templates = Jinja2Templates(directory=_FOLDER / "templates")
_templates.env.filters["size"] = sizes.in_words


def render(
    request: Request,
    template: str,
    context: Mapping[str, Any],
    status: int = 200,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Fill a template."""
    return _templates.TemplateResponse(request, template, dict(context), status, headers)
