"""/v1/jobs: submit, list, look up, wait, follow, cancel, and the result of a job."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Sequence
from datetime import UTC, datetime
from typing import Annotated, Final, TypeVar, cast

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from vibroimpact_schema import examples
from vibroimpact_schema.jobs import Attempt, Job, JobList, Progress, State
from vibroimpact_schema.problems import Problem
from vibroimpact_service import problems
from vibroimpact_service.api import answers, bodies, request_headers
from vibroimpact_service.api.bodies import while_connected
from vibroimpact_service.api.openapi import (
    BODY_FAILURES,
    IDEMPOTENCY_KEY,
    IF_NONE_MATCH,
    OF_RESULTS,
    READ_FAILURES,
    Declaration,
    answer,
    failures,
    header,
    json_body,
    not_modified,
    request_header,
)
from vibroimpact_service.api.results import ANY_RESULT, OF_RESULT, result_answer
from vibroimpact_service.api.route import FAILURES, READ, SUBMIT, admission, owner, services
from vibroimpact_service.api.shared_results import JobId, own_job, still_visible, visible_job
from vibroimpact_service.documents import requests
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results.encoders import JSON

Value = TypeVar("Value")

LONGEST_POLL: Final = 25.0
"""Seconds above which ``wait`` is cut."""
_HEARTBEAT_SECONDS: Final = 10.0

router = APIRouter(tags=["jobs"], responses=FAILURES)

Cursor = Annotated[int | None, Query(ge=1, le=2**53, description="Where the last page ended.")]
Limit = Annotated[int, Query(ge=1, le=500, description="Largest number of entries on the page.")]


def job_answer(description: str) -> Declaration:
    """Return the declaration of an answer that is a new job."""
    operations = ("get_job", "cancel_job", "get_job_result", "follow_job")
    links = {
        operation: {"job": "$response.body#/id"}
        for operation in (*operations, "get_share", "share_job", "unshare_job")
    }
    location = {"Location": header("Address of the job.")}
    return answer(description, Job, headers=location, links=links)


async def described(queue: JobQueue, job: JobRow) -> Job:
    """Return the document of a job."""
    return (await _described(queue, [job]))[0]


async def with_history(queue: JobQueue, job: JobRow) -> Job:
    """Return the document of a job with the attempts at it."""
    history = [
        Attempt(
            worker=each.worker,
            began=utc(each.began),
            ended=None if each.ended is None else utc(each.ended),
            why=each.why,
        )
        for each in await queue.history(job)
    ]
    return (await described(queue, job)).model_copy(update={"history": history})


async def _described(queue: JobQueue, jobs: Sequence[JobRow]) -> list[Job]:
    places = await queue.positions(jobs)
    return [_document(queue, job, places.get(job.id)) for job in jobs]


def _document(queue: JobQueue, job: JobRow, position: int | None) -> Job:
    return Job(
        id=job.id,
        version=job.version,
        kind=job.kind,
        name=job.name,
        state=cast("State", job.state),
        final=job.final,
        phase=job.phase,
        waiting_reason=queue.waiting_reason(job, position or 0),
        queue_position=position,
        progress=Progress(done=job.done, total=job.total, kept=job.kept),
        priority=job.priority,
        created=utc(job.created),
        started=None if job.started is None else utc(job.started),
        finished=None if job.finished is None else utc(job.finished),
        deadline=None if job.deadline is None else utc(job.deadline),
        attempts=job.attempts,
        estimate=job.seconds,
        reused=job.reused,
        digest=job.result,
        result=f"/v1/jobs/{job.id}/result" if job.state == "succeeded" else None,
        error=None if job.error is None else Problem.model_validate(job.error),
    )


def utc(seconds: float) -> datetime:
    """Return seconds since 1970 as a time."""
    return datetime.fromtimestamp(seconds, UTC)


@router.post(
    "/v1/jobs",
    operation_id="submit_job",
    status_code=201,
    summary="Queue a computation",
    description="The job is durable when this answers. Equal requests under way are computed once.",
    dependencies=[SUBMIT],
    responses={
        201: job_answer("The job."),
        **BODY_FAILURES,
    },
    openapi_extra={
        "requestBody": json_body(
            "JobRequest",
            {
                f"{kind}.{name}": {
                    "summary": example["summary"],
                    "value": {"kind": kind, "request": example["request"]},
                }
                for kind in KINDS
                for name, example in examples.requests(kind).items()
            },
        ),
        "parameters": [IDEMPOTENCY_KEY],
    },
)
async def submit_job(request: Request) -> Response:
    """Queue a computation."""
    key = request_headers.idempotency_key(request)
    body = await bodies.read_json(request)
    evaluation, settings = services(request).evaluation, services(request).settings
    computation, options = await evaluation.threads.parse(
        body, lambda: requests.read_job(owner(request), body, settings)
    )
    submitting = evaluation.submit(computation, admission(request), key, options)
    try:
        row = await while_connected(request, submitting)
    except ProblemError as error:
        raise error.under("request") from None
    headers = {"Location": f"/v1/jobs/{row.id}"}
    return answers.document(await described(evaluation.queue, row), 201, headers)


@router.get(
    "/v1/jobs",
    operation_id="list_jobs",
    summary="List jobs",
    description="The caller's jobs, newest first.",
    dependencies=[READ],
    responses={
        200: answer(
            "A page of jobs.",
            JobList,
            headers={"Link": header("The next page, rel=next (RFC 8288).")},
        ),
        **failures(400, 422, 500, 503),
    },
)
async def list_jobs(
    request: Request,
    state: Annotated[State | None, Query(description="Only jobs in this state.")] = None,
    kind: Annotated[str | None, Query(description="Only jobs of this kind.", max_length=40)] = None,
    cursor: Cursor = None,
    limit: Limit = 50,
) -> Response:
    """List the caller's jobs, newest first."""
    queue = services(request).evaluation.queue
    rows = await queue.list(owner(request), state, kind, cursor, limit + 1)
    page, more = rows[:limit], len(rows) > limit
    following = str(page[-1].seq) if more else None
    headers = {}
    if following is not None:
        url = request.url.include_query_params(cursor=following)
        headers["Link"] = f'<{url.path}?{url.query}>; rel="next"'
    jobs = await _described(queue, page)
    return answers.document(JobList(jobs=jobs, next=following), headers=headers)


