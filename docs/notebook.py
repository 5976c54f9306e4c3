"""Run the cells of docs/notebook.md; ``python docs/notebook.py`` writes their answers and pictures into the page."""

import ast
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from playwright.sync_api import sync_playwright

PAGE = Path(__file__).with_suffix(".md")

#: Size of a picture, pixels.
SIZE = {"width": 900, "height": 560}

#: A cell, and the answer or the picture behind it.
CELL = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```\n|\n!\[.*?\]\((\S+)\)\n)?", re.MULTILINE | re.DOTALL)


def cells(page: str) -> Iterator[tuple[object, str | None, str | None]]:
    """Yield the value of each cell's last expression, and the answer or the picture that the page shows for it."""
    names: dict[str, object] = {}
    for code, answer, picture in CELL.findall(page):
        *body, last = ast.parse(code).body
        exec(compile(ast.Module(body, []), "notebook", "exec"), names)
        if not isinstance(last, ast.Expr):
            raise ValueError(f"the cell ends without an expression:\n{code}")
        yield eval(compile(ast.Expression(last.value), "notebook", "eval"), names), answer or None, picture or None


def main() -> None:
    """Write answers and pictures."""
    text = PAGE.read_text(encoding="utf-8")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport=SIZE, color_scheme="light")
        for value, answer, picture in cells(text):
            if answer is not None:
                text = text.replace(f"```text\n{answer}```", f"```text\n{value!r}\n```", 1)
            if picture is not None:
                page.set_content(value.to_html(include_plotlyjs=True))
                page.wait_for_timeout(1500)
                page.screenshot(path=PAGE.parent / picture, full_page=True)
        browser.close()
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
