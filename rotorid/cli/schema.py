"""``rotorid schema``: what report.json and models.json hold."""

from enum import StrEnum
from typing import Annotated

import typer


class File(StrEnum):
    """Files that have a schema."""

    REPORT = "report"
    MODELS = "models"


def schema(file: Annotated[File, typer.Argument(help="Of report.json or of models.json.")] = File.REPORT) -> None:
    """Write the JSON Schema (2020-12) of a file that `rotorid analyze` writes to stdout.

    Example: rotorid schema models > models.schema.json
    """
    from logparse.serialization import as_json
    from reports.schema import schema as schema_of

    typer.echo(as_json(schema_of(file.value)), nl=False)
