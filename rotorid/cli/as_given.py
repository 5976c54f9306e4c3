"""Values of the command line that are already what a command asks for.

Typer converts every value by Pydantic, strings to strings and defaults to themselves; to import that takes as long as
to read a log.
"""

import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

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
        if list[str] in kinds and isinstance(value, list | tuple) and all(type(each) is str for each in value):
            return list(value)
        if Path in kinds and type(value) is str and not checked and not any(getattr(info, name) for name in _MORE):
            path = Path(value)
            fits = info.file_okay if path.is_file() else info.dir_okay if path.is_dir() else not info.exists
            if fits and (not path.exists() or os.access(path, os.R_OK)):
                return path
        return build_runtime_param(self.descriptor)._coerce_value(value, param, ctx)
