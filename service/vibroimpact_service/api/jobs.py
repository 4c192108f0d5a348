"""/v1/jobs: submit, list, look, wait, follow, cancel, and the result of a job."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator, Sequence
from datetime import UTC, datetime
from typing import Annotated, Any, Final, Literal, cast

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from vibroimpact_schema.jobs import Job, JobList, Progress
from vibroimpact_schema.problems import Problem
from vibroimpact_service import problems
from vibroimpact_service.api import contract, exchange, sharing
from vibroimpact_service.api.guard import Guarded
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.records import JobRow
from vibroimpact_service.problems import ProblemError

LONGEST_POLL: Final = 25.0

router = APIRouter(tags=["jobs"], route_class=Guarded)

State = Literal["queued", "running", "succeeded", "failed", "cancelled"]


async def described(queue: JobQueue, job: JobRow) -> Job:
    """Return the document of a job."""
    return (await _described(queue, [job]))[0]


async def _described(queue: JobQueue, jobs: Sequence[JobRow]) -> list[Job]:
    places = await queue.positions(jobs)
    return [_document(queue, job, places.get(job.id)) for job in jobs]


def _document(queue: JobQueue, job: JobRow, position: int | None) -> Job:
    return Job(
        id=job.id,
        version=job.version,
        kind=job.kind,
        state=cast("State", job.state),
        final=job.final,
        phase=job.phase,
        waiting_reason=queue.waiting_reason(job, position or 0),
        queue_position=position,
        progress=Progress(done=job.done, total=job.total, kept=job.kept),
        priority=job.priority,
        created=_time(job.created),
        started=None if job.started is None else _time(job.started),
        finished=None if job.finished is None else _time(job.finished),
        deadline=None if job.deadline is None else _time(job.deadline),
        attempts=job.attempts,
        estimate=job.seconds,
        reused=job.reused,
        digest=job.result,
        result=f"/v1/jobs/{job.id}/result" if job.state == "succeeded" else None,
        error=None if job.error is None else Problem.model_validate(job.error),
    )


def _time(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)


@router.post("/v1/jobs", **contract.submit())
async def submit(request: Request) -> Response:
    """Queue a computation."""
    key = exchange.idempotency_key(request)
    body = await exchange.read_json(request)
    use = exchange.evaluation(request)
    asked, terms = await use.ask_job(exchange.owner(request), body)
    job = await use.submit(asked, exchange.spending(request), key, terms)
    headers = {"Location": f"/v1/jobs/{job.id}"}
    return exchange.document(await described(use.queue, job), 201, headers)


@router.get("/v1/jobs", **contract.job_list())
async def listed(
    request: Request,
    state: Annotated[State | None, Query(description="Only jobs in this state.")] = None,
    kind: Annotated[str | None, Query(description="Only jobs of this kind.", max_length=40)] = None,
    cursor: Annotated[
        int | None, Query(ge=1, le=2**53, description="Where the last page ended.")
    ] = None,
    limit: Annotated[int, Query(ge=1, le=500, description="Most jobs of the page.")] = 50,
) -> Response:
    """List one's own jobs, newest first."""
    queue = exchange.evaluation(request).queue
    rows = await queue.list(exchange.owner(request), state, kind, cursor, limit + 1)
    page, more = rows[:limit], len(rows) > limit
    following = str(page[-1].seq) if more else None
    headers = {}
    if following is not None:
        url = request.url.include_query_params(cursor=following)
        headers["Link"] = f'<{url.path}?{url.query}>; rel="next"'
    jobs = await _described(queue, page)
    return exchange.document(JobList(jobs=jobs, next=following), headers=headers)


@router.get("/v1/jobs/{job}", **contract.job())
async def looked_up(
    request: Request,
    job: str,
    wait: Annotated[
        float | None,
        Query(
            ge=0,
            allow_inf_nan=False,
            description="Answer once the job is final, or after so many seconds, 25 at most.",
        ),
    ] = None,
    since: Annotated[
        int | None,
        Query(ge=0, le=2**53, description="Version that is known: wait for any other one."),
    ] = None,
) -> Response:
    """Return a job."""
    queue = exchange.evaluation(request).queue
    row = await sharing.job(request, job)
    if wait and not row.final:
        seconds = min(wait, LONGEST_POLL)
        if since is None:
            waiting = queue.finished(row.owner, job, seconds)
        else:
            waiting = queue.wait(row.owner, job, since, seconds)
        row = await exchange.unless_draining(request, waiting) or row
    return exchange.document(await described(queue, row))


@router.delete("/v1/jobs/{job}", **contract.cancel())
async def cancelled(request: Request, job: str) -> Response:
    """Cancel a job; a final one stays as it is."""
    queue = exchange.evaluation(request).queue
    row = await sharing.own_job(request, job)
    cancelled = await queue.cancel(row.owner, job)
    assert cancelled is not None
    return exchange.document(await described(queue, cancelled))


@router.get("/v1/jobs/{job}/result", **contract.job_result())
async def result(request: Request, job: str) -> Response:
    """Return the result of a job."""
    media_type = exchange.wanted_representation(request)
    use = exchange.evaluation(request)
    row = await sharing.job(request, job)
    if row.state in ("failed", "cancelled"):
        raise ProblemError(problems.NO_RESULT, f"The job was {row.state}.")
    if row.state != "succeeded":
        later = str(max(1, min(30, math.ceil(row.seconds))))
        detail = f"The job is {row.state}."
        raise ProblemError(problems.NOT_READY, detail, headers={"Retry-After": later})
    found = await use.result_of(row, media_type)
    if found is None:
        raise ProblemError(problems.NO_RESULT, "The result is no longer stored; submit it again.")
    return await exchange.result(request, row.result, found)


@router.get("/v1/jobs/{job}/events", **contract.events())
async def events(request: Request, job: str) -> Response:
    """Follow a job by server-sent events."""
    queue = exchange.evaluation(request).queue
    row = await sharing.job(request, job)
    last = request.headers.get("last-event-id", "")
    seen = int(last) if last.isdigit() and len(last) < 10 else 0
    stream = _events(request, queue, row, seen)
    headers = {"X-Accel-Buffering": "no"}
    if request.state.head:
        return Response(headers=headers, media_type="text/event-stream")
    return StreamingResponse(stream, headers=headers, media_type="text/event-stream")


async def _events(
    request: Request, queue: JobQueue, job: JobRow, seen: int
) -> AsyncIterator[bytes]:
    """Yield the job whenever it changed, under the number of the change, until it is final."""
    yield b"retry: 1000\n\n"
    changes = queue.events(job.owner, job.id, seen)
    while True:
        change: Any = await exchange.unless_draining(request, _next(changes))
        if change is None:
            return
        (row,) = change
        if not await sharing.still_shown(request, job):
            return
        if row is None:
            yield b": still here\n\n"
            continue
        text = (await described(queue, row)).model_dump_json()
        name = "end" if row.final else "job"
        yield f"id: {row.version}\nevent: {name}\ndata: {text}\n\n".encode()


async def _next(changes: AsyncIterator[JobRow | None]) -> tuple[JobRow | None] | None:
    async for change in changes:
        return (change,)
    return None
