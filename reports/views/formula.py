"""Transfer functions as formulae in MathML, which browsers draw without any script."""

import math
from collections.abc import Sequence

from markupsafe import Markup, escape

from core.quantity import MINUS, number
from sysid.transfer_functions.transfer_function import DETERMINED

#: Significant digits at most; the paper's table A1 has four.
MOST_DIGITS = 4


def polynomial(coefficients: Sequence[float], deviations: Sequence[float | None] | None = None) -> Markup:
    """Write a polynomial in s, highest power first; coefficients that the data do not determine in class ``vague``."""
    terms: list[Markup] = []
    last = len(coefficients) - 1
    for place, value in enumerate(coefficients):
        power = last - place
        if value == 0.0 and last > 0:
            continue
        if terms:
            terms.append(Markup("<mo>%s</mo>") % (MINUS if value < 0.0 else "+"))
        elif value < 0.0:
            terms.append(Markup('<mo form="prefix">%s</mo>') % MINUS)
        deviation = 0.0 if deviations is None else deviations[place]
        known = deviation is not None and deviation < DETERMINED * abs(value)
        factor = Markup() if abs(value) == 1.0 and power else _number(abs(value), _digits(value, deviation))
        term = factor + _power_of_s(power) if power else factor
        if not known and value:
            term = Markup('<mrow class="vague">%s</mrow>') % term
        terms.append(term)
    return Markup("<mrow>%s</mrow>") % (Markup().join(terms) or Markup("<mn>0</mn>"))


def _digits(value: float, deviation: float | None) -> int:
    """Significant digits that a standard deviation leaves, at most `MOST_DIGITS`."""
    if deviation is None or not deviation < DETERMINED * abs(value):
        return 1
    if deviation <= 0.0:
        return MOST_DIGITS
    exponent = math.floor(math.log10(deviation))
    last = exponent - (1 if deviation < 2.0 * 10.0**exponent else 0)
    return min(max(math.floor(math.log10(abs(value))) - last + 1, 1), MOST_DIGITS)


def transfer_function(
    output: str,
    source: str,
    num: Sequence[float],
    den: Sequence[float],
    num_std: Sequence[float | None] | None = None,
    den_std: Sequence[float | None] | None = None,
) -> Markup:
    """Write ``G_{output,source}(s) = num / den``."""
    name = Markup("<msub><mi>G</mi><mrow><mi>%s</mi><mo>,</mo><mi>%s</mi></mrow></msub>") % (output, source)
    fraction = Markup("<mfrac>%s%s</mfrac>") % (polynomial(num, num_std), polynomial(den, den_std))
    return Markup(
        '<math display="block"><mrow>%s<mo stretchy="false">(</mo><mi>s</mi><mo stretchy="false">)</mo>'
        "<mo>=</mo>%s</mrow></math>"
    ) % (name, fraction)


def _number(value: float, digits: int) -> Markup:
    # Rounded first: whole digits, too, are false where the deviation is larger.
    mantissa, times, power = number(float(f"{value:.{digits - 1}e}"), digits).partition(" × 10")
    if not times:
        return Markup("<mn>%s</mn>") % mantissa
    exponent = power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", f"{MINUS}0123456789"))
    return Markup("<mn>%s</mn><mo>×</mo><msup><mn>10</mn><mn>%s</mn></msup>") % (mantissa, escape(exponent))


def _power_of_s(power: int) -> Markup:
    return Markup("<mi>s</mi>") if power == 1 else Markup("<msup><mi>s</mi><mn>%s</mn></msup>") % power
