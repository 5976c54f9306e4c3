"""The tutorial's commands and the notebook page do what they show."""

import re
import shlex
from runpy import run_path

import pytest

from tests.paths import ROOT

TEXT = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def commands() -> list[list[str]]:
    return [
        shlex.split(line[2:]) for block in blocks("console") for line in block.splitlines() if line.startswith("$ ")
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder that looks like a checkout: sample logs inside, results beside them."""
    folder = tmp_path_factory.mktemp("tutorial")
    (folder / "sample_logs").symlink_to(ROOT / "sample_logs")
    return folder


@pytest.mark.whole
@pytest.mark.usefixtures("forks")
def test_every_command_does_what_it_says(folder, monkeypatch, rotorid_here):
    monkeypatch.chdir(folder)
    for words in commands():
        assert words[0] == "rotorid"
        done = rotorid_here(*words[1:])
        assert done.returncode == 0, f"{shlex.join(words)}\n{done.stdout}\n{done.stderr}"
    written = set(re.findall(r"`(out/[\w/]+\.\w+)`", TEXT)) | set(
        re.findall(r"^(?:Report: )?(out/\S+\.\w+)$", TEXT, re.M)
    )
    assert {name for name in written if not (folder / name).is_file()} == set()


def test_the_python_runs(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    for block in blocks("python"):
        exec(compile(block, "tutorial.md", "exec"), {})
        assert "Prediction: " in capsys.readouterr().out


DOCS = ROOT / "docs"


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
