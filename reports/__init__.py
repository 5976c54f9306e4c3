"""Reports: results as pages, tables and files."""

from reports.folder import write

__all__ = ["write"]
