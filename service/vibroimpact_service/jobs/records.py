"""The tables of jobs: their columns, and their rows as values."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Final

import sqlalchemy as sa

metadata = sa.MetaData()

jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("seq", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), primary_key=True),
    sa.Column("id", sa.String(40)),
    sa.Column("owner", sa.String(80)),
    sa.Column("kind", sa.String(40)),
    sa.Column("request", sa.String(64)),
    sa.Column("result", sa.String(64)),
    sa.Column("state", sa.String(12)),
    sa.Column("phase", sa.String(40)),
    sa.Column("priority", sa.Integer),
    sa.Column("seconds", sa.Float),
    sa.Column("done", sa.Integer),
    sa.Column("total", sa.Integer),
    sa.Column("attempts", sa.Integer),
    sa.Column("reused", sa.Boolean),
    sa.Column("created", sa.Float),
    sa.Column("started", sa.Float),
    sa.Column("finished", sa.Float),
    sa.Column("lease_owner", sa.String(64)),
    sa.Column("lease_until", sa.Float),
    sa.Column("version", sa.Integer),
    sa.Column("error", sa.JSON(none_as_null=True)),
    sa.Column("lane", sa.String(8)),
    sa.Column("kept", sa.Integer),
    sa.Column("deadline", sa.Float),
    sa.Column("retry_at", sa.Float),
    sa.Column("note", sa.String(200)),
)

idempotency = sa.Table(
    "idempotency",
    metadata,
    sa.Column("owner", sa.String(80), primary_key=True),
    sa.Column("key", sa.String(255), primary_key=True),
    sa.Column("fingerprint", sa.String(64)),
    sa.Column("job", sa.String(40)),
    sa.Column("created", sa.Float),
)

pins = sa.Table(
    "pins",
    metadata,
    sa.Column("owner", sa.String(80), primary_key=True),
    sa.Column("result", sa.String(64), primary_key=True),
    sa.Column("created", sa.Float),
)

requests = sa.Table(
    "requests",
    metadata,
    sa.Column("name", sa.String(64), primary_key=True),
    sa.Column("data", sa.LargeBinary),
    sa.Column("created", sa.Float),
)

webhooks = sa.Table(
    "webhooks",
    metadata,
    sa.Column("job", sa.String(40), primary_key=True),
    sa.Column("url", sa.String(2000)),
    sa.Column("secret", sa.String(120)),
    sa.Column("attempts", sa.Integer),
    sa.Column("due", sa.Float),
)

FINAL: Final = ("succeeded", "failed", "cancelled")


@dataclass(frozen=True, slots=True)
class JobRow:
    """One row of the table of jobs; times are seconds since 1970 by the database's clock.

    Parameters
    ----------
    version : int
        Grows with every change that a client may care about.
    done, total : int
        Chunks that are there, and chunks altogether.
    kept : int
        Chunks that were there before the job began.
    reused : bool
        Whether the whole result was there already, or was computed for an equal job.
    lane : str
        "quick" jobs go to the workers several at a time, "bulk" ones chunk by chunk.
    retry_at : float, optional
        Not to be tried again before.
    note : str, optional
        Why it has to wait, where the queue itself is not the reason.
    """

    seq: int
    id: str
    owner: str
    kind: str
    request: str
    result: str
    state: str
    phase: str
    priority: int
    seconds: float
    done: int
    total: int
    attempts: int
    reused: bool
    created: float
    started: float | None
    finished: float | None
    lease_owner: str | None
    lease_until: float | None
    version: int
    error: dict[str, Any] | None
    lane: str = "bulk"
    kept: int = 0
    deadline: float | None = None
    retry_at: float | None = None
    note: str | None = None

    @property
    def final(self) -> bool:
        """Whether the state will not change any more."""
        return self.state in FINAL


def row(found: sa.Row[Any] | dict[str, Any]) -> JobRow:
    """Return a selected row of `jobs` as a value."""
    values = found if isinstance(found, dict) else dict(found._mapping)
    if isinstance(values["error"], str):
        values["error"] = json.loads(values["error"])
    return JobRow(**values)
