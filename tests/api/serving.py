"""A service with the stand-in pipeline as a program of its own, ``python -m tests.api.serving PORT``, to be killed."""

import sys

from api import Settings, create_app
from api.server import Server
from tests.api import standins


def main() -> None:
    """Serve on the port given, with settings from the environment."""
    settings = Settings()
    app = create_app(settings, standins.analyze, preload=())
    Server(app, settings, port=int(sys.argv[1])).run()


if __name__ == "__main__":
    main()
