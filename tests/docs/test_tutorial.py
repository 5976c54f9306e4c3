"""The tutorial's commands run as printed, one after the other, and its Python too."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
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


@pytest.mark.slow
def test_every_command_does_what_it_says(folder):
    for words in commands():
        assert words[0] == "rotorid"
        done = subprocess.run(
            [Path(sys.executable).with_name("rotorid"), *words[1:]],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{shlex.join(words)}\n{done.stdout}\n{done.stderr}"
    written = set(re.findall(r"`(out/[\w/]+\.\w+)`", TEXT)) | set(
        re.findall(r"^(?:Report: )?(out/\S+\.\w+)$", TEXT, re.M)
    )
    assert {name for name in written if not (folder / name).is_file()} == set()


def test_the_python_runs(folder):
    for block in blocks("python"):
        done = subprocess.run([sys.executable, "-c", block], cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert "x: " in done.stdout
