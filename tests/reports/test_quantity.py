"""Numbers as people read them, and transfer functions as MathML."""

import math
import re
from xml.etree import ElementTree

import pytest

from core.quantity import (
    NOT_DETERMINED,
    alike,
    column,
    complex_numbers,
    number,
    per_degree,
    uncertain,
    with_unit,
)
from reports.views.formula import polynomial, transfer_function


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 3, "0"),
        (-12.345, 3, "−12.3"),
        (9.999, 3, "10.0"),
        (1234.5, 3, "1234"),
        (1.105e-5, 4, "1.105 × 10⁻⁵"),
        (-2.5e7, 2, "−2.5 × 10⁷"),
        (math.nan, 3, NOT_DETERMINED),
        (None, 3, NOT_DETERMINED),
    ],
)
def test_number_has_the_digits_asked_for(value, digits, text):
    assert number(value, digits) == text


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (1.1934, 0.0213, "1.19 ± 0.02 N"),
        (-0.5, 2.0, "0 ± 2 N"),
        (123.4, 31.0, "123 ± 31 N"),
        (1.105e-5, 2.1e-7, "(1.10 ± 0.02) × 10⁻⁵ N"),
        (0.0123, 0.0005, "0.0123 ± 0.0005 N"),
        (3.5, None, "3.50 N"),
        (None, 0.1, NOT_DETERMINED),
    ],
)
def test_uncertain_values_have_no_more_digits_than_their_sigma(value, sigma, text):
    assert uncertain(value, sigma, "N") == text


def test_columns_align_at_the_decimal_point():
    cells = column([0.0193, 12.34, 251.0, None, 1.5])
    assert cells[0] == "0.019"
    assert cells[1].rstrip("\N{FIGURE SPACE}") == "12.3"
    assert cells[2].rstrip("\N{FIGURE SPACE}\N{PUNCTUATION SPACE}") == "251"
    behind = {len(cell.lstrip("0123456789–")) for cell in cells}
    assert behind == {len(".019")}, "as many places behind the last whole digit in every cell"


def test_conjugate_poles_are_written_once():
    pairs = [(-0.21, 0.45), (-0.21, -0.45), (-3.0, 0.0)]
    assert complex_numbers(pairs) == [("−0.210 ± 0.450 i", True), ("−3.00", True)]
    # Digits end where the deviation begins, and of what is not determined one is left.
    assert complex_numbers(pairs, [0.02, 0.02, None]) == [("−0.21 ± 0.45 i", True), ("−3", False)]


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ([0.0035, 0.0173, 3.99], ["0.00", "0.02", "3.99"]),
        ([-2.0, 2.5], ["−2.0", "2.5"]),
        ([-0.001, 12.34, None], ["0.0", "12.3", "–"]),
    ],
)
def test_numbers_of_one_quantity_have_the_same_decimals(values, texts):
    assert alike(values) == texts


def test_angles_are_read_in_degrees_but_not_accelerations_and_pure_numbers_have_no_unit():
    assert per_degree("rad/s") == (pytest.approx(180.0 / math.pi), "°/s")
    assert per_degree("rad/s^2 per unit") == (1.0, "rad/s² per unit")
    for unit, text in (("m/s^2, one motor at full command", "k (m/s²)"), ("1 (MOT_THST_EXPO)", "k")):
        assert with_unit("k", per_degree(unit)[1]) == text


def text_of(markup) -> str:
    return re.sub(r"\s+", "", "".join(ElementTree.fromstring(str(markup)).itertext()))


def test_coefficients_that_the_data_do_not_determine_are_marked():
    markup = polynomial([1.0, 2.347, 3.019, 8.1e-5], [0.0, 1.9, 0.004, None])
    assert str(markup).count('class="vague"') == 2
    # One digit of what is not known; of 3.019 ± 0.004 all four; nothing invented of what has no deviation at all.
    assert text_of(markup) == "s3+2s2+3.019s+8×10−5"


def test_digits_end_where_the_deviation_begins():
    assert text_of(polynomial([123.456, 0.98765, 0.5], [4.0, 0.013, 0.2])) == "123s2+0.988s+0.5"
    assert text_of(polynomial([126.0, 0.0, 24.3], [None, 0.0, 30.0])) == "100s2+20"


def test_names_are_escaped():
    markup = transfer_function("x<script>", "m1", [1.0], [1.0, 2.0])
    assert "<script>" not in str(markup)
    ElementTree.fromstring(str(markup))
