"""Every finding that the packages raise is in the catalogue, nothing else is, and docs/findings.md is made of it."""

import ast
import re
from collections.abc import Iterator
from functools import cache

from core.catalogue import read_catalogue
from tests.paths import ROOT

PACKAGES = ("core", "logparse", "estimation", "sysid", "pipeline", "reports", "api")
#: What makes a finding: the class, the catalogue, and what names its severity; the name comes first.
SEVERITIES = ("info", "warning")
GIVERS = ("Finding", "finding", *SEVERITIES)
NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)+")

#: Hyphenated words in files that compute the names of findings, but no such names.
OTHER_WORDS = {"mavlink-raw", "n-m", "utf-8", "utf-8-sig"}


@cache
def sources() -> list[ast.Module]:
    """Parse the files that could make a finding: those that name such a class."""
    paths = (path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py")))
    texts = (path.read_text(encoding="utf-8") for path in paths)
    return [ast.parse(text) for text in texts if any(name in text for name in GIVERS)]


def words(module: ast.Module) -> set[str]:
    constants = (node.value for node in ast.walk(module) if isinstance(node, ast.Constant))
    return {value for value in constants if isinstance(value, str) and NAME.fullmatch(value)}


def calls() -> Iterator[tuple[ast.Module, ast.expr, ast.expr | None]]:
    """Where findings are made: the module, and what stands for name and severity."""
    for module in sources():
        for node in ast.walk(module):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name | ast.IfExp):
                continue
            givers = {name.id for name in ast.walk(node.func) if isinstance(name, ast.Name)} & set(GIVERS)
            if not givers:
                continue
            keywords = {keyword.arg: keyword.value for keyword in node.keywords}
            if None in keywords and not node.args:
                continue  # Read back from JSON.
            yield (
                module,
                node.args[0] if node.args else keywords["id"],
                node.func
                if givers <= set(SEVERITIES)
                else keywords.get("severity") or (node.args[1] if "Finding" in givers and len(node.args) > 1 else None),
            )


@cache
def given() -> tuple[set[str], set[str]]:
    """Names that are given to findings literally or from a table, and patterns of names that are composed."""
    names: set[str] = set()
    patterns: set[str] = set()
    for module, identity, _ in calls():
        if isinstance(identity, ast.Constant):
            names.add(str(identity.value))
        elif isinstance(identity, ast.IfExp):
            names |= {
                str(branch.value) for branch in (identity.body, identity.orelse) if isinstance(branch, ast.Constant)
            }
        elif isinstance(identity, ast.JoinedStr):
            parts = (re.escape(part.value) if isinstance(part, ast.Constant) else "[a-z-]+" for part in identity.values)
            patterns.add("".join(map(str, parts)))
        else:
            # The name comes from a table or an argument of the same file.
            names |= words(module) - OTHER_WORDS
    return names, patterns


@cache
def explained() -> dict[str, frozenset[str]]:
    """Severities of each finding of the catalogue."""
    return {
        finding.id: frozenset(finding.severities)
        for section in read_catalogue().sections
        for finding in section.findings
    }


def test_every_finding_is_explained():
    names, patterns = given()
    assert names - set(explained()) == set(), "add these to core/findings.toml"
    assert {pattern for pattern in patterns if not any(re.fullmatch(pattern, name) for name in explained())} == set()


def test_nothing_is_explained_that_no_package_raises():
    names, patterns = given()
    stale = {name for name in set(explained()) - names if not any(re.fullmatch(pattern, name) for pattern in patterns)}
    assert stale == set(), "take these out of core/findings.toml"


def test_every_severity_that_is_raised_is_in_the_catalogue():
    raised = {
        (str(identity.value), part.attr.lower() if isinstance(part, ast.Attribute) else part.id)
        for _, identity, severity in calls()
        if isinstance(identity, ast.Constant) and severity is not None
        for part in ast.walk(severity)
        if (isinstance(part, ast.Name) and part.id in SEVERITIES)
        or (isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) and part.value.id == "Severity")
    }
    assert {(name, severity) for name, severity in raised if severity not in explained()[name]} == set()


def test_the_page_is_made_from_the_catalogue():
    page = (ROOT / "docs" / "findings.md").read_text(encoding="utf-8")
    assert page == read_catalogue().as_markdown(), "rotorid schema findings > docs/findings.md"


def test_no_finding_is_listed_twice():
    names = [finding.id for section in read_catalogue().sections for finding in section.findings]
    assert {name for name in names if names.count(name) > 1} == set()
