"""The service with the stand-in pipeline as a program to be killed: ``python -m tests.api.serving [PORT]``.

Without a port it is a worker. Settings come from the environment.
"""

import sys

from api import Settings, create_app
from api.server import Server
from api.work.jobs import work_until_told
from tests.api import standins

if __name__ == "__main__":
    if len(sys.argv) > 1:
        settings = Settings()
        app = create_app(settings, standins.analyze, preload=())
        Server(app, settings, port=int(sys.argv[1])).run()
    else:
        work_until_told(Settings(), standins.analyze, preload=())
