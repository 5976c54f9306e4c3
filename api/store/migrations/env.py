"""Alembic's entry point: migrations run on the connection that `api.store.database.Database.migrate` hands over."""

from alembic import context

from api.store.records import Record

context.configure(
    connection=context.config.attributes["connection"], target_metadata=Record.metadata, render_as_batch=True
)
context.run_migrations()
