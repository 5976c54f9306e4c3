"""Every finding that the packages can raise is explained in docs/findings.md, and nothing else is."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("logparse", "estimation", "sysid", "pipeline", "reports", "api")
#: Classes whose `id` is such a name.
GIVERS = ("Finding", "FlightEvent")
NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)+")

#: Hyphenated words in files that compute the names of findings, but no such names.
OTHER_WORDS = {"mavlink-raw", "n-m", "utf-8-sig"}


def sources() -> Iterator[ast.Module]:
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            yield ast.parse(path.read_text(encoding="utf-8"))


def words(module: ast.Module) -> set[str]:
    constants = (node.value for node in ast.walk(module) if isinstance(node, ast.Constant))
    return {value for value in constants if isinstance(value, str) and NAME.fullmatch(value)}


@cache
def given() -> tuple[set[str], set[str]]:
    """Names that are given to findings literally or from a table, and patterns of names that are composed."""
    names: set[str] = set()
    patterns: set[str] = set()
    for module in sources():
        for node in ast.walk(module):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in GIVERS):
                continue
            keywords = {keyword.arg: keyword.value for keyword in node.keywords}
            if None in keywords and not node.args:
                continue  # Read back from JSON.
            identity = node.args[0] if node.args else keywords["id"]
            if isinstance(identity, ast.Constant):
                names.add(str(identity.value))
            elif isinstance(identity, ast.JoinedStr):
                parts = (
                    re.escape(part.value) if isinstance(part, ast.Constant) else "[a-z-]+" for part in identity.values
                )
                patterns.add("".join(map(str, parts)))
            else:
                # The name comes from a table or an argument of the same file.
                names |= words(module) - OTHER_WORDS
    return names, patterns


def explained() -> set[str]:
    rows = re.findall(r"^\| (`[^|]*`) \|", (ROOT / "docs" / "findings.md").read_text(encoding="utf-8"), re.MULTILINE)
    return {name for row in rows for name in re.findall(r"`([^`]+)`", row)}


def test_every_finding_is_explained():
    names, patterns = given()
    documented = explained()
    assert names - documented == set(), "add these to docs/findings.md"
    assert {pattern for pattern in patterns if not any(re.fullmatch(pattern, name) for name in documented)} == set()


def test_nothing_is_explained_that_no_room_gives():
    names, patterns = given()
    stale = {name for name in explained() - names if not any(re.fullmatch(pattern, name) for pattern in patterns)}
    assert stale == set(), "take these out of docs/findings.md"
