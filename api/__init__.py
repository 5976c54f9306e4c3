"""The web service: uploads in, models and reports out."""

from api.app import create_app
from api.server import serve, work
from api.settings import Settings

__all__ = ["Settings", "create_app", "serve", "work"]
