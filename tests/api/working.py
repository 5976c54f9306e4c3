"""A worker with the stand-in pipeline as a program of its own, ``python -m tests.api.working``, to be killed."""

from api import Settings
from api.work.jobs import work_until_told
from tests.api import standins

if __name__ == "__main__":
    work_until_told(Settings(), standins.analyze, preload=())
