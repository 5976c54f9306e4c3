"""The page of a craft in a browser: bright and dark, wide and narrow; what its forms do; names that are markup."""

import dataclasses
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, expect

from api.work.craft_flights import keep
from api.work.outcome import Flown
from tests.api.browsing import PHONE, assert_accessible, assert_fits, watched
from tests.api.conftest import served
from tests.api.programs import PATIENCE
from tests.axe import serious
from tests.pipeline.builders import hovering

expect.set_options(timeout=PATIENCE * 1000.0)  # only what never comes may meet it, on a busy computer too

#: Called so, a flight and a craft are text on every page, and no element.
MARKUP = "<img src=x onerror=alert(1)><b>bold</b>"


def test_a_craft_is_named_noted_and_read_by_everybody(browser: Browser, tmp_path: Path) -> None:
    with served(data=tmp_path, workers=1) as client:
        with client.parts.database.write() as session:
            for number, entry in enumerate(hovering(np.random.default_rng(1), "octa", 5, scatter=0.001)):
                named = dataclasses.replace(entry, name=f"{MARKUP} {number}")
                keep(session, "", f"{number:032x}", Flown(named), (None, None, ""))
        client.parts.reviews.look()
        (craft,) = client.get("/api/v1/crafts").json()["items"]
        with watched(browser, client) as page:
            page.goto(craft["links"]["page"])
            page.get_by_label("Name").fill(MARKUP)
            page.get_by_role("button", name="Call it so").click()
            expect(page.get_by_role("heading", level=1)).to_have_text(MARKUP)
            page.get_by_label("What", exact=True).fill(f"new propellers {MARKUP}")
            page.get_by_role("button", name="Note it").click()
            expect(page.get_by_role("listitem").filter(has_text="new propellers")).to_contain_text(MARKUP)
            assert page.locator("main b, main img, main script").count() == 0
            for scheme, viewport in (("light", {"width": 1280, "height": 800}), ("dark", PHONE)):
                page.emulate_media(color_scheme=scheme)
                page.set_viewport_size(viewport)
                page.goto(craft["links"]["page"])
                assert_accessible(page)
                # The table of flights scrolls by itself; the page does not.
                assert page.evaluate("document.documentElement.scrollWidth") <= viewport["width"]
                frame = page.frame_locator("iframe.craft")
                page.locator("iframe.craft").scroll_into_view_if_needed()
                expect(frame.get_by_role("heading", name="Over the flights")).to_be_visible()
                assert serious(page.frames[1]) == []
                # The boxes above a plot are its legend: there is no second one.
                expect(frame.locator(".choice .swatch").first).to_be_visible()
                assert frame.locator(".choice + .plot svg g.legend").count() == 0
                assert frame.locator("img, script[src=x]").count() == 0
                page.goto("/crafts")
                assert_accessible(page)
                assert_fits(page)
