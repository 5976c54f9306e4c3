"""Transfer functions as MathML."""

import re
from xml.etree import ElementTree

from reports.views.formula import polynomial, transfer_function


def text_of(markup) -> str:
    return re.sub(r"\s+", "", "".join(ElementTree.fromstring(str(markup)).itertext()))


def test_polynomial_reads_as_on_paper():
    assert text_of(polynomial([0.03763, -0.002489, 0.0, 1.0])) == "0.03763s3−0.002489s2+1.000"


def test_coefficients_that_the_data_do_not_determine_are_marked():
    markup = polynomial([1.0, 2.347, 3.019, 8.1e-5], [0.0, 1.9, 0.004, None])
    assert str(markup).count('class="vague"') == 2
    # One digit of what is not known; of 3.019 ± 0.004 all four; nothing invented of what has no deviation at all.
    assert text_of(markup) == "s3+2s2+3.019s+8×10−5"


def test_digits_end_where_the_deviation_begins():
    assert text_of(polynomial([123.456, 0.98765, 0.5], [4.0, 0.013, 0.2])) == "123s2+0.988s+0.5"
    assert text_of(polynomial([126.0, 24.3], [None, 30.0])) == "100s+20"


def test_names_are_escaped():
    markup = transfer_function("x<script>", "m1", [1.0], [1.0, 2.0])
    assert "<script>" not in str(markup)
    ElementTree.fromstring(str(markup))
