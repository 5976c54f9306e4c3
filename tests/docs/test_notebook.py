"""The notebook page runs, and shows what its cells answer."""

import re
from pathlib import Path
from runpy import run_path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


def labels(answer):
    """First line, and what stands before the values of the others."""
    first, *rows = answer.strip().splitlines()
    return [first, *(re.split(r"\s{2,}", row.strip())[0] for row in rows)]


@pytest.mark.slow
def test_every_cell_answers_as_shown(monkeypatch):
    monkeypatch.chdir(DOCS.parent)
    shown = 0
    for value, answer, picture in run_path(str(DOCS / "notebook.py"))["cells"](
        (DOCS / "notebook.md").read_text("utf-8")
    ):
        assert (answer is None) != (picture is None), "each cell has an answer or a picture"
        if answer is not None:
            assert labels(repr(value)) == labels(answer), "python docs/notebook.py writes the page anew"
        else:
            assert value.data
            assert (DOCS / picture).is_file()
        shown += 1
    assert shown == 10
