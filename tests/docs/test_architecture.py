"""The page on the architecture names what exists, and no more than fifteen steps from the command to the page."""

import re
from importlib import import_module
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "architecture.md").read_text(encoding="utf-8")
STEPS = re.findall(r"^\d+\. (.*(?:\n   .*)*)", PAGE, re.MULTILINE)
NAMES = sorted(set(re.findall(r"`((?:rotorid|pipeline|logparse|estimation|sysid|reports)\.[\w.]+)`", PAGE)))


def test_the_walk_is_short():
    assert 10 <= len(STEPS) <= 15


@pytest.mark.parametrize("name", NAMES)
def test_every_name_exists(name):
    """Stale cross-references are found here."""
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:end]))
        except ModuleNotFoundError:
            continue
        for part in parts[end:]:
            found = getattr(found, part)
        return
    raise AssertionError(name)


def test_every_package_is_named():
    root = Path(__file__).parents[2]
    packages = [path.parent.name for path in (root / "sysid").glob("*/__init__.py")]
    assert all(f"`sysid/{name}/`" in PAGE for name in packages)
