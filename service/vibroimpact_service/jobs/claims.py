"""Operations on claimed job records: claim, renew, report, put back, end, cancel.

A claim is a service process's right to run a job. It expires unless it is renewed, and is lost
where somebody ends the job. Every write is fenced: it changes only jobs whose claim the process
still holds, and returns which these were.
"""

from __future__ import annotations

import random
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import sqlalchemy as sa
from sqlalchemy.engine import Connection
from sqlalchemy.exc import IntegrityError

from vibroimpact_service.jobs import attempts
from vibroimpact_service.jobs.database import now
from vibroimpact_service.jobs.records import QUEUED, RUNNING, find
from vibroimpact_service.jobs.tables import JobRow, jobs, row

CLAIM_SECONDS: Final = 8.0
_UNCLAIMED: Final[dict[str, Any]] = {"claim_owner": None, "claim_until": None}
QUEUED_AGAIN: Final[dict[str, Any]] = {"state": "queued", "phase": "waiting", **_UNCLAIMED}


def claimable(connection: Connection) -> bool:
    """Whether there may be a job to claim; much cheaper than `claim` where there is none.

    It is not checked whether the result of a queued job is being computed for another job.
    """
    clock = now(connection)
    expired = sa.exists().where(RUNNING, jobs.c.claim_until < clock)
    due = sa.exists().where(QUEUED, _due(clock))
    return bool(connection.execute(sa.select(expired | due)).scalar_one())


def _due(clock: sa.ColumnElement[float]) -> sa.ColumnElement[bool]:
    return jobs.c.retry_at.is_(None) | (jobs.c.retry_at <= clock)


def overdue(connection: Connection) -> bool:
    """Whether there is a job whose deadline has passed."""
    late = sa.exists().where(QUEUED | RUNNING, jobs.c.deadline < now(connection))
    return bool(connection.execute(sa.select(late)).scalar_one())


def claim(
    connection: Connection, claim_owner: str, queue: str, room: int, seconds: float
) -> list[JobRow]:
    """Claim jobs of a queue that wait or whose claim has expired.

    Owners with fewer running jobs go first; among the jobs of one owner, priority, then age.
    A job whose result is being computed for another job waits for that.

    Parameters
    ----------
    claim_owner : str
        Name of this process.
    queue : {"quick", "bulk"}
    room : int
        Maximum number of jobs.
    seconds : float
        Planned work beyond which no more jobs are claimed.
    """
    chosen: list[JobRow] = []
    results: set[str] = set()
    planned = 0.0
    for job in _candidates(connection, queue, room):
        if len(chosen) == room or (chosen and planned >= seconds):
            break
        if job.result not in results:
            results.add(job.result)
            chosen.append(job)
            planned += job.seconds
    return _claim(connection, claim_owner, chosen)


def _candidates(connection: Connection, queue: str, room: int) -> list[JobRow]:
    """Return jobs that can be claimed, in the order in which they should be."""
    clock = now(connection)
    expired = RUNNING & (jobs.c.claim_until < clock) & (jobs.c.queue == queue)
    candidates = _locked(connection, jobs.select().where(expired).order_by(jobs.c.seq), room)
    other = jobs.alias()
    computing = sa.exists().where(
        (other.c.result == jobs.c.result) & (other.c.state == sa.literal_column("'running'"))
    )
    waiting = jobs.select().where(QUEUED, jobs.c.queue == queue, _due(clock), ~computing)
    running = _running_jobs(connection)
    owners = _owners(connection, queue)
    random.shuffle(owners)  # owners with the same number of running jobs take turns
    first: dict[str, list[JobRow]] = {}
    for owner in sorted(owners, key=lambda o: running.get(o, 0))[:room]:
        own = waiting.where(jobs.c.owner == owner)
        first[owner] = _locked(connection, own.order_by(jobs.c.priority.desc(), jobs.c.seq), room)
    while len(candidates) < room and any(first.values()):
        owner = min((o for o in first if first[o]), key=lambda o: running.get(o, 0))
        candidates.append(first[owner].pop(0))
        running[owner] = running.get(owner, 0) + 1
    return candidates


