"""A service with the stand-in pipeline as a program of its own, ``python -m tests.api.serving PORT``, to be killed."""

import sys

import uvicorn

from api import Settings, create_app
from api.server import Server
from api.web.connections import PatientProtocol
from tests.api import standins


def main() -> None:
    """Serve on the port given, with settings from the environment."""
    app = create_app(Settings(), standins.analyze, preload=())
    config = uvicorn.Config(
        app, port=int(sys.argv[1]), log_level="warning", http=PatientProtocol, timeout_graceful_shutdown=5
    )
    Server(config, app.state.parts.runner).run()


if __name__ == "__main__":
    main()
