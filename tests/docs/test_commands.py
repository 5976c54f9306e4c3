"""The page of commands has every command, each with arguments that the command line takes."""

import re
import shlex
from pathlib import Path

import pytest
from typer.main import get_command

from rotorid.cli.main import app

DOCS = Path(__file__).parents[2] / "docs"
COMMANDS = get_command(app).commands
SHOWN = re.findall(r"^\| `rotorid (.*?)` \|", (DOCS / "commands.md").read_text(encoding="utf-8"), re.MULTILINE)


def test_every_command_is_there():
    assert {words.split()[0] for words in SHOWN} == set(COMMANDS)


@pytest.mark.parametrize("words", SHOWN)
def test_every_option_exists(words):
    name, *arguments = shlex.split(words)
    options = {option for each in COMMANDS[name].params for option in (*each.opts, *each.secondary_opts)}
    assert {word for word in arguments if word.startswith("--")} <= options


def test_the_readme_is_read_in_a_minute():
    prose = re.sub(r"```.*?```", "", (DOCS.parent / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(re.sub(r"\]\(.*?\)", "]", prose).split()) < 400
