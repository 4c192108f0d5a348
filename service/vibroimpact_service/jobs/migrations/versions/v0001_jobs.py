"""The tables of jobs, of idempotency keys and of pinned results."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Create the tables."""
    op.create_table(
        "jobs",
        sa.Column(
            "seq",
            sa.BigInteger().with_variant(sa.Integer(), "sqlite"),
            primary_key=True,
            autoincrement=True,
        ),
        sa.Column("id", sa.String(40), nullable=False, unique=True),
        sa.Column("owner", sa.String(80), nullable=False),
        sa.Column("kind", sa.String(40), nullable=False),
        sa.Column("request", sa.String(64), nullable=False),
        sa.Column("result", sa.String(64), nullable=False),
        sa.Column("state", sa.String(12), nullable=False),
        sa.Column("phase", sa.String(40), nullable=False),
        sa.Column("priority", sa.Integer, nullable=False),
        sa.Column("seconds", sa.Float, nullable=False),
        sa.Column("done", sa.Integer, nullable=False),
        sa.Column("total", sa.Integer, nullable=False),
        sa.Column("attempts", sa.Integer, nullable=False),
        sa.Column("reused", sa.Boolean, nullable=False),
        sa.Column("created", sa.Float, nullable=False),
        sa.Column("started", sa.Float),
        sa.Column("finished", sa.Float),
        sa.Column("lease_owner", sa.String(64)),
        sa.Column("lease_until", sa.Float),
        sa.Column("version", sa.Integer, nullable=False),
        sa.Column("error", sa.JSON),
        sa.Column("lane", sa.String(8), nullable=False),
        sa.Column("kept", sa.Integer, nullable=False),
        sa.Column("deadline", sa.Float),
        sa.Column("retry_at", sa.Float),
        sa.Column("note", sa.String(200)),
    )
    op.create_index("jobs_by_owner", "jobs", ["owner", "seq"])
    op.create_index("jobs_by_owner_state", "jobs", ["owner", "state", "seq"])
    _partial("jobs_to_claim", ["lane", "owner", sa.text("priority DESC"), "seq"], "queued")
    _partial("jobs_in_line", [sa.text("priority DESC"), "seq"], "queued")
    _partial("jobs_alike", ["result"], "queued")
    _partial("jobs_leased", ["lease_until"], "running")
    # No two replicas can compute the same result at once.
    _partial("jobs_computing", ["result"], "running", unique=True)
    op.create_index("jobs_by_end", "jobs", ["finished"])
    op.create_index("jobs_by_request", "jobs", ["request"])
    op.create_table(
        "idempotency",
        sa.Column("owner", sa.String(80), primary_key=True),
        sa.Column("key", sa.String(255), primary_key=True),
        sa.Column("fingerprint", sa.String(64), nullable=False),
        sa.Column("job", sa.String(40)),
        sa.Column("created", sa.Float, nullable=False),
    )
    op.create_table(
        "pins",
        sa.Column("owner", sa.String(80), primary_key=True),
        sa.Column("result", sa.String(64), primary_key=True),
        sa.Column("created", sa.Float, nullable=False),
    )


def _partial(
    name: str, columns: list[str | sa.TextClause], state: str, unique: bool = False
) -> None:
    where = sa.text(f"state = '{state}'")
    op.create_index(
        name, "jobs", columns, unique=unique, sqlite_where=where, postgresql_where=where
    )
