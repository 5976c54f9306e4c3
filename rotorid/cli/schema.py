"""``rotorid schema``: what report.json and models.json hold, and which findings there are."""

from enum import StrEnum
from typing import Annotated

import typer


class Subject(StrEnum):
    """What can be described."""

    REPORT = "report"
    MODELS = "models"
    FINDINGS = "findings"


def schema(
    subject: Annotated[Subject, typer.Argument(help="report.json, models.json, or the catalogue of findings.")] = (
        Subject.REPORT
    ),
) -> None:
    """Write to stdout the JSON Schema (2020-12) of a file that `rotorid analyze` writes, or docs/findings.md.

    Example: rotorid schema models > models.schema.json
    """
    from core.catalogue import read_catalogue
    from core.serialization import as_json
    from reports.numbers.schema import schema as schema_of

    typer.echo(
        read_catalogue().as_markdown() if subject == Subject.FINDINGS else as_json(schema_of(subject.value)), nl=False
    )
