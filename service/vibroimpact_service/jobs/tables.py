"""The database tables of jobs: their columns, and rows of `jobs` as values."""

from __future__ import annotations

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
    # The columns of claims and queues keep the names that the first version stored.
    sa.Column("lease_owner", sa.String(64), key="claim_owner"),
    sa.Column("lease_until", sa.Float, key="claim_until"),
    sa.Column("version", sa.Integer),
    sa.Column("error", sa.JSON(none_as_null=True)),
    sa.Column("lane", sa.String(8), key="queue"),
    sa.Column("kept", sa.Integer),
    sa.Column("deadline", sa.Float),
    sa.Column("retry_at", sa.Float),
    sa.Column("note", sa.String(200), key="waiting_note"),
    sa.Column("trace", sa.String(64)),
    sa.Column("account", sa.String(80)),
    sa.Column("held", sa.Float),
    sa.Column("name", sa.String(120)),
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

# Results that retention leaves alone; rows that earlier versions wrote.
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

attempts = sa.Table(
    "attempts",
    metadata,
    sa.Column("seq", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), primary_key=True),
    sa.Column("job", sa.String(40)),
    sa.Column("worker", sa.String(120)),
    sa.Column("began", sa.Float),
    sa.Column("ended", sa.Float),
    sa.Column("why", sa.String(200)),
)

# Written to where a process must know that it can write.
processes = sa.Table(
    "processes",
    metadata,
    sa.Column("name", sa.String(64), primary_key=True),
    sa.Column("seen", sa.Float),
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
        Number of chunks that are stored, and number of all chunks.
    kept : int
        Number of chunks that were stored before the job began.
    reused : bool
        Whether the whole result was stored already, or was computed for an equal job.
    claim_owner : str, optional
        The service process that runs the job.
    claim_until : float, optional
        When its claim expires, unless it is renewed.
    queue : {"quick", "bulk"}
        Quick jobs are sent to the workers several at a time, bulk ones in batches of chunks.
    retry_at : float, optional
        The job is not tried again before.
    waiting_note : str, optional
        Why the job waits, where other jobs are not the reason.
    trace : str, optional
        Context of the span of the request that submitted it.
    account : str, optional
        What its processor time is charged to; absent: nobody.
    held : float
        What is charged to the account until it ends, seconds.
    name : str, optional
        What its owner calls it.
    taken_over : bool
        Whether it was claimed because the claim of another process had expired; no column.
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
    claim_owner: str | None
    claim_until: float | None
    version: int
    error: dict[str, Any] | None
    queue: str = "bulk"
    kept: int = 0
    deadline: float | None = None
    retry_at: float | None = None
    waiting_note: str | None = None
    trace: str | None = None
    account: str | None = None
    held: float = 0.0
    name: str | None = None
    taken_over: bool = False

    @property
    def final(self) -> bool:
        """Whether the state will not change any more."""
        return self.state in FINAL


def row(selected: sa.Row[Any]) -> JobRow:
    """Return a selected row as a value; it begins with all columns of `jobs`, in their order."""
    return JobRow(*selected[: len(jobs.c)])
