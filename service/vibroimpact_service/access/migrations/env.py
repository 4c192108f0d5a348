"""Runs the migrations on the connection that `database.migrate` hands over."""

from __future__ import annotations

from alembic import context

connection = context.config.attributes["connection"]
# A line of versions of its own: keys and jobs change independently.
context.configure(
    connection=connection, render_as_batch=True, version_table="alembic_version_access"
)
with context.begin_transaction():
    context.run_migrations()
