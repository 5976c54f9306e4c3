"""axe-core in the browser: what it calls serious or critical on a page is a fault."""

from __future__ import annotations

from pathlib import Path

import axe_core_python
from playwright.sync_api import Frame, Page

#: The script as its npm package has it.
_SOURCE = Path(axe_core_python.__file__).parent / "axe.min.js"


def serious(page: Page | Frame) -> list[str]:
    """Run axe on a page and return a line for each element that fails one of its serious or critical rules.

    The script comes over the browser's own protocol, so that a page's policy does not refuse it.
    """
    page.evaluate(_SOURCE.read_text("utf-8"))
    violations = page.evaluate("async () => (await axe.run(document, {resultTypes: ['violations']})).violations")
    return [
        f"{violation['id']}: {node['html'][:120]} ({node['failureSummary'].splitlines()[-1].strip()})"
        for violation in violations
        if violation["impact"] in ("serious", "critical")
        for node in violation["nodes"]
    ]
