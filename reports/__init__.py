"""Reports: results as pages, tables and files."""
