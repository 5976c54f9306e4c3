"""The web service: uploads in, models and reports out."""

from api.app import create_app
from api.server import backup, restore, serve, work
from api.settings import Settings

__all__ = ["Settings", "backup", "create_app", "restore", "serve", "work"]
