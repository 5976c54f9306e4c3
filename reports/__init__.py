"""Reports: results as pages, tables and files."""

from reports.folder import write
from reports.replay import write_replay

__all__ = ["write", "write_replay"]
