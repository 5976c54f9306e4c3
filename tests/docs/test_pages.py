"""The documentation names what exists: architecture, commands, exports; and it builds without a warning."""

import ast
import re
import shlex
import subprocess
import sys
from pkgutil import resolve_name

import pytest
from typer.main import get_command

from rotorid.cli.main import app
from tests.paths import ROOT

DOCS = ROOT / "docs"
NAME = re.compile(r"`((?:rotorid|pipeline|core|logparse|estimation|sysid|reports)\.[\w.]+)`")


def test_every_name_of_the_architecture_exists():
    names = set(NAME.findall((DOCS / "architecture.md").read_text(encoding="utf-8")))
    assert len(names) > 20
    for name in names:
        resolve_name(name)  # raises on what is not there


COMMANDS = get_command(app).commands
SHOWN = re.findall(r"^\| `rotorid (.*?)` \|", (DOCS / "commands.md").read_text(encoding="utf-8"), re.MULTILINE)


def test_every_command_is_there_with_the_options_that_are_shown():
    assert {words.split()[0] for words in SHOWN} == set(COMMANDS)
    for words in SHOWN:
        name, *arguments = shlex.split(words)
        options = {option for param in COMMANDS[name].params for option in (*param.opts, *param.secondary_opts)}
        assert {word for word in arguments if word.startswith("--")} <= options, words


PACKAGES = ("logparse", "estimation", "sysid", "pipeline", "reports", "simulation")


@pytest.mark.whole
def test_the_site_builds_without_warnings(tmp_path):
    """All but the writing of HTML: documents read, docstrings taken in, references resolved."""
    dummy = ("-b", "dummy", "-q", "-W", "--keep-going", "-d", tmp_path, DOCS, tmp_path)
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *dummy], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "api" / "sysid.doctree").read_bytes()
    assert b"sysid.Experiment.from_flight" in page
    assert b"Samples per second" in page  # what the docstring says of `rate`


@pytest.mark.parametrize("package", PACKAGES)
def test_the_reference_has_what_a_package_exports(package):
    module = ast.parse((ROOT / package / "__init__.py").read_text(encoding="utf-8"))
    exported = next(
        ast.literal_eval(node.value)
        for node in module.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    )
    page = (DOCS / "api" / f"{package}.md").read_text(encoding="utf-8")
    shown = re.findall(rf"^\.\. (?:auto\w+|py:data):: {package}\.(\w+)$", page, re.MULTILINE)
    assert sorted(shown) == sorted(exported)


def test_pictures_are_small():
    pictures = list((DOCS / "pictures").iterdir())
    assert sum(picture.stat().st_size for picture in pictures) < 1.5e6
    shown = "".join(page.read_text(encoding="utf-8") for page in DOCS.glob("*.md"))
    assert {picture.name for picture in pictures} == set(re.findall(r"\(pictures/([\w.-]+)\)", shown))
