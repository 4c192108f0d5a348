"""What jobs are charged to, and what is held for them."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    """Add the columns."""
    op.add_column("jobs", sa.Column("account", sa.String(80)))
    op.add_column("jobs", sa.Column("held", sa.Float, nullable=False, server_default="0"))