@router.get(
    "/v1/jobs/{job}",
    operation_id="get_job",
    summary="State of a job",
    description="With wait, answers when the job is final or the time is over; with since as "
    "well, when anything has changed since that version.",
    dependencies=[READ],
    responses={
        200: answer("The job.", Job, links=OF_RESULT),
        **READ_FAILURES,
    },
)
async def get_job(
    request: Request,
    job: JobId,
    wait: Annotated[
        float | None,
        Query(
            ge=0,
            allow_inf_nan=False,
            description="Answer when the job is final, or after so many seconds, at most 25.",
        ),
    ] = None,
    since: Annotated[
        int | None,
        Query(ge=0, le=2**53, description="Version that is known: wait for another one."),
    ] = None,
) -> Response:
    """Return a job."""
    queue = services(request).evaluation.queue
    row = await visible_job(request, job)
    if wait and not row.final:
        seconds = min(wait, LONGEST_POLL)
        waiting = queue.wait(row.owner, job, seconds, since)
        row = await _unless_draining(request, waiting) or row
    return answers.document(await with_history(queue, row))


@router.delete(
    "/v1/jobs/{job}",
    operation_id="cancel_job",
    summary="Cancel a job",
    description="A queued job is cancelled at once, a running one soon; a final one does not "
    "change.",
    dependencies=[SUBMIT],
    responses={
        200: answer("The job.", Job),
        **READ_FAILURES,
    },
)
async def cancel_job(request: Request, job: JobId) -> Response:
    """Cancel a job; a final one does not change."""
    queue = services(request).evaluation.queue
    row = await own_job(request, job)
    cancelled = await queue.cancel(row.owner, job)
    assert cancelled is not None
    return answers.document(await described(queue, cancelled))


