"""The database's tables from version to version, for Alembic."""
