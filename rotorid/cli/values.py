"""Values of the command line: converted only where they must be, and what is wrong with them in plain words."""

import math
import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import typer
from typer._coercion import RuntimeParam, build_runtime_param

#: What may be asked of a path beyond that it is there, a file or a folder, and readable.
_MORE = ("resolve_path", "writable", "allow_dash")


#: A number as nearly everyone writes it.
_NUMBER = re.compile(r"[+-]?\d+(\.\d*)?([eE][+-]?\d{1,3})?", re.ASCII)


@dataclass(frozen=True)
class AsGiven(RuntimeParam):
    """Conversion that asks Pydantic only where something is to be converted or checked."""

    descriptor: Any = field(default=None)

    @classmethod
    def serve(cls, parameter: Any) -> None:
        """Convert the values of an argument or option of Typer's in this way."""
        described = getattr(parameter, "type_descriptor", None)
        if described is not None and parameter._runtime_param is None:
            parameter._runtime_param = cls(described.parameter_info, described.annotation, described)

    def _coerce_value(self, value: Any, param: Any, ctx: Any) -> Any:
        info, kinds = self.parameter_info, (self.annotation, *get_args(self.annotation))
        checked = info.min is not None or info.max is not None or info.parser is not None
        if type(value) in (str, int, float, bool) and type(value) in kinds and not checked:
            return value
        if float in kinds and type(value) is str and not checked and _NUMBER.fullmatch(value):
            return float(value)
        if list[str] in kinds and isinstance(value, list | tuple) and all(type(text) is str for text in value):
            return list(value)
        if Path in kinds and type(value) is str and not checked and not any(getattr(info, name) for name in _MORE):
            path = Path(value)
            fits = info.file_okay if path.is_file() else info.dir_okay if path.is_dir() else not info.exists
            if fits and (not path.exists() or os.access(path, os.R_OK)):
                return path
        return build_runtime_param(self.descriptor)._coerce_value(value, param, ctx)


def in_words(error: Exception) -> str:
    """Return what is wrong with a value that does not fit its option; empty where the library's own words will do."""
    errors: Any = getattr(error.__cause__, "errors", None)
    if errors is None:
        return ""
    detail = errors()[0]
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


Quantity = float | list[float] | None


def not_negative(value: Quantity) -> Quantity:
    """Check an option or argument, or each of several; for ``callback=``."""
    for number in value if isinstance(value, list) else [] if value is None else [value]:
        if not math.isfinite(number):
            raise typer.BadParameter(f"{number} is not a number that can be measured")
        if number < 0.0:
            raise typer.BadParameter(f"{number:g} is below 0")
    return value
