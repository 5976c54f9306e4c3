"""Signing in with a token, which the browser then keeps in a cookie that no script can read."""

from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Form, Query, Request, Response
from fastapi.responses import RedirectResponse

from api.access import COOKIE
from api.settings import Access
from api.web.dependencies import PartsOf
from api.web.own_pages import from_our_forms
from api.web.page_templates import local_path, render

router = APIRouter(include_in_schema=False)

#: Seconds that a browser keeps a token: a month; the token itself may expire before.
_KEPT = 30 * 24 * 3600


@router.api_route("/sign-in", methods=["GET", "HEAD"])
def ask_for_token(
    request: Request, parts: PartsOf, following: Annotated[str, Query(alias="next", max_length=2000)] = "/"
) -> Response:
    """Ask for a token; where the service is open there is nothing to ask for."""
    if parts.settings.access is not Access.TOKENS:
        return RedirectResponse(local_path(following), HTTPStatus.SEE_OTHER)
    return render(request, "sign_in.html", {"next": local_path(following), "wrong": False})


@router.post("/sign-in", dependencies=from_our_forms)
def sign_in(
    request: Request,
    parts: PartsOf,
    token: Annotated[str, Form(max_length=200)] = "",
    following: Annotated[str, Form(alias="next", max_length=2000)] = "/",
) -> Response:
    """Store a token in the browser, if it is somebody's."""
    parts.rates.check_sign_ins(request)
    secret = token.strip()
    if parts.tokens.owner_of(secret) is None:
        parts.rates.count_wrong_token(request)
        view = {"next": local_path(following), "wrong": True}
        return render(request, "sign_in.html", view, HTTPStatus.UNAUTHORIZED)
    response = RedirectResponse(local_path(following), HTTPStatus.SEE_OTHER)
    response.set_cookie(
        COOKIE, secret, max_age=_KEPT, httponly=True, samesite="strict", secure=request.url.scheme == "https"
    )
    return response


@router.post("/sign-out", dependencies=from_our_forms)
def sign_out(request: Request) -> Response:
    """Remove the browser's token."""
    response = RedirectResponse("/sign-in", HTTPStatus.SEE_OTHER)
    response.delete_cookie(COOKIE, httponly=True, samesite="strict", secure=request.url.scheme == "https")
    return response
