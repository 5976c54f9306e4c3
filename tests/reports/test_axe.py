"""Reports in a browser: axe-core finds nothing serious in them, bright or dark, wide or narrow, with all unfolded."""

import pytest

from reports.html import flight_page
from reports.numbers import flight_report
from tests.reports.conftest import composed


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
