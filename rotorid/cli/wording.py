"""Wrong values on the command line, said in plain words: the libraries below speak of their own types."""

import re
from typing import Any


def in_words(error: Exception) -> str:
    """Return what is wrong with a value that does not fit its option; empty where the library's own words will do.

    Parameters
    ----------
    error : Exception
        As Typer raises it, with the validation error of Pydantic as its cause.
    """
    found: Any = getattr(error.__cause__, "errors", None)
    if found is None:
        return ""
    detail = found()[0]
    value, limits = str(detail.get("input", "")), detail.get("ctx", {})
    match detail["type"]:
        case "float_parsing" | "float_type" | "int_parsing" | "int_type" | "int_from_float":
            whole = "a whole number" if detail["type"].startswith("int") else "a number"
            unit = re.match(r"\s*([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)\s*([^\d\s.,].*)$", value)
            if unit:
                number = unit[1].replace(",", ".")
                return f"{value!r} is not {whole}: leave {unit[2].strip()!r} out ({number}); the help names the unit."
            if re.fullmatch(r"\s*[-+]?\d+,\d+\s*", value):
                return f"{value!r} is not {whole}: write it with a point ({value.replace(',', '.').strip()})."
            return f"{value!r} is not {whole}."
        case "greater_than_equal":
            return f"{value} is too small: choose {limits['ge']:g} or more."
        case "less_than_equal":
            return f"{value} is too large: choose {limits['le']:g} or less."
        case "finite_number":
            return f"{value} is not a number that can be measured."
    return ""
