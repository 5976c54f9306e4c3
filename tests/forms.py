"""Tests in a short form for `make test`, and in their whole form, which takes its place in `make whole` and CI."""

from typing import Any

import pytest


def short_and_whole(short: Any, whole: Any) -> tuple[Any, Any]:
    """Return a parameter for each form: the whole one asks for all that the short one does, and more."""
    return pytest.param(short, marks=pytest.mark.witness), pytest.param(whole, marks=pytest.mark.whole)
