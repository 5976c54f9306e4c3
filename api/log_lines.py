"""What the service writes about what it does: lines for people, or JSON for programs."""

import copy
import json
import logging
import logging.config
import re
from datetime import UTC, datetime
from typing import Any

from uvicorn.config import LOGGING_CONFIG

from api.settings import LogFormat

#: Secrets that are parts of addresses: who reads the log of requests must not be able to use them.
_SECRET = re.compile(r"(/(?:shared|reports)/)[^/?\s]+")


class JsonLines(logging.Formatter):
    """Writes every record as a JSON object on a line of its own."""

    def format(self, record: logging.LogRecord) -> str:
        """Write a record."""
        line: dict[str, Any] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.name == "uvicorn.access" and isinstance(record.args, tuple) and len(record.args) == 5:
            line |= zip(("client", "method", "path", "http_version", "status"), record.args, strict=True)
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class HideSecrets(logging.Filter):
    """Takes the secrets of shared links out of the lines about requests."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Change a record where it has to be; none is dropped."""
        if isinstance(record.args, tuple):
            record.args = tuple(
                _SECRET.sub(r"\1...", value) if isinstance(value, str) else value for value in record.args
            )
        return True


def configure(form: LogFormat) -> None:
    """Write our messages as uvicorn writes its own, to stderr; a line for each request goes to stdout."""
    config = copy.deepcopy(LOGGING_CONFIG)
    config["loggers"]["rotorid"] = {"handlers": ["default"], "level": "INFO", "propagate": False}
    config["filters"] = {"secrets": {"()": HideSecrets}}
    config["handlers"]["access"]["filters"] = ["secrets"]
    config["root"] = {"handlers": ["default"], "level": "WARNING"}
    if form is LogFormat.JSON:
        config["formatters"] = {name: {"()": JsonLines} for name in config["formatters"]}
    logging.config.dictConfig(config)
