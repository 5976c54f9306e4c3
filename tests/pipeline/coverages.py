"""What flights of tests covered: complete, with what a test says otherwise in its place."""

from typing import Any

from core.serialization import plain, restored
from pipeline.results.coverage import Coverage

_AXIS = {"rms": 0.3, "unit": "rad/s", "word": "strong"}
_USUAL: dict[str, Any] = {
    "seconds": 180.0,
    "quantities": {},
    "map": [],
    "wind": {"north": 1.0, "east": 0.0, "speed": 1.0, "direction": 0.0, "sigma": 0.1, "source": ""},
    "excitation": {
        "acceleration_rms": 1.0,
        "acceleration_noise": 0.05,
        "speed_std": [3.0, 3.0],
        "headings": 6,
        "axes": {"roll": _AXIS, "pitch": _AXIS, "yaw": _AXIS, "thrust": _AXIS | {"unit": "m/s^2"}},
    },
    "health": {
        "rates": {"attitude": {"rate": 10.0, "gaps": 0, "longest_gap": 0.1}},
        "position_sigma": {"median": 0.4, "max": 0.6},
        "settings": {},
    },
}


def coverage_of(base: Coverage | None = None, /, **parts: Any) -> Coverage:
    """Return a usual coverage, or another, with these parts merged into it, level by level."""
    whole = _USUAL if base is None else plain(base)
    return restored({name: _merged(value, plain(parts.get(name, value))) for name, value in whole.items()}, Coverage)


def _merged(old: Any, new: Any) -> Any:
    if not isinstance(old, dict) or not isinstance(new, dict):
        return new
    return old | {key: value if key == "rates" else _merged(old.get(key), value) for key, value in new.items()}
