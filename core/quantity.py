"""Numbers for people: with their unit, and with no more digits than their uncertainty or purpose allows."""

import math
from collections.abc import Sequence

#: What stands where a number could not be determined; the reason stands beside it.
NOT_DETERMINED = "not determined"
MINUS = "\N{MINUS SIGN}"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_FIGURE_SPACE = "\N{FIGURE SPACE}"
_POINT_SPACE = "\N{PUNCTUATION SPACE}"


def number(value: float | None, digits: int = 3) -> str:
    """Write a number with so many significant digits; very large and small ones as powers of ten.

    Whole digits before the decimal point are never rounded away below 100 000.
    """
    if value is None or not math.isfinite(value):
        return NOT_DETERMINED
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < 6:
        text = f"{value:.{max(digits - 1 - exponent, 0)}f}"
    else:
        text = f"{value / 10.0**exponent:.{digits - 1}f} × 10{str(exponent).translate(_SUPERSCRIPT)}"
    return text.replace("-", MINUS)


def uncertain(value: float | None, sigma: float | None, unit: str = "") -> str:
    """Write a value with its 1-sigma: ``1.19 ± 0.02 N``; two digits of a sigma that starts with 1, else one.

    Powers of ten are for values from a million on and below 0.0001; a value of ten needs none, however small its sigma.
    """
    tail = f" {unit}" if unit else ""
    if value is None or not math.isfinite(value):
        return NOT_DETERMINED
    if sigma is None or not math.isfinite(sigma) or sigma <= 0.0:
        return number(value) + tail
    exponent = math.floor(math.log10(sigma))
    decimals = -exponent + (1 if round(sigma / 10.0**exponent, 1) < 2.0 else 0)
    magnitude = math.floor(math.log10(max(abs(value), sigma)))
    if -4 <= magnitude < 6:
        places = max(decimals, 0)
        # Adding 0.0 turns a negative zero into zero.
        return f"{round(value, places) + 0.0:.{places}f} ± {sigma:.{places}f}".replace("-", MINUS) + tail
    places = max(decimals + magnitude, 0)
    scale = 10.0**magnitude
    power = f"10{str(magnitude).translate(_SUPERSCRIPT)}"
    return f"({value / scale:.{places}f} ± {sigma / scale:.{places}f}) × {power}".replace("-", MINUS) + tail


def readable(unit: str, value: float) -> str:
    """Return a value as people read it: angles in degrees, parts in per cent."""
    if unit.startswith("part of"):
        return f"{100.0 * value:.0f} % of {unit.removeprefix('part of ')}"
    if unit.startswith("rad"):
        return f"{math.degrees(value):.3g}°{unit.removeprefix('rad')}"
    return f"{value:.3g} {unit}" if unit else f"{value:.3g}"


def column(values: Sequence[float | None], digits: int = 3, places: int = 3) -> list[str]:
    """Write the numbers of a table column so that their decimal points stand below each other when right-aligned.

    No number has more than `places` digits behind the point.
    """
    texts = ["–" if value is None or not math.isfinite(value) else number(value, digits) for value in values]
    texts = [
        f"{value:.{places}f}".replace("-", MINUS)
        if value is not None and len(text.partition(".")[2]) > places
        else text
        for text, value in zip(texts, values, strict=True)
    ]
    decimals = [len(text.partition(".")[2]) for text in texts]
    most = max(decimals, default=0)
    aligned = []
    for text, behind in zip(texts, decimals, strict=True):
        point = _POINT_SPACE if most and not behind else ""
        aligned.append(text + point + _FIGURE_SPACE * (most - behind))
    return aligned


def alike(values: Sequence[float | None]) -> list[str]:
    """Write numbers of one quantity with the decimals that leave the largest three digits, without common zeros."""
    largest = max((abs(value) for value in values if value is not None), default=0.0)
    decimals = max(2 - math.floor(math.log10(largest)), 0) if largest > 0.0 else 0
    known = [round(value, decimals) for value in values if value is not None]
    while decimals and all(round(value, decimals - 1) == value for value in known):
        decimals -= 1
    # Adding 0.0 turns a negative zero into zero.
    return [
        "–" if value is None else f"{round(value, decimals) + 0.0:.{decimals}f}".replace("-", MINUS) for value in values
    ]


def duration(seconds: float | None) -> str:
    """Write a time span: ``48 s``, ``2 min 05 s``, ``1 h 02 min``."""
    if seconds is None or not math.isfinite(seconds):
        return NOT_DETERMINED
    if seconds < 10.0:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 120:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def size(count: int) -> str:
    """Write a number of bytes: ``16 kB``, ``3.1 MB``, ``4 GB``."""
    if count < 1_000_000:
        return f"{max(round(count / 1000), 1)} kB"
    return f"{count / 1e6:.3g} MB" if count < 999.5e6 else f"{count / 1e9:.3g} GB"


def complex_numbers(
    pairs: Sequence[tuple[float, float]], deviations: Sequence[float | None] | None = None
) -> list[tuple[str, bool]]:
    """Write roots given as (real, imaginary): ``−0.21``, and conjugate pairs once, as ``−0.21 ± 0.45 i``.

    Returns
    -------
    list of (str, bool)
        Text, and whether the root is determined: its deviation is below half of its distance from the origin.
    """
    texts = []
    for place, (real, imaginary) in enumerate(pairs):
        deviation = 0.0 if deviations is None else deviations[place]
        size = math.hypot(real, imaginary)
        known = deviation is not None and (deviation < 0.5 * size or deviation == 0.0)

        def part(value: float, known: bool = known, deviation: float | None = deviation) -> str:
            if not known or deviation is None:
                return number(value, 1)
            if deviation > 0.0 and abs(value) > 0.0:
                left = math.floor(math.log10(abs(value))) - math.floor(math.log10(deviation)) + 1
                return number(value, min(max(left, 1), 3))
            return number(value, 3)

        if abs(imaginary) <= 1e-9 * max(abs(real), 1e-9):
            texts.append((part(real), known))
        elif imaginary > 0.0:
            texts.append((f"{part(real)} ± {part(imaginary)} i", known))
    return texts


def per_degree(unit: str) -> tuple[float, str]:
    """Return the factor and the unit in which people read a quantity: degrees for radians, else itself."""
    if unit in ("rad", "rad/s"):
        return 180.0 / math.pi, unit.replace("rad", "°", 1)
    return 1.0, unit.replace("^2", "²").replace("^3", "³")


def with_unit(name: str, unit: str) -> str:
    """Name a quantity with its unit in brackets, unless it is a pure number: ``thrust curve``, ``lag (s)``."""
    bare = unit.partition(",")[0].partition(" (")[0].strip()
    return name if bare in ("", "1") else f"{name} ({bare})"


def counted(count: int, noun: str) -> str:
    """Write a number of things: ``1 flight``, ``12 flights``."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def joined(words: Sequence[str]) -> str:
    """Write words as a list in a sentence: ``x, y and z``; empty for none."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""