def ahead(connection: Connection, asked: Sequence[JobRow]) -> dict[str, int]:
    """Return how many queued jobs `claim` takes before each of some queued jobs.

    Owners take turns: the n-th job of one comes before the job of another that then has more than
    n jobs, running ones included. With as many, chance decides, and it does not count.
    """
    running, before = _running_jobs(connection), _before_own(connection, asked)
    due = _due(now(connection))
    count = sa.func.count().label("jobs")
    queue = jobs.c.queue.label("queue")
    query = sa.select(queue, jobs.c.owner, count).where(QUEUED, due)
    waiting = connection.execute(query.group_by(jobs.c.queue, jobs.c.owner)).all()
    positions = {}
    for job in asked:
        turn = running.get(job.owner, 0) + before[job.id]
        others = (
            min(each.jobs, max(0, turn - running.get(each.owner, 0)))
            for each in waiting
            if each.queue == job.queue and each.owner != job.owner
        )
        positions[job.id] = before[job.id] + sum(others)
    return positions


def _before_own(connection: Connection, asked: Sequence[JobRow]) -> dict[str, int]:
    """Return how many queued jobs of the same owner and queue come before each of some jobs.

    The records between neighbouring jobs are counted once, so that a page of jobs costs no more
    than its last job.
    """
    before, due = {}, _due(now(connection))
    for queue, owner, priority in {(job.queue, job.owner, job.priority) for job in asked}:
        alike = QUEUED & due & (jobs.c.queue == queue) & (jobs.c.owner == owner)
        count, last = _count(connection, alike & (jobs.c.priority > priority)), 0
        for job in sorted(asked, key=lambda job: job.seq):
            if (job.queue, job.owner, job.priority) == (queue, owner, priority):
                between = (jobs.c.seq >= last) & (jobs.c.seq < job.seq)
                count += _count(connection, alike & (jobs.c.priority == priority) & between)
                before[job.id], last = count, job.seq
    return before


def _count(connection: Connection, where: sa.ColumnElement[bool]) -> int:
    query = sa.select(sa.func.count()).select_from(jobs).where(where)
    return int(connection.execute(query).scalar_one())


def _locked(connection: Connection, query: sa.Select[Any], limit: int) -> list[JobRow]:
    rows = connection.execute(query.limit(limit).with_for_update(skip_locked=True))
    return [row(each) for each in rows.all()]


def _running_jobs(connection: Connection) -> dict[str, int]:
    """Return how many jobs of each owner are running, in whichever process."""
    count = sa.func.count().label("running")
    query = sa.select(jobs.c.owner, count).where(RUNNING).group_by(jobs.c.owner)
    return {each.owner: each.running for each in connection.execute(query)}


def _owners(connection: Connection, queue: str) -> list[str]:
    """Return the owners of queued jobs, by jumps from one to the next in the index."""
    in_queue = QUEUED, jobs.c.queue == queue
    first = sa.select(sa.func.min(jobs.c.owner).label("owner")).where(*in_queue)
    owners = first.cte("owners", recursive=True)
    following = (
        sa.select(sa.func.min(jobs.c.owner))
        .where(*in_queue, jobs.c.owner > owners.c.owner)
        .correlate(owners)
        .scalar_subquery()
    )
    owners = owners.union_all(sa.select(following).where(owners.c.owner.is_not(None)))
    query = sa.select(owners.c.owner).where(owners.c.owner.is_not(None))
    return list(connection.execute(query).scalars())


def _claim(connection: Connection, claim_owner: str, chosen: Sequence[JobRow]) -> list[JobRow]:
    """Claim the jobs, apart from those whose result another replica began to compute meanwhile."""
    if not chosen:
        return []
    clock = now(connection)
    update = change(
        jobs.c.id.in_([job.id for job in chosen]),
        state="running",
        phase="starting",
        waiting_note=None,
        retry_at=None,
        attempts=jobs.c.attempts + 1,
        started=sa.func.coalesce(jobs.c.started, clock),
        claim_owner=claim_owner,
        claim_until=clock + CLAIM_SECONDS,
    ).returning(*jobs.c)
    try:
        with connection.begin_nested():
            claimed = {each.id: row(each) for each in connection.execute(update).all()}
    except IntegrityError:
        if len(chosen) == 1:
            return []
        return [job for one in chosen for job in _claim(connection, claim_owner, [one])]
    if claimed:
        attempts.begin(connection, list(claimed), claim_owner)
    return [
        replace(claimed[job.id], taken_over=True) if job.state == "running" else claimed[job.id]
        for job in chosen
        if job.id in claimed
    ]


