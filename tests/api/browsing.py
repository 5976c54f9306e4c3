"""What holds for every page in a browser: controls have names, text has contrast, nothing breaks the policy."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeAlias

import httpx
from playwright.sync_api import Browser, BrowserContext, Page

from tests.api.programs import PATIENCE
from tests.axe import serious

PHONE = {"width": 390, "height": 844}

File: TypeAlias = tuple[str, bytes]

#: What axe does not ask for: one h1 and one main, the page's own order for the keyboard, scrolling by keyboard.
_FAULTS = """() => {
  const shown = (element) => element.checkVisibility({ checkVisibilityCSS: true });
  const faults = ["h1", "main"].filter((tag) => document.querySelectorAll(tag).length !== 1);
  for (const element of document.querySelectorAll("[tabindex]")) {
    if (element.tabIndex > 0) faults.push(element.outerHTML);
  }
  for (const element of document.querySelectorAll("pre")) {
    if (shown(element) && element.tabIndex !== 0) faults.push(element.outerHTML);
  }
  return faults;
}"""


@contextmanager
def watched(
    visitor: Browser | BrowserContext, service: httpx.Client, *, expected: Sequence[int] = (404, 422), **settings: Any
) -> Iterator[Page]:
    """Open a page; at the end no script may have failed, nothing have been refused by our policy, no answer be 5xx.

    A browser opens it for a new visitor, with settings, which takes three times as long as for one who has been here.
    """
    page = visitor.new_page(**{"base_url": str(service.base_url)} | settings if isinstance(visitor, Browser) else {})
    page.set_default_timeout(PATIENCE * 1000.0)
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))

    def note(text: str) -> None:
        # What the browser and htmx write when an answer has the status, or a test breaks off a request.
        known = [
            *(f"status of {status} " for status in expected),
            "net::ERR_FAILED",
            "htmx:sendError",
            "htmx:afterRequest",
        ]
        if not any(remark in text for remark in known):
            faults.append(text)

    page.on("console", lambda message: note(message.text) if message.type == "error" else None)
    page.on("request", lambda request: None if _ours(request.url, service) else faults.append(request.url))
    try:
        yield page
    finally:
        page.close()
    assert not faults, faults


def _ours(url: str, service: httpx.Client) -> bool:
    return url.startswith((str(service.base_url), "data:", "blob:"))


def assert_accessible(page: Page) -> None:
    """Everything has a name, an order and enough contrast."""
    faults = page.evaluate(_FAULTS) + serious(page)
    assert not faults, (page.url, faults)


def assert_fits(page: Page) -> None:
    """Nothing has to be scrolled sideways."""
    wide = page.evaluate(
        """() => [...document.body.querySelectorAll('*')]
          .filter((e) => e.checkVisibility() && !e.closest('pre, .unseen'))
          .filter((e) => e.getBoundingClientRect().right > innerWidth + 1)
          .map((e) => e.outerHTML.slice(0, 80))"""
    )
    scrolled = page.evaluate("document.documentElement.scrollWidth - innerWidth")
    assert (scrolled <= 0, wide) == (True, []), json.dumps([page.url, scrolled, wide])
