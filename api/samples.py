"""The sample logs of a checkout, to be opened by who has no log at hand."""

import json
from functools import cache
from pathlib import Path
from typing import NamedTuple

_FOLDER = Path(__file__).parents[1] / "sample_logs"


class Sample(NamedTuple):
    """A log that can be opened as if it had been uploaded."""

    name: str
    what: str
    path: Path


@cache
def samples(folder: Path = _FOLDER) -> dict[str, Sample]:
    """List the sample logs by name; none where rotorid was installed without them."""
    return {path.stem: Sample(path.stem, _what(path), path) for path in sorted(folder.glob("*.bin"))}


def _what(path: Path) -> str:
    """Read from the truth beside a log what was flown."""
    try:
        what = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))["what"]
    except (OSError, ValueError, KeyError):
        return ""
    return str(what).rpartition("simulated by rotorid, not flown: ")[2]
