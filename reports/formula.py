"""Transfer functions as formulae in MathML, which browsers draw without any script."""

from collections.abc import Sequence

from markupsafe import Markup, escape

from reports.quantity import MINUS, number


def polynomial(coefficients: Sequence[float], determined: Sequence[bool] | None = None, digits: int = 4) -> Markup:
    """Write a polynomial in s, highest power first; coefficients that the data do not determine in class ``vague``.

    Parameters
    ----------
    coefficients : sequence of float
        Highest power first.
    determined : sequence of bool, optional
        Which coefficients the data determine; all when not given.
    digits : int
        Significant digits; the paper's table A1 has four.
    """
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
        factor = Markup() if abs(value) == 1.0 and power else _number(abs(value), digits)
        term = factor + _power_of_s(power) if power else factor
        if determined is not None and not determined[place]:
            term = Markup('<mrow class="vague">%s</mrow>') % term
        terms.append(term)
    return Markup("<mrow>%s</mrow>") % (Markup().join(terms) or Markup("<mn>0</mn>"))


def transfer_function(
    output: str,
    source: str,
    num: Sequence[float],
    den: Sequence[float],
    num_determined: Sequence[bool] | None = None,
    den_determined: Sequence[bool] | None = None,
) -> Markup:
    """Write ``G_{output,source}(s) = num / den``."""
    name = Markup("<msub><mi>G</mi><mrow><mi>%s</mi><mo>,</mo><mi>%s</mi></mrow></msub>") % (output, source)
    fraction = Markup("<mfrac>%s%s</mfrac>") % (polynomial(num, num_determined), polynomial(den, den_determined))
    return Markup(
        '<math display="block"><mrow>%s<mo stretchy="false">(</mo><mi>s</mi><mo stretchy="false">)</mo>'
        "<mo>=</mo>%s</mrow></math>"
    ) % (name, fraction)


def _number(value: float, digits: int) -> Markup:
    mantissa, times, power = number(value, digits).partition(" × 10")
    if not times:
        return Markup("<mn>%s</mn>") % mantissa
    exponent = power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", f"{MINUS}0123456789"))
    return Markup("<mn>%s</mn><mo>×</mo><msup><mn>10</mn><mn>%s</mn></msup>") % (mantissa, escape(exponent))


def _power_of_s(power: int) -> Markup:
    return Markup("<mi>s</mi>") if power == 1 else Markup("<msup><mi>s</mi><mn>%s</mn></msup>") % power