@router.get(
    "/v1/jobs/{job}/result",
    operation_id="get_job_result",
    summary="Result of a job",
    description="404 while there is none: not_ready, with Retry-After, or no_result if there "
    "will be none.",
    dependencies=[READ],
    responses={
        200: result_answer(ANY_RESULT),
        304: not_modified(),
        **READ_FAILURES,
        **failures(406),
    },
    openapi_extra={"parameters": [*OF_RESULTS, IF_NONE_MATCH]},
)
async def get_job_result(request: Request, job: JobId) -> Response:
    """Return the result of a job."""
    media_type = request_headers.result_media_type(request)
    row = await visible_job(request, job)
    if row.state in ("failed", "cancelled"):
        raise ProblemError(problems.NO_RESULT, f"The job was {row.state}.")
    if row.state != "succeeded":
        later = str(max(1, min(30, math.ceil(row.seconds))))
        detail = f"The job is {row.state}."
        raise ProblemError(problems.NOT_READY, detail, headers={"Retry-After": later})
    stored = await services(request).evaluation.result_of(row, media_type)
    if stored is None:
        raise ProblemError(problems.NO_RESULT, "The result is no longer stored; submit it again.")
    return await answers.result(request, row.result, stored)


@router.get(
    "/v1/jobs/{job}/events",
    operation_id="follow_job",
    summary="Follow a job",
    description="Server-sent events: job at every change, end at the last one; data is the job, "
    "id the number of the change, from which Last-Event-ID continues.",
    dependencies=[READ],
    responses={
        200: answer(
            "The events.",
            content={
                "text/event-stream": {
                    "schema": {
                        "type": "object",
                        "properties": {
                            "id": {"type": "string"},
                            "event": {"enum": ["job", "end"]},
                            "data": {
                                "type": "string",
                                "contentMediaType": JSON,
                                "contentSchema": {"$ref": "#/components/schemas/Job"},
                            },
                        },
                    }
                }
            },
        ),
        204: answer("The job has ended, and Last-Event-ID names its last change."),
        **READ_FAILURES,
    },
    openapi_extra={
        "parameters": [
            request_header("Last-Event-ID", "Number of the last change that was received.")
        ]
    },
)
async def follow_job(request: Request, job: JobId) -> Response:
    """Follow a job by server-sent events."""
    queue = services(request).evaluation.queue
    row = await visible_job(request, job)
    seen = request_headers.last_event(request.headers.get("last-event-id"))
    headers = {"X-Accel-Buffering": "no"}
    if row.final and seen >= row.version:
        return Response(status_code=204)  # a browser would connect again after anything else
    if request.state.head:
        return Response(headers=headers, media_type="text/event-stream")
    stream = _events(request, queue, row, seen)
    return StreamingResponse(stream, headers=headers, media_type="text/event-stream")


async def _events(
    request: Request, queue: JobQueue, job: JobRow, seen: int
) -> AsyncIterator[bytes]:
    """Yield the job whenever it changed, under the number of the change, until it is final."""
    with services(request).metrics.event_streams.track_inprogress():
        async for event in _changes(request, queue, job, seen):
            yield event


async def _changes(
    request: Request, queue: JobQueue, job: JobRow, seen: int
) -> AsyncIterator[bytes]:
    yield b"retry: 1000\n\n"
    final = False
    while not final:
        waiting = queue.wait(job.owner, job.id, _HEARTBEAT_SECONDS, seen)
        row = await _unless_draining(request, waiting)
        if row is None or not await still_visible(request, job):
            return
        final = row.final
        if row.version == seen:
            yield b": still here\n\n"
            continue
        seen = row.version
        text = (await described(queue, row)).model_dump_json()
        name = "end" if final else "job"
        yield f"id: {seen}\nevent: {name}\ndata: {text}\n\n".encode()


async def _unless_draining(request: Request, waiting: Awaitable[Value | None]) -> Value | None:
    """Return what an awaitable returns, or None once the service is told to stop."""
    drain = services(request).drain
    work, stop = asyncio.ensure_future(waiting), asyncio.ensure_future(drain.wait())
    try:
        await asyncio.wait({work, stop}, return_when=asyncio.FIRST_COMPLETED)
        return work.result() if work.done() else None
    finally:
        stop.cancel()
        if not work.done():
            work.cancel()
