"""Logs of chirps that several tests look at, each read once for a module."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from logparse import FlightLog, read_log


@pytest.fixture(scope="module")
def flown(unpacked: Callable[[str], Path]) -> Callable[[str], FlightLog]:
    """Return a function that reads a log of ../shared/logs/pairs by its name; what it has shown is kept with it."""
    return cache(lambda name: read_log(unpacked(f"pairs/{name}")))
