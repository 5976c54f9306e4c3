"""The documentation builds as a site without a warning, and its API reference has all that the packages export."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PACKAGES = ("logparse", "estimation", "sysid", "pipeline", "reports", "simulation")


@pytest.mark.whole
def test_the_site_builds_without_warnings(tmp_path):
    site = tmp_path / "site"
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-b",
        "html",
        "-q",
        "-W",
        "--keep-going",
        "-d",
        tmp_path / "kept",
        DOCS,
        site,
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    page = (site / "api" / "sysid.html").read_text(encoding="utf-8")
    assert 'id="sysid.Experiment.from_flight"' in page
    assert "Samples per second" in page  # what the docstring says of `rate`


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
