"""Every finding that the packages raise is in the catalogue, nothing else is, and docs/findings.md is made of it."""

import re

from core.catalogue import read_catalogue
from tests.paths import ROOT

PACKAGES = ("core", "logparse", "estimation", "sysid", "pipeline", "reports", "api")
SOURCES = "\n".join(path.read_text("utf-8") for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py")))
ENTRIES = [finding for section in read_catalogue().sections for finding in section.findings]
SEVERITIES = {finding.id: {str(severity) for severity in finding.severities} for finding in ENTRIES}

#: Where a finding is made: what makes it, its name, and its severity where that stands behind it.
MADE = re.compile(
    r'\b(Finding|finding|info|warning)\(\s*(?:id=)?"([a-z0-9-]+)"(?:,\s*(?:severity=)?Severity\.([A-Z]+))?'
)


def test_every_finding_is_explained_with_its_severities():
    made = MADE.findall(SOURCES)
    assert len(made) > 100
    for maker, name, severity in made:
        assert name in SEVERITIES, "add it to core/findings.toml"
        raised = severity.lower() or (maker if maker in ("info", "warning") else "")
        assert not raised or raised in SEVERITIES[name], name


def test_nothing_is_explained_twice_or_that_no_package_raises():
    assert len(ENTRIES) == len(SEVERITIES)
    assert {name for name in SEVERITIES if f'"{name}"' not in SOURCES} == set(), "take these out of core/findings.toml"


def test_the_page_is_made_from_the_catalogue():
    page = (ROOT / "docs" / "findings.md").read_text(encoding="utf-8")
    assert page == read_catalogue().as_markdown(), "rotorid schema findings > docs/findings.md"