def change(where: sa.ColumnElement[bool], **values: Any) -> sa.Update:
    """Return an update that counts as a new version of the jobs."""
    return jobs.update().where(where).values(version=jobs.c.version + 1, **values)


def renew(connection: Connection, claim_owner: str, held: Collection[str]) -> set[str]:
    """Renew the claims of jobs; return the jobs whose claim is still held."""
    until = now(connection) + CLAIM_SECONDS
    update = jobs.update().where(_claimed(claim_owner, held)).values(claim_until=until)
    return set(connection.execute(update.returning(jobs.c.id)).scalars())


def report(connection: Connection, claim_owner: str, job: str, values: dict[str, Any]) -> bool:
    """Change columns of a running job; whether its claim is still held."""
    update = change(_claimed(claim_owner, [job]), **values)
    return bool(connection.execute(update).rowcount)


def put_back(
    connection: Connection,
    claim_owner: str,
    held: Collection[str],
    seconds: float = 0.0,
    note: str | None = None,
) -> set[str]:
    """Queue running jobs again, to be tried after some seconds; return those that were queued."""
    retry_at = now(connection) + seconds if seconds else None
    where = _claimed(claim_owner, held)
    update = change(where, waiting_note=note, retry_at=retry_at, **QUEUED_AGAIN)
    queued = set(connection.execute(update.returning(jobs.c.id)).scalars())
    attempts.end(connection, queued, note or "its process or its workers ended")
    return queued


def succeed(
    connection: Connection, claim_owner: str, held: Collection[str], reused: bool
) -> dict[str, JobRow]:
    """End running jobs as succeeded, and with them queued jobs with the same results.

    Returns
    -------
    dict
        Id -> job, of all that ended.
    """
    values = {"state": "succeeded", "done": jobs.c.total, "reused": reused}
    ended = _end(connection, _claimed(claim_owner, held), values)
    return ended | _end(connection, _queued_equals(ended), values | {"reused": True})


def fail(
    connection: Connection, claim_owner: str, job: str, error: dict[str, Any]
) -> dict[str, JobRow]:
    """End a running job as failed, and queued jobs with the same request; return all that ended."""
    values = {"state": "failed", "error": error}
    ended = _end(connection, _claimed(claim_owner, [job]), values)
    return ended | _end(connection, _queued_equals(ended), values)


def _queued_equals(ended: Mapping[str, JobRow]) -> sa.ColumnElement[bool]:
    return QUEUED & jobs.c.result.in_({job.result for job in ended.values()})


def fail_overdue(connection: Connection, error: dict[str, Any]) -> dict[str, JobRow]:
    """End all jobs whose deadline has passed as failed; return them."""
    late = (QUEUED | RUNNING) & (jobs.c.deadline < now(connection))
    return _end(connection, late, {"state": "failed", "error": error})


def cancel(connection: Connection, owner: str, job: str) -> tuple[JobRow | None, bool]:
    """Cancel a job that is not final; the process that runs it loses its claim.

    Returns
    -------
    job : JobRow or None
    ended : bool
        Whether it was not final before.
    """
    where = (jobs.c.id == job) & (jobs.c.owner == owner) & (QUEUED | RUNNING)
    ended = _end(connection, where, {"state": "cancelled"})
    return ended.get(job) or find(connection, owner, job), bool(ended)


def _end(
    connection: Connection, where: sa.ColumnElement[bool], values: dict[str, Any]
) -> dict[str, JobRow]:
    """End jobs and return them."""
    finished = now(connection)
    update = change(
        where, phase="done", waiting_note=None, finished=finished, **_UNCLAIMED, **values
    )
    ended = {each.id: row(each) for each in connection.execute(update.returning(*jobs.c)).all()}
    error = values.get("error") or {}
    attempts.end(connection, ended, str(error.get("detail") or values["state"]))
    return ended


def _claimed(claim_owner: str, held: Collection[str]) -> sa.ColumnElement[bool]:
    return jobs.c.id.in_(held) & (jobs.c.claim_owner == claim_owner) & RUNNING


def release_all(connection: Connection) -> None:
    """Queue every running job again, at a start where no other process can be running them."""
    update = change(RUNNING, **QUEUED_AGAIN).returning(jobs.c.id)
    interrupted = list(connection.execute(update).scalars())
    attempts.end(connection, interrupted, "the service ended")
