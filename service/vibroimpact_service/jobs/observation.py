"""What is to be known of a job queue at a moment: waiting jobs, room in the store, certificates."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import sqlalchemy as sa
import structlog
from sqlalchemy.engine import Connection

from vibroimpact_service.jobs import certificates
from vibroimpact_service.jobs.control import HELD
from vibroimpact_service.jobs.database import now
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.jobs.records import QUEUED, RUNNING
from vibroimpact_service.jobs.tables import jobs
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Room, Store

log = structlog.get_logger("vibroimpact.jobs")

_FRESH_SECONDS: Final = 5.0
"""Age from which an observation is replaced: with 100,000 jobs, the records need 0.1 s for it."""
_STALE_SECONDS: Final = 60.0
"""Age from which an observation is not told any more."""
_LIMIT_SECONDS: Final = 2.0
"""Time for which one is waited for."""


class Backlog(NamedTuple):
    """Unfinished jobs of one kind and owner in one state.

    Parameters
    ----------
    kind, owner : str
    state : {"queued", "held", "running"}
    jobs : int
        Their number.
    oldest : float
        Seconds since the first of them was submitted.
    """

    kind: str
    owner: str
    state: str
    jobs: int
    oldest: float


class Observation(NamedTuple):
    """The state of a queue.

    Parameters
    ----------
    backlog : sequence of Backlog, optional
        Absent where the records cannot be read.
    room : Room, optional
        Of the disk of the store, where that is a folder that can be read.
    expiry : mapping
        Certificate (``"ca"``, ``"cert"``) -> when it expires, seconds since 1970.
    """

    backlog: Sequence[Backlog] | None = None
    room: Room | None = None
    expiry: Mapping[str, float] = {}


class Observer:
    """Observes a queue, once for all who ask within some seconds.

    Who asks gets the last observation, and has it replaced; only where there is none yet, or an
    old one, is a new one waited for.
    """

    def __init__(self, settings: Settings, access: RecordAccess, store: Store) -> None:
        self._settings, self._access, self._store = settings, access, store
        self._observing: asyncio.Task[None] | None = None
        self._last, self._at = Observation(), float("-inf")

    async def state(self) -> Observation:
        """Return the state of the queue, or nothing where it cannot be told in time."""
        task, age = self._observing, time.monotonic() - self._at
        if age > _FRESH_SECONDS and (task is None or task.done()):
            task = self._observing = asyncio.create_task(self._observe())
        if age > _STALE_SECONDS and task is not None:
            done, _ = await asyncio.wait([task], timeout=_LIMIT_SECONDS)
            return self._last if done else Observation()
        return self._last

    def close(self) -> None:
        """Observe no more."""
        if self._observing is not None:
            self._observing.cancel()

    async def _observe(self) -> None:
        try:
            counted = await self._access.read(backlog)
        except Exception as error:
            log.warning("waiting jobs cannot be counted", error=str(error))
            counted = None
        room, expiry = await asyncio.to_thread(self._surroundings)
        self._last, self._at = Observation(counted, room, expiry), time.monotonic()

    def _surroundings(self) -> tuple[Room | None, dict[str, float]]:
        room, expiry = None, {}
        try:
            room = self._store.results.room()
        except Exception as error:
            log.warning("the store cannot be looked at", error=str(error))
        try:
            expiry = certificates.expiry(self._settings)
        except Exception as error:
            log.warning("the certificates cannot be read", error=str(error))
        return room, expiry


def backlog(connection: Connection) -> list[Backlog]:
    """Return the unfinished jobs by kind, owner and state."""
    state = sa.case((QUEUED & (jobs.c.phase == HELD), HELD), else_=jobs.c.state)
    columns = jobs.c.kind, jobs.c.owner, state.label("how")
    oldest = now(connection) - sa.func.min(jobs.c.created)
    query = sa.select(*columns, sa.func.count(), oldest).where(QUEUED | RUNNING)
    grouped = connection.execute(query.group_by(jobs.c.kind, jobs.c.owner, sa.text("how")))
    return [Backlog(*each) for each in grouped]
