"""Reports in a browser: axe-core finds nothing serious in them, bright or dark, wide or narrow, with all unfolded."""

import shutil

import pytest

from reports.html import flight_page
from reports.numbers import flight_report
from tests.reports.conftest import composed


@pytest.fixture(scope="module")
def browser():
    """Run Chromium; for this module only, for its event loop would be in the way of other tests'."""
    sync_playwright = pytest.importorskip("playwright.sync_api").sync_playwright
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("Chromium is not installed (Debian: apt-get install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def pages(flight, other, fleet, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    (folder / "flight.html").write_text(flight_page(flight, flight_report(flight)), encoding="utf-8")
    return {
        "flight": folder / "flight.html",
        "craft": fleet / "report.html",
        "folder without a craft": composed(folder / "alone", [flight, other]),
        "nothing": composed(folder / "nothing", []),
    }


@pytest.mark.parametrize(("scheme", "width"), [("light", 1280), ("dark", 390)])
@pytest.mark.parametrize("name", ["flight", "craft", "folder without a craft", "nothing"])
def test_nothing_serious_is_found(pages, browser, name, scheme, width):
    serious = pytest.importorskip("tests.axe").serious
    page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
    page.goto(pages[name].as_uri())
    page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    assert serious(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.close()
