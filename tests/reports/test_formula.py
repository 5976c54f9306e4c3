"""Transfer functions as MathML."""

import re
from xml.etree import ElementTree

from reports.formula import polynomial, transfer_function


def text_of(markup) -> str:
    return re.sub(r"\s+", "", "".join(ElementTree.fromstring(str(markup)).itertext()))


def test_polynomial_reads_as_on_paper():
    assert text_of(polynomial([0.03763, -0.002489, 0.0, 1.0])) == "0.03763s3−0.002489s2+1.000"


def test_leading_one_is_not_written_before_s_but_alone_it_is():
    assert text_of(polynomial([1.0, 2.0])) == "s+2.000"
    assert text_of(polynomial([1.0])) == "1.000"


def test_small_coefficients_are_powers_of_ten():
    assert text_of(polynomial([-5.883e-6])) == "−5.883×10−6"


def test_all_zero_is_zero():
    assert text_of(polynomial([0.0, 0.0])) == "0"


def test_coefficients_that_the_data_do_not_determine_are_marked():
    markup = str(polynomial([1.0, 2.0, 3.0], [True, False, True]))
    assert markup.count('class="vague"') == 1


def test_names_are_escaped():
    markup = transfer_function("x<script>", "m1", [1.0], [1.0, 2.0])
    assert "<script>" not in str(markup)
    ElementTree.fromstring(str(markup))
