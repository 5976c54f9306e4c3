"""What holds for every page in a browser: controls have names, text has contrast, nothing breaks the policy."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeAlias

import httpx
from playwright.sync_api import Browser, Page

from tests.api.programs import PATIENCE
from tests.axe import serious

PHONE = {"width": 390, "height": 844}

File: TypeAlias = tuple[str, bytes]

#: What every page must be, checked by what the browser makes of it; gives a line for each thing that is not so.
_FAULTS = """() => {
  const faults = [];
  const shown = (element) => element.checkVisibility({ checkVisibilityCSS: true });
  const label = (element) => `<${element.tagName.toLowerCase()}${element.id && "#" + element.id}>`;
  if (document.documentElement.lang !== "en") faults.push("the page does not say its language");
  if (document.querySelectorAll("h1").length !== 1) faults.push("there is not one h1");
  if (document.querySelectorAll("main").length !== 1) faults.push("there is not one main");
  if (!document.title) faults.push("there is no title");
  const ids = [...document.querySelectorAll("[id]")].map((element) => element.id);
  for (const id of ids) if (ids.indexOf(id) !== ids.lastIndexOf(id)) faults.push(`the id ${id} is there twice`);
  let level = 0;
  for (const heading of document.querySelectorAll("h1, h2, h3, h4")) {
    const now = Number(heading.tagName[1]);
    if (shown(heading) && now > level + 1) faults.push(`${label(heading)} skips a level`);
    if (shown(heading)) level = now;
  }
  for (const attribute of ["aria-labelledby", "aria-describedby", "for"]) {
    for (const element of document.querySelectorAll(`[${attribute}]`)) {
      for (const id of element.getAttribute(attribute).split(" ")) {
        if (!document.getElementById(id)) faults.push(`${label(element)}: ${attribute} names a missing ${id}`);
      }
    }
  }
  const controls = "a, button, summary, input, select, progress, iframe, nav, section";
  for (const control of document.querySelectorAll(controls)) {
    if (!shown(control) || control.type === "hidden") continue;
    const named = control.getAttribute("aria-label") || control.getAttribute("aria-labelledby") || control.title
      || [...(control.labels ?? [])].some((each) => each.textContent.trim())
      || (["A", "BUTTON", "SUMMARY"].includes(control.tagName) && control.textContent.trim());
    if (!named) faults.push(`${label(control)} has no name`);
    if (control.tabIndex > 0) faults.push(`${label(control)} changes the order of the keyboard`);
  }
  for (const scroller of document.querySelectorAll("pre")) {
    if (shown(scroller) && scroller.tabIndex !== 0) faults.push(`${label(scroller)} cannot be scrolled by keyboard`);
  }

  // Contrast by WCAG 2.1: 4.5 for text, 3 for large or bold and fairly large text.
  const channels = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const light = (colour) => channels(colour).slice(0, 3)
    .map((value) => value / 255)
    .map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4))
    .reduce((sum, value, index) => sum + value * [0.2126, 0.7152, 0.0722][index], 0);
  const ground = (element) => {
    for (let each = element; each; each = each.parentElement) {
      const colour = getComputedStyle(each).backgroundColor;
      if ((channels(colour)[3] ?? 1) > 0.99) return colour;
    }
    return "rgb(255, 255, 255)";
  };
  for (const element of document.body.querySelectorAll("*")) {
    const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    if (!own || !shown(element) || element.closest("option, .unseen")) continue;
    const style = getComputedStyle(element);
    const [low, high] = [light(style.color), light(ground(element))].sort((a, b) => a - b);
    const contrast = (high + 0.05) / (low + 0.05);
    const large = parseFloat(style.fontSize) >= 24;
    if (contrast < (large ? 3 : 4.5)) faults.push(`${label(element)} has a contrast of ${contrast.toFixed(1)}`);
  }
  return faults;
}"""


@contextmanager
def watched(
    browser: Browser, service: httpx.Client, *, expected: Sequence[int] = (404, 422), **settings: Any
) -> Iterator[Page]:
    """Open a page; at the end no script may have failed, nothing have been refused by our policy, no answer be 5xx."""
    context = browser.new_context(base_url=str(service.base_url), **settings)
    context.set_default_timeout(PATIENCE * 1000.0)
    page, faults = context.new_page(), []
    page.on("pageerror", lambda error: faults.append(str(error)))

    def note(text: str) -> None:
        # What the browser and htmx write when an answer has the status, or a test breaks off a request.
        known = [
            *(f"status of {status} " for status in expected),
            "net::ERR_FAILED",
            "htmx:sendError",
            "htmx:afterRequest",
        ]
        if not any(each in text for each in known):
            faults.append(text)

    page.on("console", lambda message: note(message.text) if message.type == "error" else None)
    page.on("request", lambda request: None if _ours(request.url, service) else faults.append(request.url))
    try:
        yield page
    finally:
        context.close()
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
