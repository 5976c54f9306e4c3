"""What people do on the pages, in a real browser: upload, read, share, delete, sign in, name a craft; at any width."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, Route, expect

from api import Settings
from api.settings import Access
from api.work.craft_flights import keep
from api.work.outcome import Flown
from api.work.worker import analyze_logs
from tests.api.browsing import PHONE, File, assert_accessible, assert_fits, watched
from tests.api.conftest import served
from tests.api.programs import PATIENCE
from tests.api.visits import ordered
from tests.axe import serious
from tests.paths import SAMPLES
from tests.pipeline.builders import hovering

expect.set_options(timeout=PATIENCE * 1000.0)  # only what never comes may meet it, on a busy computer too


@pytest.fixture(scope="module")
def visitor(browser: Browser, service: httpx.Client) -> BrowserContext:
    return browser.new_context(base_url=str(service.base_url))


@pytest.fixture
def page(visitor: BrowserContext, service: httpx.Client) -> Iterator[Page]:
    with watched(visitor, service) as page:
        yield page


def choose(page: Page, *files: File) -> None:
    page.goto("/")
    page.get_by_label("Choose logs").set_input_files(
        [{"name": name, "mimeType": "application/octet-stream", "buffer": content} for name, content in files]
    )


def test_a_log_becomes_a_report_and_its_files(page: Page, tmp_path: Path) -> None:
    go_on = tmp_path / "go on"
    choose(page, ("flight.bin", f"until |{go_on}|".encode()))
    page.wait_for_url("**/analyses/*")
    expect(page.get_by_role("heading", name="Analysing flight.bin")).to_be_visible()
    expect(page.get_by_role("status").first).to_have_text("Transfer functions")  # as the events tell
    assert_accessible(page)
    go_on.touch()
    # The page changes to the report by itself; the report's own script runs in its sandbox.
    expect(page.locator("iframe")).to_have_attribute("title", "Report on flight.bin")
    # Not `page.wait_for_function`: it polls with eval, which our policy refuses.
    expect(page.locator(".loading")).to_be_hidden()
    assert page.frame(name="report").title() == "drawn"  # type: ignore[union-attr]
    assert_accessible(page)
    page.get_by_text("Downloads").click()
    with page.expect_download() as download:
        page.get_by_role("link", name="RMSE table").click()
    assert download.value.suggested_filename == "flight.bin.rmse.csv"
    assert download.value.path().read_text() == "flight,x,y,z\n1,0.25,0.2,0.3\n"
    page.get_by_text("Downloads").click()
    page.get_by_text("What was logged").click()
    with page.expect_download() as download:
        page.get_by_role("link", name="imu").click()
    assert download.value.path().read_bytes() == b"PAR1"


def test_a_report_that_is_there_before_the_script_is_not_called_loading_for_good(page: Page) -> None:
    choose(page, ("flight.bin", b"good flight"))
    expect(page.locator("iframe")).to_be_visible()
    held: list[Route] = []
    page.route("**/pages.js*", lambda route: held.append(route))
    page.goto(page.url, wait_until="commit")
    expect(page.frame_locator("iframe").locator("html")).to_be_attached()
    page.frame(name="report").wait_for_load_state()  # type: ignore[union-attr]
    held[0].continue_()
    expect(page.locator(".loading")).to_be_hidden()


def test_several_logs_each_on_its_own(page: Page) -> None:
    choose(page, ("one.bin", b"good one"), ("none.bin", b""), ("two.bin", b"good two"), ("big.bin", b"x" * 4_000_001))
    uploads = page.get_by_role("region", name="Uploads").get_by_role("listitem")
    expect(uploads).to_have_count(4)
    expect(uploads.nth(0)).to_contain_text("8 bytes, uploaded")
    expect(uploads.nth(1)).to_contain_text("This file is empty")
    expect(uploads.nth(3)).to_contain_text("This file has 4 MB; the service takes logs of up to 4 MB.")
    expect(page.get_by_text("2 of 4 uploaded. Choose how to analyse them.")).to_be_attached()
    assert_accessible(page)
    page.get_by_role("button", name="Remove none.bin").click()
    expect(uploads).to_have_count(3)
    page.get_by_role("button", name="Analyse each on its own").click()
    page.wait_for_url("**/analyses")
    rows = page.locator("#analyses li")
    # The list is fetched again and again until nothing in it changes any more.
    expect(rows.nth(0)).to_contain_text("Done")
    expect(rows.nth(1)).to_contain_text("Done")
    assert [rows.nth(row).get_by_role("link").inner_text() for row in (0, 1)] == ["two.bin", "one.bin"]


def test_a_log_is_dropped(page: Page) -> None:
    page.goto("/")
    transfer = page.evaluate_handle(
        "() => { const data = new DataTransfer(); data.items.add(new File(['good drop'], 'drop.bin')); return data; }"
    )
    page.dispatch_event("main", "dragenter", {"dataTransfer": transfer})
    expect(page.locator(".drop")).to_have_class("drop over")
    page.dispatch_event("main", "drop", {"dataTransfer": transfer})
    page.wait_for_url("**/analyses/*")


def test_a_list_that_cannot_be_renewed_says_so_until_it_can(page: Page, service: httpx.Client) -> None:
    _, endless = ordered(service, b"hang endlessly", "endless.bin")
    page.goto("/")
    page.route("**/", lambda route: route.abort())
    expect(page.get_by_role("alert")).to_contain_text("The service does not answer")
    page.unroute("**/")
    expect(page.get_by_role("alert")).to_be_hidden()
    service.post(f"{endless}/cancel")


def test_an_upload_that_is_broken_off_can_be_tried_again(page: Page) -> None:
    page.route("**/api/v1/logs", lambda route: route.abort())
    choose(page, ("flight.bin", b"good after all"))
    expect(page.get_by_text("The upload was broken off")).to_be_visible()
    page.unroute("**/api/v1/logs")
    page.get_by_role("button", name="Try again flight.bin").click()
    page.wait_for_url("**/analyses/*")


def test_a_failed_log_says_why_and_can_be_deleted(page: Page) -> None:
    choose(page, ("bad.bin", b"refused"))
    expect(page.get_by_role("heading", name="The log cannot be analysed")).to_be_visible()
    expect(page.get_by_text("set LOG_BITMASK to include motor outputs")).to_be_visible()
    assert_accessible(page)
    address = page.url
    page.get_by_text("Delete", exact=True).click()
    page.get_by_label("Delete the log as well").check()
    page.get_by_role("button", name="Delete for good").click()
    page.wait_for_url("**/analyses")
    page.goto(address)
    expect(page.get_by_text("There is no analysis of this id.")).to_be_visible()


def test_an_analysis_is_cancelled_and_done_again_with_other_settings(page: Page) -> None:
    choose(page, ("long.bin", b"hang"))
    page.wait_for_url("**/analyses/*")
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_role("heading", name="Cancelled: long.bin")).to_be_visible()
    page.get_by_role("link", name="Analyse again").click()
    page.get_by_label("Poles of each transfer function").fill("3")
    page.get_by_label("Zeros").fill("4")
    page.get_by_role("button", name="Analyse").click()
    expect(page.get_by_role("alert").first).to_contain_text("fewer than the 3 poles")
    assert_accessible(page)
    page.get_by_label("Zeros").fill("2")
    page.get_by_role("button", name="Analyse").click()
    expect(page.get_by_text("3 poles, 2 zeros")).to_be_visible()
    page.goto("/analyses")  # and from the list it is cancelled without leaving it
    page.get_by_role("button", name="Cancel long.bin").click()
    expect(page.locator("#analyses li").first).to_contain_text("Cancelled")
    expect(page.locator("#said")).to_have_text("Cancelled.")
    page.once("dialog", lambda dialog: dialog.accept())
    # A page lists 25 at most, so that another may move up when one goes: this one's own link must be gone.
    button = page.get_by_role("button", name="Delete the analysis of long.bin").first
    row = page.locator("#analyses li").filter(has=button).first
    address = row.get_by_role("link").first.get_attribute("href")
    button.click()
    expect(page.locator(f'#analyses a[href="{address}"]')).to_have_count(0)


def test_a_report_is_shared_and_taken_back(page: Page, browser: Browser, service: httpx.Client) -> None:
    choose(page, ("shared.bin", b"good to share"))
    page.get_by_text("Share", exact=True).click()
    page.get_by_role("button", name="Make a link").click()
    link = page.get_by_label("Whoever has this link")
    expect(link).to_be_focused()
    with watched(browser, service) as stranger:
        stranger.goto(link.input_value())
        expect(stranger.locator("iframe")).to_have_attribute("title", "Report on shared.bin")
        expect(stranger.get_by_text("Delete")).to_have_count(0)
        assert_accessible(stranger)
        page.get_by_role("button", name="Take back all links").click()
        expect(page.get_by_text("they lead nowhere now")).to_be_visible()
        stranger.reload()
        expect(stranger.get_by_text("There is nothing behind this link")).to_be_visible()


def test_the_keyboard_is_enough(page: Page) -> None:
    page.on("filechooser", lambda _: None)  # from the start, lest the browser dismiss the first one by itself
    page.goto("/")
    page.keyboard.press("Tab")
    expect(page.get_by_text("Skip to the content")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("main")).to_be_focused()
    page.keyboard.press("Tab")
    expect(page.get_by_label("Choose logs")).to_be_focused()
    with page.expect_file_chooser() as chooser:
        page.keyboard.press("Enter")
    chooser.value.set_files([{"name": "keys.bin", "mimeType": "application/octet-stream", "buffer": b"good keys"}])
    page.locator("iframe").wait_for()
    page.wait_for_load_state()  # keys are heard when the page's script has run
    page.locator("summary", has_text="Downloads").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("link", name="RMSE table")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_role("link", name="RMSE table")).not_to_be_visible()
    expect(page.locator("summary", has_text="Downloads")).to_be_focused()
    page.get_by_text("Delete", exact=True).focus()
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Delete for good").press("Enter")
    page.wait_for_url("**/analyses")


def test_no_page_scrolls_sideways_on_a_phone(page: Page) -> None:
    page.set_viewport_size(PHONE)
    choose(page, ("a_rather_long_name_of_a_flight_" * 5 + ".bin", b"good, but long"), ("short.bin", b"good, short"))
    page.get_by_role("button", name="Analyse together").wait_for()
    assert_fits(page)
    page.get_by_role("button", name="Analyse together").click()
    page.locator("iframe").wait_for()
    for menu in ("Flights", "Downloads", "Share", "Delete"):
        page.get_by_text(menu, exact=True).click()
        assert_fits(page)
    page.get_by_role("link", name="Analyse again").click()
    page.wait_for_url("**/again")
    assert_fits(page)
    for address in ("/", "/analyses", "/nothing"):
        page.goto(address)
        assert_fits(page)
        assert_accessible(page)


def test_the_reference_is_drawn_without_anything_from_elsewhere(page: Page) -> None:
    page.goto("/docs")
    expect(page.get_by_text("Upload logs, and analyse them in the same call if wanted")).to_be_visible()
    assert_fits(page)


def test_a_token_opens_the_service(browser: Browser, tmp_path: Path) -> None:
    settings = Settings(data=tmp_path, workers=1, access=Access.TOKENS)
    with served(settings) as client, watched(browser, client, expected=(401,)) as page:
        secret = client.parts.tokens.create("anna")
        page.goto("/analyses?state=done")
        expect(page.get_by_role("heading", name="Sign in")).to_be_visible()
        assert_accessible(page)
        page.get_by_label("Token").fill("a guess")
        page.get_by_role("button", name="Sign in").click()
        expect(page.get_by_role("alert").first).to_contain_text("This token is nobody's")
        page.get_by_label("Token").fill(secret)
        page.get_by_role("button", name="Sign in").click()
        expect(page.get_by_role("heading", name="Analyses")).to_be_visible()
        kept = {cookie["name"]: (cookie["httpOnly"], cookie["sameSite"]) for cookie in page.context.cookies()}
        assert kept == {"rotorid_token": (True, "Strict"), "rotorid_form": (True, "Strict")}
        choose(page, ("a.bin", b"good a"), ("b.bin", b"good b"))
        page.get_by_role("button", name="Analyse together").click()
        # A browser sends no cookie along with what is clicked in the sandbox; the links there must work all the same.
        report = page.frame_locator("iframe")
        report.get_by_role("link", name="b.bin").click()
        expect(report.get_by_role("heading", name="b.bin")).to_be_visible()
        page.get_by_role("button", name="Sign out").click()
        page.goto("/")
        expect(page.get_by_role("heading", name="Sign in")).to_be_visible()


@pytest.mark.slow
def test_signals_are_explored_by_everybody(browser: Browser, tmp_path: Path) -> None:
    """Pages of logs and of their signals: names, order, contrast and axe, on a phone, with a plot drawn."""
    sample = SAMPLES / "quad01_davos_esc.bin"
    with served(Settings(data=tmp_path, workers=1), analyze_logs) as client:
        answer = client.post("/api/v1/logs", files={"file": (sample.name, sample.read_bytes())})
        log = answer.json()["id"]
        with watched(browser, client, color_scheme="dark", viewport=PHONE) as page:
            page.goto(f"/logs/{log}/explore?signal=ATT.Roll")
            expect(page.locator(".main-svg").first).to_be_visible()
            page.goto(f"/logs/{log}/explore")
            expect(page.get_by_role("button", name="Remove deg(attitude.roll)")).to_be_visible()
            page.get_by_role("button", name="Spectrum").click()
            expect(page.get_by_role("button", name="Over time")).to_be_visible()
            page.get_by_text("Modes, events and texts").click()
            expect(page.get_by_text("Mission: 1 Takeoff")).to_be_visible()
            page.get_by_text("Parameters, and what was changed").click()
            expect(page.get_by_text("No flight of this craft before this one is known.")).to_be_visible()
            assert_accessible(page)
            assert_fits(page)
            page.goto("/logs")
            assert_accessible(page)
            assert_fits(page)


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
