"""Starting the service."""

import copy
import logging
from typing import Any

import uvicorn
from uvicorn.config import LOGGING_CONFIG

from api.app import create_app
from api.settings import Settings

#: Seconds that requests still being answered get when the service is told to stop.
_GRACE = 5

_log = logging.getLogger("rotorid.api")


def serve(host: str = "127.0.0.1", port: int = 8000) -> None:
    """Run the service until it is told to stop (Ctrl-C, SIGTERM); its other settings come from the environment.

    Exits with a status other than 0 when the address is taken or the data folder cannot be written.
    """
    settings = Settings()
    uvicorn.run(
        create_app(settings),
        host=host,
        port=port,
        log_config=_logging(),
        server_header=False,
        timeout_graceful_shutdown=_GRACE,
    )


def _logging() -> dict[str, Any]:
    """Add our messages to uvicorn's own."""
    config = copy.deepcopy(LOGGING_CONFIG)
    config["loggers"]["rotorid"] = {"handlers": ["default"], "level": "INFO", "propagate": False}
    return config
