"""What changes something comes from our own pages, or from a program: two tests, one beside the other.

Browsers tell from where a request comes. And a page of another site cannot know the token of our forms, whatever its
browser says or leaves out: a cookie holds a secret, each form of our pages carries it, and what a form posts must bring
both (double submit). Programs that send a bearer token in a header need no form, for no browser sends that by itself.
"""

import re
import secrets
from urllib.parse import urlsplit

from fastapi import Depends, Request
from fastapi.responses import Response
from markupsafe import escape
from starlette.datastructures import URL

from api.problems import ProblemError
from api.store.ids import new_secret


async def _refuse_other_sites(request: Request) -> None:
    """Keep pages of other sites from using a visitor's browser to send logs to a service that only it can reach.

    Browsers send Sec-Fetch-Site only to https and to loopback; Origin they send with whatever changes something, under
    any name. Programs send neither.
    """
    if request.method in ("GET", "HEAD"):  # which change nothing
        return
    origins = request.headers.getlist("origin")
    foreign = len(origins) > 1 or (len(origins) == 1 and not _is_origin_of(origins[0], request.url))
    if foreign or request.headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
        detail = "This request comes from a page of another site."
        raise ProblemError.of("other-site", detail)


def _is_origin_of(origin: str, url: URL) -> bool:
    """Return whether an Origin header names scheme, host and port of an address; `null` names nothing."""
    try:
        theirs = urlsplit(origin)
        port = theirs.port or _PORTS.get(theirs.scheme)
    except ValueError:
        return False
    ours = (url.scheme, url.hostname, url.port or _PORTS.get(url.scheme))
    return theirs.hostname is not None and (theirs.scheme, theirs.hostname, port) == ours


_PORTS = {"http": 80, "https": 443}

#: For routes of the interface for programs.
from_our_pages = Depends(_refuse_other_sites)


#: Cookie and field, and the header in which scripts of ours may send it instead.
COOKIE, FIELD, HEADER = "rotorid_form", "form_token", "rotorid-form"

_FORM = re.compile(r'<form\b[^>]*\bmethod="post"[^>]*>')
_ACTION = re.compile(r'action="([^"]*)"')


def secret_of(request: Request) -> tuple[str, bool]:
    """Return the secret of a browser, and whether it is new and must be told."""
    known = request.cookies.get(COOKIE, "")
    return (known, False) if re.fullmatch(r"[\w-]{20,100}", known) else (new_secret(), True)


def fill_in(response: Response, request: Request) -> Response:
    """Put the token into the forms of a page, and the secret into the browser; what is no form stays as it is."""
    page = bytes(response.body).decode()
    if 'method="post"' not in page:
        return response
    secret, new = secret_of(request)
    field = f'<input type="hidden" name="{FIELD}" value="{escape(secret)}">'

    def filled(match: re.Match[str]) -> str:
        form = match[0]
        if "multipart/form-data" in form:  # read as it comes: the token must be there before the files
            return _ACTION.sub(lambda action: f'action="{action[1]}?{FIELD}={escape(secret)}"', form, count=1)
        return form + field

    response.body = _FORM.sub(filled, page).encode()
    response.headers["Content-Length"] = str(len(response.body))
    if new:
        response.set_cookie(COOKIE, secret, httponly=True, samesite="strict", secure=request.url.scheme == "https")
    return response


async def _check(request: Request) -> None:
    if request.method in ("GET", "HEAD") or request.headers.get("authorization"):
        return
    token = request.headers.get(HEADER) or request.query_params.get(FIELD)
    if token is None and not request.headers.get("content-type", "").startswith("multipart/"):
        form = await request.form(max_files=0, max_fields=10_000)
        token = str(form.get(FIELD, ""))
    known = request.cookies.get(COOKIE, "")
    if not known or not secrets.compare_digest((token or "").encode(), known.encode()):
        detail = "This form was not filled in on a page of this service, or its page is old. Load the page again."
        raise ProblemError.of("foreign-form", detail)


#: For routes to which forms of our pages are posted.
from_our_forms = [from_our_pages, Depends(_check)]
