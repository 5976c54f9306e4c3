"""Reports in a browser: axe-core finds nothing serious in them, wide or narrow; plots for paper and for one flight."""

from datetime import timedelta

import numpy as np
import pandas as pd
import pytest

from logparse import Finding, Severity
from pipeline.fleet.review import review
from pipeline.results.drift import CraftNote
from reports.pages.fleet import craft_page
from reports.pages.parameters import parameters_page
from sysid.rigid_body.physical import HEADLINE, PhysicalParameters
from tests.pipeline.builders import OCTA, START, hovering
from tests.reports.accounts import CRASH, LOST, answered
from tests.reports.builders import page_of
from tests.reports.conftest import composed


@pytest.fixture(scope="module")
def pages(flight, other, fleet, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    (folder / "flight.html").write_text(page_of(answered(flight, LOST, CRASH)), encoding="utf-8")
    return {
        "flight": folder / "flight.html",
        "folder": fleet / "report.html",
        "craft": _of_a_craft(folder / "craft.html"),
        "craft over flights": _over_flights(folder / "review.html"),
        "folder without a craft": composed(folder / "alone", [flight, other]),
        "nothing": composed(folder / "nothing", []),
    }


def _of_a_craft(file):
    """Write the page of `rotorid craft`: one parameter known, one not, by two methods that disagree."""
    known, unknown = (
        (2.6, 0.02, "m/s^2, at full command", 10.4, 0.1, "N", ""),
        (None, None, "s", None, None, "", "slow"),
    )
    names = ("value", "sigma", "unit", "si_value", "si_sigma", "si_unit", "note")
    rows = {
        ("thrust over mass", HEADLINE): known,
        ("thrust over mass", "rigid body"): known,
        ("motor lag", "rigid body"): unknown,
    }
    table = pd.DataFrame.from_dict(rows, orient="index", columns=names)
    table.index = pd.MultiIndex.from_tuples(rows, names=["parameter", "method"])
    finding = Finding("methods-disagree", Severity.WARNING, "two methods disagree", "weigh the craft")
    parameters = PhysicalParameters(table, None, None, None, None, (finding,))
    file.write_text(parameters_page(parameters, OCTA, ["flight.bin"], 4.3), encoding="utf-8")
    return file


def _over_flights(file):
    """Write the page of a craft one of whose motors weakens, with new propellers before its fifth flight."""
    flights = hovering(np.random.default_rng(1), "octa", 8, weak=3, loss=0.01, scatter=0.001)
    note = CraftNote(at=START + timedelta(days=3, hours=12), text="new propellers", boundary=True)
    file.write_text(craft_page(review(flights, [note]), "our <b>octa</b>", [note]), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def page(browser):
    return browser.new_page()


NAMES = ("flight", "folder", "craft", "craft over flights", "folder without a craft", "nothing")


@pytest.mark.parametrize(
    ("name", "scheme", "width"),
    # All pages are of one style sheet: one of them shows it bright as well.
    [*((name, "dark", 390) for name in NAMES), ("flight", "light", 1440)],
)
def test_nothing_serious_is_found_and_a_phone_need_not_scroll_sideways(pages, page, name, scheme, width):
    serious, faults = pytest.importorskip("tests.axe").serious, []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(pages[name].as_uri())
    if scheme == "light":
        assert page.evaluate("document.getElementById('first').getBoundingClientRect().bottom") <= 900.0
    page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    assert serious(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert not faults


def test_plots_are_drawn_for_paper_and_for_the_flight_chosen(fleet, browser):
    """What is printed as soon as the page has loaded holds every plot not folded, light, no wider than the page."""
    page = browser.new_page(viewport={"width": 390, "height": 800}, color_scheme="dark")
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto((fleet / "craft1.html").as_uri())
    page.emulate_media(media="print", color_scheme="dark")
    drawn_now = page.evaluate(
        """() => {
        dispatchEvent(new Event("beforeprint"));
        const plots = [...document.querySelectorAll(".plot")].filter((each) => each.checkVisibility());
        const text = getComputedStyle(document.documentElement).getPropertyValue("--text").trim();
        const state = plots.map((each) => [each.id, Boolean(each.querySelector(".main-svg")), each._fullLayout?.width]);
        return { state, text };
    }"""
    )
    assert len(drawn_now["state"]) >= 2
    assert all(is_drawn and width <= 690 for _, is_drawn, width in drawn_now["state"])
    assert drawn_now["text"] == "#1c2126", "paper is light"
    page.emulate_media(media="screen")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    place = page.locator("#plot-1-prediction")
    place.scroll_into_view_if_needed()
    drawn = "document.getElementById('plot-1-prediction').data[0].y[100]"
    before = page.evaluate(drawn)
    page.get_by_label("Flight").select_option(label="flight01")
    # Not `page.wait_for_function`: it polls with eval, which the page's policy refuses.
    while page.evaluate(drawn) == before:
        page.wait_for_timeout(20.0)
    assert page.get_by_role("link", name="its page").get_attribute("href") == "flights/flight01/report.html"
    assert page.evaluate("document.documentElement.scrollWidth") <= 390, "a phone need not scroll sideways"
    assert not faults
    page.close()
