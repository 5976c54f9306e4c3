"""The page on the architecture names what exists, and no more than fifteen steps from the command to the page."""

import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

from rotorid.cli.main import main

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
STEPS = re.findall(r"^\d+\. (.*(?:\n   .*)*)", PAGE, re.MULTILINE)
NAME = re.compile(r"`((?:rotorid|pipeline|core|logparse|estimation|sysid|reports)\.[\w.]+)`")
NAMES = sorted(set(NAME.findall(PAGE)))


def named(name):
    """Return what a dotted name of the page names."""
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:end]))
        except ModuleNotFoundError:
            continue
        for part in parts[end:]:
            found = getattr(found, part)
        return found
    raise AssertionError(name)


@pytest.mark.parametrize("name", NAMES)
def test_every_name_exists(name):
    """Stale cross-references are found here."""
    named(name)


@pytest.mark.slow
def test_a_log_passes_every_function_of_the_walk_in_its_order(tmp_path, monkeypatch):
    walk = [[getattr(named(name), "__code__", None) for name in NAME.findall(step)] for step in STEPS]
    wanted = {code for step in walk for code in step if code is not None}
    passed = []

    def notice(frame, event, argument):
        if event == "call" and frame.f_code in wanted and frame.f_code not in passed:
            passed.append(frame.f_code)

    log = str(ROOT / "sample_logs" / "octa01_zurich_calm.bin")
    words = ["rotorid", "analyze", log, "--out", str(tmp_path / "out"), "--poles", "2", "--zeros", "1"]
    monkeypatch.setattr(sys, "argv", words)
    sys.setprofile(notice)
    try:
        with pytest.raises(SystemExit, match="0"):
            main()
    finally:
        sys.setprofile(None)
    assert wanted - set(passed) == set()
    # What steps 5 to 12 do runs within step 13.
    first = [min(passed.index(code) for code in step if code is not None) for step in (*walk[1:12], *walk[13:])]
    assert first == sorted(first)


def test_every_package_is_named():
    packages = [path.parent.name for path in (ROOT / "sysid").glob("*/__init__.py")]
    assert all(f"`sysid/{name}/`" in PAGE for name in packages)


def test_the_walk_is_short():
    assert 10 <= len(STEPS) <= 15
