"""Save the tutorial's pictures from the reports that its commands write.

Run the tutorial's commands and ``rotorid analyze sample_logs/quad03_motor_stops.bin`` first, then ``python
docs/pictures.py out``. It opens the reports in the distribution's
Chromium and writes ``docs/pictures/*.png``.
"""

import shutil
import sys
from pathlib import Path

from playwright.sync_api import Locator, Page, sync_playwright

PICTURES = Path(__file__).parent / "pictures"

#: Width of the pages, and of a margin around what is shown, pixels.
WIDTH, MARGIN = 980, 8

#: Tallest picture, pixels: a table of parameters goes on for pages.
TALLEST = 900


def picture(page: Page, name: str, first: Locator, last: Locator | None = None) -> None:
    """Show the page from the top of one element to the bottom of another, or of itself."""
    first.scroll_into_view_if_needed()
    (last or first).scroll_into_view_if_needed()
    page.wait_for_function("document.querySelectorAll('.plot.waiting').length < 1000 && !document.hidden")
    page.wait_for_timeout(1500)  # plots are drawn when they come into view
    above = page.evaluate("window.scrollY")
    top, bottom = first.bounding_box(), (last or first).bounding_box()
    if top is None or bottom is None:
        raise SystemExit(f"{name}: what it should show is not on the page")
    y = top["y"] + above - MARGIN
    height = min(bottom["y"] + bottom["height"] + above + MARGIN - y, TALLEST)
    clip = {"x": top["x"] - MARGIN, "y": y, "width": max(top["width"], bottom["width"]) + 2 * MARGIN, "height": height}
    page.screenshot(path=PICTURES / f"{name}.png", full_page=True, clip=clip)


def main(out: Path) -> None:
    """Save all pictures of the results in a folder."""
    PICTURES.mkdir(exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WIDTH, "height": 1000}, color_scheme="light")
        page.goto((out / "quad03_motor_stops" / "report.html").resolve().as_uri())
        picture(page, "first-screen", page.locator("h1"), page.locator("figure").nth(1))
        page.goto((out / "flight" / "report.html").resolve().as_uri())
        picture(page, "answer", page.locator("h1"), page.locator("nav.contents"))
        picture(page, "horizons", page.locator("figure:has(#plot-horizons)"))
        picture(page, "prediction", page.locator("figure:has(#plot-prediction)"))
        heading = page.get_by_role("heading", name="Physical parameters by every method")
        picture(page, "parameters", heading, heading.locator("xpath=following::table[1]"))
        page.goto((out / "before" / "report.html").resolve().as_uri())
        picture(page, "fleet", page.locator("h1"), page.locator("section.craft table").first)
        page.goto((out / "comparison" / "comparison.html").resolve().as_uri())
        picture(page, "comparison", page.locator("h1"), page.locator("table").first)
        browser.close()


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
