"""Tests in a short form for `make test`, and in their whole form, which takes its place in `make whole` and CI."""

from collections.abc import Iterable
from typing import Any

import pytest


def short_and_whole(short: Any, whole: Any) -> tuple[Any, Any]:
    """Return a parameter for each form: the whole one asks for all that the short one does, and more."""
    return pytest.param(short, marks=pytest.mark.witness), pytest.param(whole, marks=pytest.mark.whole)


def thinned(cases: Iterable[Any], every: int) -> list[Any]:
    """Return cases alike as parameters, of which `make test` looks at one in so many."""
    rows = (case if isinstance(case, tuple) else (case,) for case in cases)
    return [pytest.param(*row, marks=pytest.mark.whole if k % every else ()) for k, row in enumerate(rows)]
