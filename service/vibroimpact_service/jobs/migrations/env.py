"""Runs the migrations on the connection that `open_database` hands over."""

from __future__ import annotations

from alembic import context

connection = context.config.attributes["connection"]
table = context.config.attributes["table"]
context.configure(connection=connection, render_as_batch=True, version_table=table)
with context.begin_transaction():
    context.run_migrations()
